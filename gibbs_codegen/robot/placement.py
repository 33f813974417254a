"""Where the frames of a robot's bodies are, in plain numbers, and the rotations that this takes."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.numbers import BASE, Angles3, Vector3, cos_sin
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.parts.rotor import Rotor

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


def pose_frame(pose: Pose) -> tuple[Array, Array]:
    """Axes (3, 3) of a pose, a column each, and origin (3), m."""
    return turn_of_rpy(pose.rpy_deg), np.array(pose.xyz)


def arm_frame(base: Base, k: int) -> tuple[Array, Array]:
    """Axes (3, 3), a column each, and origin (3), m, of rod k, 1 to N, in the base's axes.

    They are from the base centre.
    """
    if _starts_at_motor(base, k):
        return np.eye(3), np.array([-base.arm(1).length, 0.0, 0.0])
    return turn_by_degrees(2, base.arm_angle_deg(k)), np.zeros(3)


def joint_frame(robot: Robot, i: int) -> tuple[Array, Array]:
    """Axes (3, 3), a column each, and origin (3), m, of link i, from 1, its joint at zero.

    They are in the frame of the body which carries it.
    """
    link, parent = robot.links[i - 1], robot.parents[i - 1]
    if link.pose is not None:
        return pose_frame(link.pose)
    before = robot.links[parent - 1].body.length if parent != BASE else 0.0
    twist = turn_by_degrees(0, link.alpha_deg)
    step = np.array([before if link.a is None else link.a, 0.0, 0.0])
    axes: Array = twist @ turn_by_degrees(2, link.theta_deg)
    return axes, step + link.d * twist[:, 2]


def mounted_rotors(robot: Robot) -> tuple[Rotor, ...]:
    """All rotors as placed ones: the motors at the ends of the rods of the base, or `thrusters`.

    Those of rods are in the base's axes from the base centre.
    """
    base = robot.base
    motors = []
    for k in range(1, base.rotors + 1):
        axes, origin = arm_frame(base, k)
        if not _starts_at_motor(base, k):
            origin = base.arm(k).length * axes[:, 0]
        direction = axes @ np.array(base.thrust[k - 1])
        motors.append(
            Rotor(position=_vector(origin), direction=_vector(direction), drag=base.drag[k - 1])
        )
    return (*motors, *robot.thrusters)


def base_centre(base: Base) -> Array:
    """The base centre (3), m, from the origin of the coordinates, in the base's axes."""
    if base.origin != "motor1":
        return np.zeros(3)
    axes, origin = arm_frame(base, 1)
    seat: Array = origin if _starts_at_motor(base, 1) else base.arm(1).length * axes[:, 0]
    return -seat


def _starts_at_motor(base: Base, k: int) -> bool:
    """Whether the frame of a rod is at its motor, which is so of rod 1 by the paper's rule."""
    return k == 1 and base.azimuth_deg is None


def _vector(values: Array) -> Vector3:
    x, y, z = map(float, values)
    return (x, y, z)
