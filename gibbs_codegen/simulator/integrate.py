"""Integration of a flight: adaptive by SciPy, or by fixed steps of Runge and Kutta's method."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from gibbs_codegen.simulator.attitude import SINGULAR_COSINE
from gibbs_codegen.simulator.compiled_loop import CompiledLoop
from gibbs_codegen.simulator.plant import Plant

Array = NDArray[np.float64]
Progress = Callable[[float, float], None]
Method = Literal["adaptive", "rk4"]

# What a call of the compiled loop takes on at most, so that progress shows and Ctrl-C is heard.
_STEPS_A_CALL = 20_000
# Work, in J, next to angles and lengths: a machine of some kg at some m/s.
_WORK_SCALE = 100.0


@dataclass(frozen=True)
class Settings:
    """How to integrate: method, tolerances of "adaptive", greatest step of "rk4" (s).

    `rate` samples a second are kept. A coordinate that is `divergence` (rad or m) off its desired
    value ends the flight, unless nothing is controlled.
    """

    method: Method = "adaptive"
    step: float = 1e-3
    relative_tolerance: float = 1e-10
    absolute_tolerance: float = 1e-11
    rate: float = 100.0
    divergence: float = 20.0


@dataclass(frozen=True)
class Course:
    """Samples of the state (s, size) at times (s), and why there are no more; empty if complete."""

    time: Array
    states: Array
    stopped: str


def integrate(
    plant: Plant,
    start: Array,
    duration: float,
    settings: Settings,
    progress: Progress = lambda time, duration: None,
) -> Course:
    """Integrate from a state at time 0; stops early at a singularity or where control is lost.

    `progress` is told the time reached and the duration, s.
    """
    run = _adaptive if settings.method == "adaptive" else _fixed
    times, states = [np.zeros(1)], [start[np.newaxis]]
    stopped = _reason(plant, settings, 0.0, start)
    for begin, end in itertools.pairwise(plant.breaks(duration)):
        if stopped:
            break
        pushed = bool(plant.pushed(begin))
        stretch = _Stretch(begin, end, pushed)
        course = run(
            plant, states[-1][-1], stretch, settings, lambda time: progress(time, duration)
        )
        times.append(course.time)
        states.append(course.states)
        stopped = course.stopped
    return _without_the_lost(
        plant, settings, Course(np.concatenate(times), np.concatenate(states), stopped)
    )


def _without_the_lost(plant: Plant, settings: Settings, course: Course) -> Course:
    """A course without samples in which control was lost: they would dwarf all others."""
    error = _errors(plant, course.time, course.states)
    kept = np.all(error <= _divergence(plant, settings), axis=1)
    kept &= np.all(np.isfinite(course.states), axis=1)
    kept[0] = True
    return Course(course.time[kept], course.states[kept], course.stopped)


@dataclass(frozen=True)
class _Stretch:
    """A stretch of time in which nothing jumps."""

    begin: float
    end: float
    pushed: bool


def _adaptive(
    plant: Plant,
    start: Array,
    stretch: _Stretch,
    settings: Settings,
    progress: Callable[[float], None],
) -> Course:
    """Dormand and Prince's method of eighth order, sampled by its dense output."""
    absolute = np.full(len(start), settings.absolute_tolerance)
    absolute[2 * len(plant.vehicle.coordinates)] *= _WORK_SCALE
    solver = DOP853(
        lambda time, state: plant.derivative(time, state, stretch.pushed),
        stretch.begin,
        start,
        stretch.end,
        rtol=settings.relative_tolerance,
        atol=absolute,
    )
    first = int(np.floor(stretch.begin * settings.rate + 1e-9)) + 1
    wanted = np.arange(first, stretch.end * settings.rate - 1e-9) / settings.rate
    times, states, stopped = [], [], ""
    while solver.status == "running" and not stopped:
        with np.errstate(all="ignore"):
            said = solver.step()
        if solver.status == "failed":
            stopped = f"at t = {solver.t:.6g} s: no step is small enough ({said})"
            break
        path = solver.dense_output()
        time = solver.t
        if stopped := _reason(plant, settings, time, solver.y):
            time = _first_end(plant, settings, path, solver.t_old, time)
            stopped = _reason(plant, settings, time, path(time))
        inside = wanted[(wanted > solver.t_old) & (wanted <= time)]
        if (stopped or solver.status == "finished") and time not in inside:
            inside = np.append(inside, time)
        if len(inside):
            times.append(inside)
            states.append(path(inside).T)
        progress(solver.t)
    return _course(times, states, stopped, len(start))


def _first_end(
    plant: Plant, settings: Settings, path: Callable[[float], Array], good: float, bad: float
) -> float:
    """The first time in a step, to a millionth of it, at which the flight cannot go on."""
    for _ in range(20):
        middle = 0.5 * (good + bad)
        if _reason(plant, settings, middle, path(middle)):
            bad = middle
        else:
            good = middle
    return bad


def _fixed(
    plant: Plant,
    start: Array,
    stretch: _Stretch,
    settings: Settings,
    progress: Callable[[float], None],
) -> Course:
    """Runge and Kutta's classical method in equal steps, in C where the back end is C.

    Steps that the compiled loop leaves (those whose thrusts meet a limit) are taken here.
    """
    steps = max(int(np.ceil((stretch.end - stretch.begin) / settings.step - 1e-9)), 1)
    size = (stretch.end - stretch.begin) / steps
    every = max(round(1.0 / (settings.rate * size)), 1)
    loop = None if stretch.pushed else CompiledLoop.of(plant, size, _divergence(plant, settings))
    times, states, stopped = [], [], ""
    state, done = start, 0
    while done < steps and not stopped:
        time = stretch.begin + done * size
        taken = 0
        if loop is not None:
            count = min(_STEPS_A_CALL, steps - done)
            taken, kept, state = loop(time, state, count, every, done)
            times.append(stretch.begin + size * _kept_steps(done, taken, every))
            states.append(kept)
            done += taken
            time = stretch.begin + done * size
        if taken == 0 or loop is None:
            with np.errstate(all="ignore"):
                state = _step(plant, time, state, size, stretch.pushed)
            done += 1
            if done % every == 0:
                times.append(np.array([stretch.begin + done * size]))
                states.append(state[np.newaxis])
        stopped = _reason(plant, settings, stretch.begin + done * size, state)
        progress(stretch.begin + done * size)
    if done % every:
        times.append(np.array([stretch.begin + done * size]))
        states.append(state[np.newaxis])
    return _course(times, states, stopped, len(start))


def _kept_steps(done: int, taken: int, every: int) -> Array:
    """Numbers of the steps in (done, done + taken] that are samples."""
    first = (done // every + 1) * every
    return np.arange(first, done + taken + 1, every, dtype=np.float64)


def _step(plant: Plant, time: float, state: Array, size: float, pushed: bool) -> Array:
    first = plant.derivative(time, state, pushed)
    second = plant.derivative(time + size / 2.0, state + size / 2.0 * first, pushed)
    third = plant.derivative(time + size / 2.0, state + size / 2.0 * second, pushed)
    fourth = plant.derivative(time + size, state + size * third, pushed)
    return state + size / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)


def _reason(plant: Plant, settings: Settings, time: float, state: Array) -> str:
    """Why a flight cannot go on from a state, or nothing."""
    if not np.all(np.isfinite(state)):
        return f"at t = {time:.6g} s the state is no longer finite: control is lost"
    q = plant.parts(state)[0]
    error = _errors(plant, time, state)
    worst = int(np.argmax(error))
    name = plant.vehicle.coordinates[worst]
    if error[worst] > _divergence(plant, settings):
        unit = "rad" if name.startswith("theta_") else "m"
        return f"at t = {time:.6g} s {name} is {error[worst]:.3g} {unit} off: control is lost"
    # Angles begin on the side where the cosine is positive, so this also tells a step across.
    if np.cos(q[1]) < SINGULAR_COSINE:
        return (
            f"at t = {time:.6g} s the attitude reaches the singularity of the sequence "
            f"{plant.vehicle.attitude} (theta_0 = {np.degrees(q[1]):.4g}°)"
        )
    return ""


def _errors(plant: Plant, time: float | Array, states: Array) -> Array:
    """How far coordinates (…, nq) are from what is desired."""
    error: Array = np.abs(plant.parts(states)[0] - plant.controller.reference(time)[0])
    return error


def _divergence(plant: Plant, settings: Settings) -> float:
    return np.inf if plant.controller.law == "off" else settings.divergence


def _course(times: list[Array], states: list[Array], stopped: str, size: int) -> Course:
    if not times:
        return Course(np.zeros(0), np.zeros((0, size)), stopped)
    return Course(np.concatenate(times), np.concatenate(states), stopped)
