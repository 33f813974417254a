"""The desired motion of a scenario, timed as the paths say or as fast as limits allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.desired.knots import check_times
from gibbs_codegen.flight.desired.timing import (
    Binding,
    Demand,
    Limits,
    binding,
    check_still,
    demand_at,
    demand_of,
    exceeded,
    fastest_motion,
    limits_of,
    timed_reference,
)
from gibbs_codegen.flight.desired.trajectory import Progress, desired_motion
from gibbs_codegen.flight.plant.allocation import allocation_of
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Reference
from gibbs_codegen.flight.scenario.scenario import MAX_DURATION, Scenario
from gibbs_codegen.flight.scenario.time_scaling import retimed, stretched

# Factor between durations that are tried, how many of them, and halvings of the last interval.
_RATIO, _MOST, _HALVINGS = 1.5, 12, 6

_NOTHING = "nothing moves, so that there is nothing to time"


@dataclass(frozen=True)
class TimedMotion:
    """A scenario at the times at which it is flown, and its desired motion.

    `said` tells of the timing in words, "" where it is that of the paths; `binding` are the limits
    that it reaches.
    """

    scenario: Scenario
    reference: Reference
    said: str = ""
    binding: tuple[Binding, ...] = ()


def timed_motion(
    vehicle: Vehicle, scenario: Scenario, progress: Progress = lambda what, share: None
) -> TimedMotion:
    """The desired motion of a scenario, by its law of timing.

    Where the rotors command every wrench, "fastest" is the fastest motion along the paths. Else the
    attitude depends on the timing, and all of the motion is stretched by one factor. Raises
    `UsageError` or one of its kinds where there is no such motion.
    """
    if scenario.timing.law == "uniform":
        return TimedMotion(scenario, desired_motion(vehicle, scenario, progress))
    limits = limits_of(vehicle, scenario)
    if not limits.any:
        raise UsageError(
            f'{vehicle.name}: timing.law "fastest" needs limits, and neither the robot file nor '
            "the scenario has any; give timing.limits, timing.effort or timing.velocity"
        )
    if allocation_of(vehicle).missing:
        return _stretched_motion(vehicle, scenario, limits, progress)
    reference = desired_motion(vehicle, scenario, progress)
    if _rests(reference):
        return TimedMotion(scenario, reference, _NOTHING)
    clock = fastest_motion(
        vehicle, reference, limits, lambda share: progress("fastest timing", share)
    )
    return TimedMotion(
        retimed(scenario, clock.duration, clock.scenario_time),
        timed_reference(vehicle, clock),
        f"fastest within limits, {clock.duration:.4g} s instead of {scenario.duration:.4g} s",
        binding(vehicle, demand_at(vehicle, clock), limits),
    )


def _rests(reference: Reference) -> bool:
    """Whether nothing ever moves."""
    return not np.any(reference(check_times(reference.knots))[1])


def _stretched_motion(
    vehicle: Vehicle, scenario: Scenario, limits: Limits, progress: Progress
) -> TimedMotion:
    """The fastest motion that differs from that of a scenario by one factor of time.

    Raises `UsageError` if none of the factors that are tried keeps the limits.
    """
    tried = _Tried(vehicle, scenario, limits, progress)
    if tried.kept(1.0) and _rests(tried.found[1.0][0]):
        return TimedMotion(scenario, tried.found[1.0][0], _NOTHING)
    ratio = 1.0 / _RATIO if tried.found else _RATIO
    factors = ratio ** np.arange(1, _MOST)
    factors = np.append(1.0, factors[factors * scenario.duration <= MAX_DURATION])
    # Faster until limits are exceeded, or slower until they are kept.
    last = next((f for f in factors[1:] if tried.kept(f) == (ratio > 1.0)), factors[-1])
    if not tried.found:
        raise UsageError(
            f"timing: {vehicle.name} does not keep its limits, even if all of {scenario.name!r} "
            f"takes {last:.3g} times as long: {tried.why_not}; widen the limits, or give a gentler "
            "motion"
        )
    fast, slow = sorted((last, last / ratio))
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(fast * slow))
        fast, slow = (fast, middle) if tried.kept(middle) else (middle, slow)
    factor = min(tried.found)
    bound = f"; any faster, {tried.why_not}" if tried.why_not else ""
    reference, demand = tried.found[factor]
    return TimedMotion(
        stretched(scenario, factor),
        reference,
        f"{reference.end:.4g} s instead of {scenario.duration:.4g} s: all of the motion is "
        f"stretched by one factor, {factor:.3g}, since the attitude of {vehicle.name} follows from "
        f"the timing{bound}",
        binding(vehicle, demand, limits),
    )


class _Tried:
    """Factors of time that were tried: the motions that keep limits, and why others do not."""

    def __init__(
        self, vehicle: Vehicle, scenario: Scenario, limits: Limits, progress: Progress
    ) -> None:
        self.vehicle, self.scenario, self.limits = vehicle, scenario, limits
        self.found: dict[float, tuple[Reference, Demand]] = {}
        # Why there is no motion, or which limit it exceeds: a clause.
        self._failed: dict[float, str] = {}
        self._progress = progress

    @property
    def why_not(self) -> str:
        """What stops the slowest of the motions that fail: a clause, or ""."""
        return self._failed[max(self._failed)] if self._failed else ""

    def kept(self, factor: float) -> bool:
        """Whether there is a motion by a factor of time, and it keeps the limits.

        Raises `UsageError` if the robot cannot stand still with its joints as they are on the way.
        """
        attempts = len(self.found) + len(self._failed)
        self._progress("fastest timing", min(attempts / (_MOST + _HALVINGS), 1.0))
        try:
            reference = desired_motion(self.vehicle, stretched(self.scenario, factor))
        except UsageError as error:  # Too fast for the attitude or the arm to follow.
            self._failed[factor] = str(error)
            return False
        time = check_times(reference.knots)
        demand = demand_of(self.vehicle, reference(time), time)
        self._check_still(reference, time / factor)
        if why := exceeded(self.vehicle, demand, self.limits):
            self._failed[factor] = why
            return False
        self.found[factor] = reference, demand
        return True

    def _check_still(self, reference: Reference, time: Array) -> None:
        """Raise `UsageError` if the robot cannot stand still as the base is at the start."""
        q, v, a = reference(check_times(reference.knots))
        arm = q[:, self.vehicle.arm].copy()
        q[:] = q[0]
        q[:, self.vehicle.arm] = arm
        still = demand_of(self.vehicle, (q, 0.0 * v, 0.0 * a), time)
        check_still(self.vehicle, still, self.limits)
