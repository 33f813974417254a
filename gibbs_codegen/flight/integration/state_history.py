"""The states and ranges of inputs that an integrator leaves, and the intervals that it works on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gibbs_codegen.flight.plant.environment import Rests
from gibbs_codegen.flight.plant.vehicle import Array, Flags

# Times are the same, and steps whole, to this share of a step.
SAME_TIME = 1e-6


class InputRanges(NamedTuple):
    """Ranges of the inputs, each over a stretch of time between two samples.

    `time` (k), s, is a time in each stretch; `values` (k, 2, 2, nu) are of the commanded and of the
    applied inputs the least and the greatest.
    """

    time: Array
    values: Array

    @classmethod
    def none(cls, width: int) -> InputRanges:
        """Ranges of no stretch, of `width` inputs."""
        return cls(np.zeros(0), np.zeros((0, 2, 2, width)))

    @classmethod
    def joined(cls, parts: Sequence[InputRanges]) -> InputRanges:
        """Ranges of parts of a flight, at least one, as one."""
        times, values = [part.time for part in parts], [part.values for part in parts]
        return cls(np.concatenate(times), np.concatenate(values))

    def up_to_samples(self, time: Array, commanded: Array, applied: Array) -> Array:
        """Ranges (2, 2, s, nu) since the sample before, with the values at both samples.

        They are the least and the greatest of commanded and applied inputs (s, nu).
        """
        here = np.stack([commanded, applied], axis=1)
        before = np.concatenate([here[:1], here[:-1]])
        ranges = np.stack([np.fmin(here, before), np.fmax(here, before)], axis=2)
        sample = np.searchsorted(time, self.time)
        is_inside = sample < len(time)
        place, values = sample[is_inside], self.values[is_inside]
        np.fmin.at(ranges[:, :, 0], place, values[:, :, 0])
        np.fmax.at(ranges[:, :, 1], place, values[:, :, 1])
        return np.moveaxis(ranges, 0, 2)


class Loads(NamedTuple):
    """Loads: pushes, payloads, and inputs u (nu) that are held, if any.

    `push` says whether the push does (…), `payloads` which of them do (…, p), or one flag for all;
    `holds` which constraints do (…, c), `stops` which of them do from one side alone, pressing or
    not, and `idle` that motors do not run (…). Without `inputs` the law of control commands them at
    every instant.
    """

    push: bool | Flags = False
    payloads: bool | tuple[bool, ...] | Flags = False
    inputs: Array | tuple[float, ...] | None = None
    idle: bool | Flags = False
    holds: bool | tuple[bool, ...] | Flags = False
    stops: bool | tuple[bool, ...] | Flags = False


NOTHING = Loads()
# An impact: its time, s, kinetic energy, J, lost and left, and impulses (l) of rows.
Impact = tuple[float, float, float, Array]


@dataclass(frozen=True)
class StateHistory:
    """Samples of the state (s, size) at times (s), and why there are no more; "" if complete.

    `inputs` has the ranges of the inputs between the samples; `rests` are as of
    `Environment`.
    """

    time: Array
    states: Array
    stopped: str
    inputs: InputRanges
    impacts: tuple[Impact, ...] = ()
    rests: Rests = ()


class SmoothInterval(NamedTuple):
    """An interval of time, s, all through which the same acts on the robot."""

    begin: float
    end: float
    loads: Loads
