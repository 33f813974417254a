"""Which law of control a robot is flown by: what its rotors command decides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gibbs_codegen.flight.control.error_polynomials import check_integral
from gibbs_codegen.flight.control.geometric import GeometricLaw
from gibbs_codegen.flight.control.laws import CORRECTING, ControlLaw, Controller, Gains
from gibbs_codegen.flight.plant.allocation import (
    Allocation,
    AllocationError,
    listed,
    ranks,
    thrust_axis,
)
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Reference
from gibbs_codegen.flight.scenario.parts import Control, Law

_ALL = 6
# How much faster the base must lean than the position follows, which it moves.
_FASTER = 4.0
_WHERE = "(in the base's frame, about the base centre)"


def law_of(law: Law, vehicle: Vehicle, q: Array, scenario: str) -> Law:
    """The law that a scenario's asks for: "tracking" is one or another, all others are themselves.

    `q` (s, nq) is of the desired motion; one is enough for rotors that no joint moves. Raises
    `AllocationError`, with what would serve, if rotors do not command what the law needs.
    """
    if law in ("open_loop", "off"):
        return law
    full = bool(np.all(ranks(vehicle.thrust_wrenches(q)) == _ALL))
    one_axis = thrust_axis(vehicle, q) is not None
    if law in ("tracking", "computed_torque") and full:
        return "computed_torque"
    if law in ("tracking", "geometric") and one_axis:
        return "geometric"
    purpose = f"{vehicle.name}: to fly {scenario!r} under "
    if full:
        raise AllocationError(
            f"{purpose}the geometric law, the rotors must push along one axis, but they command "
            'all directions; set control.law to "tracking" or "computed_torque"',
            (),
        )
    wrenches = vehicle.thrust_wrenches(np.atleast_2d(q))
    missing = Allocation(wrenches[np.argmin(ranks(wrenches))]).missing
    lacks = f"but the rotors cannot command {listed(missing)} {_WHERE}"
    if one_axis:
        raise AllocationError(
            f"{purpose}computed torque, the base must be fully actuated, {lacks}; set control.law "
            'to "tracking" or "geometric", by which a base flies that pushes along one axis and '
            "commands three moments",
            missing,
        )
    at = ";"
    if vehicle.rotors_move:  # Where they command least, before other remedies.
        worst = np.reshape(q, (-1, q.shape[-1]))[np.argmin(ranks(vehicle.thrust_wrenches(q)))]
        joints = zip(vehicle.joint_names, worst[vehicle.arm].tolist(), strict=True)
        at = (
            f" where {', '.join(f'{name} = {value:.4g}' for name, value in joints)} (rad or m); "
            "choose another posture (arm.posture_deg or arm.moves), or"
        )
    remedy = 'tilt some thrusts in the robot file, add rotors, or set control.law to "open_loop"'
    if not vehicle.rotors:
        remedy = 'add rotors to the robot file, or set control.law to "off", and it falls'
    raise AllocationError(
        f"{purpose}control, the rotors must command all directions, or the force along one axis "
        f"and three moments, {lacks}{at} {remedy}",
        missing,
    )


def control_law(
    law: Law, control: Control, vehicle: Vehicle, reference: Reference, allocation: Allocation
) -> ControlLaw:
    """The law, which is not "tracking", with the gains of a scenario.

    `vehicle` is the robot as the law knows it. Raises `UsageError` if integral action makes errors
    grow, or the geometric law is to fly a motion without thrust.
    """
    geometric, allocation = law == "geometric", allocation.in_flight()
    attitude = control.attitude_frequency
    if attitude is None:
        attitude = control.frequency * (_FASTER if geometric else 1.0)
    places = vehicle.layout.v
    frequencies = np.full(places.size, control.frequency)
    frequencies[places.attitude] = attitude
    gains = Gains.of(frequencies, control.damping_ratio, places.size)
    memory = 0
    if control.integral and law in CORRECTING:
        gains, memory = replace(gains, integral=control.integral), places.size
    found: Controller | GeometricLaw
    if geometric:
        found = GeometricLaw(vehicle, reference, allocation, gains, memory=memory)
        found.check_thrust()
    else:
        found = Controller(vehicle, reference, allocation, gains, law, memory)
    check_integral(found)
    return found
