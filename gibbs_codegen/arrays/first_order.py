"""A robot by itself as a system of first order, x' = f(x, given), with outputs: what an FMU is.

All are vectors, so that C which knows no robot can call the programs. A state x has coordinates,
velocities, and states of actuators or thrusts that lag. `given` are commands, forces and torques
(f, 3) on the frames, in world axes, and the wind where the air acts on rotors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from gibbs_codegen.arrays.base import base_of, unit_entries
from gibbs_codegen.arrays.forward import along
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.labels import labelled
from gibbs_codegen.arrays.nodes import (
    Node,
    Program,
    beside,
    coordinates_of,
    join,
    reshaped,
    variable,
)
from gibbs_codegen.arrays.steps import classical_step
from gibbs_codegen.arrays.surroundings import air_on_rotors, on_frames, origin_of, rotation_of

Shapes = Mapping[str, tuple[int, ...]]


@dataclass(frozen=True)
class System:
    """The system of a robot, of whose rotors some lag: time constants, s, by their numbers."""

    robot: Functions
    lags: Mapping[int, float]

    @property
    def size(self) -> int:
        """Length of a state."""
        robot = self.robot
        actuators = robot.actuator_states if robot.driven else len(self.lags)
        return robot.space.coordinates + robot.space.velocities + actuators

    @property
    def given(self) -> Shapes:
        """Shapes of what is given, in its order."""
        frames = (self.robot.frames, 3)
        found = {"commands": (self.robot.inputs,), "forces": frames, "torques": frames}
        return {**found, **({"wind": (3,)} if self.robot.air else {})}

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
        robot, (q, v, actuators) = self.robot, self._parts(x)
        commands = given[: robot.inputs]
        rates = [base_of(robot, q).rates(v, x), self._acceleration(x, given)]
        if robot.driven and robot.actuator_states:
            rates.append(robot.actuator_rates(actuators, commands))
        rates += [
            (commands[rotor] - actuators[place]) / time
            for place, (rotor, time) in enumerate(self.lags.items())
        ]
        return join(*rates)

    def _parts(self, x: Node) -> tuple[Node, Node, Node]:
        """Coordinates with a unit quaternion, velocities, and the state of the actuators."""
        space = self.robot.space
        end = space.coordinates + space.velocities
        q = coordinates_of(unit_entries(self.robot, x[: space.coordinates]), space)
        return q, x[space.coordinates : end], x[end:]

    def _acceleration(self, x: Node, given: Node) -> Node:
        """Accelerations (nv)."""
        q, v, _ = self._parts(x)
        found: Node = self.robot.forward_dynamics_with_wrenches(q, v, *self._acting(x, given))
        return found

    def _acting(self, x: Node, given: Node) -> tuple[Node, Node]:
        """Inputs u (nu) that act, and wrenches (f, 6) on the frames."""
        robot, (q, v, actuators) = self.robot, self._parts(x)
        count, ends = robot.inputs, 3 * robot.frames
        commands, rest = given[:count], given[count:]
        u = commands
        if robot.driven:
            u = robot.inputs_of(q, v, actuators, commands)
        elif self.lags:
            places = {rotor: place for place, rotor in enumerate(self.lags)}
            u = join(*(actuators[places[k]] if k in places else u[k] for k in range(count)))
        forces, torques = (
            reshaped(half, (robot.frames, 3)) for half in (rest[:ends], rest[ends : 2 * ends])
        )
        wrenches = beside(forces, torques)
        if robot.air:
            moving = robot.frame_poses(q), robot.frame_velocities(q, v)
            speeds, wind = robot.rotor_speeds(actuators, commands), rest[2 * ends :]
            air = air_on_rotors(robot, moving, speeds, u, wind)
            wrenches = wrenches + on_frames(air, robot.frames)
        return u, wrenches

    def output(self, x: Node, given: Node, gravity: Node) -> Node:
        """The outputs one after the other."""
        robot, (q, v, _) = self.robot, self._parts(x)
        a, acting = self._acceleration(x, given), self._acting(x, given)
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
            loads = robot.joint_wrenches_with_wrenches(q, v, a, *acting)
            for k in range(bodies):
                found["loads"].append(loads[k][:3])
                found["load_torques"].append(loads[k][3:])
        return join(*(value for values in found.values() for value in values))
