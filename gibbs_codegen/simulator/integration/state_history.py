"""The states that an integrator leaves, and the intervals of time that it works on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.simulator.integration.acting import Acting
from gibbs_codegen.simulator.integration.input_ranges import InputRanges

Array = NDArray[np.float64]

# Times are the same, and steps whole, to this share of a step.
SAME_TIME = 1e-6


@dataclass(frozen=True)
class StateHistory:
    """Samples of the state (s, size) at times (s), and why there are no more; "" if complete.

    `inputs` has the ranges of the inputs between the samples.
    """

    time: Array
    states: Array
    stopped: str
    inputs: InputRanges


@dataclass(frozen=True)
class SmoothInterval:
    """An interval of time, s, all through which the same acts on the robot."""

    begin: float
    end: float
    acting: Acting

    def sample_times(self, rate: float) -> Array:
        """Multiples of 1 / rate (s) after the start of the interval, up to its end."""
        first = int(np.floor(self.begin * rate + SAME_TIME)) + 1
        last = int(np.floor(self.end * rate + SAME_TIME))
        times = np.arange(first, last + 1) / rate
        if len(times) and abs(times[-1] - self.end) * rate <= SAME_TIME:
            times[-1] = self.end
        return times


@dataclass(frozen=True)
class IntervalResult:
    """An interval that was integrated.

    `samples` are those after its begin; `end` (s) and `state` (size) are where integration came to.
    """

    samples: StateHistory
    end: float
    state: Array
