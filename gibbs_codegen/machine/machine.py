"""A machine x' = f(t, x, command): a robot with its actuators and what is around it, said once.

Closed loops, rollouts, FMUs and linear models are made of it. Commands are those of the module's
drives, and without such thrusts and torques, which thrusts of motors that lag follow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import (
    Node,
    choose,
    coordinates_of,
    dot,
    join,
    reshaped,
    zeros,
)
from gibbs_codegen.machine import surroundings
from gibbs_codegen.machine.base import base_of, unit_entries
from gibbs_codegen.machine.contact import (
    FIGURES,
    Contact,
    Touch,
    bristle_parts,
    bristles_of,
    touch,
)
from gibbs_codegen.machine.motor import approach
from gibbs_codegen.machine.state import State, StateLayout
from gibbs_codegen.machine.steps import constrained_motion


@dataclass(frozen=True)
class Surroundings:
    """Kinds of forces and their frames; their figures are inputs by name.

    `pushes`: wrenches `push` (f, 6). `wind`: the air moves, with `gusts`; `drag`: it drags frames.
    `contacts` are of frames with walls, `payloads` have the frame of each, `spins` rotor and frame
    of each. `holds`: constraints of the robot hold frames; the input `active` says which. `stops`:
    some of them act from one side alone; the input `stops` (2, l) has 1 or -1, the side, for each
    row of those that are away, and of those that press.
    """

    pushes: bool = False
    wind: bool = False
    drag: bool = False
    gusts: int = 0
    contacts: tuple[Contact, ...] = ()
    spins: tuple[tuple[int, int], ...] = ()
    payloads: tuple[int, ...] = ()
    holds: bool = False
    stops: bool = False

    @property
    def acts(self) -> bool:
        """True if anything exerts a wrench on a frame; constraints have forces of their own."""
        return bool(self.pushes or self.drag or self.contacts or self.spins or self.payloads)


NO_SURROUNDINGS = Surroundings()


class Rates(NamedTuple):
    """The motion of a machine in a state: accelerations `a` (nv), rates of actuators and bristles.

    `wrenches` (f, 6) of what acts, if anything does, `holding` (l) forces of constraints, and what
    each contact does.
    """

    a: Node
    actuators: Node
    bristles: Node
    wrenches: Node | None
    holding: Node
    touches: list[Touch]


@dataclass(frozen=True)
class Machine:
    """A robot, its actuators and what is around it; `figure` gives inputs by name and shape.

    Where no drive of the module says how, thrusts may follow their commands: with `lags` all, of
    which some may do so at once, or those of `lagging` rotors, with time constants. Motors that do
    not run are sent nothing, and the air does nothing to them. `moves`: joints move rotors.
    """

    robot: Functions
    figure: Callable[..., Node]
    around: Surroundings = NO_SURROUNDINGS
    lags: bool = False
    lagging: tuple[int, ...] = ()
    runs: bool = True
    moves: bool = False

    def layout(self, *, work: int = 0, memory: int = 0) -> StateLayout:
        """The layout of its state, with the work, or what a law remembers."""
        robot, lagging = self.robot, self.robot.rotors if self.lags else len(self.lagging)
        sizes = robot.space.coordinates, robot.space.velocities, work
        actuators = robot.actuator_states + lagging
        return StateLayout(*sizes, actuators, memory, bristles_of(self.around.contacts))

    def parts(self, x: Node, layout: StateLayout) -> State[Node]:
        """Parts of a state; a quaternion is made of unit length."""
        entries, *others = (x[place] for place in layout.places)
        return State(coordinates_of(unit_entries(self.robot, entries), self.robot.space), *others)

    @cached_property
    def has_air(self) -> bool:
        """True if the air acts on rotors."""
        return bool(self.robot.air) and self.runs

    @property
    def active(self) -> Node | None:
        """1 for constraints that hold (g), else 0, if any does."""
        return self.figure("active", self.robot.constraints) if self.around.holds else None

    # Actuators.

    def inputs(self, state: State[Node], command: Node) -> Node:
        """Inputs (nu) that act in a state while something is commanded."""
        states, thrusts = self._followers(state.actuators)
        acting = command
        if self.runs:
            acting = self.robot.inputs_of(state.q, state.v, states, command)
        if self.lagging:
            inputs = [*acting]
            for place, rotor in enumerate(self.lagging):
                inputs[rotor] = thrusts[place]
            return join(*inputs)
        if not self.lags:
            return acting
        count = self.robot.rotors
        settled = choose(self.figure("lag", count), 0.0, thrusts, acting[:count])
        return join(settled, acting[count:])

    def _followers(self, actuators: Node) -> tuple[Node, Node]:
        """States of the module's drives, and thrusts that lag."""
        return actuators[: self.robot.actuator_states], actuators[self.robot.actuator_states :]

    def _actuator_rates(self, actuators: Node, command: Node) -> Node:
        """Time derivative of the state of the actuators."""
        states, thrusts = self._followers(actuators)
        rates = self.robot.actuator_rates(states, command) if self.runs else zeros(states.size)
        if self.lags:
            count = self.robot.rotors
            return join(rates, self.figure("pace", count) * (command[:count] - thrusts))
        if not self.lagging:
            return join(rates)
        times = self.figure("time_constants", len(self.lagging))
        lagging = zip(thrusts, (command[rotor] for rotor in self.lagging), times, strict=True)
        return join(rates, *(approach(level, to, time, time) for level, to, time in lagging))

    # What is around it.

    def touches(self, state: State[Node]) -> list[Touch]:
        """Effects of each contact."""
        contacts = self.around.contacts
        if not contacts:
            return []
        poses = self.robot.frame_poses(state.q)
        velocities = self.robot.frame_velocities(state.q, state.v)
        bristles = bristle_parts(contacts, state.bristles)
        return [
            touch(
                contact,
                self.figure(f"wall_{contact.wall}", FIGURES + contact.figures),
                (poses[contact.frame], velocities[contact.frame]),
                bristle,
            )
            for contact, bristle in zip(contacts, bristles, strict=True)
        ]

    def contact_wrenches(self, touches: list[Touch]) -> Node:
        """Wrenches (f, 6) of contacts alone on the frames, N and N m, world axes."""
        return surroundings.on_frames(self._pressing(touches), self.robot.frames)

    def touching(self, state: State[Node]) -> Node:
        """Wrenches (f, 6) of what touches the frames: of contacts and of the push."""
        wrenches = self.contact_wrenches(self.touches(state))
        return wrenches + self._push if self.around.pushes else wrenches

    @property
    def _push(self) -> Node:
        return self.figure("push", self.robot.frames, 6)

    def _pressing(self, touches: list[Touch]) -> list[tuple[int, Node]]:
        """Frames of contacts by their numbers, and the wrench (6) of each."""
        pairs = zip(self.around.contacts, touches, strict=True)
        return [(contact.frame, its.wrench) for contact, its in pairs]

    def _wind(self, time: Node) -> Node:
        """Velocity (3) of the air."""
        if not self.around.wind:
            return zeros(3)
        gusts = self.figure("gusts", self.around.gusts, 5) if self.around.gusts else zeros(0, 5)
        return surroundings.wind_velocity(time, self.figure("wind", 3), gusts)

    def _wrenches(
        self, time: Node, state: State[Node], u: Node, command: Node, touches: list[Touch]
    ) -> Node | None:
        """Wrenches (f, 6) on the frames; None if nothing acts."""
        around, robot, q, v = self.around, self.robot, state.q, state.v
        if not (around.acts or self.has_air):
            return None
        wrenches, wind = self._push if around.pushes else zeros(robot.frames, 6), self._wind(time)
        if around.drag or around.spins or self.has_air:
            velocities = robot.frame_velocities(q, v)
        if around.drag:
            drag = self.figure("drag", robot.frames, 6)
            wrenches = wrenches + surroundings.drag(drag, wind, velocities)
        parts = self._pressing(touches)
        if around.spins or self.has_air:
            poses = robot.frame_poses(q)
        for k, (rotor, frame) in enumerate(around.spins):
            spin = self.figure("spins", len(around.spins), 4)[k]
            moving = poses[frame], velocities[frame]
            torque = surroundings.spin_torque(spin[:3], spin[3], u[rotor], *moving)
            parts.append((frame, join(zeros(3), torque)))
        if self.has_air:
            speeds = robot.rotor_speeds(state.actuators, command)
            parts += surroundings.air_on_rotors(robot, (poses, velocities), speeds, u, wind)
        if parts:
            wrenches = wrenches + surroundings.on_frames(parts, robot.frames)
        if around.payloads:
            masses, gravity = (
                self.figure("payloads", len(around.payloads)),
                self.figure("gravity", 3),
            )
            forces = surroundings.payload_forces(
                robot, (q, v, u), wrenches, around.payloads, masses, gravity
            )
            carried = [
                (frame, join(force, zeros(3)))
                for frame, force in zip(around.payloads, forces, strict=True)
            ]
            wrenches = wrenches + surroundings.on_frames(carried, robot.frames)
        return wrenches

    # How it moves.

    def rates(self, time: Node, state: State[Node], u: Node, command: Node) -> Rates:
        """Rates of the machine under inputs u (nu) that act while something is commanded."""
        robot, touches, (q, v, *_) = self.robot, self.touches(state), state
        wrenches, pushed = self._wrenches(time, state, u, command, touches), None
        if wrenches is not None:
            pushed = robot.forward_dynamics_with_wrenches(q, v, u, wrenches)
        active, holding = self.active, zeros(0)
        if active is not None:
            a, holding = constrained_motion(robot, (q, v), u, active, pushed)
        else:
            a = robot.forward_dynamics(q, v, u) if pushed is None else pushed
        pairs = zip(self.around.contacts, touches, strict=True)
        bristles = join(zeros(0), *(its.rate for contact, its in pairs if contact.sticks))
        actuators = zeros(0)
        if state.actuators.size:
            actuators = self._actuator_rates(state.actuators, command)
        return Rates(a, actuators, bristles, wrenches, holding, touches)

    def power(self, state: State[Node], u: Node, rates: Rates) -> Node:
        """Power, W, of all that acts less what damping takes."""
        robot, (q, v, *_) = self.robot, state
        count = robot.rotors
        if self.moves or not robot.layout.moves_freely:
            power = dot(v, robot.input_matrix(q) @ u)
        else:
            twist = base_of(robot, q).twist(self.figure("centre", 3), v)
            power = dot(u[:count], self.figure("wrenches", count, 6) @ twist)
            power = power + dot(u[count:], v[robot.layout.v.joints])
        lost = self.figure("losses", v.size) * v
        if robot.couples_dampers:  # They take the part of the forces that is odd in velocities.
            ahead, back = (robot.inverse_dynamics(q, x, zeros(v.size)) for x in (v, -v))
            lost = 0.5 * (ahead - back)
        power = power - dot(lost, v)
        if rates.wrenches is not None:
            velocities = robot.frame_velocities(q, v)
            power = power + dot(*(reshaped(x, (x.size,)) for x in (rates.wrenches, velocities)))
        if self.around.holds:  # Constraints do work only where they draw a frame to its anchor.
            power = power + dot(rates.holding, robot.constraint_jacobian(q) @ v)
        return power
