"""The desired motion of a scenario, timed as the paths say or as fast as limits allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.scenario.retimed import retimed, stretched
from gibbs_codegen.scenario.scenario import Scenario
from gibbs_codegen.simulator.desired.demand import (
    Binding,
    Demand,
    Limits,
    binding,
    demand_of,
    keeps,
    limits_of,
)
from gibbs_codegen.simulator.desired.knots import check_times
from gibbs_codegen.simulator.desired.timing import demand_at, fastest_motion, timed_reference
from gibbs_codegen.simulator.desired.trajectory import Progress, desired_motion
from gibbs_codegen.simulator.plant.moving_rotors import allocation_of
from gibbs_codegen.simulator.plant.vehicle import Vehicle
from gibbs_codegen.simulator.reference import Reference

# Factor between durations that are tried, how many of them, and halvings of the last interval.
_RATIO, _MOST, _HALVINGS = 1.5, 12, 4

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
    attitude depends on the timing, and all of the motion is stretched by one factor.

    Args:
        vehicle: The robot.
        scenario: What is flown.
        progress: Is told what is being done, and the share of it that is done, 0 to 1.

    Returns:
        Motion and scenario.

    Raises:
        UsageError: Or one of its kinds, where there is no such motion.
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

    Args:
        vehicle: The robot.
        scenario: What is flown.
        limits: What the motion is to keep to.
        progress: Is told what is being done, and the share of it that is done, 0 to 1.

    Returns:
        Motion and scenario.

    Raises:
        UsageError: If none of the factors that are tried keeps the limits.
    """
    found: dict[float, tuple[Reference, Demand]] = {}
    failed: dict[float, str] = {}

    def kept(factor: float) -> bool:
        progress("fastest timing", min(len(found) / _MOST, 1.0))
        try:
            reference = desired_motion(vehicle, stretched(scenario, factor))
        except UsageError as error:  # Too fast for the attitude or the arm to follow.
            failed[factor] = f"; any faster, {error}"
            return False
        time = check_times(reference.knots)
        demand = demand_of(vehicle, reference(time), time)
        if keeps(demand, limits):
            found[factor] = reference, demand
        else:
            failed[factor] = ""
        return factor in found

    ratio = 1.0 / _RATIO if kept(1.0) else _RATIO
    factors = ratio ** np.arange(1, _MOST)
    # Faster until limits are exceeded, or slower until they are kept.
    last = next((f for f in factors if kept(f) == (ratio > 1.0)), factors[-1])
    if not found:
        raise UsageError(
            f"timing: {vehicle.name} does not keep its limits, even if all of {scenario.name!r} "
            f"takes {last:.0f} times as long; widen the limits, or give a gentler motion"
        )
    fast, slow = sorted((last, last / ratio))
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(fast * slow))
        fast, slow = (fast, middle) if kept(middle) else (middle, slow)
    factor = min(found)
    reference, demand = found[factor]
    if _rests(reference):
        return TimedMotion(scenario, desired_motion(vehicle, scenario, progress), _NOTHING)
    return TimedMotion(
        stretched(scenario, factor),
        reference,
        f"{reference.end:.4g} s instead of {scenario.duration:.4g} s: all of the motion is "
        f"stretched by one factor, {factor:.3g}, since the attitude of {vehicle.name} follows from "
        f"the timing{failed[max(failed)] if failed else ''}",
        binding(vehicle, demand, limits),
    )
