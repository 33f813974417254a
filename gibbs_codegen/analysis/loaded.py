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
    """The functions and layout of a robot.

    Args:
        robot: A generated module with the back end "numpy" or "c", or the name or path of one,
            which is loaded.
        parameters: Parameters of the module's `prepare`; those left out keep their defaults.

    Returns:
        The robot.

    Raises:
        UsageError: There is no such module or parameter, or the module is of another back end.
    """
    module = load(robot) if isinstance(robot, str | os.PathLike) else robot
    return Vehicle(module, parameters)
