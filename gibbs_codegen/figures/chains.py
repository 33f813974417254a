"""The open chains of a robot side by side, with what acts on them (the paper's Fig. 2).

They are drawn from the robot's data alone, in the style of the figures of flights.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from gibbs_codegen.errors import UsageError
from gibbs_codegen.figures.marks import (
    CONSTRAINT,
    THRUST,
    TORQUE,
    arrow_key,
    draw_force,
    draw_joint,
    draw_link,
    draw_name,
    draw_thrust,
    draw_torque,
)
from gibbs_codegen.figures.style import DARK, FULL, style
from gibbs_codegen.robot.chains import Chain, decompose
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.placement import Array

_QUIET = "0.55"
# Chains that are drawn unless they are chosen, and links of an arm that are drawn one by one.
_MOST_CHAINS, _MOST_LINKS = 12, 4
_COLUMNS = 3
# Heights of a row of chains and of one of the legend, in; the legend's columns by those of chains.
_ROW, _LEGEND_ROW = 1.85, 0.2
_LEGEND_COLUMNS = {1: 1, 2: 3, 3: 4}
# Width and height that the links of an arm have, and the width of a gap for links left out.
_ARM_ROOM, _GAP = np.array([1.2, 1.0]), 0.2


def chains_figure(robot: Robot, numbers: Iterable[int] | None = None) -> Figure:
    """Draw the open chains of a robot side by side, as in the paper's Fig. 2 (eq. 1).

    Each is a sketch in the plane of the base, seen from above: links without length are drawn
    apart, base arms at their angles from arm 1, at most 150°, and the manipulator laid flat.

    Args:
        robot: The robot.
        numbers: The chains to draw; if None, all up to twelve, otherwise the first and last three.

    Returns:
        The figure.

    Raises:
        UsageError: The robot has no such chain.
    """
    chains = decompose(robot)
    if numbers is None:
        ends = range(1, robot.rotors + 1)
        numbers = ends if robot.rotors <= _MOST_CHAINS else [*ends[:3], *ends[-3:]]
    chosen = list(numbers)
    if not chosen or not all(1 <= number <= robot.rotors for number in chosen):
        raise UsageError(f"{robot.name} has chains 1 to {robot.rotors}, not {chosen}")
    columns = 2 if len(chosen) == 4 else min(len(chosen), _COLUMNS)
    rows = -(-len(chosen) // columns)
    keys = _chain_keys()
    legend = _LEGEND_ROW * (-(-len(keys) // _LEGEND_COLUMNS[columns]) + 0.75)
    height = _ROW * rows + legend
    with style():
        figure = Figure(figsize=(FULL * columns / _COLUMNS, height))
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        figure.subplots_adjust(0.005, legend / height, 0.995, 0.995, wspace=0.02, hspace=0.02)
        for axes, number in zip(panels, chosen, strict=False):
            _draw_chain(axes, robot, chains[number - 1])
        for axes in panels[len(chosen) :]:
            axes.set_axis_off()
        figure.legend(handles=keys, loc="lower center", ncols=_LEGEND_COLUMNS[columns])
        return figure


def _draw_chain(axes: Axes, robot: Robot, chain: Chain) -> None:
    """Draw one chain from its virtual links to its end.

    Args:
        axes: The axes.
        robot: The robot.
        chain: Its chain.
    """
    j = chain.number
    axes.set_axis_off()
    axes.set(xlim=(-1.08, 2.42), ylim=(-1.3, 1.3), aspect="equal")
    axes.set_title(f"chain {j}", loc="left", x=0.03, y=0.88, pad=0)
    joints = np.array([[-0.9, 0.0], [-0.45, 0.0], [0.0, 0.0], [1.0, 0.0]])
    for start, number in zip(joints[:2], ("−1", "0"), strict=True):
        axes.plot(
            *np.array([start, start + _by(0.45, 0.0)]).T, color=_QUIET, lw=1.2, ls=(0, (2, 1.5))
        )
        draw_name(axes, number, start + _by(0.225, -0.13), _QUIET)
    draw_link(axes, joints[2], joints[3], "1", 1 in chain.massive and _has_mass(robot, 1))
    for place, item in zip(joints, (1, 2, 3), strict=False):
        draw_joint(axes, place)
        draw_name(axes, f"$\\theta_{{{j},{item}}}$", place + _by(0.0, 0.2))
    draw_name(axes, "$O_1$", joints[2] + _by(0.08, -0.2), _QUIET)
    if 1 in chain.motors:
        below = _by(0.04, -0.42)
        draw_thrust(axes, joints[2], 0.0, robot.base.thrust[0], f"$F_{{{j},3}}$", below)
    if chain.is_constrained:
        _draw_base_arm(axes, robot, chain, joints[3])
    else:
        _draw_arm(axes, robot, chain, joints[3])


def _draw_base_arm(axes: Axes, robot: Robot, chain: Chain, centre: Array) -> None:
    """Draw the base arm of a constrained chain, with its motor and its constraint torque.

    Args:
        axes: The axes.
        robot: The robot.
        chain: Its chain.
        centre: Where O₂ is drawn (2).
    """
    j, arm = chain.number, chain.links[-1]
    true = float(robot.base.arm_angle_deg(arm))
    angle = np.deg2rad(np.clip(true, -150.0, 150.0))
    along = np.array([np.cos(angle), np.sin(angle)])
    end = centre + along
    draw_link(axes, centre, end, str(arm), arm in chain.massive and _has_mass(robot, arm))
    draw_joint(axes, centre)
    draw_joint(axes, end)
    # Beside the joint, where neither arm is.
    aside = np.array([0.0, 1.0 if angle <= 0.0 else -1.0])
    degrees = f"{true:+.4g}".replace("-", "−").replace("+0", "0")
    draw_name(axes, f"$\\theta_{{{j},4}}$ = {degrees}°", centre + _by(0.42, 0.0) + 0.42 * aside)
    draw_torque(axes, centre, aside, CONSTRAINT)
    torque = f"$\\tau\\prime_{{{j},4}}$"
    draw_name(axes, torque, centre + _by(-0.32, 0.0) + 0.34 * aside, CONSTRAINT)
    beside = _by(-0.15, 0.0) - 0.19 * aside if along[0] > -0.1 else _by(0.2, 0.0)
    draw_name(axes, "$O_2$", centre + beside, _QUIET)
    if arm in chain.motors:
        thrust = robot.base.thrust[arm - 1]
        draw_thrust(axes, end, angle, thrust, f"$F_{{{j},5}}$", 0.27 * along)


def _draw_arm(axes: Axes, robot: Robot, chain: Chain, centre: Array) -> None:
    """Draw the links of the arm, laid flat in steps, with the torques and forces of its joints.

    Args:
        axes: The axes.
        robot: The robot.
        chain: The chain that ends in the arm.
        centre: Where O₂ is drawn (2).
    """
    n = len(robot.links)
    shown = list(range(n)) if n <= _MOST_LINKS else [*range(_MOST_LINKS - 1), n - 1]
    steps = _arm_steps(robot, shown)
    draw_name(axes, "$O_2$", centre + _by(-0.19, -0.15), _QUIET)
    place = centre
    for step, i in enumerate(shown):
        if i != step:
            draw_name(axes, "…", place + _by(_GAP / 2.0, 0.0))
            draw_joint(axes, place)
            place = place + _by(_GAP, 0.0)
        end = place + steps[step]
        number = chain.links[3 + i]
        draw_link(axes, place, end, str(number), _has_mass(robot, number))
        turns = robot.links[i].joint == "revolute"
        aside = np.array([0.0, 1.0 if step % 2 == 0 else -1.0])
        if turns:
            draw_torque(axes, place, aside, TORQUE)
        else:
            draw_force(axes, place + 0.2 * aside, 0.5 * steps[step], TORQUE)
        index = f"{{{chain.number},{4 + i}}}"
        letter = "\\theta" if turns else "d"
        draw_name(axes, f"${letter}_{index}$, $\\tau_{index}$", place + _by(0.1, 0.36) * aside[1])
        draw_joint(axes, place, "o" if turns else "s")
        place = end
    if n:
        draw_name(axes, "tip", place + _by(0.17, 0.0), _QUIET)
    draw_joint(axes, place)


def _arm_steps(robot: Robot, shown: list[int]) -> Array:
    """Steps (k, 2) from joint to joint of the links that are shown, steep and flat by turns."""
    sizes = np.array([0.7 if robot.links[i].body.length else 0.5 for i in shown])
    slopes = np.deg2rad([(-75.0, -5.0)[step % 2] for step in range(len(shown))])
    steps = sizes[:, np.newaxis] * np.stack([np.cos(slopes), np.sin(slopes)], axis=1)
    room = _ARM_ROOM - _by(_GAP if len(shown) < len(robot.links) else 0.0, 0.0)
    scaled: Array = steps * min(1.0, *(room / np.maximum(np.abs(steps.sum(axis=0)), 1e-9)))
    return scaled


def _has_mass(robot: Robot, arm: int) -> bool:
    """Whether an arm, by its number, has any mass at all."""
    if arm <= robot.rotors:
        return robot.base.arm(arm).total_mass > 0.0
    return robot.links[arm - robot.rotors - 1].body.total_mass > 0.0


def _by(x: float, y: float) -> Array:
    """A step in the plane of a chain."""
    return np.array([x, y])


def _chain_keys() -> list[Line2D]:
    """What the parts of a chain mean."""
    bar: dict[str, Any] = {
        "lw": 3.6,
        "path_effects": [withStroke(linewidth=5.0, foreground=DARK)],
    }
    circle: dict[str, Any] = {"ls": "", "mfc": "none", "mec": THRUST, "ms": 8, "mew": 1.3}
    return [
        Line2D([], [], color=_QUIET, lw=1.2, ls=(0, (2, 1.5)), label="virtual link"),
        Line2D([], [], color=DARK, label="mass counted in this chain", **bar),
        Line2D([], [], color="white", label="no mass in this chain", **bar),
        Line2D([], [], marker="o", label="thrust normal to the plane", **circle),
        arrow_key(THRUST, "thrust in the plane"),
        arrow_key(CONSTRAINT, "constraint torque"),
        arrow_key(TORQUE, "joint torque or force"),
    ]
