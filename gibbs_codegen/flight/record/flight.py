"""A flight: the time series that a simulation leaves, and how they are written and read.

Files of earlier versions are read too.
"""

from __future__ import annotations

import csv
import dataclasses
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZipFile, is_zipfile

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import OutputError, UsageError, cause_of, printable
from gibbs_codegen.flight.record.series import RANGES, Column, Series, columns_of
from gibbs_codegen.flight.record.series import Array as Array

Arrays = dict[str, NDArray[Any]]
StrPath = str | os.PathLike[str]
# Rows of the CSV that are written at a time.
_ROWS = 4096
# Fields that are one number, and those of several that have no row per sample.
_NUMBERS: dict[str, Any] = {"control_rate": float, "tangent_arm": int, "weight": float}
_OF_NO_TIME = {"input_limits", "base_arm_angles_desired", "parents", "thrust_directions"}
_WANTED = "give the flight.npz that `gibbs-codegen simulate` wrote, or what write_npz wrote"


def lacking(stored: Mapping[str, NDArray[Any]]) -> Arrays:
    """Values of fields that are not in a file's arrays, as far as they follow from these.

    The ranges of inputs are those of the samples alone.
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
        "joint_limits": np.zeros((2, 0)),
        "wall_forces": np.full((len(stored["time"]), len(stored.get("walls", ()))), np.nan),
        "frame_wrenches": np.zeros((len(stored["time"]), 0, 6)),
    }
    found |= {name: value for name, value in later.items() if name not in stored}
    for name in RANGES:
        if name not in stored:
            found[name] = stored[name.partition("_")[0]]
    return found


def _before_trees(stored: Mapping[str, NDArray[Any]]) -> Arrays:
    """What files lack from when all robots had base arms, angles and one serial arm.

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


_OF_NO_TIME |= {"binding_times", "walls", "gusts"}
# Fields that a flight made by hand may lack.
_OF_NO_TIME |= {"wall_forces", "joint_limits"}


@dataclass(frozen=True)
class Flight(Series):
    """Time series of one flight, a row per sample, which can be written to files."""

    def columns(self) -> Iterator[Column]:
        """Name, unit and values (s) of every scalar series, time first."""
        return columns_of(self)

    def write_csv(self, path: StrPath) -> None:
        """Write every series as comma-separated values, `name [unit]` in the header.

        Args:
            path: The file. Its numbers are the shortest that read back exactly.

        Raises:
            OutputError: If it cannot be written.
        """
        columns = list(self.columns())
        try:
            with Path(path).open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(f"{name} [{unit}]" for name, unit, _ in columns)
                # Python's numbers take several times the room of NumPy's: some rows at a time.
                for begin in range(0, len(self.time), _ROWS):
                    rows = np.stack([v[begin : begin + _ROWS] for _, _, v in columns], axis=-1)
                    writer.writerows(rows.tolist())
        except OSError as error:
            raise OutputError(f"{printable(path)}: cannot be written: {cause_of(error)}") from None

    def write_npz(self, path: StrPath) -> None:
        """Write all fields to one `.npz` file, which `read_flight` reads.

        Args:
            path: The file.

        Raises:
            OutputError: If it cannot be written.
        """
        fields = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        # Without names there is nothing to tell that they are text.
        texts = {k: np.array(v, dtype=str) for k, v in fields.items() if isinstance(v, tuple)}
        try:
            np.savez_compressed(path, **(fields | texts))
        except OSError as error:
            raise OutputError(f"{printable(path)}: cannot be written: {cause_of(error)}") from None


def read_flight(path: StrPath) -> Flight:
    """The flight of an `.npz` file that `write_npz` wrote.

    Args:
        path: The file.

    Returns:
        The flight.

    Raises:
        UsageError: If the file is not such a one.
    """
    try:
        # Opened here: what `np.load` opens it leaves open where it is not an archive.
        with Path(path).open("rb") as file:
            return _stored(file)
    except OSError as error:
        why: object = cause_of(error)
    except KeyError as error:
        why = f"it has no array {error.args[0]}"
    except Exception as error:  # Archives can be broken in many ways.
        why = str(error) or type(error).__name__
    raise UsageError(
        f"{printable(path)}: is not a flight that was saved: {printable(why)}; {_WANTED}"
    )


def _stored(file: BinaryIO) -> Flight:
    """The flight in an open file; whatever is wrong with it raises some exception."""
    if not is_zipfile(file):
        empty = file.seek(0, os.SEEK_END) == 0
        raise ValueError(f"the file is {'empty' if empty else 'cut off, or no .npz file'}")
    file.seek(0)
    with np.load(file, allow_pickle=False) as stored:
        names = [each.name for each in dataclasses.fields(Flight)]
        held = {name: np.asarray(stored[name]) for name in names if name in stored}
    return Flight(**_checked(held | lacking(held)))


def _checked(stored: dict[str, Any]) -> dict[str, Any]:
    """Fields of a flight from the arrays of a file; `ValueError` if one is not what it must be."""
    values = dict(stored)
    for name, kind in ((each.name, str(each.type)) for each in dataclasses.fields(Flight)):
        value, is_text = stored[name], "str" in kind
        if value.dtype.kind not in ("U" if is_text else "iuf"):
            raise ValueError(f"{name} does not hold {'text' if is_text else 'numbers'}")
        if (is_text or name in _NUMBERS) and value.ndim != kind.startswith("tuple"):
            raise ValueError(f"{name} has the shape {value.shape}")
        if name in _NUMBERS:
            values[name] = _NUMBERS[name](value)
        elif is_text:
            values[name] = tuple(map(str, value)) if value.ndim else str(value)
        elif name not in _OF_NO_TIME and value.shape[:1] != np.shape(stored["time"]):
            raise ValueError(f"{name} has not as many rows as there are times")
    return values


def is_flight(path: StrPath) -> bool:
    """Whether a file is one that `write_npz` wrote, by the names of what it holds.

    False if it cannot be read.
    """
    try:
        with ZipFile(path) as archive:
            return {"robot.npy", "scenario.npy", "time.npy"} <= set(archive.namelist())
    except Exception:  # As above.
        return False
