"""Flights of files, of earlier versions too."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZipFile, is_zipfile

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError, cause_of, printable
from gibbs_codegen.flight.record.series import NO_ESTIMATES, NO_SERIES, RANGES, StrPath
from gibbs_codegen.flight.record.series import Array as Array
from gibbs_codegen.flight.record.series import Flight as Flight

Arrays = dict[str, NDArray[Any]]
# Fields that are one number, and those of several that may have no row per sample; forces of walls
# and contacts are lacking in a flight made by hand.
_NUMBERS: dict[str, Any] = {"control_rate": float, "tangent_arm": int}
_NUMBERS |= {"weight": float, "gravity": float}
_OF_NO_TIME = NO_SERIES | {"parents", "thrust_directions", "wall_forces", "commands", "actuators"}
_OF_NO_TIME |= {"hold_errors", "hold_forces", "sensors", "battery", *NO_ESTIMATES}
_OF_NO_TIME |= {f"contact_{quantity}" for quantity in ("forces", "friction", "slip", "depth")}
_WANTED = "give a flight.npz that `gibbs-codegen simulate` or write_npz wrote"


def _lacking(stored: Mapping[str, NDArray[Any]]) -> Arrays:
    """Values of fields that are not in a file's arrays, and follow from these.

    The ranges of inputs are those of the samples alone.
    """
    defaults = {} if "parents" in stored else _before_trees(stored)
    samples = len(stored["time"])
    endless = np.full(len(stored["input_names"]), np.inf)
    defaults |= {
        "input_limits": np.stack([-endless, endless]),
        "wall_forces": np.full((samples, len(stored.get("walls", ()))), np.nan),
        "frame_wrenches": np.zeros((samples, 0, 6)),
    }
    return defaults | {name: stored[name.partition("_")[0]] for name in RANGES}


def _before_trees(stored: Mapping[str, NDArray[Any]]) -> Arrays:
    """Fields for files from the time when all robots had base arms, angles and one serial arm.

    Attitude, units, parents and names. The sequence of the angles is not in such files; it makes no
    difference to what a flight has.
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


def read_flight(path: StrPath) -> Flight:
    """The flight of an `.npz` file that `write_npz` wrote, with the same numbers bit by bit.

    Args:
        path: The file, or the folder with a `flight.npz` that `simulate` wrote.

    Returns:
        The flight.

    Raises:
        UsageError: If the file is not such a one.
    """
    try:
        # Opened here: what `np.load` opens it leaves open where it is not an archive.
        with (flight_file(path) or Path(path)).open("rb") as file:
            return _stored(file)
    except OSError as error:
        why: object = cause_of(error)
    except KeyError as error:
        why = f"it has no array {error.args[0]}"
    except UsageError as error:
        why = error
    except Exception:  # Archives can be broken in many ways.
        why = "it is damaged, or its arrays are not those of a flight"
    raise UsageError(f"{printable(path)}: is not a saved flight: {printable(why)}; {_WANTED}")


def _stored(file: BinaryIO) -> Flight:
    """The flight in an open file; whatever is wrong with it raises some exception."""
    if not is_zipfile(file):
        empty = file.seek(0, os.SEEK_END) == 0
        raise UsageError(f"the file is {'empty' if empty else 'cut off, or no .npz file'}")
    file.seek(0)
    field_of = {field.name: field for field in fields(Flight)}
    with np.load(file, allow_pickle=False) as stored:
        held = {name: np.asarray(stored[name]) for name in field_of if name in stored}
    values: dict[str, Any] = _lacking(held) | held
    for name, value in values.items():
        kind = str(field_of[name].type)
        is_text = "str" in kind
        if value.dtype.kind not in ("U" if is_text else "iuf"):
            raise UsageError(f"{name} does not hold {'text' if is_text else 'numbers'}")
        if (is_text or name in _NUMBERS) and value.ndim != kind.startswith("tuple"):
            raise UsageError(f"{name} has the shape {value.shape}")
        if name in _NUMBERS:
            values[name] = _NUMBERS[name](value)
        elif is_text:
            values[name] = tuple(map(str, value)) if value.ndim else str(value)
        elif name not in _OF_NO_TIME and value.shape[:1] != values["time"].shape:
            raise UsageError(f"{name} must have as many rows as there are times")
    if not (np.diff(values["time"]) >= 0.0).all():
        raise UsageError("its time decreases, or is not a number; cut the flight there")
    return Flight(**values)


def is_flight(path: StrPath) -> bool:
    """True if a file is one that `write_npz` wrote, by the names of what it holds.

    False if it cannot be read.
    """
    try:
        with ZipFile(path) as archive:
            return {"robot.npy", "scenario.npy", "time.npy"} <= set(archive.namelist())
    except Exception:  # As above.
        return False


def flight_file(path: StrPath) -> Path | None:
    """The file of a flight in a folder that `simulate` wrote, or itself; None for anything else."""
    place = Path(path)
    if place.suffix == ".npz":
        return place
    inside = place / "flight.npz"
    return inside if inside.is_file() else None
