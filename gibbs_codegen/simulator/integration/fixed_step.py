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
    SAME_TIME,
    Array,
    IntervalResult,
    SmoothInterval,
    StateHistory,
)

# What a call of the compiled loop takes on at most, so that progress shows and Ctrl-C is heard.
_STEPS_A_CALL = 20_000


class FixedStepIntegrator:
    """Equal steps on one grid of time, of which a whole number makes a sample interval.

    A push that begins or ends between instants of the grid ends a step early. Such short steps
    are taken in Python, and so are those in which an input is saturated.

    Args:
        loop: the closed loop to integrate.
        settings: greatest step and rate of samples.
        envelope: where control counts as lost.
    """

    def __init__(self, loop: ClosedLoop, settings: Settings, envelope: Envelope) -> None:
        self.loop, self.settings, self.envelope = loop, settings, envelope
        # Steps to a sample, and their size, s.
        self.every = max(int(np.ceil(1.0 / (settings.rate * settings.step) - SAME_TIME)), 1)
        self.size = 1.0 / (settings.rate * self.every)
        self.compiled = CompiledLoops(loop, envelope.bounds)
        _check_stability(loop, self.size)

    def __call__(
        self, interval: SmoothInterval, start: Array, progress: Callable[[float], None]
    ) -> IntervalResult:
        """Integrate from a state (size) over an interval; `progress` is told the time, s."""
        loop, size, every = self.loop, self.size, self.every
        compiled = self.compiled.at(interval.acting)
        # Steps are numbered by their ends on the grid; those from `whole` to `cut` are not short.
        number = int(np.floor(interval.begin / size + SAME_TIME))
        last = int(np.ceil(interval.end / size - SAME_TIME))
        whole = number + (interval.begin / size - number > SAME_TIME)
        cut = last - (last - interval.end / size > SAME_TIME)
        samples, inputs = [np.zeros((0, len(start)))], SeenInputs(loop, interval.acting)
        times = np.arange(number // every + 1, cut // every + 1) / self.settings.rate
        if cut == last and cut % every == 0 and len(times):
            times[-1] = interval.end
        time, state, stopped = interval.begin, start, ""
        while number < last and not stopped:
            taken = 0
            if compiled is not None and whole <= number < cut:
                count = min(_STEPS_A_CALL, cut - number)
                taken, kept, state = compiled(
                    time, state, size, count, every, number, inputs.ranges
                )
                samples.append(kept)
            if taken == 0:
                taken = 1
                inputs.state(time, state)
                ahead = (interval.end if number + 1 == last else (number + 1) * size) - time
                with np.errstate(all="ignore"):
                    state = rk4_step(loop, time, state, ahead, interval.acting)
                if number < cut and (number + 1) % every == 0:
                    samples.append(state[np.newaxis])
            number += taken
            time = interval.end if number == last else number * size
            stopped = self.envelope.reason(time, state)
            progress(time)
        states = np.concatenate(samples)
        history = StateHistory(times[: len(states)], states, stopped, inputs.found())
        return IntervalResult(history, time, state)


def rk4_step(loop: ClosedLoop, time: float, state: Array, size: float, acting: Acting) -> Array:
    """One step of the classical method of Runge and Kutta.

    Args:
        loop: The closed loop.
        time: Time before the step, s.
        state: State (size) before the step.
        size: Size of the step, s.
        acting: What acts on the robot.

    Returns:
        The state (size) after the step.
    """
    first = loop.derivative(time, state, acting)
    second = loop.derivative(time + size / 2.0, state + size / 2.0 * first, acting)
    third = loop.derivative(time + size / 2.0, state + size / 2.0 * second, acting)
    fourth = loop.derivative(time + size, state + size * third, acting)
    return state + size / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)


def _check_stability(loop: ClosedLoop, size: float) -> None:
    """Raise `UsageError` if there is a mode that should decay and grows in steps of `size` s."""
    for mode in stable_modes(loop):
        z = size * mode.eigenvalue
        if not abs(1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0) <= 1.0 + 1e-9:
            raise UsageError(
                f"integration.step: in steps of {size:.3g} s rk4 makes errors grow, because of "
                f"{mode.cause}; use steps of at most {mode.longest_step:.2g} s, or {mode.remedy}"
            )
