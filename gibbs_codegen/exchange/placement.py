"""Where a frame is in another, with angles as exact fractions of a degree and a rotation matrix.

Both are kept, since a robot file gives angles while welding needs matrices. Angles that a source
gives come through unchanged as long as no rotated frame is composed with another rotated one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from gibbs_codegen.robot.parts.numbers import LEVEL as LEVEL
from gibbs_codegen.robot.parts.numbers import Angles3, Vector3
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.placement import Array, turn_of_rpy

# Of products of rotations: a few units in the last place, in degrees and in entries of a matrix.
_ROUNDING_DEG = Fraction(1, 10**12)
_ROUNDING = 1e-15


@dataclass(frozen=True, eq=False)
class Placement:
    """A frame in another: `xyz` (3) in m, then R = R_z·R_y·R_x of `rpy_deg`."""

    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy_deg: Angles3 = LEVEL

    @staticmethod
    def of_matrix(xyz: Sequence[float] | Array, matrix: Array) -> Placement:
        """The placement with an origin, in m, and axes in the columns of a matrix (3, 3)."""
        return Placement(vector(xyz), angles_of(matrix))

    @cached_property
    def matrix(self) -> Array:
        """Axes of the frame in columns (3, 3)."""
        return turn_of_rpy(self.rpy_deg)

    @property
    def is_identity(self) -> bool:
        """Whether it is the other frame itself."""
        return self.rpy_deg == LEVEL and not any(self.xyz)

    @property
    def pose(self) -> Pose:
        """As a robot has it."""
        return Pose(self.xyz, self.rpy_deg)

    def point(self, place: Sequence[float] | Array) -> Array:
        """A point (3) of the frame, in m, in the axes and from the origin of the other one."""
        inner = np.asarray(place, float)
        turned: Array = inner if self.rpy_deg == LEVEL else self.matrix @ inner
        return turned + np.array(self.xyz)

    def __matmul__(self, inner: Placement) -> Placement:
        """The inner frame, which is given in this one, in the other."""
        xyz = vector(self.point(inner.xyz))
        if self.rpy_deg == LEVEL:
            return Placement(xyz, inner.rpy_deg)
        if inner.rpy_deg == LEVEL:
            return Placement(xyz, self.rpy_deg)
        return Placement.of_matrix(xyz, self.matrix @ inner.matrix)

    @property
    def inverse(self) -> Placement:
        """The other frame in this one."""
        xyz = vector(-(self.matrix.T @ np.array(self.xyz)))
        if self.rpy_deg == LEVEL:
            return Placement(xyz)
        return Placement.of_matrix(xyz, self.matrix.T)


HERE = Placement()


def vector(values: Sequence[float] | Array) -> Vector3:
    """Three numbers as a tuple of floats, without negative zeros."""
    x, y, z = (float(value) + 0.0 for value in values)
    return x, y, z


def degrees(radians: float) -> Fraction:
    """A finite angle as the shortest decimal of its degrees, −360 to 360.

    This loses nothing that matters.
    """
    angle = Fraction(repr(math.degrees(math.remainder(radians, 4 * math.pi))))
    return angle - 360 if angle > 360 else angle + 360 if angle < -360 else angle


def angles_of(matrix: Array) -> Angles3:
    """Roll, pitch and yaw of a rotation (3, 3) in degrees, accurate at a pitch near ±90° too."""
    level = math.hypot(matrix[0, 0], matrix[1, 0])
    pitch = math.atan2(-matrix[2, 0], level if level > _ROUNDING else 0.0)
    # At ±90° roll and yaw turn about one axis, and yaw may be anything: 0.
    yaw = math.atan2(matrix[1, 0], matrix[0, 0]) if level > _ROUNDING else 0.0
    c, s = math.cos(yaw), math.sin(yaw)
    roll = math.atan2(s * matrix[0, 2] - c * matrix[1, 2], c * matrix[1, 1] - s * matrix[0, 1])
    r, p, y = (snapped_angle(degrees(angle), _ROUNDING_DEG) for angle in (roll, pitch, yaw))
    return r, p, y


def snapped_angle(angle: Fraction, tolerance: Fraction) -> Fraction:
    """The multiple of 15° that an angle, in degrees, is within a tolerance; else the angle."""
    multiple = Fraction(15 * round(angle / 15))
    return multiple if abs(angle - multiple) <= tolerance else angle
