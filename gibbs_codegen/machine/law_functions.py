"""Laws as functions that firmware calls: of gains, a state and a reference, inputs.

Each is a program of named inputs, which structures of C hold. What a law knows of the rotors is the
result of a program too, of the constants alone, so that it is computed once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from gibbs_codegen.arrays.c_file import CFunction, Member, Structure
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.labels import labelled
from gibbs_codegen.arrays.nodes import (
    Input,
    Node,
    Program,
    clip,
    constant,
    coordinates_of,
    external,
    join,
    ordered,
    reshaped,
    variable,
    zeros,
)
from gibbs_codegen.machine.allocation import smallest_thrusts
from gibbs_codegen.machine.base import Motion, base_of
from gibbs_codegen.machine.laws import (
    LAWS,
    Aim,
    CentrePath,
    Estimates,
    FrameAim,
    Gains,
    Limits,
    PushAim,
    Rotors,
    adaptation,
    inputs_of,
    moved_wrenches,
    weight_of,
    within_limits,
)
from gibbs_codegen.machine.mechanism import carried

_OF_ROTORS = {
    "centre": "base centre relative to the origin (x, y, z), base's frame, m",
    "wrenches": "force and torque about the base centre of a unit input of each, base's frame",
    "distribution": "least inputs for unit wrenches, a row of six for each input",
    "mass": "mass of the robot, kg",
    "weight": "force that holds the robot, N, world axes",
    "axis": "unit vector along which the rotors push, base's frame",
}
_OF_REFERENCE = {
    "desired_q": ("q", "desired coordinates, rad and m"),
    "desired_v": ("v", "desired velocities, as v of the state"),
    "desired_a": ("a", "desired accelerations, the derivatives of v"),
    "centre_position": ("centre_position", "desired centre of mass, m, world axes"),
    "centre_velocity": ("centre_velocity", "its velocity, m/s"),
    "centre_acceleration": ("centre_acceleration", "its acceleration, m/s^2"),
    "direction": ("direction", "unit vector along which the tip pushes, world axes"),
    "push": ("push", "force, N: desired value, and integral correction of its error"),
    "share": ("share", "share of the push, 0 to 1; at 0 the tip follows its path"),
}
_LEARNT = Structure.kept(
    "estimates",
    "Estimates of the adaptive law, in the order of the base parameters.",
    parameters="difference from the constants' values, kg, kg m or kg m^2; initially 0",
)
_OF_GAINS = {
    "stiffness": "k of each error, 1/s^2",
    "damping": "d of each error, 1/s",
    "least": "lower limits of inputs, N and N m; -INFINITY for none",
    "most": "upper limits of inputs; INFINITY for none",
    "frame_stiffness": "stiffness of the tip along the axes of the world, N/m",
    "frame_damping": "damping of the tip, N s/m",
    "frame_inertia": "apparent mass of the tip, kg",
    "adaptation": "for each base parameter: square of its expected error, divided by an energy, J",
    "least_parameters": "lower limits of estimates, as differences from the constants' values",
    "most_parameters": "greatest of them",
    "back": "rate of return of the base from the side, 1/s, and speed at which it is half of that, "
    "m/s",
}


def law_functions(
    robot: Functions, laws: Iterable[str], centre: int, tip: int, moves: bool
) -> list[CFunction]:
    """The functions of some laws, after that of what they know of the rotors.

    `centre` is the place of the base centre among the points of `positions`, `tip` that of the
    frame which laws move that do, and `moves` whether joints move rotors.
    """
    laws = list(laws)
    programs = {law: _law(robot, law, tip, moves) for law in laws}
    read = {name for program in programs.values() for name in program.names}
    parts = {"rotors": robot.rotors, "wheels": robot.layout.q.wheels}
    known = f"Data of the {' and '.join(part for part in parts if parts[part])} for laws"
    rotors = Structure(
        "rotors",
        f"{known}, which init_rotors computes from the constants.",
        tuple(Member(name, name, words) for name, words in _OF_ROTORS.items() if name in read),
    )
    values_of = _known(robot, centre)
    outputs = {member.name: values_of[member.name]() for member in rotors.members}
    made = Program("init_rotors", (), outputs)
    words = f"{known}; call it again after the constants change."
    data = (rotors,) if rotors.members else ()
    functions = [CFunction(made, words, data)] if data else []
    others = tuple(_structures(robot, read))
    wheels = ", then torques of the wheels, N m" if parts["wheels"] else ""
    explained = {
        "u": f"inputs: thrusts, N, then efforts of the joints, N m or N{wheels}; NaN where the "
        "state or the reference is"
    }
    for law, program in programs.items():
        structures, words_by_name = (*data, *others), explained
        if "h" in program.names:
            structures, words_by_name = (
                (*structures, _LEARNT),
                {"h": "time since the last call, s"} | words_by_name,
            )
        functions.append(CFunction(program, LAWS[law].words, structures, words_by_name))
    return functions


def _structures(robot: Functions, read: Iterable[str]) -> Iterator[Structure]:
    """Structures that the caller fills: gains, state, reference."""
    by_velocity = "in the places of the velocities"
    position = "the position"
    if "axis" in read:
        position = "the centre of mass, which the heading takes too,"
    frames = " Errors of the attitude are differences of its angles."
    if robot.space.has_quaternion:
        frames = " The error of the attitude is a rotation vector in the base's frame."
    elif robot.layout.has_drive:
        position, frames = "x ahead", " The error of the yaw leads the base back to its path."
    yield Structure(
        "gains",
        f"Gains {by_velocity}, those of {position} in world axes, and limits.{frames}",
        tuple(Member(name, name, words) for name, words in _OF_GAINS.items() if name in read),
    )
    linear = "the base's frame" if robot.layout.turns_with_base else "world axes"
    spins = "angular ones too" if robot.space.has_quaternion else "rates of its angles"
    velocities = f"velocities: of the base in {linear}, {spins}, and of the joints, rad/s and m/s"
    state = {"q": "coordinates, rad and m; a quaternion has unit length", "v": velocities}
    state["wrench"] = "measured: force, N, and torque, N m, on the tip, about it, world axes"
    yield Structure(
        "state",
        "State of the robot.",
        tuple(Member(name, name, words) for name, words in state.items() if name in read),
    )
    members = [Member(field, name, words) for name, (field, words) in _OF_REFERENCE.items()]
    yield Structure(
        "reference",
        "Desired state.",
        tuple(member for member in members if member.value in read),
    )


@labelled
def _law(robot: Functions, law: str, tip: int, moves: bool) -> Program:
    """Inputs u (nu) of a law; the frame of the number `tip` is moved."""
    size, count, inputs = robot.space.velocities, len(robot.base_inputs), robot.inputs

    def argument(name: str, *shape: int) -> Node:
        return variable(name, *shape, uniform=True)

    q, v = robot.state()
    motion = Motion(
        robot.coordinates("desired_q"),
        robot.velocities("desired_v"),
        robot.velocities("desired_a"),
        argument("back", 2) if robot.space.has_drive else None,
    )
    gains = Gains(argument("stiffness", size), argument("damping", size))
    limits = Limits(argument("least", inputs), argument("most", inputs))
    rotors = Rotors(
        argument("centre", 3),
        argument("distribution", count, 6),
        argument("wrenches", count, 6),
        _pushing(robot, limits.least),
        _pushing(robot, limits.most),
        move=moves,
    )
    aim, row, outputs = Aim(motion, gains), LAWS[law], dict[str, Node]()
    if row.learns:
        length = robot.signatures["reference_regressor"].shapes[0][1]
        gain = argument("adaptation", length)
        least, most = (argument(f"{x}_parameters", length) for x in ("least", "most"))
        learnt = variable("parameters", length)
        aim = replace(aim, estimates=Estimates(learnt, gain))
        rates = adaptation(robot, q, v, aim)
        outputs["parameters_next"] = clip(learnt + argument("h") * rates, least, most)
    if row.leans:
        path = CentrePath(
            *(variable(f"centre_{x}", 3) for x in ("position", "velocity", "acceleration"))
        )
        aim = replace(aim, path=path, weight=weight_of(robot, q, argument, rotors))
    if row.moves_frame:
        stiffness, damping, inertia = (
            argument(f"frame_{x}", 3) for x in ("stiffness", "damping", "inertia")
        )
        wrench = variable("wrench", 6)
        aim = replace(aim, frame=FrameAim(tip, stiffness, damping, inertia, wrench))
    if aim.frame is not None and row.pushes:
        # Who calls learns the error of the force.
        push = PushAim(variable("direction", 3), variable("push"), variable("share"), constant(0.0))
        aim = replace(aim, frame=replace(aim.frame, push=push))
    force = carried(robot, q, row.force(robot, q, v, aim))
    outputs = {"u": within_limits(inputs_of(robot, q, force, rotors)[0], limits)} | outputs
    read = {
        x.operation.name: x for x in ordered(outputs.values()) if isinstance(x.operation, Input)
    }
    names = (*_OF_ROTORS, *_OF_GAINS, "q", "v", "wrench", *_OF_REFERENCE, "parameters", "h")
    return Program(law, tuple(read[name] for name in names if name in read), outputs)


def _pushing(robot: Functions, inputs: Node) -> Node:
    """The inputs (nu) that move the base."""
    thrusts, wheels = inputs[: robot.rotors], robot.layout.q.wheels
    return join(thrusts, inputs[robot.inputs - wheels :]) if wheels else thrusts


def _known(robot: Functions, centre: int) -> dict[str, Callable[[], Node]]:
    """Figures of the rotors for laws, by name: each calls functions that the others do not."""
    neutral = constant(robot.layout.neutral)
    q, count = coordinates_of(neutral, robot.space), len(robot.base_inputs)
    place, base = robot.layout.v.position, base_of(robot, q)
    offset = robot.positions(q)[centre] if robot.layout.moves_freely else zeros(3)
    rotors = Rotors(offset, zeros(count, 6), zeros(count, 6), zeros(count), zeros(count))
    columns = moved_wrenches(robot, q, rotors) if count else zeros(0, 6)

    def distribution() -> Node:
        units = (constant(unit) for unit in np.eye(6))
        least = (smallest_thrusts(columns, unit) for unit in units)
        return join(*(reshaped(thrusts, (1, count)) for thrusts in least)).transposed

    def weight() -> Node:
        rest = zeros(robot.space.velocities)
        force = robot.inverse_dynamics(q, rest, rest)
        return base.to_world(base.wrench(zeros(3), force)[:3])

    return {
        "centre": lambda: offset,
        "wrenches": lambda: columns,
        "distribution": distribution,
        "mass": lambda: robot.mass_matrix(q)[place.start][place.start],
        "weight": weight,
        "axis": lambda: external("force_axis", (3,), columns),
    }
