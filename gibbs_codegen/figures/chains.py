"""The open chains of a robot side by side, with what acts on them (the paper's Fig. 2).

They are drawn from the robot's data alone, in the style of the figures of flights.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from gibbs_codegen.equations.typeset import Kind, base_name, name
from gibbs_codegen.errors import UsageError
from gibbs_codegen.figures import marks
from gibbs_codegen.figures.appearance import DARK, GOLD
from gibbs_codegen.figures.style import FULL, style
from gibbs_codegen.robot.chains import Chain, decompose
from gibbs_codegen.robot.file import AnyRobot, as_robot
from gibbs_codegen.robot.layout import has_default_tip, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import TRAVELS
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.robot.rotations import Array

_QUIET = "0.55"
_DASHED: dict[str, Any] = {"lw": 1.2, "ls": (0, (2, 1.5))}
# Chains that are drawn unless they are chosen, and links of an arm that are drawn one by one.
_MOST_CHAINS, _MOST_LINKS = 12, 4
# Links of an arm for whose names there is room; more have their numbers.
_MOST_NAMED = 2
_COLUMNS = 3
# Heights of a row of chains and of one of the legend, in; the legend's columns by those of chains.
_ROW, _LEGEND_ROW = 1.85, 0.2
_LEGEND_COLUMNS = {1: 1, 2: 3, 3: 4}
# Width and height that the links of an arm have, and the width of a gap for links left out.
_ARM_ROOM, _GAP = np.array([1.1, 1.05]), 0.2
_LONGEST_NAME = 10


def chains_figure(robot: AnyRobot, numbers: Iterable[int] | None = None) -> Figure:
    """Draw the open chains of a robot side by side, as in the paper's Fig. 2 (eq. 1).

    Each is a sketch in the plane of the base, seen from above: links without length are drawn
    apart, base arms at their angles from arm 1, at most 125°, and the links of arms laid flat.

    Args:
        robot: The robot, or its file or name.
        numbers: The chains to draw; if None, all up to twelve, otherwise the first and last three.

    Returns:
        The figure.

    Raises:
        UsageError: The robot has no such chain.
    """
    robot = as_robot(robot)
    chains = decompose(robot)
    ends = range(1, len(chains) + 1)
    if numbers is None:
        numbers = ends if len(chains) <= _MOST_CHAINS else [*ends[:3], *ends[-3:]]
    chosen = list(numbers)
    if not chosen or not all(number in ends for number in chosen):
        raise UsageError(f"{robot.name} has chains 1 to {len(chains)}, not {chosen}")
    columns = 2 if len(chosen) == 4 else min(len(chosen), _COLUMNS)
    rows = -(-len(chosen) // columns)
    keys = _chain_keys(robot)
    legend = _LEGEND_ROW * (-(-len(keys) // _LEGEND_COLUMNS[columns]) + 0.75)
    height = _ROW * rows + legend
    with style():
        figure = Figure(figsize=(FULL * columns / _COLUMNS, height))
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        figure.subplots_adjust(0.005, legend / height, 0.995, 0.995, wspace=0.02, hspace=0.02)
        for axes, number in zip(panels, chosen, strict=False):
            axes.set_axis_off()
            axes.set(xlim=(-1.38, 2.42), ylim=(-1.3, 1.3), aspect="equal")
            axes.set_title(f"chain {number}", loc="left", x=0.03, y=0.88, pad=0)
            chain = chains[number - 1]
            centre = _draw_root(axes, robot, chain)
            draw = _draw_arm if chain.rod is None else _draw_base_arm
            draw(axes, robot, chain, centre)
        for axes in panels[len(chosen) :]:
            axes.set_axis_off()
        figure.legend(handles=keys, loc="lower center", ncols=_LEGEND_COLUMNS[columns])
        return figure


def _draw_root(axes: Axes, robot: Robot, chain: Chain) -> Array:
    """Draw the base as the chain begins; return where its centre is drawn (2).

    Before it are the joints of virtual links where angles turn it or a list moves it, and the
    ground if it is on that; it is arm 1 or its body.
    """
    j, rods, layout = chain.number, robot.base.rotors, layout_of(robot)
    start, end = _by(0.0, 0.0), _by(1.0, 0.0)
    virtual = _virtual(robot)
    gap = min(0.56, 1.12 / max(len(virtual) - 1, 1))
    joints = [_by(-gap * before, 0.0) for before in reversed(range(len(virtual)))]
    for link, ends in enumerate(pairwise(joints)):
        axes.plot(*np.transpose(ends), color=_QUIET, **_DASHED)
        if layout.moves_freely:
            number = f"{link - 1}".replace("-", "−")
            marks.draw_name(axes, number, np.mean(ends, axis=0) + _by(0.0, -0.2), _QUIET)
    if not (layout.moves_freely or layout.turns_with_base):
        marks.draw_ground(axes, [*joints, start][0])
    if layout.turns_with_base:
        marks.draw_name(axes, f"$v_{{{j}}}$, $\\omega_{{{j}}}$", start + _by(-0.1, 0.22))
    has_mass = robot.base.arm(1).total_mass > 0.0 if rods else robot.base.body is not None
    marks.draw_link(axes, start, end, "1" if rods else "base", chain.has_core and has_mass)
    for item, (place, coordinate) in enumerate(zip(joints, virtual, strict=True), start=1):
        marks.draw_joint(axes, place, "s" if coordinate in TRAVELS else "o")
        # Above and below by turns where they are near each other.
        symbol = name(*base_name(coordinate, j, item), Kind.COORDINATE, "")
        side = -1.0 if gap < 0.5 and item % 2 == 0 else 1.0
        marks.draw_name(axes, f"${symbol.latex}$", place + _by(0.0, 0.24 * side))
    if rods:
        marks.draw_name(axes, "$O_1$", start + _by(0.14, -0.24), _QUIET)
    if rods and 1 in chain.motors:
        below = _by(0.06, -0.52)
        marks.draw_thrust(axes, start, 0.0, robot.base.thrust[0], f"$F_{{{j},3}}$", below)
    _draw_placed(axes, robot, chain, BASE, ((start + end) / 2.0, _by(0.0, 0.3)))
    return end


def _virtual(robot: Robot) -> tuple[str, ...]:
    """Names of the coordinates by which virtual links move the base, on the way to it."""
    layout = layout_of(robot)
    return () if layout.turns_with_base else layout.q.names[: layout.q.joints.start]


def _draw_placed(
    axes: Axes, robot: Robot, chain: Chain, body: int, where: tuple[Array, Array]
) -> None:
    """Draw the thrusts of the placed rotors of a body, which may point anywhere, as one arrow.

    `where` is a place (2) on its drawing, and the step (2) to the tip of the arrow.
    """
    acting = [
        k
        for k, rotor in enumerate(robot.thrusters, start=1)
        if rotor.on == body and k in chain.motors
    ]
    if acting:
        start, step = where
        marks.draw_force(axes, start, step, marks.THRUST)
        first = f"F_{{{acting[0]}}}"
        last = rf"\ldots F_{{{acting[-1]}}}" if len(acting) > 1 else ""
        marks.draw_name(
            axes, f"${first}{last}$", start + step + 0.17 * step / np.hypot(*step), marks.THRUST
        )


def _draw_base_arm(axes: Axes, robot: Robot, chain: Chain, centre: Array) -> None:
    """Draw the base arm of a constrained chain, with its motor and its constraint torque.

    `centre` (2) is where O₂ is drawn.
    """
    j, arm = chain.number, chain.links[-1]
    true = float(robot.base.arm_angle_deg(arm))
    angle = np.deg2rad(np.clip(true, -125.0, 125.0))
    along = np.array([np.cos(angle), np.sin(angle)])
    end = centre + along
    marks.draw_link(axes, centre, end, str(arm), robot.base.arm(arm).total_mass > 0.0)
    marks.draw_joint(axes, centre)
    marks.draw_joint(axes, end)
    # Beside the joint, where neither arm is.
    aside = np.array([0.0, 1.0 if angle <= 0.0 else -1.0])
    degrees = f"{true:+.4g}".replace("-", "−").replace("+0", "0")
    marks.draw_name(
        axes, f"$\\theta_{{{j},4}}$ = {degrees}°", centre + _by(0.25, 0.0) + 0.66 * aside
    )
    marks.draw_torque(axes, centre, aside, marks.CONSTRAINT)
    torque = f"$\\tau′_{{{j},4}}$"
    marks.draw_name(axes, torque, centre + _by(-0.4, 0.0) + 0.32 * aside, marks.CONSTRAINT)
    beside = _by(-0.15, 0.0) - 0.19 * aside if along[0] > -0.1 else _by(0.2, 0.0)
    marks.draw_name(axes, "$O_2$", centre + beside, _QUIET)
    if arm in chain.motors:
        thrust = robot.base.thrust[arm - 1]
        marks.draw_thrust(axes, end, angle, thrust, f"$F_{{{j},5}}$", 0.27 * along)


def _draw_arm(axes: Axes, robot: Robot, chain: Chain, centre: Array) -> None:
    """Draw the links of an arm, laid flat in steps, with what acts at their joints.

    `centre` (2) is where the base centre is drawn.
    """
    path, n = chain.path, len(chain.path)
    shown = list(range(n)) if n <= _MOST_LINKS else [*range(_MOST_LINKS - 1), n - 1]
    # From joint to joint, steep and flat by turns, and scaled so that they fit.
    long = [
        robot.links[i - 1].body.length or robot.links[i - 1].pose
        for i in (path[at] for at in shown)
    ]
    sizes = np.array([0.7 if drawn else 0.5 for drawn in long])
    slopes = np.deg2rad([(-75.0, -5.0)[step % 2] for step in range(len(shown))])
    steps = sizes[:, np.newaxis] * np.stack([np.cos(slopes), np.sin(slopes)], axis=1)
    room = _ARM_ROOM - _by(_GAP if len(shown) < n else 0.0, 0.0)
    steps *= min(1.0, *(room / np.maximum(np.abs(steps.sum(axis=0)), 1e-9)))
    if robot.base.rotors:
        marks.draw_name(axes, "$O_2$", centre + _by(-0.27, -0.22), _QUIET)
    place = centre
    for step, position in enumerate(shown):
        if position != step:
            marks.draw_name(axes, "…", place + _by(_GAP / 2.0, 0.0))
            marks.draw_joint(axes, place)
            place = place + _by(_GAP, 0.0)
        i, end = path[position], place + steps[step]
        link = robot.links[i - 1]
        number = str(robot.rotors + i)
        if link.name and len(shown) <= _MOST_NAMED:
            number = marks.short_name(link.name, _LONGEST_NAME)
        marks.draw_link(axes, place, end, number, i in chain.own and link.body.total_mass > 0.0)
        aside = np.array([0.0, 1.0 if step % 2 == 0 else -1.0])
        _draw_link_joint(axes, robot, chain, i, (place, 0.5 * steps[step], aside))
        # A place away from the names of this joint and of the next.
        steep = step % 2 == 0
        share, arrow = (0.5, _by(-0.5, 0.0)) if steep else (0.75, _by(0.0, -0.3))
        _draw_placed(axes, robot, chain, i, (place + share * (end - place), arrow))
        place = end
    if n and has_default_tip(robot):
        marks.draw_name(axes, "tip", place + _by(0.24, 0.0), _QUIET)
    marks.draw_joint(axes, place)


def _draw_link_joint(
    axes: Axes, robot: Robot, chain: Chain, i: int, where: tuple[Array, Array, Array]
) -> None:
    """Draw the joint of a link, and what acts there; a link that is welded has neither.

    `where` is the joint (2), half of the link's step (2), and the side (2) that is free.
    """
    link, (place, step, aside) = robot.links[i - 1], where
    jointed = [k for k in chain.path if k in robot.moving or k in robot.constrained]
    if i not in jointed:
        return
    index = f"{{{chain.number},{layout_of(robot).base_item + 1 + jointed.index(i)}}}"
    slides, colour = (
        link.joint == "prismatic",
        marks.CONSTRAINT if link.constrained else marks.TORQUE,
    )
    if slides:
        marks.draw_force(axes, place + 0.2 * aside, step, marks.TORQUE)
    else:
        marks.draw_torque(axes, place, aside, colour)
    letter, prime = "d" if slides else "\\theta", "′" if link.constrained else ""
    text = f"${letter}_{index}$, $\\tau{prime}_{index}$"
    marks.draw_name(axes, text, place + _by(0.1, 0.36) * aside[1])
    marks.draw_joint(axes, place, "s" if slides else "o")


def _by(x: float, y: float) -> Array:
    """A step in the plane of a chain."""
    return np.array([x, y])


def _chain_keys(robot: Robot) -> list[Line2D]:
    """Legend of the parts of a chain."""
    bar: dict[str, Any] = {"lw": 3.6, "path_effects": [withStroke(linewidth=5.0, foreground=DARK)]}
    circle: dict[str, Any] = {"ls": "", "mfc": "none", "mec": marks.THRUST, "ms": 8, "mew": 1.3}
    rods, arrow = robot.base.rotors, marks.arrow_key
    keys = [
        (Line2D([], [], color=_QUIET, label="virtual link", **_DASHED), len(_virtual(robot)) > 1),
        (Line2D([], [], color=DARK, label="mass counted in this chain", **bar), True),
        (Line2D([], [], color="white", label="no mass in this chain", **bar), True),
        (Line2D([], [], color=GOLD, label="base arm 2, mass counted", **bar), rods),
        (Line2D([], [], marker="o", label="thrust normal to the plane", **circle), rods),
        (arrow(marks.THRUST, "thrust in the plane"), rods),
        (arrow(marks.THRUST, "thrust"), robot.thrusters),
        (arrow(marks.CONSTRAINT, "constraint torque"), rods or robot.constrained),
        (arrow(marks.TORQUE, "joint torque or force"), robot.moving),
    ]
    return [key for key, is_drawn in keys if is_drawn]
