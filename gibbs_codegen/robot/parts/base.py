"""The flying base, its rods and motors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import ValidationInfo, field_validator

from gibbs_codegen.files.table import Bounds, Whole, at_most, fault, list_of, reader
from gibbs_codegen.robot.parts.body import RIGID_NEEDS_MASS, Body, BodyKeys, RigidBody, RigidKeys
from gibbs_codegen.robot.parts.numbers import AXES, Angle, Direction, NotNegative, Size, Vector3
from gibbs_codegen.robot.parts.part import Part, entry, number, taken
from gibbs_codegen.robot.parts.rotor import MAX_ROTORS

Origin = Literal["motor1", "centre", "base"]
Attitude = Literal["xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "quaternion"]
ATTITUDES: tuple[Attitude, ...] = get_args(Attitude)
# The intrinsic sequences of Tait–Bryan angles.
SEQUENCES = ATTITUDES[:-1]
# Those of a base that has rods.
ROD_ORIGINS: tuple[Origin, ...] = ("motor1", "centre")
# The keys of rods and of the motors at their ends.
ROD_KEYS = ("rotors", "arm", "thrust", "drag", "azimuth_deg")


@dataclass(frozen=True, kw_only=True)
class BaseKeys(Part):
    """Keys of a base and its table: its rods, with a motor at the end of each."""

    rotors: Annotated[Whole, Bounds(2, MAX_ROTORS)] = entry(
        "the number of rotors and arms, N", unsaid=0
    )
    attitude: Attitude = entry("intrinsic sequence of the attitude angles, or quaternion", "xyz")
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
    `azimuth_deg` None is the paper's rule, in which rod 1 is seen from its motor.
    """

    arms: tuple[Body, ...] = ()
    body: RigidBody | None = None

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
class BaseTable(BaseKeys, RigidKeys):
    """The flying base, rigid: a central body, rods with a motor at the end of each, or both."""

    conditions: ClassVar[dict[str, Any]] = {
        "dependentRequired": {
            **RIGID_NEEDS_MASS,
            **{key: [other for other in ROD_KEYS[:2] if other != key] for key in ROD_KEYS},
        }
    }

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
        arms, rotors = values.get("arm"), values.get("rotors")
        if not isinstance(arms, list) or not isinstance(rotors, int):
            return
        if 1 < rotors <= MAX_ROTORS and rotors != len(arms) <= MAX_ROTORS:
            what = f"a list of {len(arms)} for {rotors} rotors"
            yield "arm", f"{what}; give one table for all, or one each"

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
            return Base(**keys | {"origin": "base"}, body=body)
        arms = self.arm if isinstance(self.arm, list) else [self.arm]
        keys["thrust"] = self.thrust or alternating_thrust(self.rotors)
        keys["drag"] = self.drag or (0.0,) * self.rotors
        return Base(**keys, arms=tuple(arm.body() for arm in arms), body=body)
