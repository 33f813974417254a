"""Many flights of one robot: those that are alike share what they have in common."""

from __future__ import annotations

import io
import os
import pickle
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any

from gibbs_codegen.errors import GibbsCodegenError
from gibbs_codegen.runtime.load import load
from gibbs_codegen.scenario.control import Motors
from gibbs_codegen.scenario.scenario import Scenario, StartOffset
from gibbs_codegen.simulator.desired.trajectory import Progress
from gibbs_codegen.simulator.record.flight import Flight
from gibbs_codegen.simulator.simulation import Prepared, prepared
from gibbs_codegen.simulator.together import Together

Found = Flight | GibbsCodegenError

# What flights begin with is kept of so many groups.
_MOST_KNOWN = 4
_known: dict[tuple[ModuleType, bytes | None], Prepared] = {}


def simulate_many(
    robot: ModuleType | str | os.PathLike[str],
    scenarios: Sequence[Scenario],
    threads: int = 1,
    progress: Progress = lambda what, share: None,
) -> list[Found]:
    """Fly many scenarios with one robot.

    Scenarios that differ in `plant`, `motors.time_constant` and `start` only share their desired
    motion. Where such flights are integrated by "rk4", with the C back end, under a law that acts
    at all times, they are computed side by side, many times as fast as one by one.

    Args:
        robot: As of `simulate`.
        scenarios: What is flown.
        threads: How many threads share the flights that are computed side by side.
        progress: Is told what is being done, and the share of it that is done, 0 to 1.

    Returns:
        For each scenario its flight, whose series are computed when they are asked for, or the
        error with which `simulate` refuses it.
    """
    module = robot if isinstance(robot, ModuleType) else load(robot, "c")
    found: dict[int, Found] = {}
    for common, places in _alike(scenarios):
        done, size = len(found), len(places)

        def tell(share: float, done: int = done, size: int = size) -> None:
            progress("flying", (done + share * size) / len(scenarios))

        group = {place: scenarios[place] for place in places}
        found |= _flown(module, common, group, threads, tell)
    return [found[place] for place in range(len(scenarios))]


def _flown(
    module: ModuleType,
    common: bytes | None,
    scenarios: Mapping[int, Scenario],
    threads: int,
    tell: Callable[[float], None],
) -> dict[int, Found]:
    """Flights and errors, by the places of scenarios that share their desired motion.

    It is found with the first of them that can begin. `common` tells them from others.
    """
    found: dict[int, Found] = {}
    for place, scenario in scenarios.items():
        try:
            start = _prepared(module, common, scenario)
        except GibbsCodegenError as error:
            found[place] = error
            continue
        others = {each: s for each, s in scenarios.items() if each not in found}
        flights = Together(start, [*others.values()]).flights(threads, tell)
        return {**found, **dict(zip(others, flights, strict=True))}
    return found


def _prepared(module: ModuleType, common: bytes | None, scenario: Scenario) -> Prepared:
    """What flights that share their desired motion begin with, which calls in a row share too.

    `common` is what tells them from others, None if nothing does.
    """
    known = _known.pop((module, common), None)
    if known is None:
        known = prepared(module, scenario, lambda what, share: None, own=False)
    if common is not None:
        _known[module, common] = known
        for oldest in [*_known][:-_MOST_KNOWN]:
            del _known[oldest]
    return known


def _alike(scenarios: Sequence[Scenario]) -> Iterable[tuple[bytes | None, list[int]]]:
    """Places of scenarios that share their desired motion, and what these have in common."""
    groups: dict[Any, list[int]] = defaultdict(list)
    for place, scenario in enumerate(scenarios):
        groups[_common(scenario) or place].append(place)
    return [(k if isinstance(k, bytes) else None, places) for k, places in groups.items()]


def _common(scenario: Scenario) -> bytes | None:
    """What tells a scenario from those that it shares its desired motion with; None if that is all.

    Whether motors lag decides what a state consists of, and so how flights are integrated.
    """
    motors = scenario.motors
    lags = None if motors.time_constant is None else motors.time_constant > 0.0
    plain = replace(
        scenario,
        name="",
        description="",
        plant=dict.fromkeys(sorted(scenario.plant), 0.0),
        start=StartOffset(),
        motors=Motors(motors.limits, None, motors.compensation),
    )
    written = io.BytesIO()
    pickler = pickle.Pickler(written)
    pickler.fast = True  # What is equal is written alike, whether or not it is one object.
    try:
        pickler.dump((plain, lags))
    except (pickle.PicklingError, TypeError, AttributeError, RecursionError):
        return None  # A path may be any function.
    return written.getvalue()
