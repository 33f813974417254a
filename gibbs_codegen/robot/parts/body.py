"""Rods and rigid bodies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationInfo, model_validator

from gibbs_codegen.files.table import refusal
from gibbs_codegen.robot.parts.numbers import (
    AXIS_PAIRS,
    ORIGIN,
    XYZ,
    NotNegative,
    Sizes3,
    Sizes6,
    Vector3,
)
from gibbs_codegen.robot.parts.part import Part, again, number, taken

# Entries xx, yy, zz, xy, xz, yz, kg m², with xy = −∫ xy dm.
Inertia = tuple[float, float, float, float, float, float]
# Key of the robot file that lets inertias pass that no body has.
ALLOWED = "allow_impossible_inertia"
RIGID_NEEDS_MASS: dict[str, Any] = {"com": ["mass"], "inertia": ["mass"]}
NOT_BOTH_BODIES: dict[str, Any] = {
    "mass": {"properties": {"mass_per_length": False, "section_inertia": False}}
}


@dataclass(frozen=True, kw_only=True)
class RigidKeys(Part):
    """Mass, centre of mass and inertia of a rigid body."""

    mass: NotNegative | None = number("mass of a rigid body, {kg}")
    com: Sizes3 = number(
        "centre of mass of a rigid body, in the axes of its link or of the base, {m}",
        ORIGIN,
        ends=XYZ,
    )
    inertia: Sizes6 = number(
        "inertia xx, yy, zz, xy, xz, yz of a rigid body about its centre of mass, in the same "
        "axes, with xy = −∫ xy dm, {kg m^2}",
        (*ORIGIN, *ORIGIN),
        ends=AXIS_PAIRS,
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
        place = ("section_inertia" if isinstance(body, Rod) else "inertia",)
        raise refusal([(place, f"{words}; to allow it, give {ALLOWED} = true")])

    def body(self) -> Body | None:
        """The body that the table describes, or None where it gives no mass."""
        return self.rigid_body(0.0)

    def rigid_body(self, length: float) -> RigidBody | None:
        """The rigid body, None without mass; `length`, m, is the way along x to what comes next."""
        if self.mass is None:
            return None
        return RigidBody(length, self.mass, self.com, self.inertia)


@dataclass(frozen=True, kw_only=True)
class Rod(Part):
    """A straight rod along x from the link's joint, with the inertia of its cross-section (B₃)."""

    length: NotNegative = number(
        "distance along x to what comes next, a motor, a joint or the tip, {m}", 0.0
    )
    mass_per_length: NotNegative = number("mass per length of a rod, {kg/m}", 0.0)
    section_inertia: Sizes3 = number(
        "inertia xx, yy, zz of a whole rod, added about its centre of mass, {kg m^2}",
        ORIGIN,
        ends=AXIS_PAIRS[:3],
    )

    @property
    def total_mass(self) -> float:
        """Mass in kg."""
        return self.length * self.mass_per_length


@dataclass(frozen=True)
class RigidBody(Part):
    """Any rigid body: `length` and `com` in m, `mass` in kg, `inertia` in kg m²."""

    length: float = again(Rod, "length")
    mass: float = again(RigidKeys, "mass", default=0.0)
    com: Vector3 = again(RigidKeys, "com")
    inertia: Inertia = again(RigidKeys, "inertia")

    @property
    def total_mass(self) -> float:
        """Mass in kg."""
        return self.mass

    @property
    def weighs(self) -> bool:
        """True if there is any mass or inertia."""
        return self.mass != 0.0 or any(self.inertia)


Body = Rod | RigidBody


def as_rigid_body(body: Body) -> RigidBody:
    """The same body by mass, centre of mass and inertia about it."""
    if isinstance(body, RigidBody):
        return body
    mass, (xx, yy, zz) = body.total_mass, body.section_inertia
    slender = mass * body.length**2 / 12
    inertia = (xx, yy + slender, zz + slender, 0.0, 0.0, 0.0)
    return RigidBody(body.length, mass, (body.length / 2, 0.0, 0.0), inertia)


# Rounding of decimal input: 21.2e-8 + 190.8e-8 may exceed 212e-8 by a unit in the last place.
_TOLERANCE = 1e-9


def inertia_matrix(inertia: Sequence[float]) -> NDArray[np.float64]:
    """The matrix (3, 3) of inertia xx, yy, zz, xy, xz, yz, with xy = −∫ xy dm."""
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def entries_of(matrix: NDArray[np.float64]) -> Inertia:
    """Inertia xx, yy, zz, xy, xz, yz of a matrix (3, 3), without negative zeros."""
    xx, xy, xz, _, yy, yz, _, _, zz = (float(entry) + 0.0 for entry in matrix.ravel())
    return xx, yy, zz, xy, xz, yz


def inertia_fault(mass: float, inertia: Sequence[float]) -> str | None:
    """Why no body has a certain inertia about its centre of mass, kg m²; None if one has.

    An inertia matrix J belongs to a mass distribution if and only if the matrix of its second
    moments E = ½ tr(J)·1 − J is positive semidefinite, which is the triangle inequality between
    principal moments, positive semidefiniteness of J included. `inertia` holds xx, yy, zz, xy, xz,
    yz.
    """
    scale = max(abs(entry) for entry in inertia)
    if scale == 0.0:
        return None
    if mass == 0.0:
        return "is not zero although the body has no mass (a rod needs length and mass_per_length)"
    matrix = inertia_matrix(inertia) / scale
    if np.linalg.eigvalsh(matrix)[0] < -_TOLERANCE:
        return "has a negative principal moment; an inertia matrix is positive semidefinite"
    second_moments = 0.5 * np.trace(matrix) * np.eye(3) - matrix
    if np.linalg.eigvalsh(second_moments)[0] < -_TOLERANCE:
        return (
            "violates the triangle inequality: no principal moment may exceed the sum of the "
            "other two"
        )
    return None


def body_fault(body: Body) -> str | None:
    """Why no body has the inertia that a rod or rigid body is given; None if one has."""
    if isinstance(body, Rod):
        return inertia_fault(body.total_mass, (*body.section_inertia, 0.0, 0.0, 0.0))
    words = inertia_fault(body.mass, body.inertia)
    xx, xy, xz, yy, yz, zz = body.inertia
    if words and not inertia_fault(body.mass, (xx, yy, zz, xy, xz, yz)):
        return (
            "must be in the order xx, yy, zz, xy, xz, yz, and seems to be in that of URDF, xx, "
            f"xy, xz, yy, yz, zz; as given it {words}"
        )
    return words


@dataclass(frozen=True, kw_only=True)
class BodyKeys(Rod, RigidKeys):
    """A rod, with mass_per_length and section_inertia, or any rigid body, with mass."""

    conditions: ClassVar[dict[str, Any]] = {
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

    def body(self) -> Body:
        """The body that the table describes."""
        return self.rigid_body(self.length) or taken(Rod, self)
