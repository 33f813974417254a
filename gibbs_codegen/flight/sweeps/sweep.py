"""Sweeps: many flights that differ in entries of their scenarios, on any executor, into a table.

    robot_source, scenario_source   words               → modules, scenarios       (sources)
    cases_of       parameters, samples                   → Cases                   (cases)
    digests_of     cases, measures                       → a digest for each case  (chunks)
    chunks_of      cases that the store lacks            → chunks, a few s each    (chunks)
    Execution      chunks, executor                      → store                   (execution)
      fly          a chunk, in a worker                  → measures of its flights (chunks)
    table_of       rows of all cases                     → Study                   (study)

A case's digest is of all that determines it: so the same call goes on where it was ended, be it by
force, and the table is the same whatever has computed it.
"""

from __future__ import annotations

import itertools
import logging
import math
import os
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.errors import GibbsCodegenError, ScenarioFileError, UsageError, printable
from gibbs_codegen.files.staging import check_output_folder
from gibbs_codegen.flight.arguments import whole
from gibbs_codegen.flight.desired.trajectory import Progress
from gibbs_codegen.flight.distributions import Varied, varied
from gibbs_codegen.flight.scenario.parts import PREDICTIVE, functions_for
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import check_scenario
from gibbs_codegen.flight.sweeps import measures as known_measures
from gibbs_codegen.flight.sweeps.cases import NUMBERS, Cases, cases_of
from gibbs_codegen.flight.sweeps.chunks import (
    FILE,
    ResultFile,
    Row,
    chunks_of,
    digests_of,
    only_adaptive,
)
from gibbs_codegen.flight.sweeps.execution import Execution
from gibbs_codegen.flight.sweeps.measures import Measure
from gibbs_codegen.flight.sweeps.sources import (
    ScenarioSource,
    StrPath,
    robot_data,
    robot_source,
    scenario_source,
    with_places_filled,
)
from gibbs_codegen.flight.sweeps.study import FIXED, Study, table_of
from gibbs_codegen.flight.sweeps.workers import own_count
from gibbs_codegen.machine.filters import CALLED
from gibbs_codegen.runtime.predictive import DERIVATIVES, UNDER_WRENCHES

_MOST_SAMPLES = 2**24
# Combinations of listed values that are looked at beforehand, and the middle of a distribution.
_MOST_COMBINATIONS = 32
_MIDDLE = np.array([0.5])
# How often a line of the log says what is done, s.
_LOG_SECONDS = 30.0
_SLOW = (
    'these flights are computed one by one; integration.method = "rk4" computes them side by '
    "side, many times faster"
)

_log = logging.getLogger("gibbs_codegen.flight.sweeps")


def sweep(
    robots: StrPath | Sequence[StrPath],
    scenarios: StrPath | Scenario | Sequence[StrPath | Scenario],
    parameters: Mapping[str, Any] | None = None,
    samples: int = 1,
    seed: int = 0,
    measure: Mapping[str, Measure] | None = None,
    executor: Executor | None = None,
    out: StrPath = "sweep",
    progress: Progress = lambda stage, share: None,
    workers: int | None = None,
) -> Study:
    """Fly all cases of a sweep, but for those that an earlier call has flown, and measure them.

    Args:
        robots: One or several of what the command line takes as ROBOT.
        scenarios: One or several scenarios, names or files of scenarios.
        parameters: What entries of the scenario take on, by their keys, such as
            `motors.time_constant`, `start.offset[2]` or `plant.gravity`; a bare name of the
            module's PARAMETERS is one of [parameters], and `*` in names matches any. A value is
            a list, which is combined with the lists of other keys; a distribution (`uniform`,
            `normal`, `log_uniform`); `scaled` of these, for factors of the value in robot or
            scenario; or `together` of these, one number for all matches of a key with `*`.
        samples: How many times numbers are drawn for each combination of listed values.
        seed: Seed of the random numbers, noise of sensors included.
        measure: Measures by name: functions of a `Flight`, or texts such as "tip_error.max".
        executor: What computes: any executor of `concurrent.futures`, whose workers see `out`;
            None for processes of this machine.
        out: Folder for modules, finished flights and the study.
        progress: Called with the name of the work and the share done, 0 to 1.
        workers: How many processes of this machine there are; default: one for each processor.

    Returns:
        The study.

    Raises:
        UsageError: If something asked for means nothing.
        RobotFileError, ScenarioFileError: If a file is refused.
        OutputError: If results cannot be written; finished flights are kept.
    """
    _check_counts(samples, seed, workers)
    check_output_folder(out)
    folder = Path(os.path.realpath(out))
    _check_own(folder)
    scenario_sources = [scenario_source(scenario) for scenario in _listed(scenarios)]
    varying = {key: varied(value) for key, value in (parameters or {}).items()}
    _refuse_unfit(_listed(robots), scenario_sources, varying)

    def values(key: str) -> list[Any]:
        """All values of an entry of a scenario that are flown."""
        levels = varying[key].levels if key in varying else ()
        return [*(source.says(key) for source in scenario_sources), *levels]

    laws = values("control.law")
    planned = (*DERIVATIVES, *UNDER_WRENCHES) if PREDICTIVE in laws else ()
    derivatives = (*planned, *(CALLED if any(values("control.estimate")) else ()))
    holds = [source.says("hold") or source.says("holds") for source in scenario_sources]
    functions = functions_for(any(holds), laws)
    robot_sources = [
        robot_source(word, folder / "modules", progress, derivatives, functions)
        for word in _listed(robots)
    ]
    cases = cases_of(robot_sources, scenario_sources, varying, samples, seed)
    chosen = measure or known_measures.default(all(robot.has_tip for robot in robot_sources))
    known_measures.check(chosen, (*FIXED, *cases.columns))
    _refuse_out_of_bounds(cases, progress)
    if samples > 1 and not any(block.drawn or block.seed is not None for block in cases.blocks):
        raise UsageError(
            f"samples: all {samples} of a case would be the same flight, because no value is "
            "random; give a distribution, such as uniform(0.1, 0.2), or leave samples out"
        )
    rows = _rows(chosen, cases, folder, executor, workers or own_count(), progress)
    study = Study(Path(out), cases, table_of(cases, tuple(chosen), rows))
    study.save()
    return study


def _listed(values: Any) -> list[Any]:
    """One or several, as a list."""
    one = isinstance(values, str | os.PathLike | Scenario | Mapping)
    listed = [values] if one else list(values)
    if not listed:
        raise UsageError("a sweep needs at least one robot and one scenario")
    return listed


def _check_counts(samples: int, seed: int, workers: int | None) -> None:
    """Refuse numbers that are not whole, or too small or large."""
    whole("samples", samples)
    whole("seed", seed, 0)
    whole("workers", workers or 1)
    if samples > _MOST_SAMPLES:
        raise UsageError(f"samples: at most {_MOST_SAMPLES}, not {samples}")


def _check_own(folder: Path) -> None:
    """Refuse a folder that holds something else than a sweep, which might replace it."""
    # A sweep writes modules first, and nothing else before there are flights.
    others = {path.name for path in folder.glob("[!.]*")} - {"modules"}
    if others and others.isdisjoint((FILE, "cases.json")):
        raise UsageError(
            f"{printable(folder)}: contains {printable(min(others))}, which no sweep wrote; give "
            "a new or empty folder, or that of an earlier sweep"
        )


def _refuse_out_of_bounds(cases: Cases, progress: Progress) -> None:
    """Raise the error of values that keys cannot take, each beside those of the first case.

    Or of scenarios none of which can be read: a key is misspelt, mostly. `progress` is called with
    the share done of the values of a robot and scenario.
    """
    for block in cases.blocks:
        tries = [(axis, value) for axis in block.axes for value in block.ends(axis)]
        errors: list[GibbsCodegenError] = []
        faults: dict[Any, None] = {}
        scenario, first = block.scenario, block.chosen(0)[1]
        for k, (axis, value) in enumerate(tries):
            progress("checking values", k / len(tries))
            try:
                scenario.changed(with_places_filled(scenario.says, first | axis.entries(value)))
            except GibbsCodegenError as error:
                errors.append(error)
                of_value = getattr(error, "faults", ())
                faults |= dict.fromkeys(x for x in of_value if x.path.startswith(axis.targets))
        if faults:
            raise ScenarioFileError(scenario.word, [*faults])
        if errors and len(errors) == len(tries):
            raise errors[0]


def _refuse_unfit(
    robots: Sequence[StrPath], scenarios: Sequence[ScenarioSource], varying: Mapping[str, Varied]
) -> None:
    """Raise the error of scenarios none of which any robot can fly, before modules are made.

    Nothing is said where more combinations are listed than are quickly looked at.
    """
    levels = {key: axis.levels or [axis.ppf(_MIDDLE)[0]] for key, axis in varying.items()}
    if math.prod(map(len, levels.values())) > _MOST_COMBINATIONS:
        return
    data = [robot_data(word) for word in robots]
    errors = []
    for robot, source in itertools.product(data, scenarios):
        # A factor, or a number of the module, has no name in it that could be wrong.
        keys = [k for k in levels if not varying[k].relative and k.partition(".")[0] not in NUMBERS]
        keys = [k for k in keys if source.knows(k)]
        for values in itertools.product(*(levels[key] for key in keys)):
            entries = dict(zip(keys, values, strict=True))
            try:
                check_scenario(robot, source.changed(with_places_filled(source.says, entries)))
            except UsageError as error:
                errors.append(error)
            except ScenarioFileError:  # It is refused later, with the case that has it.
                return
            else:
                return
    raise errors[0]


def _rows(
    measures: Mapping[str, Measure],
    cases: Cases,
    folder: Path,
    executor: Executor | None,
    workers: int,
    progress: Progress,
) -> list[Row]:
    """The rows of cases, of which those that the folder lacks are flown."""
    done, logged = 0, time.monotonic()

    def tell(more: int) -> None:
        nonlocal done, logged
        done += more
        progress("flying", done / len(cases))
        if time.monotonic() - logged > _LOG_SECONDS:
            logged = time.monotonic()
            _log.info("%d of %d flights are done", done, len(cases))

    digests = digests_of(cases, measures)
    store = ResultFile(folder, set(digests))
    lacking = [digest not in store.rows for digest in digests]
    missing = chunks_of(cases, lacking)
    tell(lacking.count(False))
    if len(missing) > workers and only_adaptive(cases):
        _log.warning(_SLOW)
    if missing:
        processes = min(workers, len(missing))
        Execution(measures, digests, store, executor, processes, tell).run(missing)
    return [store.rows[digest] for digest in digests]
