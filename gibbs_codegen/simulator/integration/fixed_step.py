"""Integration in fixed steps: the classical method of Runge and Kutta, in C for the C back end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.scenario.scenario import Settings
from gibbs_codegen.simulator.integration.acting import Acting
from gibbs_codegen.simulator.integration.closed_loop import ClosedLoop
from gibbs_codegen.simulator.integration.compiled_loop import CompiledLoops
from gibbs_codegen.simulator.integration.envelope import Envelope
from gibbs_codegen.simulator.integration.error_modes import stable_modes
from gibbs_codegen.simulator.integration.seen_inputs import SeenInputs
from gibbs_codegen.simulator.integration.state_history import (
    Array,
    IntervalResult,
    SmoothInterval,
    StateHistory,
)
from gibbs_codegen.simulator.integration.step_grid import StepGrid, Stretch

# What a call of the compiled loop takes on at most, so that progress shows and Ctrl-C is heard.
STEPS_A_CALL = 20_000


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
