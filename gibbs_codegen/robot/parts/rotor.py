"""Rotors on bodies: where they are, what they make of their commands, what the air does to them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

from gibbs_codegen.files.table import Bounds, Flag, Place, Real, listed
from gibbs_codegen.robot.parts.numbers import (
    AXES,
    BASE,
    NO_ANGLE,
    ORIGIN,
    XYZ,
    Angle,
    Direction,
    Label,
    NotNegative,
    Positive,
    Range,
    Size,
    Sizes3,
    Vector3,
    cos_sin,
)
from gibbs_codegen.robot.parts.part import Parameter, Part, entry, number, parameters_of, sized
from gibbs_codegen.robot.parts.pose import CARRIER, BodyNumber

Command = Literal["thrust", "speed", "throttle"]
COMMANDS: tuple[Command, ...] = ("thrust", "speed", "throttle")
MAX_ROTORS = 256


@dataclass(frozen=True)
class Drive:
    """The way from a rotor's command to its thrust.

    The command is a thrust, N, a speed, rad/s, or a throttle, 1, and so is its level, which follows
    the command with the time constants `up` and `down`, s; 0 is at once. The thrust is `curve`, a
    polynomial of second degree in the level, constant term first. `limits` are those of the
    command, `full_speed` in rad/s is the speed of a throttle of 1.
    """

    command: Command = "thrust"
    curve: Vector3 = (0.0, 1.0, 0.0)
    limits: tuple[float, float] | None = None
    up: float = 0.0
    down: float = 0.0
    full_speed: float | None = None

    @property
    def speed_per_sqrt_thrust(self) -> float:
        """Speed by the square root of the thrust, (rad/s)/√N, at the greatest command."""
        level = self.limits[1] if self.limits else 1e3
        return self.speed(level) / math.sqrt(max(self.thrust(level), 1e-12))

    def speed(self, level: float) -> float:
        """Speed, rad/s, at a level that is a speed or a throttle; 0 where it is not known."""
        return level if self.command == "speed" else level * (self.full_speed or 0.0)

    @property
    def thrust_limits(self) -> tuple[float, float] | None:
        """Least and greatest thrust, N, by the limits of its command where the curve rises."""
        if self.limits is None:
            return None
        low, high = (min(max(limit, self.rising[0]), self.rising[1]) for limit in self.limits)
        return self.thrust(low), self.thrust(high)

    @property
    def rising(self) -> tuple[float, float]:
        """Levels between which the thrust rises."""
        _, slope, square = self.curve
        if square == 0.0:
            return (-math.inf if slope > 0.0 else math.inf), math.inf
        turn = -slope / (2.0 * square) + 0.0
        return (-math.inf, turn) if square < 0.0 else (turn, math.inf)

    @property
    def lags(self) -> bool:
        """True if its level follows the command with a lag."""
        return self.up > 0.0

    def thrust(self, level: float) -> float:
        """Thrust, N, at a level."""
        constant, slope, square = self.curve
        return constant + level * (slope + level * square)

    def level(self, thrust: float) -> float:
        """Level at a thrust, N, on the rising side of the curve."""
        constant, slope, square = self.curve
        rest = thrust - constant
        if square == 0.0:
            return rest / slope
        root = math.sqrt(max(slope * slope + 4.0 * square * rest, 0.0))
        return (root - slope) / (2.0 * square)


# The keys that place a rotor around an axis instead of `position`, and those that direct its thrust
# instead of `direction`.
POLAR_KEYS = ("radius", "azimuth_deg", "height")
LEAN_KEYS = ("tilt_deg", "cant_deg")
# Keys that tell the thrust by the command, of which a rotor that is read has the first.
_CURVES = ("thrust_curve", "thrust_constant", "max_thrust")
# Keys that no rotor has which is commanded thrusts.
_DRIVEN = (*_CURVES, "thrust_model_factor", "command_limits", "full_speed")
# Keys of rotors that are commanded throttles, and those that need the speed of the rotor.
_OF_THROTTLES = ("max_thrust", "full_speed")
_BY_SPEED = ("hub_drag", "inflow", "thrust_by_advance")
# What the air does to a rotor besides its thrust in still air; by the disc's radius alone nothing.
AIR_KEYS = (
    *("hub_drag", "inflow", "translational_lift", "disc_radius", "ground_effect"),
    "thrust_by_advance",
)


@dataclass(frozen=True, kw_only=True)
class Rotor(Part):
    """A rotor on the base or on a link."""

    # What is read has each number in one form: a position and a direction, a thrust curve. With
    # the speed Ω, either way, the direction n of the thrust and the air speed v at its hub, the air
    # adds −Ω·hub_drag·v across n, −Ω·inflow·v along n, and translational_lift·v² across n, along n;
    # the ground raises the thrust (Cheeseman and Bennett, 1955).
    conditions: ClassVar[dict[str, Any]] = {
        "dependentRequired": {
            key: ["azimuth_deg"] for key in (*POLAR_KEYS, *LEAN_KEYS) if key != "azimuth_deg"
        },
        "dependentSchemas": {
            "position": {"properties": dict.fromkeys(POLAR_KEYS, False)},
            "direction": {"properties": dict.fromkeys(LEAN_KEYS, False)},
        },
    }
    of_drive: ClassVar[tuple[str, ...]] = (
        *("thrust_curve", "full_speed", "speed_per_sqrt_thrust"),
        *("time_constant", "time_constants"),
    )
    synonyms: ClassVar[Mapping[str, str]] = {
        "xyz": "position",
        "motorConstant": "thrust_constant",
        "maxRotVelocity": "full_speed",
        "rotorDragCoefficient": "hub_drag",
    }

    name: Label | None = entry("name of the rotor, any text; default: its number")
    on: BodyNumber = entry(CARRIER, BASE, written="base")
    position: Sizes3 = number(
        "place in the frame of what carries it, {m}", ORIGIN, name="", ends=XYZ
    )
    radius: NotNegative = entry("instead of position: distance from the z axis there, m", 0.0)
    azimuth_deg: Angle | None = entry(
        "instead of position: angle about the z axis there, from x towards y, degrees"
    )
    height: Size = entry("instead of position: distance along the z axis there, m", 0.0)
    direction: Direction = entry(
        'direction of its thrust in that frame: an axis such as "x" or "-y", or [x, y, z]',
        AXES["z"],
        written="z",
    )
    tilt_deg: Angle = entry(
        "instead of direction: how far the thrust leans from z outwards, along the azimuth, "
        "degrees",
        NO_ANGLE,
    )
    cant_deg: Angle = entry(
        "instead of direction: how far the thrust leans sideways, turned about the outward "
        "radius by the right-hand rule, which is clockwise seen from above, degrees",
        NO_ANGLE,
    )
    drag: Size = number(
        "reaction torque about its direction per unit of thrust, {m}: negative for a rotor that "
        "spins counter-clockwise, seen from the tip of its thrust",
        0.0,
    )
    limits: Range | None = entry(
        "least and greatest thrust, for simulators and controllers, N; default: none"
    )
    time_constant: NotNegative | None = sized(
        "time constant of its thrust, for simulators, {s}; default: none"
    )
    spin_inertia: NotNegative | None = entry(
        "moment of inertia of what spins with it, about its axis, for gyroscopic torques in "
        "simulators, kg m^2; default: none"
    )
    speed_per_sqrt_thrust: NotNegative | None = sized(
        "its speed divided by the square root of its thrust, for simulators, (rad/s)/sqrt(N); "
        "default: none",
        missing=0.0,
        unit="rad/s/N^0.5",
    )
    command: Command = entry(
        "kind of command: a thrust, N, a speed, rad/s, or a throttle, 0 to 1", "thrust"
    )
    thrust_curve: Sizes3 | None = number(
        "thrust as a function of speed or throttle x: [k0, k1, k2] of k0 + k1 x + k2 x², {N}",
        name="thrust",
        ends=("0", "1", "2"),
    )
    thrust_constant: Positive | None = entry(
        "thrust divided by the square of the speed, N/(rad/s)²; instead of a thrust_curve"
    )
    max_thrust: Positive | None = entry("thrust at a throttle of 1, N; instead of a thrust_curve")
    thrust_model_factor: Annotated[Real, Bounds(0.0, 1.0)] | None = entry(
        "share of max_thrust that grows with the square of the throttle, the rest linearly, as "
        "PX4's THR_MDL_FAC; default: 1"
    )
    command_limits: Range | None = entry(
        "least and greatest speed or throttle; default: none for speeds, [0, 1] for throttles"
    )
    full_speed: Positive | None = sized("speed at a throttle of 1, {rad/s}; default: unknown")
    time_constants: Annotated[tuple[Positive, Positive], listed(2)] | None = sized(
        "time constants with which it speeds up and slows down, {s}; instead of time_constant",
        name="time",
    )
    hub_drag: NotNegative = entry(
        "drag on its hub across its direction, per rotor speed and air speed, kg", 0.0
    )
    inflow: NotNegative = entry(
        "loss of thrust with air speed along its direction, per rotor speed and air speed, kg", 0.0
    )
    translational_lift: NotNegative = entry(
        "gain of thrust per square of the air speed across its direction, kg/m", 0.0
    )
    disc_radius: Positive | None = entry("radius of the rotor disc, m; default: unknown")
    ground_effect: Flag = entry(
        "whether thrust grows near the ground, as by Cheeseman and Bennett; needs disc_radius",
        False,
    )
    thrust_by_advance: tuple[Annotated[tuple[Real, Real], listed(2)], ...] | None = entry(
        "pairs of an advance ratio (air speed along its direction by that of the blades' tips), "
        "rising, and the factor of the thrust there, linear between; default: none"
    )

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of two forms of a placement, and of a rotor of which too little is known."""
        for whole, parts in (("position", POLAR_KEYS), ("direction", LEAN_KEYS)):
            present = [key for key in parts if key in values]
            if present and whole in values:
                yield present[0], f"excludes {whole}: give {whole}, or {', '.join(parts)}"
            elif present and "azimuth_deg" not in values:
                yield present[0], "needs azimuth_deg beside it, the angle of the radius about z"
        yield from _drive_faults(values)
        if "spin_inertia" in values and not _tells_speed(values):
            yield "spin_inertia", "needs speed_per_sqrt_thrust beside it: give both or none"
        uses = ("spin_inertia", *_BY_SPEED)
        if "speed_per_sqrt_thrust" in values and not any(key in values for key in uses):
            yield "speed_per_sqrt_thrust", "needs spin_inertia beside it: give both or none"
        if "spin_inertia" in values and values.get("drag", 0.0) == 0.0:
            yield (
                "spin_inertia",
                "needs a drag other than 0, because its sign gives the direction of spin",
            )
        either = "full_speed, or " if values.get("command") == "throttle" else ""
        for key in _BY_SPEED:
            if key in values and not _tells_speed(values):
                yield key, f"needs the rotor's speed: give {either}speed_per_sqrt_thrust"
        for key in ("ground_effect", "thrust_by_advance"):
            if values.get(key) and "disc_radius" not in values:
                yield key, "needs disc_radius beside it, in m"

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """Faults of ratios that do not rise, and of thrusts that do not rise with the command."""
        ratios = [ratio for ratio, _ in self.thrust_by_advance or ()]
        if ratios and (len(ratios) < 2 or ratios != sorted({*ratios})):
            yield ("thrust_by_advance",), "must have two pairs or more, with rising ratios"
        drive, cause = self.drive, "command_limits" if self.command_limits else "thrust_curve"
        if drive.command == "thrust":
            return
        (_, slope, square), (begin, end), command = drive.curve, drive.rising, drive.command
        most = drive.limits[1] if drive.limits else math.inf
        if (square < 0.0 and slope <= 0.0) or begin == end:
            yield ("thrust_curve",), f"must rise with the {command}: give a k1 or a k2 above 0"
        elif most <= begin:
            yield (
                ("thrust_curve" if self.thrust_curve else cause,),
                f"lets the thrust rise only from {begin:g} on, beyond the greatest {command}, "
                f"{most:g}; it must rise below that",
            )
        elif most > end:
            yield (
                (cause,),
                f"lets the thrust fall beyond a {command} of {end:g}; give command_limits that end "
                "there or before",
            )

    def drive_parameters(self) -> dict[str, Parameter]:
        """Numbers that can be parameters of what it makes of its command."""
        marks, drive, keys = parameters_of(type(self)), self.drive, []
        if drive.command != "thrust":
            keys.append("thrust_curve")
            per, power = ("N/(rad/s)", "^2") if drive.command == "speed" else ("N", "")
            # Commands are found of thrusts on the rising side, and divided by one of the two.
            _, slope, square = drive.curve
            of_curve = (
                Parameter("N"),
                Parameter(per, keeps_sign=True, no_zero=square == 0.0),
                Parameter(per + power, keeps_sign=True, no_zero=slope <= 0.0),
            )
            marks["thrust_curve"] = replace(marks["thrust_curve"], of_entries=of_curve)
        if drive.full_speed is not None:
            keys.append("full_speed")
        elif drive.command == "thrust":
            keys.append("speed_per_sqrt_thrust")
        if drive.lags:
            keys.append("time_constants" if self.time_constants else "time_constant")
            ends = ("up", "down") if drive.up != drive.down else ("constant",) * 2
            marks["time_constants"] = replace(marks["time_constants"], ends=ends)
        return {key: marks[key] for key in keys}

    @property
    def has_drive(self) -> bool:
        """True if it makes more of its command than its thrust with one lag or none."""
        return self.command != "thrust" or self.time_constants is not None

    @property
    def feels_air(self) -> bool:
        """True if the air does anything to it besides its thrust in still air."""
        return any(getattr(self, key) for key in AIR_KEYS if key != "disc_radius")

    @cached_property
    def drive(self) -> Drive:
        """The way from its command to its thrust."""
        lag = self.time_constant or 0.0
        up, down = self.time_constants or (lag, lag)
        if self.command == "thrust":
            return Drive(limits=self.limits, up=up, down=down)
        square = self.thrust_constant or 0.0
        if self.command == "throttle" and self.full_speed is not None:
            square *= self.full_speed**2
        share = 1.0 if self.thrust_model_factor is None else self.thrust_model_factor
        most = self.max_thrust or 0.0
        curve = self.thrust_curve or (0.0, (1.0 - share) * most, square or share * most)
        limits = self.command_limits or ((0.0, 1.0) if self.command == "throttle" else None)
        return Drive(self.command, curve, limits, up, down, self.full_speed)

    def _completed(self) -> Rotor:
        """The rotor with each number in one form."""
        keys: dict[str, Any] = dict.fromkeys(("thrust_constant", "max_thrust"))
        keys |= {"thrust_model_factor": None, "thrust_by_advance": self.thrust_by_advance or None}
        if self.azimuth_deg is not None:
            keys["position"] = polar_point(self.radius, self.azimuth_deg, self.height)
            if self.tilt_deg or self.cant_deg:
                lean = self.azimuth_deg, self.tilt_deg, self.cant_deg
                keys["direction"] = leaning_direction(*lean)
            keys |= {key: _FORMS[key] for key in (*POLAR_KEYS, *LEAN_KEYS)}
        if self.command != "thrust":
            keys |= {"thrust_curve": self.drive.curve, "command_limits": self.drive.limits}
        if self.has_drive and self.spin_inertia and not self.speed_per_sqrt_thrust:
            keys["speed_per_sqrt_thrust"] = self.drive.speed_per_sqrt_thrust
        if not self.feels_air:
            keys["disc_radius"] = None
        return replace(self, **keys)


_FORMS = {key.name: key.default for key in fields(Rotor)}


def polar_point(radius: float, azimuth_deg: Fraction, height: float) -> Vector3:
    """The point at a distance from the z axis, an angle about it from x, and along it, m."""
    c, s = cos_sin(azimuth_deg)
    return (radius * c + 0.0, radius * s + 0.0, height)


def leaning_direction(azimuth_deg: Fraction, tilt_deg: Fraction, cant_deg: Fraction) -> Vector3:
    """R_z(azimuth)·R_x(cant)·R_y(tilt)·z: z leant away from the z axis, then about the radius."""
    (c, s), (ct, st), (cc, sc) = map(cos_sin, (azimuth_deg, tilt_deg, cant_deg))
    return (c * st + s * sc * ct + 0.0, s * st - c * sc * ct + 0.0, cc * ct + 0.0)


def _tells_speed(values: Mapping[str, Any]) -> bool:
    """True if keys of a rotor tell its speed, or may if its command is misspelt or missing."""
    if "command" not in values and any(key in values for key in _DRIVEN):
        return True
    command = values.get("command", "thrust")
    if command == "thrust" or (command == "throttle" and "full_speed" not in values):
        return "speed_per_sqrt_thrust" in values
    return True


def _drive_faults(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Faults of what a rotor makes of its command, one that is known."""
    command = values.get("command", "thrust")
    if command not in COMMANDS:
        return
    curves = [key for key in _CURVES if key in values]
    if command == "thrust" and (others := [key for key in _DRIVEN if key in values]):
        right = '"speed"' if "thrust_constant" in curves else '"speed" or "throttle"'
        if {*_OF_THROTTLES, "thrust_model_factor"} & {*others}:
            right = '"throttle"'
        words = "must be" if "command" in values else "missing: give"
        yield "command", f"{words} {right}; thrusts are commanded without {', '.join(others)}"
    elif command != "thrust" and "limits" in values:
        yield "limits", f"are limits of a thrust; give command_limits, the limits of the {command}"
    if command != "thrust" and len(curves) != 1:
        right_keys = "thrust_curve or thrust_constant"
        if command == "throttle":
            right_keys = "max_thrust, thrust_curve, or thrust_constant with full_speed"
        if curves:
            yield curves[-1], f"excludes {curves[0]}; give {right_keys}"
        else:
            yield "command", f"needs the thrust of the {command} beside it: give {right_keys}"
    if command == "throttle" and "thrust_constant" in values and "full_speed" not in values:
        yield "thrust_constant", "needs full_speed beside it, the speed at a throttle of 1, rad/s"
    if command == "speed":
        for key in _OF_THROTTLES:
            if key in values:
                yield key, 'needs command = "throttle" beside it, since speeds are commanded here'
    if "thrust_model_factor" in values and "max_thrust" not in values:
        yield "thrust_model_factor", "needs max_thrust beside it, N"
    if "time_constants" in values and "time_constant" in values:
        yield (
            "time_constants",
            "excludes time_constant; give time_constants if slowing down takes another time "
            "than speeding up, else time_constant",
        )
