"""The desired motion of a scenario, and the state in which its flight starts.

The motion is timed as the paths say, or as fast as limits allow.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.errors import UsageError, check_all
from gibbs_codegen.flight.attitude import SingularAttitudeError, Turning, rotation_vector
from gibbs_codegen.flight.desired import demands, timing
from gibbs_codegen.flight.desired.base_trajectory import (
    base_motion,
    check_times,
    desired_base,
    knots,
)
from gibbs_codegen.flight.desired.inverse_kinematics import JointBounds, check_tip, desired_with_tip
from gibbs_codegen.flight.desired.led_frames import led_frames
from gibbs_codegen.flight.desired.posture import (
    authority_posture,
    check_mechanism,
    joint_motion,
    rest_posture,
    with_joints,
)
from gibbs_codegen.flight.desired.underactuated_base import underactuated_motion
from gibbs_codegen.flight.plant.actuators import Actuators, actuators_of, joint_place
from gibbs_codegen.flight.plant.allocation import allocation_of, listed, thrust_axis
from gibbs_codegen.flight.plant.vehicle import Array, RobotData, Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.orientation import Carried
from gibbs_codegen.flight.scenario.parts import MAX_DURATION, StartOffset
from gibbs_codegen.flight.scenario.paths import Fixed, Path
from gibbs_codegen.flight.scenario.scenario import ArmTask, Scenario, on_clock, slow_motion
from gibbs_codegen.flight.vectors import rotation_about, transposed

_log = logging.getLogger("gibbs_codegen")
# How far from its posture, rad or m, a joint is elsewhere.
_ASIDE = 1e-3
# Is told what is being done, and the share of it that is done, 0 to 1.
Progress = Callable[[str, float], None]


def desired_motion(
    vehicle: Vehicle, scenario: Scenario, progress: Progress = lambda stage, share: None
) -> Reference:
    """Desired coordinates, rates and accelerations of a scenario, as functions of time.

    Raises `UsageError` or one of its kinds where there is no such motion, and for joints outside
    their limits.
    """
    actuators = check_arm(vehicle, scenario)
    check_base(vehicle, scenario)
    limits = actuators.joints[0], actuators.joints[1]
    # The timing "fastest" slows down what is too fast.
    fastest = actuators.velocities if scenario.timing.law == "uniform" else np.inf
    if not scenario.arm.paths:
        motion = _with_posture(vehicle, scenario, limits, fastest, progress)
    else:
        motion = _with_frames(vehicle, scenario, limits, progress)
        _check_rates(vehicle, motion, fastest)
    return vehicle.kinematics.reference(motion)


def base_path(vehicle: Vehicle, scenario: Scenario) -> Path:
    """The path of the base centre: that of the scenario, or where it is at coordinates of 0."""
    if scenario.base is not None:
        return scenario.base
    x, y, z = vehicle.centre_offset(vehicle.neutral).tolist()
    return Fixed((x, y, z))


def check_base(vehicle: Vehicle, scenario: Scenario) -> None:
    """Raise `UsageError` where the base cannot be where a scenario leads it."""
    if vehicle.layout.moves_freely:
        return
    time, path = knots(scenario.duration), base_path(vehicle, scenario)
    centre, turning = path(time), scenario.attitude(path, time, vehicle.arm_angles())
    motion = base_motion(vehicle, time, centre, turning)
    q = motion.q
    keys = ("base.path" if scenario.base else "", "base.attitude")
    advice = f"; leave it out of the scenario {scenario.name!r}, or fly the scenario hold"
    _check_place(vehicle, (time, q), centre[:, 0], turning.rotation, keys, advice)
    if vehicle.layout.has_drive:
        moved = vehicle.frame_velocities(q, motion.v)[:, vehicle.frames.index("base"), :3]
        slip = np.linalg.norm(centre[:, 1] - moved, axis=-1)
        if slip[k := int(np.argmax(slip))] > _OFF:
            raise UsageError(
                f"base.attitude: at t = {time[k]:.6g} s the base of {vehicle.name} would slip "
                f"sideways at {slip[k]:.4g} m/s on its path, but it only rolls ahead; set "
                'base.attitude to { kind = "tangent" }, or heading_deg to the direction of a '
                "straight path"
            )


def _check_place(
    vehicle: Vehicle,
    knots: tuple[Array, Array],
    centre: Array,
    rotation: Array,
    keys: Sequence[str],
    advice: str = "",
) -> None:
    """Raise `UsageError` with the time at which the base is furthest from where it is to be.

    `knots` are times (s), s, and coordinates (s, nq) that come nearest to a base centre (s, 3) and
    rotations (s, 3, 3); `keys` of the scenario file tell these, none where it is free. The words
    end with `advice`.
    """
    time, q = knots
    there = vehicle.positions(q)[:, vehicle.points.index(vehicle.centre)]
    turn = rotation_vector(transposed(vehicle.base_rotation(q)) @ rotation)
    along, about = (["xyz"[axis] for axis in axes] for axes in vehicle.layout.own_axes)
    moves = f"moves along {listed(along)} only" if along else "does not move"
    turns = f"turns about {listed(about)} only" if about else "does not turn"
    away = (centre - there, "m along", moves), (turn, "rad about", turns)
    for key, (off, unit, words) in zip(keys, away, strict=True):
        k, axis = np.unravel_index(np.argmax(np.abs(off)), off.shape)
        if key and abs(off[k, axis]) > _OFF:
            raise UsageError(
                f"{key}: at t = {time[k]:.6g} s it is {off[k, axis]:.4g} {unit} {'xyz'[axis]} "
                f"from where the base of {vehicle.name} can be, which {words}{advice}"
            )


def _with_posture(
    vehicle: Vehicle,
    scenario: Scenario,
    limits: JointBounds,
    fastest: Array | float,
    progress: Progress,
) -> Motion:
    """The motion of a scenario without a path of the tip.

    `fastest`: greatest rates of the joints (n), or of all, rad/s or m/s.
    """
    task, time = scenario.arm, knots(scenario.duration)
    if task.posture is None:
        posture = _rest(vehicle, scenario, limits)
    else:
        posture = _joint_values(vehicle, task.posture, "arm.posture")
    robot = Functions(vehicle.module)
    undriven = robot.undriven if robot.leads_loops else []
    for name in undriven:
        if name in task.moves:
            raise UsageError(
                f"arm.moves.{name}: loops move this joint of {vehicle.name}, which has no drive; "
                "give moves of driven joints"
            )
        if task.posture is not None and name not in task.posture:
            place = vehicle.joint_names.index(name)
            posture[place] = vehicle.module.POSTURE[vehicle.arm][place]
    joints_at = partial(joint_motion, vehicle, posture, task.moves)
    wanted, shown = (
        (base_path(vehicle, scenario), scenario.attitude),
        partial(progress, "desired motion"),
    )
    # What the base does then depends on the joints.
    joints = joints_at(time)
    _check_rates(vehicle, joints, fastest)
    if undriven:
        check_mechanism(vehicle, joints, limits, scenario.control.law != "off")
        there = joints.q[0, vehicle.arm]
        asked = {name: posture[vehicle.joint_names.index(name)] for name in task.posture or ()}
        off = [x for x, y in asked.items() if abs(there[vehicle.joint_names.index(x)] - y) > _ASIDE]
        if off:
            words = "%s: arm.posture: closed loops determine joints without a drive: %s"
            _log.warning(words, vehicle.name, ", ".join(off))
    if thrust_axis(vehicle, joints_at(time[:1]).q) is not None:
        led = led_frames(vehicle, {}, limits)
        return underactuated_motion(vehicle, time, joints_at, *wanted, led, shown)
    base = desired_base(vehicle, time, *wanted, shown)
    return with_joints(vehicle, base, joints_at(base.time))


def _rest(vehicle: Vehicle, scenario: Scenario, limits: JointBounds) -> Array:
    """Joints (n) that hang, or are where rotors that joints move command as they must."""
    posture = rest_posture(vehicle, limits)
    if vehicle.rotors_move and scenario.control.law != "off":
        return authority_posture(vehicle, limits, posture)
    return posture


def _with_frames(
    vehicle: Vehicle, scenario: Scenario, limits: JointBounds, progress: Progress
) -> Motion:
    """The motion of a scenario with paths of the tip or of other frames.

    Raises `UsageError` as `underactuated_motion` does for a base that leans, as `desired_with_tip`
    does for others, and for paths of other frames there.
    """
    task, time = scenario.arm, knots(scenario.duration)
    if Functions(vehicle.module).leads_loops:
        raise UsageError(
            f"arm: frames of {vehicle.name} cannot follow paths, because its loops have joints "
            "without a drive; give moves of joints (arm.moves_deg)"
        )
    guess = None
    if task.guess is not None:
        guess = _joint_values(vehicle, task.guess, "arm.guess")
    posture = _rest(vehicle, scenario, limits) if guess is None else guess
    joints_at = partial(joint_motion, vehicle, posture, {})
    leans = thrust_axis(vehicle, joints_at(time[:1]).q) is not None
    if leans and scenario.control.law != "off":
        return underactuated_motion(
            vehicle,
            time,
            joints_at,
            base_path(vehicle, scenario),
            scenario.attitude,
            led_frames(vehicle, task.paths, limits, posture if vehicle.rotors_move else guess),
            partial(progress, "desired motion"),
        )
    if task.tip is None or task.frames:
        raise UsageError(
            f"{vehicle.name}: arm.frames: only robots whose base leans move frames other than "
            "the tip along paths; leave them out"
        )

    def base_at(knots: Array) -> Motion:
        # Progress is shown for the first time only: what follows is the arm's.
        shown = partial(progress, "desired motion") if knots is time else lambda share: None
        path = base_path(vehicle, scenario)
        return desired_base(vehicle, knots, path, scenario.attitude, shown)

    return desired_with_tip(
        vehicle,
        time,
        base_at,
        task.tip,
        limits,
        guess,
        lambda done, total: progress("inverse kinematics", done / total),
    )


def starting_state(
    vehicle: Vehicle, reference: Reference, offset: StartOffset
) -> tuple[Array, Array]:
    """The desired state (nq), (nv) at the start of a flight, moved and turned by the start offset.

    Velocities of position and attitude stay as they are in the world, or as rates of attitude
    angles. Raises `SingularAttitudeError` if the offset turns the base to the singularity.
    """
    q, v, _ = reference(reference.begin)
    if not any(offset.position) and not any(offset.rotation):
        return q, v
    attitude, position = vehicle.layout.q.attitude, vehicle.layout.q.position
    centre = vehicle.kinematics.spread(q[position]) + vehicle.centre_offset(q)
    start, turn, turns = q.copy(), np.array(offset.rotation), vehicle.layout.own_axes[1]
    if len(turns) == 2:  # No turn about both axes at once is one of this base.
        start[attitude] += turn[turns]
        turn[turns] = 0.0
    angle = float(np.linalg.norm(turn))
    turned = rotation_about(turn / (angle or 1.0), np.array(angle)) @ vehicle.base_rotation(start)
    at_rest = np.zeros((1, 3))
    try:
        turning = Turning(turned[np.newaxis], at_rest, at_rest)
        entries, _, _ = vehicle.kinematics.turned(turning)
    except SingularAttitudeError as error:
        raise SingularAttitudeError(
            f"at t = {reference.begin:.6g} s, with the base turned by start.turn_deg (the start's "
            f"rotation), {error}, or turn it less or another way at the start",
            error.place,
        ) from None
    start[attitude] = vehicle.kinematics.continued(q[attitude], entries)[0]
    centre += offset.position
    start[position] = (centre - vehicle.centre_offset(start))[vehicle.layout.own_axes[0]]
    knot = np.array([reference.begin]), start[np.newaxis]
    keys = "start.offset", "start.turn_deg"
    _check_place(vehicle, knot, centre[np.newaxis], turned[np.newaxis], keys)
    return start, vehicle.kinematics.kept(v, turned.T @ vehicle.base_rotation(q))


def check_arm(vehicle: RobotData, scenario: Scenario) -> Actuators:
    """Limits and lag in a flight, by which what the arm is to do is possible for the joints.

    Raises `UsageError` for joints and frames that are not there, and beyond limits.
    """
    task = scenario.arm
    check_all(partial(_check_unit, vehicle, *named) for named in sorted(task.named))
    actuators = actuators_of(vehicle, scenario)
    limits = actuators.joints[0], actuators.joints[1]
    if task.posture is not None:
        posture = _joint_values(vehicle, task.posture, "arm.posture")
        _check_limits(vehicle, task, "posture", posture, limits, vehicle.joint_names)
    for name, moves in task.moves.items():
        for move in moves:
            moved = _joint_values(vehicle, {name: move.to}, "arm.moves")
            _check_limits(vehicle, task, "moves", moved, limits, [name])
    # A guess says nothing of joints it leaves out: they begin at the limit nearest to 0.
    guess = _joint_values(vehicle, task.guess or {}, "arm.guess")
    _check_limits(vehicle, task, "guess", guess, limits, task.guess or ())
    if task.tip:
        check_tip(vehicle)
    if isinstance(task.tip, Carried) and vehicle.layout.moves_freely:
        raise UsageError(
            f"arm.tip_in_base: {vehicle.name} flies, and its rotors determine how it turns; give "
            "arm.tip_beside_base, in world axes"
        )
    for name in task.frames:
        vehicle.frame_place(name, f"arm.frames.{name}")
    return actuators


def _check_unit(vehicle: RobotData, name: str, table: str) -> None:
    """Raise `UsageError` if an angle was given as a travel, or a travel as an angle."""
    unit = vehicle.layout.q.units[vehicle.arm][joint_place(vehicle, name, f"arm.{table}")]
    if (unit == "rad") != table.endswith("_deg"):
        revolute = "revolute", f"{table}_deg.{name}, in degrees"
        prismatic = "prismatic", f"{table.removesuffix('_deg')}.{name}, in m"
        kind, place = revolute if unit == "rad" else prismatic
        raise UsageError(f"arm.{table}.{name}: the joint is {kind}; give it as arm.{place}")


def _check_rates(vehicle: Vehicle, motion: Motion, most: Array | float) -> None:
    """Raise `UsageError`, with joint and time, where a joint is to move faster than it can."""
    rates = np.abs(motion.v[:, vehicle.arm_rates])
    most = np.broadcast_to(most, rates.shape[1:])
    for joint in np.flatnonzero(np.any(rates > most, axis=0)):
        instant, unit = np.argmax(rates[:, joint]), vehicle.layout.v.units[vehicle.arm_rates][joint]
        name = vehicle.joint_names[joint]
        raise UsageError(
            f"arm: at t = {motion.time[instant]:.6g} s {name} has to move at "
            f"{rates[instant, joint]:.3g} {unit}, faster than its limit of {most[joint]:g} {unit}; "
            f"slow the paths or moves down, or give another limit as arm.velocity.{name}"
        )


def _joint_values(vehicle: RobotData, values: Mapping[str, float], table: str) -> Array:
    """Coordinates (n) of all joints, 0 for those that `table`, as messages call it, leaves out."""
    coordinates = np.zeros(vehicle.joints)
    for name, value in values.items():
        coordinates[joint_place(vehicle, name, table)] = value
    return coordinates


def _check_limits(
    vehicle: RobotData,
    task: ArmTask,
    table: str,
    values: Array,
    limits: JointBounds,
    joints: Iterable[str],
) -> None:
    """Raise `UsageError` for those of some joints whose value (n) is outside its limits.

    `table` of the scenario file's arm table gives the values; messages give angles of a file in
    degrees.
    """
    faults = []
    for name in joints:
        joint = joint_place(vehicle, name)
        value, lower, upper = values[joint], limits[0][joint], limits[1][joint]
        if not lower <= value <= upper:
            key, unit = table, f" {vehicle.layout.q.units[vehicle.arm][joint]}"
            if task.named and unit == " rad":
                key, unit = f"{key}_deg", "°"
                value, lower, upper = np.degrees([value, lower, upper])
            hint = "" if value else "; a joint left out of a posture is at 0"
            faults.append(
                f"arm.{key}.{name}: {value:.6g}{unit} is outside its limits, "
                f"{lower:.6g} to {upper:.6g}{unit}{hint}"
            )
    if faults:
        raise UsageError("\n".join(faults))


# Factor between durations that are tried, how many of them, and halvings of the last interval.
_RATIO, _MOST, _HALVINGS = 1.5, 12, 6

# How far a base may be from where it is to be, m or rad, by rounding.
_OFF = 1e-9
_NOTHING = "nothing moves, so there is nothing to time"


@dataclass(frozen=True)
class TimedMotion:
    """A scenario at the times at which it is flown, and its desired motion.

    `explanation` is the timing in words, "" where it is that of the paths; `binding` are the limits
    that it reaches.
    """

    scenario: Scenario
    reference: Reference
    explanation: str = ""
    binding: tuple[demands.Binding, ...] = ()


def timed_motion(
    vehicle: Vehicle, scenario: Scenario, progress: Progress = lambda stage, share: None
) -> TimedMotion:
    """The desired motion of a scenario, by its law of timing.

    Where the rotors command every wrench, "fastest" is the fastest motion along the paths. Else the
    attitude depends on the timing, and all of the motion is stretched by one factor. Raises
    `UsageError` or one of its kinds where there is no such motion.
    """
    if scenario.timing.law == "uniform":
        return TimedMotion(scenario, desired_motion(vehicle, scenario, progress))
    limits = demands.limits_of(vehicle, scenario)
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
    clock = timing.time_optimal_motion(
        vehicle, reference, limits, lambda share: progress("fastest timing", share)
    )
    return TimedMotion(
        on_clock(scenario, clock.duration, clock.scenario_time),
        timing.timed_reference(vehicle, clock),
        f"fastest within limits, {clock.duration:.4g} s instead of {scenario.duration:.4g} s",
        demands.binding(vehicle, timing.demand_at(vehicle, clock), limits),
    )


def _rests(reference: Reference) -> bool:
    """True if nothing ever moves."""
    return not np.any(reference(check_times(reference.knots))[1])


def _stretched_motion(
    vehicle: Vehicle, scenario: Scenario, limits: demands.TimingLimits, progress: Progress
) -> TimedMotion:
    """The fastest motion that differs from that of a scenario by one factor of time.

    Raises `UsageError` if none of the factors that are tried keeps the limits, or the robot cannot
    stand still with its joints as they are on the way.
    """
    motions: dict[float, tuple[Reference, demands.Demand]] = {}
    # Why there is no motion by a factor, or which limit it exceeds: a clause.
    failed: dict[float, str] = {}

    def keeps(factor: float) -> bool:
        """True if there is a motion by a factor of time, and it keeps the limits."""
        attempts = len(motions) + len(failed)
        progress("fastest timing", min(attempts / (_MOST + _HALVINGS), 1.0))
        try:
            reference = desired_motion(vehicle, slow_motion(scenario, factor))
        except UsageError as error:  # Too fast for the attitude or the arm to follow.
            failed[factor] = str(error)
            return False
        time = check_times(reference.knots)
        demand = demands.demand_of(vehicle, reference(time), time)
        # Standing still as the base is at the start, with the joints as they are on the way.
        q = reference(time)[0]
        still = np.tile(q[0], (len(q), 1))
        still[:, vehicle.arm] = q[:, vehicle.arm]
        demands.check_still(vehicle, still, time / factor, limits)
        if why := demands.worst_violation(vehicle, demand, limits):
            failed[factor] = why
            return False
        motions[factor] = reference, demand
        return True

    if keeps(1.0) and _rests(motions[1.0][0]):
        return TimedMotion(scenario, motions[1.0][0], _NOTHING)
    ratio = 1.0 / _RATIO if motions else _RATIO
    factors = ratio ** np.arange(1, _MOST)
    factors = np.append(1.0, factors[factors * scenario.duration <= MAX_DURATION])
    # Faster until limits are exceeded, or slower until they are kept.
    last = next((f for f in factors[1:] if keeps(f) == (ratio > 1.0)), factors[-1])
    if not motions:
        raise UsageError(
            f"timing: {vehicle.name} does not keep its limits, even if all of {scenario.name!r} "
            f"takes {last:.3g} times as long: {failed[max(failed)]}; widen the limits, or give a "
            "gentler motion"
        )
    fast, slow = sorted((last, last / ratio))
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(fast * slow))
        fast, slow = (fast, middle) if keeps(middle) else (middle, slow)
    factor = min(motions)
    reference, demand = motions[factor]
    # What stops the slowest of the motions that fail.
    bound = f"; any faster, {failed[max(failed)]}" if failed else ""
    return TimedMotion(
        slow_motion(scenario, factor),
        reference,
        f"{reference.end:.4g} s instead of {scenario.duration:.4g} s: the whole motion is "
        f"stretched by {factor:.3g}, because the attitude of {vehicle.name} depends on the "
        f"timing{bound}",
        demands.binding(vehicle, demand, limits),
    )
