"""The robot in 3-D, with its frames and thrusts (the paper's Fig. 1).

It is drawn from the robot's data alone, in the style of the figures of flights.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gibbs_codegen.figures.machine_parts import (
    DASHES,
    Subject,
    draw_axis,
    draw_joints,
    draw_link_number,
    draw_rotor_thrust,
    draw_virtual_joints,
    draw_world,
    posture_away,
    shortened,
)
from gibbs_codegen.figures.marks import (
    QUIET,
    THRUST,
    X_AXIS,
    Y_AXIS,
    Z_AXIS,
    arrow_key,
)
from gibbs_codegen.figures.name_places import Names
from gibbs_codegen.figures.robot_artists import RobotArtists
from gibbs_codegen.figures.scene import VIEW, fit, set_scene
from gibbs_codegen.figures.skeleton import (
    base_rotors,
    base_shapes,
    link_end,
    rotor_radius,
    whole_shapes,
)
from gibbs_codegen.figures.style import FULL, GOLD, style
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.placement import Array
from gibbs_codegen.robot.posture import robot_frames

# Of the base arms' length, or of the whole robot: thrusts and frames' axes.
_ARROW, _AXIS, _ACROSS = 0.65, 0.5, 0.45
_SHORT_ARROW, _SHORT_AXIS = 0.2, 0.13
# Elevation from which thrusts along and across the base can be told apart, degrees.
_ELEVATION = 50.0
# Of fewer rotors on the base the drawing of the whole robot says all.
_FEW_ROTORS = 3
# Of the width of the figure: the drawing of the whole robot beside that of the base.
_SHARE = 0.38


def machine_figure(robot: Robot, q: Sequence[float] | Array | None = None) -> Figure:
    """Draw the robot as in the paper's Fig. 1, in m.

    The whole robot is on the left, with the world's axes if it is near their origin. The base is
    enlarged on the right, with arm 2 in gold; a base with few rotors or none is not drawn again.
    Rotors are discs normal to their thrusts; x and z axes of the frames start at the joints, y axes
    of base arms on the arms. Where angles turn the base their axes are dashed.

    Args:
        robot: The robot.
        q: The coordinates (nq), rad and m; `default_posture`, away from the origin, if None.

    Returns:
        The figure.

    Raises:
        UsageError: q has the wrong length.
    """
    q = posture_away(robot) if q is None else np.asarray(q, dtype=float)
    subject = Subject(robot, q, robot_frames(robot, q))
    draws: list[Any] = [_draw_whole] if robot.links else []
    if robot.base.rotors or len(base_rotors(robot)) >= _FEW_ROTORS or not robot.links:
        draws.append(_draw_base)
    with style():
        figure = Figure(figsize=((0.3 + 0.35 * len(draws)) * FULL, 4.3))
        if len(draws) == 1:
            figure.set_figwidth(0.6 * FULL)
        figure.suptitle(robot.name, color="0.35", parse_math=False)
        for column, draw in enumerate(draws):
            axes = figure.add_subplot(1, len(draws), column + 1, projection="3d")
            columns = (
                ((0.0, _SHARE), (_SHARE, 1.0 - _SHARE))[column] if len(draws) > 1 else (0.0, 1.0)
            )
            draw(axes, subject, columns, draw is draws[-1]).settle()
        figure.legend(handles=_keys(subject), loc="lower center", ncols=3)
        # Makes the ticks while the style is ours.
        figure.draw_without_rendering()
        return figure


def _keys(subject: Subject) -> list[Line2D]:
    """What the colours mean."""
    robot = subject.robot
    placed = any(link.pose for link in robot.links) or not robot.base.rotors
    x = "$x$ of a link or the base" if placed else "$x_i$, along the link"
    z = "axis of a joint, $z$ of the base" if placed else "$z_i$, axis of the joint"
    keys = [arrow_key(X_AXIS, x), arrow_key(Z_AXIS, z)]
    if robot.base.rotors:
        keys.insert(1, arrow_key(Y_AXIS, "$y_i$ of a base arm"))
        keys.append(Line2D([], [], color=GOLD, lw=3, label="base arm 2"))
    if robot.rotors:
        keys.append(arrow_key(THRUST, "thrust" if placed else "thrust $F_k$"))
    if subject.attitude_axes():
        label = "axis of an angle of the base"
        keys.append(Line2D([], [], color=QUIET, lw=1.2, ls=DASHES, label=label))
    return keys


def _draw_whole(axes: Any, subject: Subject, columns: tuple[float, float], is_last: bool) -> Names:
    """Draw the whole robot, with the frames of the links.

    Args:
        axes: The 3-D axes.
        subject: What is drawn.
        columns: Left edge and width, in shares of the figure.
        is_last: Whether the base is not drawn again.

    Returns:
        Its names, which have no places yet.
    """
    robot, frames, size = subject.robot, subject.frames, subject.size
    length = _SHORT_AXIS * size
    ends = [f.origin + length * axis for f in frames.links for axis in f.axes.T[::2]]
    shown = _shown_thrusts(robot, single=False)
    thrusts = [frames.motors[k - 1] + _SHORT_ARROW * size * frames.thrusts[k - 1] for k in shown]
    reach = [
        float(np.linalg.norm(frames.motors[k - 1] - frames.centre)) for k in base_rotors(robot)
    ]
    room = max([*reach, 2.2 * rotor_radius(robot, frames)])
    world = [np.zeros(3), *(length * np.eye(3))] if subject.shows_world else []
    virtual = subject.virtual_ends(length) if is_last else []
    low, high = _box(np.array([*subject.places, *ends, *thrusts, *virtual]), 0.5 * room)
    set_scene(axes, (np.min([low, *world], axis=0), np.max([high, *world], axis=0)), ticks=5)
    RobotArtists(axes, whole_shapes(robot, frames), colour="0.45", scale=1.3)
    fit(axes, columns[0] + 0.01, 0.11, columns[1], 0.83)
    names = Names(axes)
    names.add("$O_2$" if robot.base.rotors else "base", frames.centre, np.array([-1.0, -1.0, 0.6]))
    for k, end in zip(shown, thrusts, strict=True):
        draw_rotor_thrust(names, subject, k, end)
    draw_joints(names, subject, length)
    if subject.shows_world:
        draw_world(names, subject, length)
    draw_virtual_joints(names, virtual, subject)
    _name_links(names, subject, room if robot.base.rotors else 0.07 * size)
    return names


def _shown_thrusts(robot: Robot, single: bool) -> list[int]:
    """Rotors whose thrusts are drawn with the base alone, or with the whole robot."""
    base = base_rotors(robot)
    enlarged = single or len(base) >= _FEW_ROTORS or robot.base.rotors
    if single:
        return base
    return [k for k in range(1, robot.rotors + 1) if not enlarged or k not in base]


def _name_links(names: Names, subject: Subject, shortest: float) -> None:
    """Write names or numbers on the links, and names at frames.

    Args:
        names: The names of the scene.
        subject: What is drawn.
        shortest: Length (m) that a link must exceed.
    """
    robot, frames = subject.robot, subject.frames
    wanted: list[tuple[str, Array]] = []
    for i, (link, frame) in enumerate(zip(robot.links, frames.links, strict=True), start=1):
        end = link_end(robot, frames, i)
        if np.linalg.norm(end - frame.origin) <= shortest:
            continue
        names.line(frame.origin, end)
        middle = (frame.origin + end) / 2.0
        if link.name is None:
            draw_link_number(names, str(robot.rotors + i), middle)
        else:
            wanted.append((shortened(link.name), middle))
    links = {link.name for link in robot.links} | {"base"}
    wanted += [(shortened(n), frame.origin) for n, frame in frames.named.items() if n not in links]
    for text, place in wanted:
        names.add(text, place, np.array([0.0, 0.0, -1.0]))


def _draw_base(axes: Any, subject: Subject, columns: tuple[float, float], is_last: bool) -> Names:
    """Draw the base, with numbers of its arms, their frames, and the thrusts.

    Args:
        axes: The 3-D axes.
        subject: What is drawn.
        columns: Left edge and width, in shares of the figure.
        is_last: Whether this is the last drawing, which has the axes of virtual links.

    Returns:
        Its names, which have no places yet.
    """
    robot, frames = subject.robot, subject.frames
    rotors = _shown_thrusts(robot, single=True)
    motors = frames.motors[[k - 1 for k in rotors]]
    arms = motors - frames.centre
    reach = float(max([*np.linalg.norm(arms, axis=1), 0.0])) or 1.0
    ends = motors + _ARROW * reach * frames.thrusts[[k - 1 for k in rotors]]
    virtual = subject.virtual_ends(0.6 * reach) if is_last else []
    places = np.array([*motors, *ends, frames.centre, *virtual])
    box = _box(places, 1.1 * rotor_radius(robot, frames))
    set_scene(axes, box, (_ELEVATION, _azimuth_between(arms)), ticks=4)
    RobotArtists(axes, base_shapes(robot, frames), scale=1.3)
    left, width = columns
    fit(axes, left + (0.03 if left else 0.02), 0.11, width - 0.04, 0.83)
    names = Names(axes)
    named = [("$O_2$" if frames.rods else "base", frames.centre)]
    named += [("$O_1$", frames.motors[0])] if frames.rods else []
    for name, place in named:
        names.add(name, place, -frames.base.axes[:, 2])
    for k, motor, end in zip(rotors, motors, ends, strict=True):
        draw_rotor_thrust(names, subject, k, end, 1.6)
        names.line(frames.centre, motor)
        if robot.base.rotors:
            draw_link_number(names, str(k), 0.45 * frames.centre + 0.55 * motor)
    _draw_frames_of_base(names, subject, motors, reach)
    draw_virtual_joints(names, virtual, subject)
    return names


def _draw_frames_of_base(names: Names, subject: Subject, motors: Array, reach: float) -> None:
    """Draw the frames of the base's arms, or that of the base.

    Args:
        names: The names of the scene.
        subject: What is drawn.
        motors: Places (N, 3) of the motors on the base, m.
        reach: How far the motors are from the centre, m.
    """
    robot, frames = subject.robot, subject.frames
    for frame in frames.rods or (frames.base,):
        draw_axis(names, frame.origin, frame.point(_AXIS * reach), X_AXIS, 0.9)
    for frame, motor in zip(frames.rods, motors, strict=False):
        middle = 0.45 * frames.centre + 0.55 * motor
        draw_axis(names, middle, middle + _ACROSS * reach * frame.axes[:, 1], Y_AXIS, 0.9)
    up = frames.centre + _AXIS * reach * frames.base.axes[:, 2]
    draw_axis(names, frames.centre, up, Z_AXIS, 0.9)
    last = "" if robot.base.rotors == 2 else rf"\ldots z_{{{robot.base.rotors}}}"
    names.add(f"$z_2{last}$" if frames.rods else "$z$", up, up - frames.centre, Z_AXIS)


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
