"""The tables of a robot file: what each key may hold, and the robot that they make.

A key is one field with its description: of rods and bodies, of the base and its arms, of rotors,
frames and links, and of the top table, in this order. What names refer to is in `references`.
`docs/reference/robot-file.md` explains them at length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import field, replace
from fractions import Fraction
from itertools import chain, pairwise
from typing import Annotated, Any, ClassVar, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetCoreSchemaHandler,
    GetPydanticSchema,
    TypeAdapter,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from pydantic.config import JsonDict
from pydantic_core import CoreSchema, core_schema

from gibbs_codegen.files.table import (
    AnyReal,
    Bounds,
    Flag,
    Place,
    Real,
    Table,
    Tables,
    Whole,
    at_most,
    fault,
    file_table,
    key,
    list_of,
    listed,
    optional,
    refusal,
    shown,
    told,
)
from gibbs_codegen.robot import model
from gibbs_codegen.robot.layout import frames_of
from gibbs_codegen.robot.names import LONGEST_LABEL, NAME_PATTERN, name_fault
from gibbs_codegen.robot.placement import leaning_direction, polar_point
from gibbs_codegen.robot.references import body_numbers, constraint_faults, reference_faults
from gibbs_codegen.robot.rigid_body import body_fault, size_fault

_SIGNED_AXES = model.AXES | {
    f"-{letter}": (0.0 - x, 0.0 - y, 0.0 - z) for letter, (x, y, z) in model.AXES.items()
}


def _end_fault(end: float) -> str | None:
    if math.isnan(end):
        return "must be a number, or inf where there is no limit, not nan"
    return None if math.isinf(end) else size_fault(end)


def _order_fault(limits: tuple[float, float]) -> str | None:
    low, high = limits
    right = low <= high and low != math.inf and high != -math.inf
    return None if right else f"must be [lower, upper], not [{low:g}, {high:g}]"


def _axis(value: object) -> object:
    if not isinstance(value, str):
        return tuple(list_of(value, 3))
    if value not in _SIGNED_AXES:
        letters = ", ".join(f'"{axis}"' for axis in _SIGNED_AXES)
        raise fault(f"must be {letters} or a direction [x, y, z], not {shown(value)}")
    return _SIGNED_AXES[value]


def _unit_vector(direction: model.Vector3) -> model.Vector3:
    largest = max(map(abs, direction))
    if largest == 0.0:
        raise fault("a direction of length zero; give at least one entry that is not 0")
    if abs(math.hypot(*direction) - 1.0) < 1e-15:  # A unit vector stays what it is, bit for bit.
        return direction
    # Scaled by the largest entry first, so that tiny and huge vectors neither vanish nor overflow.
    x, y, z = (entry / largest for entry in direction)
    norm = math.hypot(x, y, z)
    return (x / norm, y / norm, z / norm)


def _exact(source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
    """An angle, degrees, as the shortest decimal that is its float: what the file says."""
    # In radians huge angles lose the part of a turn that they end in.
    bounds = Bounds(-360.0, 360.0, " degrees", "; leave out whole turns")
    degrees = handler.generate_schema(Annotated[Real, bounds])
    return core_schema.no_info_after_validator_function(lambda v: Fraction(repr(v)), degrees)


_IN_ORDER = told(_order_fault)
Size = Annotated[Real, told(size_fault)]
NotNegative = Annotated[Size, Bounds(0.0)]
Positive = Annotated[
    Size,
    Bounds(0.0),
    told(lambda value: None if value > 0.0 else "must be above 0"),
]
Angle = Annotated[Fraction, GetPydanticSchema(_exact)]
Sizes3 = Annotated[tuple[Size, Size, Size], listed(3)]
_ENTRIES = "numbers, xx, yy, zz, xy, xz, yz"
Sizes6 = Annotated[tuple[Size, Size, Size, Size, Size, Size], listed(6, _ENTRIES)]
Angles = Annotated[tuple[Angle, Angle, Angle], listed(3)]
Range = Annotated[tuple[Size, Size], listed(2), _IN_ORDER]
_End = Annotated[AnyReal, told(_end_fault)]
OpenRange = Annotated[tuple[_End, _End], listed(2), _IN_ORDER]
Name = Annotated[str, told(name_fault), WithJsonSchema({"type": "string", "pattern": NAME_PATTERN})]
Label = Annotated[
    str,
    told(
        lambda text: (
            None
            if 0 < len(text) <= LONGEST_LABEL
            else f"must be 1 to {LONGEST_LABEL} characters, not {len(text)}"
        )
    ),
    WithJsonSchema({"type": "string", "minLength": 1, "maxLength": LONGEST_LABEL}),
]
Direction = Annotated[
    tuple[Real, Real, Real],
    BeforeValidator(_axis),
    AfterValidator(_unit_vector),
    WithJsonSchema(
        {
            "anyOf": [
                {"enum": list(_SIGNED_AXES)},
                {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
            ]
        }
    ),
]
_ORIGIN = (0.0, 0.0, 0.0)
_NO_ANGLE = Fraction(0)


# Key of the robot file that lets inertias pass that no body has.
ALLOWED = "allow_impossible_inertia"
RIGID_NEEDS_MASS: JsonDict = {"com": ["mass"], "inertia": ["mass"]}
NOT_BOTH_BODIES: JsonDict = {
    "mass": {"properties": {"mass_per_length": False, "section_inertia": False}}
}


@file_table
class RigidTable(Table):
    """Mass, centre of mass and inertia of a rigid body."""

    mass: NotNegative | None = optional("mass of a rigid body, kg")
    com: Sizes3 = optional(
        "centre of mass of a rigid body, in the axes of its link or of the base, m", _ORIGIN
    )
    inertia: Sizes6 = optional(
        "inertia xx, yy, zz, xy, xz, yz of a rigid body about its centre of mass, in "
        "the same axes, with xy = −∫ xy dm, kg m²",
        (*_ORIGIN, *_ORIGIN),
    )

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Fault of a rigid body without a mass."""
        if ("com" in values or "inertia" in values) and "mass" not in values:
            yield "mass", "missing: a rigid body needs its mass in kg"

    @model_validator(mode="after")
    def _is_possible(self, info: ValidationInfo) -> Self:
        body = self.body()
        allowed = (info.context or {}).get(ALLOWED) is True
        if body is None or allowed or not (words := body_fault(body)):
            return self
        place = ("section_inertia" if isinstance(body, model.Rod) else "inertia",)
        raise refusal([(place, f"{words}; {ALLOWED} = true lets it pass")])

    def body(self) -> model.Body | None:
        """The body that the table describes, or None where it gives no mass."""
        return self.rigid_body(0.0)

    def rigid_body(self, length: float) -> model.RigidBody | None:
        """The rigid body, None without mass; `length`, m, is the way along x to what comes next."""
        if self.mass is None:
            return None
        return model.RigidBody(length, self.mass, self.com, self.inertia)


@file_table
class BodyTable(RigidTable):
    """A rod, with mass_per_length and section_inertia, or any rigid body, with mass."""

    length: NotNegative = optional(
        "distance along x to what comes next, a motor, a joint or the tip, m", 0.0
    )
    mass_per_length: NotNegative = optional("mass per length of a rod, kg/m", 0.0)
    section_inertia: Sizes3 = optional(
        "inertia xx, yy, zz of a whole rod, added about its centre of mass, kg m²", _ORIGIN
    )

    conditions: ClassVar[JsonDict] = {
        "dependentRequired": RIGID_NEEDS_MASS,
        "dependentSchemas": NOT_BOTH_BODIES,
    }

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of a body that is both a rod and a rigid body, or has no mass."""
        rigid = [key for key in ("mass", "com", "inertia") if key in values]
        rod = [key for key in ("mass_per_length", "section_inertia") if key in values]
        if rigid and rod:
            yield (
                rod[0],
                f"belongs to a rod, but {rigid[0]} describes a rigid body: give mass_per_length "
                "and section_inertia, or mass, com and inertia",
            )
        yield from super()._key_faults(values)

    def body(self) -> model.Body:
        """The body that the table describes."""
        rod = model.Rod(self.length, self.mass_per_length, self.section_inertia)
        return self.rigid_body(self.length) or rod


@file_table
class ArmTable(BodyTable):
    """An arm of the base, with a motor at its end."""

    # Without a default, which a body has.
    length: NotNegative = Field(description="the distance from the base centre to the motor, in m")


_ARM, _ARMS = TypeAdapter(ArmTable), TypeAdapter(list[ArmTable])
# The keys of rods and of the motors at their ends.
ROD_KEYS = ("rotors", "arm", "thrust", "drag", "azimuth_deg")


@file_table
class BaseTable(RigidTable):
    """The flying base, rigid: a central body, rods with a motor at the end of each, or both."""

    conditions: ClassVar[JsonDict] = {
        "dependentRequired": {
            **RIGID_NEEDS_MASS,
            **{key: [other for other in ROD_KEYS[:2] if other != key] for key in ROD_KEYS},
        }
    }

    rotors: Annotated[Whole, Bounds(2, model.MAX_ROTORS)] | None = optional(
        "the number of rotors and arms, N"
    )
    attitude: model.Attitude = optional(
        "intrinsic sequence of the attitude angles, or quaternion", "xyz"
    )
    origin: model.Origin | None = optional(
        "the point whose position is x, y, z: motor1 or centre where the base has "
        "arms, base where it has none; default: motor1 with arms, base without"
    )
    thrust: list[Direction] | None = optional(
        "direction of the thrust of each motor in its arm's frame: an axis, or "
        "[x, y, z]; default: z for odd motors, y for even ones"
    )
    drag: list[Size] | None = optional(
        "reaction torque of each motor about its thrust's direction per unit of "
        "thrust, m; default 0"
    )
    azimuth_deg: list[Angle] | None = optional(
        "angle of each arm about the base's normal z, from the base's x axis, degrees; "
        "default: equal angles, with arm 1 seen from its motor"
    )
    arm: ArmTable | list[ArmTable] | None = optional(
        "one table for all arms, or a list of one for each"
    )

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of arms that are not whole, or not as many as there are rotors."""
        yield from super()._key_faults(values)
        if any(each in values for each in ROD_KEYS):
            for each in ROD_KEYS[:2]:
                if each not in values:
                    yield each, cls._missing(each)
        elif values.get("origin") in model.ROD_ORIGINS:
            yield "origin", 'must be "base" where the base has no arms (base.rotors and base.arm)'
        arms, rotors = values.get("arm"), values.get("rotors")
        if not isinstance(arms, list) or not isinstance(rotors, int):
            return
        if 1 < rotors <= model.MAX_ROTORS and rotors != len(arms) <= model.MAX_ROTORS:
            what = f"a list of {len(arms)} for {rotors} rotors"
            yield "arm", f"{what}; give one table for all, or one each"

    @field_validator("thrust", "drag", "azimuth_deg", mode="before")
    @classmethod
    def _one_per_motor(cls, value: object, info: ValidationInfo) -> object:
        rotors = info.data.get("rotors")
        if rotors is None:  # How many there must be is not known; a flood there is not.
            return value[: model.MAX_ROTORS] if isinstance(value, list) else value
        if info.field_name != "thrust":
            return list_of(value, rotors)
        if not isinstance(value, list) or len(value) != rotors:
            raise fault(f"must be a list of {rotors} directions, one per motor")
        return value

    @field_validator("arm", mode="wrap")
    @classmethod
    def _one_or_each(
        cls, value: object, _: object, info: ValidationInfo
    ) -> ArmTable | list[ArmTable]:
        """One checked table for all arms, or a list of them.

        The field's own validator would try both forms and tell faults of both.
        """
        if isinstance(value, list):
            arms = at_most(value, model.MAX_ROTORS, "arms")
            return _ARMS.validate_python(arms, context=info.context)
        return _ARM.validate_python(value, context=info.context)

    def built(self) -> model.Base:
        """The base that the table describes."""
        body = self.rigid_body(0.0)
        if self.rotors is None or self.arm is None:
            return model.Base(attitude=self.attitude, origin=self.origin or "base", body=body)
        arms = self.arm if isinstance(self.arm, list) else [self.arm]
        return model.Base(
            self.rotors,
            tuple(arm.body() for arm in arms),
            tuple(self.thrust) if self.thrust else model.alternating_thrust(self.rotors),
            tuple(self.drag or (0.0,) * self.rotors),
            self.attitude,
            self.origin or "motor1",
            body,
            tuple(self.azimuth_deg) if self.azimuth_deg else None,
        )


_ON = 'what carries it: "base" or the name of a link'


@file_table
class PoseTable(Table):
    """A pose in the frame of a body."""

    xyz: Sizes3 | None = optional("place in the frame of what carries it, m; default [0, 0, 0]")
    rpy_deg: Angles | None = optional(
        "roll, pitch and yaw in that frame, R = R_z·R_y·R_x as in URDF, degrees; default [0, 0, 0]"
    )

    synonyms: ClassVar[Mapping[str, str]] = {"position": "xyz"}

    def pose(self) -> model.Pose:
        """The pose that the table describes."""
        return model.Pose(self.xyz or _ORIGIN, self.rpy_deg or model.Pose.rpy_deg)


# The keys that place a rotor around an axis instead of `position`, and those that direct its thrust
# instead of `direction`.
POLAR_KEYS = ("radius", "azimuth_deg", "height")
LEAN_KEYS = ("tilt_deg", "cant_deg")


@file_table
class RotorTable(Table):
    """A rotor on the base or on a link."""

    conditions: ClassVar[JsonDict] = {
        "dependentRequired": {
            key: ["azimuth_deg"] for key in (*POLAR_KEYS, *LEAN_KEYS) if key != "azimuth_deg"
        },
        "dependentSchemas": {
            "position": {"properties": dict.fromkeys(POLAR_KEYS, False)},
            "direction": {"properties": dict.fromkeys(LEAN_KEYS, False)},
        },
    }

    name: Label | None = optional("name of the rotor, any text; without it its number counts")
    on: Label = optional(_ON, "base")
    position: Sizes3 = optional("place in the frame of what carries it, m", _ORIGIN)
    radius: NotNegative = optional("instead of position: distance from the z axis there, m", 0.0)
    azimuth_deg: Angle | None = optional(
        "instead of position: angle about the z axis there, from x towards y, degrees"
    )
    height: Size = optional("instead of position: distance along the z axis there, m", 0.0)
    direction: Annotated[Direction, Field(json_schema_extra={"default": "z"})] = optional(
        'direction of its thrust in that frame: an axis such as "x" or "-y", or [x, y, z]',
        model.AXES["z"],
    )
    tilt_deg: Angle = optional(
        "instead of direction: how far the thrust leans from z outwards, along the azimuth, "
        "degrees",
        _NO_ANGLE,
    )
    cant_deg: Angle = optional(
        "instead of direction: how far the thrust leans sideways, turned about the outward "
        "radius by the right-hand rule, which is clockwise seen from above, degrees",
        _NO_ANGLE,
    )
    drag: Size = optional(
        "reaction torque about its direction per unit of thrust, m: negative for a "
        "rotor that spins counter-clockwise, seen from the tip of its thrust",
        0.0,
    )
    limits: Range | None = optional(
        "least and greatest thrust, for simulators and controllers, N; default: none"
    )
    time_constant: NotNegative | None = optional(
        "time constant of its thrust, for simulators, s; default: none"
    )
    spin_inertia: NotNegative | None = optional(
        "moment of inertia of what spins with it, about its axis, for gyroscopic "
        "torques in simulators, kg m^2; default: none"
    )
    speed_per_sqrt_thrust: NotNegative | None = optional(
        "its speed by the square root of its thrust, for simulators, (rad/s)/sqrt(N); default: none"
    )
    command: model.Command = optional(
        "what the rotor is commanded: a thrust, N, a speed, rad/s, or a throttle, 0 to 1", "thrust"
    )
    thrust_curve: Sizes3 | None = optional(
        "thrust by speed or throttle: [k0, k1, k2] of k0 + k1 x + k2 x², N"
    )
    thrust_constant: Positive | None = optional(
        "thrust by the square of the speed, N/(rad/s)²; instead of a thrust_curve"
    )
    max_thrust: Positive | None = optional(
        "thrust at a throttle of 1, N; instead of a thrust_curve"
    )
    thrust_model_factor: Annotated[Real, Bounds(0.0, 1.0)] | None = optional(
        "share of max_thrust that grows with the square of the throttle, the rest linearly, as "
        "PX4's THR_MDL_FAC; default: 1"
    )
    command_limits: Range | None = optional(
        "least and greatest speed or throttle; default: none for speeds, [0, 1] for throttles"
    )
    full_speed: Positive | None = optional("speed at a throttle of 1, rad/s; default: unknown")
    time_constants: Annotated[tuple[Positive, Positive], listed(2)] | None = optional(
        "time constants with which it speeds up and slows down, s; instead of time_constant"
    )
    hub_drag: NotNegative = optional(
        "drag against the motion of its hub across its direction, by speed and air speed, kg", 0.0
    )
    inflow: NotNegative = optional(
        "loss of thrust with the air speed along its direction, by speed and air speed, kg", 0.0
    )
    translational_lift: NotNegative = optional(
        "gain of thrust by the square of the air speed across its direction, kg/m", 0.0
    )
    disc_radius: Positive | None = optional("radius of the rotor disc, m; default: unknown")
    ground_effect: Flag = optional(
        "whether thrust grows near the ground, as by Cheeseman and Bennett; needs disc_radius",
        False,
    )
    thrust_by_advance: list[Annotated[tuple[Real, Real], listed(2)]] | None = optional(
        "pairs of an advance ratio (air speed along its direction by that of the blades' tips), "
        "rising, and the factor of the thrust there, linear between; default: none"
    )

    synonyms: ClassVar[Mapping[str, str]] = {
        "xyz": "position",
        "motorConstant": "thrust_constant",
        "maxRotVelocity": "full_speed",
        "rotorDragCoefficient": "hub_drag",
    }

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of two forms of a placement, and of a rotor of which too little is known."""
        for whole, parts in (("position", POLAR_KEYS), ("direction", LEAN_KEYS)):
            given = [each for each in parts if each in values]
            if given and whole in values:
                yield given[0], f"excludes {whole}: give {whole}, or {', '.join(parts)}"
            elif given and "azimuth_deg" not in values:
                yield given[0], "needs azimuth_deg beside it, the angle of the radius about z"
        yield from _drive_faults(values)
        if "spin_inertia" in values and not _speed_known(values):
            yield "spin_inertia", "needs speed_per_sqrt_thrust beside it: give both or none"
        uses = ("spin_inertia", *_BY_SPEED)
        if "speed_per_sqrt_thrust" in values and not any(key in values for key in uses):
            yield "speed_per_sqrt_thrust", "needs spin_inertia beside it: give both or none"
        if "spin_inertia" in values and values.get("drag", 0.0) == 0.0:
            yield "spin_inertia", "needs a drag that is not 0: its sign tells which way it spins"
        for each in _BY_SPEED:
            if each in values and not _speed_known(values):
                yield each, "needs the rotor's speed: give full_speed, or speed_per_sqrt_thrust"
        for each in ("ground_effect", "thrust_by_advance"):
            if values.get(each) and "disc_radius" not in values:
                yield each, "needs disc_radius beside it, in m"

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """Faults of ratios that do not rise, and of thrusts that do not rise with the command."""
        ratios = [ratio for ratio, _ in self.thrust_by_advance or ()]
        if ratios and (len(ratios) < 2 or ratios != sorted({*ratios})):
            yield ("thrust_by_advance",), "must have two pairs or more, with rising ratios"
        drive, given = self._drive(), "command_limits" if self.command_limits else "thrust_curve"
        if drive is None or drive.command == "thrust":
            return
        (_, slope, square), (begin, end), what = drive.curve, drive.rising, drive.command
        most = drive.limits[1] if drive.limits else math.inf
        if (square < 0.0 and slope <= 0.0) or begin == end:
            yield ("thrust_curve",), f"must rise with the {what}: give a k1 or a k2 above 0"
        elif most <= begin:
            yield (
                ("thrust_curve" if self.thrust_curve else given,),
                f"must let the thrust rise below the greatest {what}, {most:g}, but it rises from "
                f"{begin:g} on",
            )
        elif most > end:
            yield (
                (given,),
                f"must not let the thrust fall, as it does beyond a {what} of {end:g}: give "
                "command_limits that end there or before",
            )

    def rotor(self, on: int) -> model.Rotor:
        """The rotor that the table describes, on the body of that number."""
        given = vars(self)
        own = {name: given[name] for name in vars(model.Rotor()) if name in given}
        if self.azimuth_deg is not None:
            own["position"] = polar_point(self.radius, self.azimuth_deg, self.height)
            if self.tilt_deg or self.cant_deg:
                lean = self.azimuth_deg, self.tilt_deg, self.cant_deg
                own["direction"] = leaning_direction(*lean)
        drive, air = self._drive(), self._air()
        if drive is not None and self.spin_inertia and not self.speed_per_sqrt_thrust:
            own["speed_per_sqrt_thrust"] = drive.speed_per_sqrt_thrust
        return model.Rotor(**own | {"on": on, "drive": drive, "air": air})

    def _drive(self) -> model.Drive | None:
        """What it makes of its command, None where that is its thrust with one lag or none."""
        if self.command == "thrust" and self.time_constants is None:
            return None
        lag = self.time_constant or 0.0
        up, down = self.time_constants or (lag, lag)
        if self.command == "thrust":
            return model.Drive(limits=self.limits, up=up, down=down)
        square = self.thrust_constant or 0.0
        if self.command == "throttle" and self.full_speed is not None:
            square *= self.full_speed**2
        share = 1.0 if self.thrust_model_factor is None else self.thrust_model_factor
        most = self.max_thrust or 0.0
        curve = self.thrust_curve or (0.0, (1.0 - share) * most, square or share * most)
        limits = self.command_limits or ((0.0, 1.0) if self.command == "throttle" else None)
        return model.Drive(self.command, curve, limits, up, down, self.full_speed)

    def _air(self) -> model.RotorAir | None:
        """What the air does to it beside its thrust, None if nothing."""
        found = model.RotorAir(
            self.hub_drag,
            self.inflow,
            self.translational_lift,
            self.disc_radius or 0.0,
            self.ground_effect,
            tuple(self.thrust_by_advance or ()),
        )
        return None if found == model.RotorAir(radius=found.radius) else found


# Keys of rotors that are commanded throttles, and those that need the speed of the rotor.
_OF_THROTTLES = ("max_thrust", "full_speed")
_BY_SPEED = ("hub_drag", "inflow", "thrust_by_advance")


def _speed_known(values: Mapping[str, Any]) -> bool:
    """Whether the keys of a rotor tell its speed, or may do so if its command is misspelt."""
    known = {"thrust": False, "throttle": "full_speed" in values}
    return known.get(values.get("command", "thrust"), True) or "speed_per_sqrt_thrust" in values


def _drive_faults(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Faults of what a rotor makes of its command, one that is known."""
    command = values.get("command", "thrust")
    if command not in model.COMMANDS:
        return
    curves = [key for key in ("thrust_curve", "thrust_constant", "max_thrust") if key in values]
    others = ("thrust_model_factor", "command_limits", "full_speed")
    if command == "thrust" and (driven := [*curves, *(key for key in others if key in values)]):
        right = '"speed"' if "thrust_constant" in curves else '"speed" or "throttle"'
        if {*_OF_THROTTLES, "thrust_model_factor"} & {*driven}:
            right = '"throttle"'
        words = "must be" if "command" in values else "missing: give"
        yield "command", f"{words} {right}; thrusts are commanded without {', '.join(driven)}"
    elif command != "thrust" and "limits" in values:
        yield "limits", f"are limits of a thrust: give command_limits, those of the {command}"
    if command != "thrust" and len(curves) != 1:
        known = "thrust_curve or thrust_constant"
        if command == "throttle":
            known = "max_thrust, thrust_curve, or thrust_constant with full_speed"
        if curves:
            yield curves[-1], f"must not stand beside {curves[0]}: give {known}"
        else:
            yield "command", f"needs the thrust of the {command} beside it: give {known}"
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
            "must not stand beside time_constant: give time_constants where the rotor slows down "
            "otherwise than it speeds up, or else time_constant",
        )


@file_table
class FrameTable(PoseTable):
    """A named frame, such as an end effector or a sensor."""

    name: Annotated[Label, key("name of the frame, any text")]
    on: Label = optional(_ON, "base")

    def frame(self, on: int) -> model.Frame:
        """The frame that the table describes, on the body of that number."""
        return model.Frame(self.name, on, self.pose())


# What keys each type of constraint has besides those that all have.
_OF_TYPE: dict[model.ConstraintKind, tuple[str, ...]] = {
    "point": (),
    "frame": ("rpy_deg",),
    "distance": ("distance",),
    "loop": ("rpy_deg", "joint", "axis"),
    "plane": ("normal",),
}


@file_table
class ConstraintTable(Table):
    """What holds a frame against another frame of the robot, or against the world."""

    name: Annotated[Label, key("name of the constraint, any text")]
    type: Annotated[
        model.ConstraintKind,
        key(
            "what is held at the anchor: the origin of the frame (point), its axes too (frame), "
            "its distance from there, a joint between two frames of the robot (loop), or the plane "
            "through it"
        ),
    ]
    frame: Annotated[Label, key('the frame that is held: "base", "tip" or a name of a [[frame]]')]
    to: Label | None = optional(
        "the frame that carries the anchor; default: the world. A loop needs it"
    )
    xyz: Sizes3 = optional("place of the anchor in the frame that carries it, m", _ORIGIN)
    rpy_deg: Angles = optional(
        "roll, pitch and yaw of the anchor in that frame, R = R_z·R_y·R_x, of a frame or a loop, "
        "degrees",
        model.Pose.rpy_deg,
    )
    distance: Positive | None = optional("of a distance: that from the anchor, m")
    normal: Annotated[Direction, Field(json_schema_extra={"default": "z"})] = optional(
        'of a plane: its normal in the frame that carries it: an axis such as "x" or "-y", or '
        "[x, y, z]",
        model.AXES["z"],
    )
    joint: model.LoopJoint = optional("of a loop: what the frames still do at the anchor", "fixed")
    axis: Annotated[Direction, Field(json_schema_extra={"default": "z"})] = optional(
        "of a loop that is revolute: its axis, in the anchor's frame and in the one that is held",
        model.AXES["z"],
    )
    frequency: NotNegative = optional(
        "frequency with which errors go back to zero (Baumgarte), rad/s; 0: not at all", 0.0
    )
    damping_ratio: NotNegative = optional("damping ratio with which they do", 1.0)

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of keys that do not go with the type."""
        kind = values.get("type")
        if kind not in _OF_TYPE:
            return
        for each in dict.fromkeys(chain.from_iterable(_OF_TYPE.values())):
            if each in values and each not in _OF_TYPE[kind]:
                owners = [f'"{other}"' for other, keys in _OF_TYPE.items() if each in keys]
                yield each, f"belongs to a constraint of type {' or '.join(owners)}"
        if kind == "distance" and "distance" not in values:
            yield "distance", "missing: the distance from the anchor, m"
        if kind == "loop" and "to" not in values:
            yield "to", "missing: a loop is between two frames of the robot"
        if kind == "loop" and "axis" in values and values.get("joint") != "revolute":
            yield "axis", 'belongs to a loop that turns: give joint = "revolute"'
        if "damping_ratio" in values and values.get("frequency", 0.0) == 0.0:
            yield "damping_ratio", "needs frequency beside it, rad/s"

    def constraint(self) -> model.Constraint:
        """The constraint that the table describes."""
        return model.Constraint(
            self.name,
            self.type,
            self.frame,
            self.to,
            model.Pose(self.xyz, self.rpy_deg),
            self.distance or 0.0,
            self.normal,
            self.joint,
            self.axis,
            self.frequency,
            self.damping_ratio,
        )


DH_KEYS = ("alpha_deg", "a", "d", "theta_deg")
POSE_KEYS = ("xyz", "rpy_deg")
PASSIVE_KEYS = ("damping", "armature", "stiffness", "rest")
LIMIT_KEYS = ("limits", "limits_deg", "effort", "velocity")
DRIVE_KEYS = ("servo", "friction")


# Keys of servos that are commanded positions.
_OF_POSITIONS = ("stiffness", "backlash")


@file_table
class ServoTable(Table):
    """What holds a joint where it is commanded to be: its input is a position, or a rate."""

    conditions: ClassVar[JsonDict] = {
        "if": {"properties": {"command": {"const": "rate"}}, "required": ["command"]},
        "then": {"required": ["damping"], "properties": dict.fromkeys(_OF_POSITIONS, False)},
        "else": {"required": ["stiffness"]},
    }

    command: model.ServoCommand = optional("what it is commanded, a position or a rate", "position")
    stiffness: Positive | None = optional("torque or force by distance, N m/rad or N/m")
    damping: NotNegative = optional(
        "torque or force against its rate, N m s/rad or N s/m; by the difference from the rate "
        "that is commanded, if it is that",
        0.0,
    )
    torque: Positive | None = optional(
        "greatest torque or force, N m or N; default: the joint's effort"
    )
    rate: Positive | None = optional(
        "greatest rate of its reference, or that is commanded, rad/s or m/s; default: none, or the "
        "velocity of the joint"
    )
    delay: NotNegative = optional(
        "time constant with which its reference follows the command, s", 0.0
    )
    backlash: NotNegative = optional("play within which it does not push, rad or m", 0.0)

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of a rate that nothing delays, and of what only one kind of servo has."""
        if values.get("command") == "rate":
            for each in _OF_POSITIONS:
                if each in values:
                    yield each, "must be left out where rates are commanded, which it does not hold"
            if values.get("damping", 0.0) == 0.0:
                yield "damping", "must be given, above 0: by it the servo pushes towards a rate"
            return
        if "stiffness" not in values:
            yield "stiffness", cls._missing("stiffness")
        if "rate" in values and values.get("delay", 0.0) == 0.0:
            yield "rate", "needs delay beside it, s: the time in which the reference comes to rest"


@file_table
class FrictionTable(Table):
    """Dry friction of a joint, smooth about rest."""

    coulomb: Annotated[NotNegative, key("friction at speed, N m or N")]
    static: NotNegative | None = optional("friction about rest, N m or N; default: coulomb")
    velocity: Positive = optional(
        "rate at which it has come down half the way from static to coulomb, rad/s or m/s; a tenth "
        "of it is where it is smooth about rest",
        model.Friction.velocity,
    )

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """The fault of a joint that would be harder to move than to set in motion."""
        if self.static is not None and self.static < self.coulomb:
            yield (
                ("static",),
                f"must be at least coulomb, {self.coulomb:g}, since friction is greatest about "
                "rest; leave it out where both are the same",
            )


def _not_continuous(kind: object) -> object:
    if kind == "continuous":
        raise fault('must be "revolute", without limits, for what URDF calls "continuous"')
    return kind


@file_table
class JointTable(PoseTable):
    """A joint: what it does, and its place, by modified Denavit–Hartenberg parameters or a pose."""

    name: Label | None = optional("name of the link, any text; without it link 2 is called link2")
    parent: Label | None = optional(
        'what carries the link: "base" or the name of a link given earlier; default: '
        "the link before, the base for the first"
    )
    alpha_deg: Angle = optional("twist about x of the parent's frame, degrees", _NO_ANGLE)
    a: Size | None = optional(
        "distance along x of the parent's frame, m; default: the length of the "
        "parent, 0 where it is the base"
    )
    d: Size = optional("offset along the joint's axis z, m", 0.0)
    theta_deg: Angle = optional("offset of the joint angle, degrees", _NO_ANGLE)
    axis: Annotated[Direction, Field(json_schema_extra={"default": "z"})] = optional(
        "axis of a joint that xyz or rpy_deg places, in the link's frame: an axis such "
        'as "x" or "-y", or a direction [x, y, z]',
        model.AXES["z"],
    )
    joint: Annotated[model.LinkKind, BeforeValidator(_not_continuous)] = optional(
        "what the joint does: it turns about its axis, slides along it, or is fixed", "revolute"
    )
    constrained: Flag = optional(
        "whether a fixed link is held by a constraint torque about its axis, which the "
        "hybrid system has, instead of welded",
        False,
    )
    coordinate: Label | None = optional(
        "name of the joint's coordinate, any text; default: the link's name, or "
        "theta_… or d_… with the joint's number"
    )
    damping: NotNegative = optional(
        "torque or force against the joint's rate, N m s/rad or N s/m", 0.0
    )
    armature: NotNegative = optional(
        "inertia of what turns with the joint alone, such as a geared motor, kg m² or kg", 0.0
    )
    stiffness: NotNegative = optional("of a spring, N m/rad or N/m", 0.0)
    rest: Size = optional("coordinate at which the spring rests, rad or m", 0.0)
    limits: OpenRange | None = optional(
        "least and greatest coordinate, rad or m; inf where there is none. Limits are "
        "for simulators and controllers"
    )
    limits_deg: OpenRange | None = optional("limits of a joint that turns, degrees")
    effort: NotNegative | None = optional(
        "greatest torque or force of the joint, N m or N; default: none"
    )
    velocity: NotNegative | None = optional(
        "greatest rate of the joint, rad/s or m/s; default: none"
    )
    servo: ServoTable | None = optional(
        "a servo that drives the joint; default: none, and it is commanded torques or forces"
    )
    friction: FrictionTable | None = optional("dry friction of the joint; default: none")


@file_table
class LinkTable(BodyTable, JointTable):
    """A link, with the joint that carries it."""

    conditions: ClassVar[JsonDict] = {
        "dependentRequired": RIGID_NEEDS_MASS,
        "dependentSchemas": {
            **NOT_BOTH_BODIES,
            **{key: {"properties": dict.fromkeys(DH_KEYS, False)} for key in POSE_KEYS},
            "axis": {"anyOf": [{"required": [key]} for key in POSE_KEYS]},
            "limits": {"properties": {"limits_deg": False}},
            "limits_deg": {"properties": {"joint": {"const": "revolute"}}},
        },
    }

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of keys that do not go with each other."""
        yield from super()._key_faults(values)
        pose = [key for key in POSE_KEYS if key in values]
        dh = [key for key in DH_KEYS if key in values]
        if pose and dh:
            yield (
                dh[0],
                f"belongs to Denavit–Hartenberg parameters, but {pose[0]} gives a pose: give "
                "alpha_deg, a, d and theta_deg, or xyz, rpy_deg and axis",
            )
        if "axis" in values and not pose:
            yield (
                "axis",
                "needs a pose, since by Denavit–Hartenberg parameters the axis is z: give xyz or "
                "rpy_deg",
            )
        kind, constrained = values.get("joint", "revolute"), values.get("constrained") is True
        if kind == "fixed":
            for key in (*PASSIVE_KEYS, *LIMIT_KEYS, *DRIVE_KEYS):
                if key in values:
                    yield key, "must be left out, since a fixed joint does not move"
            if "coordinate" in values and not constrained:
                yield "coordinate", "must be left out, since a welded joint has no coordinate"
        elif constrained:
            yield "constrained", 'needs a joint that does not move: give joint = "fixed"'
        if kind != "fixed" and "limits_deg" in values:
            if "limits" in values:
                yield "limits_deg", "must be left out, or limits: give one of the two"
            elif kind == "prismatic":
                yield "limits_deg", "belongs to a joint that turns: give limits, in m"

    def link(self, parent: int | None) -> model.Link:
        """The link that the table describes; `parent` numbers its carrier, None the link before."""
        low, high = self.limits or map(math.radians, self.limits_deg or (-math.inf, math.inf))
        return model.Link(
            self.body(),
            self.alpha_deg,
            self.a,
            self.d,
            self.theta_deg,
            self.joint,
            parent,
            self.pose() if self.xyz or self.rpy_deg else None,
            self.axis,
            self.constrained,
            self.name,
            self.coordinate,
            model.Passive(self.damping, self.armature, self.stiffness, self.rest),
            model.JointLimits(
                low if math.isfinite(low) else None,
                high if math.isfinite(high) else None,
                self.effort,
                self.velocity,
            ),
            self._servo(),
            self._friction(),
        )

    def _servo(self) -> model.Servo | None:
        if self.servo is None:
            return None
        given = vars(self.servo) | {"stiffness": self.servo.stiffness or 0.0}
        found = model.Servo(**given)
        return found if found.torque is not None else replace(found, torque=self.effort)

    def _friction(self) -> model.Friction | None:
        own = self.friction
        if own is None:
            return None
        static = own.coulomb if own.static is None else own.static
        return model.Friction(own.coulomb, static, own.velocity)


@file_table
class BatteryTable(Table):
    """The battery that all rotors share; a throttle then gives what its voltage allows."""

    voltage: Annotated[
        list[Positive], key("voltages without load at equal steps of charge, from empty to full, V")
    ]
    resistance: Annotated[NotNegative, key("internal resistance, with wires, ohm")]
    capacity: Annotated[Positive, key("charge from full to empty, A h")]
    nominal: Positive | None = optional(
        "voltage at which thrusts of throttles are given, V; default: that without load when full"
    )
    efficiency: Annotated[Positive, Bounds(0.0, 1.0)] = optional(
        "share of the electric power of motors and their controllers that rotors get", 0.75
    )
    auxiliary: NotNegative = optional("power of all else, W", 0.0)

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of a single voltage."""
        given = values.get("voltage")
        if isinstance(given, list) and not 2 <= len(given) <= model.MAX_VOLTAGES:
            yield "voltage", f"must be 2 to {model.MAX_VOLTAGES} voltages, from empty to full"

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """The fault of voltages that fall with the charge."""
        for low, high in pairwise(self.voltage):
            if high < low:
                yield (
                    ("voltage",),
                    f"must rise with the charge, from empty to full, but {high:g} V follow "
                    f"{low:g} V",
                )
                return

    def built(self) -> model.Battery:
        """The battery that the table describes."""
        return model.Battery(
            tuple(self.voltage),
            self.nominal or self.voltage[-1],
            self.resistance,
            self.capacity,
            self.efficiency,
            self.auxiliary,
        )


@file_table
class RobotTable(Table):
    """An aerial robot: a base, rotors, links that branch from the base as a tree, and frames.

    SI units: kg, m, s. Angles are in degrees, in keys that end in `_deg`.
    """

    title: ClassVar[str] = "Robot file of gibbs_codegen"

    name: Annotated[
        Name, key("the robot's name, which becomes that of the module and the prefix in C")
    ]
    gravity: NotNegative = optional("acceleration of gravity, m/s²", 9.81)
    allow_impossible_inertia: Flag = optional(
        "whether inertias pass that no body has, as some published models have them; "
        "a warning names the body",
        False,
    )
    base: Annotated[BaseTable, key("the flying base, [base]")]
    battery: BatteryTable | None = optional("the battery, [battery]; default: none")
    rotor: Annotated[
        list[RotorTable],
        Tables("rotor", model.MAX_ROTORS, "rotors"),
        key("rotors on the base or on links, instead of base.rotors"),
    ] = field(default_factory=list)
    link: Annotated[
        list[LinkTable],
        Tables("link", model.MAX_LINKS, "links"),
        key("the links, each after the one that carries it"),
    ] = field(default_factory=list)
    frame: Annotated[
        list[FrameTable],
        Tables("frame", model.MAX_FRAMES, "frames"),
        key("named frames on the base or on links"),
    ] = field(default_factory=list)
    constraint: Annotated[
        list[ConstraintTable],
        Tables("constraint", model.MAX_CONSTRAINTS, "constraints"),
        key("what may hold frames, while it is active"),
    ] = field(default_factory=list)

    mistaken: ClassVar[tuple[str, frozenset[str]]] = (
        "a scenario",
        frozenset({"duration", "control", "motors", "integration"}),
    )

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
        """Faults of names and references, and of two forms of rotors at once."""
        base = values.get("base")
        rods = [key for key in ROD_KEYS if isinstance(base, dict) and key in base]
        if rods and values.get("rotor"):
            yield (
                ("rotor",),
                f"belongs to a base without arms, but base.{rods[0]} gives them motors: give "
                "[[rotor]] tables, or base.rotors and base.arm",
            )
        if values.get("battery") is not None:
            for i, rotor in enumerate(values.get("rotor") or []):
                if isinstance(rotor, dict) and rotor.get("command") == "throttle":
                    for name in ("full_speed", "time_constant"):
                        if name not in rotor and f"{name}s" not in rotor:
                            words = f"missing: a throttle needs its {name} where there is a battery"
                            yield ("rotor", i, name), words
        yield from reference_faults(values)

    @model_validator(mode="after")
    def _has_mass(self) -> Self:
        if self.robot().total_mass <= 0:
            place = ("base", "arm") if self.base.arm else ("base",)
            raise refusal([(place, "the robot has no mass; give its base or links some")])
        return self

    @model_validator(mode="after")
    def _constraints_hold_frames(self) -> Self:
        if self.constraint:
            references = [(each.frame, each.to) for each in self.constraint]
            robot = self.robot()
            bodies = {frame.name: robot.rigid[frame.on] for frame in frames_of(robot)}
            if faults := list(constraint_faults(references, bodies)):
                raise refusal(faults)
        return self

    def robot(self) -> model.Robot:
        """The robot that the file describes, as far as its names can be resolved."""
        numbers = body_numbers([link.name for link in self.link])
        parents = [numbers.get(link.parent or "", before) for before, link in enumerate(self.link)]
        return model.Robot(
            self.name,
            self.base.built(),
            tuple(
                link.link(None if parent == before else parent)
                for before, (link, parent) in enumerate(zip(self.link, parents, strict=True))
            ),
            self.gravity,
            tuple(rotor.rotor(numbers.get(rotor.on, model.BASE)) for rotor in self.rotor),
            tuple(frame.frame(numbers.get(frame.on, model.BASE)) for frame in self.frame),
            self.allow_impossible_inertia,
            self.battery.built() if self.battery else None,
            tuple(each.constraint() for each in self.constraint),
        )
