"""The axis along which the rotors of an underactuated base push."""

from __future__ import annotations

import numpy as np

from gibbs_codegen.simulator.plant.allocation import ranks
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle

# Of the wrenches that such rotors command: the force along the axis, and three moments.
_DIRECTIONS = 4
# Why such a base cannot fly without thrust.
LEANS_BY_THRUST = "without thrust nothing tells how the base must lean"


def thrust_axis(vehicle: Vehicle, q: Array) -> Array | None:
    """The axis along which rotors push, if they command a force along it and three moments.

    Unit vectors (…, 3) in the base's frame, along what equal thrusts of all rotors make; None if at
    some configuration (…, nq) the rotors command other wrenches.
    """
    wrenches = vehicle.thrust_wrenches(q)
    if np.any(ranks(wrenches) != _DIRECTIONS) or np.any(ranks(wrenches[..., :3, :]) != 1):
        return None
    return force_axis(wrenches)


def force_axis(wrenches: Array) -> Array:
    """Unit vectors (…, 3), base's frame, along which rotors push, as equal thrusts of all do.

    `wrenches` (…, 6, N) are those of unit thrusts.
    """
    forces = wrenches[..., :3, :]
    sizes = np.linalg.norm(forces, axis=-2, keepdims=True)
    largest = np.argmax(sizes, axis=-1, keepdims=True)
    force = np.take_along_axis(forces, largest, axis=-1)
    # Rotors may push either way; where as many push up as down, the greatest one decides.
    along = np.sum(forces * force, axis=(-2, -1), keepdims=True)
    axis: Array = (force / np.copysign(np.max(sizes, axis=-1, keepdims=True), along))[..., 0]
    return axis
