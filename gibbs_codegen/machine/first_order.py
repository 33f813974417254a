"""A robot by itself as a system of first order, x' = f(x, given), with outputs: what an FMU is.

All are vectors, so that C which knows no robot can call the programs. A state x has coordinates,
velocities, states of actuators or thrusts that lag, and bristles. `given` are commands, forces and
torques (f, 3) on the frames, and what else is chosen to act.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from gibbs_codegen.arrays.forward import along
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.labels import labelled
from gibbs_codegen.arrays.nodes import (
    Node,
    Program,
    beside,
    choose,
    constant,
    dot,
    join,
    maximum,
    reshaped,
    square_root,
    variable,
    zeros,
)
from gibbs_codegen.machine import impacts
from gibbs_codegen.machine.base import base_of
from gibbs_codegen.machine.contact import Contact, plane
from gibbs_codegen.machine.machine import Machine, Rates, Surroundings
from gibbs_codegen.machine.state import State
from gibbs_codegen.machine.steps import classical_step
from gibbs_codegen.machine.surroundings import origin_of, rotation_of

Shapes = Mapping[str, tuple[int, ...]]
# What may act besides forces and torques.
ACTING = ("drag", "walls", "payloads", "constraints")
# Figures of walls before point and normal, one of each for a frame, in the order of contacts.
_WALL = (
    *("ball_radius", "stiffness", "damping", "dissipation", "friction"),
    *("bristle_stiffness", "bristle_damping"),
)
# Figures of the machine that are as they are given.
_FIGURES = {"wind": "wind", "payloads": "payload"}
# The square of a length that is none.
_NO_DIRECTION = 1e-30
# Acceleration of gravity, m/s².
GRAVITY = variable("gravity")


@dataclass(frozen=True)
class System:
    """The system of a robot, of whose rotors some lag: time constants, s, by their numbers.

    `spins` are rotor and frame of each that spins, `momenta` (g, 4) its axis in the frame and its
    angular momentum by the square root of the thrust. `acting` are some of `ACTING`: a wall is a
    plane, of which each frame has one, as it may have a payload.
    """

    robot: Functions
    lags: Mapping[int, float]
    spins: tuple[tuple[int, int], ...] = ()
    momenta: tuple[tuple[float, ...], ...] = ()
    acting: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Length of a state."""
        return self._machine(zeros(self.length)).layout().size

    @property
    def length(self) -> int:
        """Length of what is given."""
        return sum(map(math.prod, self.given.values()))

    @property
    def given(self) -> Shapes:
        """Shapes of what is given, in its order."""
        frames, drags = self.robot.frames, "drag" in self.acting
        found: dict[str, tuple[int, ...]] = {"command": (self.robot.inputs,)}
        found |= {"force": (frames, 3), "torque": (frames, 3)}
        found |= {"wind": (3,)} if drags or self.robot.air else {}
        found |= {"drag": (frames,), "rotational_drag": (frames,)} if drags else {}
        if "walls" in self.acting:
            found |= {f"wall.{name}": (frames,) for name in _WALL}
            found |= {"wall.point": (frames, 3), "wall.normal": (frames, 3)}
        found |= {"payload": (frames,)} if "payloads" in self.acting else {}
        return found | ({"active": (self.robot.constraints,)} if self._holds else {})

    @property
    def _holds(self) -> bool:
        return "constraints" in self.acting

    @property
    def outputs(self) -> Shapes:
        """Shapes of the outputs, in their order.

        The first have a row for every frame: where it is and how it moves in the world, and what an
        IMU measures there, in the frame's axes. Loads of joints have one for every body that a
        joint carries, in the body's axes.
        """
        vectors = ("velocities", "angular_velocities", "specific_forces", "rates_of_turn")
        own = {"positions": (3,), "rotations": (3, 3), **dict.fromkeys(vectors, (3,))}
        of_frames = {name: (self.robot.frames, *shape) for name, shape in own.items()}
        signature = self.robot.signatures.get("joint_wrenches_with_wrenches")
        # Those with constraints would need their forces as wrenches on frames.
        bodies = signature.shapes[0][0] if signature and not self._holds else 0
        return {**of_frames, **dict.fromkeys(("loads", "load_torques"), (bodies, 3))}

    def programs(self) -> dict[str, Program]:
        """The programs by what they do, of x, `given`, the gravity, m/s², and the step h, s."""
        x, given, gravity = variable("x", self.size), variable("given", self.length), GRAVITY
        told = x, given, gravity
        h, rate = variable("h"), self._rate_program(*told)

        def growth(x: Node, halves: int = 0) -> Node:
            return join(*rate.results(x[: self.size], given, gravity).values())

        y = self.output(*told)
        whole = Program("system", told, {"slope": self.rate(*told)["slope"], "y": y})
        begin = join(x, zeros(rate.outputs["done"].size)) if "done" in rate.outputs else x
        after = self._kept(x, classical_step(growth, begin, h), given)
        slope = rate.results(*told)["slope"]
        found = {
            "Rates of the state.": Program("rates", told, {"slope": slope}),
            "Outputs.": Program("outputs", told, {"y": y}),
            "The state after h by the classical method of Runge and Kutta.": Program(
                "step", (*told, h), {"x_next": after}
            ),
            "Derivatives of rates and outputs along directions.": along(
                whole, ("x", "given"), "derivatives"
            ),
        }
        if self._holds:
            machine = self._machine(given)
            held = self._held(machine, x, machine.active)
            found["The state once active constraints have taken hold."] = Program(
                "take_hold", (x, given), {"x_next": held}
            )
        return found

    @labelled
    def _rate_program(self, x: Node, given: Node, gravity: Node) -> Program:
        return Program("rate", (x, given, gravity), self.rate(x, given, gravity))

    def rate(self, x: Node, given: Node, gravity: Node = GRAVITY) -> dict[str, Node]:
        """Time derivative of a state, `slope`, and with walls what is `done`, as of `impacts`."""
        state, _, rates = self._moving(x, given, gravity)
        moved = base_of(self.robot, state.q).rates(state.v, x)
        found = {"slope": join(moved, rates.a, rates.actuators, rates.bristles)}
        if rates.touches:
            machine = self._machine(given, gravity)
            found["done"] = impacts.gains(machine, state, rates, state.v)
        return found

    def _kept(self, x: Node, after: Node, given: Node) -> Node:
        """The state after a step without what contacts gained, and as rigid constraints allow."""
        machine, size = self._machine(given), self.size
        done, after = after[size:], after[:size]
        layout = machine.layout()
        if done.size:
            states = [machine.parts(each, layout) for each in (x, after)]
            moved = impacts.passive(machine, states, done[0], done[1:])
            after = join(*moved, after[layout.places.v.stop :])
        if machine.active is not None and any(self.robot.rigid):
            after = self._held(machine, after, machine.active * constant(self.robot.rigid))
        return after

    def _held(self, machine: Machine, x: Node, active: Node | None) -> Node:
        """A state after an impact on active constraints (g)."""
        layout = machine.layout()
        (q, v, *_), places = machine.parts(x, layout), layout.places
        return join(x[places.q], self.robot.impact(q, v, active)[0], x[places.v.stop :])

    def _machine(self, given: Node, gravity: Node = GRAVITY) -> Machine:
        """The machine, on whose frames acts what is given."""
        place, told, frames = 0, dict[str, Node](), self.robot.frames
        for name, shape in self.given.items():
            end = place + math.prod(shape)
            told[name], place = reshaped(given[place:end], shape), end
        figures = {
            "push": beside(told["force"], told["torque"]),
            "spins": constant(self.momenta),
            "time_constants": constant([*self.lags.values()]),
            "gravity": join(0.0, 0.0, -gravity),
            **{name: told[x] for name, x in _FIGURES.items() if x in told},
        }
        if "active" in told:  # Nothing is differentiated by what holds.
            figures["active"] = choose(told["active"], 0.5, 1.0, 0.0)
        if drags := "drag" in told:
            both = (reshaped(told[x], (frames, 1)) for x in ("drag", "rotational_drag"))
            figures["drag"] = beside(*(drag + zeros(frames, 3) for drag in both))
        contacts = tuple(
            Contact(k, k, plane, 6, sticks=True) for k in range(frames) if "wall.point" in told
        )
        for k in range(len(contacts)):
            normal = told["wall.normal"][k]
            size = square_root(maximum(dot(normal, normal), _NO_DIRECTION))
            own = (told[f"wall.{name}"][k] for name in _WALL)
            figures[f"wall_{k}"] = join(*own, told["wall.point"][k], normal / size)
        around = Surroundings(
            pushes=True,
            wind="wind" in told,
            drag=drags,
            contacts=contacts,
            spins=self.spins,
            payloads=tuple(range(frames)) if "payload" in told else (),
            holds=self._holds,
        )
        lagging = tuple(self.lags)
        return Machine(self.robot, lambda name, *_: figures[name], around, lagging=lagging)

    def _moving(self, x: Node, given: Node, gravity: Node) -> tuple[State[Node], Node, Rates]:
        """The state of the machine, inputs u (nu) that act, and how it moves."""
        machine, commands = self._machine(given, gravity), given[: self.robot.inputs]
        state = machine.parts(x, machine.layout())
        u = machine.inputs(state, commands)
        return state, u, machine.rates(constant(0.0), state, u, commands)

    def output(self, x: Node, given: Node, gravity: Node) -> Node:
        """The outputs one after the other."""
        robot, ((q, v, *_), u, rates) = self.robot, self._moving(x, given, gravity)
        a = rates.a
        poses, velocities = robot.frame_poses(q), robot.frame_velocities(q, v)
        # A product with Jacobians is what velocities are of accelerations.
        accelerations = robot.frame_velocities(q, a) + robot.frame_bias_accelerations(q, v)
        found: dict[str, list[Node]] = {name: [] for name in self.outputs}
        for k in range(robot.frames):
            rotation, spin = rotation_of(poses[k]), velocities[k][3:]
            felt = accelerations[k][:3] + join(0.0, 0.0, gravity)
            own = (velocities[k][:3], spin, rotation.transposed @ felt, rotation.transposed @ spin)
            values = (origin_of(poses[k]), reshaped(rotation, (9,)), *own)
            for name, value in zip(found, values, strict=False):
                found[name].append(value)
        if bodies := self.outputs["loads"][0]:
            loads = robot.joint_wrenches_with_wrenches(q, v, a, u, rates.wrenches)
            for k in range(bodies):
                found["loads"].append(loads[k][:3])
                found["load_torques"].append(loads[k][3:])
        return join(*(value for values in found.values() for value in values))
