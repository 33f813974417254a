"""How the points of a robot hang together, found out from what its module computes.

A module tells neither the parents of its links nor what carries a rotor. Both show where joints are
moved: what a joint carries moves with it, or is coupled with it through the mass matrix.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.simulator.plant.vehicle import Array, Flags, Vehicle

# Angles and travels of joints, rad and m, at which nothing is in line; and how far each is moved.
_FIRST, _NEXT, _MOVED = 0.2, 0.11, 0.5
# What rounding makes of what does not move, m or 1, for robots of some metres.
_ROUNDING = 1e-9


def point_parents(vehicle: Vehicle) -> NDArray[np.int_]:
    """Numbers (k) of the points that points are joined to, for drawings, −1 for none.

    For rotors and joints that is the joint that carries them or the base centre; for frames, the
    same where they are on the last link of an arm, or the base centre for a tip without an arm.
    """
    joints, centre = vehicle.joints, vehicle.points.index(vehicle.centre)
    rotor = centre + 1
    joint = rotor + vehicle.rotors
    moves = _carried(vehicle)
    mass = vehicle.mass_matrix(_posture(vehicle))[vehicle.arm_rates, vehicle.arm_rates]
    # Joints that both move a point follow each other, even where nothing else tells.
    together = np.any(moves[:, np.newaxis] & moves, axis=-1)
    moves[:, joint : joint + joints] |= together | (mass != 0.0)
    parents = np.full(len(vehicle.points), -1)
    has_child = np.zeros(joints, dtype=bool)
    for point in range(rotor, len(parents)):
        # Links come after those that carry them.
        before = point - joint if joint <= point < joint + joints else joints
        carriers = np.flatnonzero(moves[:before, point])
        last = int(carriers[-1]) if len(carriers) else -1
        parents[point] = joint + last if last >= 0 else centre
        if joint <= point < joint + joints and last >= 0:
            has_child[last] = True
        on_the_way = has_child[last] if last >= 0 else vehicle.points[point] != "tip"
        if point >= joint + joints and on_the_way:
            parents[point] = -1
    return parents


def _posture(vehicle: Vehicle) -> Array:
    """Coordinates (nq) at which joints are neither at 0 nor alike."""
    q = vehicle.neutral
    q[vehicle.arm] = _FIRST + _NEXT * np.arange(vehicle.joints)
    return q


def _carried(vehicle: Vehicle) -> Flags:
    """Whether joints move points, or turn frames and thrusts there: (n, k)."""
    here = _posture(vehicle)
    moved = np.tile(here, (vehicle.joints, 1))
    moved[:, vehicle.arm] += _MOVED * np.eye(vehicle.joints)
    found = _differs(vehicle.positions(moved) - vehicle.positions(here))
    rotor = vehicle.points.index(vehicle.centre) + 1
    thrusts, still = (vehicle.thrust_wrenches(q) for q in (moved, here))
    found[:, rotor : rotor + vehicle.rotors] |= _differs(np.swapaxes(thrusts - still, -1, -2))
    axes, rest = (vehicle.frame_poses(q)[..., 1:, :3, 0:3] for q in (moved, here))
    frames = axes.shape[1]
    found[:, len(vehicle.points) - frames :] |= _differs((axes - rest).reshape(*axes.shape[:2], 9))
    return found


def _differs(differences: Array) -> Flags:
    found: Flags = np.abs(differences).max(axis=-1, initial=0.0) > _ROUNDING
    return found
