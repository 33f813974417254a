"""The combiner: chains into the hybrid system, constraints and their torques (eqs. 14–19).

Two ways lead to the hybrid system and must agree. `hybrid_from_chains` is the paper's: each chain
in its constrained form (eq. 15), added entry by entry where the coupling map says (eq. 18). The
other is what the emitted code uses: the chains' inertia is summed at the root before it is
projected, so the free rows are those of the reduced system, and each constrained joint adds its own
row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.composite_inertia import joint_space_inertia
from gibbs_codegen.derivation.forces import (
    input_matrix,
    motor_torque_about_rod,
    rotor_column,
)
from gibbs_codegen.derivation.held_links import held_rows, torques_on_held_links
from gibbs_codegen.derivation.inertia_forces import link_wrench
from gibbs_codegen.derivation.passive import armatures, passive_forces
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import (
    State,
    generalised_inertia_forces,
    mass_matrix,
    tree_motions,
)
from gibbs_codegen.robot.chains import Chain, coupling_map
from gibbs_codegen.robot.coordinates import held_coordinate, hybrid_coordinates
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.names import coordinate_of
from gibbs_codegen.symbolic.vectors import Matrix, Wrench, zeros


@dataclass(frozen=True)
class LinearSystem:
    """matrix · unknowns = residual + inputs · u."""

    matrix: Matrix
    residual: list[sp.Expr]
    inputs: Matrix

    @classmethod
    def empty(cls, size: int, inputs: int) -> LinearSystem:
        """A system of zeros, to be filled."""
        return cls(zeros(size, size), [sp.S.Zero] * size, zeros(size, inputs))


def reduced_system(symbolic: SymbolicRobot) -> LinearSystem:
    """The reduced system M a = R + B u, in the order of v."""
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.reduced_tree
    minus_r = generalised_inertia_forces(tape, root, tree, symbolic.state.unaccelerated)
    matrix = mass_matrix(tape, root, tree)
    residual = [-row for row in minus_r]
    _add_passive(symbolic, symbolic.places.joint_places, matrix, residual)
    return LinearSystem(matrix, residual, input_matrix(symbolic))


def _add_passive(
    symbolic: SymbolicRobot, places: Sequence[int | None], matrix: Matrix, residual: list[sp.Expr]
) -> None:
    """Add armature to a mass matrix, and dampers and springs to a residual.

    `places` has the row of each joint that moves, or None where it is left out.
    """
    tape = symbolic.tape
    given = zip(places, armatures(symbolic), passive_forces(symbolic), strict=True)
    with tape.group("armature, dampers and springs of the joints"):
        for row, armature, force in given:
            if row is not None:
                matrix[row][row] = tape.let(matrix[row][row] + armature)
                residual[row] = tape.let(residual[row] + force)


def constrained_joint_row(symbolic: SymbolicRobot, serial: SegmentTree, state: State) -> sp.Expr:
    """∂S/∂θ̈ of a constrained joint (N m).

    `serial` is the constrained chain: the root and one base arm. In `state`, in the order of v,
    rate and acceleration of the constrained joint are zero.
    """
    return serial.segments[1].row(constrained_joint_wrench(symbolic, serial, state))


def constrained_joint_wrench(symbolic: SymbolicRobot, serial: SegmentTree, state: State) -> Wrench:
    """𝒮 and ℛ of a base arm about the constrained joint, in the base's axes (N, N m).

    The arguments are as of `constrained_joint_row`.
    """
    places = symbolic.root.places(serial.joints)

    def held(values: Sequence[sp.Expr]) -> list[sp.Expr]:
        base, _ = symbolic.places.split(values)
        return places.joined(base, [sp.S.Zero] * serial.joints)

    own = State(held(state.rates), held(state.accelerations), state.gravity)
    motions = tree_motions(symbolic.tape, symbolic.root, serial, own)
    with symbolic.tape.group(f"inertia forces of {serial.subtree_about_joint(1)}"):
        return link_wrench(symbolic.tape, serial, 1, motions[1])


def hybrid_system(symbolic: SymbolicRobot, reduced: LinearSystem) -> LinearSystem:
    """I_H a_H = R_H + B_H u (eqs. 18–19): free rows from the reduced system, the rest by joint."""
    free, size = layout_of(symbolic.robot).free, len(hybrid_coordinates(symbolic.robot))
    system = LinearSystem.empty(size, len(symbolic.u))
    matrix = system.matrix
    for i, row in enumerate(free):
        for j, column in enumerate(free):
            matrix[row][column] = reduced.matrix[i][j]
        system.residual[row] = reduced.residual[i]
        system.inputs[row] = list(reduced.inputs[i])
    held = range(size)[layout_of(symbolic.robot).constrained]
    for here, torque in zip(held, range(size - len(held), size), strict=True):
        matrix[here][torque], matrix[torque][here] = -sp.S.One, sp.S.One
    _fill_rods(symbolic, system)
    for joint in held_rows(symbolic):
        for column, entry in joint.entries.items():
            matrix[joint.place][column] = matrix[column][joint.place] = entry
        system.residual[joint.place] = joint.residual
        system.inputs[joint.place][: symbolic.robot.rotors] = joint.inputs
    return system


def _fill_rods(symbolic: SymbolicRobot, system: LinearSystem) -> None:
    """Fill the rows of the base rods' joints, each from its own chain.

    Where a chain's joint and its root coordinates stand among the hybrid unknowns is what the
    coupling map says.
    """
    matrix, state = system.matrix, symbolic.state.unaccelerated
    maps = coupling_map(symbolic.robot)
    for (chain, serial), places in zip(symbolic.open_chains, maps, strict=True):
        if chain.rod is None:
            continue
        *coordinates, _ = places
        base, (here,) = symbolic.root.places(serial.joints).split(coordinates)
        inertia = joint_space_inertia(symbolic.tape, serial)
        with symbolic.tape.group(f"mass matrix, column of {serial.segments[1].joint_name}"):
            entries = symbolic.root.rows(symbolic.tape, inertia.wrenches[0])
        for row, entry in zip(base, entries, strict=True):
            matrix[row][here] = matrix[here][row] = entry
        matrix[here][here] = inertia.entries[0, 0]
        system.residual[here] = -constrained_joint_row(symbolic, serial, state)
        system.inputs[here][chain.rod - 1] = motor_torque_about_rod(symbolic, chain.rod)


def constraint_torques(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """τ'_k (N m) of the held joints, the base rods' first, for given a and u (eq. 14)."""
    torques = []
    for chain, serial in symbolic.open_chains:
        if chain.rod is not None:
            inertia_force = constrained_joint_row(symbolic, serial, symbolic.state)
            with symbolic.tape.group(f"constraint torque on base arm {chain.rod}"):
                lever = motor_torque_about_rod(symbolic, chain.rod)
                active = symbolic.tape.let(lever * symbolic.u[chain.rod - 1])
                torques.append(symbolic.tape.let(inertia_force - active))
    return [*torques, *torques_on_held_links(symbolic)]


def chain_matrix(symbolic: SymbolicRobot, number: int) -> Matrix:
    """Mass matrix I_j of chain `number` (from 1), bordered with ±ζ where constrained (eq. 15)."""
    _, tree = symbolic.open_chains[number - 1]
    return _bordered(symbolic, number, mass_matrix(symbolic.tape, symbolic.root, tree))


def chain_system(symbolic: SymbolicRobot, number: int) -> LinearSystem:
    """Chain `number`, from 1, in forward form (eqs. 11–17): I_jθ̈_j = R_j + F_j, for all inputs u.

    It is bordered where it is constrained. The chain of a base rod has the eight unknowns of eq.
    15: its seven accelerations and τ'_j.
    """
    tape, root = symbolic.tape, symbolic.root
    chain, serial = symbolic.open_chains[number - 1]
    by_name = dict(zip(layout_of(symbolic.robot).v.names, symbolic.v, strict=True))
    rates = [by_name.get(name, sp.S.Zero) for name in chain.coordinates]
    state = State(rates, (), symbolic.parameters.gravity).unaccelerated
    matrix = mass_matrix(tape, root, serial)
    residual = [-row for row in generalised_inertia_forces(tape, root, serial, state)]
    rows = {
        i: chain.coordinates.index(coordinate_of(symbolic.robot, i))
        for i in chain.own
        if i in symbolic.robot.moving
    }
    _add_passive(symbolic, [rows.get(i) for i in symbolic.robot.moving], matrix, residual)
    thrust = _chain_inputs(symbolic, chain, serial, rows)
    for _ in chain.held:  # The last rows are ζᵀθ̈_j = 0.
        residual.append(sp.S.Zero)
        thrust.append([sp.S.Zero] * len(symbolic.u))
    return LinearSystem(_bordered(symbolic, number, matrix), residual, thrust)


def _bordered(symbolic: SymbolicRobot, number: int, matrix: Matrix) -> Matrix:
    """The mass matrix of chain `number` with ±ζ for each joint that is held."""
    chain, _ = symbolic.open_chains[number - 1]
    robot, zero, one = symbolic.robot, sp.S.Zero, sp.S.One
    names = [held_coordinate(robot, arm).name for arm in chain.held]
    held = [chain.coordinates.index(name) for name in names]
    border = [[one if i == place else zero for place in held] for i in range(len(matrix))]
    rows = [[*row, *(-z for z in zeta)] for row, zeta in zip(matrix, border, strict=True)]
    return [*rows, *([*column, *[zero] * len(held)] for column in zip(*border, strict=True))]


def hybrid_from_chains(symbolic: SymbolicRobot) -> LinearSystem:
    """The hybrid system by adding up the chains' systems where the coupling map places them.

    What holds a joint that several chains share is written by the first of them.
    """
    size, width = len(hybrid_coordinates(symbolic.robot)), len(symbolic.u)
    system = LinearSystem.empty(size, width)
    matrix, residual, thrust = system.matrix, system.residual, system.inputs
    let = symbolic.tape.let
    for number, places in enumerate(coupling_map(symbolic.robot), start=1):
        chain = chain_system(symbolic, number)
        torques = len(symbolic.open_chains[number - 1][0].held)
        inner = len(places) - torques
        for i, row in enumerate(places):
            residual[row] = let(residual[row] + chain.residual[i])
            for j, column in enumerate(places):
                if i < inner and j < inner:
                    matrix[row][column] = let(matrix[row][column] + chain.matrix[i][j])
                elif chain.matrix[i][j] != 0:
                    matrix[row][column] = chain.matrix[i][j]
            for j in range(width):
                thrust[row][j] = let(thrust[row][j] + chain.inputs[i][j])
    return system


def _chain_inputs(
    symbolic: SymbolicRobot, chain: Chain, serial: SegmentTree, rows: Mapping[int, int]
) -> Matrix:
    """What the inputs u (columns) do to a chain's coordinates (rows) (eq. 13).

    `rows` has the row of each joint that moves and is counted in this chain, by its link's number.
    """
    matrix = zeros(len(chain.coordinates), len(symbolic.u))
    bodies = symbolic.chain_bodies(chain)
    for motor in chain.motors:
        on_rod = chain.rod is not None
        column = rotor_column(symbolic, serial, bodies, motor)
        for row, entry in enumerate(column):
            matrix[row][motor - 1] = entry
        if on_rod and motor > 1:
            (here,) = symbolic.root.places(serial.joints).joint_places
            matrix[here][motor - 1] = motor_torque_about_rod(symbolic, motor)
    for i, row in rows.items():
        matrix[row][symbolic.robot.rotors + symbolic.robot.moving.index(i)] = sp.S.One
    return matrix
