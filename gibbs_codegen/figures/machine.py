"""The robot in 3-D, with its frames and thrusts (the paper's Fig. 1).

It is drawn from the robot's data alone, in the style of the figures of flights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gibbs_codegen.equations.typeset import hybrid_name
from gibbs_codegen.figures import marks
from gibbs_codegen.figures.appearance import DARK, GOLD, VIEW, disc_corners, disc_radius
from gibbs_codegen.figures.robot_artists import RobotArtists, Shapes
from gibbs_codegen.figures.scene import PlacedNames, fit, project, set_scene
from gibbs_codegen.figures.style import FULL, lay_out, style
from gibbs_codegen.robot.chains import decompose
from gibbs_codegen.robot.file import AnyRobot, as_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import rotor_label
from gibbs_codegen.robot.parts.numbers import BASE
from gibbs_codegen.robot.placement import mounted_rotors
from gibbs_codegen.robot.posture import RobotFrames, default_posture, link_end, robot_frames
from gibbs_codegen.robot.rotations import Array, turn

# The robot's place in the world unless its posture is given, in its own size.
_AWAY = np.array([0.6, 0.1, 0.1])
_LONGEST_NAME = 14
# Sizes of marks that names must not lie on, points.
_NUMBER_SIZE = 15.0
# Dashes of the axes of virtual links.
DASHES = (0, (2, 1.5))


@dataclass(frozen=True)
class Subject:
    """The subject of a drawing: a robot in a posture q, and its frames there."""

    robot: Robot
    q: Array
    frames: RobotFrames

    @property
    def places(self) -> Array:
        """Positions (k, 3) of its joints, rotors and ends, m."""
        ends = [link_end(self.robot, self.frames, i + 1) for i in range(len(self.robot.links))]
        return np.array([*self.frames.points, *ends])

    @property
    def size(self) -> float:
        """Its extent, m."""
        return float(np.ptp(self.places, axis=0).max())

    @property
    def origin(self) -> Array:
        """The point (3) whose place the coordinates are, m."""
        place, layout = np.array(self.robot.base.pose.xyz), layout_of(self.robot)
        place[layout.own_axes[0]] += self.q[layout.q.position]
        return place

    @property
    def shows_world(self) -> bool:
        """True if the world's axes are near enough to be drawn, and apart from the robot."""
        return 0.0 < float(np.linalg.norm(self.origin)) <= self.size

    def attitude_axes(self) -> list[Array]:
        """Axes (3) about which the angles of the attitude turn the base; none of a quaternion."""
        layout = layout_of(self.robot)
        if layout.is_quaternion:
            return []
        axes, turned = [], np.eye(3)
        for letter, angle in zip(layout.angle_axes, self.q[layout.q.attitude], strict=True):
            axis = "xyz".index(letter)
            axes.append(turned[:, axis])
            turned = turned @ turn(axis, angle)
        return axes

    def virtual_ends(self, length: float) -> list[Array]:
        """Ends (3) of lines along these axes, away from the base and from its thrusts."""
        aside = self.frames.centre - self.origin + 1e-3 * self.frames.base.axes[:, 2]
        turns = self.attitude_axes()
        return [self.origin - length * np.copysign(1.0, axis @ aside) * axis for axis in turns]


def posture_away(robot: Robot) -> Array:
    """A posture q (nq) that shows the parts of a robot, away from the origin of the world."""
    q, layout = default_posture(robot), layout_of(robot)
    subject = Subject(robot, q, robot_frames(robot, q))
    q[layout.q.position] += subject.size * _AWAY[layout.own_axes[0]]
    return q


def draw_world(names: PlacedNames, subject: Subject, length: float) -> None:
    """Draw the world's axes, and from their origin the place that the coordinates are."""
    start = np.zeros(3)
    for axis, letter in zip(np.eye(3), "XYZ", strict=True):
        draw_axis(names, start, length * axis, marks.QUIET, 1.1)
        names.add(f"${letter}_0$", length * axis, axis, marks.QUIET)
    entries = layout_of(subject.robot).q
    moving = ", ".join(entries.names[entries.position])
    if moving and np.any(subject.origin):
        draw_axis(names, start, subject.origin, DARK, 0.9)
        place = f"$({moving})$" if "," in moving else f"${moving}$"
        names.add(place, 0.5 * subject.origin, np.array([-1.0, 0.0, 0.5]))


def draw_virtual_joints(names: PlacedNames, ends: list[Array], subject: Subject) -> None:
    """Draw the axes about which virtual links turn the base, up to their ends (3), m."""
    layout = layout_of(subject.robot)
    for angle, end in zip(layout.q.names[layout.q.attitude], ends, strict=False):
        flat = project(names.axes, np.array([subject.origin, end]))
        marks.draw_line(names.axes, flat, marks.QUIET, DASHES)
        names.line(subject.origin, end)
        text = f"${hybrid_name(angle, '').latex}$"
        names.add(text, end, end - subject.origin, marks.QUIET)


def draw_joints(names: PlacedNames, subject: Subject, length: float) -> None:
    """Draw the x axis of each link with a joint, and the joint's axis."""
    robot = subject.robot
    for i, (link, frame) in enumerate(zip(robot.links, subject.frames.links, strict=True), start=1):
        if not (link.moves or link.constrained):
            continue
        k, axis = robot.rotors + i, frame.axes @ np.array(link.axis)
        value = "d" if link.joint == "prismatic" else r"\theta"
        x = (f"$x_{{{k}}}$", marks.X_AXIS, frame.axes[:, 0])
        z = (rf"$z_{{{k}}}$: ${value}_{{{k}}}$, $\tau_{{{k}}}$", marks.Z_AXIS, axis)
        for text, colour, along in (x, z):
            end = frame.origin + length * along
            draw_axis(names, frame.origin, end, colour, 0.9)
            if link.name is None:
                names.add(text, end, end - frame.origin, colour)


def draw_rotor_thrust(
    names: PlacedNames, subject: Subject, k: int, end: Array, width: float = 1.4
) -> None:
    """Draw the thrust of rotor `k`, from 1, with its name, up to an end (3), m."""
    motor = subject.frames.motors[k - 1]
    draw_axis(names, motor, end, marks.THRUST, width)
    label = rotor_label(subject.robot, k)
    names.add(
        f"$F_{{{k}}}$" if label == str(k) else shortened(label), end, end - motor, marks.THRUST
    )


def draw_link_number(names: PlacedNames, text: str, place: Array) -> None:
    """Write the number of a link on it, at a place (3), m."""
    marks.draw_number(names.axes, text, project(names.axes, place))
    names.mark(place, _NUMBER_SIZE)


def shortened(name: str) -> str:
    """A name of the robot file as there is room for it."""
    return marks.short_name(name, _LONGEST_NAME)


def draw_axis(names: PlacedNames, start: Array, end: Array, colour: str, width: float) -> None:
    """Draw an arrow between two points (3) of a scene, m, on which names must not lie."""
    ends = project(names.axes, np.array([start, end]))
    marks.draw_arrow(names.axes, ends[0], ends[1], colour, width=width)
    names.line(start, end)


# Thrusts and frames' axes, as shares of the base arms' length or of the whole robot.
_ARROW, _AXIS, _ACROSS = 0.65, 0.5, 0.45
_SHORT_ARROW, _SHORT_AXIS = 0.2, 0.16
# Elevation from which thrusts along and across the base can be told apart, degrees; and from above.
_ELEVATION, _ABOVE = 35.0, (90.0, -90.0)
# Thrusts whose part across the line of sight is less are not drawn from above.
_SEEN = 0.3
# With fewer rotors on the base the drawing of the whole robot says all.
_FEW_ROTORS = 3
# Inches of the height: a row of drawings, heading and legend.
_ROW, _HEADING, _LEGEND = 3.4, 0.25, 0.5
# Left, bottom, width and height of a drawing, in shares of the figure.
_Room = tuple[float, float, float, float]


def machine_figure(robot: AnyRobot, q: Sequence[float] | Array | None = None) -> Figure:
    """Draw the robot as in the paper's Fig. 1, in m.

    The base is above, with arm 2 in gold: from above with its frames, and beside it from the side
    with the thrusts and, dashed, the axes of angles that turn it. The links are below, with the
    world's axes if these are near. A base with few rotors or none is drawn with its links. Rotors
    are discs normal to their thrusts; x and z axes of the frames start at the joints, y axes of
    base arms on the arms.

    Args:
        robot: The robot, or its file or name.
        q: The coordinates (nq), rad and m; `default_posture`, away from the origin, if None.

    Returns:
        The figure.

    Raises:
        UsageError: q has the wrong length.
    """
    robot = as_robot(robot)
    q = posture_away(robot) if q is None else np.asarray(q, dtype=float)
    subject = Subject(robot, q, robot_frames(robot, q))
    rows = 2 if robot.links and _is_enlarged(robot) else 1
    height = rows * _ROW + _HEADING + _LEGEND
    # The layout of the drawings: left end, width, and row from below.
    panels: list[tuple[Any, float, float, int]] = []
    if robot.links:
        panels.append((_draw_links, 0.0, 1.0, 0))
    if _is_enlarged(robot):
        panels.append((partial(_draw_base, above=True), 0.0, 0.5, rows - 1))
        panels.append((partial(_draw_base, above=False), 0.5, 0.5, rows - 1))
    with style():
        figure = Figure(figsize=(FULL, height))
        figure.suptitle(robot.name, color="0.35", parse_math=False)
        for draw, left, width, row in panels:
            axes = figure.add_subplot(projection="3d")
            room = (left, (_LEGEND + row * _ROW) / height, width, _ROW / height)
            draw(axes, subject, room).settle()
        figure.legend(handles=_keys(subject), loc="lower center", ncols=3)
        lay_out(figure)
        return figure


def _keys(subject: Subject) -> list[Line2D]:
    """Legend of the colours."""
    robot = subject.robot
    placed = any(link.pose for link in robot.links) or not robot.base.rotors
    x = "$x$ of a link or the base" if placed else "$x_i$, along the link"
    z = "axis of a joint, $z$ of the base" if placed else "$z_i$, axis of the joint"
    keys = [marks.arrow_key(marks.X_AXIS, x), marks.arrow_key(marks.Z_AXIS, z)]
    if robot.base.rotors:
        keys.insert(1, marks.arrow_key(marks.Y_AXIS, "$y_i$ of a base arm"))
        keys.append(Line2D([], [], color=GOLD, lw=3, label="base arm 2"))
    if robot.rotors:
        keys.append(marks.arrow_key(marks.THRUST, "thrust" if placed else "thrust $F_k$"))
    if subject.attitude_axes():
        label = "axis of an angle of the base"
        keys.append(Line2D([], [], color=marks.QUIET, lw=1.2, ls=DASHES, label=label))
    return keys


def _draw_links(axes: Any, subject: Subject, room: _Room) -> PlacedNames:
    """Draw the links with their frames, on the base if that has no drawings of its own."""
    robot, frames = subject.robot, subject.frames
    enlarged = _is_enlarged(robot)
    shapes = whole_shapes(robot, frames)
    if enlarged:  # Then there is of the base no more than arm 1, if it has arms.
        kept = [k for k in range(robot.rotors) if k + 1 not in base_rotors(robot)]
        spokes = shapes.spokes[:1] if robot.base.rotors else [shapes.spokes[k] for k in kept]
        shapes = replace(shapes, spokes=spokes, gold=np.empty((0, 3)), discs=shapes.discs[kept])
    places = np.concatenate([*shapes.arms, *shapes.spokes])
    size = float(np.ptp(places, axis=0).max()) or subject.size
    length = _SHORT_AXIS * size
    ends = [f.origin + length * axis for f in frames.links for axis in f.axes.T[::2]]
    shown = [k for k in range(1, robot.rotors + 1) if not enlarged or k not in base_rotors(robot)]
    thrusts = [frames.motors[k - 1] + _SHORT_ARROW * size * frames.thrusts[k - 1] for k in shown]
    world = [np.zeros(3), *(length * np.eye(3))] if subject.shows_world else []
    virtual = [] if enlarged else subject.virtual_ends(length)
    margin = 1.1 * rotor_radius(robot, frames) if shown else 0.1 * length
    low, high = _box(np.array([*places, *ends, *thrusts, *virtual]), margin)
    set_scene(axes, (np.min([low, *world], axis=0), np.max([high, *world], axis=0)), ticks=5)
    RobotArtists(axes, shapes, colour="0.45", scale=1.3)
    fit(axes, *room)
    names = PlacedNames(axes)
    names.add("$O_2$" if robot.base.rotors else "base", frames.centre, np.array([-1.0, -1.0, 0.6]))
    for k, end in zip(shown, thrusts, strict=True):
        draw_rotor_thrust(names, subject, k, end)
    draw_joints(names, subject, length)
    if subject.shows_world:
        draw_world(names, subject, length)
    draw_virtual_joints(names, virtual, subject)
    if enlarged and frames.rods:
        names.add("$O_1$", frames.motors[0], np.array([0.0, 0.0, -1.0]))
    _name_links(names, subject, 0.07 * size)
    return names


def _is_enlarged(robot: Robot) -> bool:
    """True if the base has drawings of its own."""
    few = len(base_rotors(robot)) < _FEW_ROTORS and not robot.base.rotors
    return not few or not robot.links


def _name_links(names: PlacedNames, subject: Subject, shortest: float) -> None:
    """Write names or numbers on the links longer than `shortest`, m, and names at frames."""
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


def _draw_base(axes: Any, subject: Subject, room: _Room, above: bool) -> PlacedNames:
    """Draw the base, from above or from the side.

    From above it is with the frames of its arms and the thrusts in its plane, from the side with
    all thrusts and the axes of virtual links.
    """
    robot, frames = subject.robot, subject.frames
    rotors = base_rotors(robot)
    chosen = [k - 1 for k in rotors]
    motors, thrusts = frames.motors[chosen], frames.thrusts[chosen]
    reach = float(max([*np.linalg.norm(motors - frames.centre, axis=1), 0.0])) or 1.0
    ends, virtual = motors + _ARROW * reach * thrusts, subject.virtual_ends(0.6 * reach)
    places = np.array([*motors, *ends, frames.centre, *virtual])
    # An azimuth from which no arm hides another: not along any, not half-way.
    arms, azimuth = motors - frames.centre, VIEW[1]
    if len(arms):
        angles = np.degrees(np.arctan2(arms[:, 1], arms[:, 0])) + 0.4 * 360.0 / len(arms)
        off = (angles - VIEW[1] + 180.0) % 360.0 - 180.0
        azimuth += float(off[np.abs(off).argmin()])
    view = _ABOVE if above else (_ELEVATION, azimuth)
    set_scene(axes, _box(places, 1.1 * rotor_radius(robot, frames)), view, ticks=4)
    if above:
        axes.set(zticks=[], zlabel="")
    shapes = base_shapes(robot, frames)
    RobotArtists(axes, shapes, scale=1.3)
    fit(axes, *room)
    names = PlacedNames(axes)
    for disc in shapes.discs:
        for corner in disc[::3]:
            names.line(disc.mean(axis=0), corner)
    names.add("$O_2$" if frames.rods else "base", frames.centre, -frames.base.axes[:, 2])
    if frames.rods:
        names.add("$O_1$", frames.motors[0], -frames.base.axes[:, 2])
    middles = 0.45 * frames.centre + 0.55 * motors
    for k, motor, middle in zip(rotors, motors, middles, strict=True):
        names.line(frames.centre, motor)
        if robot.base.rotors:
            draw_link_number(names, str(k), middle)
    for k, end, thrust in zip(rotors, ends, thrusts, strict=True):
        if not above or np.hypot(*thrust[:2]) > _SEEN:
            draw_rotor_thrust(names, subject, k, end, 1.6)
    if above:
        for frame in frames.rods or (frames.base,):
            draw_axis(names, frame.origin, frame.point(_AXIS * reach), marks.X_AXIS, 0.9)
        for frame, middle in zip(frames.rods, middles, strict=False):
            across = middle + _ACROSS * reach * frame.axes[:, 1]
            draw_axis(names, middle, across, marks.Y_AXIS, 0.9)
        return names
    up = frames.centre + _AXIS * reach * frames.base.axes[:, 2]
    draw_axis(names, frames.centre, up, marks.Z_AXIS, 0.9)
    last = "" if robot.base.rotors == 2 else rf"\ldots z_{{{robot.base.rotors}}}"
    names.add(f"$z_2{last}$" if frames.rods else "$z$", up, up - frames.centre, marks.Z_AXIS)
    draw_virtual_joints(names, virtual, subject)
    return names


def _box(places: Array, room: float) -> tuple[Array, Array]:
    """Lowest and highest coordinates of places with room around, never flat."""
    low, high = places.min(axis=0) - room, places.max(axis=0) + room
    least = 0.3 * float((high - low).max()) or 1.0  # A lone body has no extent at all.
    half = np.maximum(high - low, least) / 2.0
    return (low + high) / 2.0 - half, (low + high) / 2.0 + half


# Discs of rotors that are alone, as a share of the whole robot's size.
_LARGEST_DISC = 0.15


def whole_shapes(robot: Robot, frames: RobotFrames) -> Shapes:
    """Lines and discs of the whole robot; of rods the second is gold."""
    arms: list[Array] = []
    marked: list[int] = []
    drawn: set[int] = set()
    for chain in decompose(robot):
        new = [i for i in chain.path if i not in drawn]
        if not new:
            continue
        drawn.update(new)
        first = robot.parents[new[0] - 1]
        start = frames.centre if first == BASE else frames.links[first - 1].origin
        joints = [frames.links[i - 1].origin for i in new]
        place = sum(len(arm) + 1 for arm in arms)
        arms.append(np.array([start, *joints, link_end(robot, frames, new[-1])]))
        links = [robot.links[i - 1] for i in new]
        jointed = [place + k for k, e in enumerate(links, start=1) if e.moves or e.constrained]
        marked += [place, *jointed, place + len(new) + 1]
    return _shapes(robot, frames, range(1, robot.rotors + 1), arms, marked)


def base_shapes(robot: Robot, frames: RobotFrames) -> Shapes:
    """Lines and discs of the base, with its centre marked."""
    return _shapes(robot, frames, base_rotors(robot), [frames.centre[np.newaxis]], [0])


def base_rotors(robot: Robot) -> list[int]:
    """Numbers, from 1, of the rotors on the base."""
    return [k for k, rotor in enumerate(mounted_rotors(robot), start=1) if rotor.on == BASE]


def _shapes(
    robot: Robot,
    frames: RobotFrames,
    rotors: range | list[int],
    arms: list[Array],
    marked: list[int],
) -> Shapes:
    """Some rotors with their spokes, and lines along links; `arms`, `marked` as of `Shapes`."""
    bodies = [frames.base, *frames.links]
    mounted = mounted_rotors(robot)
    spokes, gold = [], np.empty((0, 3))
    for k in rotors:
        ends = np.array([frames.motors[k - 1], bodies[mounted[k - 1].on].origin])
        if k == 2 and robot.base.rotors:
            gold = ends[::-1]
        else:
            spokes.append(ends)
    chosen = [k - 1 for k in rotors]
    discs = disc_corners(frames.thrusts, rotor_radius(robot, frames))[chosen]
    return Shapes(spokes, gold, arms, discs + frames.motors[chosen, np.newaxis], marked)


def rotor_radius(robot: Robot, frames: RobotFrames) -> float:
    """Radius of the rotors' discs, m."""
    if not robot.rotors:
        return 0.0
    size = float(np.ptp(frames.points, axis=0).max()) or 1.0
    away = np.linalg.norm(frames.motors - frames.centre, axis=1)
    radius = disc_radius(frames.motors, frames.thrusts, away)
    return min(radius, _LARGEST_DISC * size) if robot.thrusters else radius
