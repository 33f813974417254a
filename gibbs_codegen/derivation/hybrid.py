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
from gibbs_codegen.derivation.machine import Machine
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.tree_dynamics import (
    Matrix,
    State,
    generalised_inertia_forces,
    mass_matrix,
    tree_motions,
)
from gibbs_codegen.robot.chains import Chain, coupling_map
from gibbs_codegen.robot.coordinates import hybrid_coordinates
from gibbs_codegen.robot.layout import layout_of


@dataclass(frozen=True)
class LinearSystem:
    """matrix · unknowns = residual + inputs · u."""

    matrix: Matrix
    residual: list[sp.Expr]
    inputs: Matrix


def unaccelerated_state(machine: Machine) -> State:
    """The state with θ̈ = 0, whose generalised inertia forces are −R.

    Args:
        machine: The robot in symbols.

    Returns:
        Its rates and gravity, with accelerations of zero.

    """
    zeros = [sp.S.Zero] * len(machine.q)
    return State(machine.v, zeros, machine.parameters.gravity)


def reduced_system(machine: Machine) -> LinearSystem:
    """The reduced system M a = R + B u.

    Args:
        machine: The robot in symbols.

    Returns:
        Rows and unknowns in the order of q.

    """
    tape, root, tree = machine.tape, machine.root, machine.reduced_tree
    minus_r = generalised_inertia_forces(tape, root, tree, unaccelerated_state(machine))
    return LinearSystem(
        mass_matrix(tape, root, tree), [-row for row in minus_r], input_matrix(machine)
    )


def constrained_joint_column(
    machine: Machine, serial: SegmentTree
) -> tuple[tuple[sp.Expr, ...], sp.Expr]:
    """Column of I_H for a constrained joint.

    Args:
        machine: The robot in symbols.
        serial: The constrained chain: the root and one base arm.

    Returns:
        Its entries at the base's coordinates, and its own.

    """
    tape = machine.tape
    inertia = joint_space_inertia(tape, serial)
    with tape.group(f"mass matrix, column of {serial.segments[1].joint_name}"):
        return machine.root.rows(tape, inertia.wrenches[0]), inertia.entries[0, 0]


def constrained_joint_row(machine: Machine, serial: SegmentTree, state: State) -> sp.Expr:
    """∂S/∂θ̈ of a constrained joint (N m).

    Args:
        machine: The robot in symbols.
        serial: The constrained chain: the root and one base arm.
        state: Rates and accelerations in the order of q; those of the constrained joint are zero.

    Returns:
        The row at the given rates and accelerations.

    """
    places = machine.root.places(serial.joints)

    def held(values: Sequence[sp.Expr]) -> list[sp.Expr]:
        base, _ = machine.places.split(values)
        return places.joined(base, [sp.S.Zero] * serial.joints)

    own = State(held(state.rates), held(state.accelerations), state.gravity)
    motions = tree_motions(machine.tape, machine.root, serial, own)
    with machine.tape.group(f"inertia forces of {serial.subtree_about_joint(1)}"):
        return link_wrench(machine.tape, serial, 1, motions[1]).moment[2]


def hybrid_system(machine: Machine, reduced: LinearSystem) -> LinearSystem:
    """I_H a_H = R_H + B_H u (eqs. 18–19): free rows from the reduced system, the rest by chain.

    Where a chain's own joint, its constraint torque and its root coordinates stand among the hybrid
    unknowns is what the coupling map says.

    Args:
        machine: The robot in symbols.
        reduced: Its reduced system.

    Returns:
        Rows and unknowns in the order of the hybrid coordinates.

    """
    free, size = layout_of(machine.robot).free, len(hybrid_coordinates(machine.robot))
    zero, one = sp.S.Zero, sp.S.One
    matrix: Matrix = [[zero] * size for _ in range(size)]
    residual = [zero] * size
    thrust: Matrix = [[zero] * len(machine.u) for _ in range(size)]
    for i, row in enumerate(free):
        for j, column in enumerate(free):
            matrix[row][column] = reduced.matrix[i][j]
        residual[row] = reduced.residual[i]
        thrust[row] = list(reduced.inputs[i])
    state = unaccelerated_state(machine)
    maps = coupling_map(machine.robot)
    for (chain, serial), places in zip(machine.open_chains, maps, strict=True):
        if not chain.is_constrained:
            continue
        *coordinates, torque = places
        base, (here,) = machine.root.places(serial.joints).split(coordinates)
        entries, own = constrained_joint_column(machine, serial)
        for row, entry in zip(base, entries, strict=True):
            matrix[row][here] = matrix[here][row] = entry
        matrix[here][here] = own
        matrix[here][torque], matrix[torque][here] = -one, one
        residual[here] = -constrained_joint_row(machine, serial, state)
        arm = chain.links[-1]
        thrust[here][arm - 1] = motor_torque_about_arm_joint(machine, arm)
    return LinearSystem(matrix, residual, thrust)


def constraint_torques(machine: Machine) -> list[sp.Expr]:
    """τ'_k for k = 2 … N, given the free coordinates' accelerations and the inputs (eq. 14).

    Args:
        machine: The robot in symbols.

    Returns:
        One torque for each constrained joint (N m).

    """
    state = State(machine.v, machine.a, machine.parameters.gravity)
    torques = []
    for chain, serial in machine.open_chains:
        if chain.is_constrained:
            arm = chain.links[-1]
            inertia_force = constrained_joint_row(machine, serial, state)
            with machine.tape.group(f"constraint torque on base arm {arm}"):
                lever = motor_torque_about_arm_joint(machine, arm)
                active = machine.tape.let(lever * machine.u[arm - 1])
                torques.append(machine.tape.let(inertia_force - active))
    return torques


def chain_matrix(machine: Machine, number: int) -> Matrix:
    """Mass matrix I_j of a chain, bordered with ±ζ where the chain is constrained (eq. 15).

    Args:
        machine, number: The chain, by its number 1 … N.

    Returns:
        The matrix in the order of the chain's unknowns.

    """
    chain, serial = machine.open_chains[number - 1]
    matrix = mass_matrix(machine.tape, machine.root, serial)
    if not chain.is_constrained:
        return matrix
    zero, one = sp.S.Zero, sp.S.One
    places = machine.root.places(serial.joints)
    zeta = places.joined([zero] * len(places.base), [one])
    return [*([*row, -z] for row, z in zip(matrix, zeta, strict=True)), [*zeta, zero]]


def chain_system(machine: Machine, number: int) -> LinearSystem:
    """A chain in forward form (eqs. 11–17): I_jθ̈_j = R_j + F_j, bordered where constrained.

    A constrained chain has the eight unknowns of eq. 15: its seven accelerations and τ'_j.

    Args:
        machine, number: The chain, by its number 1 … N.

    Returns:
        Rows in the order of the chain's unknowns; all inputs u.

    """
    tape, root = machine.tape, machine.root
    chain, serial = machine.open_chains[number - 1]
    matrix = chain_matrix(machine, number)
    rates = _chain_values(machine, chain, machine.v)
    state = State(rates, [sp.S.Zero] * len(rates), machine.parameters.gravity)
    residual = [-row for row in generalised_inertia_forces(tape, root, serial, state)]
    thrust = _chain_inputs(machine, chain, serial)
    if chain.is_constrained:  # The last row is ζᵀθ̈_j = 0.
        residual.append(sp.S.Zero)
        thrust.append([sp.S.Zero] * len(machine.u))
    return LinearSystem(matrix, residual, thrust)


def hybrid_from_chains(machine: Machine) -> LinearSystem:
    """The hybrid system by adding up the chains' systems where the coupling map places them.

    Args:
        machine: The robot in symbols.

    Returns:
        Rows and unknowns in the order of the hybrid coordinates.

    """
    size, width = len(hybrid_coordinates(machine.robot)), len(machine.u)
    zero = sp.S.Zero
    matrix: Matrix = [[zero] * size for _ in range(size)]
    residual = [zero] * size
    thrust: Matrix = [[zero] * width for _ in range(size)]
    let = machine.tape.let
    maps = coupling_map(machine.robot)
    for number, places in enumerate(maps, start=1):
        system = chain_system(machine, number)
        for i, row in enumerate(places):
            residual[row] = let(residual[row] + system.residual[i])
            for j, column in enumerate(places):
                matrix[row][column] = let(matrix[row][column] + system.matrix[i][j])
            for j in range(width):
                thrust[row][j] = let(thrust[row][j] + system.inputs[i][j])
    return LinearSystem(matrix, residual, thrust)


def _chain_values(machine: Machine, chain: Chain, values: tuple[sp.Symbol, ...]) -> list[sp.Expr]:
    """Rates or accelerations of a chain's coordinates.

    Args:
        machine: The robot in symbols.
        chain: The chain.
        values: Rates or accelerations in the order of q.

    Returns:
        Values in the order of the chain's coordinates; that of a constrained joint is zero.

    """
    by_name = {symbol.name: value for symbol, value in zip(machine.q, values, strict=True)}
    return [by_name.get(name, sp.S.Zero) for name in chain.coordinates]


def _chain_inputs(machine: Machine, chain: Chain, serial: SegmentTree) -> Matrix:
    """What the inputs do in a chain (eq. 13).

    Args:
        machine: The robot in symbols.
        chain, serial: The chain, and its segments.

    Returns:
        Rows in the order of the chain's coordinates, columns in that of u.

    """
    zero, one = sp.S.Zero, sp.S.One
    matrix: Matrix = [[zero] * len(machine.u) for _ in chain.coordinates]
    places = machine.root.places(serial.joints)
    for motor in chain.motors:
        for row, entry in zip(places.base, motor_column(machine, motor), strict=True):
            matrix[row][motor - 1] = entry
        if motor > 1:
            (here,) = places.joint_places
            matrix[here][motor - 1] = motor_torque_about_arm_joint(machine, motor)
    if not chain.is_constrained:
        for i, row in enumerate(places.joint_places, start=machine.robot.rotors):
            matrix[row][i] = one
    return matrix
