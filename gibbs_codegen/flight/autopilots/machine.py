"""A robot as an autopilot has it: outputs of motors and servos go in, readings of sensors come out.

The autopilot flies the base. Joints follow the scenario, or servos of the autopilot, by computed
torque: the inverse dynamics of the accelerations that joints are to have, and of the one that the
base has under what acts on it, which its acceleration tells.
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
from gibbs_codegen.flight.autopilots.air import ALTITUDE
from gibbs_codegen.flight.desired.trajectory import Progress
from gibbs_codegen.flight.plant.sensors import SensorSuite
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.scenario.devices import Barometer, Gps, Imu, Magnetometer
from gibbs_codegen.flight.scenario.parts import Sensors
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.stepping import Simulation
from gibbs_codegen.robot.autopilot_axes import north_east_down, turned_attitude, turned_over


@dataclass(frozen=True)
class Outputs:
    """What an autopilot commands: shares (N) of motors, 0 to 1, and places (n) of servos, −1 to 1.

    What is beyond is as the nearest of these. Motors that are NaN rest, and servos stay.
    """

    motors: Array
    servos: Array


@dataclass(frozen=True)
class Readings:
    """What sensors tell at a time, s; a body's axes are FRD, the world's NED.

    Angular velocity `gyro` (3), rad/s, and specific force `accelerometer` (3), m/s², in the body's
    axes; `altitude` of the pressure above the sea, m; magnetic `field` (3), T, in the body's axes;
    `fix` of satellites: position (3), m, and velocity (3), m/s. The truth about the base's origin
    are `position` (3), m, `velocity` (3), m/s, and `quaternion` (4), real part first, which turns
    the body's axes into the world's.
    """

    time: float
    gyro: Array
    accelerometer: Array
    altitude: float
    field: Array
    fix: tuple[Array, Array]
    position: Array
    velocity: Array
    quaternion: Array


# Kinds of sensors that autopilots have, and those of a machine whose scenario has none. The field
# is that where the origin is.
_USUAL: dict[str, Any] = {
    "imu": Imu(),
    "barometer": Barometer(altitude=ALTITUDE),
    "magnetometer": Magnetometer(
        declination=math.radians(3.0), inclination=math.radians(64.0), strength=4.8e-5
    ),
    "gps": Gps(),
}


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
        self.vehicle, self.servos = self.loop.vehicle, servos
        self.rotors, self.joints = self.vehicle.rotors, self.vehicle.joints
        actuators = self.loop.actuators
        limits = actuators.thrusts if actuators.commands is None else actuators.commands
        # Rotors that could push backwards as well do not.
        self._least, self._most = np.maximum(limits[:, : self.rotors], [[0.0], [-np.inf]])
        if missing := self._without(self.vehicle.commands, np.isfinite(self._least + self._most)):
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
        own = scenario.sensors or Sensors()
        self._own = {kind: getattr(own, kind)[:1] for kind in _USUAL}
        chosen: dict[str, Any] = {kind: self._own[kind] or (each,) for kind, each in _USUAL.items()}
        self._suite = SensorSuite(self.vehicle, Sensors(**chosen))
        self._wanted: Array | None = np.full(self.joints, np.nan) if servos else None

    @staticmethod
    def _without(names: tuple[str, ...], known: Any) -> str:
        return ", ".join(name for name, k in zip(names, known, strict=False) if not k)

    @property
    def time(self) -> float:
        """Time that was flown, s."""
        return self.simulation.time

    def fly(self, outputs: Outputs, duration: float) -> None:
        """Fly on under outputs that are held, for a duration, s."""
        u = np.empty(len(self.vehicle.inputs))
        shares = np.clip(np.nan_to_num(outputs.motors), 0.0, 1.0)
        u[: self.rotors] = self._least + shares * (self._most - self._least)
        if self.joints:
            u[self.rotors :] = self._joint_commands(outputs.servos, u[: self.rotors])
        self.simulation.advance(u, duration)

    def _joint_commands(self, servos: Array, rotors: Array) -> Array:
        """Torques and forces, or commands of servos (n), by which joints go where they are to."""
        vehicle, gains = self.vehicle, self.loop.controller.gains
        places, joints = vehicle.arm_rates, vehicle.arm
        q, v = self.simulation.q, self.simulation.v
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
        wished = growth + damping * (rate - v[places]) + stiffness * off
        # What acts on the base stays, and joints that move otherwise move it otherwise.
        mass, every = vehicle.mass_matrix(q), np.arange(len(v))
        base, moved = np.delete(every, places), self.simulation.a.copy()
        coupling = mass[np.ix_(base, every[places])]
        moved[base] -= np.linalg.solve(
            mass[np.ix_(base, base)], coupling @ (wished - moved[places])
        )
        moved[places] = wished
        inputs = np.zeros(len(vehicle.inputs))
        inputs[self.rotors :] = vehicle.inverse_dynamics(q, v, moved)[places]
        if vehicle.rotors_move and not vehicle.is_driven:
            inputs[self.rotors :] -= vehicle.input_matrix(q)[places, : self.rotors] @ rotors
        if not vehicle.is_driven:
            return inputs[self.rotors :]
        aim, speed = q.copy(), v.copy()
        # Servos of positions have no gains; those of rates correct the error by theirs.
        correction = np.divide(stiffness, damping, out=np.zeros_like(off), where=damping > 0.0)
        aim[joints], speed[places] = wanted, rate + correction * off
        return vehicle.command_of(aim, speed, inputs)[self.rotors :]

    def readings(self) -> Readings:
        """What sensors tell now: those of the scenario, and without errors those that it lacks."""
        vehicle, q, v = self.vehicle, self.simulation.q, self.simulation.v
        exact = self._suite.measured(q, v, self.simulation.a)
        told, sensed = {}, self.simulation.sensors
        for (kind, own), place in zip(self._own.items(), self._suite.places, strict=True):
            told[kind] = exact[place]
            if own and np.all(np.isfinite(values := sensed[own[0].name].values)):
                told[kind] = values
        pose = vehicle.frame_poses(q)[0]
        layout, quaternion = vehicle.layout, q[vehicle.layout.q.attitude]
        if not layout.is_quaternion:
            quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat()
        force, turning = told["imu"].reshape(2, 3)
        position, velocity = told["gps"].reshape(2, 3)
        return Readings(
            self.time,
            turned_over(turning),
            turned_over(force),
            float(told["barometer"][0]),
            turned_over(told["magnetometer"]),
            (north_east_down(position), north_east_down(velocity)),
            north_east_down(pose[:3, 3]),
            north_east_down(vehicle.frame_velocities(q, v)[0, :3]),
            turned_attitude(quaternion),
        )
