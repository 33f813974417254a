"""The combiner: chains into the hybrid system, constraints and their torques (eqs. 14–19).

Two ways lead to the hybrid system and must agree. `hybrid_from_chains` is the paper's: each chain
in its constrained form (eq. 15), added entry by entry where the coupling map says (eq. 18). The
other is what the emitted code uses: the chains' inertia is summed at the root before it is
projected, so the free rows are those of the reduced system, and each constrained joint adds its own
row. These rows, and the torques that hold links (eq. 14), come from the tree that has the
constrained joints, too, at rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation import tree_dynamics
from gibbs_codegen.derivation.forces import (
    forces_of_wrenches,
    input_matrix,
    motor_torque_about_rod,
    rotor_column,
)
from gibbs_codegen.derivation.motion import TreeState
from gibbs_codegen.derivation.passive import armatures, passive_forces, spring_loads
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.chains import coupling_map
from gibbs_codegen.robot.description import constrained_coordinate
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.symbolic.tape import Tape
from gibbs_codegen.symbolic.vectors import Matrix, Wrench, zeros


@dataclass(frozen=True)
class LinearSystem:
    """matrix · unknowns = residual + inputs · u."""

    matrix: Matrix
    residual: list[sp.Expr]
    inputs: Matrix

    @classmethod
    def empty(cls, symbolic: SymbolicRobot) -> LinearSystem:
        """A system of the hybrid unknowns with zeros, to be filled."""
        size = len(symbolic.description.hybrid_coordinates)
        return cls(zeros(size, size), [sp.S.Zero] * size, zeros(size, len(symbolic.u)))

    def folded(self, symbolic: SymbolicRobot) -> LinearSystem:
        """The system of the coordinates of a robot, from that of all joints that gears move."""
        tree = symbolic.ungeared
        if tree is symbolic:
            return self
        is_hybrid = len(self.residual) > len(tree.v)
        before, after = (
            [x.name for x in (d.hybrid_coordinates if is_hybrid else d.velocities)]
            for d in (tree.description, symbolic.description)
        )

        def folded(values: Sequence[sp.Expr]) -> list[sp.Expr]:
            by_name = dict(zip(before, values, strict=True))
            free = symbolic.folded([by_name[name] for name in tree.description.layout.v.names])
            by_name |= zip(symbolic.description.layout.v.names, free, strict=True)
            return [by_name[name] for name in after]

        columns = map(folded, zip(*map(folded, self.matrix), strict=True))
        pairs = zip(zip(*self.inputs, strict=True), tree.u, strict=True)
        inputs = [folded(column) for column, u in pairs if u != 0]
        rows = (zip(*x, strict=True) for x in (columns, inputs))
        matrix, driven = ([*map(list, row)] for row in rows)
        if not is_hybrid:  # It is symmetric, but sums on both sides are rounded otherwise.
            for i, row in enumerate(matrix):
                row[:i] = [matrix[j][i] for j in range(i)]
        return LinearSystem(matrix, folded(self.residual), driven)


def reduced_system(symbolic: SymbolicRobot) -> LinearSystem:
    """The reduced system M a = R + B u, in the order of v."""
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.reduced_tree
    minus_r = tree_dynamics.generalised_inertia_forces(
        tape, root, tree, symbolic.state.unaccelerated
    )
    matrix = tree_dynamics.mass_matrix(tape, root, tree)
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
    passive = zip(places, armatures(symbolic), passive_forces(symbolic), strict=True)
    with tape.group("armature, dampers and springs of the joints"):
        for row, armature, force in passive:
            if row is not None:
                matrix[row][row] = tape.let(matrix[row][row] + armature)
                residual[row] = tape.let(residual[row] + force)


def hybrid_system(symbolic: SymbolicRobot, reduced: LinearSystem) -> LinearSystem:
    """I_H a_H = R_H + B_H u (eqs. 18–19): free rows from the reduced system, the rest by joint."""
    system = LinearSystem.empty(symbolic)
    matrix, free = system.matrix, symbolic.description.layout.free
    for i, row in enumerate(free):
        for j, column in enumerate(free):
            matrix[row][column] = reduced.matrix[i][j]
        system.residual[row] = reduced.residual[i]
        system.inputs[row] = list(reduced.inputs[i])
    size = len(matrix)
    constrained = range(size)[symbolic.description.layout.constrained]
    for here, torque in zip(constrained, range(size - len(constrained), size), strict=True):
        matrix[here][torque], matrix[torque][here] = -sp.S.One, sp.S.One
    # The rows of the base rods' joints, each from its own chain, where the coupling map says.
    state = symbolic.state.unaccelerated
    maps = coupling_map(symbolic.robot)
    for (chain, serial), places in zip(symbolic.open_chains, maps, strict=True):
        if chain.rod is None:
            continue
        *coordinates, _ = places
        base, (here,) = symbolic.root.places(serial.joints).split(coordinates)
        inertia = tree_dynamics.joint_space_inertia(symbolic.tape, serial)
        with symbolic.tape.group(f"mass matrix, column of {serial.segments[1].joint_name}"):
            entries = symbolic.root.rows(symbolic.tape, inertia.wrenches[0])
        for row, entry in zip(base, entries, strict=True):
            matrix[row][here] = matrix[here][row] = entry
        matrix[here][here] = inertia.entries[0, 0]
        system.residual[here] = -serial.segments[1].row(rod_wrench(symbolic, serial, state))
        system.inputs[here][chain.rod - 1] = motor_torque_about_rod(symbolic, chain.rod)
    _fill_links(symbolic, system)
    return system


def rod_wrench(symbolic: SymbolicRobot, serial: SegmentTree, state: TreeState) -> Wrench:
    """𝒮 and ℛ of a base rod about its constrained joint, in the base's axes (N, N m).

    `serial` is the constrained chain: the root and one base arm. The component along the joint is
    ∂S/∂θ̈. In `state`, in the order of v, there is no rate or acceleration of the joint.
    """
    base_state = symbolic.state_with(state, [BASE])  # As the base, the rod has no joint that moves.
    motions = tree_dynamics.tree_motions(symbolic.tape, symbolic.root, serial, base_state)
    with symbolic.tape.group(f"inertia forces of {serial.subtree_about_joint(1)}"):
        return tree_dynamics.link_wrench(symbolic.tape, serial, 1, motions[1])


def _fill_links(symbolic: SymbolicRobot, system: LinearSystem) -> None:
    """Fill the rows of the joints that hold links, from the tree that has these joints."""
    if not symbolic.robot.constrained:
        return
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.hybrid_tree
    numbers, layout = symbolic.hybrid_bodies.numbers, symbolic.description.layout
    own_places = root.places(len(numbers))
    names = [coordinate.name for coordinate in symbolic.description.hybrid_coordinates]
    joints = [names.index(_coordinate(symbolic.robot, i)) for i in numbers]
    places = own_places.joined(symbolic.places.split(layout.free)[0], joints)
    state = symbolic.state_with(symbolic.state.unaccelerated, numbers)
    matrix = tree_dynamics.mass_matrix(tape, root, tree)
    minus_r = tree_dynamics.generalised_inertia_forces(tape, root, tree, state)
    columns = _thrust_columns(symbolic)
    for i, pull in zip(_constrained_places(symbolic), _held_pulls(symbolic), strict=True):
        here = places[i]
        for place, entry in zip(places, matrix[i], strict=True):
            system.matrix[here][place] = system.matrix[place][here] = entry
        system.residual[here] = tape.let(pull - minus_r[i])
        system.inputs[here][: len(columns)] = [column[i] for column in columns]


def _coordinate(robot: Robot, i: int) -> str:
    """Name of the coordinate of a link, or of a virtual one: −1, −2 …."""
    return coordinate_of(robot, i) if i > BASE else robot.base.virtual_joints[-1 - i]


def _thrust_columns(symbolic: SymbolicRobot) -> list[list[sp.Expr]]:
    """Effect of each rotor's unit thrust in the tree that has the constrained joints, too."""
    tree, bodies = symbolic.hybrid_tree, symbolic.hybrid_bodies
    return [rotor_column(symbolic, tree, bodies, k) for k in range(1, symbolic.robot.rotors + 1)]


def _held_pulls(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Effects of springs between frames on the constrained joints of links, in order."""
    loads = spring_loads(symbolic, symbolic.hybrid_bodies)
    forces = forces_of_wrenches(symbolic, symbolic.hybrid_tree, loads)
    return [forces[i] for i in _constrained_places(symbolic)]


def _constrained_places(symbolic: SymbolicRobot) -> list[int]:
    """Places of the constrained joints among the coordinates of the tree that has them."""
    robot, numbers = symbolic.robot, symbolic.hybrid_bodies.numbers
    joints = symbolic.root.places(len(numbers)).joint_places
    return [place for place, i in zip(joints, numbers, strict=True) if i in robot.constrained]


def constraint_torques(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """τ'_k (N m) of the constrained joints for given a and u (eq. 14), the base rods' first."""
    tape, torques = symbolic.tape, []
    for chain, serial in symbolic.open_chains:
        if chain.rod is not None:
            inertia_force = serial.segments[1].row(rod_wrench(symbolic, serial, symbolic.state))
            with tape.group(f"constraint torque on base arm {chain.rod}"):
                lever = motor_torque_about_rod(symbolic, chain.rod)
                active = tape.let(lever * symbolic.u[chain.rod - 1])
                torques.append(tape.let(inertia_force - active))
    if not symbolic.robot.constrained:
        return torques
    state = symbolic.state_with(symbolic.state, symbolic.hybrid_bodies.numbers)
    forces = tree_dynamics.generalised_inertia_forces(
        tape, symbolic.root, symbolic.hybrid_tree, state
    )
    columns = _thrust_columns(symbolic)
    for i, pull in zip(_constrained_places(symbolic), _held_pulls(symbolic), strict=True):
        with tape.group("constraint torques of links"):
            pairs = zip(columns, symbolic.u[: len(columns)], strict=True)
            thrusts = [tape.let(column[i] * thrust) for column, thrust in pairs]
            torques.append(tape.let(forces[i] - sp.Add(*thrusts, pull)))
    return torques


def chain_matrix(symbolic: SymbolicRobot, number: int) -> Matrix:
    """Mass matrix I_j of chain `number` (from 1), bordered with ±ζ where constrained (eq. 15)."""
    _, tree = symbolic.open_chains[number - 1]
    return _bordered(
        symbolic, number, tree_dynamics.mass_matrix(symbolic.tape, symbolic.root, tree)
    )


def chain_system(symbolic: SymbolicRobot, number: int) -> LinearSystem:
    """Chain `number`, from 1, in forward form (eqs. 11–17): I_jθ̈_j = R_j + F_j, for all inputs u.

    It is bordered where it is constrained. The chain of a base rod has the eight unknowns of eq.
    15: its seven accelerations and τ'_j.
    """
    tape, root = symbolic.tape, symbolic.root
    chain, serial = symbolic.open_chains[number - 1]
    by_name = dict(zip(symbolic.description.layout.v.names, symbolic.v, strict=True))
    rates = [by_name.get(name, sp.S.Zero) for name in chain.coordinates]
    state = TreeState.coasting(rates, symbolic.parameters.gravity)
    matrix = tree_dynamics.mass_matrix(tape, root, serial)
    residual = [-row for row in tree_dynamics.generalised_inertia_forces(tape, root, serial, state)]
    rows = {
        i: chain.coordinates.index(coordinate_of(symbolic.robot, i))
        for i in chain.own
        if i in symbolic.robot.moving
    }
    _add_passive(symbolic, [rows.get(i) for i in symbolic.jointed], matrix, residual)
    for i, pull in zip(symbolic.robot.constrained, _held_pulls(symbolic), strict=True):
        if i in chain.own:
            row = chain.coordinates.index(coordinate_of(symbolic.robot, i))
            residual[row] = tape.let(residual[row] + pull)
    # Effects of the inputs u (columns) on the chain's coordinates (rows) (eq. 13).
    thrust = zeros(len(chain.coordinates), len(symbolic.u))
    bodies = symbolic.chain_bodies(chain)
    for motor in chain.motors:
        for row, entry in enumerate(rotor_column(symbolic, serial, bodies, motor)):
            thrust[row][motor - 1] = entry
        if chain.rod is not None and motor > 1:
            (here,) = root.places(serial.joints).joint_places
            thrust[here][motor - 1] = motor_torque_about_rod(symbolic, motor)
    for i, row in rows.items():
        thrust[row][symbolic.robot.rotors + symbolic.robot.moving.index(i)] = sp.S.One
    for _ in chain.constrained:  # The last rows are ζᵀθ̈_j = 0.
        residual.append(sp.S.Zero)
        thrust.append([sp.S.Zero] * len(symbolic.u))
    return LinearSystem(_bordered(symbolic, number, matrix), residual, thrust)


def _bordered(symbolic: SymbolicRobot, number: int, matrix: Matrix) -> Matrix:
    """The mass matrix of chain `number` with ±ζ for each constrained joint."""
    chain, _ = symbolic.open_chains[number - 1]
    names = [constrained_coordinate(symbolic.robot, arm).name for arm in chain.constrained]
    places = [chain.coordinates.index(name) for name in names]
    border = [[sp.Integer(i == place) for place in places] for i in range(len(matrix))]
    rows = [[*row, *(-z for z in zeta)] for row, zeta in zip(matrix, border, strict=True)]
    nothing = [sp.S.Zero] * len(places)
    return [*rows, *([*column, *nothing] for column in zip(*border, strict=True))]


def hybrid_from_chains(symbolic: SymbolicRobot) -> LinearSystem:
    """The hybrid system by adding up the chains' systems where the coupling map places them.

    What holds a joint that several chains share is written by the first of them.
    """
    system = LinearSystem.empty(symbolic)
    matrix, residual, thrust = system.matrix, system.residual, system.inputs
    let = symbolic.tape.let
    for number, places in enumerate(coupling_map(symbolic.robot), start=1):
        chain = chain_system(symbolic, number)
        inner = len(places) - len(symbolic.open_chains[number - 1][0].constrained)
        for i, row in enumerate(places):
            residual[row] = let(residual[row] + chain.residual[i])
            for j, column in enumerate(places):
                if i < inner and j < inner:
                    matrix[row][column] = let(matrix[row][column] + chain.matrix[i][j])
                elif chain.matrix[i][j] != 0:
                    matrix[row][column] = chain.matrix[i][j]
            for j in range(len(symbolic.u)):
                thrust[row][j] = let(thrust[row][j] + chain.inputs[i][j])
    return system


# For each entry by rows and columns, the numbers of chains.
Filling = tuple[tuple[tuple[int, ...], ...], ...]


@dataclass(frozen=True)
class FilledEntries:
    """For each entry of I_H, R_H and B_H, the chains that add something to it (Figs. 7–9).

    `residual` has one column.
    """

    matrix: Filling
    residual: Filling
    inputs: Filling


def filled_entries(robot: Robot) -> FilledEntries:
    """Places of nonzero entries in the systems of single chains (eq. 15), by the coupling map.

    What they have for joints that gears or the ground move stands with what moves these.
    """
    symbolic, systems = SymbolicRobot.of(robot, Tape()), []
    tree = symbolic.ungeared
    for number, places in enumerate(coupling_map(robot), start=1):
        chain, system = chain_system(tree, number), LinearSystem.empty(tree)
        for i, row in enumerate(places):
            system.residual[row], system.inputs[row] = chain.residual[i], chain.inputs[i]
            for j, column in enumerate(places):
                system.matrix[row][column] = chain.matrix[i][j]
        systems.append(system.folded(symbolic))
    return FilledEntries(
        _filling(system.matrix for system in systems),
        _filling([[entry] for entry in system.residual] for system in systems),
        _filling(system.inputs for system in systems),
    )


def _filling(matrices: Iterable[Matrix]) -> Filling:
    """For each entry the numbers of the matrices, one a chain, in which it is not zero."""
    return tuple(
        tuple(
            tuple(number for number, entry in enumerate(entries, start=1) if entry != 0)
            for entries in zip(*rows, strict=True)
        )
        for rows in zip(*matrices, strict=True)
    )
