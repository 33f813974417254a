"""A robot by itself as a system of first order, x' = f(x, given), with outputs: what an FMU is.

All are vectors, so that C which knows no robot can call the programs. A state x has coordinates,
velocities, and states of actuators or thrusts that lag. `given` are commands, forces and torques
(f, 3) on the frames, and the wind, in world axes, and coefficients of the drag of frames.
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
    constant,
    join,
    reshaped,
    variable,
    zeros,
)
from gibbs_codegen.machine.base import base_of
from gibbs_codegen.machine.machine import Machine, Rates, Surroundings
from gibbs_codegen.machine.state import State
from gibbs_codegen.machine.steps import classical_step
from gibbs_codegen.machine.surroundings import origin_of, rotation_of

Shapes = Mapping[str, tuple[int, ...]]


@dataclass(frozen=True)
class System:
    """The system of a robot, of whose rotors some lag: time constants, s, by their numbers.

    `spins` are rotor and frame of each that spins, `momenta` (g, 4) its axis in the frame and its
    angular momentum by the square root of the thrust.
    """

    robot: Functions
    lags: Mapping[int, float]
    spins: tuple[tuple[int, int], ...] = ()
    momenta: tuple[tuple[float, ...], ...] = ()

    @property
    def size(self) -> int:
        """Length of a state."""
        return Machine(self.robot, variable, lagging=tuple(self.lags)).layout().size

    @property
    def given(self) -> Shapes:
        """Shapes of what is given, in its order."""
        frames = self.robot.frames
        acting = {"forces": (frames, 3), "torques": (frames, 3), "wind": (3,)}
        drag = {"drag": (frames,), "rotational_drag": (frames,)}
        return {"commands": (self.robot.inputs,), **acting, **drag}

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
        bodies = signature.shapes[0][0] if signature else 0
        return {**of_frames, **dict.fromkeys(("loads", "load_torques"), (bodies, 3))}

    def programs(self) -> dict[str, Program]:
        """The programs by what they do, of x, `given`, the gravity, m/s², and the step h, s."""
        x, given = self._inputs()
        h, gravity = variable("h"), variable("gravity")
        rate = self._rate_program(x, given)

        def slope(x: Node, halves: int = 0) -> Node:
            return rate.results(x, given)["slope"]

        y = self.output(x, given, gravity)
        both = {"slope": self.rate(x, given), "y": y}
        whole = Program("system", (x, given, gravity), both)
        return {
            "Rates of the state.": Program("rates", (x, given), {"slope": slope(x)}),
            "Outputs.": Program("outputs", (x, given, gravity), {"y": y}),
            "The state after h by the classical method of Runge and Kutta.": Program(
                "step", (x, given, h), {"x_next": classical_step(slope, x, h)}
            ),
            "Derivatives of rates and outputs along directions.": along(
                whole, ("x", "given"), "derivatives"
            ),
        }

    @labelled
    def _rate_program(self, x: Node, given: Node) -> Program:
        return Program("rate", (x, given), {"slope": self.rate(x, given)})

    def _inputs(self) -> tuple[Node, Node]:
        return variable("x", self.size), variable("given", sum(map(math.prod, self.given.values())))

    def rate(self, x: Node, given: Node) -> Node:
        """Time derivative of a state."""
        state, _, rates = self._moving(x, given)
        moved = base_of(self.robot, state.q).rates(state.v, x)
        return join(moved, rates.a, rates.actuators)

    def _machine(self, given: Node) -> Machine:
        """The machine, on whose frames act the forces and torques that are given, and the air."""
        place, parts = 0, dict[str, Node]()
        for name, shape in self.given.items():
            end = place + math.prod(shape)
            parts[name], place = reshaped(given[place:end], shape), end
        drags = (reshaped(parts[x], (self.robot.frames, 1)) for x in ("drag", "rotational_drag"))
        figures = {
            "push": beside(parts["forces"], parts["torques"]),
            "wind": parts["wind"],
            "drag": beside(*(drag + zeros(self.robot.frames, 3) for drag in drags)),
            "spins": constant(self.momenta),
            "time_constants": constant([*self.lags.values()]),
        }
        around = Surroundings(pushes=True, wind=True, drag=True, spins=self.spins)
        lagging = tuple(self.lags)
        return Machine(self.robot, lambda name, *_: figures[name], around, lagging=lagging)

    def _moving(self, x: Node, given: Node) -> tuple[State[Node], Node, Rates]:
        """The state of the machine, inputs u (nu) that act, and how it moves."""
        machine, commands = self._machine(given), given[: self.robot.inputs]
        state = machine.parts(x, machine.layout())
        u = machine.inputs(state, commands)
        return state, u, machine.rates(constant(0.0), state, u, commands)

    def output(self, x: Node, given: Node, gravity: Node) -> Node:
        """The outputs one after the other."""
        robot, ((q, v, *_), u, rates) = self.robot, self._moving(x, given)
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
