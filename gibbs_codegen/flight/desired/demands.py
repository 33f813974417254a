"""The demand of a motion on rotors and joints, beside their limits."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.plant.actuators import actuators_of, joint_place
from gibbs_codegen.flight.plant.allocation import least_inputs
from gibbs_codegen.flight.plant.vehicle import Array, Flags, RobotData, Vehicle
from gibbs_codegen.flight.scenario.scenario import Scenario

# Share of the range between least and greatest input, at its ends, in which a limit counts as
# reached.
_REACHED = 0.01
_NEAR = 1.0 - _REACHED
# Gaps shorter than this between times at which a limit is reached are not told, s.
_GAP = 0.05


@dataclass(frozen=True)
class TimingLimits:
    """Limits of the timing of a motion; infinite where there is none.

    - `inputs` (2, nu): least and greatest thrusts, N, and torques or forces, N m or N
    - `thrust_rate`: greatest rate of thrusts, N/s
    - `velocities` (n): greatest rates of the joints, rad/s or m/s
    """

    inputs: Array
    thrust_rate: float
    velocities: Array

    @property
    def any(self) -> bool:
        """True if there is a limit at all."""
        return bool(np.any(np.isfinite(self.inputs)) or np.any(np.isfinite(self.velocities)))


def limits_of(vehicle: RobotData, scenario: Scenario) -> TimingLimits:
    """Limits that the scenario's timing says, and else those of motors and joints.

    Raises `UsageError` for a joint that the robot does not have.
    """
    timing, actuators = scenario.timing, actuators_of(vehicle, scenario)
    if timing.limits is not None:
        actuators.thrusts[:] = np.transpose([timing.limits])
    for key, values in (("effort", actuators.efforts), ("velocity", actuators.velocities)):
        for name, most in getattr(timing, key).items():
            values[joint_place(vehicle, name, f"timing.{key}")] = most
    # What loops move needs no torque.
    for name in chain(*getattr(vehicle.module, "LOOPS", {}).values()):
        actuators.efforts[vehicle.joint_names.index(name)] = np.inf
    rate = np.inf if timing.thrust_rate is None else timing.thrust_rate
    return TimingLimits(actuators.inputs, rate, actuators.velocities)


def needed_inputs(vehicle: Vehicle, q: Array, v: Array, a: Array) -> Array:
    """Inputs (s, nu) that a motion needs, with the thrusts of least norm, whatever their limits.

    Wrenches that the rotors cannot produce are left out.
    """
    columns = vehicle.input_wrenches(q if vehicle.wrenches_vary else None)
    return least_inputs(vehicle, q, vehicle.needed_force(q, v, a), columns)


@dataclass(frozen=True)
class Demand:
    """The demand of a motion at times (s), s.

    - `inputs` (s, nu), and `still` (s, nu): those for standing still there
    - `rates` (s, N): of the thrusts, N/s; `velocities` (s, n): of the joints, rad/s or m/s
    """

    time: Array
    inputs: Array
    still: Array
    rates: Array
    velocities: Array


def demand_of(vehicle: Vehicle, motion: tuple[Array, Array, Array], time: Array) -> Demand:
    """The demand of a motion (s, nq), (s, nv), (s, nv) at times (s), s."""
    q, v, a = motion
    inputs = needed_inputs(vehicle, q, v, a)
    rates = np.gradient(inputs[:, : vehicle.rotors], time, axis=0)
    return Demand(
        time, inputs, needed_inputs(vehicle, q, 0.0 * v, 0.0 * v), rates, v[:, vehicle.arm_rates]
    )


def excess(demand: Demand, limits: TimingLimits) -> Array:
    """Factors (s) by which squared speeds and accelerations are too great; 1 just at a limit.

    Standing still must keep the limits.
    """
    least, most = limits.inputs
    moving = demand.inputs - demand.still
    room = np.where(moving > 0.0, most - demand.still, demand.still - least)
    inputs = np.max(np.abs(moving) / room, axis=-1)
    joints = np.max(np.abs(demand.velocities) / limits.velocities, axis=-1, initial=0.0)
    return np.maximum(inputs, joints**2)


def worst_violation(vehicle: Vehicle, demand: Demand, limits: TimingLimits) -> str:
    """A clause with the limit that is exceeded most, as a share of it, and when; "" if none is."""
    least, most = limits.inputs
    joints, thrusts = vehicle.joint_names, vehicle.inputs[: vehicle.rotors]
    rates = vehicle.layout.v.units[vehicle.arm_rates]
    worst, clause = 0.0, ""
    for verb, names, series, limit, units in (
        ("exceed", vehicle.inputs, demand.inputs, most, vehicle.input_units),
        ("fall below", vehicle.inputs, -demand.inputs, -least, vehicle.input_units),
        ("change faster than", thrusts, np.abs(demand.rates), limits.thrust_rate, ["N/s"]),
        ("move faster than", joints, np.abs(demand.velocities), limits.velocities, rates),
    ):
        limit = np.broadcast_to(limit, series.shape[1:])
        over = (series - limit) / (1.0 + np.where(np.isfinite(limit), np.abs(limit), 0.0))
        if np.max(over, initial=0.0) <= worst:
            continue
        instant, place = np.unravel_index(np.argmax(over), over.shape)
        worst = over[instant, place]
        value = -limit[place] if verb == "fall below" else limit[place]
        unit = units[place % len(units)]
        at = f"at t = {demand.time[instant]:.4g} s"
        clause = f"{names[place]} would {verb} {value:g} {unit} {at}"
    return clause


def check_still(vehicle: Vehicle, q: Array, time: Array, limits: TimingLimits) -> None:
    """Raise `UsageError`, with input and time, if the robot cannot stand still on its way.

    Coordinates (s, nq) are those at times (s), s, of the scenario.
    """
    at_rest = np.zeros((len(q), vehicle.layout.v.size))
    still = needed_inputs(vehicle, q, at_rest, at_rest)
    least, most = limits.inputs
    margin = np.minimum(still - least, most - still)
    if np.all(margin > 0.0):
        return
    instant, place = np.argwhere(margin <= 0.0)[0]
    raise UsageError(
        f"timing: at t = {time[instant]:.6g} s of the scenario {vehicle.inputs[place]} is "
        f"{still[instant, place]:.4g} while the robot stands still, outside its limits, "
        f"{least[place]:g} to {most[place]:g}, so no timing helps; widen the limits"
    )


@dataclass(frozen=True)
class Binding:
    """A limit that is reached from `begin` to `end`, s: `limit` names it."""

    begin: float
    end: float
    limit: str


def binding(vehicle: Vehicle, demand: Demand, limits: TimingLimits) -> tuple[Binding, ...]:
    """The limits that a motion reaches, with their times, the earliest first."""
    least, most = limits.inputs
    names, thrusts = vehicle.inputs, vehicle.inputs[: vehicle.rotors]
    with np.errstate(invalid="ignore"):
        span = most - least
        # A limit alone counts from what standing still takes.
        alone = np.abs(np.where(np.isfinite(least), least, most) - demand.still.mean(axis=0))
        margin = _REACHED * np.where(np.isfinite(span), span, alone)
        reached = (
            ("greatest", names, demand.inputs >= most - margin),
            ("least", names, demand.inputs <= least + margin),
            ("rate of", thrusts, np.abs(demand.rates) >= _NEAR * limits.thrust_rate),
            (
                "velocity of",
                vehicle.joint_names,
                np.abs(demand.velocities) >= _NEAR * limits.velocities,
            ),
        )
    bindings = [
        Binding(begin, end, f"{quantity} {name}")
        for quantity, inputs, flags in reached
        for name, series in zip(inputs, flags.T, strict=True)
        for begin, end in _runs(demand.time, series)
    ]
    return tuple(sorted(bindings, key=lambda b: (b.begin, b.end, b.limit)))


def _runs(time: Array, flags: Flags) -> list[tuple[float, float]]:
    """Begin and end, s, of each interval in which `flags` (s) hold; gaps hardly there are closed.

    None is of an instant alone.
    """
    places = np.flatnonzero(flags)
    if not len(places):
        return []
    times = time[places]
    apart = np.flatnonzero(np.diff(times) > _GAP)
    begins = times[np.concatenate([[0], apart + 1])]
    ends = times[np.concatenate([apart, [len(times) - 1]])]
    return [(float(b), float(e)) for b, e in zip(begins, ends, strict=True) if e > b]
