"""Integration in fixed steps: the classical method of Runge and Kutta, in C for the C back end."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoops
from gibbs_codegen.flight.integration.envelope import Envelope, stable_modes
from gibbs_codegen.flight.integration.input_history import SeenInputs
from gibbs_codegen.flight.integration.state_history import (
    SAME_TIME,
    Acting,
    Array,
    IntervalResult,
    SmoothInterval,
    StateHistory,
)
from gibbs_codegen.flight.scenario.scenario import Settings

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

    def __init__(self, loop: ClosedLoop, settings: Settings, envelope: Envelope) -> None:
        self.loop, self.envelope = loop, envelope
        self.grid = StepGrid(settings)
        self.compiled = CompiledLoops(loop, envelope.bounds)
        check_stability(loop, self.grid.size)

    def __call__(
        self, interval: SmoothInterval, start: Array, progress: Callable[[float], None]
    ) -> IntervalResult:
        """Integrate from a state (size) over an interval; `progress` is told the time, s."""
        samples, inputs = [np.zeros((0, len(start)))], SeenInputs(self.loop, interval.acting)
        time, state, stopped = interval.begin, start, ""
        for stretch in self.grid.stretches(interval):
            done = 0
            while done < stretch.steps and not stopped:
                taken, kept, state = self._advance(stretch, done, time, state, inputs)
                samples.append(kept)
                done += taken
                time = min((stretch.first + done) * self.grid.size, interval.end)
                stopped = self.envelope.reason(time, state)
                progress(time)
        states, times = np.concatenate(samples), self.grid.sample_times(interval)
        history = StateHistory(times[: len(states)], states, stopped, inputs.found())
        return IntervalResult(history, time if stopped else interval.end, state)

    def _advance(
        self, stretch: Stretch, done: int, time: float, state: Array, inputs: SeenInputs
    ) -> tuple[int, Array, Array]:
        """Take steps of a stretch, of which `done` were taken: many in C, or one in Python.

        Returns how many, samples (s, size), and the last state.
        """
        number, acting = stretch.first + done, inputs.acting
        if (compiled := self.compiled.at(acting)) is not None:
            count = min(STEPS_A_CALL, stretch.steps - done)
            taken, kept, last = compiled(
                time, state, stretch.step, count, stretch.every, number, inputs.ranges
            )
            if taken:
                return taken, kept, last
        inputs.state(time, state)
        with np.errstate(all="ignore"):
            state = rk4_step(self.loop, time, state, stretch.step, acting)
        return 1, state[np.newaxis][: (number + 1) % stretch.every == 0], state


def rk4_step(loop: ClosedLoop, time: float, state: Array, size: float, acting: Acting) -> Array:
    """The state (size) after one step of the classical method of Runge and Kutta."""
    first = loop.derivative(time, state, acting)
    second = loop.derivative(time + size / 2.0, state + size / 2.0 * first, acting)
    third = loop.derivative(time + size / 2.0, state + size / 2.0 * second, acting)
    fourth = loop.derivative(time + size, state + size * third, acting)
    return state + size / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)


def check_stability(loop: ClosedLoop, size: float) -> None:
    """Raise `UsageError` for steps in which what should decay grows."""
    for mode in stable_modes(loop):
        z = size * mode.eigenvalue
        if not abs(1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0) <= 1.0 + 1e-9:
            raise UsageError(
                f"integration.step: in steps of {size:.3g} s rk4 makes errors grow, because of "
                f"{mode.cause}; use steps of at most {mode.longest_step:.2g} s, or {mode.remedy}"
            )
