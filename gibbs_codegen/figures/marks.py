"""Marks of the drawings of a robot's structure: names, links, joints, torques and thrusts.

Places are in the plane of the axes that are drawn on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation

from gibbs_codegen.figures.appearance import COLOURS, DARK, GOLD
from gibbs_codegen.robot.rotations import Array

X_AXIS, CONSTRAINT, Z_AXIS, THRUST = COLOURS[:4]
Y_AXIS = COLOURS[7]
TORQUE = X_AXIS
# The grey of marks that are there to help.
QUIET = "0.5"
# Larger than the style's, since subscripts must be read on a screen; points.
_FONT_SIZE = 10
# Names and numbers lie above all that they name.
ABOVE_ALL = 1000
# Half the height of the ground.
_GROUND = 0.14
_CENTRED: dict[str, Any] = {"horizontalalignment": "center", "verticalalignment": "center"}


def draw_name(axes: Axes, text: str, place: Array, colour: str = DARK) -> Annotation:
    """Write a name, or a symbol in Matplotlib's mathematics, with its middle at a place (2).

    The place is in data units.
    """
    return axes.annotate(
        text,
        xy=_point(place),
        xytext=(0.0, 0.0),
        textcoords="offset points",
        color=colour,
        fontsize=_FONT_SIZE,
        path_effects=[withStroke(linewidth=1.8, foreground="white")],
        zorder=ABOVE_ALL + 1,
        **_CENTRED,
    )


def _point(place: Any) -> tuple[float, float]:
    return float(place[0]), float(place[1])


def short_name(name: str, longest: int) -> str:
    """A name of the robot file as Matplotlib should write it.

    Its middle is left out where it has more than `longest` letters: names often begin or end alike.
    """
    if len(name) > longest:
        tail = longest // 2
        name = f"{name[: longest - 1 - tail]}…{name[-tail:]}"
    return name.replace("$", r"\$")


def draw_number(axes: Axes, text: str, place: Array) -> None:
    """Write the number of a link on it, in a circle, or its name."""
    shape = "circle,pad=0.18" if text.isdigit() else "round,pad=0.15,rounding_size=0.3"
    axes.annotate(
        text,
        xy=_point(place),
        fontsize=9,
        bbox={"boxstyle": shape, "facecolor": "white", "edgecolor": DARK, "lw": 0.5},
        zorder=ABOVE_ALL,
        **_CENTRED,
    )


def draw_link(axes: Axes, start: Array, end: Array, number: str, has_mass: bool) -> None:
    """Draw a link as a bar with its number; arm 2 in gold.

    The bar is solid if the chain counts mass of the link.
    """
    solid = GOLD if number == "2" else DARK
    draw_bar(axes, start, end, solid if has_mass else "white", 3.6)
    draw_number(axes, number, (start + end) / 2.0)


def draw_joint(axes: Axes, place: Array, marker: str = "o") -> None:
    """Draw a joint: a circle if it is revolute, and with marker "s", a square, if prismatic."""
    axes.plot(*place, marker, ms=4.5, mfc="white", mec=DARK, mew=0.8, zorder=5)


def draw_ground(axes: Axes, place: Array) -> None:
    """Draw the ground, on the left of a place (2)."""
    x, y = _point(place)
    corner, size = (x - 0.12, y - _GROUND), (0.12, 2 * _GROUND)
    axes.add_patch(Rectangle(corner, *size, fill=False, hatch="/////", ec=QUIET, lw=0))
    axes.vlines(x, y - _GROUND, y + _GROUND, colors=QUIET, lw=1.2)


def draw_torque(axes: Axes, place: Array, side: Array, colour: str) -> None:
    """Draw a torque about a joint as an arc, counter-clockwise, on the joint's `side` (2)."""
    across = 0.17 * np.array([side[1], -side[0]])
    start, end = place + across + 0.08 * side, place - across + 0.08 * side
    arrow = FancyArrowPatch(
        _point(start),
        _point(end),
        connectionstyle="arc3,rad=0.75",
        arrowstyle="-|>,head_width=1.6,head_length=2.8",
        color=colour,
        lw=1.2,
        shrinkA=0,
        shrinkB=0,
        zorder=6,
    )
    axes.add_patch(arrow)


def draw_force(axes: Axes, place: Array, step: Array, colour: str) -> None:
    """Draw a force as a straight arrow."""
    look = {"arrowstyle": "-|>", "color": colour, "lw": 1.5, "shrinkA": 2, "shrinkB": 0}
    axes.annotate("", _point(place + step), _point(place), arrowprops=look, zorder=6)


def draw_arrow(
    axes: Axes, start: Array, end: Array, colour: str, dashes: Any = "solid", width: float = 1.3
) -> None:
    """Draw a vector as an arrow with a slender head; its width is in points."""
    look = {"arrowstyle": "-|>,head_width=0.2,head_length=0.45", "color": colour, "lw": width}
    look |= {"linestyle": dashes, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", _point(end), _point(start), arrowprops=look, zorder=ABOVE_ALL - 1)


def draw_line(axes: Axes, ends: Array, colour: str, dashes: Any) -> None:
    """Draw a line (2, 2) above all but names; in 3-D axes it is in data units of the page."""
    line = Line2D(*ends.T, color=colour, lw=1.2, ls=dashes, zorder=ABOVE_ALL - 2)
    line.set_transform(axes.transData)
    Axes.add_line(axes, line)


def draw_bar(axes: Axes, start: Array, end: Array, filling: str, width: float) -> None:
    """Draw a link as a bar with an outline; its width is in points."""
    ends = np.array([start, end]).T
    axes.plot(*ends, color=DARK, lw=width + 1.4, solid_capstyle="round", zorder=3)
    axes.plot(*ends, color=filling, lw=width, solid_capstyle="round", zorder=3)


def draw_thrust(
    axes: Axes, place: Array, angle: float, direction: Sequence[float], text: str, aside: Array
) -> None:
    """Draw the thrust of a motor: out of the plane, into it, in the plane, or both.

    `angle`, rad, is that of the motor's arm in the plane, and `direction` (3) the thrust's unit
    vector in the frame of the arm. `aside` (2) is where the name is from the motor, if no arrow
    lies in the plane.
    """
    c, s = np.cos(angle), np.sin(angle)
    flat = np.array([[c, -s], [s, c]]) @ np.array(direction[:2])
    if abs(direction[2]) > 1e-9:
        # The tip of an arrow that comes, or the feathers of one that goes.
        axes.plot(*place, "o", ms=9, mfc="none", mec=THRUST, mew=1.3, zorder=6)
        axes.plot(*place, "." if direction[2] > 0 else "x", ms=5, color=THRUST, zorder=6)
    if np.hypot(*flat) > 1e-9:
        end = place + 0.32 * flat
        draw_force(axes, place, 0.32 * flat, THRUST)
        draw_name(axes, text, end + 0.15 * flat / np.hypot(*flat), THRUST)
    else:
        draw_name(axes, text, place + aside, THRUST)


def arrow_key(colour: str, label: str) -> Line2D:
    """An entry of a legend for an arrow."""
    return Line2D([], [], color=colour, lw=1.4, marker=">", markevery=[1], ms=3.5, label=label)
