"""Where a robot rests on walls: the state in which a flight from the ground begins.

From above the robot is lowered until walls carry its weight. From there on a displacement is sought
under which nothing accelerates at time 0, with the inputs that act then. Bristles of contacts are
where that displacement leaves them, if their points have stuck on the way.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.plant.vehicle import Array

# How far a robot is lifted or lowered, m, in how many parts, and how often these are halved.
_REACH, _PARTS, _HALVES = 0.5, 2001, 40
# Accelerations, rad/s² or m/s², that are none; and after how many displacements the search ends.
_NONE, _TRIES = 1e-6, 40
_REMEDY = "move it to where it stands (the base's path, start.offset), or turn it (start.turn_deg)"


def resting(loop: ClosedLoop, q: Array, charge: float = 1.0) -> tuple[Array, Array]:
    """Coordinates (nq) near others at which a robot rests on walls, and bristles that hold it.

    `charge` is that of the battery. Raises `UsageError` where there are none.
    """
    vehicle = loop.vehicle
    still = np.zeros(vehicle.layout.v.size)
    contacts = loop.environment.around.contacts if loop.environment else ()
    if not contacts:
        raise UsageError("start.settled: there is no [[wall]] on which the robot could rest")
    frames = [each.frame for each in contacts if each.sticks]
    begin = _lowered(loop, q)
    before = vehicle.frame_poses(begin)[frames, :3, 3]

    def state(moved: Array) -> Array:
        there = vehicle.integrate(begin, moved)
        found = loop.start(there, still, charge)
        strained = vehicle.frame_poses(there)[frames, :3, 3] - before
        found[loop.bristle_place :] = strained.ravel()
        return found

    loads, size = loop.loads(0.0), vehicle.layout.q.size

    def accelerations(moved: Array) -> Array:
        rate = loop.derivative(0.0, state(moved), loads)
        return rate[size : loop.work_place]

    tight = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15)
    found = least_squares(accelerations, still, x_scale="jac", max_nfev=_TRIES, **tight)
    if np.abs(found.fun).max() > _NONE:
        raise UsageError(f"start.settled: {vehicle.name} does not come to rest there; {_REMEDY}")
    end = state(found.x)
    return end[:size], end[loop.bristle_place :]


def _lowered(loop: ClosedLoop, q: Array) -> Array:
    """Coordinates (nq), the base lowered or lifted to where walls carry the weight."""
    vehicle = loop.vehicle
    height = vehicle.layout.q.position.start + 2
    still = np.zeros(vehicle.layout.v.size)
    weight = -vehicle.gravity_forces(vehicle.neutral)[vehicle.layout.v.position.start + 2]

    def at(lifts: Array) -> Array:
        moved = np.tile(q, (len(lifts), 1))
        moved[:, height] += lifts
        return moved

    def carried(lifts: Array) -> Array:
        """Upward forces (k), N, of contacts without friction."""
        states = loop.start(at(lifts), np.tile(still, (len(lifts), 1)))
        forces = loop.contact_wrenches(loop.parts(states))[..., 2].sum(axis=-1)
        return forces - weight

    lifts = np.linspace(_REACH, -_REACH, _PARTS)
    enough = np.flatnonzero(carried(lifts) >= 0.0)
    if not len(enough):
        raise UsageError(
            f"start.settled: within {_REACH:g} m above and below where {vehicle.name} begins no "
            f"wall carries its weight; {_REMEDY}"
        )
    low = lifts[enough[0]]
    high = low + 2.0 * _REACH / (_PARTS - 1)
    for _ in range(_HALVES):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if carried(np.array([middle]))[0] >= 0.0 else (low, middle)
    return at(np.array([low]))[0]
