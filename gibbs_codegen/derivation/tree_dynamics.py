"""Equations of motion of a tree on its root: mass matrix, residual, Gibbs function (eqs. 5, 11).

The same code derives a single open chain of the decomposition and the reduced system, which is the
arm on a root that has the sum of all chains' inertia: *sum before projecting*. Coordinates are
those of the root and of the joints of the segments, where the root places them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.composite_inertia import joint_space_inertia
from gibbs_codegen.derivation.inertia_forces import inward, outward, tree_gibbs_function
from gibbs_codegen.derivation.motion import Motion
from gibbs_codegen.derivation.root.protocol import Root
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import Matrix, zeros


@dataclass(frozen=True)
class State:
    """Velocities and their rates in the order of the tree's coordinates, and gravity.

    Zeros are as good as symbols: θ̈ = 0 gives the residual, θ̇ = 0 with the rates for accelerations
    and no gravity gives velocities.
    """

    rates: Sequence[sp.Expr]
    accelerations: Sequence[sp.Expr]
    gravity: sp.Expr

    @property
    def unaccelerated(self) -> State:
        """The state with θ̈ = 0, whose generalised inertia forces are −R."""
        return replace(self, accelerations=[sp.S.Zero] * len(self.rates))


def tree_motions(tape: Scalars, root: Root, tree: SegmentTree, state: State) -> list[Motion]:
    """Motion of every segment, in its working frame."""
    places = root.places(tree.joints)
    rates, joint_rates = places.split(state.rates)
    accelerations, joint_accelerations = places.split(state.accelerations)
    with tape.group(f"motion of {tree.segments[0].name}"):
        root_motion = root.frame_motion(tape, rates, accelerations, state.gravity)
    return outward(
        tape,
        tree,
        root_motion,
        [root.segment_spin(rates), *joint_rates],
        [root.segment_spin(accelerations), *joint_accelerations],
    )


def free_motions(
    tape: Scalars, root: Root, tree: SegmentTree, rates: Sequence[sp.Expr]
) -> list[Motion]:
    """Motions that the rates alone make about an origin at rest: every θ̈ is zero.

    Rates of the position are left out; motions are in the segments' working frames.
    """
    return motions_about_origin(tape, root, tree, State(rates, (), sp.S.Zero).unaccelerated)


def motions_about_origin(
    tape: Scalars, root: Root, tree: SegmentTree, state: State
) -> list[Motion]:
    """Motions about the origin of the coordinates, as if it were at rest, in working frames."""
    rates, accelerations = [*state.rates], [*state.accelerations]
    for values in (rates, accelerations):
        values[root.places(tree.joints).position] = [sp.S.Zero] * 3
    return tree_motions(tape, root, tree, State(rates, accelerations, state.gravity))


def generalised_inertia_forces(
    tape: Scalars, root: Root, tree: SegmentTree, state: State
) -> list[sp.Expr]:
    """∂S/∂θ̈, row by row (eq. 5): M a − R, or −R where the accelerations are zero (N m or N)."""
    motions = tree_motions(tape, root, tree, state)
    wrench, joints = inward(tape, tree, motions)
    places, mass = root.places(tree.joints), tree.segments[0].inertia.mass
    rates, _ = places.split(state.rates)
    accelerations, _ = places.split(state.accelerations)
    with tape.group("inertia forces on attitude and position"):
        *angular, x, y, z = root.rows(tape, wrench)
        moved = root.origin_acceleration(tape, rates, accelerations, state.gravity)
        linear = [tape.let(row + mass * r) for row, r in zip((x, y, z), moved, strict=True)]
    return places.joined([*angular, *linear], joints)


def gibbs_function(tape: Scalars, root: Root, tree: SegmentTree, state: State) -> sp.Expr:
    """S of the tree up to terms free of accelerations (eqs. 2–3)."""
    return tree_gibbs_function(tape, tree, tree_motions(tape, root, tree, state))


def mass_matrix(tape: Scalars, root: Root, tree: SegmentTree) -> Matrix:
    """Mass matrix of the tree in the order of its coordinates, both triangles.

    It is zero between joints of which neither supports the other.
    """
    inertia = joint_space_inertia(tape, tree)
    places = root.places(tree.joints)
    base, joints = places.base, places.joint_places
    matrix = zeros(places.size, places.size)
    with tape.group("mass matrix of attitude and position"):
        root_block = root.mass_block(tape, inertia.composite)
    for i, row in zip(base, root_block, strict=True):
        for j, entry in zip(base, row, strict=True):
            matrix[i][j] = entry
    for k, wrench in zip(joints, inertia.wrenches, strict=True):
        with tape.group("mass matrix between the joints and attitude and position"):
            entries = root.rows(tape, wrench)
        for i, entry in zip(base, entries, strict=True):
            matrix[i][k] = matrix[k][i] = entry
    for (j, k), entry in inertia.entries.items():
        matrix[joints[j]][joints[k]] = matrix[joints[k]][joints[j]] = entry
    return matrix
