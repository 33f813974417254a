"""The combiner: chains into the hybrid system, constraints and their torques (eqs. 14–19).

Two ways lead to the hybrid system and must agree. `hybrid_from_chains` is the paper's: each chain
in its constrained form (eq. 15), added entry by entry where the coupling map says (eq. 18). The
other is what the emitted code uses: the chains' inertia is summed at the root before it is
projected, so the free rows are those of the reduced system, and each constrained joint adds its own
row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.composite_inertia import joint_space_inertia
from gibbs_codegen.derivation.forces import input_matrix, motor_column, motor_torque_about_arm_joint
from gibbs_codegen.derivation.inertia_forces import link_wrench
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import (
    State,
    generalised_inertia_forces,
    mass_matrix,
    tree_motions,
)
from gibbs_codegen.robot.chains import Chain, coupling_map
from gibbs_codegen.robot.coordinates import hybrid_coordinates
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.symbolic.vectors import Matrix, zeros


@dataclass(frozen=True)
class LinearSystem:
    """matrix · unknowns = residual + inputs · u."""

    matrix: Matrix
    residual: list[sp.Expr]
    inputs: Matrix

    @classmethod
    def empty(cls, size: int, inputs: int) -> LinearSystem:
        """A system of zeros, to be filled.

        Args:
            size: Number of its rows and unknowns.
            inputs: Number of its inputs.

        Returns:
            The system.
        """
        return cls(zeros(size, size), [sp.S.Zero] * size, zeros(size, inputs))


def reduced_system(symbolic: SymbolicRobot) -> LinearSystem:
    """The reduced system M a = R + B u.

    Args:
        symbolic: The robot in symbols.

    Returns:
        Rows and unknowns in the order of v.
    """
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.reduced_tree
    minus_r = generalised_inertia_forces(tape, root, tree, symbolic.state.unaccelerated)
    return LinearSystem(
        mass_matrix(tape, root, tree), [-row for row in minus_r], input_matrix(symbolic)
    )


def constrained_joint_row(symbolic: SymbolicRobot, serial: SegmentTree, state: State) -> sp.Expr:
    """∂S/∂θ̈ of a constrained joint (N m).

    Args:
        symbolic: The robot in symbols.
        serial: The constrained chain: the root and one base arm.
        state: Rates and accelerations in the order of v; those of the constrained joint are zero.

    Returns:
        The row at the given rates and accelerations.
    """
    places = symbolic.root.places(serial.joints)

    def held(values: Sequence[sp.Expr]) -> list[sp.Expr]:
        base, _ = symbolic.places.split(values)
        return places.joined(base, [sp.S.Zero] * serial.joints)

    own = State(held(state.rates), held(state.accelerations), state.gravity)
    motions = tree_motions(symbolic.tape, symbolic.root, serial, own)
    with symbolic.tape.group(f"inertia forces of {serial.subtree_about_joint(1)}"):
        return link_wrench(symbolic.tape, serial, 1, motions[1]).moment[2]


def hybrid_system(symbolic: SymbolicRobot, reduced: LinearSystem) -> LinearSystem:
    """I_H a_H = R_H + B_H u (eqs. 18–19): free rows from the reduced system, the rest by chain.

    Where a chain's own joint, its constraint torque and its root coordinates stand among the hybrid
    unknowns is what the coupling map says.

    Args:
        symbolic: The robot in symbols.
        reduced: Its reduced system.

    Returns:
        Rows and unknowns in the order of the hybrid coordinates.
    """
    free, size = layout_of(symbolic.robot).free, len(hybrid_coordinates(symbolic.robot))
    system = LinearSystem.empty(size, len(symbolic.u))
    matrix = system.matrix
    for i, row in enumerate(free):
        for j, column in enumerate(free):
            matrix[row][column] = reduced.matrix[i][j]
        system.residual[row] = reduced.residual[i]
        system.inputs[row] = list(reduced.inputs[i])
    state = symbolic.state.unaccelerated
    maps = coupling_map(symbolic.robot)
    for (chain, serial), places in zip(symbolic.open_chains, maps, strict=True):
        if not chain.is_constrained:
            continue
        *coordinates, torque = places
        base, (here,) = symbolic.root.places(serial.joints).split(coordinates)
        inertia = joint_space_inertia(symbolic.tape, serial)
        with symbolic.tape.group(f"mass matrix, column of {serial.segments[1].joint_name}"):
            entries = symbolic.root.rows(symbolic.tape, inertia.wrenches[0])
        for row, entry in zip(base, entries, strict=True):
            matrix[row][here] = matrix[here][row] = entry
        matrix[here][here] = inertia.entries[0, 0]
        matrix[here][torque], matrix[torque][here] = -sp.S.One, sp.S.One
        system.residual[here] = -constrained_joint_row(symbolic, serial, state)
        arm = chain.links[-1]
        system.inputs[here][arm - 1] = motor_torque_about_arm_joint(symbolic, arm)
    return system


def constraint_torques(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """τ'_k for k = 2 … N, given the free coordinates' accelerations and the inputs (eq. 14).

    Args:
        symbolic: The robot in symbols.

    Returns:
        One torque for each constrained joint (N m).
    """
    torques = []
    for chain, serial in symbolic.open_chains:
        if chain.is_constrained:
            arm = chain.links[-1]
            inertia_force = constrained_joint_row(symbolic, serial, symbolic.state)
            with symbolic.tape.group(f"constraint torque on base arm {arm}"):
                lever = motor_torque_about_arm_joint(symbolic, arm)
                active = symbolic.tape.let(lever * symbolic.u[arm - 1])
                torques.append(symbolic.tape.let(inertia_force - active))
    return torques


def chain_matrix(symbolic: SymbolicRobot, number: int) -> Matrix:
    """Mass matrix I_j of a chain, bordered with ±ζ where the chain is constrained (eq. 15).

    Args:
        symbolic, number: The chain, by its number 1 … N.

    Returns:
        The matrix in the order of the chain's unknowns.
    """
    chain, serial = symbolic.open_chains[number - 1]
    matrix = mass_matrix(symbolic.tape, symbolic.root, serial)
    if not chain.is_constrained:
        return matrix
    zero, one = sp.S.Zero, sp.S.One
    places = symbolic.root.places(serial.joints)
    zeta = places.joined([zero] * len(places.base), [one])
    return [*([*row, -z] for row, z in zip(matrix, zeta, strict=True)), [*zeta, zero]]


def chain_system(symbolic: SymbolicRobot, number: int) -> LinearSystem:
    """A chain in forward form (eqs. 11–17): I_jθ̈_j = R_j + F_j, bordered where constrained.

    A constrained chain has the eight unknowns of eq. 15: its seven accelerations and τ'_j.

    Args:
        symbolic, number: The chain, by its number 1 … N.

    Returns:
        Rows in the order of the chain's unknowns; all inputs u.
    """
    tape, root = symbolic.tape, symbolic.root
    chain, serial = symbolic.open_chains[number - 1]
    matrix = chain_matrix(symbolic, number)
    by_name = dict(zip(layout_of(symbolic.robot).v.names, symbolic.v, strict=True))
    rates = [by_name.get(name, sp.S.Zero) for name in chain.coordinates]
    state = State(rates, (), symbolic.parameters.gravity).unaccelerated
    residual = [-row for row in generalised_inertia_forces(tape, root, serial, state)]
    thrust = _chain_inputs(symbolic, chain, serial)
    if chain.is_constrained:  # The last row is ζᵀθ̈_j = 0.
        residual.append(sp.S.Zero)
        thrust.append([sp.S.Zero] * len(symbolic.u))
    return LinearSystem(matrix, residual, thrust)


def hybrid_from_chains(symbolic: SymbolicRobot) -> LinearSystem:
    """The hybrid system by adding up the chains' systems where the coupling map places them.

    Args:
        symbolic: The robot in symbols.

    Returns:
        Rows and unknowns in the order of the hybrid coordinates.
    """
    size, width = len(hybrid_coordinates(symbolic.robot)), len(symbolic.u)
    system = LinearSystem.empty(size, width)
    matrix, residual, thrust = system.matrix, system.residual, system.inputs
    let = symbolic.tape.let
    for number, places in enumerate(coupling_map(symbolic.robot), start=1):
        chain = chain_system(symbolic, number)
        for i, row in enumerate(places):
            residual[row] = let(residual[row] + chain.residual[i])
            for j, column in enumerate(places):
                matrix[row][column] = let(matrix[row][column] + chain.matrix[i][j])
            for j in range(width):
                thrust[row][j] = let(thrust[row][j] + chain.inputs[i][j])
    return system


def _chain_inputs(symbolic: SymbolicRobot, chain: Chain, serial: SegmentTree) -> Matrix:
    """What the inputs do in a chain (eq. 13).

    Args:
        symbolic: The robot in symbols.
        chain, serial: The chain, and its segments.

    Returns:
        Rows in the order of the chain's coordinates, columns in that of u.
    """
    matrix = zeros(len(chain.coordinates), len(symbolic.u))
    places = symbolic.root.places(serial.joints)
    for motor in chain.motors:
        for row, entry in zip(places.base, motor_column(symbolic, motor), strict=True):
            matrix[row][motor - 1] = entry
        if motor > 1:
            (here,) = places.joint_places
            matrix[here][motor - 1] = motor_torque_about_arm_joint(symbolic, motor)
    if not chain.is_constrained:
        for i, row in enumerate(places.joint_places, start=symbolic.robot.rotors):
            matrix[row][i] = sp.S.One
    return matrix
