"""Parts of the drawing of a robot in 3-D: the world, joints and thrusts, with their names."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.figures.marks import (
    QUIET,
    THRUST,
    X_AXIS,
    Z_AXIS,
    draw_arrow,
    draw_line,
    draw_number,
    short_name,
)
from gibbs_codegen.figures.name_places import Names
from gibbs_codegen.figures.scene import project
from gibbs_codegen.figures.skeleton import default_posture, link_end
from gibbs_codegen.figures.style import DARK
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import rotor_label
from gibbs_codegen.robot.placement import Array, turn
from gibbs_codegen.robot.posture import RobotFrames, robot_frames

# Where the robot is drawn in the world unless its posture is given, in its own size.
_AWAY = np.array([0.6, 0.1, 0.1])
_LONGEST_NAME = 14
# Sizes of marks that names must not lie on, points.
_NUMBER_SIZE = 15.0
# Of the axes of virtual links.
DASHES = (0, (2, 1.5))


@dataclass(frozen=True)
class Subject:
    """What is drawn: a robot in a posture q, and where its frames are."""

    robot: Robot
    q: Array
    frames: RobotFrames

    @property
    def places(self) -> Array:
        """Where (k, 3) its joints, rotors and ends are, m."""
        ends = [link_end(self.robot, self.frames, i + 1) for i in range(len(self.robot.links))]
        return np.array([*self.frames.points, *ends])

    @property
    def size(self) -> float:
        """Its extent, m."""
        return float(np.ptp(self.places, axis=0).max())

    @property
    def origin(self) -> Array:
        """The point (3) whose place the coordinates are, m."""
        origin: Array = self.q[layout_of(self.robot).q.position]
        return origin

    @property
    def shows_world(self) -> bool:
        """Whether the world's axes are near enough to be drawn, and apart from the robot."""
        return 0.0 < float(np.linalg.norm(self.origin)) <= self.size

    def attitude_axes(self) -> list[Array]:
        """Axes (3) about which the angles of the attitude turn the base; none of a quaternion."""
        layout = layout_of(self.robot)
        if layout.is_quaternion:
            return []
        axes, turned = [], np.eye(3)
        for letter, angle in zip(layout.attitude, self.q[layout.q.attitude], strict=True):
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
    q = default_posture(robot)
    subject = Subject(robot, q, robot_frames(robot, q))
    q[layout_of(robot).q.position] += subject.size * _AWAY
    return q


def draw_world(names: Names, subject: Subject, length: float) -> None:
    """Draw the world's axes, and from their origin the place that the coordinates are."""
    start = np.zeros(3)
    for axis, letter in zip(np.eye(3), "XYZ", strict=True):
        draw_axis(names, start, length * axis, QUIET, 1.1)
        names.add(f"${letter}_0$", length * axis, axis, QUIET)
    draw_axis(names, start, subject.origin, DARK, 0.9)
    names.add("$(x, y, z)$", 0.5 * subject.origin, np.array([-1.0, 0.0, 0.5]))


def draw_virtual_joints(names: Names, ends: list[Array], subject: Subject) -> None:
    """Draw the axes about which virtual links turn the base, up to their ends (3), m."""
    for index, end in zip(("-1", "0", "1"), ends, strict=False):
        flat = project(names.axes, np.array([subject.origin, end]))
        draw_line(names.axes, flat, QUIET, DASHES)
        names.line(subject.origin, end)
        names.add(rf"$\theta_{{{index}}}$", end, end - subject.origin, QUIET)


def draw_joints(names: Names, subject: Subject, length: float) -> None:
    """Draw the x axis of each link with a joint, and the joint's axis."""
    robot = subject.robot
    for i, (link, frame) in enumerate(zip(robot.links, subject.frames.links, strict=True), start=1):
        if not (link.moves or link.constrained):
            continue
        k, axis = robot.rotors + i, frame.axes @ np.array(link.axis)
        value = "d" if link.joint == "prismatic" else r"\theta"
        x = (f"$x_{{{k}}}$", X_AXIS, frame.axes[:, 0])
        z = (rf"$z_{{{k}}}$: ${value}_{{{k}}}$, $\tau_{{{k}}}$", Z_AXIS, axis)
        for text, colour, along in (x, z):
            end = frame.origin + length * along
            draw_axis(names, frame.origin, end, colour, 0.9)
            if link.name is None:
                names.add(text, end, end - frame.origin, colour)


def draw_rotor_thrust(
    names: Names, subject: Subject, k: int, end: Array, width: float = 1.4
) -> None:
    """Draw the thrust of rotor `k`, from 1, with its name, up to an end (3), m."""
    motor = subject.frames.motors[k - 1]
    draw_axis(names, motor, end, THRUST, width)
    label = rotor_label(subject.robot, k)
    names.add(f"$F_{{{k}}}$" if label == str(k) else shortened(label), end, end - motor, THRUST)


def draw_link_number(names: Names, text: str, place: Array) -> None:
    """Write the number of a link on it, at a place (3), m."""
    draw_number(names.axes, text, project(names.axes, place))
    names.mark(place, _NUMBER_SIZE)


def shortened(name: str) -> str:
    """A name of the robot file as there is room for it."""
    return short_name(name, _LONGEST_NAME)


def draw_axis(names: Names, start: Array, end: Array, colour: str, width: float) -> None:
    """Draw an arrow between two points (3) of a scene, m, on which names must not lie."""
    ends = project(names.axes, np.array([start, end]))
    draw_arrow(names.axes, ends[0], ends[1], colour, width=width)
    names.line(start, end)
