"""What ROBOT may be in the functions of this folder: a module, or the name or path of one."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import ModuleType

from gibbs_codegen.runtime.load import load
from gibbs_codegen.simulator.plant.vehicle import Vehicle


def vehicle_of(
    robot: ModuleType | str | os.PathLike[str], parameters: Mapping[str, float] | None = None
) -> Vehicle:
    """Functions and layout of a module, loaded by name or path if need be, with parameters.

    Its back end is "numpy" or "c". Raises `UsageError` if there is no such module or parameter, or
    for another back end.
    """
    module = load(robot) if isinstance(robot, str | os.PathLike) else robot
    return Vehicle(module, parameters)
