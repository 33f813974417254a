"""Many flights of one robot: those that are alike share what they have in common."""

from __future__ import annotations

import io
import os
import pickle
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.errors import GibbsCodegenError, UsageError
from gibbs_codegen.flight.control.sampled_control import law_in_time
from gibbs_codegen.flight.desired.trajectory import Progress, starting_state
from gibbs_codegen.flight.integration.block_loop import BlockIntegration
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.integrators import StepGrid, check_stability, integrate
from gibbs_codegen.flight.integration.rest import resting
from gibbs_codegen.flight.integration.state_history import StateHistory
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.recording import DeferredFlight, Recording, timing_fields
from gibbs_codegen.flight.scenario.file import AnyScenario, read_scenario
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import (
    FlightStart,
    check_flight,
    check_mass_matrix,
    flight_start,
    is_positive_definite,
)
from gibbs_codegen.runtime.load import load

Outcome = Flight | GibbsCodegenError

# The number of groups whose starts of flights are kept.
_MOST_KNOWN = 4
_kept_starts: dict[tuple[ModuleType, bytes | None], FlightStart] = {}


def fits_blocks(scenario: Scenario) -> bool:
    """True if flights of a scenario, and of others like it, can be computed side by side."""
    return scenario.integration.method == "rk4" and not scenario.is_sampled


@dataclass(frozen=True)
class ScenarioLoops:
    """Closed loops of a scenario that differ in parameters of the plant and in the lag of motors.

    - `parameters`: those of the plant, by name, arrays (n), or (1) for all; `table` is what
      messages call them
    - `lag` (1 or n, rotors): time constants, s
    """

    start: FlightStart
    parameters: Mapping[str, Array]
    lag: Array
    table: str

    def loop(self, states: int | Sequence[int] | None = None) -> ClosedLoop:
        """The closed loop of one state, or of several, with an axis of these.

        None is for all states, with an axis where they differ.
        """

        def of(values: Array) -> Any:
            if states is None:
                return values if len(values) > 1 else values[0]
            return values[np.minimum(states, len(values) - 1)]

        scenario = self.start.scenario
        parameters = {name: of(values) for name, values in self.parameters.items()}
        if parameters:
            parameters = {**scenario.plant, **parameters}
        return self.start.loop.with_plant(parameters, of(self.lag), scenario, self.table)


class FlightGroup:
    """Flights that share desired motion, law and limits.

    Their scenarios differ in `plant`, `motors.time_constant` and `start` only; `start` is what one
    of them begins with. In `blocks` they are computed side by side, where they can be.
    """

    def __init__(self, start: FlightStart, scenarios: Sequence[Scenario], blocks: bool) -> None:
        # Bristles that hold one of them at rest say nothing of the others.
        start = replace(start, loop=replace(start.loop, bristles=None))
        self._common, self._scenarios, self._blocks = start, scenarios, blocks
        self._like: Recording | None = None
        shared, lags = start.loop.actuators.lag, [s.motors.time_constant for s in scenarios]
        self._joint = ScenarioLoops(
            start,
            {name: np.array([s.plant[name] for s in scenarios]) for name in start.scenario.plant},
            np.stack([shared if lag is None else np.full(len(shared), lag) for lag in lags]),
            "plant",
        )
        self._loops: dict[int, ClosedLoop] = {}
        self._starts: dict[tuple[float, ...], Array] = {}
        # Lags of motors with which steps are known to be short enough.
        self._stable: set[bytes] = set()

    def flights(self, threads: int, tell: Callable[[float], None]) -> list[Outcome]:
        """Fly them all: for each scenario the flight, or the error that refuses it."""
        outcomes: list[Outcome] = []
        histories = self._block_histories(threads, tell)
        for i, history in enumerate(histories):
            try:
                outcomes.append(self._flight(i, history))
            except GibbsCodegenError as error:
                outcomes.append(error)
            tell((i + 1) / len(histories))
        return outcomes

    def _block_histories(
        self, threads: int, tell: Callable[[float], None]
    ) -> list[StateHistory | None]:
        """Histories of the flights that can be computed side by side; None of the others."""
        histories: list[StateHistory | None] = [None] * len(self._scenarios)
        scenario = self._common.scenario
        if not (self._blocks and fits_blocks(scenario)):
            return histories
        have_mass = self._have_mass()
        places = [i for i in range(len(histories)) if self._is_sound(i, have_mass)]
        if not places:
            return histories
        loop = self._joint.loop(places)
        starts = np.stack([self._state(i) for i in places])
        fly = BlockIntegration(
            loop,
            lambda k: self._loop(places[k]),
            scenario.integration,
            scenario.duration,
            threads,
        )
        done = fly(starts, lambda time: tell(time / scenario.duration))
        for i, history in zip(places, done, strict=True):
            histories[i] = history
        return histories

    def _have_mass(self) -> bool:
        """True if the mass matrices of all plants are positive definite where flights begin."""
        try:
            vehicle = self._joint.loop().vehicle
        except UsageError:
            return False
        return is_positive_definite(vehicle.mass_matrix(self._common.q))

    def _is_sound(self, i: int, has_mass: bool) -> bool:
        """True if nothing speaks against a flight that it alone would have to report."""
        common, lag = self._common.loop, self._joint.lag[i].tobytes()
        environment = common.environment
        depends = common.vehicle.is_driven or bool(
            environment and (environment.wall or environment.wind)
        )
        try:
            if not has_mass:
                check_mass_matrix(self._loop(i).vehicle, self._common.q)
            self._state(i)
            if depends or lag not in self._stable:
                check_stability(self._loop(i), StepGrid(self._scenarios[i].integration).size)
                self._stable.add(lag)
        except UsageError:
            return False
        return True

    def _loop(self, i: int) -> ClosedLoop:
        """The closed loop of a flight, under a law that acts at all times."""
        if i not in self._loops:
            self._loops[i] = self._joint.loop(i)
        return self._loops[i]

    def _state(self, i: int) -> Array:
        """State (size) in which a flight starts, which a plant that settles decides, but no lag."""
        offset, common = self._scenarios[i].start, self._common
        place = (*offset.position, *offset.rotation, offset.charge, i if offset.settled else -1)
        if place not in self._starts:
            loop, q, v = self._loop(i), common.q, common.v
            if offset != common.scenario.start or offset.settled:
                law = loop.controller
                q, v = starting_state(law.vehicle, law.reference, offset)
            if offset.settled:
                (q, bristles), v = resting(loop, q, offset.charge), np.zeros(len(v))
                self._loops[i] = loop = replace(loop, bristles=bristles)
            self._starts[place] = loop.start(q, v, offset.charge)
        return self._starts[place]

    def _single(self, i: int) -> tuple[ClosedLoop, StateHistory]:
        """Closed loop and history of a flight by itself. Raises `UsageError` as `simulate` does."""
        state, scenario = self._state(i), self._common.scenario
        loop = self._loop(i)  # With the bristles of a start at rest, which was found first.
        q, v, *_ = loop.parts(state)
        check_mass_matrix(loop.vehicle, q)
        law = law_in_time(loop.controller, self._scenarios[i], loop.actuators, loop.idles)
        loop = replace(loop, controller=law)
        begin = loop.start(q, v, self._scenarios[i].start.charge)
        return loop, integrate(loop, begin, scenario.duration, scenario.integration)

    def _flight(self, i: int, history: StateHistory | None) -> Flight:
        """A flight whose series are computed when they are asked for.

        Its history is without ranges of inputs; None if it is yet to be integrated.
        """
        common, ranges = self._common, None
        if history is None:
            loop, flown = self._single(i)
        else:
            # Ranges are seldom asked for, and take an integration by itself.
            loop, flown, ranges = None, history, lambda: self._single(i)[1].inputs
        if self._like is None and not flown.stopped:
            self._like = Recording(common.loop, common.motion.scenario, flown)
        like = None if flown.stopped else self._like

        def recording() -> Recording:
            scenario = replace(common.motion.scenario, name=self._scenarios[i].name)
            return Recording(loop or self._loop(i), scenario, flown, like, ranges)

        q, v, *_ = common.loop.parts(flown.states)
        values = {"stopped": flown.stopped, "time": flown.time, "q": q, "v": v}
        return DeferredFlight(recording, values | timing_fields(common.motion))


def simulate_many(
    robot: ModuleType | str | os.PathLike[str],
    scenarios: Sequence[AnyScenario],
    threads: int = 1,
    progress: Progress = lambda stage, share: None,
    blocks: bool | None = None,
) -> list[Outcome]:
    """Fly many scenarios with one robot.

    Scenarios that differ in `plant`, `motors.time_constant` and `start` only share their desired
    motion. Where such flights are integrated by "rk4", with the C back end, under a law that acts
    at all times, they are computed side by side, many times as fast as one by one.

    Args:
        robot: As of `simulate`.
        scenarios: What is flown, each as of `simulate`.
        threads: How many threads share the flights that are computed side by side.
        progress: Called with the name of the work and the share done, 0 to 1.
        blocks: Whether flights that can be computed side by side are, even one by itself, so that
            results do not depend on how many there are; None: where there are two or more alike.

    Returns:
        For each scenario its flight, whose series are computed when they are asked for, or the
        error with which `simulate` refuses it.
    """
    read = dict(enumerate(map(read_scenario, scenarios)))
    module, outcomes = robot if isinstance(robot, ModuleType) else load(robot), dict[int, Outcome]()
    if module is not robot:  # What NumPy can tell comes first: to compile takes long.
        outcomes = _refused(module, read)
        module = load(robot, "c") if len(outcomes) < len(read) else module
    for common, places in _groups(
        {k: scenario for k, scenario in read.items() if k not in outcomes}
    ):
        done, size = len(outcomes), len(places)

        def tell(share: float, done: int = done, size: int = size) -> None:
            progress("flying", (done + share * size) / len(scenarios))

        group = {place: read[place] for place in places}
        whether = size > 1 if blocks is None else blocks
        outcomes |= _fly_group(module, common, group, threads, tell, whether)
    return [outcomes[place] for place in range(len(scenarios))]


def _refused(module: ModuleType, scenarios: Mapping[int, Scenario]) -> dict[int, Outcome]:
    """Errors of the scenarios that a module on NumPy's arrays refuses, by their places."""
    refusals: dict[int, Outcome] = {}
    for place, scenario in scenarios.items():
        try:
            check_flight(module, scenario)
        except GibbsCodegenError as error:
            refusals[place] = error
    return refusals


def _fly_group(
    module: ModuleType,
    common: bytes | None,
    scenarios: Mapping[int, Scenario],
    threads: int,
    tell: Callable[[float], None],
    blocks: bool,
) -> dict[int, Outcome]:
    """Flights and errors, by the places of scenarios that share their desired motion.

    It is found with the first of them that can begin. `common` tells them from others.
    """
    outcomes: dict[int, Outcome] = {}
    for place, scenario in scenarios.items():
        try:
            start = _start_of(module, common, scenario)
        except GibbsCodegenError as error:
            outcomes[place] = error
            continue
        others = {
            place_left: s for place_left, s in scenarios.items() if place_left not in outcomes
        }
        flights = FlightGroup(start, [*others.values()], blocks).flights(threads, tell)
        return {**outcomes, **dict(zip(others, flights, strict=True))}
    return outcomes


def _start_of(module: ModuleType, common: bytes | None, scenario: Scenario) -> FlightStart:
    """The start of flights that share their desired motion, which calls in a row share too.

    `common` is what tells them from others, None if nothing does.
    """
    start = _kept_starts.pop((module, common), None)
    if start is None:
        start = flight_start(module, scenario, lambda stage, share: None, custom_law=False)
    if common is not None:
        _kept_starts[module, common] = start
        for oldest in [*_kept_starts][:-_MOST_KNOWN]:
            del _kept_starts[oldest]
    return start


def _groups(scenarios: Mapping[int, Scenario]) -> Iterable[tuple[bytes | None, list[int]]]:
    """Places of scenarios that share their desired motion, and what these have in common."""
    groups: dict[Any, list[int]] = defaultdict(list)
    for place, scenario in scenarios.items():
        groups[_common(scenario) or place].append(place)
    return [(k if isinstance(k, bytes) else None, places) for k, places in groups.items()]


def _common(scenario: Scenario) -> bytes | None:
    """A key of scenarios that share their desired motion; None if a scenario shares it with none.

    Whether motors lag decides what a state consists of, and so how flights are integrated.
    """
    motors = scenario.motors
    lags = None if motors.time_constant is None else motors.time_constant > 0.0
    others = ("name", "description", "plant", "start", "motors")
    common = {name: value for name, value in vars(scenario).items() if name not in others}
    common |= {"plant": sorted(scenario.plant), "motors": vars(motors) | {"time_constant": None}}
    written = io.BytesIO()
    pickler = pickle.Pickler(written)
    pickler.fast = True  # What is equal is written alike, whether or not it is one object.
    try:
        pickler.dump((common, lags))
    except (pickle.PicklingError, TypeError, AttributeError, RecursionError):
        return None  # A path may be any function.
    return written.getvalue()
