"""Integration of a flight from interval to interval, until its end or until it cannot go on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.flight.integration.adaptive import AdaptiveIntegrator
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.envelope import Envelope
from gibbs_codegen.flight.integration.fixed_step import FixedStepIntegrator
from gibbs_codegen.flight.integration.state_history import Array, InputRanges, StateHistory
from gibbs_codegen.flight.scenario.scenario import Settings


class Integration:
    """A flight that is integrated from interval to interval, as far as it is wanted.

    Stops early at a singularity, where control is lost, where "adaptive" needs more evaluations
    than can be waited for, and where a controller commands what inputs cannot be. `duration`, s, is
    what errors may take to grow. Raises `UsageError` for steps of "rk4" so long that errors under
    control, or of lagging motors, would grow.
    """

    def __init__(
        self,
        loop: ClosedLoop,
        start: Array,
        settings: Settings,
        duration: float,
        begin: float = 0.0,
    ) -> None:
        self._loop = loop
        self._envelope = Envelope(loop, settings.divergence, duration)
        method = AdaptiveIntegrator if settings.method == "adaptive" else FixedStepIntegrator
        self._integrator = method(loop, settings, self._envelope)
        self._times, self._states = [np.array([begin])], [start[np.newaxis]]
        self._inputs = [InputRanges.none(len(loop.vehicle.inputs))]
        self.time, self.state = begin, start
        self.stopped = self._envelope.reason(begin, start)

    def advance(self, end: float, progress: Callable[[float], None] = lambda time: None) -> None:
        """Integrate up to a time, or until the flight cannot go on; `progress` is told the time."""
        for interval in self._loop.smooth_intervals(self.time, end):
            if not self.stopped:
                begun, self.stopped = self._loop.begun(interval, self.state)
            if self.stopped:
                break
            result = self._integrator(begun, self.state, progress)
            self._times.append(result.samples.time)
            self._states.append(result.samples.states)
            self._inputs.append(result.samples.inputs)
            self.time, self.state, self.stopped = result.end, result.state, result.samples.stopped

    def history(self) -> StateHistory:
        """Samples of the state at multiples of 1 / rate, and at the last instant."""
        samples = StateHistory(
            np.concatenate(self._times),
            np.concatenate(self._states),
            self.stopped,
            InputRanges.joined(self._inputs),
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
    return StateHistory(time[kept], states[kept], samples.stopped, samples.inputs)


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
