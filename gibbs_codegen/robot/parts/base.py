"""The flying base, its rods and motors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import BeforeValidator, ValidationInfo, field_validator

from gibbs_codegen.files.table import (
    Bounds,
    InSchema,
    Whole,
    at_most,
    fault,
    kind_of,
    list_of,
    not_one_of,
    reader,
    shown,
    to_python,
)
from gibbs_codegen.robot.parts.body import RIGID_NEEDS_MASS, Body, BodyKeys, RigidBody, RigidKeys
from gibbs_codegen.robot.parts.numbers import (
    AXES,
    Angle,
    Angles,
    Direction,
    NotNegative,
    Size,
    Sizes3,
    Vector3,
)
from gibbs_codegen.robot.parts.part import Part, entry, number, taken
from gibbs_codegen.robot.parts.pose import HERE, Pose, Posed
from gibbs_codegen.robot.parts.rotor import MAX_ROTORS

Origin = Literal["motor1", "centre", "base"]
Attitude = Literal["xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "quaternion"]
ATTITUDES: tuple[Attitude, ...] = get_args(Attitude)
# Those of a base that has rods.
ROD_ORIGINS: tuple[Origin, ...] = ("motor1", "centre")
# The keys of rods and of the motors at their ends.
ROD_KEYS = ("rotors", "arm", "thrust", "drag", "azimuth_deg")
FREE, FIXED = "free", "fixed"
# Motions of a base that stays level, with what of it moves, along and about its own axes.
PLANAR = "planar"
LEVEL_MOTIONS = {FIXED: (), PLANAR: ("x", "y", "yaw"), "upright": ("x", "y", "z", "yaw")}
# What of a planar base has velocities that does not slip sideways, by its drive.
DRIVES = {"differential": ("x", "yaw")}
LEVEL_KINDS = LEVEL_MOTIONS | dict.fromkeys(DRIVES, LEVEL_MOTIONS[PLANAR])
# Axes of the world along which a base with a list moves, and about which.
TRAVELS = dict(zip(("x", "y", "z"), range(3), strict=True))
TURNS = dict(zip(("roll", "pitch", "yaw"), range(3), strict=True))


def _motion(value: object) -> object:
    """A motion by name, or the names of what moves, translations first."""
    names = (FREE, *LEVEL_MOTIONS)
    if isinstance(value, str):
        if value not in names:
            hint = 'or a list of motions, such as ["x", "pitch"]'
            raise fault(f"{not_one_of(value, names)}; {hint}")
        return value
    parts = to_python(value)
    if not isinstance(parts, list):
        choices = ", ".join(map(repr, names))
        raise fault(f"must be one of {choices} or a list of motions, not {kind_of(value)}")
    for i, part in enumerate(parts):
        if part not in (*TRAVELS, *TURNS):
            raise fault(not_one_of(part, (*TRAVELS, *TURNS)))
        if part in parts[:i]:
            raise fault(f"{shown(part)} is there twice")
        if part in TRAVELS and any(before in TURNS for before in parts[:i]):
            raise fault(
                f"{shown(part)} comes after a rotation, which would turn its axis; put it "
                'before, or use motion = "fixed" and links that move'
            )
    if not parts:
        raise fault('empty list; give "fixed" if the base does not move')
    return tuple(parts)


def as_motion(text: str) -> Any:
    """The motion that a text such as "planar" or "x,z,pitch" says; None if it says none."""
    parts = tuple(text.split(","))
    if text in (FREE, *LEVEL_MOTIONS):
        return text
    return parts if {*parts} <= {*TRAVELS, *TURNS} else None


def shown_motion(motion: Any) -> str:
    """The text that says a motion."""
    return motion if isinstance(motion, str) else ",".join(motion)


def _drive(value: object) -> object:
    if value not in tuple(DRIVES):
        words = "wheels cannot steer, and wheels that slide along their axes need no drive"
        raise fault(f"{not_one_of(value, DRIVES)}: {words}")
    return value


Motion = Annotated[
    Any,
    BeforeValidator(_motion),
    InSchema(
        {
            "anyOf": [
                {"enum": [FREE, *LEVEL_MOTIONS]},
                {
                    "type": "array",
                    "items": {"enum": [*TRAVELS, *TURNS]},
                    "minItems": 1,
                    "uniqueItems": True,
                },
            ]
        }
    ),
]


@dataclass(frozen=True, kw_only=True)
class BaseKeys(Part):
    """Keys of a base and its table: its rods, with a motor at the end of each."""

    rotors: Annotated[Whole, Bounds(2, MAX_ROTORS)] = entry(
        "the number of rotors and arms, N", unsaid=0
    )
    attitude: Attitude = entry("intrinsic sequence of the attitude angles, or quaternion", "xyz")
    motion: Motion = entry(
        'motion of the base: "free"; "fixed"; "planar": x, y and yaw; "upright": these and z; '
        "or a list of x, y, z, roll, pitch and yaw, along and about axes of the world in that "
        "order",
        FREE,
    )
    drive: Annotated[Literal["differential"] | None, BeforeValidator(_drive)] = entry(
        'drive of a planar base: "differential" forbids side slip, and the velocities are '
        "ahead, along the x axis, and about z; default: it moves in all directions"
    )
    origin: Origin = entry(
        "the point whose position is x, y, z: motor1 or centre where the base has arms, base "
        "where it has none; default: motor1 with arms, base without",
        unsaid="motor1",
    )
    thrust: tuple[Direction, ...] = entry(
        "direction of the thrust of each motor in its arm's frame: an axis, or [x, y, z]; "
        "default: z for odd motors, y for even ones",
        (),
    )
    drag: tuple[Size, ...] = number(
        "reaction torque of each motor about its thrust's direction per unit of thrust, {m}; "
        "default 0",
        (),
    )
    azimuth_deg: tuple[Angle, ...] | None = entry(
        "angle of each arm about the base's normal z, from the base's x axis, degrees; default: "
        "equal angles, with arm 1 seen from its motor"
    )


@dataclass(frozen=True, kw_only=True)
class Base(BaseKeys):
    """The flying base: a central body, N rods with a motor at the end of each, or both, rigid.

    `rotors` is the number of rods. `arms` has one entry when all rods share one table, else N.
    `azimuth_deg` None is the paper's rule, in which rod 1 is seen from its motor. `motion` is a
    name, or a tuple of what moves. `pose` is that of the base where nothing has moved yet.
    """

    pose: Pose = HERE
    arms: tuple[Body, ...] = ()
    body: RigidBody | None = None

    @property
    def moves_freely(self) -> bool:
        """True if position and attitude are whatever they are."""
        return bool(self.motion == FREE)

    @property
    def virtual_joints(self) -> tuple[str, ...]:
        """What moves as joints of links without length and mass, from the world outwards."""
        return self.motion if isinstance(self.motion, tuple) else ()

    @property
    def moved(self) -> tuple[str, ...]:
        """What moves of a base that does not move freely."""
        return LEVEL_MOTIONS.get(self.motion, self.virtual_joints)

    @property
    def kind(self) -> str:
        """What a module says of the base's coordinates: the attitude's kind, or what moves."""
        if self.moves_freely:
            return self.attitude
        return self.drive or " ".join(self.virtual_joints) or str(self.motion)

    @property
    def shares_one_arm(self) -> bool:
        """True if one table serves all arms."""
        return len(self.arms) == 1

    def arm(self, k: int) -> Body:
        """Body of base arm k, from 1 to N, in the arm's frame."""
        return self.arms[0] if self.shares_one_arm else self.arms[k - 1]

    def arm_angle_deg(self, k: int) -> Fraction:
        """Angle θ_k of arm k against the base, in degrees.

        It is −180° + 360°(k−1)/N by default; k is from 1 or, by the paper's rule, from 2 to N.
        """
        if self.azimuth_deg is not None:
            return self.azimuth_deg[k - 1]
        return Fraction(-180) + Fraction(360 * (k - 1), self.rotors)


def alternating_thrust(rotors: int) -> tuple[Vector3, ...]:
    """Default directions: odd motors push along z, even motors along y of their arm's frame."""
    return tuple(AXES["y" if k % 2 else "z"] for k in range(rotors))


@dataclass(frozen=True, kw_only=True)
class ArmTable(BodyKeys):
    """An arm of the base, with a motor at its end."""

    # The first key, without a default, which a body has.
    length: NotNegative = number(
        "the distance from the base centre to the motor, in {m}", ..., kw_only=False
    )


@dataclass(frozen=True, kw_only=True)
class BaseTable(Posed, BaseKeys, RigidKeys):
    """The flying base, rigid: a central body, rods with a motor at the end of each, or both."""

    conditions: ClassVar[dict[str, Any]] = {
        "dependentRequired": {
            **RIGID_NEEDS_MASS,
            **{key: [other for other in ROD_KEYS[:2] if other != key] for key in ROD_KEYS},
        }
    }

    xyz: Sizes3 | None = entry(
        "place of a base that does not move freely, at coordinates zero, m; default [0, 0, 0]"
    )
    rpy_deg: Angles | None = entry(
        "roll, pitch and yaw of the base there, R = R_z·R_y·R_x as in URDF, degrees; default "
        "[0, 0, 0]"
    )
    arm: ArmTable | list[ArmTable] | None = entry(
        "one table for all arms, or a list of one for each"
    )

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of arms that are not whole, or not as many as there are rotors."""
        yield from super()._key_faults(values)
        if any(key in values for key in ROD_KEYS):
            for key in ROD_KEYS[:2]:
                if key not in values:
                    yield key, cls._missing(key)
        elif values.get("origin") in ROD_ORIGINS:
            yield "origin", 'must be "base" where the base has no arms (base.rotors and base.arm)'
        yield from cls._motion_faults(values)
        arms, rotors = values.get("arm"), values.get("rotors")
        if not isinstance(arms, list) or not isinstance(rotors, int):
            return
        if 1 < rotors <= MAX_ROTORS and rotors != len(arms) <= MAX_ROTORS:
            arms_listed = f"a list of {len(arms)} for {rotors} rotors"
            yield "arm", f"{arms_listed}; give one table for all, or one for each"

    @classmethod
    def _motion_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of keys that do not fit how the base moves."""
        if values.get("drive") is not None and values.get("motion", FREE) != PLANAR:
            yield "drive", f'needs a base that rolls; give motion = "{PLANAR}" too'
        if values.get("motion", FREE) == FREE:
            for key in ("xyz", "rpy_deg"):
                if key in values:
                    yield (
                        key,
                        "applies to a base that does not move freely; give its motion too, or "
                        "leave it out, because coordinates define where a free base is",
                    )
            return
        for key in ("attitude", *ROD_KEYS):
            if key in values:
                why = "its motion defines how it turns"
                if key != "attitude":
                    why = "give it [[rotor]] tables"
                yield key, f"applies to a base that moves freely; leave it out: {why}"

    @field_validator("thrust", "drag", "azimuth_deg", mode="before")
    @classmethod
    def _one_per_motor(cls, value: object, info: ValidationInfo) -> object:
        rotors = info.data.get("rotors")
        if not rotors:  # How many there must be is not known; a flood there is not.
            return value[:MAX_ROTORS] if isinstance(value, list) else value
        if info.field_name != "thrust":
            return list_of(value, rotors)
        if not isinstance(value, list) or len(value) != rotors:
            raise fault(f"must be a list of {rotors} directions, one per motor")
        return value

    @field_validator("arm", mode="wrap")
    @classmethod
    def _one_or_all(
        cls, value: object, _: object, info: ValidationInfo
    ) -> ArmTable | list[ArmTable]:
        """One checked table for all arms, or a list of them.

        The field's own validator would try both forms and tell faults of both.
        """
        if isinstance(value, list):
            arms = at_most(value, MAX_ROTORS, "arms")
            return reader(list[ArmTable]).validate_python(arms, context=info.context)
        return reader(ArmTable).validate_python(value, context=info.context)

    def built(self) -> Base:
        """The base that the table describes."""
        body, keys = self.rigid_body(0.0), vars(taken(BaseKeys, self))
        if self.arm is None:
            return Base(**keys | {"origin": "base"}, body=body, pose=self.whole_pose)
        arms = self.arm if isinstance(self.arm, list) else [self.arm]
        keys["thrust"] = self.thrust or alternating_thrust(self.rotors)
        keys["drag"] = self.drag or (0.0,) * self.rotors
        return Base(**keys, arms=tuple(arm.body() for arm in arms), body=body)
