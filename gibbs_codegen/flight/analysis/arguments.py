"""Robots and coordinates that callers give, with errors that say what would be right."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.arguments import vector
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.runtime.load import load

# How far from 1 the length of a quaternion may be, which is then normalised.
_LENGTH = 1e-3


def coordinates(vehicle: Vehicle, values: ArrayLike) -> Array:
    """Coordinates (nq) of a robot, of which a quaternion is normalised.

    Raises `UsageError`, also if its length is not 1.
    """
    q = vector(f"q ({', '.join(vehicle.coordinates)})", values, len(vehicle.coordinates))
    length = float(np.linalg.norm(q[vehicle.layout.q.attitude]))
    if vehicle.layout.is_quaternion and abs(length - 1.0) > _LENGTH:
        raise UsageError(
            f"q: its quaternion {', '.join(vehicle.coordinates[vehicle.layout.q.attitude])} must "
            f"have the length 1, not {length:.4g}"
        )
    return vehicle.kinematics.normalised(q)


def vehicle_of(
    robot: ModuleType | str | os.PathLike[str], parameters: Mapping[str, float] | None = None
) -> Vehicle:
    """Functions and layout of a module, loaded by name or path if need be, with parameters.

    Its back end is "numpy" or "c". Raises `UsageError` if there is no such module or parameter, or
    for another back end.
    """
    module = load(robot) if isinstance(robot, str | os.PathLike) else robot
    return Vehicle(module, parameters)
