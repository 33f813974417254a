"""Parameters of autopilots for a robot: an airframe file of PX4, or a list for ArduPilot.

Autopilots know a body with rotors, seen from its centre of mass, and servos. Comments name
what of a robot their parameters cannot say.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot import posture
from gibbs_codegen.robot.autopilot_axes import turned_over
from gibbs_codegen.robot.balance import carried_rotors, hangs
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of, rotor_label
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.robot.parts.rotor import Drive
from gibbs_codegen.robot.placement import mounted_rotors
from gibbs_codegen.robot.rotations import Array

_MOST_ROTORS = 12
_MOST_TILTS = 4
_MOST_SET = 6
# PX4's value for a rotor whose thrust is not known.
_USUAL_CT = 6.5
_USUAL_OUTPUTS = 8
_LEVEL = 1e-6


@dataclass(frozen=True)
class _Tilt:
    """A joint that tilts rotors, towards a bearing, degrees from x towards y."""

    joint: int
    rotors: tuple[int, ...]
    towards: float


class _Vehicle:
    """A robot as an autopilot sees it: `positions` and `axes` (N, 3) from the centre of mass, FRD.

    `thrusts` are the greatest, N, None where they are not known; `drags` are in m. It tilts rotors
    by `most_tilts` joints at most.
    """

    def __init__(self, robot: Robot, most_tilts: int = 0) -> None:
        if not 0 < robot.rotors <= _MOST_ROTORS:
            raise UsageError(
                f"{robot.name} has {robot.rotors} rotors; autopilots take 1 to {_MOST_ROTORS}"
            )
        self.robot, self.words = robot, list[str]()
        frames = posture.frames_at_origin(robot)
        hanging = hangs(robot)
        whole = posture.base_properties(robot) if hanging else posture.whole_properties(robot)
        self.positions = turned_over(frames.motors - np.array(whole.com))
        self.axes = turned_over(frames.thrusts)
        self.drags = [rotor.drag for rotor in mounted_rotors(robot)]
        limits = [drive.thrust_limits for drive in robot.drives]
        self.thrusts = [bounds[1] if bounds else None for bounds in limits]
        tilting = list(self._tilts(frames))
        self.tilts = tilting[:most_tilts]
        if most_tilts and (lost := tilting[most_tilts:]):
            names = ", ".join(coordinate_of(robot, tilt.joint) for tilt in lost)
            self.words.append(f"tilts by {most_tilts} joints at most; not by: {names}")
        tilted = {rotor for tilt in self.tilts for rotor in tilt.rotors}
        if moved := [k for k in carried_rotors(robot) if k not in tilted]:
            self._tell("fixed here, with joints at zero", moved)
        if unknown := [k for k, most in enumerate(self.thrusts, start=1) if not most]:
            self._tell("no greatest thrust known", unknown)
        if robot.links:
            where = "with the arm beneath the base" if hanging else "with joints at zero"
            self.words.append(f"the centre of mass is taken {where}; the arm's motion moves it")
        up = -self.axes[:, 2]
        if np.any(up < 1.0 - _LEVEL):
            self.words.append(
                "multicopter modes of autopilots push along the base's normal only; thrusts to the "
                "side need setpoints from outside"
            )
        lifts = [most * z for most, z in zip(self.thrusts, up, strict=True) if most]
        full = sum(lifts) if len(lifts) == robot.rotors else 0.0
        self.hover = robot.gravity * robot.total_mass / full if full > 0.0 else None
        # Share of the thrust by the square of the output, None where that is not known.
        factors = [_square_share(drive) for drive in robot.drives]
        squares = [factor for factor in factors if factor is not None]
        self.thrust_model = sum(squares) / len(squares) if len(squares) == len(factors) else None
        if self.thrust_model is None:
            self.words.append(
                "the thrust curve is not known; the autopilot's setting stays as it is"
            )
        elif max(squares) - min(squares) > _LEVEL:
            self.words.append("the thrust curves of the rotors differ; their mean is used")
        if self.hover is not None and self.hover > 0.8:
            self.words.append(
                f"hovers at {self.hover:.0%} of its greatest thrust, which leaves little margin"
            )

    def tell_outputs(self, needed: int, place: str) -> None:
        """Say that a robot needs more outputs than many boards have at a place."""
        if needed > _USUAL_OUTPUTS:
            self.words.append(f"needs {needed} outputs; many boards have {_USUAL_OUTPUTS} {place}")

    def _tell(self, words: str, rotors: list[int]) -> None:
        names = ", ".join(rotor_label(self.robot, k) for k in rotors)
        self.words.append(f"{words}: rotor{'s' * (len(rotors) > 1)} {names}")

    def _tilts(self, frames: posture.RobotFrames) -> Iterator[_Tilt]:
        """Joints on the base that tilt rotors, which push upwards at zero, about a level axis."""
        robot = self.robot
        for i in robot.moving:
            link, limits = robot.links[i - 1], robot.links[i - 1].limits
            carried = tuple(k for k, r in enumerate(robot.thrusters, start=1) if r.on == i)
            axis = turned_over(frames.links[i - 1].axes @ np.array(link.axis))
            upright = all(self.axes[k - 1][2] < -1.0 + _LEVEL for k in carried)
            bounded = None not in (limits.low, limits.high)
            tilts = link.joint == "revolute" and robot.parents[i - 1] == BASE and bounded
            if carried and tilts and upright and abs(axis[2]) < _LEVEL:
                towards = math.degrees(math.atan2(axis[0], -axis[1])) % 360.0
                yield _Tilt(i, carried, towards)


def _square_share(drive: Drive) -> float | None:
    """The part of the thrust by the square of the output, which is 0 to 1 over the commands."""
    if drive.command == "thrust" or drive.limits is None:
        return None
    low, high = drive.limits
    span, (_, slope, square) = high - low, drive.curve
    first, second = span * (slope + 2.0 * square * low), span * span * square
    return min(max(second / (first + second), 0.0), 1.0)


def px4_text(robot: Robot) -> tuple[str, list[str]]:
    """An airframe file of PX4, and lines on what it cannot say.

    Raises `UsageError` if the robot has no rotors, or too many.
    """
    seen = _Vehicle(robot, _MOST_TILTS)
    tilts = seen.tilts
    values: dict[str, float] = {"CA_AIRFRAME": 8 if tilts else 0, "CA_ROTOR_COUNT": robot.rotors}
    for k, (place, axis) in enumerate(zip(seen.positions, seen.axes, strict=True)):
        values |= _letters(f"CA_ROTOR{k}_P", place) | _letters(f"CA_ROTOR{k}_A", axis)
        values[f"CA_ROTOR{k}_CT"] = seen.thrusts[k] or _USUAL_CT
        values[f"CA_ROTOR{k}_KM"] = -seen.drags[k] + 0.0
        for number, tilt in enumerate(tilts, start=1):
            if k + 1 in tilt.rotors:
                values[f"CA_ROTOR{k}_TILT"] = number
    if tilts:
        values["CA_SV_TL_COUNT"] = len(tilts)
    for number, tilt in enumerate(tilts):
        limits, towards = robot.links[tilt.joint - 1].limits, round(tilt.towards) % 360
        values[f"CA_SV_TL{number}_MINA"] = math.degrees(limits.low or 0.0)
        values[f"CA_SV_TL{number}_MAXA"] = math.degrees(limits.high or 0.0)
        values[f"CA_SV_TL{number}_TD"] = towards
        if abs(tilt.towards - towards) % 360 > 0.01:
            name = coordinate_of(robot, tilt.joint)
            seen.words.append(f"joint {name} tilts towards {tilt.towards:.4g} deg, {towards} here")
    outputs = {f"motor {rotor_label(robot, k + 1)}": 101 + k for k in range(robot.rotors)}
    outputs |= {f"tilt {coordinate_of(robot, t.joint)}": 201 + n for n, t in enumerate(tilts)}
    arm = [i for i in robot.moving if i not in {tilt.joint for tilt in tilts}]
    outputs |= {f"joint {coordinate_of(robot, i)}": 301 + n for n, i in enumerate(arm[:_MOST_SET])}
    if lost := [coordinate_of(robot, i) for i in arm[_MOST_SET:]]:
        seen.words.append(f"PX4 sets {_MOST_SET} actuators; without an output: {', '.join(lost)}")
    seen.tell_outputs(len(outputs), "on PWM_MAIN, and more on PWM_AUX")
    if (factor := seen.thrust_model) is not None:
        values["THR_MDL_FAC"] = factor
    if seen.hover is not None:
        values["MPC_THR_HOVER"] = seen.hover
    lines = [f"param set-default {name} {value:.9g}" for name, value in values.items()]
    for channel, (output, function) in enumerate(outputs.items(), start=1):
        lines += ["", *_wrapped(f"{output}{_travel(robot, output)}")]
        lines.append(f"param set-default PWM_MAIN_FUNC{channel} {function}")
    places = ": axes are FRD, and positions are from the centre of mass"
    head = ["#!/bin/sh", "#", f"# @name {robot.name}", "#", "# @type Multirotor"]
    head += ["# @class Copter", "#", *_comment(seen, places), ""]
    head += [". ${R}etc/init.d/rc.mc_defaults", ""]
    return "\n".join([*head, *lines, ""]), _report(seen)


def _letters(name: str, vector: Array) -> dict[str, float]:
    return {f"{name}{letter}": value for letter, value in zip("XYZ", vector.tolist(), strict=True)}


def _wrapped(words: str) -> list[str]:
    """Lines of a comment, as long as shells of autopilots take."""
    return [f"# {line}" for line in textwrap.wrap(words, 96)]


def _comment(seen: _Vehicle, words: str) -> list[str]:
    lines = [f"{seen.robot.name}, by gibbs-codegen export{words}.", *seen.words]
    return [part for line in lines for part in _wrapped(line)]


def _report(seen: _Vehicle) -> list[str]:
    battery = ["left out: the battery"] if seen.robot.battery else []
    return [*battery, *(f"mind: {words}" for words in seen.words)]


def _travel(robot: Robot, output: str) -> str:
    """For a joint, what outputs of −1 and 1 are, where it has limits."""
    limits = {f"joint {coordinate_of(robot, i)}": robot.links[i - 1] for i in robot.moving}
    link = limits.get(output)
    if link is None or link.limits.low is None or link.limits.high is None:
        return ""
    unit = "rad" if link.joint == "revolute" else "m"
    return f", -1 to 1 is {link.limits.low:.6g} to {link.limits.high:.6g} {unit}"


# ArduPilot's frames by class and type: the bearing of each motor, degrees clockwise from the front,
# and + for those that turn counter-clockwise.
_CORNERS = (45, -135, -45, 135)
_CROSS = (90, -90, 0, 180)
_STAR = (0, 180, 45, 135, -45, -135, -90, 90)
_PAIRS = (0, -90, 180, 90, -90, 0, 90, 180)
_FRAMES: Mapping[tuple[int, int], tuple[tuple[float, ...], str]] = {
    (1, 0): (_CROSS, "++--"),
    (1, 1): (_CORNERS, "++--"),
    (1, 3): (_CORNERS, "--++"),
    (2, 0): ((0, 180, -120, 60, -60, 120), "-+-++-"),
    (2, 1): ((90, -90, -30, 150, 30, -150), "-+-++-"),
    (3, 0): (_STAR, "--++++--"),
    (3, 1): ((22.5, -157.5, 67.5, 157.5, -22.5, -112.5, -67.5, 112.5), "--++++--"),
    (4, 0): (_PAIRS, "+-+-+-+-"),
    (4, 1): (tuple(45.0 + bearing for bearing in _PAIRS), "+-+-+-+-"),
    (4, 3): (tuple(45.0 + bearing for bearing in _PAIRS), "-+-+-+-+"),
}
_NEAR_DEG = 5.0


def ardupilot_text(robot: Robot) -> tuple[str, list[str]]:
    """Parameters of ArduPilot, and lines on what they cannot express; raises as for PX4."""
    seen = _Vehicle(robot)
    values: dict[str, float] = {}
    frame = _frame(seen)
    if frame is None:
        seen.words.append(
            "ArduPilot has no frame with these rotors; define one in a script (FRAME_CLASS 15 "
            "or 16)"
        )
    else:
        (values["FRAME_CLASS"], values["FRAME_TYPE"]), motors = frame
        values |= {f"SERVO{k}_FUNCTION": 32 + motor for k, motor in enumerate(motors, start=1)}
        seen.words.append("ArduPilot assumes equal rotors at equal distances from the centre")
    channels = {i: robot.rotors + n for n, i in enumerate(robot.moving, start=1)}
    values |= {f"SERVO{channel}_FUNCTION": 0 for channel in channels.values()}
    seen.tell_outputs(robot.rotors + len(channels), "MAIN OUT, and more on AUX OUT")
    if (factor := seen.thrust_model) is not None:
        values["MOT_THST_EXPO"] = factor
    if seen.hover is not None:
        values["MOT_THST_HOVER"] = seen.hover
    if battery := robot.battery:
        values["MOT_BAT_VOLT_MIN"], values["MOT_BAT_VOLT_MAX"] = (
            battery.voltages[0],
            battery.voltages[-1],
        )
        values["BATT_CAPACITY"] = round(1000.0 * battery.capacity)
    lines = [f"{name},{value:.9g}" for name, value in values.items()]
    joints = [
        line
        for i, channel in channels.items()
        for line in _wrapped(f"SERVO{channel}, by MAV_CMD_DO_SET_SERVO: {coordinate_of(robot, i)}")
    ]
    report = [f"mind: {words}" for words in seen.words]
    return "\n".join([*_comment(seen, ""), *joints, *lines, ""]), report


def _frame(seen: _Vehicle) -> tuple[tuple[int, int], list[int]] | None:
    """The class and type of ArduPilot's frame that the rotors make, and the number of each."""
    if np.any(seen.axes[:, 2] > -1.0 + _LEVEL) or not all(seen.drags):
        return None
    around = seen.positions - seen.positions.mean(axis=0)
    bearings = np.degrees(np.arctan2(around[:, 1], around[:, 0]))
    spins = ["+" if drag < 0.0 else "-" for drag in seen.drags]
    for frame, (wanted, turning) in _FRAMES.items():
        motors = []
        for bearing, spin in zip(bearings, spins, strict=True):
            off = [abs((bearing - other + 180.0) % 360.0 - 180.0) for other in wanted]
            motors += [
                number
                for number, (angle, its) in enumerate(zip(off, turning, strict=True), start=1)
                if angle < _NEAR_DEG and its == spin
            ]
        if len(wanted) == len(spins) and sorted(motors) == [*range(1, len(spins) + 1)]:
            return frame, motors
    return None
