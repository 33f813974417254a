"""Paths and attitudes of a scenario at other times than they say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.flight.scenario.orientation import Level, Tangent, Turn
from gibbs_codegen.flight.scenario.paths import ORDERS, Array, Path
from gibbs_codegen.flight.scenario.scenario import Scenario

# The time of a scenario and its first three derivatives (…, 4) at times (…) of the flight, s.
Clock = Callable[[Array], Array]


@dataclass(frozen=True)
class Retimed:
    """A path that is followed by another clock."""

    path: Path
    clock: Clock

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        now, rate, growth, jerk = np.moveaxis(self.clock(np.asarray(time, float)), -1, 0)
        place = self.path(now)
        rate, growth, jerk = (each[..., np.newaxis] for each in (rate, growth, jerk))
        first, second, third = (place[..., order, :] for order in range(1, ORDERS))
        out = np.empty_like(place)
        out[..., 0, :] = place[..., 0, :]
        out[..., 1, :] = first * rate
        out[..., 2, :] = second * rate**2 + first * growth
        out[..., 3, :] = third * rate**3 + 3.0 * second * rate * growth + first * jerk
        return out


@dataclass(frozen=True)
class Stretched:
    """A clock that goes slower by a factor."""

    factor: float

    def __call__(self, time: Array) -> Array:
        """Time of the scenario and derivatives (…, 4) at times (…), s."""
        out = np.zeros((*np.shape(time), ORDERS))
        out[..., 0] = np.asarray(time) / self.factor
        out[..., 1] = 1.0 / self.factor
        return out


def retimed(scenario: Scenario, duration: float, clock: Clock) -> Scenario:
    """A scenario whose paths are followed by another clock.

    Its new paths are not those that its attitude goes by.
    """
    tip = scenario.arm.tip and Retimed(scenario.arm.tip, clock)
    arm = replace(scenario.arm, tip=tip)
    return replace(scenario, duration=duration, base=Retimed(scenario.base, clock), arm=arm)


def stretched(scenario: Scenario, factor: float) -> Scenario:
    """A scenario all motion of which takes longer by a factor; below 1 it is faster."""
    attitude: Level | Turn | Tangent = scenario.attitude
    if isinstance(attitude, Level):
        attitude = replace(attitude, rate=attitude.rate / factor)
    elif isinstance(attitude, Turn):
        attitude = replace(
            attitude, duration=factor * attitude.duration, begin=factor * attitude.begin
        )
    slower = retimed(scenario, factor * scenario.duration, Stretched(factor))
    moves = {
        joint: [
            replace(move, begin=factor * move.begin, duration=factor * move.duration)
            for move in each
        ]
        for joint, each in scenario.arm.moves.items()
    }
    return replace(slower, attitude=attitude, arm=replace(slower.arm, moves=moves))
