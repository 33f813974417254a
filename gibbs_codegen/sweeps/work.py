"""What a worker does: it flies the cases of a chunk, and returns their measures."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

from gibbs_codegen.errors import GibbsCodegenError, printable
from gibbs_codegen.sweeps.sources import ScenarioSource

if TYPE_CHECKING:
    from gibbs_codegen.scenario.scenario import Scenario
    from gibbs_codegen.simulator.record.flight import Flight
    from gibbs_codegen.sweeps.measures import Measure
    from gibbs_codegen.sweeps.store import Rows

_LONGEST_REASON = 400
# After so long a worker hands over what it has flown, to be kept.
_SECONDS = 4.0

_log = logging.getLogger("gibbs_codegen")


@dataclass(frozen=True)
class Task:
    """The flights of a chunk: all that another process needs to know.

    `folder` is that of the robot's module, with the `digest` of its files. `changes` are the values
    of entries by key, for each flight. `measures` are packed.
    """

    folder: str
    digest: str
    scenario: ScenarioSource
    changes: Sequence[Mapping[str, Any]]
    measures: bytes


def fly(task: Task) -> Rows:
    """Fly the first cases of a chunk, as many as take some seconds but at least one.

    A row for each of these is as of `store.rows_of`. Raises `UsageError` if there is no module, or
    the measures cannot be unpacked here.
    """
    from gibbs_codegen.sweeps.measures import unpacked
    from gibbs_codegen.sweeps.store import rows_of

    module, measures = _module(task.folder, task.digest), unpacked(task.measures)
    rows: list[Any] = []
    left, size = _SECONDS, 1  # How long flights take shows with the first.
    while len(rows) < len(task.changes) and (left > 0.0 or not rows):
        begin = time.monotonic()
        some = task.changes[len(rows) : len(rows) + size]
        found = _flights(module, [_scenario(task.scenario, each) for each in some])
        found.reverse()
        while found:  # A flight takes a megabyte once it has been measured: they go one by one.
            rows.append(_measured(measures, found.pop()))
        spent = max(time.monotonic() - begin, 1e-3)  # Not every clock is finer.
        left -= spent
        size = max(int(left / spent * len(some)), 1)
    return rows_of(*zip(*rows, strict=True))


def dead_row(measures: int, reason: str) -> Rows:
    """The row, in an array of one, of a case that leaves no flight, and why."""
    from gibbs_codegen.sweeps.store import rows_of

    return rows_of([[math.nan] * measures], [""], [reason], [""])


@cache
def _module(folder: str, digest: str) -> ModuleType:
    """The module of a folder, which is loaded once as long as its digest is the same."""
    from gibbs_codegen.runtime.load import load

    return load(folder, "c")


def _scenario(source: ScenarioSource, changes: Mapping[str, Any]) -> Scenario | Exception:
    """The scenario of a case, or why there is none."""
    try:
        return source.changed(changes)
    except Exception as error:  # Whatever values do to a scenario concerns their case only.
        return error


def _flights(
    module: ModuleType, scenarios: Sequence[Scenario | Exception]
) -> list[Flight | Exception]:
    """For each scenario, or reason why there is none, the flight or why there is none."""
    from gibbs_codegen.simulator.many import simulate_many

    flown = [each for each in scenarios if not isinstance(each, Exception)]
    found: list[Flight | Exception] = []
    try:
        found += simulate_many(module, flown)
    except Exception as error:  # One of them is to blame, which is told by flying it by itself.
        words = printable(f"{type(error).__name__}: {error}")
        _log.warning("%s: not flown side by side, but one by one: %s", module.NAME, words)
        for scenario in flown:
            try:
                found += simulate_many(module, [scenario])
            except Exception as error:
                found.append(error)
    flights = iter(found)
    return [each if isinstance(each, Exception) else next(flights) for each in scenarios]


def _measured(
    measures: Mapping[str, Measure], flight: Flight | Exception
) -> tuple[list[float], str, str, str]:
    """Measures of a flight, if there is one, and its texts of `store.REASONS`."""
    from gibbs_codegen.sweeps.measures import of_flight

    if not isinstance(flight, Exception):
        values, why = of_flight(measures, flight)
        return values, printable(flight.stopped, _LONGEST_REASON), "", why
    own = isinstance(flight, GibbsCodegenError)
    words = str(flight) if own else f"{type(flight).__name__}: {flight}"
    return [math.nan] * len(measures), "", printable(words, _LONGEST_REASON), ""
