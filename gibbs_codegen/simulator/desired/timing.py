"""The fastest timing of a motion within limits.

The geometry of the motion stays as it is; only when it is where changes. Inputs along the course
are linear in acceleration and squared speed there, and `speed_profile` finds the fastest motion;
`schedule` makes it smooth. What that puts beyond the limits is taken back by less room for motion
there, and a limit of thrust rates is kept by averaging over longer.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import maximum_filter1d

from gibbs_codegen.errors import UsageError
from gibbs_codegen.simulator.desired.course import Course, Stretch, nodes
from gibbs_codegen.simulator.desired.demand import (
    Demand,
    Limits,
    check_still,
    demand_of,
    excess,
    needed_inputs,
)
from gibbs_codegen.simulator.desired.knots import CHECKS, KNOT_SPACING, check_times, tolerance
from gibbs_codegen.simulator.desired.schedule import Clock, Profile
from gibbs_codegen.simulator.desired.speed_profile import Rows, fastest
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.reference import Motion, Reference

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


def fastest_motion(
    vehicle: Vehicle,
    reference: Reference,
    limits: Limits,
    progress: Callable[[float], None] = lambda share: None,
) -> Clock:
    """The fastest timing of a motion whose wrenches the rotors can produce.

    `reference` is in the scenario's time; `progress` is told the share done, 0 to 1. Raises
    `UsageError` if the robot cannot stand still within its limits everywhere on its way.
    """
    course = Course(reference)
    still = course.time[::CHECKS]
    q, v, _ = reference(still)
    check_still(vehicle, demand_of(vehicle, (q, 0.0 * v, 0.0 * v), still), limits)
    ways = [_Way(vehicle, course, stretch, limits) for stretch in course.stretches]
    window = 0.0
    for attempt in range(_ATTEMPTS):
        progress(attempt / _ATTEMPTS)
        profiles = [way.profile() for way in ways]
        clock = Clock(course, profiles, KNOT_SPACING, window)
        demand = demand_at(vehicle, clock)
        over = excess(demand, limits)
        if np.max(np.abs(demand.rates)) > limits.thrust_rate:
            window = _window(vehicle, course, profiles, limits.thrust_rate)
        elif np.max(over, initial=0.0) > 1.0 or (attempt < 3 and np.any(vehicle.damping)):
            for way in ways:
                way.slow_down(clock(demand.time)[:, 0], over, everywhere=attempt >= _LOCAL)
        else:
            return clock
    raise UsageError(
        "timing: no motion along the paths keeps the limits of thrust and torque together with "
        "the thrust rate; widen one of them, or give a gentler motion"
    )


def demand_at(vehicle: Vehicle, clock: Clock) -> Demand:
    """What a timed motion demands, at its knots and between."""
    time = check_times(clock.knots)
    return demand_of(vehicle, clock.motion(time), time)


def timed_reference(vehicle: Vehicle, clock: Clock) -> Reference:
    """The motion as a function of time, with knots so near that it stays true between them."""
    refinement = 1
    while True:
        pieces = refinement * (len(clock.knots) - 1)
        time = np.linspace(0.0, clock.duration, pieces + 1)
        reference = vehicle.kinematics.reference(Motion(time, *clock.motion(time)))
        every = check_times(time)
        q = clock.motion(every)[0]
        off = np.abs(reference(every)[0] - q) / tolerance(np.abs(q).max(axis=0))
        if refinement == _FINEST or np.all(off <= 1.0):
            return reference
        refinement *= 2


class _Way:
    """One stretch of a course with the limits along it.

    `room` (nodes) is what is left of the way from standing still to the limits.
    """

    def __init__(self, vehicle: Vehicle, course: Course, stretch: Stretch, limits: Limits) -> None:
        time = nodes(course, stretch, _NODE_SPACING)
        self.lengths = course.length(time)
        self.speeds = stretch.speeds
        self.room = np.full(len(time), 1.0 - _RESERVE)
        self.squares: Array | None = None
        # Where it begins or ends at rest, a direction is found near by only.
        looked = time.copy()
        for end, beside in ((0, 1), (-1, -2)):
            if stretch.speeds[end] == 0.0:
                looked[end] = 0.9 * time[end] + 0.1 * time[beside]
        q, direction, bend = course.at(looked)
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
        self.squares = fastest(self.lengths, rows, (ends[0], ends[1]))
        return Profile(self.lengths, self.squares)

    def slow_down(self, lengths: Array, over: Array, everywhere: bool) -> None:
        """Leave less room for motion where limits are exceeded, or everywhere on the stretch.

        `over` (s) tells by how much at lengths (s) along the course; below 1 if they are not.
        """
        over = maximum_filter1d(np.maximum(over, 1.0), 2 * _AROUND + 1)
        here = np.interp(self.lengths, lengths, over)
        if everywhere:
            here = np.full_like(here, np.max(here))
        self.room /= np.where(here > 1.0, here * _SURELY, 1.0)


def _both(values: Array, joints: Array) -> Array:
    """Rows for the greatest and the least inputs, and for the joints' velocities."""
    return np.concatenate([values, -values, joints], axis=1)


def _window(vehicle: Vehicle, course: Course, profiles: list[Profile], thrust_rate: float) -> float:
    """The shortest time to average over, s, for thrusts to change by at most `thrust_rate`, N/s."""

    def too_fast(window: float) -> bool:
        clock = Clock(course, profiles, KNOT_SPACING, window)
        rates = demand_at(vehicle, clock).rates
        return bool(np.max(np.abs(rates)) > (1.0 - _RATE_RESERVE) * thrust_rate)

    low, high = 0.0, KNOT_SPACING
    while too_fast(high) and high < course.reference.end:
        low, high = high, 2.0 * high
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if too_fast(middle) else (low, middle)
    return high
