"""When a motion is where on its course: squared speeds made into a smooth function of time.

The fastest motion switches from one limit to another in no time. Its length along the course, taken
at equal steps of time, is therefore made the control points of a cubic spline. The acceleration of
that is an average of accelerations nearby, and so is what depends on it linearly: averages of what
keeps limits keep them too, but for the change of the course within a few steps. A longer average
makes thrusts change more slowly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, PPoly

from gibbs_codegen.errors import UsageError
from gibbs_codegen.scenario.scenario import MAX_DURATION
from gibbs_codegen.simulator.desired.course import Course
from gibbs_codegen.simulator.plant.vehicle import Array

# Steps by which a cubic spline reaches out to both sides of its control points.
_REACH = 2
# Share of the greatest speed in the scenario below which its time is not told to change.
_STANDSTILL = 1e-4


@dataclass(frozen=True)
class Profile:
    """Squared speeds (s) along a stretch at lengths (s) of the course."""

    lengths: Array
    squares: Array


class Clock:
    """Length along a course as a function of time, with three derivatives.

    Profiles have the squared speeds along each stretch; a rest lasts as long as in the scenario.
    Lengths are averaged over `window`, s, and control points are at most `spacing` apart, s:
    `knots` (s) are their times, `step` the time between two of them. `duration` (s) is that of the
    motion.
    """

    def __init__(
        self, course: Course, profiles: Sequence[Profile], spacing: float, window: float
    ) -> None:
        self.course = course
        exact = _exact(course, profiles, _REACH * spacing + 0.5 * window)
        self.duration = float(exact.x[-1])
        if self.duration > MAX_DURATION:
            raise UsageError(
                f"timing: within its limits the motion takes {self.duration:.4g} s, longer than "
                f"a flight may be, {MAX_DURATION:g} s; widen the limits"
            )
        pieces = max(int(np.ceil(self.duration / spacing)), 1)
        self.step = self.duration / pieces
        self.knots = np.linspace(0.0, self.duration, pieces + 1)
        time: Array = self.step * np.arange(-1.0, pieces + 2.0)
        if window > 0.0:
            integral = exact.antiderivative()
            ahead, behind = (
                _integral(exact, integral, time + 0.5 * by) for by in (window, -window)
            )
            points = (ahead - behind) / window
        else:
            points = _mirrored(exact, time)
        knots = self.step * np.arange(-3, pieces + 4)
        spline = BSpline(knots, points, 3)
        self._derivatives = [spline, *(spline.derivative(order) for order in (1, 2, 3))]

    def __call__(self, time: Array) -> Array:
        """Length and three derivatives (s, 4) at times (s), s, from 0 to the duration."""
        inside = np.clip(time, 0.0, self.duration)
        return np.stack([each(inside) for each in self._derivatives], axis=-1)

    def scenario_time(self, time: Array) -> Array:
        """Time of the scenario and its three derivatives (…, 4); these are zero where it rests."""
        length, speed, growth, jerk = np.moveaxis(self(np.ravel(time)), -1, 0)
        now = self.course.times(length)
        out = np.zeros((len(now), 4))
        out[:, 0] = now
        way = self.course.speeds(now)
        moving = way[0] > _STANDSTILL * np.max(way[0], initial=0.0)
        first, second, third = way[:, moving]
        rate = speed[moving] / first
        slope = (growth[moving] - second * rate**2) / first
        bend = (jerk[moving] - 3.0 * second * rate * slope - third * rate**3) / first
        out[moving, 1:] = np.stack([rate, slope, bend], axis=-1)
        return out.reshape(*np.shape(time), 4)

    def motion(self, time: Array) -> tuple[Array, Array, Array]:
        """Coordinates (s, nq), velocities and accelerations (s, nv) at times (s), s."""
        length, speed, growth, _ = np.moveaxis(self(time)[..., np.newaxis], 1, 0)
        q, direction, bend = self.course.at(self.course.times(length[:, 0]))
        return q, direction * speed, direction * growth + bend * speed**2


def _exact(course: Course, profiles: Sequence[Profile], pad: float) -> PPoly:
    """Length along the course in time, from 0, with constant accelerations between nodes.

    `pad`, s, is added to every rest where a stretch begins or ends there.
    """
    reference = course.reference
    steps: list[Array] = []
    coefficients: list[Array] = []
    last, length, before = reference.begin, 0.0, 0.0

    def rest(duration: float) -> None:
        if duration > 0.0:
            steps.append(np.array([duration]))
            coefficients.append(np.array([[0.0], [0.0], [length]]))

    for stretch, profile in zip(course.stretches, profiles, strict=True):
        after = pad if stretch.speeds[0] == 0.0 else 0.0
        rest(before + stretch.begin - last + after)
        speeds = np.sqrt(profile.squares)
        apart = np.diff(profile.lengths)
        steps.append(2.0 * apart / (speeds[1:] + speeds[:-1]))
        growth = np.diff(profile.squares) / (2.0 * apart)
        coefficients.append(np.stack([0.5 * growth, speeds[:-1], profile.lengths[:-1]]))
        before = pad if stretch.speeds[1] == 0.0 else 0.0
        last, length = stretch.end, float(profile.lengths[-1])
    rest(before + reference.end - last)
    ends = np.concatenate([[0.0], np.cumsum(np.concatenate(steps))])
    return PPoly(np.concatenate(coefficients, axis=1), ends)


def _mirrored(exact: PPoly, time: Array) -> Array:
    """The length at any times (s): before the first and after the last, as if seen in a mirror.

    So averages over times on both sides of an end are the length there.
    """
    end = exact.x[-1]
    inside = np.where(time < 0.0, -time, np.where(time > end, 2.0 * end - time, time))
    turned = np.where(time < 0.0, 2.0 * exact(0.0), 2.0 * exact(end)) - exact(inside)
    result: Array = np.where(inside == time, exact(inside), turned)
    return result


def _integral(exact: PPoly, integral: PPoly, time: Array) -> Array:
    """The integral (s) of `_mirrored` from 0 to times (s); `integral` is that of `exact`."""
    end = exact.x[-1]
    early, late = time < 0.0, time > end
    inside = np.where(early, -time, np.where(late, 2.0 * end - time, time))
    added = np.where(early, 2.0 * exact(0.0) * time, 2.0 * exact(end) * (time - end))
    result: Array = integral(inside) + np.where(early | late, added, 0.0)
    return result
