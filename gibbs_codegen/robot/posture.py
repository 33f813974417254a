"""Where a robot and its frames are at one configuration, in numbers: what drawings start from.

Plain composition of the frames that a robot file fixes, with no part in the derivation, which the
emitted `positions` come from; a test compares the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.layout import Layout, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.thrusters import arm_frame, wrench_matrix

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Frame:
    """Origin (3) and axes (3, 3), a column each, of a link's frame in world axes; m."""

    origin: Array
    axes: Array

    def point(self, x: float) -> Array:
        """A point on the x axis.

        Args:
            x: Distance along the axis, m.

        Returns:
            The point (3) in world axes, m.
        """
        place: Array = self.origin + x * self.axes[:, 0]
        return place


@dataclass(frozen=True)
class RobotFrames:
    """Frames of arm 1, of base arms 2 … N and of the arm's links, in world axes.

    `motors` (N, 3) are the seats of the motors in m, `thrusts` (N, 3) the unit vectors of their
    thrusts. The frame of arm 1 has its origin at O₁, those of the other base arms at O₂. `centre`
    is O₂, `tip` the end of the last link, or O₂ where there is none.
    """

    arm_1: Frame
    base_arms: tuple[Frame, ...]
    links: tuple[Frame, ...]
    motors: Array
    thrusts: Array
    centre: Array
    tip: Array

    @property
    def points(self) -> Array:
        """Positions in the order of the emitted POINTS: O1, O2, motors, joints, tip."""
        joints = [frame.origin for frame in self.links]
        return np.array([self.motors[0], self.centre, *self.motors, *joints, self.tip])


def robot_frames(robot: Robot, q: Sequence[float] | Array) -> RobotFrames:
    """Frames of a robot at one configuration.

    Args:
        robot: The robot.
        q: Its coordinates (rad, m).

    Returns:
        The frames, in world axes.

    Raises:
        UsageError: If q has another length.
    """
    base, layout = robot.base, layout_of(robot)
    if np.shape(q) != (layout.q.size,):
        raise UsageError(f"{robot.name} has {layout.q.size} coordinates, not {np.shape(q)}")
    attitude = _attitude(layout, np.asarray(q)[layout.q.attitude])
    length = base.arm(1).length
    motor_1 = 0.0 if base.origin == "motor1" else -length
    origin = np.array(q[layout.q.position]) + motor_1 * attitude[:, 0]
    arm_1 = Frame(origin, attitude)
    centre = arm_1.point(length)
    turns = (arm_frame(base, k)[0] for k in range(2, base.rotors + 1))
    arms = tuple(Frame(centre, attitude @ axes) for axes in turns)
    motors = [origin, *(frame.point(base.arm(k).length) for k, frame in enumerate(arms, start=2))]
    links = _links(robot, Frame(centre, attitude), q[layout.q.joints])
    tip = links[-1].point(robot.links[-1].body.length) if links else centre
    thrusts = (attitude @ wrench_matrix(robot)[:3]).T
    return RobotFrames(arm_1, arms, links, np.array(motors), thrusts, centre, tip)


def _attitude(layout: Layout, parts: Array) -> Array:
    """Rotation matrix (3, 3) of attitude angles (3), or of a quaternion (4)."""
    attitude = np.eye(3)
    if not layout.is_quaternion:
        for letter, angle in zip(layout.attitude, parts, strict=True):
            attitude = attitude @ turn("xyz".index(letter), angle)
        return attitude
    vector, scalar = parts[:3], parts[3]
    across = np.cross(np.eye(3), vector)
    attitude += 2.0 * (across @ across + scalar * across)
    return attitude


def _links(robot: Robot, parent: Frame, joints: Sequence[float] | Array) -> tuple[Frame, ...]:
    """Frames of the arm's links: Rot_x(α)·Trans_x(a)·Rot_z(θ)·Trans_z(d), one after another.

    Args:
        robot: The robot, with n links.
        parent: Frame at the base centre, with arm 1's axes.
        joints: Angle (rad) or travel (m) of each joint (n).

    Returns:
        The frames, in world axes.
    """
    frames: list[Frame] = []
    before = 0.0
    for link, joint in zip(robot.links, joints, strict=True):
        turns = link.joint == "revolute"
        origin = parent.point(before if link.a is None else link.a)
        axes = parent.axes @ turn(0, np.deg2rad(float(link.alpha_deg)))
        origin = origin + (link.d + (0.0 if turns else joint)) * axes[:, 2]
        axes = axes @ turn(2, np.deg2rad(float(link.theta_deg)) + (joint if turns else 0.0))
        parent = Frame(origin, axes)
        frames.append(parent)
        before = link.body.length
    return tuple(frames)


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
