"""How the base is balanced, in plain numbers: its mass, where it is, and the thrusts of hovering.

All of it is in the base's frame: arm 1's axes, from the base centre O₂.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.robot.model import Robot, as_rigid_body
from gibbs_codegen.robot.rigid_body import inertia_matrix
from gibbs_codegen.robot.thrusters import arm_frame, wrench_matrix

# Of the arms' length. Nobody puts a battery more exactly; a misplaced arm is off by more.
_LOPSIDED = 0.01
_ROUNDING = 1e-12
# Of more rotors the least and the largest thrust are told.
_MOST_LISTED = 12

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Balance:
    """Mass (kg), centre of mass (m) and inertia about it (kg m²) of all base arms together.

    `inertia` holds xx, yy, zz, xy, xz, yz (xy = −∫ xy dm), `offset` is the distance of the centre
    of mass from the base's axis in m. `hover` holds the thrusts in N of least norm that carry the
    robot's weight with the base level and at rest, the arm's centre of mass beneath the base
    centre; it is None where no thrusts do.
    """

    mass: float
    com: tuple[float, ...]
    inertia: tuple[float, ...]
    offset: float
    hover: tuple[float, ...] | None


def balance(robot: Robot) -> Balance:
    """Balance of the base of a robot.

    Args:
        robot: The robot.

    Returns:
        The balance, in the base's frame.
    """
    mass, moment, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for k in range(1, robot.rotors + 1):
        body, (turn, origin) = as_rigid_body(robot.base.arm(k)), arm_frame(robot.base, k)
        place = origin + turn @ np.array(body.com)
        mass += body.mass
        moment += body.mass * place
        second += turn @ inertia_matrix(body.inertia) @ turn.T + body.mass * _about_origin(place)
    com: Array = moment / mass if mass else moment
    inertia = second - mass * _about_origin(com)
    lengths = [robot.base.arm(k).length for k in range(1, robot.rotors + 1)]
    com = _rounded(com, max(*lengths, float(np.abs(com).max())))
    inertia = _rounded(inertia, float(np.abs(second).max()))
    entries = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    hover = _hover(robot, mass * com)
    return Balance(
        mass,
        tuple(map(float, com)),
        tuple(map(float, entries)),
        float(np.hypot(com[0], com[1])),
        None if hover is None else tuple(map(float, hover)),
    )


def _hover(robot: Robot, moment: Array) -> Array | None:
    """Thrusts of least norm that carry the weight, the base's first moment of mass being given."""
    x, y, _ = moment
    needed = robot.gravity * np.array([0.0, 0.0, robot.total_mass, y, -x, 0.0])
    matrix = wrench_matrix(robot)
    thrusts = np.linalg.lstsq(matrix, needed, rcond=1e-9)[0]
    size = float(np.abs(needed).max())
    if np.abs(matrix @ thrusts - needed).max() > 1e-9 * size:
        return None
    return _rounded(thrusts, size)


def balance_lines(found: Balance) -> list[str]:
    """Mass, centre of mass, inertia and hover thrusts in words.

    Args:
        found: Balance of a base.

    Returns:
        A line each for mass with its centre, inertia, and thrusts.
    """
    x, y, z = map(_number, found.com)
    pairs = zip(("xx", "yy", "zz", "xy", "xz", "yz"), found.inertia, strict=True)
    how = "of least norm, level, the arm's centre of mass beneath the base centre"
    hover = f"none carry the weight ({how})"
    if found.hover is not None and len(found.hover) > _MOST_LISTED:
        hover = f"{_number(min(found.hover))} to {_number(max(found.hover))} N, {how}"
    elif found.hover is not None:
        hover = f"{', '.join(map(_number, found.hover))} N, {how}"
    return [
        f"base: {_number(found.mass)} kg, centre of mass {x}, {y}, {z} m from the base centre in "
        "arm 1's axes",
        f"inertia about it: {', '.join(f'{a} {_number(v)}' for a, v in pairs)} kg m²",
        f"hover thrusts: {hover}",
    ]


def lopsided(robot: Robot, found: Balance) -> str | None:
    """What is wrong with a base whose centre of mass is off its axis, and a remedy.

    Args:
        robot: The robot.
        found: Balance of its base.

    Returns:
        The warning, or None for a base that is balanced.
    """
    base = robot.base
    longest = max(base.arm(k).length for k in range(1, robot.rotors + 1))
    if found.offset <= _LOPSIDED * longest or longest == 0.0:
        return None
    x, y, _ = found.com
    what = (
        f"the base is lopsided: its centre of mass is {found.offset:.3g} m off its axis, "
        f"{found.offset / longest:.2g} of the arms' length, at x = {x:.3g}, y = {y:.3g} m from the "
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


def _number(value: float) -> str:
    return f"{value:.4g}"


def _about_origin(place: Array) -> Array:
    """Inertia of a unit of mass at a place about the origin."""
    matrix: Array = place @ place * np.eye(3) - np.outer(place, place)
    return matrix


def _rounded(values: NDArray[np.floating[Any]], size: float) -> Array:
    """The values with what is rounding set to zero."""
    rounded: Array = np.where(np.abs(values) <= _ROUNDING * size, 0.0, values)
    return rounded
