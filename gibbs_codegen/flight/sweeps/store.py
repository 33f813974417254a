"""What is kept of a sweep on the disk: a file for each chunk, with its first flights or all."""

from __future__ import annotations

import hashlib
import io
import logging
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import OutputError, cause_of, printable
from gibbs_codegen.files.staging import staging_folder

_FOLDER = "chunks"
_SEAL = hashlib.sha256().digest_size
REMOVED = "what a sweep wrote has been removed while it went on; call it again"
# Texts of a row: why a flight ended early, why there is none, why a measure could not be taken.
REASONS = ("stopped", "failed", "unmeasured")

Rows = NDArray[Any]

_log = logging.getLogger("gibbs_codegen")


def rows_of(measures: Sequence[Sequence[float]], *reasons: Sequence[str]) -> Rows:
    """A row for each flight: its measures, and a text for each of `REASONS`."""
    fields: list[Any] = [("measures", np.float64, (len(measures[0]),))]
    fields += zip(REASONS, map(_text_type, reasons), strict=True)
    rows = np.zeros(len(measures), fields)
    rows["measures"] = measures
    for name, texts in zip(REASONS, reasons, strict=True):
        rows[name] = texts
    return rows


def joined(parts: Sequence[Rows]) -> Rows:
    """Rows of several chunks, one after the other; texts are as wide as the longest."""
    measures: Any = np.concatenate([part["measures"] for part in parts])
    return rows_of(measures, *([t for part in parts for t in part[n].tolist()] for n in REASONS))


def npy(array: NDArray[Any]) -> bytes:
    """An array as a file of NumPy; what NumPy writes by itself has no words for a full disk."""
    written = io.BytesIO()
    np.save(written, array, allow_pickle=False)
    return written.getvalue()


def _text_type(texts: Sequence[str]) -> str:
    """The type of a column of texts, as wide as the longest; there is none of no width."""
    return f"U{max(1, *map(len, texts))}"


class Store:
    """The files of chunks in the folder of a study, by their digests."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._chunks = folder, folder / _FOLDER

    def read(self, digest: str) -> Rows | None:
        """The first rows of the chunk of a digest, as many as are kept; None if there are none.

        `OutputError` is raised if they cannot be read.
        """
        path = self._chunks / f"{digest}.npy"
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise OutputError(f"{printable(path)}: cannot be read: {cause_of(error)}") from None
        rows, seal = content[:-_SEAL], content[-_SEAL:]
        if seal == _seal(digest, rows):
            found: Rows = np.load(io.BytesIO(rows), allow_pickle=False)
            return found
        why = "is broken or was changed: its rows and its last bytes, their digest, don't agree"
        _log.warning("%s: %s; its flights are flown again", printable(path), why)
        with suppress(OSError):
            path.unlink()
        return None

    def add(self, digest: str, kept: int, rows: Rows) -> Rows:
        """Keep rows after the first `kept` ones, written aside and renamed, and return all.

        `OutputError` is raised if they cannot be written, or the first ones have been removed.
        """
        before = self.read(digest)
        if before is not None and len(before) >= kept + len(rows):
            return before  # The same call in another program was faster.
        if kept and (before is None or len(before) < kept):
            raise OutputError(REMOVED)
        whole = rows if before is None else joined([before[:kept], rows])
        content = npy(whole)
        try:
            self._chunks.mkdir(parents=True, exist_ok=True)
            with staging_folder(self._folder) as new:
                with (new / "rows.npy").open("wb") as file:
                    file.write(content + _seal(digest, content))
                    file.flush()
                    os.fsync(file.fileno())
                os.replace(new / "rows.npy", self._chunks / f"{digest}.npy")
        except OSError as error:
            raise OutputError(
                f"{printable(self._folder)}: cannot be written: {cause_of(error)}; what was done "
                "is kept, and the same call goes on from there"
            ) from None
        return whole


def _seal(digest: str, rows: bytes) -> bytes:
    """What stands at the end of a file: the SHA-256 of what determines its rows and of the rows."""
    return hashlib.sha256(digest.encode() + rows).digest()
