"""The tables of a robot file's bodies: base arms and links, each a rod or any rigid body."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Annotated, Any, Self

from pydantic import AfterValidator, ConfigDict, Field, model_validator

from gibbs_codegen.files.faults import fault, refusal
from gibbs_codegen.files.fields import Bounds, listed
from gibbs_codegen.files.table import Table
from gibbs_codegen.robot.magnitude import size_fault
from gibbs_codegen.robot.model import Body, JointKind, Link, RigidBody, Rod
from gibbs_codegen.robot.rigid_body import inertia_fault


def _sized(number: float) -> float:
    if words := size_fault(number):
        raise fault(words)
    return number


Size = Annotated[float, AfterValidator(_sized)]
NotNegative = Annotated[Size, Bounds(0.0)]
# In radians huge angles lose the part of a turn that they end in.
Angle = Annotated[float, Bounds(-360.0, 360.0, " degrees", "; leave out whole turns")]
Sizes3 = Annotated[tuple[Size, Size, Size], listed(3)]
Sizes6 = Annotated[tuple[Size, Size, Size, Size, Size, Size], listed(6)]


class PlaceTable(Table):
    """Where a link's joint is, by modified Denavit–Hartenberg parameters, and what it does."""

    alpha_deg: Angle = Field(default=0.0, description="twist about x of the frame before, degrees")
    a: Size | None = Field(
        default=None,
        description="distance along x of the frame before, m; default: the length of the link "
        "before, 0 for the first link",
    )
    d: Size = Field(default=0.0, description="offset along the joint's axis z, m")
    theta_deg: Angle = Field(default=0.0, description="offset of the joint angle, degrees")
    joint: JointKind = Field(
        default="revolute",
        description="what the joint does: it turns about its axis z, or slides along it",
    )


class BodyTable(Table):
    """A rod, with mass_per_length and section_inertia, or any rigid body, with mass."""

    model_config = ConfigDict(
        json_schema_extra={
            "dependentRequired": {"com": ["mass"], "inertia": ["mass"]},
            "dependentSchemas": {
                "mass": {"properties": {"mass_per_length": False, "section_inertia": False}}
            },
        }
    )

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
    mass: NotNegative | None = Field(default=None, description="mass of a rigid body, kg")
    com: Sizes3 | None = Field(
        default=None, description="centre of mass of a rigid body, link axes, m; default 0"
    )
    inertia: Sizes6 | None = Field(
        default=None,
        description="inertia xx, yy, zz, xy, xz, yz of a rigid body about its centre of mass, link "
        "axes, with xy = −∫ xy dm, kg m²; default 0",
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of a body that is both a rod and a rigid body, or has no mass.

        Args:
            values: The table as it stands in the file.

        Yields:
            Key and words of each fault.
        """
        rigid = [key for key in ("mass", "com", "inertia") if key in values]
        rod = [key for key in ("mass_per_length", "section_inertia") if key in values]
        if rigid and rod:
            yield (
                rod[0],
                f"belongs to a rod, but {rigid[0]} describes a rigid body: give mass_per_length "
                "and section_inertia, or mass, com and inertia",
            )
        if rigid and "mass" not in values:
            yield "mass", "missing: a rigid body needs its mass in kg"

    @model_validator(mode="after")
    def _is_possible(self) -> Self:
        body = self.body()
        if isinstance(body, Rod):
            key, inertia = "section_inertia", (*body.section_inertia, 0.0, 0.0, 0.0)
        else:
            key, inertia = "inertia", body.inertia
        if words := inertia_fault(body.total_mass, inertia):
            raise refusal([((key,), words)])
        return self

    def body(self) -> Body:
        """The body that the table describes."""
        if self.mass is None:
            return Rod(self.length, self.mass_per_length or 0.0, self.section_inertia or (0.0,) * 3)
        com, inertia = self.com or (0.0,) * 3, self.inertia or (0.0,) * 6
        return RigidBody(self.length, self.mass, com, inertia)


class ArmTable(BodyTable):
    """An arm of the base, with a motor at its end."""

    length: NotNegative = Field(description="the distance from the base centre to the motor, in m")


class LinkTable(BodyTable, PlaceTable):
    """A link of the arm, with the joint that carries it."""

    def link(self) -> Link:
        """The link that the table describes."""
        # Of an angle its shortest decimal: what the file says.
        alpha, theta = (Fraction(repr(angle)) for angle in (self.alpha_deg, self.theta_deg))
        return Link(self.body(), alpha, self.a, self.d, theta, self.joint)
