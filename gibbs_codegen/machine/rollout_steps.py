"""Steps of rollouts: inputs or linear feedback, limits, lag of motors, wrenches and bounds.

A program has what is asked for and nothing else. Inputs are commanded at the start of a step and
held through it; what becomes of them is known in closed form at its start, middle and end. Where
there are drives, commands of motors and servos are held, and the states of actuators are
integrated as velocities are; so are bristles of contacts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.labels import labelled, named
from gibbs_codegen.arrays.nodes import (
    Input,
    Node,
    Program,
    absolute,
    choose,
    clip,
    constant,
    coordinates_of,
    join,
    maximum,
    total,
    variable,
    zeros,
)
from gibbs_codegen.machine import impacts
from gibbs_codegen.machine.inner_loop import InnerLoop
from gibbs_codegen.machine.machine import NO_SURROUNDINGS, Machine, Surroundings
from gibbs_codegen.machine.state import State, StateLayout
from gibbs_codegen.machine.steps import METHODS, projected

# States of which more than this is summed up have diverged. Single precision has their squares.
_FARTHEST = 1e15


@dataclass(frozen=True)
class Parts:
    """Parts of a rollout besides inputs; drives have a lag of their own.

    With an `inner` loop it has actions in place of inputs. `around` is what acts on frames: with
    `pushes` there are wrenches. `figures` are those of what
    surrounds it that are part of the program, entry by entry, by the names of `Machine`.
    """

    feedback: bool = False
    limits: bool = False
    lag: bool = False
    bounds: bool = False
    around: Surroundings = NO_SURROUNDINGS
    figures: tuple[tuple[str, tuple[float, ...]], ...] = ()
    inner: InnerLoop | None = None


ALL = Parts(feedback=True, limits=True, lag=True, bounds=True, around=Surroundings(pushes=True))


def sent(robot: Functions) -> str:
    """Name of the input of programs that says what is commanded."""
    return "command" if robot.driven else "u"


def rollout_inputs(robot: Functions, parts: Parts) -> dict[str, Node]:
    """Inputs of a program with such parts, of each state or of all, by names, in their order.

    - `u` (nu): inputs, or `command` (nu) where there are drives
    - with an inner loop, in their place `InnerLoop.inputs`
    - `gain` (nu, nd + nv), `desired_q` (nq) and `desired_v` (nv): feedback, which is added to them;
      with states of actuators a gain (nu, nd + nv + nx) and `desired_x` (nx)
    - `least` and `most` (nu): limits, within which they are then brought
    - `lag` (3, rotors): what is left of the way from thrusts to what is commanded at the start of a
      step, after half of it, and at its end
    - `wrenches` (frames, 6): on the frames, as of `forward_dynamics_with_wrenches`
    - `lowest` and `highest` (nq + nv): the least and the greatest q and v
    - `wind` (3): steady velocity of the air; `drag` (frames, 6) coefficients of the frames; `gusts`
      (3, 3): what gusts add to it at the start of a step, after half of it and at its end
    - `payloads` (p): masses, kg, and `gravity` (3), m/s²
    """
    n, m, inputs = robot.space.coordinates, robot.space.velocities, robot.inputs
    variables = [variable(sent(robot), inputs)]
    if parts.inner:
        variables = parts.inner.inputs(robot)
    if parts.feedback:
        states = robot.actuator_states
        deviations = robot.layout.displaced.size + m + states
        variables += [variable("gain", inputs, deviations, uniform=True)]
        variables += [robot.coordinates("desired_q"), robot.velocities("desired_v")]
        variables += [variable("desired_x", states)] if states else []
    if parts.limits:
        alike = parts.inner is None
        variables += [variable(name, inputs, uniform=alike) for name in ("least", "most")]
    if parts.lag and sent(robot) == "u":
        variables += [variable("lag", 3, robot.rotors)]
    if parts.around.pushes:
        variables += [variable("wrenches", robot.frames, 6)]
    if parts.bounds:
        variables += [variable(name, n + m, uniform=True) for name in ("lowest", "highest")]
    if parts.around.wind:
        variables += [variable("wind", 3), variable("drag", robot.frames, 6)]
        variables += [variable("gusts", 3, 3)] if parts.around.gusts else []
    if parts.around.payloads:
        variables += [variable("payloads", len(parts.around.payloads)), variable("gravity", 3)]
    return {x.operation.name: x for x in variables if isinstance(x.operation, Input)}


@labelled
def rollout_step(
    robot: Functions, method: str, parts: Parts, name: str = "step", *, has_thrusts: bool = False
) -> Program:
    """A step of h from x: coordinates, velocities and, where motors may lag, thrusts.

    With drives, the states of actuators follow in their place; bristles of
    contacts come last. `inputs` (nu) are those that are commanded, within limits. Where `ended` is
    above 0, the step has taken a state out of bounds. With `has_thrusts` it has thrusts without lag
    too, which are those commanded.
    """
    nodes, around = rollout_inputs(robot, parts), replace(parts.around, gusts=0)
    machines = [Machine(robot, _figures(parts, nodes, halves), around) for halves in range(3)]
    machine = machines[0]
    rotors = robot.lagging if "lag" in nodes or has_thrusts else 0
    time, h = (variable(quantity, uniform=True) for quantity in ("time", "h"))
    layout = replace(machine.layout(), actuators=robot.actuator_states or rotors)
    places, x = layout.places, variable("x", layout.size)
    q, v, actuators = coordinates_of(x[places.q], robot.space), x[places.v], x[places.actuators]
    if parts.inner:
        wanted = parts.inner.commands(robot, q, v, nodes)
        u = named(wanted, "wanted", "inputs of the inner loop")
    else:
        u = nodes[sent(robot)]
    if parts.feedback:
        parts_away = [robot.displacement(q, nodes["desired_q"]), nodes["desired_v"] - v]
        parts_away += [nodes["desired_x"] - actuators] if "desired_x" in nodes else []
        error = named(join(*parts_away), "error", "way to the desired state")
        u = named(u + nodes["gain"] @ error, "wanted", "inputs with linear feedback")
    if parts.limits:
        u = named(clip(u, nodes["least"], nodes["most"]), "commanded", "inputs within their limits")
    acting = [u] * 3
    if "lag" in nodes:
        settled, efforts = u[:rotors], u[rotors:]
        way = actuators - settled
        acting = [join(settled + nodes["lag"][k] * way, efforts) for k in range(3)]

    # What is integrated together: velocities, states of actuators, bristles, and what is done.
    moving = StateLayout(0, layout.v, 0, robot.actuator_states, 0, layout.bristles)

    def state_of(q: Node, moved: Node) -> State[Node]:
        _, *others = (moved[place] for place in moving.places)
        return State(q, *others)

    def accelerate(q: Node, moved: Node, halves: int) -> Node:
        """Rates of velocities, states of actuators and bristles, which follow in v.

        Where there are walls, also the power of all but contacts, and what these do.
        """
        state = state_of(q, moved)
        inputs = machine.inputs(state, acting[halves])
        rates = machines[halves].rates(time, state, inputs, u)
        done = [rates.a, rates.actuators, rates.bristles]
        if around.contacts:
            # By "euler" forces of the begin act through the step: on the mean of its velocities.
            mean = state.v + 0.5 * h * rates.a if method == "euler" else state.v
            done.append(impacts.gains(machine, state, rates, mean))
        return join(*done)

    def move(q: Node, displacement: Node) -> Node:
        return robot.integrate(q, displacement[: layout.v])

    spent = zeros(4 + 6 * len(around.contacts) if around.contacts else 0)
    end = moving.places.actuators.stop
    begin = join(x[layout.q : layout.q + end], x[places.bristles], spent)
    q_next, moved = METHODS[method](move, accelerate, q, begin, h)
    if machine.active is not None:
        q_next, v_next = projected(robot, move, q_next, moved[: layout.v], machine.active)
        moved = join(v_next, moved[layout.v :])
    if around.contacts:
        states, work = (state_of(q, begin), state_of(q_next, moved)), moved[moving.size]
        done = moved[moving.size + 1 :]
        if method == "euler":  # What comes into a wall in a step was not pushed yet.
            touches = machine.touches(states[1])
            done = done + h * join(zeros(3), *(touch.wrench for touch in touches))
        place, v_next = impacts.passive(machine, states, work, done)
        q_next = coordinates_of(place, robot.space)
        moved = join(v_next, moved[layout.v :])
    x_next = join(q_next, moved[:end], acting[2][:rotors], moved[end : moving.size])
    ended = constant(0.0)
    if parts.bounds:
        held = x_next[: layout.q + layout.v]
        beyond = maximum(nodes["lowest"] - held, 0.0) + maximum(held - nodes["highest"], 0.0)
        ended = named(total(beyond), "beyond", "how far q and v are out of bounds")
    outputs = {"x_next": x_next, "ended": ended, "inputs": u}
    return Program(name, (time, h, x, *nodes.values()), outputs)


def decision_program(robot: Functions, method: str, parts: Parts, steps: int) -> Program:
    """So many steps of h under one action or input, one after the other, as one program.

    Its inputs are those of a step: `time`, `h`, `x`, and what `rollout_inputs` has. Coordinates,
    velocities and what follows them in x become `x_next`, `inputs` are those of the last step, and
    `ended` is above 0 where a step has left the bounds, and `diverged` where it was not finite: x
    then stays as it was after the one or before the other. What an inner loop calls has the owner
    `model`, all else that of the robot.
    """
    step = rollout_step(robot, method, parts)
    first, x, rest = step.inputs[:2], step.inputs[2], step.inputs[3:]
    ended = diverged = constant(0.0)
    for _ in range(steps):
        outputs = step.results(*first, x, *rest)
        after = outputs["x_next"]
        goes = choose(_FARTHEST, total(absolute(after)), 1.0, 0.0) * choose(ended, 0.0, 0.0, 1.0)
        diverged = choose(ended, 0.0, diverged, 1.0 - goes)
        ended = choose(goes, 0.0, outputs["ended"], maximum(ended, diverged))
        x = choose(goes, 0.0, after, x)
    results = {**outputs, "x_next": x, "ended": ended, "diverged": diverged}
    return Program("decision", step.inputs, results)


def contact_program(robot: Functions, parts: Parts) -> Program:
    """The `wrenches` (f, 6) of contacts on the frames: of q, v and bristles."""
    machine = Machine(robot, _figures(parts, {}, 0), parts.around)
    bristles = variable("bristles", machine.layout().bristles)
    (q, v), none = robot.state(), zeros(0)
    state = State(q, v, none, none, none, bristles)
    outputs = {"wrenches": machine.contact_wrenches(machine.touches(state))}
    inputs = (q, v, bristles) if bristles.size else (q, v)
    return Program("contacts", inputs, outputs)


def _figures(parts: Parts, nodes: dict[str, Node], halves: int) -> Callable[..., Node]:
    """Figures of what is around a robot, so many halves of a step after its start."""
    constants = dict(parts.figures)

    def figure(name: str, *shape: int) -> Node:
        if name == "push":
            return nodes["wrenches"]
        if name == "wind" and "gusts" in nodes:
            return nodes["wind"] + nodes["gusts"][halves]
        if name in nodes:
            return nodes[name]
        return constant(np.reshape(constants[name], shape))

    return figure
