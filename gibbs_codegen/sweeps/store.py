"""What is kept of a sweep on the disk: a file for each chunk that is done, whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import OutputError, printable
from gibbs_codegen.files.staging import staging_folder

_FOLDER = "chunks"
# Texts of a row: why a flight ended early, why there is none, why a measure could not be taken.
REASONS = ("stopped", "failed", "unmeasured")

Rows = NDArray[Any]


def rows_of(measures: Sequence[Sequence[float]], *reasons: Sequence[str]) -> Rows:
    """What is kept of flights.

    Args:
        measures: Measures of each flight.
        reasons: Texts of each flight, for each of `REASONS`.

    Returns:
        An array with a row for each flight.
    """
    fields: list[Any] = [("measures", np.float64, (len(measures[0]),))]
    fields += zip(REASONS, map(_text_type, reasons), strict=True)
    rows = np.zeros(len(measures), fields)
    rows["measures"] = measures
    for name, texts in zip(REASONS, reasons, strict=True):
        rows[name] = texts
    return rows


def joined(parts: Sequence[Rows]) -> Rows:
    """Rows of several chunks, one after the other.

    Args:
        parts: The rows of each.

    Returns:
        All rows; texts are as wide as the longest.
    """
    measures: Any = np.concatenate([part["measures"] for part in parts])
    return rows_of(measures, *([t for part in parts for t in part[n].tolist()] for n in REASONS))


def _text_type(texts: Sequence[str]) -> str:
    """The type of a column of texts, as wide as the longest; there is none of no width."""
    return f"U{max(1, *map(len, texts))}"


class Store:
    """The files of chunks in a folder, by their digests.

    Args:
        folder: The folder of the study.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._chunks = folder, folder / _FOLDER

    def read(self, digest: str, count: int) -> Rows | None:
        """The rows of a chunk.

        Args:
            digest: Of all that determines it.
            count: How many there must be.

        Returns:
            The rows; None if there are none, or the file is damaged.
        """
        try:
            rows: Rows = np.load(self._chunks / f"{digest}.npy", allow_pickle=False)
        except (OSError, ValueError, EOFError):
            return None
        whole = rows.dtype.names == ("measures", *REASONS) and len(rows) == count
        return rows if whole else None

    def write(self, digest: str, rows: Rows) -> None:
        """Keep the rows of a chunk: they are written aside, and renamed.

        Args:
            digest: Of all that determines it.
            rows: The rows.

        Raises:
            OutputError: If they cannot be written.
        """
        try:
            self._chunks.mkdir(parents=True, exist_ok=True)
            with staging_folder(self._folder) as new:
                with (new / "rows.npy").open("wb") as file:
                    np.save(file, rows, allow_pickle=False)
                    file.flush()
                    os.fsync(file.fileno())
                os.replace(new / "rows.npy", self._chunks / f"{digest}.npy")
        except OSError as error:
            raise OutputError(
                f"{printable(self._folder)}: cannot be written: {error.strerror}; what was done is "
                "kept, and the same call goes on from there"
            ) from None
