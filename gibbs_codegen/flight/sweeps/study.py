"""A study: the table of a sweep's results, with its evaluations."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError, printable, require
from gibbs_codegen.figures import FORMATS
from gibbs_codegen.files.staging import staging_folder, writing
from gibbs_codegen.flight.sweeps.cases import Case, Cases
from gibbs_codegen.flight.sweeps.chunks import REASONS, Row
from gibbs_codegen.flight.sweeps.sensitivity import Sensitivity, sensitivities
from gibbs_codegen.flight.sweeps.sources import StrPath

_TABLE, _CSV, _CASES = "table.npy", "table.csv", "cases.json"
# Files that `gibbs_codegen.flight.figures.study` leaves beside them.
_FIGURES = [f"{n}.{s}" for n in ("distributions", "worst_cases", "sensitivities") for s in FORMATS]
# Columns that every table has.
FIXED = ("case", "robot", "scenario", *REASONS)


class Spread(NamedTuple):
    """The spread of a measure over `flights` that went on to their end; NaN if there is none."""

    measure: str
    flights: int
    least: float
    percent_5: float
    median: float
    percent_95: float
    greatest: float


class Worst(NamedTuple):
    """A case, its value of a measure, why it stopped ("" if not), and what flies it again."""

    case: int
    value: float
    stopped: str
    command: str


@dataclass(frozen=True)
class Study:
    """The result of a sweep: a row for each case.

    Attributes:
        folder: where it is kept.
        cases: the flights, in the order of the rows.
        table: a structured array with the columns `case`, `robot` and `scenario`, one for each key
            that varies, one for each measure, `stopped`, which says why a flight ended early,
            `failed`, which says why there is none, and `unmeasured`, which says why a measure could
            not be taken of it. Measures that there are not are NaN.
    """

    folder: Path
    cases: Sequence[Case]
    table: NDArray[Any]

    @property
    def keys(self) -> tuple[str, ...]:
        """The keys that vary, as `sweep` was given them."""
        return tuple(self.cases[0].values) if self.cases else ()

    @property
    def measures(self) -> tuple[str, ...]:
        """Names of the measures."""
        others = {*FIXED, *self.keys}
        return tuple(name for name in self.table.dtype.names or () if name not in others)

    @property
    def failures(self) -> NDArray[Any]:
        """The rows of cases that gave no flight; `failed` says why."""
        return self.table[self.table["failed"] != ""]

    @property
    def stopped(self) -> NDArray[Any]:
        """The rows of flights that ended early; `stopped` says why."""
        return self.table[self.table["stopped"] != ""]

    @property
    def unmeasured(self) -> NDArray[Any]:
        """The rows of flights of which a measure could not be taken; `unmeasured` says why."""
        return self.table[self.table["unmeasured"] != ""]

    @cached_property
    def whole(self) -> NDArray[Any]:
        """The rows of flights that went on to their end."""
        flew = (self.table["failed"] == "") & (self.table["stopped"] == "")
        return self.table[flew]

    def summary(self) -> list[Spread]:
        """The spread of each measure over the flights that went on to their end."""
        spreads = []
        for measure in self.measures:
            values = self.whole[measure]
            values = values[np.isfinite(values)]
            numbers = [math.nan] * 5
            if len(values):
                numbers = np.percentile(values, [0.0, 5.0, 50.0, 95.0, 100.0]).tolist()
            spreads.append(Spread(measure, len(values), *numbers))
        return spreads

    def worst(self, measure: str, count: int = 5, smallest: bool = False) -> list[Worst]:
        """The flights with the greatest values of a measure, those that ended early among them.

        Args:
            measure: The measure.
            count: How many.
            smallest: Whether small values are the bad ones.

        Returns:
            The cases, the worst first.

        Raises:
            UsageError: If there is no such measure.
        """
        values = self._column(measure)
        # NaN is neither great nor small; equal values stay in the order of the cases.
        order = np.argsort(values if smallest else -values, kind="stable")
        order = order[np.isfinite(values[order])][:count]
        stopped = self.table["stopped"]
        return [
            Worst(int(row), float(values[row]), str(stopped[row]), self.command(int(row)))
            for row in order
        ]

    def command(self, case: int) -> str:
        """The command line that flies a case again, for a shell.

        Args:
            case: Its number.

        Returns:
            Such as `gibbs-codegen simulate hexarotor_3link --scenario hover --set duration=5`.
        """
        chosen = self.cases[case]
        words = ["gibbs-codegen", "simulate", chosen.robot, "--scenario", chosen.scenario]
        for key, value in chosen.changes.items():
            words += ["--set", f"{key}={_toml(value)}"]
        return shlex.join(words)

    def sensitivity(self, measure: str) -> list[Sensitivity]:
        """The share of a measure that each key explains, over flights that went on to their end.

        Robot and scenario count as keys where there are several.

        Args:
            measure: The measure.

        Returns:
            What `sensitivity` says of each key, those that explain most first.

        Raises:
            UsageError: If there is no such measure.
        """
        self._column(measure)
        rows = self.whole[np.isfinite(self.whole[measure])]
        columns = {key: rows[key] for key in ("robot", "scenario", *self.keys)}
        # NaN, which is unlike itself: a robot that has no such parameter.
        varied = {k: c for k, c in columns.items() if len(np.unique(c[c == c])) > 1}
        shares = sensitivities(varied, rows[measure])
        return sorted(shares, key=lambda share: -np.nansum([share.alone, share.joint]))

    def to_parquet(self, path: StrPath) -> None:
        """Write the table as Parquet, which pandas, polars, DuckDB, Julia, R and MATLAB read.

        Args:
            path: The file.

        Raises:
            UsageError: If `pyarrow` is not installed, which the extra of that name brings.
            OutputError: If the file cannot be written.
        """
        require("pyarrow", "Parquet")
        import pyarrow
        from pyarrow import parquet

        columns = {name: self.table[name].tolist() for name in self.table.dtype.names or ()}
        with writing(path):
            parquet.write_table(pyarrow.table(columns), path)

    def save(self) -> None:
        """Write the study into its folder, where `read_study` finds it.

        The files are `table.npy`, the same table as `table.csv`, and `cases.json`, which comes last
        and has the digest of the table that it belongs to. Figures of another table are removed.

        Raises:
            OutputError: If they cannot be written; earlier files remain.
        """
        with writing(self.folder), staging_folder(self.folder) as new:
            written = io.BytesIO()  # What NumPy writes has no words for a full disk.
            np.save(written, self.table, allow_pickle=False)
            (new / _TABLE).write_bytes(written.getvalue())
            with (new / _CSV).open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(self.table.dtype.names or ())
                writer.writerows(self.table.tolist())
            cases = [json.dumps(vars(case)) for case in self.cases]
            lines = ",\n".join(cases)
            digest = json.dumps(_digest(new / _TABLE))
            contents = f'{{"table": {digest}, "cases": [\n{lines}\n]}}\n'
            (new / _CASES).write_text(contents, encoding="utf-8")
            old = self.folder / _TABLE
            if old.exists() and _digest(old) != _digest(new / _TABLE):
                for name in _FIGURES:
                    (self.folder / name).unlink(missing_ok=True)
            for name in (_CSV, _TABLE, _CASES):
                os.replace(new / name, self.folder / name)

    def _column(self, measure: str) -> NDArray[np.float64]:
        """The values of a measure, which must exist."""
        if measure not in self.measures:
            measures = ", ".join(self.measures)
            raise UsageError(f"{printable(measure)}: no such measure; there are {measures}")
        return self.table[measure]


def read_study(folder: StrPath) -> Study:
    """The study that a sweep left.

    Args:
        folder: Where it is, as `out` of `sweep`.

    Returns:
        The study.

    Raises:
        UsageError: If there is no study, or it is incomplete.
    """
    place = Path(folder)
    if not place.is_dir():
        raise UsageError(f"{printable(folder)}: there is no such folder")
    try:
        contents = json.loads((place / _CASES).read_text("utf-8"))
        digest, cases = contents["table"], [Case(**case) for case in contents["cases"]]
        table = np.load(place / _TABLE, allow_pickle=False)
        fits = _digest(place / _TABLE) == digest
    except (OSError, TypeError, ValueError, KeyError) as error:
        raise _no_study(folder, error) from None
    if not fits:
        why = f"{_TABLE} and {_CASES} are of different studies; call the sweep again"
        raise _no_study(folder, why)
    return Study(place, cases, table)


def _digest(path: Path) -> str:
    """The SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _no_study(folder: StrPath, why: object) -> UsageError:
    return UsageError(f"{printable(folder)}: contains no finished study: {printable(why)}")


def _toml(value: Any) -> str:
    """A value as `--set` takes it, which reads back exactly."""
    if value is None:
        return ""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else repr(value)


def table_of(cases: Cases, measures: Sequence[str], rows: Sequence[Row]) -> NDArray[Any]:
    """The table of a sweep: a structured array with a row for each case."""
    heads = [(case.index, case.robot, case.scenario, *case.values.values()) for case in cases]
    values, *reasons = zip(*rows, strict=True)
    names = ("case", "robot", "scenario", *cases.columns, *measures, *REASONS)
    entries = (*zip(*heads, strict=True), *zip(*values, strict=True), *reasons)
    columns = dict(zip(names, map(_column, entries), strict=True))
    table = np.zeros(len(rows), [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return table


def _column(values: Sequence[Any]) -> NDArray[Any]:
    """Numbers or switches as an array of these; a mixture, or anything else, as texts."""
    array = np.asarray(values)
    return array if array.dtype.kind in "iufb" else np.array([str(value) for value in values])
