"""Chunks of a sweep: cases that are flown together, a few seconds of work; and how it is done.

What is known of each case is kept on the disk in one file, a line for each, by a digest of all that
determines it: so the same call finds it again, however its cases are cut into chunks.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
import os
import pickle
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.errors import GibbsCodegenError, OutputError, cause_of, printable
from gibbs_codegen.flight.many import fits_blocks, simulate_many
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.sweeps.cases import Axis, Block, Cases
from gibbs_codegen.flight.sweeps.fingerprint import fingerprint
from gibbs_codegen.flight.sweeps.measures import Measure, of_flight, words_of
from gibbs_codegen.flight.sweeps.sources import ScenarioSource
from gibbs_codegen.runtime.load import load
from gibbs_codegen.version import __version__

# What a chunk is to take at most, s; how many flights, and samples of them, may be in memory.
_SECONDS, _MOST_FLIGHTS, _MOST_SAMPLES = 4.0, 256, 256_000
# Entries in which flights may differ that `simulate_many` computes side by side.
_SIDE_BY_SIDE = ("plant.", "start.", "motors.time_constant")
# After so long a worker hands over what it has flown, to be kept.
_HANDED_OVER = 4.0
_LONGEST_REASON = 400
# The file of a study's folder with the results of each case.
FILE = "flights.jsonl"
_BROKEN = "%s: %d lines are damaged or were changed; their flights are repeated"
# Texts of a row: why a flight ended early, why there is none, why a measure could not be taken.
REASONS = ("stopped", "failed", "unmeasured")
# The measures of a flight, and its `REASONS`.
Row = tuple[list[float], str, str, str]

_log = logging.getLogger("gibbs_codegen")


@dataclass(frozen=True, eq=False)
class Chunk:
    """Cases of one block, by their `places` in it, whose first case is number `first` of all.

    `deaths` is how often a worker died that flew them.
    """

    block: Block
    first: int
    places: Sequence[int]
    deaths: int = 0

    def __len__(self) -> int:
        """The number of cases."""
        return len(self.places)

    @property
    def cases(self) -> list[int]:
        """Numbers of the cases."""
        return [self.first + place for place in self.places]

    def after(self, count: int) -> Chunk:
        """The chunk without its first cases."""
        return replace(self, places=self.places[count:])

    def halves(self) -> tuple[Chunk, Chunk]:
        """The first and the second half."""
        middle = len(self) // 2
        return replace(self, places=self.places[:middle]), self.after(middle)

    def task(self, measures: bytes) -> Task:
        """The task of a worker, with packed measures."""
        robot, block = self.block.robot, self.block
        changes = [block.chosen(place)[1] for place in self.places]
        folder, blocks = str(robot.folder), _forms_blocks(block)
        return Task(folder, robot.digest, block.scenario, changes, measures, blocks)


def chunks_of(cases: Cases, lacking: Sequence[bool]) -> list[Chunk]:
    """The chunks of those cases that are lacking, in their order, none with cases of two blocks."""
    chunks = []
    for block, first in zip(cases.blocks, cases.begins, strict=False):
        places, size = [p for p in range(len(block)) if lacking[first + p]], _flights(block)
        for begin in range(0, len(places), size):
            chunks.append(Chunk(block, first, places[begin : begin + size]))
    return chunks


def digests_of(cases: Cases, measures: Mapping[str, Measure]) -> list[str]:
    """For each case the SHA-256, in hexadecimal digits, of all that determines its results."""
    digests = []
    for block in cases.blocks:
        source, chosen = (block.scenario.text, block.scenario.scenario), list(measures.values())
        common = (__version__, block.robot.digest, *source, chosen, _forms_blocks(block))
        shared = fingerprint(*common)
        for place in range(len(block)):
            changes = json.dumps(block.chosen(place)[1], default=fingerprint)
            digests.append(hashlib.sha256(f"{shared}{changes}".encode()).hexdigest())
    return digests


def only_adaptive(cases: Cases) -> bool:
    """True if only the adaptive integration keeps all cases from being side by side."""
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
    """True if every flight of a block can share blocks with others.

    Axes alone decide, so that the same call flies the same cases alone, however they are cut.
    """
    listed = [axis for axis in block.axes if len(axis.varied.levels) > 1]
    drawn = [axis for axis in block.axes if axis.varied.draw is not None and block.samples > 1]
    return any(map(_keeps_blocks, listed)) or (bool(drawn) and all(map(_keeps_blocks, drawn)))


def _keeps_blocks(axis: Axis) -> bool:
    """True if flights that differ along an axis can be side by side."""
    return all(key.startswith(_SIDE_BY_SIDE) for key in axis.targets)


def _flights(block: Block) -> int:
    """The number of flights of a block in a chunk, by the time of its first on one core, s."""
    try:
        scenario = block.scenario.changed(block.chosen(0)[1])
    except GibbsCodegenError:
        return _MOST_FLIGHTS
    settings, samples = scenario.integration, _samples(scenario)
    steps = scenario.duration / settings.step if settings.method == "rk4" else 0.0
    if _forms_blocks(block) and fits_blocks(scenario):
        seconds = 2e-3 + 3e-7 * steps + 3e-6 * samples
    else:
        seconds = 0.05 + 0.03 * scenario.duration + 1e-5 * steps + 2e-5 * samples
    return max(int(min(_SECONDS / seconds, _MOST_FLIGHTS)), 1)


def _samples(scenario: Scenario | Exception) -> float:
    """The number of samples that a flight keeps."""
    if isinstance(scenario, Exception):
        return 0.0
    return scenario.duration * scenario.integration.rate


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


def fly(task: Task) -> list[Row]:
    """Fly the first cases of a chunk, as many as take some seconds but at least one.

    Raises `UsageError` if there is no module, or the measures cannot be unpacked here.
    """
    module = _module(task.folder, task.digest)
    measures = pickle.loads(task.measures)  # noqa: S301
    rows: list[Row] = []
    left, size = _HANDED_OVER, 1  # How long flights take shows with the first.
    while len(rows) < len(task.changes) and (left > 0.0 or not rows):
        begin = time.monotonic()
        some = task.changes[len(rows) : len(rows) + size]
        scenarios = [_scenario(task.scenario, change) for change in some]
        fit = np.cumsum([_samples(case) for case in scenarios]) <= _MOST_SAMPLES
        scenarios = scenarios[: max(int(np.count_nonzero(fit)), 1)]
        flights = _flights_of_cases(module, scenarios, task.blocks)
        flights.reverse()
        while flights:  # A flight takes a megabyte once it has been measured: they go one by one.
            rows.append(_measured(measures, flights.pop()))
        spent = max(time.monotonic() - begin, 1e-3)  # Not every clock is finer.
        left -= spent
        size = max(int(left / spent * len(scenarios)), 1)
    return rows


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
    sound = [case for case in scenarios if not isinstance(case, Exception)]
    flights_of_sound: list[Flight | Exception] = []
    try:
        flights_of_sound += simulate_many(module, sound, blocks=blocks)
    except Exception as error:  # One of them is to blame: flights by themselves show which.
        words = printable(words_of(error))
        _log.warning("%s: flights are computed one by one: %s", module.NAME, words)
        for scenario in sound:
            try:
                flights_of_sound += simulate_many(module, [scenario], blocks=blocks)
            except Exception as error:
                flights_of_sound.append(error)
    flights = iter(flights_of_sound)
    return [case if isinstance(case, Exception) else next(flights) for case in scenarios]


def _measured(measures: Mapping[str, Measure], flight: Flight | Exception) -> Row:
    """Measures of a flight, if there is one, and its `REASONS`."""
    if not isinstance(flight, Exception):
        values, why = of_flight(measures, flight)
        return values, printable(flight.stopped, _LONGEST_REASON), "", why
    return [math.nan] * len(measures), "", printable(words_of(flight), _LONGEST_REASON), ""


class ResultFile:
    """The rows of cases, by their digests, in a file of the folder of a study.

    A line of it has a digest, the row, and the SHA-256 of both.
    """

    def __init__(self, folder: Path, wanted: Collection[str]) -> None:
        """Read the rows that are wanted; `OutputError` is raised if they cannot be read."""
        self._path = folder / FILE
        self.rows: dict[str, Row] = {}
        broken = 0
        try:
            with self._path.open("rb") as file:
                for line in file:
                    digest, _, rest = line.rstrip().partition(b" ")
                    row, _, seal = rest.rpartition(b" ")
                    if seal != _seal(digest, row):
                        broken += bool(line.strip())
                    elif (name := digest.decode()) in wanted:
                        values, *reasons = json.loads(row)
                        self.rows[name] = (values, *reasons)
        except FileNotFoundError:
            return
        except OSError as error:
            raise OutputError(
                f"{printable(self._path)}: cannot be read: {cause_of(error)}"
            ) from None
        if broken:
            _log.warning(_BROKEN, printable(self._path), broken)

    def add(self, digests: Sequence[str], rows: Sequence[Row]) -> None:
        """Keep rows; `OutputError` is raised if they cannot be written."""
        self.rows |= zip(digests, rows, strict=True)
        lines = [b""]  # What an earlier program did not end stands on a line of its own.
        for digest, row in zip(digests, rows, strict=True):
            key, text = digest.encode(), json.dumps(row).encode()
            lines.append(b" ".join((key, text, _seal(key, text))))
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("ab") as file:
                file.write(b"\n".join(lines) + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise OutputError(
                f"{printable(self._path.parent)}: cannot be written: {cause_of(error)}; finished "
                "flights are kept; repeat the call to continue"
            ) from None


def _seal(digest: bytes, row: bytes) -> bytes:
    """The seal at the end of a line, in hexadecimal digits."""
    return hashlib.sha256(digest + row).hexdigest().encode()
