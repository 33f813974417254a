"""The robot in 3-D, with its frames and thrusts (the paper's Fig. 1).

It is drawn from the robot's data alone, in the style of the figures of flights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gibbs_codegen.figures.marks import (
    ABOVE_ALL,
    THRUST,
    X_AXIS,
    Z_AXIS,
    arrow_key,
    draw_name,
    draw_number,
)
from gibbs_codegen.figures.robot_drawing import RobotDrawing, disc_radius
from gibbs_codegen.figures.scene import VIEW, fit, project, set_scene
from gibbs_codegen.figures.style import DARK, FULL, GOLD, style
from gibbs_codegen.robot.coordinates import points
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.posture import Array, Frame, RobotFrames, robot_frames

_ARROWS = {
    THRUST: "thrust $F_k$",
    X_AXIS: "$x_i$, along the link",
    Z_AXIS: "$z_i$, axis of the joint",
}

# Of the base arms' length: thrusts and frames' axes.
_ARROW, _AXIS = 0.75, 0.5
# Elevation from which thrusts along and across the base can be told apart, degrees.
_ELEVATION = 42.0


@dataclass(frozen=True)
class _Still:
    """A robot that stands where its frames are, as a drawing wants it: one sample."""

    points: tuple[str, ...]
    positions: Array
    base_rotation: Array
    thrust_directions: Array
    rotors: int
    tangent_arm: int = 0


def default_posture(robot: Robot) -> Array:
    """Choose a configuration in which a robot shows its parts.

    The base is level, with the origin of the coordinates at the world's. Revolute joints are bent
    by 40° or 140°, each so that the tip moves down and away; prismatic ones stand at half of the
    longest link.

    Args:
        robot: The robot.

    Returns:
        The coordinates q (nq), rad and m.
    """
    longest = max((link.body.length for link in robot.links), default=0.0)
    # Where bends are equally good, the first, which is small, is taken.
    angles = np.deg2rad([-40.0, 40.0, -140.0, 140.0])
    layout = layout_of(robot)
    q = np.array(layout.neutral)
    for place, link in 2 * list(zip(layout.q.joint_places, robot.links, strict=True)):
        values = angles if link.joint == "revolute" else [longest / 2.0]
        scores = []
        for q[place] in values:
            frames = robot_frames(robot, q)
            scores.append(frames.tip[2] - float(np.linalg.norm(frames.tip - frames.centre)))
        q[place] = values[int(np.argmin(np.round(scores, 9)))]
    return q


def machine_figure(robot: Robot, q: Sequence[float] | Array | None = None) -> Figure:
    """Draw the robot as in the paper's Fig. 1, in m.

    The whole robot is on the left, the base enlarged on the right, with arm 2 in gold. Rotors are
    discs normal to their thrusts; x and z axes of the frames start at the joints.

    Args:
        robot: The robot.
        q: The coordinates (nq), rad and m; `default_posture` if None.

    Returns:
        The figure.

    Raises:
        UsageError: q has the wrong length.
    """
    frames = robot_frames(robot, default_posture(robot) if q is None else q)
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


def _draw_whole(axes: Any, robot: Robot, frames: RobotFrames) -> None:
    """Draw the whole robot, with the frames of the arm's links.

    Args:
        axes: The 3-D axes.
        robot: The robot.
        frames: Where its frames are.
    """
    room = float(np.linalg.norm(frames.motors - frames.centre, axis=1).max())
    length = 0.13 * float(np.ptp(frames.points, axis=0).max())
    ends = [f.origin + length * axis for f in frames.links for axis in f.axes.T[::2]]
    set_scene(axes, _box(np.array([*frames.points, *ends]), 0.5 * room), ticks=5)
    RobotDrawing(axes, _still(robot, frames, points(robot)), colour="0.45", scale=1.3).show(0)
    fit(axes, 0.01, 0.07, 0.5, 0.86)
    for number, frame in enumerate(frames.links, start=robot.rotors + 1):
        _draw_frame(axes, frame, length, str(number))
    _name(axes, "$O_2$", frames.centre, (-12.0, 7.0))
    _name(axes, "tip", frames.tip, (12.0, -5.0))
    for frame, after, number in zip(
        frames.links,
        [*(frame.origin for frame in frames.links[1:]), frames.tip],
        range(robot.rotors + 1, robot.rotors + len(robot.links) + 1),
        strict=True,
    ):
        if np.linalg.norm(after - frame.origin) > room:
            draw_number(axes, str(number), project(axes, (frame.origin + after) / 2.0))


def _draw_base(axes: Any, robot: Robot, frames: RobotFrames) -> None:
    """Draw the base, with numbers of its arms, their frames, and the thrusts.

    Args:
        axes: The 3-D axes.
        robot: The robot.
        frames: Where its frames are.
    """
    arms = frames.motors - frames.centre
    reach = float(np.linalg.norm(arms, axis=1).max())
    ends = frames.motors + _ARROW * reach * frames.thrusts
    bare = tuple(name for name in points(robot) if not name.startswith("joint"))
    still = _still(robot, frames, bare)
    box = _box(np.concatenate([frames.motors, ends]), 1.1 * disc_radius(still))
    set_scene(axes, box, (_ELEVATION, _azimuth_between(arms)), ticks=4)
    RobotDrawing(axes, still, scale=1.3).show(0)
    left, width = (0.53, 0.46) if robot.links else (0.02, 0.96)
    fit(axes, left, 0.07, width, 0.86)
    for k, (motor, end) in enumerate(zip(frames.motors, ends, strict=True), start=1):
        _arrow(axes, motor, end, THRUST, 1.6)
        _name(axes, f"$F_{{{k}}}$", end, end - motor, THRUST)
        draw_number(axes, str(k), project(axes, 0.45 * frames.centre + 0.55 * motor))
    for frame in (frames.arm_1, *frames.base_arms):
        _arrow(axes, frame.origin, frame.point(_AXIS * reach), X_AXIS, 0.9)
    up = frames.centre + _AXIS * reach * frames.arm_1.axes[:, 2]
    _arrow(axes, frames.centre, up, Z_AXIS, 0.9)
    last = "" if robot.rotors == 2 else rf"\ldots z_{{{robot.rotors}}}"
    _name(axes, f"$z_2{last}$", up, up - frames.centre, Z_AXIS)
    for name, place in (("$O_1$", frames.motors[0]), ("$O_2$", frames.centre)):
        _name(axes, name, place, -frames.arm_1.axes[:, 2])


def _still(robot: Robot, frames: RobotFrames, names: tuple[str, ...]) -> _Still:
    """Take the points that are named.

    Args:
        robot: The robot.
        frames: Where its frames are.
        names: Names of the points; without joints the tip is the centre.

    Returns:
        The robot with these points.
    """
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
    angles = np.degrees(np.arctan2(arms[:, 1], arms[:, 0])) + 0.4 * 360.0 / len(arms)
    off = (angles - VIEW[1] + 180.0) % 360.0 - 180.0
    return float(VIEW[1] + off[np.abs(off).argmin()])


def _draw_frame(axes: Any, frame: Frame, length: float, number: str) -> None:
    """Draw x and z axis of a frame with their names.

    Args:
        axes: The 3-D axes.
        frame: The frame.
        length: Length of the axes, m.
        number: Number of the link.
    """
    for place, (letter, colour) in {0: ("x", X_AXIS), 2: ("z", Z_AXIS)}.items():
        end = frame.origin + length * frame.axes[:, place]
        _arrow(axes, frame.origin, end, colour, 0.9)
        _name(axes, f"${letter}_{{{number}}}$", end, end - frame.origin, colour)


def _arrow(axes: Any, start: Array, end: Array, colour: str, width: float) -> None:
    """Draw an arrow between two points of a scene.

    Args:
        axes: The 3-D axes.
        start, end: Positions (3) of its ends, m.
        colour: Its colour.
        width: Width of its line, points.
    """
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
        zorder=ABOVE_ALL - 1,
    )


def _name(
    axes: Any, text: str, place: Array, away: Array | tuple[float, float], colour: str = DARK
) -> None:
    """Write a name beside a point of a scene.

    Args:
        axes: The 3-D axes.
        text: The name.
        place: Position (3) of the point, m.
        away: The direction (3) of the scene in which the name is off, or how far (2) in points.
        colour: Its colour.
    """
    offset = np.array(away)
    if len(offset) == 3:
        there = axes.transData.transform(project(axes, np.array([place, place + offset])))
        offset = there[1] - there[0]
        size = float(np.hypot(*offset))
        offset = 7.0 * (offset / size if size > 1e-9 else np.array([0.0, 1.0]))
    draw_name(axes, text, project(axes, place), colour, offset)
