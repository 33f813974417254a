"""One open chain on symbols that read well: the derivation's own recursions, with other leaves.

Structural angles and inertias are numbers and polynomials to the derivation of code, which decides
by them which terms exist. To a reader they are θ_{j,4}, B₀, B₁ and B₂ + B₃. Here the chain is
made of these, and everything downstream is the same: the Gibbs function, its partials, the mass
matrix and the residual come from the functions that code is derived from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache, partial

import sympy as sp

from gibbs_codegen.derivation.forces import forces_of_wrenches, rotor_wrench
from gibbs_codegen.derivation.inertia import NO_INERTIA
from gibbs_codegen.derivation.motion import TreeState
from gibbs_codegen.derivation.passive import armatures, passive_forces
from gibbs_codegen.derivation.segment_tree import (
    JointedLink,
    Segment,
    SegmentTree,
    joint_rotation,
    tree_of_links,
)
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import (
    generalised_inertia_forces,
    gibbs_function,
    mass_matrix,
)
from gibbs_codegen.equations.chain_names import Made, chain_names, defined_inertias, fixed_rotation
from gibbs_codegen.equations.definitions import Definition
from gibbs_codegen.equations.normal_form import TooLongError, collected, count_terms
from gibbs_codegen.equations.typeset import Name
from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.chains import Chain, decompose
from gibbs_codegen.robot.description import constrained_coordinate
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of
from gibbs_codegen.robot.parts.numbers import AXES
from gibbs_codegen.symbolic.tape import InlineTape, Scalars, Stage
from gibbs_codegen.symbolic.vectors import NO_ROTATION, Matrix, Rotation, Wrench, X, Z, axis_vector


@dataclass(frozen=True)
class ReadableChain:
    """Chain `chain` of a robot in symbols, and their names.

    `serial` has the named inertias and places, which `definitions` gives by the parameters, and is
    made of `links`; `state` holds the rates, zero where a joint is held, and the accelerations, in
    the order of the coordinates. `wrenches` are those of the motors that act in the chain, per unit
    of thrust; `passive` says for each coordinate which armature adds to its row, and which force of
    dampers and springs.
    """

    symbolic: SymbolicRobot
    chain: Chain
    links: tuple[JointedLink, ...]
    serial: SegmentTree
    state: TreeState
    wrenches: dict[int, tuple[int, Wrench]]
    passive: tuple[tuple[sp.Expr, sp.Expr], ...]
    definitions: tuple[Definition, ...]
    names: dict[sp.Symbol, Name]

    @property
    def robot(self) -> Robot:
        """The robot that the chain is of."""
        return self.symbolic.robot

    @property
    def torques(self) -> tuple[sp.Symbol, ...]:
        """The constraint torques."""
        unknowns = self.chain.unknowns[len(self.chain.coordinates) :]
        return tuple(sp.Symbol(unknown) for unknown in unknowns)

    @property
    def held(self) -> tuple[int, ...]:
        """Places of what they hold among the coordinates."""
        names = [constrained_coordinate(self.robot, arm).name for arm in self.chain.constrained]
        return tuple(map(self.chain.coordinates.index, names))

    @property
    def quasi(self) -> bool:
        """True if the base's accelerations are rates of quasi-velocities."""
        return self.symbolic.description.layout.turns_with_base


def check_chain(robot: Robot, number: int) -> None:
    """Raise `UsageError` if a robot has no chain of a number, or springs that lead to others."""
    if robot.springs or robot.is_geared:
        by_gears = "wheels that turn" if robot.wheels else "gears"
        obstacle = "springs between frames" if robot.springs else by_gears
        raise UsageError(f"{robot.name}: chains cannot be shown with {obstacle}")
    chains = len(decompose(robot))
    if not 1 <= number <= chains:
        only = "only chain 1" if chains == 1 else f"chains 1 to {chains}"
        raise UsageError(f"chain {number}: {robot.name} has {only}")


def readable_chain(robot: Robot, number: int, tape: Scalars | None = None) -> ReadableChain:
    """Open chain `number`, from 1, in symbols that read well.

    Without a tape it is on one that names nothing.
    """
    tape = tape or InlineTape()
    symbolic = SymbolicRobot.of(robot, tape)
    chain, serial = symbolic.open_chains[number - 1]
    names = chain_names(symbolic, chain)
    # The meaning of the symbols of inertia and places is written in the parameters themselves.
    plain = SymbolicRobot.of(robot, InlineTape())
    first = symbolic.root_item
    made = Made(tape, number, names, plain)
    root, *segments = serial.segments
    links: list[JointedLink] = []
    if chain.rod is not None:
        (joint,) = _chain_joints(symbolic, chain)
        angle = tape.symbol(joint, Stage.CONFIGURATION)
        # Where θ_{j,3} turns about the base normal as well, their sum turns the arm.
        rotation = Rotation.angle(tape, Z, symbolic.root.segment_angle + angle)
        own_group = not symbolic.root.spins_about_normal
        segments = [replace(segments[0], rotation=rotation, starts_group=own_group)]
    else:
        placed = enumerate(plain.chain_bodies(chain).links, start=first + 1)
        links = [made.placed(item, link) for item, link in placed]
        fixed = partial(fixed_rotation, tape, names)
        _, *segments = tree_of_links(tape, root, symbolic.root.segment_angle, links, fixed).segments
    pairs = zip((root, *segments), defined_inertias(plain, chain), strict=True)
    serial = SegmentTree(
        tuple(
            replace(segment, inertia=made.inertia(item, inertia))
            for item, (segment, inertia) in enumerate(pairs, start=first)
        )
    )
    wrenches = {}
    for k in chain.motors:
        segment, wrench = _motor_wrench(plain, chain, k)
        wrenches[k] = segment, made.wrench(k, segment, wrench)
    terms = zip(symbolic.jointed, armatures(symbolic), passive_forces(symbolic), strict=True)
    passive = [(sp.S.Zero, sp.S.Zero)] * len(chain.coordinates)
    for i, armature, force in terms:
        if i in chain.own:
            passive[chain.coordinates.index(coordinate_of(robot, i))] = (armature, force)
    return ReadableChain(
        symbolic,
        chain,
        tuple(links),
        serial,
        chain_state(symbolic, chain),
        wrenches,
        tuple(passive),
        tuple(made.definitions),
        names,
    )


def own_frames(readable: ReadableChain) -> SegmentTree:
    """The chain with each segment in its own frame, and one more, without inertia, at its end.

    The derivation keeps segments on parallel axes in one frame, and a last segment in that of its
    parent, which saves operations and takes explaining.
    """
    symbolic, serial = readable.symbolic, readable.serial
    segments = [serial.segments[0]]
    if readable.chain.rod is not None:
        (joint,) = _chain_joints(symbolic, readable.chain)
        rotation = Rotation.angle(symbolic.tape, Z, sp.Symbol(joint))
        segments.append(replace(serial.segments[1], rotation=rotation, starts_group=True))
    else:
        tape, fixed = symbolic.tape, partial(fixed_rotation, symbolic.tape, readable.names)
        for link, segment in zip(readable.links, serial.segments[1:], strict=True):
            angle = link.coordinate if link.joint == "revolute" else sp.S.Zero
            rotation = joint_rotation(tape, angle, link.theta_deg, fixed)
            segments.append(replace(segment, rotation=rotation, starts_group=True))
    end = Segment(NO_INERTIA, NO_ROTATION, parent=len(segments) - 1)
    return SegmentTree((*segments, end))


def item_frames(readable: ReadableChain) -> tuple[tuple[sp.Expr, ...], ...]:
    """Poses of the items after the first in those before them, as `ChainEquation.frames`."""
    if readable.chain.rod is not None:
        (joint,) = _chain_joints(readable.symbolic, readable.chain)
        step = readable.serial.segments[1].step
        return ((sp.Integer(4), sp.Symbol(joint), sp.S.Zero, *step, *[sp.S.Zero] * 3),)
    rows = []
    for item, link in enumerate(readable.links, start=readable.symbolic.root_item + 1):
        gamma, alpha, theta = (  # As they are printed.
            sp.Integer(angle) if angle.denominator == 1 else sp.Float(float(angle))
            for angle in (link.turn_deg, link.alpha_deg, link.theta_deg)
        )
        rows.append((sp.Integer(item), link.coordinate, gamma, *link.step, alpha, link.d, theta))
    return tuple(rows)


def _chain_joints(symbolic: SymbolicRobot, chain: Chain) -> list[str]:
    """Names of the coordinates of a chain's joints."""
    joints = len(chain.coordinates) - len(symbolic.places.base)
    return symbolic.root.places(joints).split(chain.coordinates)[1]


def generalised_forces(readable: ReadableChain) -> list[sp.Expr]:
    """F_j (eqs. 7, 12, 16): Ψ of every motor of the chain times its thrust, and joint torques."""
    chain, symbolic, serial = readable.chain, readable.symbolic, readable.serial
    u = symbolic.u
    forces = [sp.S.Zero] * len(chain.coordinates)
    for k in chain.motors:
        motor_forces = forces_of_wrenches(symbolic, serial, dict([readable.wrenches[k]]))
        forces = [force + row * u[k - 1] for force, row in zip(forces, motor_forces, strict=True)]
    efforts = dict(zip(symbolic.robot.moving, u[symbolic.robot.rotors :], strict=True))
    for i in chain.own:
        if i in efforts:
            forces[chain.coordinates.index(coordinate_of(symbolic.robot, i))] += efforts[i]
    return forces


def _motor_wrench(symbolic: SymbolicRobot, chain: Chain, k: int) -> tuple[int, Wrench]:
    """Wrench of motor k ≥ 1 per unit of thrust, in the frame of what it is on (1 and m).

    That of a rod's motor is about the rod's joint; for motor 1 it is about the origin of the
    coordinates, at its seat or one rod from it.
    """
    if symbolic.robot.thrusters:
        return rotor_wrench(symbolic, symbolic.chain_bodies(chain), k)
    tape = symbolic.tape
    lever = axis_vector(X, symbolic.rod_reach(k))
    # An axis, or its components as symbols, those that are zero left out.
    thrust_axis = symbolic.robot.base.thrust[k - 1]
    direction = tuple(
        sp.Symbol(f"epsilon_{k}_{axis}") if entry else sp.S.Zero
        for axis, entry in zip("xyz", thrust_axis, strict=True)
    )
    if thrust_axis in AXES.values():
        direction = axis_vector(thrust_axis.index(1.0))
    if k == 1:
        lever = tape.add(symbolic.centre, symbolic.rod_frame(1).vector(tape, lever))
        direction = symbolic.rod_frame(1).vector(tape, direction)
    drag = tape.scale(symbolic.parameters.rotors[k]["drag"], direction)
    wrench = Wrench(direction, tape.add(tape.cross(lever, direction), drag))
    return 0 if k == 1 else 1, wrench


def chain_state(symbolic: SymbolicRobot, chain: Chain) -> TreeState:
    """The state of an open chain in symbols.

    Rates are zero where a joint is constrained; accelerations are kept there.
    """
    names = symbolic.description.layout.v.names
    free_rates = dict(zip(names, symbolic.v, strict=True))
    free_accelerations = dict(zip(names, symbolic.a, strict=True))
    rates, accelerations = [], []
    for coordinate in chain.coordinates:
        rates.append(free_rates.get(coordinate, sp.S.Zero))
        held = symbolic.tape.symbol(f"a_{coordinate}", Stage.MOTION)
        accelerations.append(free_accelerations.get(coordinate, held))
    return TreeState(rates, accelerations, symbolic.parameters.gravity)


@dataclass(frozen=True)
class ChainClosedForm:
    """S_j of one open chain and ∂S_j/∂θ̈_{j,i}, as expressions in the robot's symbols.

    `accelerations` are the symbols θ̈_{j,i} in the order of the chain's coordinates; `partials` come
    from the recursion of eq. 5, not from differentiating `gibbs`, so that the two can be compared.
    """

    coordinates: tuple[str, ...]
    accelerations: tuple[sp.Symbol, ...]
    gibbs: sp.Expr
    partials: tuple[sp.Expr, ...]


def chain_closed_form(robot: Robot, number: int) -> ChainClosedForm:
    """Closed form of an open chain (eqs. 2, 3 and 5), which grows about threefold with every link.

    Args:
        robot: The robot.
        number: Number of the chain, 1 to N.

    Returns:
        The closed form. A constrained joint keeps its acceleration as a symbol; its rate is zero.

    Raises:
        UsageError: If there is no such chain.
    """
    check_chain(robot, number)
    tape = InlineTape()
    symbolic = SymbolicRobot.of(robot, tape)
    chain, serial = symbolic.open_chains[number - 1]
    state = chain_state(symbolic, chain)
    return ChainClosedForm(
        chain.coordinates,
        tuple(state.accelerations),
        gibbs_function(tape, symbolic.root, serial, state),
        tuple(generalised_inertia_forces(tape, symbolic.root, serial, state)),
    )


@lru_cache(maxsize=8)
def closed_system(robot: Robot, chain: int, most: int) -> tuple[Matrix, list[sp.Expr]] | None:
    """I_j and R_j (eq. 15) in symbols that read well, collected by products of rates.

    `chain` is from 1. None if both have more than `most` terms together.
    """
    readable = readable_chain(robot, chain)
    tape, root, serial = readable.symbolic.tape, readable.symbolic.root, readable.serial
    rates = [rate for rate in readable.state.rates if rate != 0]
    unaccelerated = readable.state.unaccelerated
    rows = generalised_inertia_forces(tape, root, serial, unaccelerated)
    residual: list[sp.Expr] = []
    left = most
    try:
        for row, (_, force) in zip(rows, readable.passive, strict=True):
            residual.append(collected(force - row, rates, most))
            left -= count_terms(residual[-1])
            if left < 0:
                return None
        matrix = mass_matrix(tape, root, serial)
        for i, (armature, _) in enumerate(readable.passive):
            matrix[i][i] += armature
        for i, row in enumerate(matrix):
            for j in range(i + 1):
                row[j] = matrix[j][i] = collected(row[j], (), most)
                left -= count_terms(row[j])
    except TooLongError:
        return None
    return (matrix, residual) if left >= 0 else None
