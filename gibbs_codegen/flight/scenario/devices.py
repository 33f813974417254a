"""Sensors of a robot, as a scenario declares them: where each is, how often it reads, how it errs.

Where noise is a density, the standard deviation of a reading is the density times √rate;
a bias that walks adds steps from reading to reading, of its density divided by √rate.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, ClassVar

from gibbs_codegen.files.table import Bounds, Table, entry, key, needed, table
from gibbs_codegen.flight.scenario.numbers import (
    IN_DEGREES,
    LEAST,
    Endless,
    NotNegative,
    Number,
    Positive,
    Vector,
)
from gibbs_codegen.machine.sensors import Channel
from gibbs_codegen.robot.layout import Layout

Delay = Annotated[Number, Bounds(0.0, 10.0, " s")]
FRAME = "a name in the module's FRAMES"
_Rate = Annotated[Number, Bounds(0.1, 1e5)]
_Span = Annotated[Endless, Bounds(LEAST)]
_Name = Annotated[
    str,
    needed(
        lambda name: re.fullmatch("[A-Za-z][A-Za-z0-9_]{0,39}", name) is not None,
        "must be at most 40 letters, digits and _, and begin with a letter",
    ),
]
_ZERO = (0.0, 0.0, 0.0)
_NAME, _RATE = "unique name of the sensor", "readings a second, Hz"


def _vector(
    name: str,
    unit: str,
    noise: tuple[float, ...],
    walk: float = 0.0,
    bias: tuple[float, ...] = _ZERO,
    span: float = math.inf,
) -> Channel:
    """The channel of a vector (3)."""
    names = tuple(f"{name}_{axis}" for axis in "xyz")
    return Channel(names, (unit,) * 3, noise, walk, bias, span)


@table
class Device(Table):
    """A sensor, which reads at whole multiples of 1 / rate from time 0 on."""

    measures: ClassVar[str] = ""

    name: _Name = entry(_NAME, "sensor")
    rate: _Rate = entry(_RATE, 100.0)
    delay: Delay = entry("delay between measurement and reading, s", 0.0)

    def channels(self, layout: Layout) -> tuple[Channel, ...]:
        """The channels of a reading, on a robot with a layout of coordinates."""
        raise NotImplementedError

    @property
    def figures(self) -> tuple[float, ...]:
        """Figures of its place on earth."""
        return ()


@table
class DeviceAtFrame(Device):
    """A sensor that is at the origin of a frame."""

    frame: str = entry(f"frame of the sensor: {FRAME}", "base")


@table
class Imu(DeviceAtFrame):
    """An accelerometer, which measures specific force, and a gyroscope, in the axes of a frame."""

    measures: ClassVar[str] = "imu"

    name: _Name = entry(_NAME, "imu")
    rate: _Rate = entry(_RATE, 250.0)
    accelerometer_noise: NotNegative = entry("density of its noise, m/s²/√Hz", 0.0)
    accelerometer_walk: NotNegative = entry("density at which its bias walks, m/s³/√Hz", 0.0)
    accelerometer_bias: Vector = entry("its bias at the start, [x, y, z] in m/s²", _ZERO)
    accelerometer_range: _Span = entry(
        "greatest reading of an axis, m/s²; default: no limit", math.inf
    )
    gyroscope_noise: NotNegative = entry("density of its noise, rad/s/√Hz", 0.0)
    gyroscope_walk: NotNegative = entry("density at which its bias walks, rad/s²/√Hz", 0.0)
    gyroscope_bias: Vector = entry("its bias at the start, [x, y, z] in rad/s", _ZERO)
    gyroscope_range: _Span = entry(
        "greatest reading about an axis, rad/s; default: no limit", math.inf
    )

    def channels(self, layout: Layout) -> tuple[Channel, ...]:
        """Specific force and angular velocity."""
        root = math.sqrt(self.rate)
        return tuple(
            _vector(
                quantity,
                unit,
                (getattr(self, f"{part}_noise") * root,),
                getattr(self, f"{part}_walk") / root,
                getattr(self, f"{part}_bias"),
                getattr(self, f"{part}_range"),
            )
            for part, quantity, unit in (
                ("accelerometer", "acceleration", "m/s^2"),
                ("gyroscope", "angular_velocity", "rad/s"),
            )
        )


@table
class Barometer(DeviceAtFrame):
    """The pressure of the air, as its height in a standard atmosphere."""

    measures: ClassVar[str] = "barometer"

    name: _Name = entry(_NAME, "barometer")
    rate: _Rate = entry(_RATE, 50.0)
    altitude: Number = entry("height of the world's origin above sea level, m", 0.0)
    noise: NotNegative = entry("standard deviation of a reading, m", 0.0)
    drift: NotNegative = entry("density at which its bias walks, m/s/√Hz", 0.0)

    def channels(self, layout: Layout) -> tuple[Channel, ...]:
        """Altitude."""
        walk = self.drift / math.sqrt(self.rate)
        return (Channel(("altitude",), ("m",), (self.noise,), walk),)

    @property
    def figures(self) -> tuple[float, ...]:
        """The height of the world's origin above sea level, m."""
        return (self.altitude,)


@table
class Magnetometer(DeviceAtFrame):
    """The magnetic field of the earth, in the axes of a frame."""

    measures: ClassVar[str] = "magnetometer"

    name: _Name = entry(_NAME, "magnetometer")
    declination: Annotated[
        Number,
        Bounds(-180.0, 180.0, "°"),
        IN_DEGREES,
        key("declination of the field east of north, degrees", "declination_deg"),
    ] = 0.0
    inclination: Annotated[
        Number,
        Bounds(-90.0, 90.0, "°"),
        IN_DEGREES,
        key("inclination of the field below horizontal, degrees; default 60", "inclination_deg"),
    ] = math.radians(60.0)
    strength: Positive = entry("strength of the field, T", 5e-5)
    noise: NotNegative = entry("standard deviation along an axis, T", 0.0)
    bias: Vector = entry("field of magnets on the robot, [x, y, z] in T, axes of the frame", _ZERO)

    def channels(self, layout: Layout) -> tuple[Channel, ...]:
        """The field."""
        return (_vector("field", "T", (self.noise,), 0.0, self.bias),)

    @property
    def figures(self) -> tuple[float, ...]:
        """The magnetic field (3), T, world axes: x east, y north, z up."""
        level = self.strength * math.cos(self.inclination)
        east, north = math.sin(self.declination), math.cos(self.declination)
        return level * east, level * north, -self.strength * math.sin(self.inclination)


@table
class Gps(DeviceAtFrame):
    """Position and velocity of a frame by satellites, world axes."""

    measures: ClassVar[str] = "gps"

    name: _Name = entry(_NAME, "gps")
    rate: _Rate = entry(_RATE, 5.0)
    horizontal_noise: NotNegative = entry("standard deviation of x and of y, m", 0.0)
    vertical_noise: NotNegative = entry("standard deviation of z, m", 0.0)
    velocity_noise: NotNegative = entry("standard deviation of velocities along an axis, m/s", 0.0)

    def channels(self, layout: Layout) -> tuple[Channel, ...]:
        """Position and velocity."""
        level = self.horizontal_noise
        return (
            _vector("position", "m", (level, level, self.vertical_noise)),
            _vector("velocity", "m/s", (self.velocity_noise,)),
        )


@table
class PoseSensor(DeviceAtFrame):
    """Place and attitude of a frame by cameras, world axes, as motion capture tells them."""

    measures: ClassVar[str] = "pose"

    name: _Name = entry(_NAME, "pose")
    position_noise: NotNegative = entry("standard deviation of each coordinate, m", 0.0)
    attitude_noise: NotNegative = entry(
        "standard deviation of each entry of the directions of its axes, rad", 0.0
    )

    def channels(self, layout: Layout) -> tuple[Channel, ...]:
        """Position, and the directions of its x and y axes."""
        return (
            _vector("position", "m", (self.position_noise,)),
            *(_vector(f"{axis}_axis", "1", (self.attitude_noise,)) for axis in "xy"),
        )


@table
class Encoders(Device):
    """Coordinates of all joints."""

    measures: ClassVar[str] = "encoders"

    name: _Name = entry(_NAME, "encoders")
    rate: _Rate = entry(_RATE, 250.0)
    noise: NotNegative = entry("standard deviation of a reading, rad or m", 0.0)
    resolution: NotNegative = entry("step from one reading to the next, rad or m; 0: none", 0.0)

    def channels(self, layout: Layout) -> tuple[Channel, ...]:
        """Coordinates of the joints."""
        places, joints = layout.q, layout.q.joints
        names, units = places.names[joints], places.units[joints]
        return (Channel(names, units, (self.noise,), resolution=self.resolution),)


@table
class WrenchSensor(DeviceAtFrame):
    """Force and torque of contacts on a frame, in its axes."""

    measures: ClassVar[str] = "wrench"

    name: _Name = entry(_NAME, "wrench")
    rate: _Rate = entry(_RATE, 250.0)
    force_noise: NotNegative = entry("standard deviation along an axis, N", 0.0)
    force_range: _Span = entry("greatest force along an axis, N; default: no limit", math.inf)
    torque_noise: NotNegative = entry("standard deviation about an axis, N m", 0.0)
    torque_range: _Span = entry("greatest torque about an axis, N m; default: no limit", math.inf)

    def channels(self, layout: Layout) -> tuple[Channel, ...]:
        """Force and torque."""
        return (
            _vector("force", "N", (self.force_noise,), span=self.force_range),
            _vector("torque", "N m", (self.torque_noise,), span=self.torque_range),
        )
