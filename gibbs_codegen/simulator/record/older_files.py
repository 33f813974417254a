"""What files of flights lack that earlier versions wrote."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.simulator.record.series import RANGES

Arrays = dict[str, NDArray[Any]]


def lacking(stored: Mapping[str, NDArray[Any]]) -> Arrays:
    """Fields that are not in a file, as far as they follow from what is.

    Args:
        stored: The arrays of a file.

    Returns:
        Their values. The ranges of inputs are those of the samples alone.
    """
    found = {} if "parents" in stored else _before_trees(stored)
    endless = np.full(len(stored["input_names"]), np.inf)
    later = {
        "law": np.array(""),
        "control_rate": np.array(0.0),
        "weight": np.array(np.nan),
        "input_limits": np.stack([-endless, endless]),
        "timing": np.array(""),
        "binding": np.array([], dtype=str),
        "binding_times": np.zeros((0, 2)),
        "walls": np.zeros((0, 6)),
        "gusts": np.zeros((0, 2)),
        "frames": np.array([], dtype=str),
        "wall_forces": np.full((len(stored["time"]), len(stored.get("walls", ()))), np.nan),
        "frame_wrenches": np.zeros((len(stored["time"]), 0, 6)),
    }
    found |= {name: value for name, value in later.items() if name not in stored}
    for name in RANGES:
        if name not in stored:
            found[name] = stored[name.partition("_")[0]]
    return found


def _before_trees(stored: Mapping[str, NDArray[Any]]) -> Arrays:
    """What files lack that are from when all robots had base arms, angles and one serial arm.

    Args:
        stored: The arrays of a file.

    Returns:
        Attitude, units, parents and names. The sequence of the angles is not in such files; it
        makes no difference to what a flight has.
    """
    points, coordinates = stored["points"].tolist(), stored["coordinates"].tolist()
    rotors = len(stored["base_arm_angles_desired"]) + 1
    centre = points.index("O2") if "O2" in points else 0
    parents = np.full(len(points), -1)
    parents[centre + 1 : centre + rotors + 2] = centre
    parents[centre + rotors + 2 :] = np.arange(centre + rotors + 1, len(points) - 1)
    units = ["rad" if name.startswith("theta_") else "m" for name in coordinates]
    return {
        "attitude": np.array("xyz"),
        "coordinate_units": np.array(units),
        "parents": parents,
        "constraint_names": np.array([f"tau_prime_{k}" for k in range(2, rotors + 1)], dtype=str),
    }
