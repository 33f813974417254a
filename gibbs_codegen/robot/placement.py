"""Poses of a robot's rods and joints, and its rotors, in what carries them, in plain numbers."""

from __future__ import annotations

import numpy as np

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.numbers import BASE, NO_ANGLE, Vector3
from gibbs_codegen.robot.parts.pose import Pose, vector
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.robot.rotations import Array


def arm_pose(base: Base, k: int) -> Pose:
    """The frame of rod k, 1 to N, in the base's axes and from the base centre."""
    if _starts_at_motor(base, k):
        return Pose((-base.arm(1).length, 0.0, 0.0))
    return Pose(rpy_deg=(NO_ANGLE, NO_ANGLE, base.arm_angle_deg(k)))


def motor_seat(base: Base, k: int) -> Vector3:
    """The place (3), m, of motor k, 1 to N, in the frame of its rod."""
    return (0.0 if _starts_at_motor(base, k) else base.arm(k).length, 0.0, 0.0)


def joint_pose(robot: Robot, i: int) -> Pose:
    """The frame of link i, from 1, its joint at zero, in that of the body which carries it."""
    link, parent = robot.links[i - 1], robot.parents[i - 1]
    if link.pose is not None:
        return link.pose
    before = robot.links[parent - 1].body.length if parent != BASE else 0.0
    start = (before if link.a is None else link.a, 0.0, 0.0)
    step = Pose(start, (link.alpha_deg, NO_ANGLE, NO_ANGLE))
    return step @ Pose((0.0, 0.0, link.d), (NO_ANGLE, NO_ANGLE, link.theta_deg))


def mounted_rotors(robot: Robot) -> tuple[Rotor, ...]:
    """All rotors as placed ones: the motors at the ends of the rods of the base, or `thrusters`.

    Those of rods are in the base's axes from the base centre.
    """
    base, motors = robot.base, []
    for k in range(1, base.rotors + 1):
        rod = arm_pose(base, k)
        position = vector(rod.point(motor_seat(base, k)))
        direction = vector(rod.matrix @ np.array(base.thrust[k - 1]))
        motors.append(Rotor(position=position, direction=direction, drag=base.drag[k - 1]))
    return (*motors, *robot.thrusters)


def base_centre(base: Base) -> Array:
    """The base centre (3), m, from the origin of the coordinates, in the base's axes."""
    if base.origin != "motor1":
        return np.zeros(3)
    return -arm_pose(base, 1).point(motor_seat(base, 1))


def _starts_at_motor(base: Base, k: int) -> bool:
    """True if the frame of a rod is at its motor, which is so of rod 1 by the paper's rule."""
    return k == 1 and base.azimuth_deg is None
