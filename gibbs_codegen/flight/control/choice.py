"""The law of control of a flight; it depends on what the rotors command."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError, check_all
from gibbs_codegen.flight.control.error_polynomials import check_integral
from gibbs_codegen.flight.control.geometric import LeaningController
from gibbs_codegen.flight.control.laws import Controller, Gains, MovedFrame
from gibbs_codegen.flight.plant.actuators import has_servo, holds, joint_place
from gibbs_codegen.flight.plant.allocation import (
    Allocation,
    AllocationError,
    asked_of,
    commands_all,
    listed,
    ranks,
    thrust_axis,
)
from gibbs_codegen.flight.plant.vehicle import Array, RobotData, Vehicle
from gibbs_codegen.flight.reference import Reference
from gibbs_codegen.flight.scenario.parts import PREDICTIVE, WORLD, Control, Force, Impedance, Law
from gibbs_codegen.machine.base import RETURN
from gibbs_codegen.machine.laws import LAWS, turns_servos

# Joints do not move a frame along a push by less than this share of how they move it.
_NO_LEVER = 1e-3
# How much faster the base must lean than the position follows, which it moves.
_FASTER = 4.0
_WHERE = "(in the base's frame, about the base centre)"


def law_of(law: Law, vehicle: RobotData, q: Array, scenario: str) -> Law:
    """The law that a scenario asks for: of a task, such as "tracking", that which suits the rotors.

    All others are themselves.
    `q` (s, nq) is of the desired motion; one is enough for rotors that no joint moves. Raises
    `AllocationError`, with what would serve, if rotors do not command what the law needs.
    """
    rolls = vehicle.layout.has_drive or vehicle.layout.q.wheels
    lacking = [name for name, row in LAWS.items() if rolls and row.calls]
    if law in lacking:
        raise UsageError(
            f"control.law: {law} does not support wheels, which {vehicle.name} has; set it to "
            '"tracking"'
        )
    if law == PREDICTIVE and vehicle.layout.moves_freely:
        law_of("tracking", vehicle, q, scenario)  # It plans about hover, for which rotors serve.
    if law not in ("tracking", *LAWS):
        return law
    full = commands_all(vehicle, q)
    one_axis = thrust_axis(vehicle, q) is not None
    task = LAWS[law].task if law in LAWS else law
    of_task = {name: row for name, row in LAWS.items() if row.task == task and name not in lacking}
    suiting = [name for name, row in of_task.items() if (one_axis if row.leans else full)]
    if law == task and suiting:
        return suiting[0]
    if law in suiting:
        return law
    purpose = f"{vehicle.name}: to fly {scenario!r} under "
    others = " or ".join(f'"{name}"' for name in dict.fromkeys((task, *suiting)))
    if full:
        raise AllocationError(
            f"{purpose}{LAWS[law].title}, the rotors must push along one axis, but "
            f"{'they command all directions' if vehicle.rotors else 'there are none'}; set "
            f"control.law to {others}",
            (),
        )
    places = np.atleast_2d(q)
    weakest = places[np.argmin(ranks(vehicle.input_wrenches(places)))]
    asked = asked_of(vehicle, weakest)
    missing = Allocation(vehicle.input_wrenches(weakest), asked=asked).missing
    if not vehicle.rotors and not vehicle.layout.moves_freely:
        remedy = 'to "predictive", which uses the joints alone, or to "off"'
        if rolls:
            remedy = 'to "off", give more wheels an effort'
        raise AllocationError(
            f"{vehicle.name}: nothing produces the {listed(missing)} that its base needs to "
            f"follow {scenario!r}; set control.law {remedy}, or give your own controller",
            missing,
        )
    lacks = f"but the rotors cannot command {listed(missing)} {_WHERE}"
    if one_axis:
        raise AllocationError(
            f"{purpose}{LAWS[law].title}, the base must be fully actuated, {lacks}; set "
            f"control.law to {others}, for a base that pushes along one axis and commands three "
            "moments",
            missing,
        )
    at = ";"
    if vehicle.rotors_move:  # Where they command least, before other remedies.
        joints = zip(vehicle.joint_names, weakest[vehicle.arm].tolist(), strict=True)
        at = (
            f" where {', '.join(f'{name} = {value:.4g}' for name, value in joints)} (rad or m); "
            "choose another posture (arm.posture_deg or arm.moves), or"
        )
    count = len(vehicle.layout.v.base)
    few = "" if vehicle.rotors >= count else f" (all directions take {count} or more)"
    remedy = (
        f'tilt some thrusts in the robot file, add rotors{few}, or set control.law to "open_loop"; '
        "in Python, lqr and rollout fly what trim balances"
    )
    if not vehicle.rotors:
        remedy = 'add rotors to the robot file, or set control.law to "off", and it falls'
    raise AllocationError(
        f"{purpose}control, the rotors must command all directions, or the force along one axis "
        f"and three moments, {lacks}{at} {remedy}",
        missing,
    )


def control_law(
    law: Law, control: Control, vehicle: Vehicle, reference: Reference, allocation: Allocation
) -> Controller:
    """The law, which is not "tracking", with the gains of a scenario.

    `vehicle` is the robot as the law knows it. Raises `UsageError` if integral action makes errors
    grow, the geometric law is to fly a motion without thrust, or joints do not move a frame along
    the push of a base that leans.
    """
    if law == PREDICTIVE:  # It is sampled, in place of the inputs of the desired motion.
        law = "open_loop"
    leans, allocation = law in LAWS and LAWS[law].leans, allocation.in_flight()
    check_control(law, control, vehicle)
    held = [k for k in range(vehicle.joints) if holds(vehicle, k) and not turns_servos(law)]
    gains = gains_of(control, vehicle, leans, held)
    gains = replace(gains, integral=control.integral, adaptation=control.adaptation)
    gains = replace(gains, back=control.back)
    moved = _moved_frame(law, control, vehicle)
    if leans and moved is not None:
        _check_levers(moved, control, vehicle, reference)
    elif moved is not None:
        _check_moved(moved, gains.stiffness > 0.0, vehicle, reference)
    kind = LeaningController if leans else Controller
    controller = kind(vehicle, reference, allocation, gains, law, 0, moved)
    if law in LAWS and (control.integral or LAWS[law].pushes or LAWS[law].learns):
        controller = replace(controller, memory=controller.memory_size)
    if isinstance(controller, LeaningController):
        controller.check_thrust()
    check_integral(controller)
    return controller


def gains_of(control: Control, vehicle: RobotData, leans: bool, held: Sequence[int] = ()) -> Gains:
    """Gains of errors by the frequencies of a scenario, of a base that leans or does not.

    Servos hold the joints `held`, by their places among the joints.
    """
    attitude, places = control.attitude_frequency, vehicle.layout.v
    if attitude is None:
        attitude = control.frequency * (_FASTER if leans else 1.0)
    frequencies = np.full(places.size, control.frequency)
    frequencies[places.attitude] = attitude
    ratios = np.full(places.size, control.damping_ratio)
    for name, row in control.joints.items():
        place = places.joints.start + joint_place(vehicle, name)
        frequencies[place] = row.frequency or control.frequency
        ratios[place] = control.damping_ratio if row.damping_ratio is None else row.damping_ratio
    # A servo corrects what is off itself, unless the law wants torques of it.
    frequencies[places.joints][[*held]] = 0.0
    return Gains.of(frequencies, ratios, places.size)


def check_control(law: Law | None, control: Control, vehicle: RobotData) -> None:
    """Raise `UsageError` for joints and frames that are not there, or that servos hold.

    `law` is None where the desired motion decides it.
    """
    checks = [partial(joint_place, vehicle, name, "control.joints") for name in control.joints]
    if control.impedance or control.force:
        frame = (control.impedance or Impedance()).frame
        checks.append(partial(vehicle.frame_place, frame, "control.impedance.frame"))
    if control.force and control.force.axes != WORLD:
        checks.append(partial(vehicle.frame_place, control.force.axes, "control.force.axes"))
    if chosen := control.estimation:
        for key, frame in (("wrench", chosen.wrench), ("payload", chosen.payload)):
            if frame:
                checks.append(partial(vehicle.frame_place, frame, f"control.filter.{key}"))
    check_all(checks)
    if control.back != RETURN and not vehicle.layout.has_drive:
        raise UsageError(
            "control: return_rate and return_speed need a base with a drive, which "
            f"{vehicle.name} does not have; leave them out"
        )
    for name in control.joints if law is not None and not turns_servos(law) else ():
        if holds(vehicle, joint_place(vehicle, name)):
            raise UsageError(
                f"control.joints.{name}: a servo drives the joint with the gains of the robot "
                "file; leave it out"
            )
    if control.law == PREDICTIVE and (loops := getattr(vehicle.module, "LOOPS", ())):
        raise UsageError(
            f"control.law: the predictive law does not support loops ({', '.join(loops)}); set "
            'another law, such as "computed_torque"'
        )
    served = [x for k, x in enumerate(vehicle.joint_names) if has_servo(vehicle, k)]
    if control.law == PREDICTIVE and control.force and served:
        # Between a servo and a wall it loses machines.
        raise UsageError(
            "control.force: the predictive law pushes with joint torques, but servos drive "
            f"{', '.join(served)}; remove these servos, or, if the base commands all directions, "
            'set control.law to "force"'
        )


def _moved_frame(law: Law, control: Control, vehicle: Vehicle) -> MovedFrame | None:
    """The frame that a law moves, and how; None if it moves none.

    Raises `UsageError` for a frame that the robot does not have, or that nothing moves.
    """
    if law not in LAWS or not LAWS[law].moves_frame:
        return None
    impedance, force = control.impedance or Impedance(), control.force
    place, axes = vehicle.frame_place(impedance.frame, "control.impedance.frame"), None
    if force is not None and force.axes != WORLD:
        axes = vehicle.frame_place(force.axes, "control.force.axes")
    if hindrance := LAWS[law].hindrance(vehicle.joints, impedance.frame):
        raise UsageError(
            f'{vehicle.name}: {hindrance}; set control.law to "tracking", or fly a robot whose '
            "base commands all directions"
        )
    if impedance.inertia is None and np.isnan(vehicle.mass):
        raise UsageError(
            f"control.impedance.inertia: missing; the mass of {vehicle.name}, its default, is "
            "not known without a moving base or gravity"
        )
    gains = Gains.of(control.frequency, control.damping_ratio, 3)
    return MovedFrame(place, axes, impedance, gains, force)


def _check_moved(
    moved: MovedFrame, loose: NDArray[np.bool_], vehicle: Vehicle, reference: Reference
) -> None:
    """Raise `UsageError` with the time at which what is `loose` (nv) moves a frame least.

    A law that moves it needs all directions, but for axes of the world along which no posture does.
    """
    frame, q = moved.impedance.frame, reference(reference.knots)[0]
    anywhere = vehicle.module.integrate(q, np.cos(np.arange(len(loose))))
    levers, others = (
        np.pad(vehicle.frame_jacobians(x)[:, moved.place, :3][..., loose], ((0, 0), (0, 0), (0, 3)))
        for x in (q, anywhere)
    )
    across = ~np.any([levers, others], axis=(0, 1, 3))
    count = 3 - np.count_nonzero(across)
    ways, shares, _ = np.linalg.svd(levers)
    k = np.argmin(shares[:, count - 1] - _NO_LEVER * shares[:, 0])
    if shares[k, count - 1] <= _NO_LEVER * shares[k, 0]:
        raise UsageError(
            f"{vehicle.name}: at t = {reference.knots[k]:.6g} s the robot cannot move {frame} "
            f"along {_in_words(ways[k, :, count - 1])}, and control.law needs all directions; "
            'choose another posture (arm.posture_deg), or set control.law to "tracking"'
        )
    if moved.force is None:
        return
    n = _push_direction(moved, moved.force, vehicle, reference(moved.force.begin)[0])
    if np.any(np.abs(n[across]) > _NO_LEVER):
        raise UsageError(
            f"control.force.direction: {vehicle.name} can never move {frame} along "
            f"{_in_words(np.eye(3)[across][0])}; give a direction in the plane in which it moves"
        )


def _push_direction(moved: MovedFrame, force: Force, vehicle: Vehicle, q: Array) -> Array:
    """The direction (3) of a push where it begins, of length 1, world axes."""
    direction: Array = np.array(force.direction) / np.linalg.norm(force.direction)
    if moved.axes is not None:
        direction = vehicle.frame_poses(q)[moved.axes, :3, :3] @ direction
    return direction


def _in_words(way: Array) -> str:
    """A direction (3), of which the greatest entry is positive."""
    way = way * np.sign(way[np.argmax(np.abs(way))])
    return f"[{', '.join(f'{x:.3g}' for x in way.round(3) + 0.0)}]"


def _check_levers(
    moved: MovedFrame, control: Control, vehicle: Vehicle, reference: Reference
) -> None:
    """Raise `UsageError` where no joint moves a frame along its push when that begins.

    Where a base leans, the joints alone move the frame relative to the centre of mass. Where they
    cannot, springs that were asked for are not there: warn.
    """
    frame, force = moved.impedance.frame, moved.force
    q = reference(0.0 if force is None else force.begin)[0]
    relative = vehicle.frame_jacobians(q)[moved.place, :3] - vehicle.centre_of_mass_jacobian(q)
    levers = relative[:, vehicle.layout.v.joints]
    least = _NO_LEVER * np.linalg.norm(levers)
    if force is None:
        ways, shares, _ = np.linalg.svd(np.pad(levers, ((0, 0), (0, 3))))
        stiff = " and ".join(map(_in_words, ways.T[shares <= least]))
        if control.impedance and control.impedance.stiffness and stiff:
            warnings.warn(
                f"control.impedance.stiffness: {vehicle.name} leans, so its joints must yield, "
                f"but at the start none moves {frame} along {stiff} relative to the centre of "
                "mass; leave it out, and control.frequency of the base holds the frame there",
                stacklevel=2,
            )
        return
    if np.linalg.norm(_push_direction(moved, force, vehicle, q) @ levers) <= least:
        raise UsageError(
            f"control.force.direction: {vehicle.name} leans, so its joints must push, but at "
            f"{force.begin:g} s none moves {frame} along the direction relative to the centre of "
            "mass; turn the direction or the base, or bend the arm (arm.posture_deg)"
        )
