"""A flight: the time series that a simulation leaves, and how they are written and read."""

from __future__ import annotations

import csv
import dataclasses
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np

from gibbs_codegen.errors import OutputError, UsageError, printable
from gibbs_codegen.simulator.record.columns import Column, columns_of
from gibbs_codegen.simulator.record.older_files import lacking
from gibbs_codegen.simulator.record.series import Array as Array
from gibbs_codegen.simulator.record.series import Series

StrPath = str | os.PathLike[str]

# Rows of the CSV that are written at a time.
_ROWS = 4096
# Fields that are one number, and those of several that have no row per sample.
_NUMBERS: dict[str, Any] = {"control_rate": float, "tangent_arm": int, "weight": float}
_OF_NO_TIME = {"input_limits", "base_arm_angles_desired", "parents", "thrust_directions"}
_OF_NO_TIME |= {"binding_times", "walls", "gusts"}
# Fields that a flight made by hand may lack.
_OF_NO_TIME |= {"wall_forces"}


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
            raise OutputError(f"{printable(path)}: cannot be written: {error.strerror}") from None

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
            raise OutputError(f"{printable(path)}: cannot be written: {error.strerror}") from None


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
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as stored:
            values: dict[str, Any] = dict(lacking(stored))
            names = [each.name for each in dataclasses.fields(Flight) if each.name not in values]
            values |= {name: stored[name] for name in names}
        return Flight(**_checked(values))
    except (OSError, TypeError, ValueError, KeyError, BadZipFile) as error:
        raise UsageError(
            f"{printable(path)}: is not a flight that was saved: {printable(error)}"
        ) from None


def _checked(stored: dict[str, Any]) -> dict[str, Any]:
    """Fields of a flight from the arrays of a file.

    Args:
        stored: The arrays by the names of the fields.

    Returns:
        The fields.

    Raises:
        ValueError: If an array is not what its field must be.
        TypeError: Likewise.
    """
    values = dict(stored)
    for name, value in stored.items():
        if name in _NUMBERS:
            values[name] = _NUMBERS[name](value)
        elif value.dtype.kind == "U":
            values[name] = str(value) if value.ndim == 0 else tuple(map(str, value))
        elif name not in _OF_NO_TIME and value.shape[:1] != np.shape(stored["time"]):
            raise ValueError(f"{name} has not as many rows as there are times")
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
    except (OSError, BadZipFile):
        return False
