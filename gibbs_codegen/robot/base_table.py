"""The table of a robot file's base."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import ConfigDict, Field, TypeAdapter, ValidationInfo, field_validator

from gibbs_codegen.files.faults import fault
from gibbs_codegen.files.fields import Bounds, at_most, list_of
from gibbs_codegen.robot.body_tables import RIGID_NEEDS_MASS, ArmTable, RigidTable
from gibbs_codegen.robot.model import (
    MAX_ROTORS,
    ROD_ORIGINS,
    Attitude,
    Base,
    Origin,
    alternating_thrust,
)
from gibbs_codegen.robot.quantities import Angle, Direction, Size, exact

_ARMS = TypeAdapter(list[ArmTable])
# The keys of rods and of the motors at their ends.
ROD_KEYS = ("rotors", "arm", "thrust", "drag", "azimuth_deg")


class BaseTable(RigidTable):
    """The flying base, rigid: a central body, rods with a motor at the end of each, or both."""

    model_config = ConfigDict(
        json_schema_extra={
            "dependentRequired": {
                **RIGID_NEEDS_MASS,
                **{key: [other for other in ROD_KEYS[:2] if other != key] for key in ROD_KEYS},
            }
        }
    )

    rotors: Annotated[int, Bounds(2, MAX_ROTORS)] | None = Field(
        default=None, description="the number of rotors and arms, N"
    )
    attitude: Attitude = Field(
        default="xyz", description="intrinsic sequence of the attitude angles, or quaternion"
    )
    origin: Origin | None = Field(
        default=None,
        description="the point whose position is x, y, z: motor1 or centre where the base has "
        "arms, base where it has none; default: motor1 with arms, base without",
    )
    thrust: list[Direction] | None = Field(
        default=None,
        description="direction of the thrust of each motor in its arm's frame: an axis, or "
        "[x, y, z]; default: z for odd motors, y for even ones",
    )
    drag: list[Size] | None = Field(
        default=None,
        description="reaction torque of each motor about its thrust's direction per unit of "
        "thrust, m; default 0",
    )
    azimuth_deg: list[Angle] | None = Field(
        default=None,
        description="angle of each arm about the base's normal z, from the base's x axis, degrees; "
        "default: equal angles, with arm 1 seen from its motor",
    )
    arm: ArmTable | list[ArmTable] | None = Field(
        default=None, description="one table for all arms, or a list of one for each"
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of arms that are not whole, or not as many as there are rotors."""
        yield from super().key_faults(values)
        if any(key in values for key in ROD_KEYS):
            for key in ROD_KEYS[:2]:
                if key not in values:
                    yield key, f"missing: {cls.model_fields[key].description}"
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
        if rotors is None:  # How many there must be is not known; a flood there is not.
            return value[:MAX_ROTORS] if isinstance(value, list) else value
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
            arms = at_most(value, MAX_ROTORS, "arms")
            return _ARMS.validate_python(arms, context=info.context)
        return ArmTable.model_validate(value, context=info.context)

    def built(self) -> Base:
        """The base that the table describes."""
        body = self.rigid_body(0.0)
        if self.rotors is None or self.arm is None:
            return Base(attitude=self.attitude, origin=self.origin or "base", body=body)
        arms = self.arm if isinstance(self.arm, list) else [self.arm]
        return Base(
            self.rotors,
            tuple(arm.body() for arm in arms),
            tuple(self.thrust) if self.thrust else alternating_thrust(self.rotors),
            tuple(self.drag or (0.0,) * self.rotors),
            self.attitude,
            self.origin or "motor1",
            body,
            tuple(map(exact, self.azimuth_deg)) if self.azimuth_deg else None,
        )
