"""Integrators of the closed loop, and a flight from interval to interval until it cannot go on.

In fixed steps: the classical method of Runge and Kutta. In steps of adaptive size: the method of
eighth order by Dormand and Prince (DOP853). Both are in C, or else in Python, where SciPy has the
latter.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoops
from gibbs_codegen.flight.integration.envelope import Envelope, integration_burdens, stable_modes
from gibbs_codegen.flight.integration.state_history import (
    SAME_TIME,
    InputRanges,
    IntervalResult,
    Loads,
    SmoothInterval,
    StateHistory,
)
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.scenario.parts import Settings
from gibbs_codegen.runtime.program_flow import (
    ENDED,
    REFUSED,
    TOO_SHORT,
    TOO_SLOW,
    Flow,
    ProgramFlow,
)

if TYPE_CHECKING:
    from scipy.integrate import DOP853

# What a call of the compiled loop takes on at most, so that progress shows and Ctrl-C is heard.
STEPS_A_CALL = 20_000


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

    def stretches(self, interval: SmoothInterval) -> list[Stretch]:
        """Whole steps on the grid, after a step up to it and before one from it where need be."""
        begin, end, size, every = interval.begin, interval.end, self.size, self.every
        first, last = (_on_grid(time / size) for time in (begin, end))
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
        first, last = (_on_grid(t / self.size) for t in (interval.begin, interval.end))
        count = self.every
        times = np.arange(math.floor(first) // count + 1, math.floor(last) // count + 1)
        sampled: Array = times / self.rate
        if len(times) and times[-1] * count == last:
            sampled[-1] = interval.end
        return sampled


def _on_grid(steps: float) -> float:
    """A number of steps, whole if it is so but for rounding."""
    return float(round(steps)) if abs(steps - round(steps)) <= SAME_TIME else steps


class FixedStepIntegrator:
    """Equal steps on one grid of time, of which a whole number makes a sample interval.

    A push that begins or ends between instants of the grid ends a step early.
    """

    def __init__(
        self, loop: ClosedLoop, settings: Settings, envelope: Envelope, compiled: CompiledLoops
    ) -> None:
        self.loop, self.envelope = loop, envelope
        self.grid, self.compiled = StepGrid(settings), compiled
        check_stability(loop, self.grid.size)

    def __call__(
        self, interval: SmoothInterval, start: Array, progress: Callable[[float], None]
    ) -> IntervalResult:
        """Integrate from a state (size) over an interval; `progress` is told the time, s."""
        samples, inputs = [np.zeros((0, len(start)))], InputRecord(self.loop, interval.loads)
        time, state, stopped = interval.begin, start, ""
        for stretch in self.grid.stretches(interval):
            done = 0
            while done < stretch.steps and not stopped:
                taken, kept, state, goes_on = self._advance(stretch, done, time, state, inputs)
                samples.append(kept)
                done += taken
                time = min((stretch.first + done) * self.grid.size, interval.end)
                stopped = "" if goes_on else self.envelope.reason(time, state)
                progress(time)
        states, times = np.concatenate(samples), self.grid.sample_times(interval)
        end = time if stopped else interval.end
        return IntervalResult(
            times[: len(states)], states, inputs.all_ranges(), end, state, stopped
        )

    def _advance(
        self, stretch: Stretch, done: int, time: float, state: Array, inputs: InputRecord
    ) -> tuple[int, Array, Array, bool]:
        """Take steps of a stretch, of which `done` were taken: many in C, or one in Python.

        Returns how many, samples (s, size), the last state, and whether it is known that the flight
        goes on from it.
        """
        number, loads = stretch.first + done, inputs.loads
        if (compiled := self.compiled.at(loads)) is not None:
            count = min(STEPS_A_CALL, stretch.steps - done)
            taken, kept, last = compiled(
                time, state, stretch.step, count, stretch.every, number, inputs.ranges
            )
            if taken:
                return taken, kept, last, compiled.goes_on
        inputs.state(time, state)
        with np.errstate(all="ignore"):
            state = self.loop.step(time, state, stretch.step, loads)
        return 1, state[np.newaxis][: (number + 1) % stretch.every == 0], state, False


def check_stability(loop: ClosedLoop, size: float) -> None:
    """Raise `UsageError` for steps in which what should decay grows."""
    for mode in stable_modes(loop):
        if words := mode.fault(size):
            raise UsageError(f"integration.step: {words}")


# States whose inputs are computed at once: bounds the memory.
_BATCH = 4096


class InputRecord:
    """Gathers the inputs of the states that an integrator comes to while the same acts."""

    def __init__(self, loop: ClosedLoop, loads: Loads) -> None:
        self.loop, self.loads = loop, loads
        self._ranges: list[InputRanges] = []
        self._times: list[float] = []
        self._states: list[Array] = []

    def state(self, time: float, state: Array) -> None:
        """Take a state (size) at a time, s."""
        if np.all(np.isfinite(state)):
            self._times.append(time)
            self._states.append(state)
        if len(self._times) >= _BATCH:
            self._compute()

    def ranges(self, ranges: InputRanges) -> None:
        """Take ranges that are known already."""
        self._ranges.append(ranges)

    def all_ranges(self) -> list[InputRanges]:
        """The ranges of all that was taken; a state is a stretch of its own."""
        if self._times:
            self._compute()
        return self._ranges

    def _compute(self) -> None:
        time, states = np.array(self._times), np.stack(self._states)
        both = self.loop.inputs(time, self.loop.parts(states), self.loads)
        inputs = np.stack(both, axis=1)
        self._ranges.append(InputRanges(time, np.stack([inputs, inputs], axis=2)))
        self._times.clear()
        self._states.clear()


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
# Shares of a step at which inputs are looked at.
_SHARES = np.array([0.25, 0.5, 0.75, 1.0])
# Knots at which steps end before one across a knot is tried again.
_MOST_STOPS = 64
# Steps, in s, that a flight can be waited for.
_SHORTEST = 1e-6


class AdaptiveIntegrator:
    """Steps of adaptive size, sampled by their dense output: in C, or else by SciPy.

    What C refuses, as it does a wrench that rotors cannot produce, Python says.
    """

    def __init__(
        self, loop: ClosedLoop, settings: Settings, envelope: Envelope, compiled: CompiledLoops
    ) -> None:
        self.loop, self.settings, self.envelope = loop, settings, envelope
        self.compiled = compiled
        # Evaluations that may still be spent; a smooth second saves up no more than this.
        self.budget: float = _EVALUATIONS_AHEAD
        # The step, s, that the interval before would have gone on with.
        self.ahead: float | None = None
        # Of absolute tolerances (size).
        self.scale = np.ones(loop.size)
        self.scale[loop.layout.places.work] *= _WORK_SCALE
        self.exact = settings.relative_tolerance, settings.absolute_tolerance
        self.rough = tuple(map(max, self.exact, _NOT_SMOOTH))
        # Knots of the motion that is followed, s, at which third derivatives jump; and their steps.
        follows, reference = loop.hold is None, loop.controller.reference
        self.knots = [*(reference.knots.tolist() if follows else []), math.inf]
        self.piece = reference.step if follows else 0.0

    def __call__(
        self, interval: SmoothInterval, start: Array, progress: Callable[[float], None]
    ) -> IntervalResult:
        """Integrate from a state (size) over an interval; `progress` is told the time, s."""
        self.budget = min(self.budget + _EVALUATIONS_AN_INTERVAL, _EVALUATIONS_AHEAD)
        times = StepGrid(self.settings).sample_times(interval)
        begun = IntervalResult(times[:0], np.zeros((0, len(start))), [], interval.begin, start, "")
        slope = self.compiled.slope(interval.loads)
        if slope is not None:
            begun = self._in_c(slope.flow, begun, interval, times, progress)
        if not begun.stopped and begun.end < interval.end:
            begun = self._in_python(begun, interval, times, progress)
        return begun

    def _in_c(
        self,
        steps: ProgramFlow,
        begun: IntervalResult,
        interval: SmoothInterval,
        times: Array,
        progress: Callable[[float], None],
    ) -> IntervalResult:
        """Integrate an interval from its begin on, as far as nothing is refused."""
        samples, inputs, state, stopped, taken = [begun.states], begun.inputs, begun.state, "", 0
        step = self.ahead or self._first_step(interval, state)
        flow = Flow(interval.begin, interval.end, step, budget=self.budget, patience=1)
        flow.income, flow.most = _EVALUATIONS_A_SECOND, _EVALUATIONS_AHEAD
        flow.begin, flow.piece = self.loop.controller.reference.begin, self.piece
        flow.relative, flow.absolute = zip(self.exact, self.rough, strict=True)
        flow.smooth = 0 if self.loop.compensates else 1 if self.loop.hold is not None else 2
        while flow.time < interval.end and flow.reason != REFUSED and not stopped:
            flown = steps(flow, state, self.scale, times[taken:])
            samples.append(flown.samples)
            taken += len(flown.samples)
            inputs.append(InputRanges(flown.instants, np.stack([flown.inputs] * 2, axis=2)))
            state = flown.last
            if flow.reason == TOO_SHORT:
                stopped = self._no_step(flow.time, state)
            elif flow.reason == ENDED:
                stopped = self.envelope.reason(flow.time, state)
            elif flow.reason == TOO_SLOW:
                stopped = self._too_slow(flow.time, flow.taken, state)
            progress(flow.time)
        self.budget, self.ahead = flow.budget, flow.step
        states = np.concatenate(samples)
        return IntervalResult(times[: len(states)], states, inputs, flow.time, state, stopped)

    def _in_python(
        self,
        begun: IntervalResult,
        interval: SmoothInterval,
        times: Array,
        progress: Callable[[float], None],
    ) -> IntervalResult:
        """Integrate an interval that was integrated to some time from there on."""
        from scipy.integrate import DOP853  # Late, as SciPy takes long to import.

        loop, envelope, end = self.loop, self.envelope, interval.end
        solver = DOP853(
            self.compiled.derivative(interval.loads),
            begun.end,
            begun.state,
            end,
            first_step=self.ahead and min(self.ahead, end - begun.end),
        )
        samples, stopped, inputs = [begun.states], "", InputRecord(loop, interval.loads)
        time, state, spent = begun.end, begun.state, 0
        # Steps end at so many knots, after one across a knot failed.
        knots, patience, stops = self.knots, 1, 0
        while time < end and not stopped:
            self._set_tolerances(solver)
            knot = knots[bisect_right(knots, time + SAME_TIME * self.piece)]
            solver.t_bound, solver.status = (knot if stops else end), "running"
            after = min(time + solver.h_abs, solver.t_bound)
            with np.errstate(all="ignore"):
                solver.step()
            if solver.status == "failed":
                stopped = self._no_step(time, state)
                break
            path = solver.dense_output()
            before, time, state = time, solver.t, solver.y
            stops -= stops > 0 and time >= knot
            if after > knot:
                patience = 1 if time > knot else min(2 * patience, _MOST_STOPS)
                stops = 0 if time > knot else patience
            if stopped := envelope.reason(time, state):
                time = _first_violation(envelope, path, before, time)
                state = path(time)
                stopped = envelope.reason(time, state)
            for instant in (before + _SHARES * (time - before)).tolist():
                inputs.state(instant, path(instant))
            inside = times[(times > before) & (times <= time)]
            if len(inside):
                samples.append(path(inside).T)
            earned = self.budget + (time - before) * _EVALUATIONS_A_SECOND
            self.budget = min(earned, _EVALUATIONS_AHEAD) - (solver.nfev - spent)
            spent = solver.nfev
            if not stopped and self.budget < 0.0:
                stopped = self._too_slow(time, time - before, state)
            progress(solver.t)
        self.ahead = solver.h_abs
        states, seen = np.concatenate(samples), begun.inputs + inputs.all_ranges()
        return IntervalResult(times[: len(states)], states, seen, time, state, stopped)

    def _first_step(self, interval: SmoothInterval, state: Array) -> float:
        """The first step, s, from a state (size): Hairer, Nørsett and Wanner (1993), II.4."""
        derivative, duration = (
            self.compiled.derivative(interval.loads),
            interval.end - interval.begin,
        )
        relative, absolute = self.exact
        scale = np.sqrt(len(state)) * (absolute * self.scale + relative * np.abs(state))
        slope = derivative(interval.begin, state)
        size, speed = (float(np.linalg.norm(x / scale)) for x in (state, slope))
        short = min(0.01 * size / speed if min(size, speed) >= 1e-5 else 1e-6, duration)
        ahead = derivative(interval.begin + short, state + short * slope) - slope
        most = max(speed, float(np.linalg.norm(ahead / scale)) / short)
        step = (0.01 / most) ** 0.125 if most > 1e-15 else max(1e-6, 1e-3 * short)
        return min(100.0 * short, step, duration)

    def _no_step(self, time: float, state: Array) -> str:
        """Why a flight cannot go on without a step."""
        burdens = integration_burdens(self.loop, time, state)
        return f"at t = {time:.6g} s: no step is small enough{burdens}"

    def _set_tolerances(self, solver: DOP853) -> None:
        """Set tolerances for the next step."""
        loop = self.loop
        kinked = loop.compensates or (loop.hold is None and loop.saturated(solver.t, solver.y))
        solver.rtol, absolute = self.rough if kinked else self.exact
        solver.atol = absolute * self.scale

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


def _first_violation(
    envelope: Envelope, path: Callable[[float], Array], good: float, bad: float
) -> float:
    """A time, s, at which the flight cannot go on, to a millionth of the step the first one.

    `path` gives the state (size) at times of the step, from `good` to `bad`, s, where it cannot.
    """
    for _ in range(20):
        middle = 0.5 * (good + bad)
        if envelope.reason(middle, path(middle)):
            bad = middle
        else:
            good = middle
    return bad


class Integration:
    """A flight that is integrated from interval to interval, as far as it is wanted.

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
        self._loop = loop
        self._envelope = Envelope(loop, settings.divergence, duration)
        self.compiled = compiled or CompiledLoops(loop, self._envelope.bounds)
        method = AdaptiveIntegrator if settings.method == "adaptive" else FixedStepIntegrator
        self._integrator = method(loop, settings, self._envelope, self.compiled)
        self._times, self._states = [np.array([begin])], [start[np.newaxis].copy()]
        self._inputs = [InputRanges.none(len(loop.vehicle.inputs))]
        self._impacts: list[tuple[float, float]] = []
        self.time, self.state = begin, start
        self._loads: Loads | None = None
        self.stopped = self._envelope.reason(begin, start)
        self._take_hold()

    def advance(self, end: float, progress: Callable[[float], None] = lambda time: None) -> None:
        """Integrate up to a time, or until the flight cannot go on; `progress` is told the time."""
        for interval in self._loop.smooth_intervals(self.time, end):
            if not self.stopped:
                begun, self.stopped = self._loop.begun(interval, self.state)
            if self.stopped:
                break
            self._loads = begun.loads
            result = self._integrator(begun, self.state, progress)
            self._times.append(result.time)
            self._states.append(result.states)
            self._inputs += result.inputs
            self.time, self.state, self.stopped = result.end, result.state, result.stopped
            self._take_hold()

    def _take_hold(self) -> None:
        """Take the impact of constraints that begin to hold now; a sample of now is after it."""
        if not self.stopped and self._loop.takes_hold(self.time):
            self.state, lost = self._loop.held(self.time, self.state)
            self._impacts.append((self.time, float(lost)))
            if self._times[-1][-1:].tolist() == [self.time]:
                self._states[-1][-1] = self.state

    def prepare(self, end: float) -> None:
        """Compile what steps up to a time need, s."""
        inputs = self._loop.hold.inputs if self._loop.hold else None
        for loads in {interval.loads for interval in self._loop.smooth_intervals(self.time, end)}:
            for make in (self.compiled.at, self.compiled.derivative):
                make(loads._replace(inputs=inputs))

    def rate(self) -> Array:
        """Time derivative (size) of the state, under what has acted until now."""
        if self._loads is None:
            first = next(self._loop.smooth_intervals(self.time, self.time + 1.0))
            self._loads = self._loop.begun(first, self.state)[0].loads
        return self.compiled.derivative(self._loads)(self.time, self.state)

    def history(self) -> StateHistory:
        """Samples of the state at multiples of 1 / rate, and at the last instant."""
        samples = StateHistory(
            np.concatenate(self._times),
            np.concatenate(self._states),
            self.stopped,
            InputRanges.joined(self._inputs),
            np.reshape(self._impacts, (-1, 2)),
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

    Samples are at multiples of 1 / rate and the last instant; `progress` is told time and duration.
    Raises `UsageError` for steps of "rk4" so long that errors would grow.
    """
    integration = Integration(loop, start, settings, duration)
    integration.advance(duration, lambda time: progress(time, duration))
    return integration.history()
