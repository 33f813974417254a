"""Flights of one robot that differ in parameters of the plant, in lag and in where they start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gibbs_codegen.errors import GibbsCodegenError, UsageError
from gibbs_codegen.scenario.scenario import Scenario
from gibbs_codegen.simulator.control.sampled import law_in_time
from gibbs_codegen.simulator.desired.trajectory import starting_state
from gibbs_codegen.simulator.integration.closed_loop import ClosedLoop
from gibbs_codegen.simulator.integration.fixed_step import check_stability
from gibbs_codegen.simulator.integration.input_ranges import InputRanges
from gibbs_codegen.simulator.integration.integrate import integrate
from gibbs_codegen.simulator.integration.side_by_side import SideBySide
from gibbs_codegen.simulator.integration.state_history import StateHistory
from gibbs_codegen.simulator.integration.step_grid import StepGrid
from gibbs_codegen.simulator.plant.environment import Environment
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.record.flight import Flight
from gibbs_codegen.simulator.record.late_flight import LateFlight
from gibbs_codegen.simulator.record.recording import Recording, timing_fields
from gibbs_codegen.simulator.simulation import Prepared, check_mass_matrix


class Together:
    """Flights that share desired motion, law and limits.

    Their scenarios differ in `plant`, `motors.time_constant` and `start` only; `start` is what one
    of them begins with.
    """

    def __init__(self, start: Prepared, scenarios: Sequence[Scenario]) -> None:
        self._common, self._scenarios = start, scenarios
        self._like: Recording | None = None
        self._loops: dict[int, ClosedLoop] = {}
        self._starts: dict[tuple[float, ...], Array] = {}
        # Lags of motors with which steps are known to be short enough.
        self._stable: set[bytes] = set()

    def flights(
        self, threads: int, tell: Callable[[float], None]
    ) -> list[Flight | GibbsCodegenError]:
        """Fly them all: for each scenario the flight, or the error that refuses it."""
        found: list[Flight | GibbsCodegenError] = []
        histories = self._side_by_side(threads, tell)
        for i, history in enumerate(histories):
            try:
                found.append(self._flight(i, history))
            except GibbsCodegenError as error:
                found.append(error)
            tell((i + 1) / len(histories))
        return found

    def _side_by_side(
        self, threads: int, tell: Callable[[float], None]
    ) -> list[StateHistory | None]:
        """Histories of the flights that can be computed side by side; None of the others."""
        histories: list[StateHistory | None] = [None] * len(self._scenarios)
        scenario = self._common.scenario
        sampled = scenario.control.rate is not None or scenario.sensors is not None
        if len(histories) == 1 or scenario.integration.method != "rk4" or sampled:
            return histories
        places = [i for i in range(len(histories)) if self._is_sound(i)]
        if not places:
            return histories
        loop = self._joint_loop(places)
        starts = np.stack([self._state(i) for i in places])
        fly = SideBySide(
            loop,
            lambda k: self._loop(places[k]),
            scenario.integration,
            scenario.duration,
            threads,
        )
        found = fly(starts, lambda time: tell(time / scenario.duration))
        for i, history in zip(places, found, strict=True):
            histories[i] = history
        return histories

    def _is_sound(self, i: int) -> bool:
        """Whether nothing speaks against a flight, of which it would have to be told by itself."""
        scenario = self._scenarios[i]
        try:
            loop = self._loop(i)
            check_mass_matrix(loop.vehicle, self._common.q)
            lag = loop.actuators.lag.tobytes()
            waits = loop.environment is not None and (
                loop.environment.wall or loop.environment.wind
            )
            if waits or lag not in self._stable:
                check_stability(loop, StepGrid(scenario.integration).size)
                self._stable.add(lag)
        except UsageError:
            return False
        return True

    def _joint_loop(self, places: Sequence[int]) -> ClosedLoop:
        """The closed loop of several flights; arrays have an axis of these where they differ."""
        loop, chosen = self._common.loop, [self._scenarios[i] for i in places]
        first, plant = chosen[0], loop.vehicle
        if first.plant:
            varied = {name: np.array([each.plant[name] for each in chosen]) for name in first.plant}
            plant = Vehicle(loop.vehicle.module, {**first.parameters, **varied}, "plant")
        lags = np.stack([self._lag(each) for each in chosen])
        actuators = replace(loop.actuators, lag=lags)
        environment = Environment.of(plant, first, actuators.spins)
        return replace(loop, vehicle=plant, actuators=actuators, environment=environment)

    def _loop(self, i: int) -> ClosedLoop:
        """The closed loop of a flight, under a law that acts at all times."""
        if i in self._loops:
            return self._loops[i]
        scenario, loop = self._scenarios[i], self._common.loop
        known = {**scenario.parameters, **scenario.plant}
        plant = Vehicle(loop.vehicle.module, known, "plant") if scenario.plant else loop.vehicle
        actuators = replace(loop.actuators, lag=self._lag(scenario))
        environment = Environment.of(plant, scenario, actuators.spins)
        own = replace(loop, vehicle=plant, actuators=actuators, environment=environment)
        self._loops[i] = own
        return own

    def _lag(self, scenario: Scenario) -> Array:
        """Time constants (N) of the motors in a flight, s."""
        known, value = self._common.loop.actuators.lag, scenario.motors.time_constant
        return known if value is None else np.full(len(known), value)

    def _state(self, i: int) -> Array:
        """State (size) in which a flight starts, which neither the plant nor a lag decides."""
        offset, common = self._scenarios[i].start, self._common
        place = (*offset.position, *offset.rotation)
        if place not in self._starts:
            loop, q, v = self._loop(i), common.q, common.v
            if offset != common.scenario.start:
                law = loop.controller
                q, v = starting_state(law.vehicle, law.reference, offset)
            self._starts[place] = loop.start(q, v)
        return self._starts[place]

    def _alone(self, i: int) -> tuple[ClosedLoop, StateHistory]:
        """Closed loop and history of a flight by itself. Raises `UsageError` as `simulate` does."""
        loop, scenario = self._loop(i), self._common.scenario
        q, v, *_ = loop.parts(self._state(i))
        check_mass_matrix(loop.vehicle, q)
        law = law_in_time(loop.controller, self._scenarios[i], loop.actuators, None)
        loop = replace(loop, controller=law)
        return loop, integrate(loop, loop.start(q, v), scenario.duration, scenario.integration)

    def _flight(self, i: int, history: StateHistory | None) -> Flight:
        """A flight whose series are computed when they are asked for.

        Its history is without ranges of inputs; None if it is yet to be integrated.
        """
        motion = self._common.motion
        scenario = replace(motion.scenario, name=self._scenarios[i].name)
        ranges: Callable[[], InputRanges] | None = None
        loop, own = self._alone(i) if history is None else (self._loop(i), history)
        if self._like is None and not own.stopped:
            self._like = Recording(self._common.loop, scenario, own)
        like = None if own.stopped else self._like
        # Ranges are seldom asked for, and take an integration by itself.
        ranges = None if history is None else lambda: self._alone(i)[1].inputs
        recording = Recording(loop, scenario, own, like, ranges)
        return LateFlight(recording, timing_fields(motion))
