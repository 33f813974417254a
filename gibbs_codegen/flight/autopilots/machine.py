"""A robot as an autopilot has it: outputs of motors and servos go in, readings of sensors come out.

The autopilot flies the base. Joints follow the scenario, or servos of the autopilot, by computed
torque: the inverse dynamics of the acceleration that joints are to have and of that which the base
has, as an inertial sensor at the base measures it.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.desired.trajectory import Progress
from gibbs_codegen.flight.plant.environment import Environment
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.stepping import Simulation
from gibbs_codegen.robot.autopilot_axes import north_east_down, turned_attitude, turned_over


@dataclass(frozen=True)
class Outputs:
    """What an autopilot commands: shares (N) of motors, 0 to 1, and places (n) of servos, −1 to 1.

    What is beyond is as the nearest of these. Places that are NaN are not commanded.
    """

    motors: Array
    servos: Array


@dataclass(frozen=True)
class Readings:
    """What sensors at the base's origin tell at a time, s; a body's axes are FRD, the world's NED.

    Angular velocity `gyro` (3), rad/s, and specific force `accelerometer` (3), m/s², in the body's
    axes; `position` (3), m, and `velocity` (3), m/s, in the world's; `quaternion` (4), real part
    first, turns the body's axes into the world's.
    """

    time: float
    gyro: Array
    accelerometer: Array
    position: Array
    velocity: Array
    quaternion: Array


class Machine:
    """A robot in a scenario, which an autopilot flies; with `servos` it moves the joints as well.

    The scenario's paths of the base and its law are not looked at. Raises `UsageError` for a flight
    that cannot begin, and for rotors and joints without the limits that outputs are shares of.
    """

    def __init__(
        self,
        robot: ModuleType | str | os.PathLike[str],
        scenario: Scenario,
        servos: bool = False,
        progress: Progress = lambda what, share: None,
    ) -> None:
        settings = replace(scenario.integration, method="rk4", divergence=math.inf)
        scenario = replace(scenario, integration=settings)
        self.simulation = Simulation(robot, scenario, progress)
        self.loop = self.simulation.loop
        self.vehicle, self.scenario = self.loop.vehicle, scenario
        self.rotors, self.joints = self.vehicle.rotors, self.vehicle.joints
        actuators = self.loop.actuators
        limits = actuators.thrusts if actuators.commands is None else actuators.commands
        self._least, self._most = limits[:, : self.rotors]
        if missing := self._without(self.vehicle.commands, np.isfinite(limits).all(axis=0)):
            raise UsageError(
                f"{self.vehicle.name}: {missing}: no greatest thrust is known, of which outputs of "
                "an autopilot are shares; give limits in the robot file, or motors.limits"
            )
        self._travel = actuators.joints
        bounded = np.isfinite(self._travel).all(axis=0)
        if servos and (missing := self._without(self.vehicle.joint_names, bounded)):
            raise UsageError(
                f"{self.vehicle.name}: {missing}: a servo needs limits of the joint, from -1 to 1; "
                "give limits in the robot file, or arm.limits"
            )
        self._gravity = Environment(self.vehicle).gravity
        self._wanted: Array | None = np.full(self.joints, np.nan) if servos else None

    @staticmethod
    def _without(names: tuple[str, ...], known: Any) -> str:
        return ", ".join(name for name, k in zip(names, known, strict=False) if not k)

    def _state(self) -> tuple[Array, Array, Array]:
        """Coordinates (nq), velocities and accelerations (nv)."""
        return self.simulation.q, self.simulation.v, self.simulation.a

    @property
    def time(self) -> float:
        """Time that was flown, s."""
        return self.simulation.time

    def fly(self, outputs: Outputs, duration: float) -> None:
        """Fly on under outputs that are held, for a duration, s."""
        u = np.empty(len(self.vehicle.inputs))
        shares = np.minimum(np.maximum(outputs.motors, 0.0), 1.0)
        u[: self.rotors] = self._least + shares * (self._most - self._least)
        if self.joints:
            u[self.rotors :] = self._joint_commands(outputs.servos, u[: self.rotors])
        self.simulation.advance(u, duration)

    def _joint_commands(self, servos: Array, rotors: Array) -> Array:
        """Torques and forces, or commands of servos (n), by which joints go where they are to."""
        vehicle, gains = self.vehicle, self.loop.controller.gains
        places, joints = vehicle.arm_rates, vehicle.arm
        q, v, a = self._state()
        curves = self.loop.controller.reference.curves(self.time).reshape(3, -1)
        wanted, rate, growth = curves[:, joints]
        if self._wanted is not None:
            low, high = self._travel
            asked = low + 0.5 * (np.clip(servos, -1.0, 1.0) + 1.0) * (high - low)
            self._wanted = np.where(np.isnan(asked), self._wanted, asked)
            is_asked = ~np.isnan(self._wanted)
            wanted = np.where(is_asked, self._wanted, wanted)
            rate, growth = np.where(is_asked, 0.0, (rate, growth))
        stiffness, damping = gains.stiffness[places], gains.damping[places]
        off = wanted - q[joints]
        moved = a.copy()
        moved[places] = growth + damping * (rate - v[places]) + stiffness * off
        inputs = np.zeros(len(vehicle.inputs))
        inputs[self.rotors :] = vehicle.inverse_dynamics(q, v, moved)[places]
        if vehicle.rotors_move and not vehicle.is_driven:
            push = vehicle.input_matrix(q)[places, : self.rotors] @ rotors
            inputs[self.rotors :] -= push
        if not vehicle.is_driven:
            return inputs[self.rotors :]
        aim, speed = q.copy(), v.copy()
        aim[joints], speed[places] = wanted, rate + stiffness / damping * off
        return vehicle.command_of(aim, speed, inputs)[self.rotors :]

    def readings(self) -> Readings:
        """What sensors tell now."""
        vehicle, (q, v, a) = self.vehicle, self._state()
        pose, jacobian = vehicle.frame_poses(q)[0], vehicle.frame_jacobians(q)[0, :3]
        linear, angular = vehicle.frame_velocities(q, v)[0].reshape(2, 3)
        growth = jacobian @ a + vehicle.frame_bias_accelerations(q, v)[0, :3]
        rotation, layout = pose[:3, :3], vehicle.layout
        quaternion = q[layout.q.attitude]
        if not layout.is_quaternion:
            quaternion = Rotation.from_matrix(rotation).as_quat()
        return Readings(
            self.time,
            turned_over(angular @ rotation),
            turned_over((growth - self._gravity) @ rotation),
            north_east_down(pose[:3, 3]),
            north_east_down(linear),
            turned_attitude(quaternion),
        )
