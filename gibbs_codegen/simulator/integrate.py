"""Integration of a flight: adaptive by SciPy, or by fixed steps of Runge and Kutta's method."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from gibbs_codegen.errors import UsageError
from gibbs_codegen.scenario.scenario import Settings
from gibbs_codegen.simulator.closed_loop import ClosedLoop
from gibbs_codegen.simulator.compiled_loop import CompiledLoop
from gibbs_codegen.simulator.envelope import Envelope

Array = NDArray[np.float64]
Progress = Callable[[float, float], None]


# What a call of the compiled loop takes on at most, so that progress shows and Ctrl-C is heard.
_STEPS_A_CALL = 20_000
# Work, in J, next to angles and lengths: a machine of some kg at some m/s.
_WORK_SCALE = 100.0
# Evaluations that "adaptive" may spend: so many for each second flown, and so many ahead of that.
# Smooth flights take 500 a second, 2000 at the tightest tolerances.
_EVALUATIONS_A_SECOND = 20_000
_EVALUATIONS_AHEAD = 10_000
# Least tolerances where thrusts meet limits: slopes have kinks there, which no order serves.
_KINKED = (1e-6, 1e-7)
# Times are the same, and steps whole, to this share of a step.
_SAME = 1e-6
# Where rates next to steps say that stiffness is what makes these small.
_STIFF = 0.5
# Steps, in s, that a flight can be waited for.
_SHORTEST = 1e-6


@dataclass(frozen=True)
class Course:
    """Samples of the state (s, size) at times (s), and why there are no more; empty if complete."""

    time: Array
    states: Array
    stopped: str


def integrate(
    loop: ClosedLoop,
    start: Array,
    duration: float,
    settings: Settings,
    progress: Progress = lambda time, duration: None,
) -> Course:
    """Integrate from a state at time 0; stops early at a singularity or where control is lost.

    So does "adaptive" where it needs more evaluations than can be waited for. `progress` is told
    the time reached and the duration, s. Raises `UsageError` for steps of "rk4" that are so long
    that errors under control, or of lagging motors, would grow.
    """
    envelope = Envelope(loop, settings.divergence, duration)
    fly = (_Adaptive if settings.method == "adaptive" else _Fixed)(loop, settings, envelope)
    times, states = [np.zeros(1)], [start[np.newaxis]]
    now, state = 0.0, start
    stopped = envelope.reason(now, state)
    for begin, end in itertools.pairwise(loop.breaks(duration)):
        if stopped:
            break
        stretch = _Stretch(begin, end, bool(loop.pushed(begin)))
        flown = fly(stretch, state, lambda time: progress(time, duration))
        times.append(flown.samples.time)
        states.append(flown.samples.states)
        now, state, stopped = flown.end, flown.state, flown.samples.stopped
    if now > next(time[-1] for time in reversed(times) if len(time)):
        times.append(np.array([now]))
        states.append(state[np.newaxis])
    course = Course(np.concatenate(times), np.concatenate(states), stopped)
    # Samples in which control was lost would dwarf all others.
    kept = envelope.holds(course.time, course.states)
    kept[0] = True
    return Course(course.time[kept], course.states[kept], stopped)


@dataclass(frozen=True)
class _Stretch:
    """A stretch of time in which nothing jumps."""

    begin: float
    end: float
    pushed: bool


@dataclass(frozen=True)
class _Flown:
    """A stretch that is flown: samples after its begin, and time and state that it came to."""

    samples: Course
    end: float
    state: Array


class _Adaptive:
    """Dormand and Prince's method of eighth order, sampled by its dense output."""

    def __init__(self, loop: ClosedLoop, settings: Settings, envelope: Envelope) -> None:
        self.loop, self.settings, self.envelope = loop, settings, envelope
        # What may still be spent; a second without work saves up no more than this.
        self.left: float = _EVALUATIONS_AHEAD

    def __call__(
        self, stretch: _Stretch, start: Array, progress: Callable[[float], None]
    ) -> _Flown:
        loop, settings = self.loop, self.settings
        solver = DOP853(
            lambda time, state: loop.derivative(time, state, stretch.pushed),
            stretch.begin,
            start,
            stretch.end,
        )
        samples, stopped = [np.zeros((0, len(start)))], ""
        wanted = _sample_times(stretch, settings.rate)
        time, state, spent = stretch.begin, start, 0
        while solver.status == "running" and not stopped:
            self._tolerate(solver)
            with np.errstate(all="ignore"):
                said = solver.step()
            if solver.status == "failed":
                stopped = f"at t = {time:.6g} s: no step is small enough ({said})"
                stopped += _acting(loop, time, state)
                break
            path = solver.dense_output()
            before, time, state = time, solver.t, solver.y
            if stopped := self.envelope.reason(time, state):
                time = _first_end(self.envelope, path, before, time)
                state = path(time)
                stopped = self.envelope.reason(time, state)
            inside = wanted[(wanted > before) & (wanted <= time)]
            if len(inside):
                samples.append(path(inside).T)
            self._spend(time - before, solver.nfev - spent)
            spent = solver.nfev
            if not stopped and self.left < 0.0:
                stopped = self._too_slow(time, time - before, state)
            progress(solver.t)
        states = np.concatenate(samples)
        return _Flown(Course(wanted[: len(states)], states, stopped), time, state)

    def _tolerate(self, solver: DOP853) -> None:
        """Set tolerances for the next step."""
        settings, loop = self.settings, self.loop
        relative, absolute = settings.relative_tolerance, settings.absolute_tolerance
        if loop.limits and len(loop.saturated(solver.t, solver.y)):
            relative, absolute = max(relative, _KINKED[0]), max(absolute, _KINKED[1])
        solver.rtol = relative
        solver.atol = np.full(len(solver.y), absolute)
        solver.atol[2 * len(loop.vehicle.coordinates)] *= _WORK_SCALE

    def _spend(self, flown: float, evaluations: int) -> None:
        earned = self.left + flown * _EVALUATIONS_A_SECOND
        self.left = min(earned, _EVALUATIONS_AHEAD) - evaluations

    def _too_slow(self, time: float, step: float, state: Array) -> str:
        """Why a flight takes too many evaluations, and what to do about it."""
        said = f"at t = {time:.6g} s: steps of {step:.2g} s are needed"
        stiffest = max(_decays(self.loop), default=None)
        if stiffest is not None and stiffest.rate * step > _STIFF:
            longest = 2.0 / stiffest.rate
            instead = f"rk4 with steps of {longest:.2g} s, or " if longest > _SHORTEST else ""
            said += f" (stiff: {stiffest.cause}); use {instead}{stiffest.remedy}"
            return said + _acting(self.loop, time, state, lag=False)
        lag = " or a shorter time constant of the motors" if self.loop.lag else ""
        return f"{said}{_acting(self.loop, time, state)}; use rk4, looser tolerances{lag}"


def _sample_times(stretch: _Stretch, rate: float) -> Array:
    """Multiples of 1 / rate after the begin of a stretch, up to its end."""
    first = int(np.floor(stretch.begin * rate + _SAME)) + 1
    last = int(np.floor(stretch.end * rate + _SAME))
    times = np.arange(first, last + 1) / rate
    if len(times) and abs(times[-1] - stretch.end) * rate <= _SAME:
        times[-1] = stretch.end
    return times


def _first_end(
    envelope: Envelope, path: Callable[[float], Array], good: float, bad: float
) -> float:
    """The first time in a step, to a millionth of it, at which the flight cannot go on."""
    for _ in range(20):
        middle = 0.5 * (good + bad)
        if envelope.reason(middle, path(middle)):
            bad = middle
        else:
            good = middle
    return bad


class _Fixed:
    """Runge and Kutta's classical method in steps of one grid, in C where the back end is C.

    A sample interval is a whole number of steps; breaks of the push that fall between the grid's
    instants end a step early. Those short steps, and steps that the compiled loop leaves (whose
    thrusts meet a limit), are taken in Python.
    """

    def __init__(self, loop: ClosedLoop, settings: Settings, envelope: Envelope) -> None:
        self.loop, self.settings, self.envelope = loop, settings, envelope
        self.every = max(int(np.ceil(1.0 / (settings.rate * settings.step) - _SAME)), 1)
        self.size = 1.0 / (settings.rate * self.every)
        _refuse_growing(loop, self.size)

    def __call__(
        self, stretch: _Stretch, start: Array, progress: Callable[[float], None]
    ) -> _Flown:
        loop, size, every = self.loop, self.size, self.every
        compiled = CompiledLoop.of(loop, size, self.envelope.bounds, stretch.pushed)
        # Steps are numbered by their ends on the grid; those from `whole` to `cut` are not short.
        number = int(np.floor(stretch.begin / size + _SAME))
        last = int(np.ceil(stretch.end / size - _SAME))
        whole = number + (stretch.begin / size - number > _SAME)
        cut = last - (last - stretch.end / size > _SAME)
        samples: list[Array] = [np.zeros((0, len(start)))]
        times = np.arange(number // every + 1, cut // every + 1) / self.settings.rate
        if cut == last and cut % every == 0 and len(times):
            times[-1] = stretch.end
        time, state, stopped = stretch.begin, start, ""
        while number < last and not stopped:
            taken = 0
            if compiled is not None and whole <= number < cut:
                count = min(_STEPS_A_CALL, cut - number)
                taken, kept, state = compiled(time, state, count, every, number)
                samples.append(kept)
            if taken == 0:
                taken = 1
                ahead = (stretch.end if number + 1 == last else (number + 1) * size) - time
                with np.errstate(all="ignore"):
                    state = _step(loop, time, state, ahead, stretch.pushed)
                if number < cut and (number + 1) % every == 0:
                    samples.append(state[np.newaxis])
            number += taken
            time = stretch.end if number == last else number * size
            stopped = self.envelope.reason(time, state)
            progress(time)
        states = np.concatenate(samples)
        return _Flown(Course(times[: len(states)], states, stopped), time, state)


@dataclass(frozen=True, order=True)
class _Decay:
    """A rate (1/s) at which something decays, what that is, and how to slow it."""

    rate: float
    cause: str
    remedy: str
    root: complex = field(compare=False)


def _decays(loop: ClosedLoop) -> list[_Decay]:
    """What decays of itself: lagging thrusts, and errors under computed torque."""
    found = []
    # A lag that is nothing, next to any step, is not nothing to divide by.
    lag = max(loop.lag, 1e-30)
    slower = f"a longer time constant of the motors than {loop.lag:g} s, or none"
    if loop.lag:
        found.append(_Decay(1.0 / lag, "the motors' lag", slower, complex(-1.0 / lag)))
    if loop.controller.law == "computed_torque":
        gains = loop.controller.gains
        pairs = {*zip(gains.damping.tolist(), gains.stiffness.tolist(), strict=True)}
        for damping, stiffness in sorted(pairs):
            # Joints do not lag, so their errors obey the second, those of the base the third order.
            orders = [np.array([1.0, damping, stiffness])]
            if loop.lag:
                orders.append(np.array([lag, 1.0, damping, stiffness]) / lag)
            found += [
                _Decay(abs(root), "the gains of control", "lower gains", complex(root))
                for root in itertools.chain.from_iterable(np.roots(order) for order in orders)
                if root.real < 0.0
            ]
    return found


def _refuse_growing(loop: ClosedLoop, size: float) -> None:
    """Raise `UsageError` for steps in which what should decay grows."""
    for decay in sorted(_decays(loop), reverse=True):
        z = size * decay.root
        if not abs(1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0) <= 1.0 + 1e-9:
            raise UsageError(
                f"integration.step: in steps of {size:.3g} s rk4 makes errors grow, because of "
                f"{decay.cause}; use steps of at most {2.0 / decay.rate:.2g} s, or {decay.remedy}"
            )


def _acting(loop: ClosedLoop, time: float, state: Array, lag: bool = True) -> str:
    """What makes integration hard besides the machine itself: thrusts at limits, lag."""
    found = ""
    rotors = [str(rotor + 1) for rotor in loop.saturated(time, state)]
    if rotors:
        found += f"; thrusts at their limits: {', '.join(rotors)} (rk4 keeps its steps there)"
    if lag and loop.lag:
        found += f"; the motors lag by {loop.lag:g} s"
    return found


def _step(loop: ClosedLoop, time: float, state: Array, size: float, pushed: bool) -> Array:
    first = loop.derivative(time, state, pushed)
    second = loop.derivative(time + size / 2.0, state + size / 2.0 * first, pushed)
    third = loop.derivative(time + size / 2.0, state + size / 2.0 * second, pushed)
    fourth = loop.derivative(time + size, state + size * third, pushed)
    return state + size / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
