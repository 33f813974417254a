"""The axis along which the rotors of an underactuated base push."""

from __future__ import annotations

import numpy as np

from gibbs_codegen.simulator.plant.allocation import ranks
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle

# Of the wrenches that such rotors command: the force along the axis, and three moments.
_DIRECTIONS = 4


def thrust_axis(vehicle: Vehicle, q: Array) -> Array | None:
    """The axis along which rotors push, if they command a force along it and three moments.

    Args:
        vehicle: The robot.
        q: Configurations (…, nq).

    Returns:
        Unit vectors (…, 3) in the base's frame, along the thrust of the first rotor; None if at
        some configuration the rotors command other wrenches.
    """
    wrenches = vehicle.thrust_wrenches(q)
    if np.any(ranks(wrenches) != _DIRECTIONS) or np.any(ranks(wrenches[..., :3, :]) != 1):
        return None
    return force_axis(wrenches)


def force_axis(wrenches: Array) -> Array:
    """The axis along which the first rotor pushes, as all do of those that have one.

    Args:
        wrenches: Wrenches of unit thrusts (…, 6, N), as `Vehicle.thrust_wrenches` has them.

    Returns:
        Unit vectors (…, 3) in the base's frame.
    """
    force = wrenches[..., :3, 0]
    axis: Array = force / np.linalg.norm(force, axis=-1, keepdims=True)
    return axis
