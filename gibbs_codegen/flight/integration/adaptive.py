"""Adaptive integration: SciPy's method of eighth order by Dormand and Prince (DOP853)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import DOP853

from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoops
from gibbs_codegen.flight.integration.envelope import Envelope, integration_burdens, stable_modes
from gibbs_codegen.flight.integration.input_history import SeenInputs
from gibbs_codegen.flight.integration.state_history import (
    Array,
    IntervalResult,
    SmoothInterval,
    StateHistory,
)
from gibbs_codegen.flight.scenario.scenario import Settings

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
# Steps, in s, that a flight can be waited for.
_SHORTEST = 1e-6


class AdaptiveIntegrator:
    """Steps of adaptive size, sampled by their dense output."""

    def __init__(self, loop: ClosedLoop, settings: Settings, envelope: Envelope) -> None:
        self.loop, self.settings, self.envelope = loop, settings, envelope
        self.compiled = CompiledLoops(loop, envelope.bounds)
        # Evaluations that may still be spent; a smooth second saves up no more than this.
        self.budget: float = _EVALUATIONS_AHEAD
        # The step, s, that the interval before would have gone on with.
        self.ahead: float | None = None

    def __call__(
        self, interval: SmoothInterval, start: Array, progress: Callable[[float], None]
    ) -> IntervalResult:
        """Integrate from a state (size) over an interval; `progress` is told the time, s."""
        loop, envelope = self.loop, self.envelope
        solver = self._solver(interval, start)
        samples, stopped = [np.zeros((0, len(start)))], ""
        inputs = SeenInputs(loop, interval.acting)
        sample_times = interval.sample_times(self.settings.rate)
        time, state, spent = interval.begin, start, 0
        while solver.status == "running" and not stopped:
            self._set_tolerances(solver)
            with np.errstate(all="ignore"):
                message = solver.step()
            if solver.status == "failed":
                stopped = f"at t = {time:.6g} s: no step is small enough ({message})"
                stopped += integration_burdens(loop, time, state)
                break
            path = solver.dense_output()
            before, time, state = time, solver.t, solver.y
            if stopped := envelope.reason(time, state):
                time = _first_violation(envelope, path, before, time)
                state = path(time)
                stopped = envelope.reason(time, state)
            inputs.path(path, before + _SHARES * (time - before))
            inside = sample_times[(sample_times > before) & (sample_times <= time)]
            if len(inside):
                samples.append(path(inside).T)
            self._spend(time - before, solver.nfev - spent)
            spent = solver.nfev
            if not stopped and self.budget < 0.0:
                stopped = self._too_slow(time, time - before, state)
            progress(solver.t)
        self.ahead = solver.h_abs
        states = np.concatenate(samples)
        history = StateHistory(sample_times[: len(states)], states, stopped, inputs.found())
        return IntervalResult(history, time, state)

    def _solver(self, interval: SmoothInterval, start: Array) -> DOP853:
        """The solver of an interval, which begins with a state (size), and may take more steps."""
        self.budget = min(self.budget + _EVALUATIONS_AN_INTERVAL, _EVALUATIONS_AHEAD)
        return DOP853(
            self.compiled.derivative(interval.acting),
            interval.begin,
            start,
            interval.end,
            first_step=self.ahead and min(self.ahead, interval.end - interval.begin),
        )

    def _set_tolerances(self, solver: DOP853) -> None:
        """Set tolerances for the next step."""
        settings, loop = self.settings, self.loop
        relative, absolute = settings.relative_tolerance, settings.absolute_tolerance
        if loop.compensates or (loop.held is None and loop.saturated(solver.t, solver.y)):
            relative, absolute = max(relative, _NOT_SMOOTH[0]), max(absolute, _NOT_SMOOTH[1])
        solver.rtol = relative
        solver.atol = np.full(len(solver.y), absolute)
        solver.atol[loop.work_place] *= _WORK_SCALE

    def _spend(self, flown: float, evaluations: int) -> None:
        earned = self.budget + flown * _EVALUATIONS_A_SECOND
        self.budget = min(earned, _EVALUATIONS_AHEAD) - evaluations

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
