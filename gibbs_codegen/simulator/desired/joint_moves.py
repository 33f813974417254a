"""Desired motion of joints that no path of the tip leads: a posture, and moves from it."""

from __future__ import annotations

import numpy as np

from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.reference import Motion


def joint_motion(vehicle: Vehicle, posture: Array, time: Array) -> Motion:
    """Motion of the joints, with the base's coordinates at zero.

    Args:
        vehicle: The robot.
        posture: Joint coordinates (n) at the start, rad or m.
        time: Times (s), s.

    Returns:
        The motion at the times.
    """
    q = np.tile(vehicle.neutral, (len(time), 1))
    v, a = np.zeros((2, len(time), vehicle.layout.v.size))
    q[:, vehicle.arm] = posture
    return Motion(time, q, v, a)


def with_joints(vehicle: Vehicle, base: Motion, joints: Motion) -> Motion:
    """Motion of the base with that of the joints put in.

    Args:
        vehicle: The robot.
        base: Motion of the base at knots, its other entries at zero.
        joints: Motion of the joints at the same knots.

    Returns:
        The motion of both.
    """
    places, rates = vehicle.arm, vehicle.arm_rates
    base.q[:, places] = joints.q[:, places]
    base.v[:, rates], base.a[:, rates] = joints.v[:, rates], joints.a[:, rates]
    return base
