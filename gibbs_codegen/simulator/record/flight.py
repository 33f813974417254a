"""A flight: the time series that a simulation leaves, and how they are written and read."""

from __future__ import annotations

import csv
import dataclasses
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import BadZipFile, ZipFile, is_zipfile

import numpy as np

from gibbs_codegen.errors import OutputError, UsageError, cause_of, printable
from gibbs_codegen.simulator.record.columns import Column, columns_of
from gibbs_codegen.simulator.record.older_files import lacking
from gibbs_codegen.simulator.record.series import RANGES, Series
from gibbs_codegen.simulator.record.series import Array as Array

StrPath = str | os.PathLike[str]

# Rows of the CSV that are written at a time.
_ROWS = 4096
# Fields that are one number.
_NUMBERS: dict[str, Any] = {"control_rate": float, "tangent_arm": int, "weight": float}
# Fields by their shapes. What has a letter has as many entries there as all others with it: s
# samples, q coordinates, v velocities, u inputs, k points, f frames, c constraints, a base arms.
_SHAPES: dict[str, tuple[str, ...]] = {
    "": ("robot", "scenario", "law", "attitude", "stopped", "timing", *_NUMBERS),
    "s": ("time", "heading_error", "kinetic_energy", "potential_energy", "work"),
    "q": ("coordinates", "coordinate_units"),
    "sq": ("q", "q_desired"),
    "sv": ("v", "a", "v_desired", "a_desired"),
    "u": ("input_names",),
    "su": ("commanded", "applied", *RANGES),
    "2u": ("input_limits",),
    "c": ("constraint_names",),
    "sc": ("constraint_torques",),
    "a": ("base_arm_angles_desired",),
    "sa": ("base_arm_angles",),
    "k": ("points", "parents"),
    "sk3": ("positions",),
    "s33": ("base_rotation",),
    "s3": ("centre_desired",),
    "st": ("tip_desired",),
    "f": ("frames",),
    "sf6": ("frame_wrenches",),
    "b": ("binding",),
    "b2": ("binding_times",),
    "w6": ("walls",),
    "g2": ("gusts",),
}
_WANTED = "give the flight.npz that `gibbs-codegen simulate` wrote, or what write_npz wrote"


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
    texts = {each.name for each in dataclasses.fields(Flight) if "str" in str(each.type)}
    thrusts = "sn3" if stored["thrust_directions"].ndim == 3 else "n3"
    shapes = {**_SHAPES, thrusts: ("thrust_directions",)}
    sizes: dict[str, int] = {}
    values: dict[str, Any] = {}
    for shape, name in ((shape, name) for shape, names in shapes.items() for name in names):
        array = stored[name]
        if array.dtype.kind not in ("U" if name in texts else "iuf"):
            raise ValueError(f"{name} does not hold {'text' if name in texts else 'numbers'}")
        if len(shape) != array.ndim or any(
            size != (int(letter) if letter.isdigit() else sizes.setdefault(letter, size))
            for letter, size in zip(shape, array.shape, strict=True)
        ):
            raise ValueError(f"{name} has the shape {array.shape}, which does not fit the others")
        if name in texts:
            array = tuple(map(str, array)) if shape else str(array)
        values[name] = _NUMBERS[name](array) if name in _NUMBERS else array
    return values


def is_flight(path: StrPath) -> bool:
    """Whether a file is one that `write_npz` wrote, by the names of what it holds.

    Args:
        path: The file.

    Returns:
        Whether it is; False if it cannot be read.
    """
    try:
        with ZipFile(path) as archive:
            return {"robot.npy", "scenario.npy", "time.npy"} <= set(archive.namelist())
    except (OSError, BadZipFile, NotImplementedError):
        return False
