"""The open chains of a robot side by side, with what acts on them (the paper's Fig. 2).

They are drawn from the robot's data alone, in the style of the figures of flights.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyArrowPatch
from matplotlib.patheffects import withStroke

from gibbs_codegen.errors import UsageError
from gibbs_codegen.figures.machine import FONT_SIZE, THRUST, arrow_key
from gibbs_codegen.figures.style import DARK, FULL, GOLD, style
from gibbs_codegen.robot.chains import Chain, decompose
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.posture import Array

# Of the palette that DARK and GOLD are of.
CONSTRAINT, TORQUE = "#d55e00", "#0072b2"
_QUIET = "0.55"
# Chains that are drawn unless they are chosen, and links of an arm that are drawn one by one.
_MOST_CHAINS, _MOST_LINKS = 12, 4
_COLUMNS = 3


def chains_figure(robot: Robot, numbers: Iterable[int] | None = None) -> Figure:
    """The open chains of a robot side by side, as in the paper's Fig. 2 (eq. 1).

    A scheme in the plane of the base, seen from above: links of no length are drawn apart, base
    arms at their angles against arm 1, at most 150°, the manipulator laid flat. `numbers` chooses
    chains; up to twelve are drawn otherwise, of more rotors the first and last three. Raises
    `UsageError` where there is no such chain.
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
    with style():
        figure = Figure(figsize=(FULL * columns / _COLUMNS, 1.85 * rows + 0.65))
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        figure.subplots_adjust(
            0.005, 0.55 / (1.85 * rows + 0.65), 0.995, 0.995, wspace=0.02, hspace=0.02
        )
        for axes, number in zip(panels, chosen, strict=False):
            _draw_chain(axes, robot, chains[number - 1])
        for axes in panels[len(chosen) :]:
            axes.set_axis_off()
        figure.legend(handles=_chain_keys(), loc="lower center", ncols=4 if columns > 1 else 2)
        return figure


def _draw_chain(axes: Axes, robot: Robot, chain: Chain) -> None:
    """One chain from its virtual links to its end."""
    j = chain.number
    axes.set_axis_off()
    axes.set(xlim=(-1.08, 2.42), ylim=(-1.3, 1.3), aspect="equal")
    axes.set_title(f"chain {j}", loc="left", x=0.03, y=0.88, pad=0)
    joints = np.array([[-0.9, 0.0], [-0.45, 0.0], [0.0, 0.0], [1.0, 0.0]])
    for start, number in zip(joints[:2], ("−1", "0"), strict=True):
        axes.plot(
            *np.array([start, start + _by(0.45, 0.0)]).T, color=_QUIET, lw=1.2, ls=(0, (2, 1.5))
        )
        _text(axes, number, start + _by(0.225, -0.13), _QUIET)
    _link(axes, joints[2], joints[3], "1", 1 in chain.massive and _has_mass(robot, 1))
    names = [f"$\\theta_{{{j},{item}}}$" for item in (1, 2, 3)]
    for place, text in zip(joints, names, strict=False):
        _joint(axes, place)
        _text(axes, text, place + _by(0.0, 0.17))
    _text(axes, "$O_1$", joints[2] + _by(0.0, -0.17), _QUIET)
    if 1 in chain.motors:
        _thrust(axes, joints[2], 0.0, robot.base.thrust[0], f"$F_{{{j},3}}$", _by(0.0, -0.36))
    if chain.is_constrained:
        _draw_base_arm(axes, robot, chain, joints[3])
    else:
        _draw_manipulator(axes, robot, chain, joints[3])


def _draw_base_arm(axes: Axes, robot: Robot, chain: Chain, centre: Array) -> None:
    """The base arm of a constrained chain, with its motor and the torque that holds it."""
    j, arm = chain.number, chain.links[-1]
    true = float(robot.base.arm_angle_deg(arm))
    angle = np.deg2rad(np.clip(true, -150.0, 150.0))
    along = np.array([np.cos(angle), np.sin(angle)])
    end = centre + along
    _link(axes, centre, end, str(arm), arm in chain.massive and _has_mass(robot, arm))
    _joint(axes, centre)
    _joint(axes, end)
    # Beside the joint, where neither arm is.
    aside = np.array([0.0, 1.0 if angle <= 0.0 else -1.0])
    degrees = f"{true:+.4g}".replace("-", "−").replace("+0", "0")
    _text(axes, f"$\\theta_{{{j},4}}$ = {degrees}°", centre + _by(0.42, 0.0) + 0.42 * aside)
    _turning(axes, centre, aside, CONSTRAINT)
    _text(axes, f"$\\tau'_{{{j},4}}$", centre + _by(-0.32, 0.0) + 0.34 * aside, CONSTRAINT)
    beside = _by(-0.12, 0.0) - 0.19 * aside if along[0] > -0.1 else _by(0.2, 0.0)
    _text(axes, "$O_2$", centre + beside, _QUIET)
    if arm in chain.motors:
        _thrust(axes, end, angle, robot.base.thrust[arm - 1], f"$F_{{{j},5}}$", 0.3 * along)


def _draw_manipulator(axes: Axes, robot: Robot, chain: Chain, centre: Array) -> None:
    """The links of the manipulator, laid flat in a zigzag, with the torques of its joints."""
    j, n = chain.number, len(robot.links)
    shown = list(range(n)) if n <= _MOST_LINKS else [*range(_MOST_LINKS - 1), n - 1]
    sizes = np.array([0.7 if robot.links[i].body.length else 0.5 for i in shown])
    slopes = np.deg2rad([(-70.0, 20.0)[step % 2] for step in range(len(shown))])
    steps = sizes[:, np.newaxis] * np.stack([np.cos(slopes), np.sin(slopes)], axis=1)
    gap = 0.25 if len(shown) < n else 0.0
    steps *= min(1.0, (1.1 - gap) / max(float(steps[:, 0].sum()), 1e-9))
    _text(axes, "$O_2$", centre + _by(-0.12, -0.18), _QUIET)
    place = centre
    for step, i in enumerate(shown):
        if i != step:
            _text(axes, "…", place + _by(gap / 2.0, 0.0))
            _joint(axes, place)
            place = place + _by(gap, 0.0)
        end = place + steps[step]
        number = chain.links[3 + i]
        _link(axes, place, end, str(number), _has_mass(robot, number))
        turns = robot.links[i].joint == "revolute"
        aside = np.array([0.0, 1.0 if step % 2 == 0 else -1.0])
        if turns:
            _turning(axes, place, aside, TORQUE)
        else:
            _pushing(axes, place + 0.2 * aside, 0.5 * steps[step], TORQUE)
        letter = "\\theta" if turns else "d"
        label = f"${letter}_{{{j},{4 + i}}}$, $\\tau_{{{j},{4 + i}}}$"
        _text(axes, label, place + _by(0.04 + 0.08 * step, 0.0) + 0.4 * aside)
        _joint(axes, place, "o" if turns else "s")
        place = end
    if n:
        _text(axes, "tip", place + _by(0.0, -0.18), _QUIET)
        _joint(axes, place)
    else:
        _joint(axes, centre)


def _has_mass(robot: Robot, arm: int) -> bool:
    """Whether an arm, by its number, has any mass at all."""
    if arm <= robot.rotors:
        return robot.base.arm(arm).total_mass > 0.0
    return robot.links[arm - robot.rotors - 1].body.total_mass > 0.0


def _link(axes: Axes, start: Array, end: Array, number: str, counts: bool) -> None:
    """A link as a bar, solid where its mass counts, with its number; arm 2 in gold."""
    ends = np.array([start, end]).T
    axes.plot(*ends, color=DARK, lw=5.0, solid_capstyle="round", zorder=3)
    inside = ("white" if not counts else GOLD) if not counts or number == "2" else DARK
    axes.plot(*ends, color=inside, lw=3.6, solid_capstyle="round", zorder=3)
    axes.annotate(
        number,
        xy=(float(ends[0].mean()), float(ends[1].mean())),
        fontsize=7.5,
        horizontalalignment="center",
        verticalalignment="center",
        bbox={"boxstyle": "circle,pad=0.18", "facecolor": "white", "edgecolor": DARK, "lw": 0.5},
        zorder=4,
    )


def _joint(axes: Axes, place: Array, marker: str = "o") -> None:
    axes.plot(*place, marker, ms=4.5, mfc="white", mec=DARK, mew=0.8, zorder=5)


def _text(axes: Axes, text: str, place: Array, colour: str = DARK) -> None:
    axes.text(
        float(place[0]),
        float(place[1]),
        text,
        color=colour,
        fontsize=FONT_SIZE,
        horizontalalignment="center",
        verticalalignment="center",
        path_effects=[withStroke(linewidth=1.5, foreground="white")],
        zorder=8,
    )


def _turning(axes: Axes, place: Array, aside: Array, colour: str) -> None:
    """A torque about a joint: an arc on its side `aside`, counter-clockwise."""
    side = 0.17 * np.array([aside[1], -aside[0]])
    start, end = place + side + 0.08 * aside, place - side + 0.08 * aside
    arrow = FancyArrowPatch(
        (float(start[0]), float(start[1])),
        (float(end[0]), float(end[1])),
        connectionstyle="arc3,rad=0.75",
        arrowstyle="-|>,head_width=1.6,head_length=2.8",
        color=colour,
        lw=1.2,
        shrinkA=0,
        shrinkB=0,
        zorder=6,
    )
    axes.add_patch(arrow)


def _pushing(axes: Axes, place: Array, step: Array, colour: str) -> None:
    """A force along a straight step."""
    axes.annotate(
        "",
        xy=(float(place[0] + step[0]), float(place[1] + step[1])),
        xytext=(float(place[0]), float(place[1])),
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.5, "shrinkA": 2, "shrinkB": 0},
        zorder=6,
    )


def _thrust(
    axes: Axes, place: Array, angle: float, direction: Sequence[float], text: str, aside: Array
) -> None:
    """A thrust in the frame of an arm at an angle: towards the eye, in the plane, or both.

    Its name stands at the end of its arrow, or `aside` where it has none.
    """
    c, s = np.cos(angle), np.sin(angle)
    flat = np.array([[c, -s], [s, c]]) @ np.array(direction[:2])
    if abs(direction[2]) > 1e-9:
        # The tip of an arrow that comes, or the feathers of one that goes.
        axes.plot(*place, "o", ms=11, mfc="none", mec=THRUST, mew=1.3, zorder=6)
        axes.plot(*place, "." if direction[2] > 0 else "x", ms=5, color=THRUST, zorder=6)
    if np.hypot(*flat) > 1e-9:
        end = place + 0.42 * flat
        _pushing(axes, place, 0.42 * flat, THRUST)
        _text(axes, text, end + 0.14 * flat / np.hypot(*flat), THRUST)
    else:
        _text(axes, text, place + aside, THRUST)


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
        Line2D([], [], color=DARK, label="mass counts here", **bar),
        Line2D([], [], color="white", label="no mass here", **bar),
        Line2D([], [], marker="o", label="thrust towards the eye", **circle),
        arrow_key(THRUST, "thrust in the plane"),
        arrow_key(CONSTRAINT, "constraint torque"),
        arrow_key(TORQUE, "joint torque"),
    ]
