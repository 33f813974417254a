"""Frames of a robot's bodies, in plain numbers."""

from __future__ import annotations

import numpy as np

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.robot.parts.pose import vector
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.robot.rotations import Array, turn_by_degrees


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
        return link.pose.matrix, np.array(link.pose.xyz)
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
            Rotor(position=vector(origin), direction=vector(direction), drag=base.drag[k - 1])
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
    """True if the frame of a rod is at its motor, which is so of rod 1 by the paper's rule."""
    return k == 1 and base.azimuth_deg is None
