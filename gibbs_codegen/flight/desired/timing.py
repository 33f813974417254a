"""The fastest timing of a motion within limits.

The geometry of the motion stays as it is; only when it is where changes. It is found in this order:

The path is where the motion leads, measured by its arc length: the way that all velocities together
cover, of the base in m, of angles in rad. It consists of stretches on which something moves, with
rests between; a motion also rests where it turns back. In this length every stretch begins and ends
regularly, however gently the motion does.

The demand, of `desired/demands.py`: inputs along the path are linear in acceleration and squared
speed there.

The fastest speeds: between two nodes the acceleration along the path is constant, so that the
squared speed grows linearly. Limits hold at both ends of each interval (Pham and Pham, 2018:
time-optimal path parameterisation by reachability analysis): a pass backward finds the greatest
squared speed from which the end can still be reached, a pass forward takes the greatest
acceleration that stays below.

The schedule makes squared speeds a smooth function of time, since the fastest motion switches from
one limit to another in no time. Its length along the path, taken at equal steps of time, is made
the control points of a cubic spline. The acceleration of that is an average of accelerations
nearby, and so is what depends on it linearly: averages of what keeps limits keep them too, but for
the change of the path within a few steps. A longer average makes thrusts change more slowly, so
limits of thrust rates are kept by it. What still is beyond the limits is taken back by less room
for motion there.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.desired.base_trajectory import (
    CHECKS,
    KNOT_SPACING,
    check_times,
    tolerance,
)
from gibbs_codegen.flight.desired.demands import (
    Demand,
    TimingLimits,
    check_still,
    demand_of,
    excess,
    needed_inputs,
)
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.parts import MAX_DURATION

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
# No speed is greater: a length of the path per s.
_FASTEST = 1e6
# Steps by which a cubic spline reaches out to both sides of its control points.
_REACH = 2
# Share of the greatest speed in the scenario below which its time is not told to change.
_STANDSTILL = 1e-4
# Greatest distance in time of nodes of the speed profile, s.
_NODE_SPACING = 0.01
# Share of the room for motion within limits that is left for rounding.
_RESERVE = 1e-3
# Share of the limit of thrust rates that is left for what they are between the times looked at.
_RATE_RESERVE = 0.008
# Attempts to keep the limits, and how many of them take room where it is exceeded only.
_ATTEMPTS, _LOCAL = 20, 10
# What a factor is made greater by, so that a limit is kept the next time.
_SURELY = 1.0 + 1e-4
# Instants on both sides of one at which a limit is exceeded that take part in slowing down.
_AROUND = 4 * CHECKS
# Greatest refinement of knots.
_FINEST = 8


@dataclass(frozen=True)
class PathStretch:
    """A part of a path on which something moves, from `begin` to `end`, s, of the scenario.

    `first`, `last` are lengths of the path there, `speeds` those at both ends, in length per s; 0
    for a rest.
    """

    begin: float
    end: float
    first: float
    last: float
    speeds: tuple[float, float]


class ArcLength:
    """Length of the way of a motion as a function of the scenario's time, and back."""

    def __init__(self, reference: Reference) -> None:
        self.reference = reference
        self.time = check_times(reference.knots)
        v = reference(self.time)[1]
        speed = np.linalg.norm(v, axis=-1)
        speed[speed <= _REST * speed.max()] = 0.0
        self._speed = scipy.interpolate.PchipInterpolator(self.time, speed)
        self._growth = self._speed.derivative()
        self.length: scipy.interpolate.PPoly = self._speed.antiderivative()
        self.lengths = self.length(self.time)
        time, lengths = self.time.tolist(), self.lengths.tolist()
        # At rest is where a stretch meets another or standstill: all but the ends of the motion.
        inner = np.arange(len(speed)) % (len(speed) - 1) > 0
        ends = np.where(inner, 0.0, speed).tolist()
        # Where the motion turns back, one stretch begins where another ends.
        along, both = np.sum(v[1:] * v[:-1], axis=1), speed[1:] * speed[:-1]
        turned = np.flatnonzero((along < _TURNED * both) & (both > 0.0))
        slower = turned + (speed[turned + 1] < speed[turned])
        # A step between two instants is part of a stretch unless the motion rests at both.
        moves = (speed[1:] > 0.0) | (speed[:-1] > 0.0)
        change = np.flatnonzero(np.diff(moves, prepend=False, append=False))
        cuts = sorted({*change.tolist(), *slower.tolist()})
        self.stretches = [
            PathStretch(time[a], time[b], lengths[a], lengths[b], (ends[a], ends[b]))
            for a, b in itertools.pairwise(cuts)
            if moves[a]
        ]

    def speeds(self, time: Array) -> Array:
        """Speed along the path in the scenario, and its first two derivatives (3, s)."""
        bend = self._growth.derivative()
        return np.stack([self._speed(time), self._growth(time), bend(time)])

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """Coordinates (s, nq), velocities per length, and growth of these per length (s, nv).

        The latter two are zero where the motion rests. `time` (s) is of the scenario.
        """
        q, v, a = self.reference(time)
        speed, growth = (curve(time)[:, np.newaxis] for curve in (self._speed, self._growth))
        moving = speed > 0.0
        safe = np.where(moving, speed, 1.0)
        direction = np.where(moving, v / safe, 0.0)
        bend = np.where(moving, (a - direction * growth) / safe**2, 0.0)
        return q, direction, bend

    def times(self, lengths: Array) -> Array:
        """Scenario times (s) at lengths (s) of the path; the first time where it rests there."""
        place = np.clip(np.searchsorted(self.lengths, lengths), 1, len(self.time) - 1)
        low, high = self.time[place - 1], self.time[place]
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            short = self.length(middle) < lengths
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        return high


def nodes(arc: ArcLength, stretch: PathStretch, spacing: float) -> Array:
    """Scenario times (s) at which a stretch is looked at, close in time and along the path.

    They are at most `spacing` apart, s, and include both ends.
    """
    inside = (arc.time >= stretch.begin) & (arc.time <= stretch.end)
    time, length = arc.time[inside], arc.lengths[inside]
    duration, way = stretch.end - stretch.begin, stretch.last - stretch.first
    place = (time - stretch.begin) / duration + (length - stretch.first) / way
    count = max(int(np.ceil(duration / spacing)), 2 * CHECKS)
    times = np.interp(np.linspace(0.0, 2.0, 2 * count + 1), place, time)
    # None so near to an end that rounding would make something of what lies between.
    way_done = np.interp(times, time, length) - stretch.first
    apart = (way_done > _APART * way) & (way_done < (1.0 - _APART) * way)
    return np.concatenate([[stretch.begin], times[apart], [stretch.end]])


@dataclass(frozen=True)
class Rows:
    """Limits `acceleration` · σ̈ + `square` · σ̇² ≤ `most` at nodes, each (nodes, rows).

    `most` is positive everywhere: whatever rests stays within the limits.
    """

    acceleration: Array
    square: Array
    most: Array


def greatest_squares(lengths: Array, rows: Rows, ends: tuple[float, float]) -> Array:
    """The greatest squared speeds (s) at nodes at lengths (s), with at most `ends` at both ends."""
    steps = np.diff(lengths)
    count = len(lengths)
    reachable = np.empty(count)
    last = _greatest(rows.square[-1], rows.acceleration[-1], rows.most[-1])
    reachable[-1] = min(ends[1], last, _FASTEST**2)
    for k in reversed(range(count - 1)):
        square, acceleration, most = _interval(rows, k, steps[k], reachable[k + 1])
        reachable[k] = min(_greatest(square, acceleration, most), _FASTEST**2)
    squares = np.empty(count)
    squares[0] = min(ends[0], reachable[0])
    for k in range(count - 1):
        square, acceleration, most = _interval(rows, k, steps[k], reachable[k + 1])
        left = most - square * squares[k]
        up = acceleration > 0.0
        growth = np.min(left[up] / acceleration[up])
        squares[k + 1] = np.clip(squares[k] + 2.0 * steps[k] * growth, 0.0, reachable[k + 1])
    return squares


def _interval(rows: Rows, k: int, step: float, greatest: float) -> tuple[Array, Array, Array]:
    """Limits of the squared speed at node k and the acceleration after it.

    Coefficients of both, and right sides; `step` is the length to the next node, `greatest` its
    greatest squared speed.
    """
    ahead = rows.acceleration[k + 1] + 2.0 * step * rows.square[k + 1]
    return (
        np.concatenate([rows.square[k], rows.square[k + 1], [1.0, -1.0]]),
        np.concatenate([rows.acceleration[k], ahead, [2.0 * step, -2.0 * step]]),
        np.concatenate([rows.most[k], rows.most[k + 1], [greatest, 0.0]]),
    )


def _greatest(square: Array, acceleration: Array, most: Array) -> float:
    """The greatest b with square · b + acceleration · u ≤ most for some u; all `most` (rows) ≥ 0.

    Infinite if there is none.
    """
    up, down = acceleration > 0.0, acceleration < 0.0
    flat = ~up & ~down
    # u lies between what rows of both signs allow: each pair of them bounds b.
    weights_up, weights_down = acceleration[up][:, np.newaxis], -acceleration[down]
    slopes = square[up][:, np.newaxis] * weights_down + square[down] * weights_up
    bounds = most[up][:, np.newaxis] * weights_down + most[down] * weights_up
    slopes = np.concatenate([slopes.ravel(), square[flat]])
    bounds = np.concatenate([bounds.ravel(), most[flat]])
    limiting = slopes > 0.0
    return float(np.min(bounds[limiting] / slopes[limiting], initial=np.inf))


@dataclass(frozen=True)
class Profile:
    """Squared speeds (s) along a stretch at lengths (s) of the path."""

    lengths: Array
    squares: Array


class Clock:
    """Length along a path as a function of time, with three derivatives.

    Profiles have the squared speeds along each stretch; a rest lasts as long as in the scenario.
    Lengths are averaged over `window`, s, and control points are at most `spacing` apart, s:
    `knots` (s) are their times, `step` the time between two of them. `duration` (s) is that of the
    motion.
    """

    def __init__(
        self, arc: ArcLength, profiles: Sequence[Profile], spacing: float, window: float
    ) -> None:
        self.arc = arc
        exact = _exact(arc, profiles, _REACH * spacing + 0.5 * window)
        self.duration = float(exact.x[-1])
        if self.duration > MAX_DURATION:
            raise UsageError(
                f"timing: within its limits the motion takes {self.duration:.4g} s, and a flight "
                f"at most {MAX_DURATION:g} s; widen the limits"
            )
        pieces = max(int(np.ceil(self.duration / spacing)), 1)
        self.step = self.duration / pieces
        self.knots = np.linspace(0.0, self.duration, pieces + 1)
        time: Array = self.step * np.arange(-1.0, pieces + 2.0)
        whole = _mirrored(exact)
        if window > 0.0:
            integral = whole.antiderivative()
            points = (integral(time + 0.5 * window) - integral(time - 0.5 * window)) / window
        else:
            points = whole(time)
        knots = self.step * np.arange(-3, pieces + 4)
        spline = scipy.interpolate.BSpline(knots, points, 3)
        self._derivatives = [spline, *(spline.derivative(order) for order in (1, 2, 3))]

    def __call__(self, time: Array) -> Array:
        """Length and three derivatives (s, 4) at times (s), s, from 0 to the duration."""
        inside = np.clip(time, 0.0, self.duration)
        return np.stack([curve(inside) for curve in self._derivatives], axis=-1)

    def scenario_time(self, time: Array) -> Array:
        """Time of the scenario and its three derivatives (…, 4); these are zero where it rests."""
        length, speed, growth, jerk = np.moveaxis(self(np.ravel(time)), -1, 0)
        now = self.arc.times(length)
        out = np.zeros((len(now), 4))
        out[:, 0] = now
        way = self.arc.speeds(now)
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
        q, direction, bend = self.arc.at(self.arc.times(length[:, 0]))
        return q, direction * speed, direction * growth + bend * speed**2


def _exact(arc: ArcLength, profiles: Sequence[Profile], pad: float) -> scipy.interpolate.PPoly:
    """Length along the path in time, from 0, with constant accelerations between nodes.

    `pad`, s, is added to every rest where a stretch begins or ends there.
    """
    reference = arc.reference
    steps: list[Array] = []
    coefficients: list[Array] = []
    last, length, before = reference.begin, 0.0, 0.0

    def rest(duration: float) -> None:
        if duration > 0.0:
            steps.append(np.array([duration]))
            coefficients.append(np.array([[0.0], [0.0], [length]]))

    for stretch, profile in zip(arc.stretches, profiles, strict=True):
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
    return scipy.interpolate.PPoly(np.concatenate(coefficients, axis=1), ends)


def _mirrored(exact: scipy.interpolate.PPoly) -> scipy.interpolate.PPoly:
    """The length also before the first time and after the last, as if seen in mirrors there.

    So averages over times on both sides of an end are the length there.
    """
    time, (bend, slope, _), steps = exact.x, exact.c, np.diff(exact.x)
    ends = exact(time)
    back = np.stack([-bend, 2.0 * bend * steps + slope, -ends[1:]])[:, ::-1]
    before, after = back.copy(), back
    before[2] += 2.0 * ends[0]
    after[2] += 2.0 * ends[-1]
    times = np.concatenate([-time[:0:-1], time, 2.0 * time[-1] - time[-2::-1]])
    return scipy.interpolate.PPoly(np.concatenate([before, exact.c, after], axis=1), times)


def time_optimal_motion(
    vehicle: Vehicle,
    reference: Reference,
    limits: TimingLimits,
    progress: Callable[[float], None] = lambda share: None,
) -> Clock:
    """The fastest timing of a motion whose wrenches the rotors can produce.

    `reference` is in the scenario's time; `progress` is called with the share done, 0 to 1. Raises
    `UsageError` if the robot cannot stand still within its limits everywhere on its way.
    """
    arc = ArcLength(reference)
    knots = arc.time[::CHECKS]
    check_still(vehicle, reference(knots)[0], knots, limits)
    parts = [_SegmentLimits(vehicle, arc, stretch, limits) for stretch in arc.stretches]
    window = 0.0
    for attempt in range(_ATTEMPTS):
        progress(attempt / _ATTEMPTS)
        profiles = [way.profile() for way in parts]
        clock = Clock(arc, profiles, KNOT_SPACING, window)
        demand = demand_at(vehicle, clock)
        over = excess(demand, limits)
        if np.max(np.abs(demand.rates), initial=0.0) > limits.thrust_rate:
            window = _window(vehicle, arc, profiles, limits.thrust_rate)
        elif np.max(over, initial=0.0) > 1.0 or (attempt < 3 and np.any(vehicle.damping)):
            for way in parts:
                way.slow_down(clock(demand.time)[:, 0], over, everywhere=attempt >= _LOCAL)
        else:
            return clock
    raise UsageError(
        "timing: no motion along the paths keeps the limits of thrust, torque and thrust rate "
        "together; widen one of them, or give a gentler motion"
    )


def demand_at(vehicle: Vehicle, clock: Clock) -> Demand:
    """The demand of a timed motion, at its knots and between."""
    time = check_times(clock.knots)
    return demand_of(vehicle, clock.motion(time), time)


def timed_reference(vehicle: Vehicle, clock: Clock) -> Reference:
    """The motion as a function of time, with knots so near that it stays true between them."""
    refinement = 1
    while True:
        pieces = refinement * (len(clock.knots) - 1)
        time = np.linspace(0.0, clock.duration, pieces + 1)
        reference = vehicle.kinematics.reference(Motion(time, *clock.motion(time)))
        times = check_times(time)
        q = clock.motion(times)[0]
        off = np.abs(reference(times)[0] - q) / tolerance(np.abs(q).max(axis=0))
        if refinement == _FINEST or np.all(off <= 1.0):
            return reference
        refinement *= 2


class _SegmentLimits:
    """One stretch of a path with the limits along it.

    `room` (nodes) is what is left of the way from standing still to the limits.
    """

    def __init__(
        self, vehicle: Vehicle, arc: ArcLength, stretch: PathStretch, limits: TimingLimits
    ) -> None:
        time = nodes(arc, stretch, _NODE_SPACING)
        self.lengths = arc.length(time)
        self.speeds = stretch.speeds
        self.room = np.full(len(time), 1.0 - _RESERVE)
        self.squares: Array | None = None
        # Where it begins or ends at rest, a direction is found near by only.
        looked = time.copy()
        for end, beside in ((0, 1), (-1, -2)):
            if stretch.speeds[end] == 0.0:
                looked[end] = 0.9 * time[end] + 0.1 * time[beside]
        q, direction, bend = arc.at(looked)
        at_rest = 0.0 * direction
        still = needed_inputs(vehicle, q, at_rest, at_rest)
        ahead, back = (needed_inputs(vehicle, q, s * direction, bend) for s in (1.0, -1.0))
        least, most = limits.inputs
        joints = (direction[:, vehicle.arm_rates] / limits.velocities) ** 2
        self.square = _both(0.5 * (ahead + back) - still, joints)
        # What is odd in the velocity: damping.
        self.damping = _both(0.5 * (ahead - back), 0.0 * joints)
        pushed = needed_inputs(vehicle, q, at_rest, direction) - still
        self.acceleration = _both(pushed, 0.0 * joints)
        self.most = np.concatenate([most - still, still - least, np.ones_like(joints)], axis=1)

    def profile(self) -> Profile:
        """The fastest motion along the stretch in the room that there is."""
        square = self.square
        if self.squares is not None:
            # Damping grows with the speed: as a share of its square it is exact at the last one.
            speeds = np.sqrt(np.maximum(self.squares, np.max(self.squares) * 1e-6))
            square = square + self.damping / speeds[:, np.newaxis]
        limited = np.all(np.isfinite(self.most), axis=0)
        most = self.most[:, limited] * self.room[:, np.newaxis]
        rows = Rows(self.acceleration[:, limited], square[:, limited], most)
        # At an end the motion neither accelerates nor brakes.
        ends = [
            min(speed**2, np.min(most[k] / np.maximum(rows.square[k], 1e-300)))
            for k, speed in zip((0, -1), self.speeds, strict=True)
        ]
        self.squares = greatest_squares(self.lengths, rows, (ends[0], ends[1]))
        return Profile(self.lengths, self.squares)

    def slow_down(self, lengths: Array, over: Array, everywhere: bool) -> None:
        """Leave less room for motion where limits are exceeded, or everywhere on the stretch.

        `over` (s) tells by how much at lengths (s) along the path; below 1 if they are not.
        """
        over = scipy.ndimage.maximum_filter1d(np.maximum(over, 1.0), 2 * _AROUND + 1)
        here = np.interp(self.lengths, lengths, over)
        if everywhere:
            here = np.full_like(here, np.max(here))
        self.room /= np.where(here > 1.0, here * _SURELY, 1.0)


def _both(values: Array, joints: Array) -> Array:
    """Rows for the greatest and the least inputs, and for the joints' velocities."""
    return np.concatenate([values, -values, joints], axis=1)


def _window(vehicle: Vehicle, arc: ArcLength, profiles: list[Profile], thrust_rate: float) -> float:
    """The shortest time to average over, s, for thrusts to change by at most `thrust_rate`, N/s."""

    def too_fast(window: float) -> bool:
        clock = Clock(arc, profiles, KNOT_SPACING, window)
        rates = demand_at(vehicle, clock).rates
        return bool(np.max(np.abs(rates), initial=0.0) > (1.0 - _RATE_RESERVE) * thrust_rate)

    low, high = 0.0, KNOT_SPACING
    while too_fast(high) and high < arc.reference.end:
        low, high = high, 2.0 * high
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if too_fast(middle) else (low, middle)
    return high
