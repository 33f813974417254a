"""The grid of time of equal steps, of which a whole number makes a sample interval."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gibbs_codegen.scenario.scenario import Settings
from gibbs_codegen.simulator.integration.state_history import SAME_TIME, Array, SmoothInterval


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
