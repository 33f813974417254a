"""How a robot is balanced, in words: its base, where that is heavy, and the thrusts of hovering."""

from __future__ import annotations

import numpy as np

from gibbs_codegen.robot.hover import Hover, hangs, holding_efforts, hover
from gibbs_codegen.robot.mass_properties import base_properties
from gibbs_codegen.robot.model import Robot, as_rigid_body
from gibbs_codegen.robot.names import coordinate_of, rotor_label

# Of the arms' length. Nobody puts a battery more exactly; a misplaced arm is off by more.
_LOPSIDED = 0.01
# Of more rotors the least and the largest thrust are told.
_MOST_LISTED = 12


def balance_lines(robot: Robot) -> list[str]:
    """Mass, centre of mass and inertia of the base, and hover thrusts, in words."""
    found = base_properties(robot)
    x, y, z = map(number, found.com)
    pairs = zip(("xx", "yy", "zz", "xy", "xz", "yz"), found.inertia, strict=True)
    return [
        f"base: {number(found.mass)} kg, centre of mass {x}, {y}, {z} m from {frame_text(robot)}",
        f"inertia about it: {', '.join(f'{a} {number(v)}' for a, v in pairs)} kg m²",
        *hover_lines(robot, hover(robot, margin=False)),
    ]


def frame_text(robot: Robot) -> str:
    """The frame that masses are told in, such as "the base centre in arm 1's axes"."""
    if not robot.base.rotors:
        return "the origin of the base's frame"
    by_rule = robot.base.azimuth_deg is None
    return f"the base centre in {'arm 1' if by_rule else 'the base'}'s axes"


def hover_lines(robot: Robot, found: Hover) -> list[str]:
    """Thrusts of hovering in words, what they leave, and limits where there are any."""
    if not robot.rotors:
        return ["hover thrusts: the robot has no rotors"]
    where = "level"
    if hangs(robot):
        where += ", the arm's centre of mass beneath the base centre"
    elif robot.moving:
        where += ", joints at zero"
    how = f"of least norm, {where}"
    if found.moment is not None:
        left = ", ".join(map(number, found.moment))
        return [f"hover thrusts: none hold it level: a moment of {left} N m is left ({where})"]
    if found.thrusts is None:
        return [f"hover thrusts: none carry the weight ({how})"]
    values = ", ".join(map(number, found.thrusts))
    if len(found.thrusts) > _MOST_LISTED:
        values = f"{number(min(found.thrusts))} to {number(max(found.thrusts))}"
    lines = [f"hover thrusts: {values} N, {how}"]
    if hangs(robot) and robot.moving:
        lines.append("joint torques with them: none, if the arm hangs there at rest")
    elif robot.moving:
        pairs = zip(robot.moving, holding_efforts(robot, found.thrusts), strict=True)
        told = [f"{coordinate_of(robot, i)} {number(effort)}" for i, effort in pairs]
        lines.append(f"joint torques with them, N m, or forces, N: {', '.join(told)}")
    if found.margin is not None and found.margin < 1e-9:  # 0 but for rounding.
        lines.append("thrust margin: no thrusts within the limits hover here")
    elif found.margin is not None:
        lines.append(f"thrust margin: the limits carry {found.margin:.3g} times the weight")
    if found.beyond:
        which = ", ".join(rotor_label(robot, k) for k in found.beyond)
        lines.append(f"beyond their limits at these thrusts: {which}")
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
    x, y, _ = base_properties(robot).com
    offset = float(np.hypot(x, y))
    if offset <= _LOPSIDED * longest or longest == 0.0:
        return None
    what = (
        f"the base is lopsided: its centre of mass is {offset:.3g} m off its axis, "
        f"{offset / longest:.2g} of the arms' length, at x = {x:.3g}, y = {y:.3g} m from the "
        "base centre in arm 1's axes; "
    )
    if not base.shares_one_arm:
        return what + (
            "see whether com is right in each table of base.arm: it counts from the motor on arm "
            "1, whose x axis runs to the base centre, and from the centre on the others"
        )
    arm = as_rigid_body(base.arm(1))
    x, y, z = arm.com
    first = [f"{v + 0.0:.9g}" for v in (arm.length - x, -y, z)]
    text = (
        "base.arm is one table for all arms, and its com counts from the motor on arm 1, whose x "
        "axis runs to the base centre, and from the centre on the others; if all arms are alike, "
        f"give base.arm as a list of {robot.rotors} tables, the first with "
        f"com = [{', '.join(first)}]"
    )
    if arm.inertia[4] or arm.inertia[5]:
        text += " and with the last two entries of inertia of opposite sign"
    return what + text


def number(value: float) -> str:
    """A number as reports have it, in four digits."""
    return f"{value:.4g}"
