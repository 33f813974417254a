"""The balance of a robot, and numbers of it that are probably in another unit.

Wrenches of its rotors, its base and the thrusts of hovering, and lines of text about them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gibbs_codegen.robot import posture
from gibbs_codegen.robot.layout import frames_of, joint_terms, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of, link_label, rotor_label
from gibbs_codegen.robot.parts.base import FIXED
from gibbs_codegen.robot.parts.battery import Battery
from gibbs_codegen.robot.parts.body import Body, as_rigid_body, body_fault, inertia_matrix
from gibbs_codegen.robot.parts.numbers import AXIS_PAIRS, BASE
from gibbs_codegen.robot.parts.spring import SHORTEST
from gibbs_codegen.robot.placement import mounted_rotors
from gibbs_codegen.robot.rotations import Array
from gibbs_codegen.robot.wrenches import directions, farthest, null_space, rank

# Fewer times better is a matter of taste.
_FAR_BETTER = 3.0
# Configurations that are tried where the arrangement depends on the joints, and how far joints
# without limits move in them, rad or m.
_TRIED, _TRAVEL = 20, 1.0


@dataclass(frozen=True)
class Arrangement:
    """Rank, condition number (infinite where the rank is below 6) and what cannot be commanded.

    `missing` names the directions that no combination of thrusts can push in, about the base centre
    in the base's axes.
    """

    rank: int
    condition: float
    missing: tuple[str, ...]


def wrench_matrix(robot: Robot, joints: Sequence[float] | Array | None = None) -> Array:
    """Force, then moment (6, N), m, of each unit thrust about the base centre, in the base's axes.

    `joints` are those that move, rad or m, zero if None.
    """
    frames = posture.frames_at_origin(robot, joints)
    drags = np.array([*robot.base.drag, *(rotor.drag for rotor in robot.thrusters)])
    moments = np.cross(frames.motors, frames.thrusts) + drags[:, np.newaxis] * frames.thrusts
    return np.concatenate([frames.thrusts, moments], axis=1).T


def wheel_wrenches(robot: Robot) -> Array:
    """Force, then moment (6, w) of a torque of 1 N m of each wheel, of robots that roll, the same.

    They are in the axes of the base; wheels without effort have none.
    """
    columns = np.zeros((6, len(robot.wheels)))
    for column, link in zip(columns.T, (robot.links[i - 1] for i in robot.wheels), strict=True):
        pose, roll = link.pose, link.rolling
        if pose is not None and roll is not None and link.limits.effort != 0.0:
            ahead = pose.matrix[:, 0]
            column[:] = np.append(ahead, np.cross(pose.xyz, ahead)) / roll.radius
    return columns


def arrangement(robot: Robot, joints: Sequence[float] | Array | None = None) -> Arrangement:
    """Rank and conditioning of the rotors' arrangement, in N and N m about the base centre.

    `joints` are those that move, rad or m, zero if None.
    """
    matrix = wrench_matrix(robot, joints)
    left, values, _ = np.linalg.svd(matrix)
    reached = rank(matrix)
    condition = float(values[0] / values[-1]) if reached == len(left) else float("inf")
    return Arrangement(reached, condition, directions(left[:, reached:]))


def carried_rotors(robot: Robot) -> tuple[int, ...]:
    """Numbers, from 1, of rotors that a joint moves against the base."""
    moved = {BASE: False}
    for i, link in enumerate(robot.links, start=1):
        moved[i] = link.moves or moved[robot.parents[i - 1]]
    return tuple(k for k, rotor in enumerate(robot.thrusters, start=1) if moved[rotor.on])


def ranks_in_motion(robot: Robot) -> tuple[int, int] | None:
    """Least and greatest rank of the arrangement as the joints move, within their limits.

    They are over some configurations that are always the same; None where no joint moves a rotor.
    """
    if not carried_rotors(robot):
        return None
    ranks = [arrangement(robot, joints).rank for joints in tried_postures(robot)]
    return min(ranks), max(ranks)


def tried_postures(robot: Robot) -> Array:
    """Coordinates (k, n), rad or m, of joints that move, within their limits: always the same."""
    limits = [robot.links[i - 1].limits for i in robot.moving]
    low = [-_TRAVEL if bounds.low is None else bounds.low for bounds in limits]
    high = [_TRAVEL if bounds.high is None else bounds.high for bounds in limits]
    shares = np.random.default_rng(0).random((_TRIED, len(limits)))
    return low + shares * (np.array(high) - np.array(low))


@dataclass(frozen=True)
class TiltHint:
    """Motors 1 … N whose tilts had better have the other sign, and the condition number then."""

    motors: tuple[int, ...]
    condition: float

    def text(self) -> str:
        """The hint in words."""
        which = f"motor {self.motors[0]}" if len(self.motors) == 1 else "motors "
        if len(self.motors) > 1:
            which += f"{', '.join(map(str, self.motors[:-1]))} and {self.motors[-1]}"
        return (
            f"if the thrust of {which} tilted to the other side (opposite signs of x and y), the "
            f"condition number would be {self.condition:.4g}; arm 1's x axis points to the base "
            "centre, those of the others away from it"
        )


def tilt_hint(robot: Robot) -> TiltHint | None:
    """Signs of the tilts that condition the arrangement far better, if there are such.

    Tried are those with which alternating tilts go wrong: arm 1's axes point the other way round,
    and the arms may have to alternate. That is so by the paper's rule for rods only.
    """
    if not robot.base.rotors or robot.base.azimuth_deg is not None:
        return None
    now = arrangement(robot)
    every_second = set(range(2, robot.rotors + 1, 2))
    hints = []
    for motors in ({1}, every_second, every_second ^ {1}):
        thrust = tuple(
            (-x, -y, z) if k in motors else (x, y, z)
            for k, (x, y, z) in enumerate(robot.base.thrust, start=1)
        )
        mirrored = replace(robot, base=replace(robot.base, thrust=thrust))
        condition = arrangement(mirrored).condition
        hints.append(TiltHint(tuple(sorted(motors)), condition))
    best = min(hints, key=lambda hint: hint.condition)
    return best if best.condition * _FAR_BETTER < now.condition else None


@dataclass(frozen=True)
class HoverThrusts:
    """Thrusts in N of least norm that carry the robot, level and at rest; None where none do.

    Where none do although some carry the weight, `moment` (N m, about the base centre, in the
    base's axes) is what these leave at least, and `lifting` are those that leave it. `margin` is
    how many times its weight the robot may have before a rotor meets its limits, None where they
    are not all given or do not let it hover at any weight, or where it was not asked for. `beyond`
    are the numbers of the rotors whose limits the thrusts of least norm break.
    """

    thrusts: tuple[float, ...] | None
    margin: float | None
    beyond: tuple[int, ...]
    moment: tuple[float, ...] | None = None
    lifting: tuple[float, ...] | None = None


def hangs(robot: Robot) -> bool:
    """True if hovering is taken with the arm's centre of mass beneath the base centre.

    So it is for the paper's form of file, whose joints at zero stretch the arm out sideways.
    Otherwise all joints are at zero.
    """
    return bool(robot.base.rotors)


def hover(robot: Robot, margin: bool = True) -> HoverThrusts:
    """Hovering of a robot, with its margin."""
    body = posture.base_properties(robot) if hangs(robot) else posture.whole_properties(robot)
    x, y, _ = body.mass * np.array(body.com)
    # The wrench about the base centre that holds the robot, level, in the base's axes.
    needed = robot.gravity * np.array([0.0, 0.0, robot.total_mass, y, -x, 0.0])
    matrix = wrench_matrix(robot)
    size = float(np.abs(needed).max())
    if not robot.rotors:
        return HoverThrusts(None, None, ())
    thrusts = np.linalg.lstsq(matrix, needed, rcond=1e-9)[0]
    if np.abs(matrix @ thrusts - needed).max() > 1e-9 * size:
        # The least moment that thrusts leave which carry the weight.
        forces, moments = matrix[:3], matrix[3:]
        idle = null_space(forces)
        thrusts = np.linalg.lstsq(forces, needed[:3], rcond=1e-9)[0]
        if np.abs(forces @ thrusts - needed[:3]).max() > 1e-9 * size:
            return HoverThrusts(None, None, ())
        left = needed[3:] - moments @ thrusts
        turning = idle @ np.linalg.lstsq(moments @ idle, left, rcond=1e-9)[0]
        pair = left - moments @ turning, thrusts + turning
        rounded = (tuple(map(float, posture.rounded(x, size))) for x in pair)
        return HoverThrusts(None, None, (), *rounded)
    hovering = tuple(map(float, posture.rounded(thrusts, size)))
    limits = [drive.thrust_limits for drive in robot.drives]
    beyond = [
        k
        for k, (thrust, bounds) in enumerate(zip(hovering, limits, strict=True), start=1)
        if bounds and not bounds[0] <= thrust <= bounds[1]
    ]
    bounded = [bounds for bounds in limits if bounds]
    times = None
    if margin and size and len(bounded) == robot.rotors:
        ways = np.column_stack([thrusts, null_space(matrix)])
        most = farthest(ways, np.transpose(bounded), np.eye(ways.shape[1])[0])
        times = None if most is None or most[0] < 0.0 else float(most[0])
    return HoverThrusts(hovering, times, tuple(beyond))


@dataclass(frozen=True)
class Endurance:
    """Hovering on a battery: `voltage`, V, and `current`, A, when it is full.

    For `time`, s, it hovers, until its charge is `charge`, with `until` for what ends it.
    """

    voltage: float
    current: float
    time: float
    charge: float
    until: str


@dataclass(frozen=True)
class HoverCommands:
    """Commands of rotors that hover, with a full battery where there is one.

    `left` is how far the throttle nearest to its greatest one is from it, None without throttles.
    `battery` is None where there is none, or nothing takes power from it.
    """

    commands: tuple[float, ...]
    left: float | None
    battery: Endurance | None


def hover_commands(robot: Robot, thrusts: Sequence[float]) -> HoverCommands:
    """Commands for thrusts, N, that hover, and what they do to the battery."""
    drives, battery = robot.drives, robot.battery
    levels = [drive.level(thrust) for drive, thrust in zip(drives, thrusts, strict=True)]
    most = {k: (d.limits or (0.0, 1.0))[1] for k, d in enumerate(drives) if d.command == "throttle"}
    # A throttle gives what the battery's voltage allows, of what it gives at the nominal one.
    power = _power(robot, thrusts, levels)
    endurance = _endurance(battery, power, levels, most) if battery and power else None
    raised = battery.nominal / endurance.voltage if battery and endurance else 1.0
    commands = [level * raised if k in most else level for k, level in enumerate(levels)]
    left = min((end - commands[k] for k, end in most.items()), default=None)
    return HoverCommands(tuple(commands), left, endurance)


def _power(robot: Robot, thrusts: Sequence[float], levels: Sequence[float]) -> float:
    """The power, W, that rotors take from the battery, with all else; 0 without one."""
    rotors, battery = sum(_shaft_powers(robot, thrusts, levels)), robot.battery
    return rotors / battery.efficiency + battery.auxiliary if battery else 0.0


def _shaft_powers(
    robot: Robot, thrusts: Sequence[float], levels: Sequence[float]
) -> Iterator[float]:
    """Power, W, that turns each rotor, 0 where its drag or its speed is not known."""
    for rotor, drive, thrust, level in zip(
        mounted_rotors(robot), robot.drives, thrusts, levels, strict=True
    ):
        speed = drive.speed(level)
        if drive.command == "thrust":
            speed = (rotor.speed_per_sqrt_thrust or 0.0) * math.sqrt(abs(thrust))
        yield abs(rotor.drag * thrust * speed)


# Steps of the charge in which the time of hovering is summed up.
_STEPS = 4096


def _endurance(
    battery: Battery, power: float, levels: Sequence[float], most: Mapping[int, float]
) -> Endurance:
    """Hovering on a battery at a power, W; `most` has the greatest throttles, by places."""
    lost = battery.resistance * power
    loads = (levels[k] * battery.nominal / end if end else math.inf for k, end in most.items())
    loaded = max(loads, default=0.0)
    # Voltages with and without load at which it ends; with less than √(R P) there is no such power.
    least = max(loaded, math.sqrt(lost))
    needed = least + (lost / least if least else 0.0)
    voltages, steps = battery.voltages, len(battery.voltages) - 1
    end, until = 0.0, "it is empty"
    if below := [k for k, voltage in enumerate(voltages) if voltage < needed]:
        k = below[-1]
        share = (needed - voltages[k]) / (voltages[k + 1] - voltages[k]) if k < steps else 0.0
        end = (k + share) / steps
        until = "the throttle" if loaded >= least else "its power"
        until += " no longer suffices"

    def voltage(charge: Array) -> Array:
        """The voltage with load, V."""
        free = np.interp(charge, np.linspace(0.0, 1.0, steps + 1), voltages)
        return (free + np.sqrt(np.maximum(free * free - 4.0 * lost, 0.0))) / 2.0

    charges = end + (1.0 - end) * (np.arange(_STEPS) + 0.5) / _STEPS
    full = float(voltage(np.array(1.0)))
    time = 3600.0 * battery.capacity * (1.0 - end) * float(voltage(charges).mean()) / power
    return Endurance(full, power / full, time, end, until)


def holding_efforts(robot: Robot, thrusts: Sequence[float]) -> list[float]:
    """Torques (N m), forces (N) that hold joints at zero, the base level, under thrusts (N)."""
    frames = posture.frames_at_origin(robot)
    links, carriers = frames.links, {frame.name: frame.on for frame in frames_of(robot)}
    loads = np.zeros((len(robot.links) + 1, 6))  # On each body, about the base centre.
    for rotor, unit, thrust in zip(
        mounted_rotors(robot), wrench_matrix(robot).T, thrusts, strict=True
    ):
        loads[rotor.on] += thrust * unit
    for spring in robot.springs:
        end, other = (frames.named[name].origin for name in (spring.frame, spring.to))
        distance = np.hypot(np.linalg.norm(end - other), SHORTEST)
        pull = spring.stiffness * (1.0 - spring.length / distance) * (other - end)
        wrench = np.concatenate([pull, np.cross(end, pull)])
        loads[carriers[spring.frame]] += wrench
        loads[carriers[spring.to]] -= wrench
    for i in range(len(robot.links), 0, -1):
        body = as_rigid_body(robot.links[i - 1].body)
        weight = np.array([0.0, 0.0, -robot.gravity * body.mass])
        loads[i] += *weight, *np.cross(links[i - 1].place(body.com), weight)
        loads[robot.parents[i - 1]] += loads[i]
    efforts = dict.fromkeys(robot.moving, 0.0)
    for i, gear in robot.gearing.items():
        link, frame, (force, moment) = robot.links[i - 1], links[i - 1], np.split(loads[i], 2)
        turns = link.joint == "revolute"
        along = moment - np.cross(frame.origin, force) if turns else force
        pulled = link.passive.stiffness * (gear.offset - link.passive.rest)
        for mover, ratio in gear.ratios.items():
            efforts[mover] += ratio * float(pulled - along @ frame.axes @ link.axis)
    size = robot.gravity * robot.total_mass
    return list(map(float, posture.rounded(np.array([*efforts.values()]), size)))


# A share of the arms' length. Nobody puts a battery more exactly; a misplaced arm is off by more.
_LOPSIDED = 0.01
# The least and the largest thrust stand for more rotors.
_MOST_LISTED = 12


def balance_lines(robot: Robot) -> list[str]:
    """Mass, centre of mass and inertia of a base that moves, and hover thrusts, in words."""
    if robot.base.motion == FIXED:
        return []
    base = posture.base_properties(robot)
    where = "the origin of the base's frame"
    if robot.base.rotors:
        by_rule = robot.base.azimuth_deg is None
        where = f"the base centre in {'arm 1' if by_rule else 'the base'}'s axes"
    x, y, z = map(number, base.com)
    pairs = zip(AXIS_PAIRS, base.inertia, strict=True)
    return [
        f"base: {number(base.mass)} kg, centre of mass {x}, {y}, {z} m from {where}",
        f"inertia about it: {', '.join(f'{a} {number(v)}' for a, v in pairs)} kg m²",
        *hover_lines(robot, hover(robot, margin=False)),
    ]


def hover_lines(robot: Robot, hovering: HoverThrusts) -> list[str]:
    """Thrusts of hovering in words, what they leave, and limits where there are any.

    There is nothing to tell of a base that does not move freely: something else holds it.
    """
    if not robot.base.moves_freely:
        return []
    if not robot.rotors:
        return ["hover thrusts: the robot has no rotors"]
    where = "level"
    if hangs(robot):
        where += ", the arm's centre of mass beneath the base centre"
    elif robot.moving:
        where += ", joints at zero"
    how = f"of least norm, {where}"
    if hovering.moment is not None and (lifting := hovering.lifting) is not None:
        left = ", ".join(map(number, hovering.moment))
        lines = [
            f"hover thrusts: no thrusts hold it level; a moment of {left} N m remains ({where})"
        ]
        lines.append(f"thrusts that carry the weight: {_values(lifting)} N")
        return lines + _command_lines(robot, hover_commands(robot, lifting))
    if hovering.thrusts is None:
        return [f"hover thrusts: no thrusts carry the weight ({how})"]
    lines = [f"hover thrusts: {_values(hovering.thrusts)} N, {how}"]
    lines += _command_lines(robot, hover_commands(robot, hovering.thrusts))
    if posture.closed_loops(robot):
        lines.append("joint torques that hold it there: see trim, because loops carry part of them")
    elif robot.moving and not hangs(robot):
        efforts = [
            f"{coordinate_of(robot, i)} {number(effort)} {joint_terms(robot, i).effort_unit}"
            for i, effort in zip(
                robot.moving, holding_efforts(robot, hovering.thrusts), strict=True
            )
        ]
        lines.append(f"joint torques that hold it there: {', '.join(efforts)}")
    if hovering.margin is not None and hovering.margin < 1e-9:  # 0 but for rounding.
        lines.append("thrust margin: no thrusts within the limits hover here")
    elif hovering.margin is not None:
        lines.append(f"thrust margin: the limits carry {hovering.margin:.3g} times the weight")
    if hovering.beyond:
        which = ", ".join(rotor_label(robot, k) for k in hovering.beyond)
        lines.append(f"beyond their limits at these thrusts: {which}")
    return lines


def _values(values: Sequence[float]) -> str:
    """Numbers, or the least and the greatest of many."""
    if len(values) > _MOST_LISTED:
        return f"{number(min(values))} to {number(max(values))}"
    return ", ".join(map(number, values))


def _command_lines(robot: Robot, hovering: HoverCommands) -> list[str]:
    """Throttles and speeds of hovering in words, and what the battery makes of it."""
    lines, battery = [], hovering.battery
    throttles = {k: drive for k, drive in enumerate(robot.drives) if drive.command == "throttle"}
    suffices = all(
        low <= hovering.commands[k] <= high
        for k, (low, high) in ((k, drive.limits or (0.0, 1.0)) for k, drive in throttles.items())
    )
    for kind, unit, scale in (("throttle", "%", 100.0), ("speed", "rad/s", 1.0)):
        commanded = [k for k, drive in enumerate(robot.drives) if drive.command == kind]
        line = f"hover {kind}: {_values([scale * hovering.commands[k] for k in commanded])} {unit}"
        if len(commanded) < min(robot.rotors, _MOST_LISTED):
            names = ", ".join(rotor_label(robot, k + 1) for k in commanded)
            line += f" (rotor{'s' * (len(commanded) > 1)} {names})"
        if kind == "throttle" and hovering.left is not None:
            line += ", with a full battery" * (battery is not None)
            left = f"; {number(scale * hovering.left)} % remain"
            line += left if suffices else ", which is beyond the limits"
        lines += [line] * bool(commanded)
    if battery is not None and suffices:
        until = battery.until
        until += f", with {number(100.0 * battery.charge)} % of its charge" * (battery.charge > 0.0)
        lines.append(
            f"battery in hover: {number(battery.voltage)} V and {number(battery.current)} A when "
            f"full; {number(battery.time / 60.0)} min until {until}"
        )
    return lines


def lopsided(robot: Robot) -> str | None:
    """A warning of a base of rods whose centre of mass is off its axis, and a remedy.

    None for a balanced one. A central body, and rods at angles of their own, may be anywhere on
    purpose.
    """
    base = robot.base
    if not base.rotors or base.body or base.azimuth_deg is not None:
        return None
    longest = max(base.arm(k).length for k in range(1, robot.rotors + 1))
    x, y, _ = posture.base_properties(robot).com
    offset = float(np.hypot(x, y))
    if offset <= _LOPSIDED * longest or longest == 0.0:
        return None
    opening = (
        f"the base is lopsided: its centre of mass is {offset:.3g} m off its axis, "
        f"{offset / longest:.2g} of the arms' length; it is at x = {x:.3g}, y = {y:.3g} m from "
        "the base centre in arm 1's axes; "
    )
    if not base.shares_one_arm:
        return opening + (
            "check com in each table of base.arm: it is measured from the motor on arm 1, whose "
            "x axis points to the base centre, and from the centre on the others"
        )
    arm = as_rigid_body(base.arm(1))
    x, y, z = arm.com
    first = [f"{v + 0.0:.9g}" for v in (arm.length - x, -y, z)]
    text = (
        "base.arm is one table for all arms, but its com is measured from the motor on arm 1 "
        "and from the base centre on the others; if all arms are alike, give base.arm as a list "
        f"of {robot.rotors} tables, the first with com = [{', '.join(first)}]"
    )
    if arm.inertia[4] or arm.inertia[5]:
        text += " and with the last two entries of inertia of opposite sign"
    return opening + text


def number(value: float) -> str:
    """A number as reports have it, in four digits."""
    return f"{value:.4g}"


# Robots are slender: none fills the cube around it with water, kg/m³.
_WATER = 1000.0
# Robots have substance: film to wrap food in weighs twice as much, kg/m². An arm of 64 rods of 3 m
# and 1 kg/m weighs more, too, and all robots are a million times lighter in millimetres.
_FILM = 0.004
# Radius of gyration of a body, of the extent of the whole robot.
_LARGEST_GYRATION = 3.0
# Propellers have about 0.01 to 0.03 m.
LARGEST_DRAG = 0.1
# What nobody means who gives throttles.
_MOST_THROTTLE = 2.0
# Speed of small propellers, rad/s; power that racers need for a newton is half as much, W/N; no
# tip outruns its sound, m/s.
_FASTEST, _THIRSTIEST, _SPEED_OF_SOUND = 6000.0, 75.0, 340.0
# Lag of thrusts, s: the slowest that carry robots, those of turbines, take a second.
_SLOWEST = 3.0
# Energy of a battery by the mass of the whole robot, W h/kg: the best cells alone have half.
_FULLEST = 600.0


def implausible(robot: Robot) -> tuple[str, ...]:
    """Warnings of what is probably grams, millimetres or degrees, with what was perhaps meant."""
    frames = posture.frames_at_origin(robot)
    ends: list[Array] = [frames.centre, *frames.motors]
    for link, frame in zip(robot.links, frames.links, strict=True):
        body = as_rigid_body(link.body)
        ends += [frame.origin, frame.place(body.com), frame.point(body.length)]
    # The longest side of a box around the joints, rotors, ends and centres of mass.
    extent = float(np.ptp(np.array(ends), axis=0).max())
    warnings = []
    if extent and robot.total_mass > _WATER * extent**3:
        warnings.append(
            f"the robot weighs {robot.total_mass:.4g} kg at a size of {extent:.3g} m, more than "
            "a cube of water of that size; give masses in kg and lengths in m"
        )
    if robot.total_mass < _FILM * extent**2:
        warnings.append(
            f"the robot is {extent:.4g} m long and weighs {robot.total_mass:.4g} kg; are lengths "
            "in millimetres? (they are in m)"
        )
    for name, solid in named_bodies(robot):
        body = as_rigid_body(solid)
        largest = max(float(np.linalg.eigvalsh(inertia_matrix(body.inertia))[-1]), 0.0)
        gyration = float(np.sqrt(largest / body.mass)) if body.mass else 0.0
        if extent and gyration > _LARGEST_GYRATION * extent:
            warnings.append(
                f"the inertia of {name} has a radius of gyration of {gyration:.3g} m, and the "
                f"whole robot is {extent:.3g} m long; give inertias in kg m²"
            )
    drags = [*robot.base.drag, *(rotor.drag for rotor in robot.thrusters)]
    for k, drag in enumerate(drags, start=1):
        if abs(drag) > LARGEST_DRAG:
            warnings.append(
                f"the drag of rotor {rotor_label(robot, k)} is {drag:.4g} m; it is the reaction "
                "torque per unit of thrust, about 0.02 m for propellers"
            )
    warnings += _implausible_drives(robot)
    for i in robot.moving:
        link = robot.links[i - 1]
        far = [v for v in (link.limits.low, link.limits.high) if v and abs(v) > 2.0 * np.pi]
        if link.joint == "revolute" and far:
            warnings.append(
                f"a limit of {link_label(robot, i)} is {far[0]:.4g} rad, more than a turn; "
                "limits are in rad, limits_deg in degrees"
            )
    turning = [bool(layout_of(robot).own_axes[1])]  # Inertia plays no part where nothing turns.
    for i, (link, parent) in enumerate(zip(robot.links, robot.parents, strict=True), start=1):
        turning.append(turning[parent] or (link.moves and link.joint == "revolute"))
        if link.motor and turning[parent]:
            whole, part = posture.carrier_inertia(robot, i), link.motor.rotor_inertia
            if part > whole:
                warnings.append(
                    f"rotor_inertia of {link_label(robot, i)} is {part:.4g} kg m², more than the "
                    f"{whole:.4g} kg m² of the body with the motor, which includes the rotor; "
                    "give the inertia of the rotor itself, without the square of gear_ratio"
                )
    return tuple(warnings)


def _listed(labels: Sequence[str]) -> str:
    """Labels of rotors, of many the first."""
    return ", ".join(labels[:_MOST_LISTED]) + " and others" * (len(labels) > _MOST_LISTED)


def _implausible_drives(robot: Robot) -> Iterator[str]:
    """Warnings of percent, milliseconds, turns a minute, and of what a battery does not give."""
    wild: dict[str, list[str]] = {}
    for k, (rotor, drive) in enumerate(
        zip(mounted_rotors(robot), robot.drives, strict=True), start=1
    ):
        most = drive.limits[1] if drive.limits else 0.0
        speed = drive.speed(most)
        tip = speed * (rotor.disc_radius or 0.0)
        lag = max(drive.up, drive.down)
        if lag > _SLOWEST:
            words = (
                f"time constant of {{}} is {lag:.4g} s; is it in milliseconds? (these would be "
                f"{lag / 1e3:.4g} s)"
            )
        elif drive.command == "throttle" and most > _MOST_THROTTLE:
            words = f"throttle of {{}} is {most:.4g}, and 1 is full; is it in percent?"
        elif speed > _FASTEST or abs(rotor.drag) * speed > _THIRSTIEST or tip > _SPEED_OF_SOUND:
            words = (
                f"speed of {{}} is {speed:.4g} rad/s; is it in turns a minute? (these would be "
                f"{speed * math.pi / 30:.4g} rad/s)"
            )
        else:
            continue
        wild.setdefault(words, []).append(rotor_label(robot, k))
    for words, labels in wild.items():
        yield "the greatest " + words.format(f"rotor{'s' * (len(labels) > 1)} {_listed(labels)}")
    battery = robot.battery
    if battery is None:
        return
    if battery.capacity * battery.nominal > _FULLEST * robot.total_mass:
        yield (
            f"the capacity of the battery is {battery.capacity:.4g} A h; is it in mA h? (these "
            f"would be {battery.capacity / 1e3:.4g} A h)"
        )
    units = [1.0] * robot.rotors
    powers = enumerate(_shaft_powers(robot, units, units), start=1)
    if idle := [rotor_label(robot, k) for k, power in powers if power == 0.0]:
        yield (
            f"the battery model lacks the drag or the speed of rotors {_listed(idle)}; give "
            "drag, and full_speed of a throttle or speed_per_sqrt_thrust of a thrust"
        )


def named_bodies(robot: Robot) -> list[tuple[str, Body]]:
    """All bodies with what they are called in messages."""
    bodies: list[tuple[str, Body]] = [("the base", robot.base.body)] if robot.base.body else []
    bodies += [(f"base arm {k}", arm) for k, arm in enumerate(robot.base.arms, start=1)]
    return bodies + [
        (link_label(robot, i), link.body) for i, link in enumerate(robot.links, start=1)
    ]


def impossible_inertias(robot: Robot) -> tuple[str, ...]:
    """Warnings of inertias that no body has and that the robot file lets pass, with the body."""
    faults = [(label, body_fault(body)) for label, body in named_bodies(robot)]
    return tuple(f"{label}: its inertia {fault}" for label, fault in faults if fault)
