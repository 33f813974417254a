"""The robot in 3-D, with its frames and thrusts (the paper's Fig. 1).

It is drawn from the robot's data alone, in the style of the figures of flights.
"""

from __future__ import annotations

from collections.abc import Sequence
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
    short_name,
)
from gibbs_codegen.figures.robot_artists import RobotArtists
from gibbs_codegen.figures.scene import VIEW, fit, project, set_scene
from gibbs_codegen.figures.skeleton import (
    base_rotors,
    base_shapes,
    default_posture,
    link_end,
    rotor_radius,
    whole_shapes,
)
from gibbs_codegen.figures.style import DARK, FULL, GOLD, style
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import rotor_label
from gibbs_codegen.robot.placement import Array
from gibbs_codegen.robot.posture import RobotFrames, robot_frames

# Of the base arms' length, or of the whole robot: thrusts and frames' axes.
_ARROW, _AXIS = 0.75, 0.5
_SHORT_ARROW, _SHORT_AXIS = 0.2, 0.13
# Elevation from which thrusts along and across the base can be told apart, degrees.
_ELEVATION = 42.0
# Of fewer rotors on the base the drawing of the whole robot says all.
_FEW_ROTORS = 3
_LONGEST_NAME = 14
# How far names may be from what they name, points; one that finds no room is left out.
_OFFSETS = np.array(
    [(0, -8), (0, 9), (26, 0), (-26, 0), (24, -14), (-24, -14), (24, 14), (-24, 14)]
)


def machine_figure(robot: Robot, q: Sequence[float] | Array | None = None) -> Figure:
    """Draw the robot as in the paper's Fig. 1, in m.

    The whole robot is on the left, the base enlarged on the right, with arm 2 in gold; a base with
    few rotors or none is not drawn again. Rotors are discs normal to their thrusts; x and z axes of
    the frames start at the joints.

    Args:
        robot: The robot.
        q: The coordinates (nq), rad and m; `default_posture` if None.

    Returns:
        The figure.

    Raises:
        UsageError: q has the wrong length.
    """
    frames = robot_frames(robot, default_posture(robot) if q is None else q)
    draws: list[Any] = [_draw_whole] if robot.links else []
    if robot.base.rotors or len(base_rotors(robot)) >= _FEW_ROTORS or not robot.links:
        draws.append(_draw_base)
    with style():
        figure = Figure(figsize=((0.3 + 0.35 * len(draws)) * FULL, 3.9))
        if len(draws) == 1:
            figure.set_figwidth(0.6 * FULL)
        figure.suptitle(robot.name, color="0.35", parse_math=False)
        for column, draw in enumerate(draws):
            axes = figure.add_subplot(1, len(draws), column + 1, projection="3d")
            draw(axes, robot, frames, (column / len(draws), 1.0 / len(draws)))
        keys = _keys(robot)
        figure.legend(handles=keys, loc="lower center", ncols=4)
        # Makes the ticks while the style is ours.
        figure.draw_without_rendering()
        return figure


def _keys(robot: Robot) -> list[Line2D]:
    """What the colours mean."""
    placed = any(link.pose for link in robot.links) or not robot.base.rotors
    x = "$x$ of a link or the base" if placed else "$x_i$, along the link"
    z = "axis of a joint, $z$ of the base" if placed else "$z_i$, axis of the joint"
    keys = [arrow_key(X_AXIS, x), arrow_key(Z_AXIS, z)]
    if robot.rotors:
        keys.insert(0, arrow_key(THRUST, "thrust" if placed else "thrust $F_k$"))
    if robot.base.rotors:
        keys.insert(0, Line2D([], [], color=GOLD, lw=3, label="base arm 2"))
    return keys


def _draw_whole(axes: Any, robot: Robot, frames: RobotFrames, columns: tuple[float, float]) -> None:
    """Draw the whole robot, with the frames of the links.

    Args:
        axes: The 3-D axes.
        robot, frames: The robot, and where its frames are.
        columns: Left edge and width, in shares of the figure.
    """
    shapes = whole_shapes(robot, frames)
    tips = [link_end(robot, frames, i) for i in range(1, len(robot.links) + 1)]
    every = np.array([*frames.points, *tips])
    size = float(np.ptp(every, axis=0).max())
    length = _SHORT_AXIS * size
    ends = [f.origin + length * axis for f in frames.links for axis in f.axes.T[::2]]
    shown = _shown_thrusts(robot, single=False)
    thrusts = [frames.motors[k - 1] + _SHORT_ARROW * size * frames.thrusts[k - 1] for k in shown]
    reach = [
        float(np.linalg.norm(frames.motors[k - 1] - frames.centre)) for k in base_rotors(robot)
    ]
    room = max([*reach, 2.2 * rotor_radius(robot, frames)])
    set_scene(axes, _box(np.array([*every, *ends, *thrusts]), 0.5 * room), ticks=5)
    RobotArtists(axes, shapes, colour="0.45", scale=1.3)
    left, width = columns
    fit(axes, left + 0.01, 0.07, width, 0.86)
    for k, end in zip(shown, thrusts, strict=True):
        _draw_thrust(axes, robot, frames, k, end)
    _draw_joints(axes, robot, frames, length)
    _name(axes, "$O_2$" if robot.base.rotors else "base", frames.centre, (-12.0, 7.0))
    _name_links(axes, robot, frames, room if robot.base.rotors else 0.07 * size)


def _shown_thrusts(robot: Robot, single: bool) -> list[int]:
    """Rotors whose thrusts are drawn with the base alone, or with the whole robot."""
    base = base_rotors(robot)
    enlarged = single or len(base) >= _FEW_ROTORS or robot.base.rotors
    if single:
        return base
    return [k for k in range(1, robot.rotors + 1) if not enlarged or k not in base]


def _draw_joints(axes: Any, robot: Robot, frames: RobotFrames, length: float) -> None:
    """Draw the x axis of each link with a joint, and the joint's axis.

    Args:
        axes: The 3-D axes.
        robot, frames: The robot, and where its frames are.
        length: Length of the axes, m.
    """
    for i, (link, frame) in enumerate(zip(robot.links, frames.links, strict=True), start=1):
        if not (link.moves or link.constrained):
            continue
        axis = frame.axes @ np.array(link.axis)
        for letter, colour, along in (("x", X_AXIS, frame.axes[:, 0]), ("z", Z_AXIS, axis)):
            end = frame.origin + length * along
            _arrow(axes, frame.origin, end, colour, 0.9)
            if link.name is None:
                _name(axes, f"${letter}_{{{robot.rotors + i}}}$", end, end - frame.origin, colour)


def _name_links(axes: Any, robot: Robot, frames: RobotFrames, shortest: float) -> None:
    """Write names or numbers on the links, and names at frames, where there is room for them.

    Args:
        axes: The 3-D axes.
        robot, frames: The robot, and where its frames are.
        shortest: Length (m) that a link must exceed.
    """
    wanted: list[tuple[str, Array]] = []
    for i, (link, frame) in enumerate(zip(robot.links, frames.links, strict=True), start=1):
        end = link_end(robot, frames, i)
        if np.linalg.norm(end - frame.origin) <= shortest:
            continue
        middle = (frame.origin + end) / 2.0
        if link.name is None:
            draw_number(axes, str(robot.rotors + i), project(axes, middle))
        else:
            wanted.append((_text(link.name), middle))
    links = {link.name for link in robot.links} | {"base"}
    if "tip" in frames.named:
        _name(axes, "tip", frames.named["tip"].origin, (12.0, -5.0))
        links.add("tip")
    wanted += [(_text(n), frame.origin) for n, frame in frames.named.items() if n not in links]
    taken: list[Array] = [_pixels(axes, frames.centre) + np.array([-12.0, 7.0])]
    for text, place in wanted:
        for offset in _OFFSETS:
            spot = _pixels(axes, place) + offset
            apart = np.abs(np.array(taken) - spot) / (2.9 * len(text) + 14.0, 9.0)
            if apart.max(axis=1).min() > 1.0:
                _name(axes, text, place, (float(offset[0]), float(offset[1])))
                taken.append(spot)
                break


def _pixels(axes: Any, place: Array) -> Array:
    """Where a point of the scene is on the page, in points."""
    at: Array = axes.transData.transform(project(axes, place)) * 72.0 / axes.figure.dpi
    return at


def _draw_base(axes: Any, robot: Robot, frames: RobotFrames, columns: tuple[float, float]) -> None:
    """Draw the base, with numbers of its arms, their frames, and the thrusts.

    Args:
        axes: The 3-D axes.
        robot, frames: The robot, and where its frames are.
        columns: Left edge and width, in shares of the figure.
    """
    rotors = _shown_thrusts(robot, single=True)
    motors = frames.motors[[k - 1 for k in rotors]]
    arms = motors - frames.centre
    reach = float(max([*np.linalg.norm(arms, axis=1), 0.0])) or 1.0
    ends = motors + _ARROW * reach * frames.thrusts[[k - 1 for k in rotors]]
    places = np.concatenate([motors, ends, frames.centre[np.newaxis]])
    box = _box(places, 1.1 * rotor_radius(robot, frames))
    set_scene(axes, box, (_ELEVATION, _azimuth_between(arms)), ticks=4)
    RobotArtists(axes, base_shapes(robot, frames), scale=1.3)
    left, width = columns
    fit(axes, left + (0.03 if left else 0.02), 0.07, width - 0.04, 0.86)
    for k, motor, end in zip(rotors, motors, ends, strict=True):
        _draw_thrust(axes, robot, frames, k, end, 1.6)
        if robot.base.rotors:
            draw_number(axes, str(k), project(axes, 0.45 * frames.centre + 0.55 * motor))
    for frame in frames.rods or (frames.base,):
        _arrow(axes, frame.origin, frame.point(_AXIS * reach), X_AXIS, 0.9)
    up = frames.centre + _AXIS * reach * frames.base.axes[:, 2]
    _arrow(axes, frames.centre, up, Z_AXIS, 0.9)
    last = "" if robot.base.rotors == 2 else rf"\ldots z_{{{robot.base.rotors}}}"
    _name(axes, f"$z_2{last}$" if frames.rods else "$z$", up, up - frames.centre, Z_AXIS)
    named = [("$O_2$" if frames.rods else "base", frames.centre)]
    named += [("$O_1$", frames.motors[0])] if frames.rods else []
    for name, place in named:
        _name(axes, name, place, -frames.base.axes[:, 2])


def _draw_thrust(
    axes: Any, robot: Robot, frames: RobotFrames, k: int, end: Array, width: float = 1.4
) -> None:
    """Draw a thrust with its name.

    Args:
        axes: The 3-D axes.
        robot, frames: The robot, and where its frames are.
        k: Number of the rotor, from 1.
        end: Where (3) the arrow ends, m.
        width: Width of its line, points.
    """
    motor = frames.motors[k - 1]
    _arrow(axes, motor, end, THRUST, width)
    label = rotor_label(robot, k)
    name = f"$F_{{{k}}}$" if label == str(k) else _text(label)
    _name(axes, name, end, end - motor, THRUST)


def _text(name: str) -> str:
    return short_name(name, _LONGEST_NAME)


def _box(places: Array, room: float) -> tuple[Array, Array]:
    """Lowest and highest coordinates of places with room around, never flat."""
    low, high = places.min(axis=0) - room, places.max(axis=0) + room
    least = 0.3 * float((high - low).max()) or 1.0  # A lone body has no extent at all.
    half = np.maximum(high - low, least) / 2.0
    return (low + high) / 2.0 - half, (low + high) / 2.0 + half


def _azimuth_between(arms: Array) -> float:
    """An azimuth, in degrees, from which no arm hides another: not along any, not half-way."""
    angles = np.degrees(np.arctan2(arms[:, 1], arms[:, 0])) + 0.4 * 360.0 / max(len(arms), 1)
    off = (angles - VIEW[1] + 180.0) % 360.0 - 180.0
    return float(VIEW[1] + off[np.abs(off).argmin()]) if len(arms) else VIEW[1]


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
