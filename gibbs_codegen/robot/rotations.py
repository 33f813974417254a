"""Rotations as matrices in plain numbers, of angles, axes, quaternions, and back."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.robot.parts.numbers import Angles3, cos_sin

Array = NDArray[np.float64]


def turn(axis: int, angle: float) -> Array:
    """Rotation matrix (3, 3) about axis 0, 1 or 2, x, y or z, by an angle in rad."""
    return _turn(axis, math.cos(angle), math.sin(angle))


def turn_by_degrees(axis: int, angle: Fraction) -> Array:
    """Rotation matrix (3, 3) about axis 0, 1 or 2 by degrees, exact for multiples of 90°."""
    return _turn(axis, *cos_sin(angle)) + 0.0


def _turn(axis: int, c: float, s: float) -> Array:
    p, q = (axis + 1) % 3, (axis + 2) % 3
    matrix: Array = np.eye(3)
    matrix[p, p] = matrix[q, q] = c
    matrix[p, q], matrix[q, p] = -s, s
    return matrix


def turn_about(axis: Array, angle: float) -> Array:
    """Rotation matrix (3, 3) about any unit vector (3), by an angle in rad (Rodrigues)."""
    if np.count_nonzero(axis) == 1 and axis.max() == 1.0:
        return turn(int(np.argmax(axis)), angle)
    cross = _cross(*axis)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def turn_of_quaternion(x: float, y: float, z: float, w: float) -> Array:
    """Rotation matrix (3, 3) of a quaternion, which is not zero but need not be of unit length."""
    v, n = np.array([x, y, z]), x * x + y * y + z * z + w * w
    return ((w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * _cross(x, y, z)) / n


def _cross(x: float, y: float, z: float) -> Array:
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def turn_of_rpy(rpy_deg: Angles3) -> Array:
    """Rotation matrix (3, 3) R_z·R_y·R_x of roll, pitch and yaw."""
    x, y, z = (turn_by_degrees(axis, angle) for axis, angle in enumerate(rpy_deg))
    return z @ y @ x


# Rounding of rotations: a few units in the last place, in degrees and in entries of a matrix.
_ROUNDING_DEG = Fraction(1, 10**12)
_ROUNDING = 1e-15


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
