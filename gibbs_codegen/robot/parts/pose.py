"""Poses of frames in others, and the bodies that carry them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, ClassVar

from pydantic import GetPydanticSchema

from gibbs_codegen.robot.parts.numbers import (
    LEVEL,
    ORIGIN,
    XYZ,
    Angles,
    Angles3,
    Label,
    Sizes3,
    Vector3,
)
from gibbs_codegen.robot.parts.part import Part, entry, number

CARRIER = 'what carries it: "base" or the name of a link'
# A file names the body; once the robot is whole, this is its number.
BodyNumber = Annotated[
    int,
    GetPydanticSchema(lambda _, handler: handler.generate_schema(Label)),
]


@dataclass(frozen=True)
class Pose(Part):
    """Where a frame is in another: `xyz` in m, then R = R_z·R_y·R_x of `rpy_deg`, as in URDF."""

    xyz: Vector3 = number("place, {m}", ORIGIN, name="", ends=XYZ)
    rpy_deg: Angles3 = LEVEL

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """Its attitude, the scalar part last."""
        pairs = [_half(angle) for angle in self.rpy_deg]
        (cr, sr), (cp, sp), (cy, sy) = pairs
        return (
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        )


def _half(angle: Fraction) -> tuple[float, float]:
    """Cosine and sine of half an angle in degrees."""
    half = math.radians(float(angle) / 2.0)
    return math.cos(half), math.sin(half)


@dataclass(frozen=True, kw_only=True)
class Posed(Part):
    """A pose in the frame of a body."""

    synonyms: ClassVar[Mapping[str, str]] = {"position": "xyz"}

    xyz: Sizes3 | None = entry("place in the frame of what carries it, m; default [0, 0, 0]")
    rpy_deg: Angles | None = entry(
        "roll, pitch and yaw in that frame, R = R_z·R_y·R_x as in URDF, degrees; default [0, 0, 0]"
    )

    @property
    def whole_pose(self) -> Pose:
        """The pose that the keys describe."""
        return Pose(self.xyz or ORIGIN, self.rpy_deg or LEVEL)
