"""Motions of a tree outwards and its inertia forces inwards: ∂S/∂θ̈ by recursion (eqs. 5 and 6)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import sympy as sp

from gibbs_codegen.derivation.gibbs import (
    ACCELERATION,
    GRADIENT,
    MASS,
    OMEGA,
    OMEGA_DOT,
    evaluated,
    link_gibbs_function,
    link_partials_by_gradient,
)
from gibbs_codegen.derivation.motion import Motion
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    NO_WRENCH,
    Wrench,
    axis_vector,
    scale,
)


def outward(
    tape: Scalars,
    tree: SegmentTree,
    root_motion: Motion,
    rates: Sequence[sp.Expr],
    accelerations: Sequence[sp.Expr],
) -> list[Motion]:
    """Motion of every segment, in its working frame.

    `root_motion` is of the root's group frame in its own axes; the root's own rate and acceleration
    are its turn about z against that frame.
    """
    motions: list[Motion] = []
    for k, segment in enumerate(tree.segments):
        with tape.group(f"motion of {segment.name}"):
            motion = _passed_out(tape, tree, k, motions[segment.parent]) if k else root_motion
            move = motion.spun if segment.joint == "revolute" else motion.slid
            motion = move(tape, rates[k], accelerations[k])
            if tree.works_in_own_frame(k):
                motion = motion.rotated(tape, segment.rotation.inverse)
        motions.append(motion)
    return motions


def _passed_out(tape: Scalars, tree: SegmentTree, k: int, motion: Motion) -> Motion:
    """Motion of segment k ≥ 1 before joint k moves, in its group frame, from its parent's."""
    segment = tree.segments[k]
    if segment.starts_group:
        motion = motion.rotated(tape, segment.turn.inverse)
        motion = motion.stepped(tape, NO_ROTATION, segment.step)
        motion = motion.rotated(tape, segment.twist.inverse)
    else:
        parent = tree.segments[segment.parent]
        motion = motion.stepped(tape, parent.rotation, segment.step)
    return motion.displaced(tape, axis_vector(2, segment.d))


def before_joints(
    tape: Scalars, tree: SegmentTree, root_motion: Motion, motions: Sequence[Motion]
) -> list[Motion]:
    """Motion of every segment before its joint moves it, in its group frame, from `outward`'s."""
    before = [root_motion]
    for k, segment in enumerate(tree.segments[1:], start=1):
        with tape.group(f"motion of {segment.name}"):
            before.append(_passed_out(tape, tree, k, motions[segment.parent]))
    return before


def link_wrench(tape: Scalars, tree: SegmentTree, k: int, motion: Motion) -> Wrench:
    """𝒮 and ℛ of segment k (eq. 6) about its joint, in its working frame (N, N m).

    The root's B₀r̈ is left out: regrouping brings most of the mass there, and it is cheapest in
    world axes.
    """
    segment = tree.segments[k]
    inertia = tree.working_inertia(tape, k)
    values = inertia.values
    if k == 0:
        values[MASS] = sp.S.Zero
    values.update(zip(ACCELERATION, motion.acceleration, strict=True))
    for j, column in enumerate(motion.gradient):
        values.update((GRADIENT[i][j], entry) for i, entry in enumerate(column))
    force, moment = link_partials_by_gradient()
    wrench = Wrench.of(tape.let(evaluated(partial, values)) for partial in (*force, *moment))
    c_x, c_y, c_z = segment.inertia.moment
    if c_y == c_z == 0 and values[MASS] == 0 and not tree.works_in_own_frame(k):
        # A rod: its 𝒮 is parallel to the step to the next joint, which the kinematics has.
        return Wrench(scale(tape, c_x, motion.along_x(tape, segment.rotation)), wrench.moment)
    return wrench


def inward(
    tape: Scalars,
    tree: SegmentTree,
    motions: Sequence[Motion],
    loads: Mapping[int, Wrench] = MappingProxyType({}),
) -> tuple[Wrench, list[sp.Expr]]:
    """∂S/∂θ̈ of the tree (eq. 5): 𝒮 and ℛ of it all at the root, and the rows of the joints.

    They are about the root in its group frame, without its B₀r̈, which the caller adds. The
    arguments are those of `subtree_wrenches`.
    """
    root, *others = subtree_wrenches(tape, tree, motions, loads)
    # Neither component along the joint is turned by what turns about it.
    rows = [s.row(wrench) for s, wrench in zip(tree.segments[1:], others, strict=True)]
    with tape.group(f"inertia forces of {tree.subtree_about_joint(0)}"):
        return tree.to_group_frame(tape, 0, root), rows


def subtree_wrenches(
    tape: Scalars,
    tree: SegmentTree,
    motions: Sequence[Motion],
    loads: Mapping[int, Wrench] = MappingProxyType({}),
) -> list[Wrench]:
    """𝒮 and ℛ of each segment with all that it supports: what its joint has to supply.

    They are about the joint in the working frame, as `motions` are; the root's are without its
    B₀r̈. `loads` act on segments after the root, by their index, about the joint in the segment's
    own frame (N, N m), and are subtracted.
    """
    received = [NO_WRENCH for _ in tree.segments]
    for k in range(tree.joints, -1, -1):
        segment = tree.segments[k]
        with tape.group(f"inertia forces of {tree.subtree_about_joint(k)}"):
            wrench = link_wrench(tape, tree, k, motions[k]).plus(tape, received[k])
            if k in loads:
                load = tree.to_working_frame(tape, k, loads[k])
                wrench = wrench.plus(tape, load.opposite)
            received[k] = wrench
            if k > 0:
                wrench = tree.to_group_frame(tape, k, wrench)
        if k > 0:
            with tape.group(f"inertia forces of {tree.subtree_about_joint(segment.parent)}"):
                wrench = tree.passed_in(tape, k, wrench)
                received[segment.parent] = received[segment.parent].plus(tape, wrench)
    return received


def tree_gibbs_function(tape: Scalars, tree: SegmentTree, motions: Sequence[Motion]) -> sp.Expr:
    """Σ of eq. 2 over the links, up to terms free of accelerations."""
    terms = []
    for k, motion in enumerate(motions):
        with tape.group(f"Gibbs function of {tree.segments[k].name}"):
            values = tree.working_inertia(tape, k).values
            values.update(zip(ACCELERATION, motion.acceleration, strict=True))
            values.update(zip(OMEGA, motion.omega, strict=True))
            values.update(zip(OMEGA_DOT, motion.omega_dot, strict=True))
            terms.append(tape.let(evaluated(link_gibbs_function(), values)))
    with tape.group("sum over the links"):
        return tape.let(sp.Add(*terms))
