"""The tables of a robot file's bodies: the base, its arms and links, rods or any rigid bodies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Self

from pydantic import ConfigDict, Field, ValidationInfo, model_validator
from pydantic.config import JsonDict

from gibbs_codegen.files.faults import refusal
from gibbs_codegen.files.table import Table
from gibbs_codegen.robot.model import Body, RigidBody, Rod
from gibbs_codegen.robot.quantities import NotNegative, Sizes3, Sizes6
from gibbs_codegen.robot.rigid_body import body_fault

# Key of the robot file that lets inertias pass that no body has.
ALLOWED = "allow_impossible_inertia"
RIGID_NEEDS_MASS: JsonDict = {"com": ["mass"], "inertia": ["mass"]}
NOT_BOTH_BODIES: JsonDict = {
    "mass": {"properties": {"mass_per_length": False, "section_inertia": False}},
}


class RigidTable(Table):
    """Mass, centre of mass and inertia of a rigid body."""

    mass: NotNegative | None = Field(default=None, description="mass of a rigid body, kg")
    com: Sizes3 | None = Field(
        default=None,
        description="centre of mass of a rigid body, in the axes of its link or of the base, m; "
        "default 0",
    )
    inertia: Sizes6 | None = Field(
        default=None,
        description="inertia xx, yy, zz, xy, xz, yz of a rigid body about its centre of mass, in "
        "the same axes, with xy = −∫ xy dm, kg m²; default 0",
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Fault of a rigid body without a mass."""
        if ("com" in values or "inertia" in values) and "mass" not in values:
            yield "mass", "missing: a rigid body needs its mass in kg"

    @model_validator(mode="after")
    def _is_possible(self, info: ValidationInfo) -> Self:
        body = self.body()
        allowed = (info.context or {}).get(ALLOWED) is True
        if body is None or allowed or not (words := body_fault(body)):
            return self
        key = "section_inertia" if isinstance(body, Rod) else "inertia"
        raise refusal([((key,), f"{words}; {ALLOWED} = true lets it pass")])

    def body(self) -> Body | None:
        """The body that the table describes, or None where it gives no mass."""
        return self.rigid_body(0.0)

    def rigid_body(self, length: float) -> RigidBody | None:
        """The rigid body, None without mass; `length`, m, is the way along x to what comes next."""
        if self.mass is None:
            return None
        return RigidBody(length, self.mass, self.com or (0.0,) * 3, self.inertia or (0.0,) * 6)


class RodTable(Table):
    """What is known of a rod, or of any body, along x."""

    length: NotNegative = Field(
        default=0.0,
        description="distance along x to what comes next, a motor, a joint or the tip, m",
    )
    mass_per_length: NotNegative | None = Field(
        default=None, description="mass per length of a rod, kg/m; default 0"
    )
    section_inertia: Sizes3 | None = Field(
        default=None,
        description="inertia xx, yy, zz of a whole rod, added about its centre of mass, kg m²; "
        "default 0",
    )


class BodyTable(RigidTable, RodTable):
    """A rod, with mass_per_length and section_inertia, or any rigid body, with mass."""

    model_config = ConfigDict(
        json_schema_extra={
            "dependentRequired": RIGID_NEEDS_MASS,
            "dependentSchemas": NOT_BOTH_BODIES,
        }
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of a body that is both a rod and a rigid body, or has no mass."""
        rigid = [key for key in ("mass", "com", "inertia") if key in values]
        rod = [key for key in ("mass_per_length", "section_inertia") if key in values]
        if rigid and rod:
            yield (
                rod[0],
                f"belongs to a rod, but {rigid[0]} describes a rigid body: give mass_per_length "
                "and section_inertia, or mass, com and inertia",
            )
        yield from super().key_faults(values)

    def body(self) -> Body:
        """The body that the table describes."""
        rod = Rod(self.length, self.mass_per_length or 0.0, self.section_inertia or (0.0,) * 3)
        return self.rigid_body(self.length) or rod


class ArmTable(BodyTable):
    """An arm of the base, with a motor at its end."""

    length: NotNegative = Field(description="the distance from the base centre to the motor, in m")
