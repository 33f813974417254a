"""The machine of a robot in 3-D, with its frames and thrusts (the paper's Fig. 1).

It is drawn from the robot's data alone, in the style of the figures of flights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from gibbs_codegen.figures.machine_drawing import VIEW, MachineDrawing, fit, project, set_scene
from gibbs_codegen.figures.style import DARK, FULL, GOLD, style
from gibbs_codegen.robot.coordinates import points
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.posture import Array, Frame, MachineFrames, machine_frames

# Of the palette that DARK and GOLD are of.
THRUST = "#cc79a7"
X_AXIS, Z_AXIS = "#0072b2", "#009e73"
_ARROWS = {
    THRUST: "thrust $F_k$",
    X_AXIS: "$x_i$, along the link",
    Z_AXIS: "$z_i$, axis of the joint",
}

# Of the base arms' length: thrusts, frames' axes, and room around the base.
_ARROW, _AXIS = 0.75, 0.5
# Elevation from which thrusts along and across the base can be told apart, degrees.
_ELEVATION = 38.0
# Of names, in points: larger than the style's, since subscripts must be read on a screen.
FONT_SIZE = 9
# Above all of a machine.
_LABELS = 100


@dataclass(frozen=True)
class _Still:
    """A machine that stands where its frames are, as a drawing wants it: one sample."""

    points: tuple[str, ...]
    positions: Array
    base_rotation: Array
    thrust_directions: Array
    rotors: int
    tangent_arm: int = 0

    def point(self, name: str) -> Array:
        return self.positions[:, self.points.index(name)]


def default_posture(robot: Robot) -> Array:
    """A configuration in which a machine shows its parts.

    The base is level, with the origin of the coordinates at the world's. Revolute joints are bent
    by 40°, each to the side that takes the tip down and away, prismatic ones stand at half of
    the longest link.
    """
    longest = max((link.body.length for link in robot.links), default=0.0)
    angles = np.deg2rad([-40.0, 40.0])
    layout = layout_of(robot)
    q = np.zeros(layout.size)
    for place, link in 2 * list(zip(layout.joint_places, robot.links, strict=True)):
        values = angles if link.joint == "revolute" else [longest / 2.0]
        scores = []
        for q[place] in values:
            frames = machine_frames(robot, q)
            scores.append(frames.tip[2] - float(np.linalg.norm(frames.tip - frames.centre)))
        q[place] = values[int(np.argmin(np.round(scores, 9)))]
    return q


def machine_figure(robot: Robot, q: Sequence[float] | Array | None = None) -> Figure:
    """The machine at q (rad, m; `default_posture` if None) as in the paper's Fig. 1, in m.

    The whole of it stands on the left, the base enlarged on the right, with arm 2 in gold. Rotors
    are discs normal to their thrusts; x and z axes of the frames start at the joints. Raises
    `UsageError` where q has the wrong length.
    """
    frames = machine_frames(robot, default_posture(robot) if q is None else q)
    with style():
        figure = Figure(figsize=(FULL if robot.links else 0.6 * FULL, 3.9))
        figure.suptitle(robot.name, color="0.35", parse_math=False)
        if robot.links:
            _draw_whole(figure.add_subplot(1, 2, 1, projection="3d"), robot, frames)
        columns = 2 if robot.links else 1
        _draw_base(figure.add_subplot(1, columns, columns, projection="3d"), robot, frames)
        figure.legend(
            handles=[
                Line2D([], [], color=GOLD, lw=3, label="base arm 2"),
                *(arrow_key(colour, label) for colour, label in _ARROWS.items()),
            ],
            loc="lower center",
            ncols=4,
        )
        # Makes the ticks while the style is ours.
        figure.draw_without_rendering()
        return figure


def _draw_whole(axes: Any, robot: Robot, frames: MachineFrames) -> None:
    """The whole machine, with the frames of the arm's links."""
    room = float(np.linalg.norm(frames.motors - frames.centre, axis=1).max())
    length = 0.13 * float(np.ptp(frames.points, axis=0).max())
    ends = [f.origin + length * axis for f in frames.links for axis in f.axes.T[::2]]
    set_scene(axes, _box(np.array([*frames.points, *ends]), 0.4 * room), ticks=5)
    MachineDrawing(axes, _still(robot, frames, points(robot)), colour="0.45", scale=1.3).show(0)
    fit(axes, 0.01, 0.07, 0.5, 0.86)
    for number, frame in enumerate(frames.links, start=robot.rotors + 1):
        _draw_frame(axes, frame, length, str(number))
    _name(axes, "$O_2$", frames.centre, (-7.0, 9.0))
    _name(axes, "tip", frames.tip, frames.tip - frames.links[-1].origin)
    for frame, after, number in zip(
        frames.links,
        [*(frame.origin for frame in frames.links[1:]), frames.tip],
        range(robot.rotors + 1, robot.rotors + len(robot.links) + 1),
        strict=True,
    ):
        if np.linalg.norm(after - frame.origin) > 0.5 * room:
            _number(axes, str(number), (frame.origin + after) / 2.0)


def _draw_base(axes: Any, robot: Robot, frames: MachineFrames) -> None:
    """The base, with numbers of its arms, their frames, and the thrusts."""
    arms = frames.motors - frames.centre
    reach = float(np.linalg.norm(arms, axis=1).max())
    ends = frames.motors + _ARROW * reach * frames.thrusts
    box = _box(np.concatenate([frames.motors, ends]), 0.25 * reach)
    set_scene(axes, box, (_ELEVATION, _azimuth_between(arms)), ticks=4)
    bare = tuple(name for name in points(robot) if not name.startswith("joint"))
    MachineDrawing(axes, _still(robot, frames, bare), scale=1.3).show(0)
    left, width = (0.53, 0.46) if robot.links else (0.02, 0.96)
    fit(axes, left, 0.07, width, 0.86)
    for k, (motor, end) in enumerate(zip(frames.motors, ends, strict=True), start=1):
        _arrow(axes, motor, end, THRUST, 1.6)
        _name(axes, f"$F_{{{k}}}$", end, end - motor, THRUST)
        _number(axes, str(k), 0.45 * frames.centre + 0.55 * motor)
    for frame in (frames.arm_1, *frames.base_arms):
        _arrow(axes, frame.origin, frame.point(_AXIS * reach), X_AXIS, 0.9)
    up = frames.centre + _AXIS * reach * frames.arm_1.axes[:, 2]
    _arrow(axes, frames.centre, up, Z_AXIS, 0.9)
    last = "" if robot.rotors == 2 else rf"\ldots z_{{{robot.rotors}}}"
    _name(axes, f"$z_2{last}$", up, up - frames.centre, Z_AXIS)
    _name(axes, "$O_1$", frames.motors[0], arms[0])
    _name(axes, "$O_2$", frames.centre, -frames.arm_1.axes[:, 2])


def _still(robot: Robot, frames: MachineFrames, names: tuple[str, ...]) -> _Still:
    """The machine with the points that are named; without joints its tip is the centre."""
    at = dict(zip(points(robot), frames.points, strict=True))
    if not any(name.startswith("joint") for name in names):
        at["tip"] = frames.centre
    return _Still(
        names,
        np.array([[at[name] for name in names]]),
        frames.arm_1.axes[np.newaxis],
        frames.thrusts @ frames.arm_1.axes,
        robot.rotors,
    )


def _box(places: Array, room: float) -> tuple[Array, Array]:
    """Lowest and highest coordinates of places with room around, never flat."""
    low, high = places.min(axis=0) - room, places.max(axis=0) + room
    half = np.maximum(high - low, 0.3 * float((high - low).max())) / 2.0
    return (low + high) / 2.0 - half, (low + high) / 2.0 + half


def _azimuth_between(arms: Array) -> float:
    """An azimuth, in degrees, from which no arm hides another: not along any, not half-way."""
    angles = np.degrees(np.arctan2(arms[:, 1], arms[:, 0])) + 0.6 * 360.0 / len(arms)
    off = (angles - VIEW[1] + 180.0) % 360.0 - 180.0
    return float(VIEW[1] + off[np.abs(off).argmin()])


def _draw_frame(axes: Any, frame: Frame, length: float, number: str) -> None:
    for place, (letter, colour) in {0: ("x", X_AXIS), 2: ("z", Z_AXIS)}.items():
        end = frame.origin + length * frame.axes[:, place]
        _arrow(axes, frame.origin, end, colour, 0.9)
        _name(axes, f"${letter}_{{{number}}}$", end, end - frame.origin, colour)


def _arrow(axes: Any, start: Array, end: Array, colour: str, width: float) -> None:
    """An arrow between two points of a scene."""
    axes.annotate(
        "",
        xy=project(axes, end),
        xytext=project(axes, start),
        arrowprops={
            "arrowstyle": "-|>,head_width=0.18,head_length=0.4",
            "color": colour,
            "lw": width,
            "shrinkA": 0,
            "shrinkB": 0,
        },
        zorder=_LABELS,
    )


def _name(
    axes: Any, text: str, place: Array, away: Array | tuple[float, float], colour: str = DARK
) -> None:
    """A text beside a point of a scene: off in a direction of the scene, or by so many points."""
    step = np.array(away)
    if len(step) == 3:
        there = axes.transData.transform(project(axes, np.array([place, place + step])))
        step = there[1] - there[0]
        size = float(np.hypot(*step))
        step = 7.0 * (step / size if size > 1e-9 else np.array([0.0, 1.0]))
    axes.annotate(
        text,
        xy=project(axes, place),
        xytext=step,
        textcoords="offset points",
        color=colour,
        fontsize=FONT_SIZE,
        horizontalalignment="center",
        verticalalignment="center",
        path_effects=[withStroke(linewidth=1.8, foreground="white")],
        zorder=_LABELS + 2,
    )


def _number(axes: Any, text: str, place: Array) -> None:
    """The number of an arm on it, in a circle."""
    axes.annotate(
        text,
        xy=project(axes, place),
        fontsize=7.5,
        horizontalalignment="center",
        verticalalignment="center",
        bbox={"boxstyle": "circle,pad=0.18", "facecolor": "white", "edgecolor": DARK, "lw": 0.5},
        zorder=_LABELS + 1,
    )


def arrow_key(colour: str, label: str) -> Line2D:
    """An entry of a legend: an arrow of a colour."""
    return Line2D([], [], color=colour, lw=1.4, marker=">", markevery=[1], ms=3.5, label=label)
