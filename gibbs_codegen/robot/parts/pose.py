"""Poses of frames in others, and the bodies that carry them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
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
from gibbs_codegen.robot.rotations import Array, angles_of, turn_of_rpy

CARRIER = 'what carries it: "base" or the name of a link'
# A file names the body; once the robot is whole, this is its number.
BodyNumber = Annotated[
    int,
    GetPydanticSchema(lambda _, handler: handler.generate_schema(Label)),
]


@dataclass(frozen=True)
class Pose(Part):
    """A frame in another: `xyz` in m, then R = R_z·R_y·R_x of `rpy_deg`, as in URDF.

    Angles come through unchanged as long as no rotated frame is composed with another rotated one.
    """

    xyz: Vector3 = number("place, {m}", ORIGIN, name="", ends=XYZ)
    rpy_deg: Angles3 = LEVEL

    @staticmethod
    def of_matrix(xyz: Sequence[float] | Array, matrix: Array) -> Pose:
        """The pose with an origin, in m, and axes in the columns of a matrix (3, 3)."""
        return Pose(vector(xyz), angles_of(matrix))

    @cached_property
    def matrix(self) -> Array:
        """Axes of the frame in columns (3, 3)."""
        return turn_of_rpy(self.rpy_deg)

    @property
    def is_identity(self) -> bool:
        """True if it is the other frame itself."""
        return self.rpy_deg == LEVEL and not any(self.xyz)

    def point(self, place: Sequence[float] | Array) -> Array:
        """A point (3) of the frame, in m, in the axes and from the origin of the other one."""
        inner = np.asarray(place, float)
        turned: Array = inner if self.rpy_deg == LEVEL else self.matrix @ inner
        return turned + np.array(self.xyz)

    def __matmul__(self, inner: Pose) -> Pose:
        """The inner frame, which is given in this one, in the other."""
        xyz = vector(self.point(inner.xyz))
        if self.rpy_deg == LEVEL:
            return Pose(xyz, inner.rpy_deg)
        if inner.rpy_deg == LEVEL:
            return Pose(xyz, self.rpy_deg)
        return Pose.of_matrix(xyz, self.matrix @ inner.matrix)

    @property
    def inverse(self) -> Pose:
        """The other frame in this one."""
        xyz = vector(-(self.matrix.T @ np.array(self.xyz)))
        if self.rpy_deg == LEVEL:
            return Pose(xyz)
        return Pose.of_matrix(xyz, self.matrix.T)

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


HERE = Pose()


def vector(values: Sequence[float] | Array) -> Vector3:
    """Three numbers as a tuple of floats, without negative zeros."""
    x, y, z = (float(value) + 0.0 for value in values)
    return x, y, z


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
