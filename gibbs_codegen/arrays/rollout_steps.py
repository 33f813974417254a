"""Steps of rollouts: inputs or linear feedback, limits, lag of motors, wrenches and bounds.

A program has what is asked for and nothing else. Inputs are commanded at the start of a step and
held through it; what becomes of them is known in closed form at its start, middle and end. Of a
robot that is driven, commands of motors and servos are held, and the states of its actuators are
integrated as velocities are; so are bristles of contacts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.arrays import impacts
from gibbs_codegen.arrays.contact import Contact, Touch, bristle_parts, bristles_of, touch
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.labels import labelled, named
from gibbs_codegen.arrays.nodes import (
    Input,
    Node,
    Program,
    clip,
    constant,
    coordinates_of,
    dot,
    entries_of,
    join,
    maximum,
    total,
    variable,
    zeros,
)
from gibbs_codegen.arrays.steps import METHODS, constrained_motion, projected
from gibbs_codegen.arrays.surroundings import air_on_rotors, on_frames


@dataclass(frozen=True)
class Parts:
    """What a rollout has besides inputs; a robot that is driven has its own lag.

    `walls` are contacts with them, each with the figures of its wall. `active` has 1 for each
    constraint that holds, else 0, if any does.
    """

    feedback: bool = False
    limits: bool = False
    lag: bool = False
    wrenches: bool = False
    bounds: bool = False
    walls: tuple[tuple[Contact, tuple[float, ...]], ...] = ()
    active: tuple[float, ...] = ()

    @property
    def bristles(self) -> int:
        """How many numbers the bristles of contacts have, which end the state."""
        return bristles_of(tuple(contact for contact, _ in self.walls))


ALL = Parts(feedback=True, limits=True, lag=True, wrenches=True, bounds=True)


def sent(robot: Functions) -> str:
    """What the input of programs is called that says what is commanded."""
    return "command" if robot.driven else "u"


def given(robot: Functions, parts: Parts) -> dict[str, Node]:
    """What a program with such parts is given of each state or all, by names, in their order.

    - `u` (nu): inputs, or `command` (nu) where the robot is driven
    - `gain` (nu, 2 nv), `desired_q` (nq) and `desired_v` (nv): feedback, which is added to them;
      with states of actuators a gain (nu, 2 nv + nx) and `desired_x` (nx)
    - `least` and `most` (nu): limits, within which they are then brought
    - `lag` (3, rotors): what is left of the way from thrusts to what is commanded at the start of a
      step, after half of it, and at its end
    - `wrenches` (frames, 6): on the frames, as of `forward_dynamics_with_wrenches`
    - `lowest` and `highest` (nq + nv): the least and the greatest q and v
    """
    n, m, inputs = robot.space.coordinates, robot.space.velocities, robot.inputs
    found = [variable(sent(robot), inputs)]
    if parts.feedback:
        states = robot.actuator_states
        found += [variable("gain", inputs, 2 * m + states, uniform=True)]
        found += [robot.coordinates("desired_q"), robot.velocities("desired_v")]
        found += [variable("desired_x", states)] if states else []
    if parts.limits:
        found += [variable(name, inputs, uniform=True) for name in ("least", "most")]
    if parts.lag and not robot.driven:
        found += [variable("lag", 3, robot.rotors)]
    if parts.wrenches:
        found += [variable("wrenches", robot.frames, 6)]
    if parts.bounds:
        found += [variable(name, n + m, uniform=True) for name in ("lowest", "highest")]
    return {x.operation.name: x for x in found if isinstance(x.operation, Input)}


@labelled
def rollout_step(
    robot: Functions, method: str, parts: Parts, name: str = "step", *, has_thrusts: bool = False
) -> Program:
    """A step of h from x: coordinates, velocities and, where motors may lag, thrusts.

    Of a robot that is driven, the states of its actuators follow in their place; bristles of
    contacts come last. `inputs` (nu) are
    those that are commanded, within limits. Where `ended` is above 0, the step has taken a state
    out of bounds. With `has_thrusts` it has thrusts without lag too, which are those commanded.
    """
    n, m = robot.space.coordinates, robot.space.velocities
    own = given(robot, parts)
    rotors = robot.rotors if "lag" in own or (has_thrusts and not robot.driven) else 0
    time, h = (variable(each, uniform=True) for each in ("time", "h"))
    driven = robot.actuator_states if robot.driven else 0
    end = n + m + (driven or rotors)
    x = variable("x", end + parts.bristles)
    q, v, actuators = coordinates_of(x[:n], robot.space), x[n : n + m], x[n + m : end]
    u = own[sent(robot)]
    if parts.feedback:
        away = _displacement(robot, q, own["desired_q"])
        parts_away = [away, own["desired_v"] - v]
        parts_away += [own["desired_x"] - actuators] if "desired_x" in own else []
        error = named(join(*parts_away), "error", "way to the desired state")
        u = named(u + own["gain"] @ error, "wanted", "inputs with linear feedback")
    if parts.limits:
        u = named(clip(u, own["least"], own["most"]), "commanded", "inputs within their limits")
    acting, active = [u] * 3, constant(parts.active)
    if "lag" in own:
        settled, efforts = u[:rotors], u[rotors:]
        way = actuators - settled
        acting = [join(settled + own["lag"][k] * way, efforts) for k in range(3)]

    contacts, kept = tuple(contact for contact, _ in parts.walls), m + driven + parts.bristles

    def touches(q: Node, v: Node, bristles: Node) -> list[Touch]:
        """What contacts do."""
        poses, velocities = robot.frame_poses(q), robot.frame_velocities(q, v)
        return [
            touch(each, constant(np.array(wall)), (poses[each.frame], velocities[each.frame]), z)
            for (each, wall), z in zip(parts.walls, bristle_parts(contacts, bristles), strict=True)
        ]

    def accelerate(q: Node, v: Node, halves: int) -> Node:
        """Accelerations, and rates of states of actuators and bristles, which follow in v.

        Where there are walls, also the power of all but contacts, and what these do.
        """
        v, states, bristles = v[:m], v[m : m + driven], v[m + driven : kept]
        inputs = robot.inputs_of(q, v, states, u) if robot.driven else acting[halves]
        wrenches, acting_on, touching = own.get("wrenches"), [], list[Touch]()
        if robot.air:
            velocities = robot.frame_velocities(q, v)
            speeds, moving = robot.rotor_speeds(states, u), (robot.frame_poses(q), velocities)
            acting_on += air_on_rotors(robot, moving, speeds, inputs, zeros(3))
        if parts.walls:
            touching = touches(q, v, bristles)
        pairs = list(zip(contacts, touching, strict=True))
        acting_on += [(each.frame, found.wrench) for each, found in pairs]
        if acting_on:
            on_all = on_frames(acting_on, robot.frames)
            wrenches = on_all if wrenches is None else wrenches + on_all
        a = None
        if wrenches is not None:
            a = robot.forward_dynamics_with_wrenches(q, v, inputs, wrenches)
        if parts.active:
            a, _ = constrained_motion(robot, (q, v), inputs, active, a)
        elif a is None:
            a = robot.forward_dynamics(q, v, inputs)
        rates = [robot.actuator_rates(states, u)] if states.size else []
        rates += [found.rate for each, found in pairs if each.sticks]
        if parts.walls:
            # By "euler" forces of the begin act through the step: on the mean of its velocities.
            mean = v + 0.5 * h * a if method == "euler" else v
            done = impacts.effects(contacts, touching, robot.frame_velocities(q, mean))
            rates += [dot(mean, robot.inverse_dynamics(q, v, a)) - done[0], done]
        return join(a, *rates)

    def move(q: Node, displacement: Node) -> Node:
        return _moved(robot, q, displacement[:m])

    spent = zeros(4 + 6 * len(contacts) if contacts else 0)
    begin = join(x[n : n + m + driven], x[end:], spent)
    q_next, v_next = METHODS[method](move, accelerate, q, begin, h)
    if parts.active:
        q_next, own_next = projected(robot, move, q_next, v_next[:m], active)
        v_next = join(own_next, v_next[m:])
    if contacts:
        states = [
            (place, moving[:m], moving[m + driven : kept])
            for place, moving in ((q, begin), (q_next, v_next))
        ]
        (work, done), held = (v_next[kept], v_next[kept + 1 :]), active if parts.active else None
        if method == "euler":  # What comes into a wall in a step was not pushed yet.
            done = done + h * join(zeros(3), *(found.wrench for found in touches(*states[1])))
        place, own_next = impacts.passive(robot, contacts, touches, states, work, done, held)
        q_next, v_next = coordinates_of(place, robot.space), join(own_next, v_next[m:])
    x_next = join(q_next, v_next[: m + driven], acting[2][:rotors], v_next[m + driven : kept])
    ended = constant(0.0)
    if parts.bounds:
        moved = x_next[: n + m]
        beyond = maximum(own["lowest"] - moved, 0.0) + maximum(moved - own["highest"], 0.0)
        ended = named(total(beyond), "beyond", "how far q and v are out of bounds")
    outputs = {"x_next": x_next, "ended": ended, "inputs": u}
    return Program(name, (time, h, x, *own.values()), outputs)


def _moved(robot: Functions, q: Node, displacement: Node) -> Node:
    """Coordinates after a displacement (nv): a sum, unless there is a quaternion."""
    if robot.space.has_quaternion:
        found: Node = robot.integrate(q, displacement)
        return found
    return coordinates_of(entries_of(q) + displacement, robot.space)


def _displacement(robot: Functions, q: Node, other: Node) -> Node:
    """The displacement (nv) from coordinates to others."""
    if robot.space.has_quaternion:
        found: Node = robot.difference(q, other)
        return found
    return entries_of(other) - entries_of(q)
