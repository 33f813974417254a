"""Integration of the closed loop: a flight from interval to interval until it cannot go on.

In equal steps: the classical method of Runge and Kutta. In steps of adaptive size: the method of
eighth order by Dormand and Prince (DOP853). Both are in C, or else in Python.
"""

from __future__ import annotations

import ctypes
import itertools
import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoops
from gibbs_codegen.flight.integration.envelope import Envelope, integration_burdens, stable_modes
from gibbs_codegen.flight.integration.python_flow import HALVINGS, PythonFlow
from gibbs_codegen.flight.integration.state_history import (
    SAME_TIME,
    Impact,
    InputRanges,
    Loads,
    SmoothInterval,
    StateHistory,
)
from gibbs_codegen.flight.integration.stops import after_impacts
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.scenario.parts import Settings
from gibbs_codegen.runtime.program_flow import (
    ENDED,
    GOES_ON,
    REFUSED,
    TOO_SHORT,
    TOO_SLOW,
    Flow,
    Leg,
    Samples,
)

# What a call of the compiled loop takes on at most, of equal steps and of adaptive size, so that
# progress shows and Ctrl-C is heard; and intervals of a law that is sampled.
STEPS_A_CALL = 20_000, 100
_INTERVALS_A_CALL = 1000


class Stretch(NamedTuple):
    """Steps of one size, s, after `first` steps of the grid; each `every`-th of all is a sample."""

    first: int
    steps: int
    step: float
    every: int


class StepGrid:
    """Equal steps on one grid of time, by the greatest step and the rate of samples."""

    def __init__(self, settings: Settings) -> None:
        self.rate = settings.rate
        # Steps to a sample, and their size, s.
        self.every = max(int(np.ceil(1.0 / (settings.rate * settings.step) - SAME_TIME)), 1)
        self.size = 1.0 / (settings.rate * self.every)
        # Why steps are not as long as they may be, in words.
        cut = f"cut to {self.size:.4g} s by integration.rate, {settings.rate:g} Hz; "
        self.cut = cut if self.size < settings.step * (1.0 - SAME_TIME) else ""

    def stretches(self, interval: SmoothInterval) -> list[Stretch]:
        """Whole steps on the grid, after a step up to it and before one from it where need be."""
        begin, end, size, every = interval.begin, interval.end, self.size, self.every
        first, last = _on_grid(begin / size), _on_grid(end / size)
        whole, cut = math.ceil(first), math.floor(last)
        never = cut + 2  # What ends off the grid is no sample.
        if whole > cut:
            return [Stretch(cut, 1, end - begin, never)]
        stretches = [
            Stretch(whole - 1, 1, whole * size - begin, every),
            Stretch(whole, cut - whole, size, every),
            Stretch(cut, 1, end - cut * size, never),
        ]
        return stretches[whole == first : 2 + (cut < last)]

    def sample_times(self, interval: SmoothInterval) -> Array:
        """Times of samples after an interval's begin, s; its end too if it is on the grid."""
        first, last = _on_grid(interval.begin / self.size), _on_grid(interval.end / self.size)
        after, until = math.floor(first) // self.every + 1, math.floor(last) // self.every + 1
        sampled: Array = np.arange(after, until) / self.rate
        if after < until and (until - 1) * self.every == last:
            sampled[-1] = interval.end
        return sampled


def _on_grid(steps: float) -> float:
    """A number of steps, whole if it is so but for rounding."""
    whole = round(steps)
    return float(whole) if abs(steps - whole) <= SAME_TIME else steps


def check_stability(loop: ClosedLoop, size: float, cut: str = "") -> None:
    """Raise `UsageError` for steps, s, in which what should decay grows, and are cut to that."""
    for mode in stable_modes(loop):
        if words := mode.fault(size):
            raise UsageError(f"integration.step: {cut}{words}")


# Work, in J, next to angles and lengths: a vehicle of some kg at some m/s.
_WORK_SCALE = 100.0
# Evaluations that may be spent: so many for each second flown, and so many ahead of that. Smooth
# flights take 500 a second, 2000 at the tightest tolerances.
_EVALUATIONS_A_SECOND = 20_000
_EVALUATIONS_AHEAD = 10_000
# How many the start of an interval may take besides, which is with a step of its own.
_EVALUATIONS_AN_INTERVAL = 40
# Least tolerances where no order helps: rates have kinks while an input is saturated, and where the
# motors' lag is compensated they jump a little at each knot of the desired motion.
_NOT_SMOOTH = (1e-6, 1e-7)
# A step times the rate of the fastest mode, from which on stiffness is what makes steps small.
_STIFF = 0.5
# Steps, in s, that a flight can be waited for.
_SHORTEST = 1e-6


class Integration:
    """A flight that is integrated from interval to interval, as far as it is wanted.

    Steps are equal ones on one grid of time, which a push that begins or ends between its instants
    cuts short, or of adaptive size. What C refuses, as it does a wrench that rotors cannot produce,
    Python says.

    Stops early at a singularity, where control is lost, where "adaptive" needs more evaluations
    than can be waited for, and where a controller commands what inputs cannot be. `duration`, s, is
    what errors may take to grow. `compiled` are the loops of another flight in the same settings,
    which need not be made again. Raises `UsageError` for steps of "rk4" so long that errors under
    control, or of lagging motors, would grow.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        start: Array,
        settings: Settings,
        duration: float,
        begin: float = 0.0,
        compiled: CompiledLoops | None = None,
    ) -> None:
        # What rests on a stop makes another of it.
        self.loop = loop
        self._envelope = Envelope(loop, settings.divergence, duration, (begin, start))
        self.compiled = compiled or CompiledLoops(loop, self._envelope.bounds, settings.method)
        self._grid, self._adaptive = StepGrid(settings), settings.method == "adaptive"
        if not self._adaptive:
            check_stability(loop, self._grid.size, self._grid.cut)
        # Scales of absolute tolerances (size).
        self._scale = np.ones(loop.size)
        self._scale[loop.layout.places.work] *= _WORK_SCALE
        follows, reference = loop.hold is None, loop.controller.reference
        self._flow = flow = Flow(budget=_EVALUATIONS_AHEAD, income=_EVALUATIONS_A_SECOND)
        flow.extra, flow.most = _EVALUATIONS_AN_INTERVAL, _EVALUATIONS_AHEAD
        # At knots of the motion that is followed third derivatives jump.
        flow.begin, flow.piece = reference.begin, reference.step if follows else 0.0
        exact = settings.relative_tolerance, settings.absolute_tolerance
        rough = tuple(map(max, exact, _NOT_SMOOTH))
        flow.relative, flow.absolute = zip(exact, rough, strict=True)
        flow.scale = self._scale.ctypes.data
        flow.smooth = 0 if loop.compensates else 2 if follows else 1
        self._times, self._states = [np.array([begin])], [start[np.newaxis].copy()]
        self._inputs = [InputRanges.none(len(loop.vehicle.inputs))]
        self._impacts: list[Impact] = []
        # Whether what acts has changed at a time that was not known before.
        self._changed = False
        self.time, self.state = begin, start
        self._loads: Loads | None = None
        self.stopped = self._envelope.reason(begin, start)
        self._take_hold()

    def advance(self, end: float, progress: Callable[[float], None] = lambda time: None) -> None:
        """Integrate up to a time, or until the flight cannot go on; `progress` gets the time."""
        while self.time < end and not self.stopped:
            self._changed = False
            intervals = self.loop.smooth_intervals(self.time, end)
            for _, alike in itertools.groupby(intervals, lambda interval: interval.loads):
                left = [*alike]
                while left and not self.stopped and not self._changed:
                    left = left[self._fly(left[:_INTERVALS_A_CALL], progress) :]
                if self._changed:
                    break

    def _fly(self, intervals: list[SmoothInterval], progress: Callable[[float], None]) -> int:
        """Fly through intervals in which the same acts; how many were begun."""
        loop, law = self.loop, self.loop.sampled
        if law is not None:
            loads = intervals[0].loads._replace(inputs=law.inputs)
            if self.compiled.at(loads) is not None:
                ahead = law.ahead(np.array([interval.begin for interval in intervals]))
                if begun := self._integrate(intervals, loads, progress, ahead):
                    return begun
        if loop.hold is not None:
            first, self.stopped = loop.begun(intervals[0], self.state)
            intervals = [first]
        if not self.stopped:
            self._integrate(intervals, intervals[0].loads, progress)
        return len(intervals)

    def _integrate(
        self,
        intervals: Sequence[SmoothInterval],
        loads: Loads,
        progress: Callable[[float], None],
        ahead: Samples | None = None,
    ) -> int:
        """Integrate over intervals in which the same acts; how many were begun.

        `progress` is called with the time, s. `ahead` are samples of a law, at the begins of the
        intervals; what C refuses of them is left.
        """
        flow, loop, state = self._flow, self.loop, self.state
        whole = SmoothInterval(intervals[0].begin, intervals[-1].end, loads)
        times, law = self._grid.sample_times(whole), loop.sampled if ahead else None
        legs, firsts = self._legs(intervals, ahead)
        compiled = self.compiled.at(loads)
        python = PythonFlow(loop, self._envelope, loads)
        samples, taken = list[Array](), 0
        begins = np.empty((len(legs), len(state))) if law and loop.sensors else None
        flow.time, flow.leg, flow.done, flow.begun, flow.sampled = whole.begin, 0, 0, 0, 0
        if self._adaptive and not flow.step:
            flow.step = self._first_step(whole, loads)
        flow.halvings = HALVINGS if np.any(loads.stops) else 0
        while flow.leg < len(legs) and not self.stopped and not self._changed:
            flow.steps, flow.reason = STEPS_A_CALL[self._adaptive], REFUSED
            if compiled is not None:
                left = times[taken:]
                flown = compiled.flow(flow, legs, state, left, ahead, begins)
                samples.append(flown.samples)
                state, taken = flown.last, taken + len(flown.samples)
                seen = np.concatenate((left[: len(flown.samples)], [flow.time]))
                self._inputs.append(InputRanges(seen, flown.ranges))
            if flow.reason == REFUSED:
                leg, left = legs[flow.leg], times[taken:]
                if ahead:
                    if not flow.begun:
                        break
                    # What C refuses goes on in Python under the command of this leg.
                    python.loads = loads._replace(inputs=ahead.commands[leg.command])
                kept, state = self._in_python(python, leg, state, left, progress)
                samples.append(kept)
                taken += len(kept)
            if flow.reason != GOES_ON:
                self.stopped = self._stopped(state)
                self._changed = flow.reason == ENDED and not self.stopped
            progress(flow.time)
        begun = bisect_left(firsts, flow.leg + flow.begun)
        if ahead and law:
            if not begun:
                return 0
            loop.took(law, ahead, begun, None if begins is None else begins[firsts[:begun]])
            loads = loads._replace(inputs=law.inputs)
        self._times.append(times[:taken])
        self._states.append(samples[0] if len(samples) == 1 else np.concatenate(samples))
        self._inputs += python.ranges()
        self.time, self.state, self._loads = flow.time, state, loads
        self._take_hold()
        return begun

    def _legs(
        self, intervals: Sequence[SmoothInterval], ahead: Samples | None
    ) -> tuple[ctypes.Array[Leg], list[int]]:
        """Legs of intervals, and the place of the first leg of each."""
        rows: list[Leg] = []
        firsts: list[int] = []
        for k, interval in enumerate(intervals):
            firsts.append(len(rows))
            begin, due = interval.begin, 0 if ahead is None else ahead.due[k]
            acting = 0 if ahead is None else ahead.acting[k]
            if self._adaptive:
                rows.append(Leg(begin, interval.end, 0.0, 0, 1, 0, due, acting))
                continue
            for first, steps, step, every in filter(itemgetter(1), self._grid.stretches(interval)):
                end = min((first + steps) * self._grid.size, interval.end)
                rows.append(Leg(begin, end, step, steps, every, first, due, acting))
                begin, due = end, 0
            if len(rows) == firsts[-1]:  # As short as rounding: nothing moves, and no sample ends.
                rows.append(Leg(begin, interval.end, 0.0, 0, 2, 0, due, acting))
            rows[-1].end = interval.end
        return (Leg * len(rows))(*rows), firsts

    def _in_python(
        self,
        python: PythonFlow,
        leg: Leg,
        state: Array,
        times: Array,
        progress: Callable[[float], None],
    ) -> tuple[Array, Array]:
        """One equal step, or those of adaptive size to the end of a leg."""
        flow = self._flow
        if not flow.begun:
            flow.begun, flow.done = 1, 0
            flow.budget = min(flow.budget + flow.extra, flow.most)
        if self._adaptive:
            derivative = self.compiled.derivative(python.loads)
            flown = python.steps(flow, leg, state, self._scale, times, derivative, progress)
        else:
            flown = python.step(flow, leg, state)
        if flow.time >= leg.end:
            flow.leg, flow.begun = flow.leg + 1, 0
        return flown

    def _stopped(self, state: Array) -> str:
        """Why the flight cannot go on from where it is, "" if it can."""
        flow = self._flow
        if flow.reason == TOO_SHORT:
            burdens = integration_burdens(self.loop, flow.time, state)
            return f"at t = {flow.time:.6g} s: no step is small enough{burdens}"
        if flow.reason == ENDED:
            return self._envelope.reason(flow.time, state)
        if flow.reason == TOO_SLOW:
            return self._too_slow(flow.time, flow.taken, state)
        return ""

    def _first_step(self, interval: SmoothInterval, loads: Loads) -> float:
        """The first step, s, from the state: Hairer, Nørsett and Wanner (1993), II.4."""
        state, duration = self.state, interval.end - interval.begin
        derivative = self.compiled.derivative(loads)
        relative, absolute = self._flow.relative[0], self._flow.absolute[0]
        scale = np.sqrt(len(state)) * (absolute * self._scale + relative * np.abs(state))
        slope = derivative(interval.begin, state)
        size, speed = (float(np.linalg.norm(x / scale)) for x in (state, slope))
        if not np.isfinite(speed):  # No step will do; one that is a number is found to be none.
            return min(1e-6, duration)
        short = min(0.01 * size / speed if min(size, speed) >= 1e-5 else 1e-6, duration)
        ahead = derivative(interval.begin + short, state + short * slope) - slope
        most = max(speed, float(np.linalg.norm(ahead / scale)) / short)
        step = (0.01 / most) ** 0.125 if most > 1e-15 else max(1e-6, 1e-3 * short)
        return min(100.0 * short, step, duration)

    def _too_slow(self, time: float, step: float, state: Array) -> str:
        """Why a flight takes too many evaluations, and what to do about it."""
        reason = f"at t = {time:.6g} s: steps of {step:.2g} s are needed"
        fastest = next(iter(stable_modes(self.loop)), None)
        if fastest is not None and fastest.rate * step > _STIFF:
            longest = fastest.longest_step
            rk4 = f"rk4 with steps of {longest:.2g} s, or " if longest > _SHORTEST else ""
            reason += f" (stiff: {fastest.cause}); use {rk4}{fastest.remedy}"
            return reason + integration_burdens(self.loop, time, state, lag=False)
        lag = " or a shorter time constant of the motors" if self.loop.lags else ""
        reason += integration_burdens(self.loop, time, state)
        return f"{reason}; use rk4, looser tolerances{lag}"

    def _take_hold(self) -> None:
        """Take the impacts that are due now; a sample of now is after them."""
        loop, around = self.loop, self.loop.environment
        if around and not self.stopped and (self._changed or around.takes_hold(self.time)):
            self.loop, self.state, hits = after_impacts(loop, around, self.time, self.state)
            self._changed |= self.loop is not loop
            self._impacts += hits
            if self._times[-1][-1:].tolist() == [self.time]:
                self._states[-1][-1] = self.state

    def prepare(self, end: float) -> None:
        """Compile what steps up to a time need, s."""
        inputs = self.loop.hold.inputs if self.loop.hold else None
        for loads in {interval.loads for interval in self.loop.smooth_intervals(self.time, end)}:
            self.compiled.at(loads._replace(inputs=inputs))

    def rate(self) -> Array:
        """Time derivative (size) of the state, under what has acted until now."""
        if self._loads is None:
            first = next(self.loop.smooth_intervals(self.time, self.time + 1.0))
            self._loads = self.loop.begun(first, self.state)[0].loads
        return self.compiled.derivative(self._loads)(self.time, self.state)

    def history(self) -> StateHistory:
        """Samples of the state at multiples of 1 / rate, and at the last instant."""
        samples = StateHistory(
            np.concatenate(self._times),
            np.concatenate(self._states),
            self.stopped,
            InputRanges.joined(self._inputs),
            tuple(self._impacts),
            self.loop.environment.rests if self.loop.environment else (),
        )
        return whole_history(samples, self.time, self.state, self._envelope)


def whole_history(
    samples: StateHistory, end: float, state: Array, envelope: Envelope
) -> StateHistory:
    """The samples of a flight and its last instant, without those in which control is lost.

    The first is kept in any case. `end`, s, and `state` (size) are of the last instant.
    """
    time, states = samples.time, samples.states
    if end > time[-1]:
        time, states = np.append(time, end), np.concatenate([states, state[np.newaxis]])
    # Samples in which control was lost would dwarf all others.
    kept = envelope.holds(time, states)
    kept[0] = True
    return replace(samples, time=time[kept], states=states[kept])


def integrate(
    loop: ClosedLoop,
    start: Array,
    duration: float,
    settings: Settings,
    progress: Callable[[float, float], None] = lambda time, duration: None,
) -> StateHistory:
    """Integrate the state of a closed loop from time 0 on, as `Integration` does.

    Samples are at multiples of 1 / rate and the last instant; `progress` is called with time and
    duration. Raises `UsageError` for steps of "rk4" so long that errors would grow.
    """
    integration = Integration(loop, start, settings, duration)
    integration.advance(duration, lambda time: progress(time, duration))
    return integration.history()
