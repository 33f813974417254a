"""A robot as an autopilot has it: outputs of motors and servos go in, readings of sensors come out.

What both are is said in `machine/autopilot.py`.
"""

from __future__ import annotations

import math
import os
from dataclasses import replace
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.attitude import quaternion_of
from gibbs_codegen.flight.autopilots.air import ALTITUDE
from gibbs_codegen.flight.desired.trajectory import Progress
from gibbs_codegen.flight.integration.closed_loop import loop_program
from gibbs_codegen.flight.integration.state_history import Loads
from gibbs_codegen.flight.plant.environment import Environment
from gibbs_codegen.flight.plant.sensors import SensorSuite
from gibbs_codegen.flight.plant.state_program import state_program
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.scenario.devices import Barometer, Gps, Imu, Magnetometer
from gibbs_codegen.flight.scenario.parts import Sensors
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.stepping import Simulation
from gibbs_codegen.machine.autopilot import command_program, telling_program
from gibbs_codegen.robot.autopilot_axes import north_east_down, turned_attitude, turned_over
from gibbs_codegen.robot.layout import check_free_base


class Outputs(NamedTuple):
    """Commands of an autopilot: shares (N) of motors, 0 to 1, and places (n) of servos, −1 to 1.

    What is beyond is as the nearest of these. Motors that are NaN rest, and servos stay.
    """

    motors: Array
    servos: Array


class Telemetry(NamedTuple):
    """Readings of sensors at a time, s; a body's axes are FRD, the world's NED.

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
    """A robot in a scenario, which an autopilot flies; the scenario's path and law play no part.

    Args:
        robot: A generated module, or the name or path of one.
        scenario: Motion of the joints, wind, loads and walls, sensors, the start.
        servos: Whether outputs of the autopilot move the joints, and not the scenario.
        progress: Called with the name of the work and the share done.

    Raises:
        UsageError: For a flight that cannot begin, and for rotors and joints without the limits
            that outputs are shares of.
    """

    def __init__(
        self,
        robot: ModuleType | str | os.PathLike[str],
        scenario: Scenario,
        servos: bool = False,
        progress: Progress = lambda stage, share: None,
    ) -> None:
        settings = replace(scenario.integration, method="rk4", divergence=math.inf)
        scenario = replace(scenario, integration=settings)
        self.simulation = Simulation(robot, scenario, progress)
        self.loop = self.simulation.loop
        self.vehicle, self.servos = self.loop.vehicle, servos
        check_free_base(self.vehicle.name, self.vehicle.attitude, "autopilots are")
        self.rotors, self.joints = self.vehicle.rotors, self.vehicle.joints
        actuators = self.loop.actuators
        # Rotors that could push backwards as well do not.
        least, most = np.maximum(actuators.sent[:, : self.rotors], [[0.0], [-np.inf]])
        if missing := self._without(self.vehicle.commands, np.isfinite(least + most)):
            raise UsageError(
                f"{self.vehicle.name}: {missing}: the greatest thrust is not known, and "
                "autopilots send shares of it; give limits in the robot file, or motors.limits"
            )
        travel = actuators.joints
        bounded = np.isfinite(travel).all(axis=0)
        if servos and (missing := self._without(self.vehicle.joint_names, bounded)):
            raise UsageError(
                f"{self.vehicle.name}: {missing}: servo outputs from -1 to 1 span the limits of "
                "a joint, which are missing; give limits in the robot file, or arm.limits"
            )
        sensors = scenario.sensors or Sensors()
        chosen: dict[str, Any] = {k: getattr(sensors, k)[:1] or (x,) for k, x in _USUAL.items()}
        suite = SensorSuite(self.vehicle, Sensors(**chosen))
        # Places of the scenario's sensors in the telemetry.
        pairs = zip(_USUAL, suite.devices, suite.places, strict=True)
        self._rows = {device.name: place for kind, device, place in pairs if getattr(sensors, kind)}
        closed, law = loop_program(self.loop, Loads(inputs=())), self.loop.controller
        values = {"least": least, "most": most, "low": travel[0], "high": travel[1]}
        values |= {"stiffness": law.gains.stiffness, "damping": law.gains.damping}
        values |= {"gravity": Environment(self.vehicle).gravity}
        self._commands = state_program(
            self.vehicle,
            command_program(closed),
            {**values, "servos": np.nan, "asked": np.nan},
            self.loop.controller.tables,
            {"desired": law.reference.curves},
        )
        measurement = telling_program(closed, suite.program)
        self._telling = state_program(self.vehicle, measurement, values)
        # Places and signs of the telemetry in axes of autopilots.
        read = np.arange(1, suite.size + 7)
        turned = [*map(turned_over, read[:6].reshape(2, 3)), read[6:7], turned_over(read[7:10])]
        numbers = np.concatenate([*turned, *map(north_east_down, read[10:].reshape(4, 3))])
        self._places, self._signs = np.abs(numbers).astype(int) - 1, np.sign(numbers)
        # An autopilot is not to wait for what is compiled.
        self.simulation.prepare()

    @staticmethod
    def _without(names: tuple[str, ...], has_value: Any) -> str:
        return ", ".join(name for name, k in zip(names, has_value, strict=False) if not k)

    @property
    def time(self) -> float:
        """Time that was flown, s."""
        return self.simulation.time

    def fly(self, outputs: Outputs, duration: float) -> None:
        """Fly on under outputs that are held.

        Args:
            outputs: What the autopilot commands.
            duration: How long, s.
        """
        inputs, commands = self._commands.inputs, self._commands.outputs
        inputs["time"][...], inputs["motors"][...] = self.time, outputs.motors
        inputs["x"][...], inputs["a"][...] = self.simulation.state, self.simulation.a
        if self.servos:
            inputs["servos"][...] = outputs.servos
        self._commands.run()
        inputs["asked"][...] = commands["next"]
        self.simulation.advance(commands["u"], duration)

    def readings(self) -> Telemetry:
        """Readings of sensors now: the scenario's, and without errors those that it lacks."""
        inputs = self._telling.inputs
        inputs["x"][...], inputs["a"][...] = self.simulation.state, self.simulation.a
        self._telling.run()
        telemetry = self._telling.outputs["told"].copy()
        sensed = self.simulation.sensors if self._rows else {}
        for name, place in self._rows.items():
            if np.isfinite(values := sensed[name].values).all():
                telemetry[place] = values
        attitude = telemetry[len(self._places) :]
        if not self.vehicle.layout.is_quaternion:
            attitude = quaternion_of(attitude.reshape(3, 3))
        turned = telemetry.take(self._places) * self._signs + 0.0
        force, turning, field = turned[:3], turned[3:6], turned[7:10]
        fix, fix_velocity, position, velocity = turned[10:].reshape(4, 3)
        return Telemetry(
            *(self.time, turning, force, float(turned[6]), field, (fix, fix_velocity)),
            *(position, velocity, turned_attitude(attitude)),
        )
