"""Desired motion of joints that no path of the tip leads: a posture, and moves from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gibbs_codegen.scenario.paths import Line
from gibbs_codegen.scenario.scenario import Move
from gibbs_codegen.simulator.plant.actuators import joint_place
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.reference import Motion


def joint_motion(
    vehicle: Vehicle, posture: Array, moves: Mapping[str, Sequence[Move]], time: Array
) -> Motion:
    """Motion of the joints by moves from `posture` (n), with the base's coordinates at zero."""
    joints = np.zeros((len(time), 3, vehicle.joints))
    joints[:, 0] = posture
    for name, legs in moves.items():
        place = joint_place(vehicle, name, "arm.moves")
        start = posture[place]
        for leg in legs:
            # How far it has come, as of a point on a line.
            way = Line((0.0, 0.0, 0.0), (leg.to - start, 0.0, 0.0), leg.duration, leg.begin)
            joints[:, :, place] += way(time)[:, :3, 0]
            start = leg.to
    q = np.tile(vehicle.neutral, (len(time), 1))
    v, a = np.zeros((2, len(time), vehicle.layout.v.size))
    q[:, vehicle.arm] = joints[:, 0]
    v[:, vehicle.arm_rates], a[:, vehicle.arm_rates] = joints[:, 1], joints[:, 2]
    return Motion(time, q, v, a)


def with_joints(vehicle: Vehicle, base: Motion, joints: Motion) -> Motion:
    """Motion of the base with that of the joints at the same knots put in."""
    q, v, a = base.q.copy(), base.v.copy(), base.a.copy()
    q[:, vehicle.arm] = joints.q[:, vehicle.arm]
    v[:, vehicle.arm_rates] = joints.v[:, vehicle.arm_rates]
    a[:, vehicle.arm_rates] = joints.a[:, vehicle.arm_rates]
    return Motion(base.time, q, v, a)
