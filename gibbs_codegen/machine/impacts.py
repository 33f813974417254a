"""Energy that contacts gain in steps of time, as array programs: known, and taken back.

Equal steps know neither when a surface is met nor how fast a damper slows what hits it hard, and
may gain energy. With what there was before, springs and bristles included, and with the work of all
else it is known how much, and a part of the contacts' impulse takes it back.
"""

from __future__ import annotations

from collections.abc import Sequence

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.nodes import (
    Node,
    constant,
    dot,
    entries_of,
    maximum,
    minimum,
    square_root,
    zeros,
)
from gibbs_codegen.machine.contact import Touch
from gibbs_codegen.machine.machine import Machine, Rates
from gibbs_codegen.machine.state import State, StateLayout
from gibbs_codegen.machine.surroundings import on_frames

# What is no divisor.
_NONE = 1e-30
# Energy, J, or square of an impulse, N² s², below which nothing touches: bristles round.
_TOUCHING = 1e-20


def effects(machine: Machine, state: State[Node], touches: Sequence[Touch]) -> Node:
    """Effects of contacts now (3 + 6 c), of which a step makes what they have done.

    Power, W, parts of normal forces by damping, N, normal forces, N, and the wrench (6) of each.
    """
    pairs = list(zip(machine.around.contacts, touches, strict=True))
    velocities = machine.robot.frame_velocities(state.q, state.v)
    power = sum((dot(x.wrench, velocities[contact.frame]) for contact, x in pairs), constant(0.0))
    eased, normal = (
        sum((getattr(x, name) for x in touches), constant(0.0)) for name in ("eased", "normal")
    )
    return nodes.join(power, eased, normal, *(x.wrench for x in touches))


def gains(machine: Machine, state: State[Node], rates: Rates, mean: Node) -> Node:
    """Power, W, of all but contacts, and what these do now (1 + 3 + 6 c), at `mean` velocities."""
    done = effects(machine, state._replace(v=mean), rates.touches)
    force = machine.robot.inverse_dynamics(state.q, state.v, rates.a)
    return nodes.join(dot(mean, force) - done[0], done)


def without_gains(
    machine: Machine, layout: StateLayout, ends: tuple[Node, Node], work: Node, done: Node
) -> Node:
    """The state after a step as of `passive`; `ends` are those before and after it."""
    moved = passive(machine, [machine.parts(x, layout) for x in ends], work, done)
    return nodes.join(*moved, ends[1][layout.places.v.stop :])


def held(machine: Machine, layout: StateLayout, x: Node) -> Node:
    """A state with velocities that active constraints allow, so that places do not drift."""
    rigid, active = machine.robot.rigid, machine.active
    if active is None or not any(rigid):
        return x
    return after_impact(machine, layout, x, active * constant(rigid))


def after_impact(machine: Machine, layout: StateLayout, x: Node, active: Node | None) -> Node:
    """A state after an impact on active constraints (g)."""
    (q, v, *_), places = machine.parts(x, layout), layout.places
    after, _ = machine.robot.impact(q, v, active, zeros(machine.robot.constraints))
    return nodes.join(x[places.q], after, x[places.v.stop :])


def passive(
    machine: Machine, states: Sequence[State[Node]], work: Node, done: Node
) -> tuple[Node, Node]:
    """Entries of coordinates (nq) and velocities (nv) after a step in which contacts gain nothing.

    `states` are those before and after a step, `work`, J, is of all but contacts, which have `done`
    (3 + 6 c), as of `effects`. What they gained is taken back along that, at q and v after
    the step; active constraints stay met. Of a damper that stopped what it met, nothing goes on.
    Where there is less along that way, all velocities lose the rest. Where they have less than
    that, the robot stays where it was before the step.
    """
    robot, contacts, active = machine.robot, machine.around.contacts, machine.active
    strained = [sum((x.stored for x in machine.touches(at)), constant(0.0)) for at in states]
    before, after = (
        stored + robot.kinetic_energy(at.q, at.v) + robot.potential_energy(at.q)
        for at, stored in zip(states, strained, strict=True)
    )
    gained, (q, v, *_) = after - before - work, states[1]
    still, none = zeros(robot.space.velocities), zeros(robot.inputs)
    parts = [(x.frame, done[6 * k + 3 : 6 * k + 9]) for k, x in enumerate(contacts)]
    impulses = on_frames(parts, robot.frames)
    pushed = robot.forward_dynamics_with_wrenches(q, still, none, impulses)
    change = pushed - robot.forward_dynamics(q, still, none)
    flat = nodes.reshaped(impulses, (6 * robot.frames,))
    # A step in which nothing touched has errors of its own.
    gained = nodes.choose(sum(strained) + dot(flat, flat), _TOUCHING, gained, 0.0)
    if active is not None:
        change, _ = robot.impact(q, change, active, zeros(robot.constraints))
    speed, yielding = (
        dot(flat, nodes.reshaped(robot.frame_velocities(q, way), flat.shape)) for way in (v, change)
    )
    most = 0.5 * speed * speed / maximum(yielding, _NONE)
    taken = minimum(gained + done[1] / maximum(done[2], _NONE) * most, most)
    taken = nodes.choose(gained, 0.0, taken, 0.0)
    root = square_root(maximum(speed * speed - 2.0 * taken * yielding, 0.0))
    share = nodes.copysign(2.0 * taken / maximum(nodes.absolute(speed) + root, _NONE), speed)
    left = v - share * change
    moving = maximum(robot.kinetic_energy(q, left), _NONE)
    rest = minimum(maximum(gained - taken, 0.0) / moving, 1.0)
    place = nodes.choose(gained - taken - moving, 0.0, *(entries_of(x.q) for x in states))
    return place, square_root(1.0 - rest) * left
