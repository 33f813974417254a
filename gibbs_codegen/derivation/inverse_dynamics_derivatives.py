"""Derivatives of inverse dynamics by coordinates and velocities, with M and the forces themselves.

    ∂τ/∂q,  ∂τ/∂v,  M  and  τ  of  τ = M a − R

in one pass. Derivatives by q are in the tangent space: of δ ↦ τ(q ⊕ δ) at zero, which with
Tait–Bryan angles are the partial derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.inverse_dynamics import inverse_dynamics
from gibbs_codegen.derivation.joint_derivatives import Entries, MovingTree, joint_derivatives
from gibbs_codegen.derivation.passive import passive_symbols
from gibbs_codegen.derivation.root.protocol import BaseDerivatives, Values
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import tree_motions
from gibbs_codegen.robot.layout import Places
from gibbs_codegen.symbolic.vectors import Matrix, zeros


@dataclass(frozen=True)
class InverseDynamicsDerivatives:
    """τ (N m or N), ∂τ/∂q, ∂τ/∂v and M; rows and columns in the order of v."""

    force: list[sp.Expr]
    force_dq: Matrix
    force_dv: Matrix
    mass_matrix: Matrix


def inverse_dynamics_derivatives(symbolic: SymbolicRobot) -> InverseDynamicsDerivatives:
    """Derivatives of inverse dynamics, from the moments of all subtrees.

    Columns of the position in ∂τ/∂q are zero.
    """
    force = inverse_dynamics(symbolic)
    tree, of_base = symbolic.reduced_tree, base_derivatives(symbolic)
    matrices = inertial_derivatives(symbolic, tree, of_base)
    _add_passive(symbolic, matrices)
    return InverseDynamicsDerivatives(force, *matrices)


def base_derivatives(symbolic: SymbolicRobot) -> BaseDerivatives:
    """How forces depend on the motion of the base, in the state that the symbols are."""
    places, state = symbolic.places, symbolic.state
    rates, accelerations = (
        places.split(values)[0] for values in (state.rates, state.accelerations)
    )
    with symbolic.tape.group("motion per unit of attitude and position"):
        return symbolic.root.derivatives(symbolic.tape, rates, accelerations, state.gravity)


def inertial_derivatives(
    symbolic: SymbolicRobot, tree: SegmentTree, of_base: BaseDerivatives
) -> tuple[Matrix, Matrix, Matrix]:
    """Derivatives of the inertia forces by q, v and a, for the reduced tree with any inertias."""
    tape, root, places = symbolic.tape, symbolic.root, symbolic.places
    moving = _moving_tree(symbolic, tree)
    joints = joint_derivatives(tape, moving)
    columns = [joints.columns[k] for k in range(1, symbolic.joints + 1)]
    with tape.group("mass matrix of attitude and position"):
        mass_block = root.mass_block(tape, moving.composite)
    block_dq, block_dv = of_base.blocks(tape, moving.bodies[0], mass_block)
    rows = [of_base.row(tape, column) for column in columns]
    with tape.group("columns of the joints, on attitude and position"):
        mass, by_rate, by_angle = (
            [root.rows(tape, wrench) for wrench in wrenches]
            for wrenches in (
                [column.mass for column in columns],
                [column.rate for column in columns],
                [column.angle for column in columns],
            )
        )
    mirrored = {(j, i): entry for (i, j), entry in joints.mass.items()}
    return (
        _assembled(places, block_dq, by_angle, [dq for dq, _ in rows], joints.by_angle),
        _assembled(places, block_dv, by_rate, [dv for _, dv in rows], joints.by_rate),
        _assembled(places, mass_block, mass, mass, joints.mass | mirrored),
    )


def _moving_tree(symbolic: SymbolicRobot, tree: SegmentTree) -> MovingTree:
    """A tree in the motion that the state says."""
    tape, root, state = symbolic.tape, symbolic.root, symbolic.state
    rates, joint_rates = symbolic.places.split(state.rates)
    accelerations, _ = symbolic.places.split(state.accelerations)
    motions = tree_motions(tape, root, tree, state)
    root_motion = root.frame_motion(tape, rates, accelerations, state.gravity)
    spins = [root.segment_spin(rates), *joint_rates]
    return MovingTree.of(tape, tree, root_motion, motions, spins)


def _assembled(
    places: Places,
    block: Matrix,
    columns: Sequence[Values],
    rows: Sequence[Values],
    entries: Entries,
) -> Matrix:
    """A matrix in the order of v, of the base and the joints.

    `block` is that of the base by itself, `columns` are the joints' columns on the base, `rows` the
    joints' rows in its columns, and `entries` are between joints, by their segments.
    """
    base, joints = places.base, places.joint_places
    matrix = zeros(places.size, places.size)
    for i, own in zip(base, block, strict=True):
        for j, entry in zip(base, own, strict=True):
            matrix[i][j] = entry
    for joint, column, row in zip(joints, columns, rows, strict=True):
        for place, above, beside in zip(base, column, row, strict=True):
            matrix[place][joint], matrix[joint][place] = above, beside
    for (i, j), entry in entries.items():
        matrix[joints[i - 1]][joints[j - 1]] = entry
    return matrix


def _add_passive(symbolic: SymbolicRobot, matrices: tuple[Matrix, Matrix, Matrix]) -> None:
    """Add springs, dampers and armature to the diagonals of ∂τ/∂q, ∂τ/∂v and M."""
    tape = symbolic.tape
    with tape.group("diagonals with the springs, dampers and armature of the joints"):
        for place, own in zip(symbolic.places.joint_places, passive_symbols(symbolic), strict=True):
            parts = (own.stiffness, own.damping, own.armature)
            for matrix, part in zip(matrices, parts, strict=True):
                matrix[place][place] = tape.let(matrix[place][place] + part)
