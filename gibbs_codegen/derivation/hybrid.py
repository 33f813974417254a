"""The combiner: chains into the hybrid system, constraints and their torques (eqs. 14–19).

Two ways lead to the hybrid system and must agree. `hybrid_from_chains` is the paper's: each chain
in its constrained form (eq. 15), added entry by entry where the coupling map says (eq. 18). The
other is what the emitted code uses: the chains' inertia is summed at the root before it is
projected, so the free rows are those of the reduced system, and each constrained joint adds its own
row. These rows, and the torques that hold links (eq. 14), come from the tree that has the
constrained joints, too, at rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.composite_inertia import joint_space_inertia
from gibbs_codegen.derivation.forces import (
    armatures,
    input_matrix,
    motor_torque_about_rod,
    passive_forces,
    rotor_column,
)
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
from gibbs_codegen.robot.layout import held_coordinate, hybrid_coordinates, inputs, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of
from gibbs_codegen.symbolic.tape import Tape
from gibbs_codegen.symbolic.vectors import Matrix, Wrench, zeros


@dataclass(frozen=True)
class HeldRow:
    """The row of a joint that holds a link: number `place` of the hybrid system.

    `entries` are those of the mass matrix by their column in the hybrid system, `inputs` those of
    the rotors' thrusts.
    """

    place: int
    entries: dict[int, sp.Expr]
    residual: sp.Expr
    inputs: list[sp.Expr]


def held_rows(symbolic: SymbolicRobot) -> list[HeldRow]:
    """The rows of the joints that hold links, in order."""
    places = _held_places(symbolic)
    if not places:
        return []
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.held_tree
    state = symbolic.state_of(symbolic.held_bodies)
    matrix = mass_matrix(tape, root, tree)
    minus_r = generalised_inertia_forces(tape, root, tree, state.unaccelerated)
    columns = _thrust_columns(symbolic)
    everywhere = _places_of_held_tree(symbolic)
    return [
        HeldRow(
            everywhere[i],
            dict(zip(everywhere, matrix[i], strict=True)),
            -minus_r[i],
            [column[i] for column in columns],
        )
        for i in places
    ]


def torques_on_held_links(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """τ' (N m) of the joints that hold links, in order, given the free accelerations and inputs."""
    places = _held_places(symbolic)
    if not places:
        return []
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.held_tree
    state = symbolic.state_of(symbolic.held_bodies)
    forces = generalised_inertia_forces(tape, root, tree, state)
    columns = _thrust_columns(symbolic)
    thrusts = symbolic.u[: len(columns)]
    torques = []
    for i in places:
        with tape.group("constraint torques of links"):
            pairs = zip(columns, thrusts, strict=True)
            active = [tape.let(column[i] * thrust) for column, thrust in pairs]
            torques.append(tape.let(forces[i] - sp.Add(*active)))
    return torques


def _thrust_columns(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """What each rotor's unit thrust does in the tree with held joints."""
    tree, bodies = symbolic.held_tree, symbolic.held_bodies
    return [rotor_column(symbolic, tree, bodies, k) for k in range(1, symbolic.robot.rotors + 1)]


def _held_places(symbolic: SymbolicRobot) -> list[int]:
    """Places of the held joints among the coordinates of the tree that has them."""
    robot, numbers = symbolic.robot, symbolic.held_bodies.numbers
    joints = symbolic.root.places(len(numbers)).joint_places
    return [place for place, i in zip(joints, numbers, strict=True) if i in robot.constrained]


def _places_of_held_tree(symbolic: SymbolicRobot) -> list[int]:
    """Where the coordinates of the tree with held joints stand among the hybrid unknowns."""
    robot, layout = symbolic.robot, layout_of(symbolic.robot)
    names = [coordinate.name for coordinate in hybrid_coordinates(robot)]
    joints = [names.index(coordinate_of(robot, i)) for i in symbolic.held_bodies.numbers]
    base, _ = symbolic.places.split(layout.free)
    return symbolic.root.places(len(joints)).joined(base, joints)


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


Filling = tuple[tuple[tuple[int, ...], ...], ...]
_Open = list[list[list[int]]]


@dataclass(frozen=True)
class FilledEntries:
    """For each entry of I_H, R_H and B_H, the chains that add something to it (Figs. 7–9).

    `matrix` and `inputs` are by rows and columns; `residual` has one column.
    """

    matrix: Filling
    residual: Filling
    inputs: Filling


def filled_matrix(robot: Robot) -> Filling:
    """For each entry of I_H, the chains, by number, whose own matrix (eq. 15) is not zero there."""
    symbolic, size = SymbolicRobot.of(robot, Tape()), len(hybrid_coordinates(robot))
    matrix = _no_entries(size, size)
    for number, places in enumerate(coupling_map(robot), start=1):
        _note(matrix, number, chain_matrix(symbolic, number), places, places)
    return _frozen(matrix)


def filled_entries(robot: Robot) -> FilledEntries:
    """Where each chain's own system (eq. 15) has entries other than zero, by the coupling map."""
    symbolic = SymbolicRobot.of(robot, Tape())
    size, width = len(hybrid_coordinates(robot)), len(inputs(robot))
    matrix, residual, thrust = (_no_entries(size, columns) for columns in (size, 1, width))
    for number, places in enumerate(coupling_map(robot), start=1):
        system = chain_system(symbolic, number)
        _note(matrix, number, system.matrix, places, places)
        _note(residual, number, [[entry] for entry in system.residual], places, (0,))
        _note(thrust, number, system.inputs, places, range(width))
    return FilledEntries(*map(_frozen, (matrix, residual, thrust)))


def _no_entries(rows: int, columns: int) -> _Open:
    return [[[] for _ in range(columns)] for _ in range(rows)]


def _note(
    filling: _Open, number: int, entries: Matrix, rows: Iterable[int], columns: Sequence[int]
) -> None:
    """Note chain `number` in `filling` at `rows` and `columns`, where its entries are not zero."""
    for row, values in zip(rows, entries, strict=True):
        for column, entry in zip(columns, values, strict=True):
            if entry != 0:
                filling[row][column].append(number)


def _frozen(filling: _Open) -> Filling:
    return tuple(tuple(tuple(chains) for chains in row) for row in filling)
