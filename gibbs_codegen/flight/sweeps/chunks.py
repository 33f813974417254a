"""Chunks of a sweep: cases that are flown and kept together, 1 to 10 s of work; and how it is done.

A chunk is kept on the disk in a file of its own, with its first flights or all.
How a sweep is cut depends on its cases alone, so that the same call finds the same chunks.
"""

from __future__ import annotations

import hashlib
import io
import json
import logging
import math
import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import GibbsCodegenError, OutputError, cause_of, printable
from gibbs_codegen.files.staging import staging_folder
from gibbs_codegen.flight.many import fits_blocks, simulate_many
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.sweeps.cases import Axis, Block, Cases
from gibbs_codegen.flight.sweeps.fingerprint import fingerprint
from gibbs_codegen.flight.sweeps.measures import Measure, of_flight, packed, unpacked
from gibbs_codegen.flight.sweeps.sources import ScenarioSource
from gibbs_codegen.runtime.load import load
from gibbs_codegen.version import __version__

# What a chunk is to take at most, s; how many flights, and samples of them, may be in memory.
_SECONDS, _MOST_FLIGHTS, _MOST_SAMPLES = 4.0, 256, 256_000
# Entries in which flights may differ that `simulate_many` computes side by side.
_SIDE_BY_SIDE = ("plant.", "start.", "motors.time_constant")
# Entries that decide how long a flight takes.
_OF_LENGTH = ("duration", "integration", "control.rate")
# After so long a worker hands over what it has flown, to be kept.
_HANDED_OVER = 4.0
_LONGEST_REASON = 400

_log = logging.getLogger("gibbs_codegen")


@dataclass(frozen=True, eq=False)
class Chunk:
    """Cases `begin` to before `end` of one block, whose first case is number `first` of all."""

    block: Block
    first: int
    begin: int
    end: int

    def __len__(self) -> int:
        """How many cases there are."""
        return self.end - self.begin

    @property
    def rows(self) -> slice:
        """Numbers of the cases."""
        return slice(self.first + self.begin, self.first + self.end)

    def after(self, count: int) -> Chunk:
        """What is left after the first cases."""
        return replace(self, begin=self.begin + count)

    def halves(self) -> tuple[Chunk, Chunk]:
        """The first and the second half."""
        middle = (self.begin + self.end) // 2
        return replace(self, end=middle), replace(self, begin=middle)


def chunks_of(cases: Cases) -> list[Chunk]:
    """The chunks of a sweep, in the order of the cases, none with cases of two blocks."""
    found = []
    for block, first in zip(cases.blocks, cases.begins, strict=False):
        size, samples = _flights(block), block.samples
        # Samples of a combination are cut where they would be if there were more of them.
        stride = samples if samples >= size else size // samples * samples
        for outer in range(0, len(block), stride):
            end = min(outer + stride, len(block))
            for begin in range(outer, end, size):
                found.append(Chunk(block, first, begin, min(begin + size, end)))
    return found


def only_adaptive(cases: Cases) -> bool:
    """Whether nothing but the adaptive integration keeps all cases from being side by side."""
    for block in cases.blocks:
        try:
            scenario = block.scenario.changed(block.chosen(0)[1])
        except GibbsCodegenError:
            return False
        fixed = replace(scenario, integration=replace(scenario.integration, method="rk4"))
        adaptive = scenario.integration.method == "adaptive"
        if not (adaptive and fits_blocks(fixed) and _forms_blocks(block)):
            return False
    return True


def _forms_blocks(block: Block) -> bool:
    """Whether every flight of a block has others from which nothing keeps it in blocks apart.

    Axes alone decide, so that the same call flies the same cases alone, however they are cut.
    """
    listed = [axis for axis in block.axes if len(axis.varied.levels) > 1]
    drawn = [axis for axis in block.axes if axis.varied.draw is not None and block.samples > 1]
    return any(map(_keeps_blocks, listed)) or (bool(drawn) and all(map(_keeps_blocks, drawn)))


def _keeps_blocks(axis: Axis) -> bool:
    """Whether flights that differ in what an axis varies can be side by side."""
    return all(key.startswith(_SIDE_BY_SIDE) for key in axis.targets)


def _flights(block: Block) -> int:
    """How many flights of a block make a chunk."""
    in_blocks, entries = _forms_blocks(block), dict[str, Any]()
    fit = _fit(block, entries, in_blocks)
    for axis in block.axes:  # One after the other is set to what takes longest.
        if any(key.startswith(_OF_LENGTH) for key in axis.targets):
            drawn = block.drawn.get(axis.column, np.zeros(1))
            values = axis.varied.levels or (float(drawn.min()), float(drawn.max()))
            tried = [{**entries, **axis.entries(value)} for value in values]
            fits = [_fit(block, each, in_blocks) for each in tried]
            if min(fits) <= _MOST_FLIGHTS:
                fit = min(fits)
                entries = tried[fits.index(fit)]
    return min(fit, _MOST_FLIGHTS)


def _fit(block: Block, entries: Mapping[str, Any], in_blocks: bool) -> int:
    """How many flights of a block with some entries fit; if refused, more than may be."""
    try:
        scenario = block.scenario.changed(entries)
    except GibbsCodegenError:
        return _MOST_FLIGHTS + 1
    samples = scenario.duration * scenario.integration.rate
    most = min(_SECONDS / _seconds(scenario, in_blocks), _MOST_SAMPLES / samples, _MOST_FLIGHTS)
    return max(int(most), 1)


def _seconds(scenario: Scenario, in_blocks: bool) -> float:
    """What a flight will take on one core, s, roughly.

    `in_blocks` is whether there are others from which nothing keeps it in blocks apart.
    """
    settings, samples = scenario.integration, scenario.duration * scenario.integration.rate
    steps = scenario.duration / settings.step if settings.method == "rk4" else 0.0
    if in_blocks and fits_blocks(scenario):
        return 2e-3 + 3e-7 * steps + 3e-6 * samples
    return 0.05 + 0.03 * scenario.duration + 1e-5 * steps + 2e-5 * samples


@dataclass(frozen=True)
class Task:
    """The flights of a chunk: all that another process needs to know.

    `folder` is that of the robot's module, with the `digest` of its files. `changes` are the values
    of entries by key, for each flight. `measures` are packed. `blocks` is as of `simulate_many`.
    """

    folder: str
    digest: str
    scenario: ScenarioSource
    changes: Sequence[Mapping[str, Any]]
    measures: bytes
    blocks: bool


def fly(task: Task) -> Rows:
    """Fly the first cases of a chunk, as many as take some seconds but at least one.

    A row for each of these is as of `store.rows_of`. Raises `UsageError` if there is no module, or
    the measures cannot be unpacked here.
    """
    module, measures = _module(task.folder, task.digest), unpacked(task.measures)
    rows: list[Any] = []
    left, size = _HANDED_OVER, 1  # How long flights take shows with the first.
    while len(rows) < len(task.changes) and (left > 0.0 or not rows):
        begin = time.monotonic()
        some = task.changes[len(rows) : len(rows) + size]
        scenarios = [_scenario(task.scenario, each) for each in some]
        found = _flights_of_cases(module, scenarios, task.blocks)
        found.reverse()
        while found:  # A flight takes a megabyte once it has been measured: they go one by one.
            rows.append(_measured(measures, found.pop()))
        spent = max(time.monotonic() - begin, 1e-3)  # Not every clock is finer.
        left -= spent
        size = max(int(left / spent * len(some)), 1)
    return rows_of(*zip(*rows, strict=True))


@cache
def _module(folder: str, digest: str) -> ModuleType:
    """The module of a folder, which is loaded once as long as its digest is the same."""
    return load(folder, "c")


def _scenario(source: ScenarioSource, changes: Mapping[str, Any]) -> Scenario | Exception:
    """The scenario of a case, or why there is none."""
    try:
        return source.changed(changes)
    except Exception as error:  # Whatever values do to a scenario concerns their case only.
        return error


def _flights_of_cases(
    module: ModuleType, scenarios: Sequence[Scenario | Exception], blocks: bool
) -> list[Flight | Exception]:
    """For each scenario, or reason why there is none, the flight or why there is none."""
    sound = [each for each in scenarios if not isinstance(each, Exception)]
    found: list[Flight | Exception] = []
    try:
        found += simulate_many(module, sound, blocks=blocks)
    except Exception as error:  # One of them is to blame, which is told by flying it by itself.
        words = printable(f"{type(error).__name__}: {error}")
        _log.warning("%s: not flown side by side, but one by one: %s", module.NAME, words)
        for scenario in sound:
            try:
                found += simulate_many(module, [scenario], blocks=blocks)
            except Exception as error:
                found.append(error)
    flights = iter(found)
    return [each if isinstance(each, Exception) else next(flights) for each in scenarios]


def _measured(
    measures: Mapping[str, Measure], flight: Flight | Exception
) -> tuple[list[float], str, str, str]:
    """Measures of a flight, if there is one, and its texts of `store.REASONS`."""
    if not isinstance(flight, Exception):
        values, why = of_flight(measures, flight)
        return values, printable(flight.stopped, _LONGEST_REASON), "", why
    own = isinstance(flight, GibbsCodegenError)
    words = str(flight) if own else f"{type(flight).__name__}: {flight}"
    return [math.nan] * len(measures), "", printable(words, _LONGEST_REASON), ""


class Job:
    """Flights and measures."""

    def __init__(self, measures: Mapping[str, Measure]) -> None:
        self.measures = dict(measures)
        self._packed = packed(measures)
        self._digests: dict[tuple[int, int], str] = {}
        self._of_measures = fingerprint(list(self.measures.values()))

    def task(self, chunk: Chunk) -> Task:
        """What a worker is told: the flights of a chunk."""
        robot, scenario = chunk.block.robot, chunk.block.scenario
        blocks, changes = _forms_blocks(chunk.block), _changes(chunk)
        return Task(str(robot.folder), robot.digest, scenario, changes, self._packed, blocks)

    def digest(self, chunk: Chunk) -> str:
        """The SHA-256, in hexadecimal digits, of all that determines the results of a chunk."""
        place = (chunk.first + chunk.begin, len(chunk))
        if place not in self._digests:
            robot, scenario = chunk.block.robot, chunk.block.scenario
            changes = json.dumps(_changes(chunk), default=fingerprint)
            blocks, source = _forms_blocks(chunk.block), (scenario.text, scenario.scenario)
            parts = (robot.digest, *source, self._of_measures, changes, blocks)
            self._digests[place] = fingerprint(__version__, *parts)
        return self._digests[place]


def _changes(chunk: Chunk) -> list[dict[str, Any]]:
    """What each case of a chunk has of its own."""
    return [chunk.block.chosen(place)[1] for place in range(chunk.begin, chunk.end)]


_FOLDER = "chunks"
_SEAL = hashlib.sha256().digest_size
REMOVED = "what a sweep wrote has been removed while it went on; call it again"
# Texts of a row: why a flight ended early, why there is none, why a measure could not be taken.
REASONS = ("stopped", "failed", "unmeasured")

Rows = NDArray[Any]


def rows_of(measures: Sequence[Sequence[float]], *reasons: Sequence[str]) -> Rows:
    """A row for each flight: its measures, and a text for each of `REASONS`."""
    fields: list[Any] = [("measures", np.float64, (len(measures[0]),))]
    # Columns of texts are as wide as the longest; there is none of no width.
    widths = [f"U{max(1, *map(len, texts))}" for texts in reasons]
    fields += zip(REASONS, widths, strict=True)
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
            return np.load(io.BytesIO(rows), allow_pickle=False)
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
