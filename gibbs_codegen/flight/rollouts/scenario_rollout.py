"""Rollouts of a scenario's closed loop: flights side by side, of plants that differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from gibbs_codegen.errors import GibbsCodegenError, UsageError
from gibbs_codegen.flight.integration.block_loop import BlockIntegration
from gibbs_codegen.flight.integration.envelope import NOT_FINITE
from gibbs_codegen.flight.integration.integrators import check_stability, integrate
from gibbs_codegen.flight.integration.state_history import StateHistory
from gibbs_codegen.flight.many import ScenarioLoops
from gibbs_codegen.flight.rollouts.arguments import RolloutArguments
from gibbs_codegen.flight.scenario.file import AnyScenario, read_scenario
from gibbs_codegen.flight.scenario.parts import Settings
from gibbs_codegen.flight.simulation import FlightStart, flight_start
from gibbs_codegen.machine.state import State
from gibbs_codegen.runtime.rollouts import (
    DIVERGED,
    OUT_OF_BOUNDS,
    REALS,
    RUNNING,
    Array,
    Precision,
    Rollout,
)


def scenario_rollout(
    arguments: RolloutArguments,
    scenario: AnyScenario,
    begin: tuple[Any, Any],
    grid: tuple[float, int],
    varied: tuple[Mapping[str, Any], Any],
    computed: tuple[Precision, int],
    progress: Callable[[str, float], None],
) -> Rollout:
    """Roll states out under the control of a scenario, in its surroundings.

    `begin` are q0 and v0 or None, `varied` parameters and time constants, as of `rollout`; `grid`
    is the size of a step, s, and how many make a sample. `computed` is in which precision, and by
    how many threads. A state in which control is lost is out of bounds. Raises `UsageError` if a
    flight cannot begin or go on.
    """
    (dt, every), (parameters, lag), (precision, threads) = grid, varied, computed
    duration = arguments.steps * dt
    start = _scenario_start(arguments, scenario, dt, every)
    if begin[0] is not None:  # Elsewhere bristles are not strained.
        start = replace(start, loop=replace(start.loop, bristles=None))
    q, v = arguments.start(
        *(a if b is None else b for a, b in zip((start.q, start.v), begin, strict=True))
    )
    numbers = arguments.parameters(parameters)
    lags = start.loop.actuators.lag[np.newaxis] if lag is None else arguments.lag(lag)
    loops = ScenarioLoops(start, numbers, lags, "parameters")
    count = arguments.count()
    loop, settings = loops.loop(), start.scenario.integration
    _check_steps(loops, count, dt)
    q, v = (np.repeat(part, count // len(part), 0) for part in (q, v))
    starts = loop.start(q, v, start.scenario.start.charge)
    # In single precision thrusts a moment apart do not differ enough to make up for their lag.
    single = precision == "single" and not loop.compensates
    fly = BlockIntegration(loop, loops.loop, settings, duration, threads, single)
    block_histories = fly(starts, lambda time: progress("rolling out", time / duration))
    histories = _with_others(loops, block_histories, starts, duration, progress)
    parts = loop.parts(
        np.stack([_on_grid(run, dt * every, 1 + arguments.steps // every) for run in histories])
    )
    time = np.arange(parts.q.shape[1], dtype=np.float64) * (dt * every)
    ends = np.array([run.time[-1] if run.stopped else duration for run in histories])
    thrusts = _thrusts(loops, parts, np.minimum(time, ends[:, None])) if loop.lags else None
    reasons = [DIVERGED if NOT_FINITE in run.stopped else OUT_OF_BOUNDS for run in histories]
    ended = np.where([run.stopped != "" for run in histories], reasons, RUNNING)
    steps, real = np.rint(ends / dt).astype(np.int64), REALS[precision]
    q, v = parts.q.astype(real), parts.v.astype(real)
    thrusts = None if thrusts is None else thrusts.astype(real)
    x = parts.actuators.astype(real) if loop.vehicle.actuator_states else None
    bristles = parts.bristles.astype(real) if parts.bristles.shape[-1] else None
    return Rollout(time, q, v, thrusts, steps, ended.astype(np.int8), x, bristles)


def _scenario_start(
    arguments: RolloutArguments, scenario: AnyScenario, dt: float, every: int
) -> FlightStart:
    """Motion, closed loop and start of a scenario, in steps of `dt`, `every` of them a sample.

    Raises `UsageError` if it cannot begin, or its law is sampled.
    """
    scene = read_scenario(scenario)
    if scene.is_sampled:
        raise UsageError(
            'control: rollouts do not support control.rate, sensors or the law "predictive"; '
            "use simulate_many"
        )
    settings: Settings = replace(scene.integration, method="rk4", step=dt, rate=1.0 / (dt * every))
    scene = replace(scene, integration=settings)
    return flight_start(arguments.module, scene, lambda stage, share: None, custom_law=False)


def _check_steps(loops: ScenarioLoops, count: int, dt: float) -> None:
    """Raise `UsageError` for steps in which what should decay grows in one of the states."""
    loop = loops.loop()
    lag = np.atleast_2d(loop.actuators.lag)
    # The shortest lag decides, but where parameters do too: about walls and drag, and of those
    # that joints with servos or friction have, the least and the greatest.
    states = [int(np.where(lag > 0.0, lag, np.inf).min(axis=1, initial=np.inf).argmin())]
    if loop.vehicle.is_driven:
        ends = [f(x) for x in loops.parameters.values() for f in (np.argmin, np.argmax)]
        states = sorted({*states, *map(int, ends)})
    if loop.environment is not None and (loop.environment.wall or loop.environment.wind):
        rows = [np.broadcast_to(x, count) for x in (0.0, *lag.T, *loops.parameters.values())]
        states = np.unique(np.stack(rows), axis=1, return_index=True)[1].tolist()
    for state in states:
        try:
            check_stability(loops.loop(state), dt)
        except UsageError as error:
            words = str(error).removeprefix("integration.step: ")
            raise UsageError(f"dt: state {state}: {words}") from None


def _with_others(
    loops: ScenarioLoops,
    block_histories: list[StateHistory | None],
    starts: Array,
    duration: float,
    progress: Callable[[str, float], None],
) -> list[StateHistory]:
    """Histories of all states: those that have none are integrated by themselves.

    `starts` (n, size) are states of the closed loops. Raises `UsageError` if one cannot go on.
    """
    missing, done, histories = block_histories.count(None), 0, []
    for i, history in enumerate(block_histories):
        if history is None:

            def tell(share: float, before: int = done) -> None:
                progress("rolling out states by themselves", (before + share) / missing)

            history, done = _single(loops, i, starts[i], duration, tell), done + 1
        histories.append(history)
    return histories


def _single(
    loops: ScenarioLoops, state: int, start: Array, duration: float, tell: Callable[[float], None]
) -> StateHistory:
    """The history (samples, size) of a state that is integrated by itself.

    `start` (size) has thrusts if any state lags. Raises `UsageError` if it cannot go on.
    """
    loop, size = loops.loop(state), len(start)
    first = loop.layout.places.work.stop
    places = np.delete(np.arange(size), slice(first, first + size - loop.size))
    settings = loops.start.scenario.integration
    try:
        history = integrate(loop, start[places], duration, settings, lambda t, end: tell(t / end))
    except GibbsCodegenError as error:
        raise UsageError(f"state {state}: {error}") from None
    states = np.zeros((len(history.states), size))
    states[:, places] = history.states
    return replace(history, states=states)


def _thrusts(loops: ScenarioLoops, parts: State[Array], time: Array) -> Array:
    """Thrusts (n, samples, rotors), N, of motors of which some lag, of parts (n, samples)."""
    thrusts = parts.actuators.copy()
    lag = np.broadcast_to(loops.loop().actuators.lag, thrusts[:, 0].shape)
    for i in np.flatnonzero((lag == 0.0).any(axis=1)).tolist():
        # A command acts at once where nothing lags, and then the state has no thrust.
        loop, state = loops.loop(i), State(*(part[i] for part in parts))
        applied = loop.inputs(time[i], state, loop.loads(time[i]))[1]
        thrusts[i] = applied[:, : thrusts.shape[-1]]
    return thrusts


def _on_grid(history: StateHistory, between: float, count: int) -> Array:
    """Samples (count, size) of a history, of which the last is repeated after its end."""
    places = history.time / between
    whole = history.states[np.abs(places - np.rint(places)) < 1e-6]
    rest = np.broadcast_to(history.states[-1], (count - len(whole), len(history.states[-1])))
    return np.concatenate([whole, rest])
