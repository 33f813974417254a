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
# Figures of the wall of a frame before its point and normal.
_WALL = (
    *("ball_radius", "stiffness", "damping", "dissipation", "friction"),
    *("bristle_stiffness", "bristle_damping"),
)
# The square of a length that is none.
_NO_DIRECTION = 1e-30
# Acceleration of gravity, m/s².
GRAVITY = variable("gravity")


@dataclass(frozen=True)
class System:
    """The system of a robot, of whose rotors some lag: time constants, s, by their numbers.

    `spins` are rotor and frame of each that spins, `momenta` (g, 4) its axis in the frame and its
    angular momentum by the square root of the thrust. `acting` are some of `ACTING`: a wall is a
    plane, of which each frame has one, as it may have a payload. The last bodies are `wheels`: axes
    of these turn by angles that have no derivatives, so that no outputs tell their loads.
    """

    robot: Functions
    lags: Mapping[int, float]
    spins: tuple[tuple[int, int], ...] = ()
    momenta: tuple[tuple[float, ...], ...] = ()
    acting: tuple[str, ...] = ()
    wheels: int = 0

    @property
    def size(self) -> int:
        """Length of a state."""
        return self._machine(zeros(self.length)).layout().size

    @property
    def length(self) -> int:
        """Length of the influences."""
        return sum(map(math.prod, self.influences.values()))

    @property
    def influences(self) -> Shapes:
        """Shapes of the influences, in their order."""
        frames, acting = self.robot.frames, self.acting
        shapes: dict[str, tuple[int, ...]] = {"command": (self.robot.inputs,)}
        shapes |= dict.fromkeys(("force", "torque"), (frames, 3))
        if "drag" in acting or self.robot.air:
            shapes["wind"] = (3,)
        if "drag" in acting:
            shapes |= dict.fromkeys(("drag", "rotational_drag"), (frames,))
        if "walls" in acting:
            shapes |= dict.fromkeys((f"wall.{name}" for name in _WALL), (frames,))
            shapes |= dict.fromkeys(("wall.point", "wall.normal"), (frames, 3))
        if "payloads" in acting:
            shapes["payloads"] = (frames,)
        return shapes | ({"active": (self.robot.constraints,)} if self._holds else {})

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
        shapes = {"positions": (3,), "rotations": (3, 3), **dict.fromkeys(vectors, (3,))}
        of_frames = {name: (self.robot.frames, *shape) for name, shape in shapes.items()}
        signature = self.robot.signatures.get("joint_wrenches_with_wrenches")
        # Those with constraints would need their forces as wrenches on frames.
        bodies = signature.shapes[0][0] - self.wheels if signature and not self._holds else 0
        return {**of_frames, **dict.fromkeys(("loads", "load_torques"), (bodies, 3))}

    def programs(self) -> dict[str, Program]:
        """The programs by what they do, of x, `given`, the gravity, m/s², and the step h, s."""
        x, influences = variable("x", self.size), variable("given", self.length)
        inputs, h, rate = (x, influences, GRAVITY), variable("h"), self._rate_program(x, influences)

        def growth(x: Node, halves: int = 0) -> Node:
            return join(*rate.results(x[: self.size], influences, GRAVITY).values())

        y = self.output(x, influences)
        whole = Program("system", inputs, {"slope": self.rate(x, influences)["slope"], "y": y})
        begin = join(x, zeros(growth(x).size - self.size))
        after = self._kept(x, classical_step(growth, begin, h), influences)
        slope = rate.results(*inputs)["slope"]
        programs = {
            "Rates of the state.": Program("rates", inputs, {"slope": slope}),
            "Outputs.": Program("outputs", inputs, {"y": y}),
            "The state after h by the classical method of Runge and Kutta.": Program(
                "step", (*inputs, h), {"x_next": after}
            ),
            "Derivatives of rates and outputs along directions.": along(
                whole, ("x", "given"), "derivatives"
            ),
        }
        if self._holds:
            machine = self._machine(influences)
            after = impacts.after_impact(machine, machine.layout(), x, machine.active)
            programs["The state once active constraints have taken hold."] = Program(
                "take_hold", (x, influences), {"x_next": after}
            )
        return programs

    @labelled
    def _rate_program(self, x: Node, influences: Node) -> Program:
        return Program("rate", (x, influences, GRAVITY), self.rate(x, influences))

    def rate(self, x: Node, influences: Node) -> dict[str, Node]:
        """Time derivative of a state, `slope`, and with walls what they have `done`."""
        state, _, rates = self._moving(x, influences)
        moved = base_of(self.robot, state.q).rates(state.v, x)
        results = {"slope": join(moved, rates.a, rates.actuators, rates.bristles)}
        if rates.touches:
            results["done"] = impacts.gains(self._machine(influences), state, rates, state.v)
        return results

    def _kept(self, x: Node, after: Node, influences: Node) -> Node:
        """The state after a step without what contacts gained, and as rigid constraints allow."""
        machine, done, after = self._machine(influences), after[self.size :], after[: self.size]
        layout = machine.layout()
        if done.size:
            after = impacts.without_gains(machine, layout, (x, after), done[0], done[1:])
        return impacts.held(machine, layout, after)

    def _machine(self, influences: Node) -> Machine:
        """The machine, on whose frames the influences act."""
        place, figures, frames = 0, dict[str, Node](), self.robot.frames
        for name, shape in self.influences.items():
            end = place + math.prod(shape)
            figures[name], place = reshaped(influences[place:end], shape), end
        figures["push"] = beside(figures["force"], figures["torque"])
        figures["spins"] = constant(self.momenta)
        figures["time_constants"] = constant([*self.lags.values()])
        figures["gravity"] = join(0.0, 0.0, -GRAVITY)
        if self._holds:  # Nothing is differentiated by what holds.
            figures["active"] = choose(figures["active"], 0.5, 1.0, 0.0)
        if "drag" in self.acting:
            drags = (reshaped(figures[x], (frames, 1)) for x in ("drag", "rotational_drag"))
            figures["drag"] = beside(*(drag + zeros(frames, 3) for drag in drags))
        walls = range(frames) if "walls" in self.acting else range(0)
        for k in walls:
            normal = figures["wall.normal"][k]
            size = square_root(maximum(dot(normal, normal), _NO_DIRECTION))
            numbers = (figures[f"wall.{name}"][k] for name in _WALL)
            figures[f"wall_{k}"] = join(*numbers, figures["wall.point"][k], normal / size)
        around = Surroundings(
            pushes=True,
            wind="wind" in figures,
            drag="drag" in self.acting,
            contacts=tuple(Contact(k, k, plane, 6, sticks=True) for k in walls),
            spins=self.spins,
            payloads=tuple(range(frames)) if "payloads" in self.acting else (),
            holds=self._holds,
        )
        return Machine(self.robot, lambda x, *_: figures[x], around, lagging=tuple(self.lags))

    def _moving(self, x: Node, influences: Node) -> tuple[State[Node], Node, Rates]:
        """The state of the machine, inputs u (nu) that act, and how it moves."""
        machine, commands = self._machine(influences), influences[: self.robot.inputs]
        state = machine.parts(x, machine.layout())
        u = machine.inputs(state, commands)
        return state, u, machine.rates(constant(0.0), state, u, commands)

    def output(self, x: Node, influences: Node) -> Node:
        """The outputs one after the other."""
        robot, ((q, v, *_), u, rates) = self.robot, self._moving(x, influences)
        a = rates.a
        poses, velocities = robot.frame_poses(q), robot.frame_velocities(q, v)
        # A product with Jacobians is what velocities are of accelerations.
        accelerations = robot.frame_velocities(q, a) + robot.frame_bias_accelerations(q, v)
        outputs: dict[str, list[Node]] = {name: [] for name in self.outputs}
        for k in range(robot.frames):
            rotation, spin = rotation_of(poses[k]), velocities[k][3:]
            felt = accelerations[k][:3] + join(0.0, 0.0, GRAVITY)
            motion = velocities[k][:3], spin, rotation.transposed @ felt, rotation.transposed @ spin
            values = (origin_of(poses[k]), reshaped(rotation, (9,)), *motion)
            for name, value in zip(outputs, values, strict=False):
                outputs[name].append(value)
        if bodies := self.outputs["loads"][0]:
            loads = robot.joint_wrenches_with_wrenches(q, v, a, u, rates.wrenches)
            for k in range(bodies):
                outputs["loads"].append(loads[k][:3])
                outputs["load_torques"].append(loads[k][3:])
        return join(*(value for values in outputs.values() for value in values))
