"""Integration of a flight from interval to interval, until its end or until it cannot go on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.scenario.scenario import Settings
from gibbs_codegen.simulator.integration.adaptive import AdaptiveIntegrator
from gibbs_codegen.simulator.integration.closed_loop import ClosedLoop
from gibbs_codegen.simulator.integration.envelope import Envelope
from gibbs_codegen.simulator.integration.fixed_step import FixedStepIntegrator
from gibbs_codegen.simulator.integration.input_ranges import InputRanges
from gibbs_codegen.simulator.integration.state_history import Array, StateHistory


def integrate(
    loop: ClosedLoop,
    start: Array,
    duration: float,
    settings: Settings,
    progress: Callable[[float, float], None] = lambda time, duration: None,
) -> StateHistory:
    """Integrate the state of a closed loop from time 0 on.

    Stops early at a singularity, where control is lost, and where "adaptive" needs more evaluations
    than can be waited for.

    Args:
        loop: The closed loop.
        start: State (size) at time 0.
        duration: Time to integrate, s.
        settings: Method, tolerances or step, and rate of samples.
        progress: Is told the time reached and the duration, s.

    Returns:
        Samples of the state at multiples of 1 / rate, and at the last instant.

    Raises:
        UsageError: For steps of "rk4" that are so long that errors under control, or of lagging
            motors, would grow.
    """
    envelope = Envelope(loop, settings.divergence, duration)
    method = AdaptiveIntegrator if settings.method == "adaptive" else FixedStepIntegrator
    integrator = method(loop, settings, envelope)
    times, states = [np.zeros(1)], [start[np.newaxis]]
    inputs = [InputRanges.none(len(loop.vehicle.inputs))]
    now, state = 0.0, start
    stopped = envelope.reason(now, state)
    for interval in loop.smooth_intervals(duration):
        if stopped:
            break
        result = integrator(interval, state, lambda time: progress(time, duration))
        times.append(result.samples.time)
        states.append(result.samples.states)
        inputs.append(result.samples.inputs)
        now, state, stopped = result.end, result.state, result.samples.stopped
    if now > next(time[-1] for time in reversed(times) if len(time)):
        times.append(np.array([now]))
        states.append(state[np.newaxis])
    time, samples = np.concatenate(times), np.concatenate(states)
    # Samples in which control was lost would dwarf all others.
    kept = envelope.holds(time, samples)
    kept[0] = True
    return StateHistory(time[kept], samples[kept], stopped, InputRanges.joined(inputs))
