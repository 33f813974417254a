"""Rest of a robot on walls: the state in which a flight from the ground begins.

From above the robot is lowered until walls carry its weight. From there on a displacement is sought
under which nothing accelerates at time 0, with the inputs that act then. Bristles of contacts are
where that displacement leaves them, if their points have stuck on the way. Where that fails, walls
are soft and rough at first, so that a robot that leans comes to stand on all of its feet.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.scenario.walls import bristle

# How far a robot is lifted or lowered, m, in how many parts, and how often these are halved.
_REACH, _PARTS, _HALVES = 0.5, 2001, 40
# How far soft walls give way under the weight, m, and the friction of rough ones.
_SOFT, _ROUGH = 0.03, 1e3
# Share by which the friction of frames that were about to slide stays below that at rest.
_WITHIN = 1e-12
# Accelerations, rad/s² or m/s², that are none; and after how many displacements the search ends.
_NONE, _TRIES = 1e-6, 40
# How accelerations may grow with displacements, 1/s², by errors of differences.
_TOPPLES = 0.1
_REMEDY = "move its start (the base's path, start.offset), or turn it (start.turn_deg)"


def resting(loop: ClosedLoop, q: Array, charge: float = 1.0) -> tuple[Array, Array]:
    """Coordinates (nq) near others at which a robot rests on walls, and bristles that hold it.

    `charge` is that of the battery. Raises `UsageError` where there are none.
    """
    loop = replace(loop, bristles=None)
    environment = loop.environment
    if environment is None or not environment.wall:
        raise UsageError(
            "start.settled: there is no [[wall]] to rest on; add one, or leave settled out"
        )
    if np.any(loop.loads(0.0).holds):
        raise UsageError(
            "start.settled: a constraint already holds the robot at the start; let it begin "
            "later, or leave settled out"
        )
    stiffness = sum(wall.stiffness * len(wall.frames) for wall in environment.wall)
    weight = loop.vehicle.weight
    place, bristles, left = _balanced(loop, _lowered(loop, q), charge)
    share = min(weight / (_SOFT * stiffness), 1.0)
    if left > _NONE and share < 1.0:
        place = _lowered(_softer(loop, share), q)
        # Each time stiffer by the same factor, of ten or less.
        for softness in np.geomspace(share, 1.0, 1 + math.ceil(-math.log10(share))).tolist():
            place, bristles, left = _balanced(_softer(loop, softness), place, charge)
    if left > _NONE:
        raise UsageError(
            f"start.settled: {loop.vehicle.name} does not come to rest there; {_REMEDY}"
        )
    return place, _held(loop, place, bristles, charge)


def _held(loop: ClosedLoop, q: Array, bristles: Array, charge: float) -> Array:
    """Bristles (3 b) with the forces of others, strained no further than friction holds them."""
    if loop.environment is None:
        return bristles
    contacts, walls = loop.environment.around.contacts, loop.environment.wall
    loop = replace(loop, bristles=bristles)
    loads, still = loop.loads(0.0), np.zeros(loop.vehicle.layout.v.size)
    parts = loop.parts(loop.start(q, still, charge))
    _, aimed, acting = loop.commands(0.0, parts, loads)
    motions = loop.motion(0.0, parts, aimed, acting, loads)["contacts"]
    strained = [
        -(1.0 - _WITHIN * motions[k, 4:7].any()) * motions[k, 1:4] / bristle(walls[contact.wall])[0]
        for k, contact in enumerate(contacts)
        if contact.sticks
    ]
    return np.ravel(strained)


def _softer(loop: ClosedLoop, share: float) -> ClosedLoop:
    """The loop with walls, and bristles, that have so much of their stiffness, and all stick."""
    if share == 1.0 or loop.environment is None:
        return loop
    walls = tuple(
        replace(
            wall,
            stiffness=share * wall.stiffness,
            friction=wall.friction and _ROUGH,
            bristle_stiffness=wall.bristle_stiffness and share * wall.bristle_stiffness,
        )
        for wall in loop.environment.wall
    )
    return replace(loop, environment=replace(loop.environment, wall=walls))


def _balanced(loop: ClosedLoop, begin: Array, charge: float) -> tuple[Array, Array, float]:
    """Coordinates (nq) near others at which nothing accelerates, bristles, and what is left of it.

    That is the greatest acceleration, rad/s² or m/s²; infinite where the robot would topple.
    """
    vehicle = loop.vehicle
    still = np.zeros(vehicle.layout.v.size)
    contacts = loop.environment.around.contacts if loop.environment else ()
    frames = [contact.frame for contact in contacts if contact.sticks]
    before = vehicle.frame_poses(begin)[frames, :3, 3]
    loads, size = loop.loads(0.0), vehicle.layout.q.size

    def state(moved: Array) -> Array:
        there = vehicle.integrate(begin, moved)
        start = loop.start(there, still, charge)
        deflections = vehicle.frame_poses(there)[frames, :3, 3] - before
        start[loop.layout.places.bristles] = deflections.ravel()
        return start

    def accelerations(moved: Array) -> Array:
        return loop.derivative(0.0, state(moved), loads)[loop.layout.places.v]

    tight = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15)
    search = scipy.optimize.least_squares
    solution = search(accelerations, still, x_scale="jac", max_nfev=_TRIES, **tight)
    end, left = state(solution.x), float(np.abs(solution.fun).max())
    if np.linalg.eigvals(solution.jac).real.max() > _TOPPLES:
        left = np.inf
    return end[:size], end[loop.layout.places.bristles], left


def _lowered(loop: ClosedLoop, q: Array) -> Array:
    """Coordinates (nq), the base lowered or lifted, if it can be, to where walls carry it."""
    vehicle, along = loop.vehicle, loop.vehicle.layout.own_axes[0]
    if 2 not in along:
        return q
    height = vehicle.layout.q.position.start + along.index(2)
    still = np.zeros(vehicle.layout.v.size)
    weight = vehicle.weight

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
            f"start.settled: no wall within {_REACH:g} m above or below the start carries the "
            f"weight of {vehicle.name}; {_REMEDY}"
        )
    low = lifts[enough[0]]
    high = low + 2.0 * _REACH / (_PARTS - 1)
    for _ in range(_HALVES):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if carried(np.array([middle]))[0] >= 0.0 else (low, middle)
    return at(np.array([low]))[0]
