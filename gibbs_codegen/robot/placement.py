"""Where the frames of a robot's bodies are, in plain numbers, as the robot file places them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.robot.model import BASE, Base, Pose, Robot

Array = NDArray[np.float64]


def turn(axis: int, angle: float) -> Array:
    """Rotation matrix about a coordinate axis.

    Args:
        axis: 0, 1 or 2 for x, y or z.
        angle: The angle, rad.

    Returns:
        The matrix (3, 3).
    """
    c, s = np.cos(angle), np.sin(angle)
    p, q = (axis + 1) % 3, (axis + 2) % 3
    matrix: Array = np.eye(3)
    matrix[p, p] = matrix[q, q] = c
    matrix[p, q], matrix[q, p] = -s, s
    return matrix


def turn_about(axis: Array, angle: float) -> Array:
    """Rotation matrix about any axis (Rodrigues).

    Args:
        axis: Unit vector (3).
        angle: The angle, rad.

    Returns:
        The matrix (3, 3).
    """
    if np.count_nonzero(axis) == 1 and axis.max() == 1.0:
        return turn(int(np.argmax(axis)), angle)
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix: Array = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
    return matrix


def pose_frame(pose: Pose) -> tuple[Array, Array]:
    """Axes and origin of a pose.

    Args:
        pose: Of a frame in another.

    Returns:
        The axes (3, 3), a column each, and the origin (3), m.
    """
    x, y, z = (turn(axis, np.deg2rad(float(angle))) for axis, angle in enumerate(pose.rpy_deg))
    return z @ y @ x, np.array(pose.xyz)


def arm_frame(base: Base, k: int) -> tuple[Array, Array]:
    """Frame of a base rod, from the base centre in the base's axes.

    Args:
        base: The base.
        k: Number of the rod, from 1 to N.

    Returns:
        The axes (3, 3), a column each, and the origin (3), m.
    """
    if k == 1 and base.azimuth_deg is None:
        return np.eye(3), np.array([-base.arm(1).length, 0.0, 0.0])
    return turn(2, np.deg2rad(float(base.arm_angle_deg(k)))), np.zeros(3)


def joint_frame(robot: Robot, i: int) -> tuple[Array, Array]:
    """Frame of a link in that of the body which carries it, its joint at zero.

    Args:
        robot: The robot.
        i: Number of the link, from 1.

    Returns:
        The axes (3, 3), a column each, and the origin (3), m.
    """
    link, parent = robot.links[i - 1], robot.parents[i - 1]
    if link.pose is not None:
        return pose_frame(link.pose)
    before = robot.links[parent - 1].body.length if parent != BASE else 0.0
    twist = turn(0, np.deg2rad(float(link.alpha_deg)))
    step = np.array([before if link.a is None else link.a, 0.0, 0.0])
    axes: Array = twist @ turn(2, np.deg2rad(float(link.theta_deg)))
    return axes, step + link.d * twist[:, 2]
