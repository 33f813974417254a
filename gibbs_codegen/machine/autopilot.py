"""Between an autopilot and a robot, as array programs: commands of its outputs, and its sensors.

The autopilot flies the base. Joints go where they are to by computed torque: the inverse dynamics
of the accelerations that they are to have, and of the one that the base has under what acts on it,
which its acceleration tells. What is no number of outputs commands nothing: motors rest, and joints
stay where they were asked to be, or follow the desired motion if they never were.
"""

from __future__ import annotations

import math

from gibbs_codegen.arrays.nodes import (
    Node,
    Program,
    choose,
    clip,
    coordinates_of,
    entries_of,
    join,
    maximum,
    reshaped,
    solve,
    variable,
    zeros,
)
from gibbs_codegen.machine.closed_loop import LoopStructure
from gibbs_codegen.machine.surroundings import origin_of, rotation_of

# Least damping, 1/s, by which stiffness is divided: a servo of positions has none.
_LEAST = 1e-9


def _or(x: Node, otherwise: Node | float) -> Node:
    """Entries, or others where they are no numbers: these are greater than nothing."""
    return choose(x, -math.inf, x, otherwise)


def command_program(loop: LoopStructure) -> Program:
    """Inputs `u` (nu) that outputs command, and where joints are `next` (n) asked to be.

    Of a time, the state x, accelerations `a` (nv), shares of `motors` (N), from 0 to 1 between
    `least` and `most` (N), and places of `servos` (n), from -1 to 1 between `low` and `high` (n);
    then where joints were `asked` to be (n), and the gains (nv) of errors.
    """
    robot, layout = loop.plant, loop.plant.layout
    count, joints = robot.rotors, robot.inputs - robot.rotors
    time, x, a = variable("time", uniform=True), variable("x", loop.size), robot.velocities("a")
    motors, least, most = (variable(name, count) for name in ("motors", "least", "most"))
    servos, low, high, asked = (
        variable(name, joints) for name in ("servos", "low", "high", "asked")
    )
    stiffness, damping = (robot.velocities(name) for name in ("stiffness", "damping"))
    inputs = time, x, a, motors, least, most, servos, low, high, asked, stiffness, damping
    thrusts = least + clip(_or(motors, 0.0), 0.0, 1.0) * (most - least)
    if not joints:
        return Program("outputs", inputs, {"u": thrusts, "next": asked})
    asked = _or(low + 0.5 * (clip(servos, -1.0, 1.0) + 1.0) * (high - low), asked)
    q, v, *_ = loop.parts(x)
    n, m = robot.space.coordinates, robot.space.velocities
    at, places, curves = layout.q.joints, layout.v.joints, loop.curves(time)[0]
    wanted = _or(asked, curves[:n][at])
    # What is asked for stands still.
    rate, growth = (choose(asked, -math.inf, 0.0, curves[k : k + m][places]) for k in (n, n + m))
    stiffness, damping = stiffness[places], damping[places]
    off = wanted - entries_of(q)[at]
    wished = growth + damping * (rate - v[places]) + stiffness * off

    def others(rows: Node) -> Node:
        return join(rows[: places.start], rows[places.stop :])

    def beside(base: Node, moved: Node) -> Node:
        return join(base[: places.start], moved, base[places.start :])

    # What acts on the base stays, and joints that move otherwise move it otherwise.
    by_base = others(robot.mass_matrix(q)).transposed
    change = solve(others(by_base), by_base[places].transposed @ (wished - a[places]))
    force = robot.inverse_dynamics(q, v, beside(others(a) - change, wished))[places]
    if not robot.driven:
        if loop.moves:
            loads = robot.input_matrix(q)[places].transposed[:count]
            force = force - loads.transposed @ thrusts
        return Program("outputs", inputs, {"u": join(thrusts, force), "next": asked})
    # Servos of positions have no gains; those of rates correct the error by theirs.
    correction = choose(damping, 0.0, stiffness / maximum(damping, _LEAST), 0.0)
    entries = entries_of(q)
    aim = coordinates_of(join(entries[: at.start], wanted, entries[at.stop :]), robot.space)
    speed = beside(others(v), rate + correction * off)
    sent = robot.command_of(aim, speed, join(zeros(count), force))
    return Program("outputs", inputs, {"u": join(thrusts, sent[count:]), "next": asked})


def telling_program(loop: LoopStructure, measurement: Program) -> Program:
    """The output `told` of a motion: measurements of sensors, and the true motion of the base.

    The latter is its position (3), m, and velocity (3), m/s, world axes, and its attitude: the
    quaternion (4), real part last, or else the rotation (9) to the world. Of the state x and
    accelerations `a` (nv); `measurement` is as of `sensors.measurement_program`.
    """
    robot = loop.plant
    x, a, gravity = variable("x", loop.size), robot.velocities("a"), variable("gravity", 3)
    q, v, *_ = loop.parts(x)
    measured = measurement(q, v, a, zeros(robot.frames, 6), gravity)[0]
    pose, attitude = robot.frame_poses(q)[0], entries_of(q)[robot.layout.q.attitude]
    if not robot.space.has_quaternion:
        attitude = reshaped(rotation_of(pose), (9,))
    velocity = robot.frame_velocities(q, v)[0][:3]
    telemetry = join(measured, origin_of(pose), velocity, attitude)
    return Program("telling", (x, a, gravity), {"told": telemetry})
