"""The course of a motion: where it leads, apart from when.

A course is measured by the length of the way that all velocities together cover: of the base in m,
of angles in rad. It consists of stretches on which something moves, with rests between; a motion
also rests where it turns back. In this length every stretch begins and ends regularly, however
gently the motion does.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator, PPoly

from gibbs_codegen.simulator.desired.knots import CHECKS, check_times
from gibbs_codegen.simulator.plant.vehicle import Array
from gibbs_codegen.simulator.reference import Reference

# Share of the greatest speed below which everything rests. What a smooth start covers below it is
# a share of 1e-9 of the way.
_REST = 1e-7
# Cosine of the angle between the velocities of two successive instants above which the motion has
# turned back between them.
_TURNED = 0.5
# Least distance of inner nodes from the ends of a stretch, as a share of its length.
_APART = 1e-5
# Halvings of an interval that leave of it no more than rounding.
_HALVINGS = 55


@dataclass(frozen=True)
class Stretch:
    """A part of a course on which something moves, from `begin` to `end`, s, of the scenario.

    `first`, `last` are lengths of the course there, `speeds` those at both ends, in length per s; 0
    for a rest.
    """

    begin: float
    end: float
    first: float
    last: float
    speeds: tuple[float, float]


class Course:
    """Length of the way of a motion as a function of the scenario's time, and back."""

    def __init__(self, reference: Reference) -> None:
        self.reference = reference
        self.time = check_times(reference.knots)
        v = reference(self.time)[1]
        speed = np.linalg.norm(v, axis=-1)
        speed[speed <= _REST * speed.max()] = 0.0
        self._speed = PchipInterpolator(self.time, speed)
        self._growth = self._speed.derivative()
        self.length: PPoly = self._speed.antiderivative()
        self.lengths = self.length(self.time)
        self.stretches = [self._stretch(*ends, speed) for ends in _moving(v, speed)]

    def _stretch(self, first: int, last: int, speed: Array) -> Stretch:
        """The stretch between two instants, by their numbers; `speed` (s) is of all instants."""
        # At rest is where a stretch meets another or standstill: all but the ends of the motion.
        ends = (0, len(speed) - 1)
        speeds = [
            float(speed[k]) if k == end else 0.0 for k, end in zip((first, last), ends, strict=True)
        ]
        return Stretch(
            float(self.time[first]),
            float(self.time[last]),
            float(self.lengths[first]),
            float(self.lengths[last]),
            (speeds[0], speeds[1]),
        )

    def speeds(self, time: Array) -> Array:
        """Speed along the course in the scenario, and its first two derivatives (3, s)."""
        bend = self._growth.derivative()
        return np.stack([self._speed(time), self._growth(time), bend(time)])

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Coordinates (s, nq), velocities per length, and growth of these per length (s, nv).

        The latter two are zero where the motion rests. `time` (s) is of the scenario.
        """
        q, v, a = self.reference(time)
        speed, growth = (each(time)[:, np.newaxis] for each in (self._speed, self._growth))
        moving = speed > 0.0
        safe = np.where(moving, speed, 1.0)
        direction = np.where(moving, v / safe, 0.0)
        bend = np.where(moving, (a - direction * growth) / safe**2, 0.0)
        return q, direction, bend

    def times(self, lengths: Array) -> Array:
        """Scenario times (s) at lengths (s) of the course; the first time where it rests there."""
        place = np.clip(np.searchsorted(self.lengths, lengths), 1, len(self.time) - 1)
        low, high = self.time[place - 1], self.time[place]
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            short = self.length(middle) < lengths
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        return high


def _moving(v: Array, speed: Array) -> list[tuple[int, int]]:
    """First and last instant of every stretch.

    Where the motion turns back, one stretch begins where another ends. `speed` (s) is 0 at rest.
    """
    along = np.sum(v[1:] * v[:-1], axis=1)
    both = speed[1:] * speed[:-1]
    turned = np.flatnonzero((along < _TURNED * both) & (both > 0.0))
    slower = turned + (speed[turned + 1] < speed[turned])
    # A step between two instants is part of a stretch unless the motion rests at both.
    moves = (speed[1:] > 0.0) | (speed[:-1] > 0.0)
    change = np.flatnonzero(np.diff(np.concatenate([[False], moves, [False]]).astype(int)))
    cuts = sorted({*change.tolist(), *slower.tolist()})
    return [(first, last) for first, last in itertools.pairwise(cuts) if moves[first]]


def nodes(course: Course, stretch: Stretch, spacing: float) -> Array:
    """Scenario times (s) at which a stretch is looked at, close in time and along the course.

    They are at most `spacing` apart, s, and include both ends.
    """
    inside = (course.time >= stretch.begin) & (course.time <= stretch.end)
    time, length = course.time[inside], course.lengths[inside]
    duration, way = stretch.end - stretch.begin, stretch.last - stretch.first
    place = (time - stretch.begin) / duration + (length - stretch.first) / way
    count = max(int(np.ceil(duration / spacing)), 2 * CHECKS)
    found = np.interp(np.linspace(0.0, 2.0, 2 * count + 1), place, time)
    # None so near to an end that rounding would make something of what lies between.
    way_done = np.interp(found, time, length) - stretch.first
    apart = (way_done > _APART * way) & (way_done < (1.0 - _APART) * way)
    result: Array = np.concatenate([[stretch.begin], found[apart], [stretch.end]])
    return result
