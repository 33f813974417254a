"""Where a robot, its frames and its masses are at one configuration: what drawings start from.

Plain composition of the frames that a robot file fixes, with no part in the derivation, which the
emitted `positions` come from; a test compares the two.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.layout import Layout, frames_of, layout_of
from gibbs_codegen.robot.model import BASE, Body, Robot, as_rigid_body
from gibbs_codegen.robot.placement import (
    Array,
    arm_frame,
    base_centre,
    joint_frame,
    mounted_rotors,
    pose_frame,
    turn,
    turn_about,
)
from gibbs_codegen.robot.rigid_body import inertia_matrix


@dataclass(frozen=True)
class Frame:
    """Origin (3) in m and axes (3, 3), a column each, of a frame in another or in the world."""

    origin: Array
    axes: Array

    def point(self, x: float) -> Array:
        """A point (3), m, at a distance along the x axis, in the outer axes."""
        place: Array = self.origin + x * self.axes[:, 0]
        return place

    def place(self, point: Sequence[float] | Array) -> Array:
        """A point (3) of the frame seen from outside, m."""
        place: Array = self.origin + self.axes @ np.asarray(point)
        return place

    def within(self, axes: Array, origin: Array) -> Frame:
        """A frame that is given in this one, in the outer axes."""
        return Frame(self.place(origin), self.axes @ axes)


AT_ORIGIN = Frame(np.zeros(3), np.eye(3))


@dataclass(frozen=True)
class RobotFrames:
    """Frames of the base, of its rods, of all links and those that have names, in world axes.

    `base` is at the base centre, O₂, and has the base's axes; that of rod 1 is at O₁ by the paper's
    rule. `motors` (N, 3) are the seats of the rotors in m, `thrusts` (N, 3) the unit vectors of
    their thrusts. `named` are those of `frames_of`, the base's among them.
    """

    base: Frame
    rods: tuple[Frame, ...]
    links: tuple[Frame, ...]
    motors: Array
    thrusts: Array
    named: dict[str, Frame]
    moving: tuple[int, ...]

    @property
    def centre(self) -> Array:
        """The base centre (3), m."""
        return self.base.origin

    @property
    def points(self) -> Array:
        """Positions in the order of the emitted POINTS: base, rotors, joints, frames."""
        core = [self.motors[0], self.centre] if self.rods else [self.centre]
        joints = [self.links[i - 1].origin for i in self.moving]
        frames = [frame.origin for name, frame in self.named.items() if name != "base"]
        return np.array([*core, *self.motors, *joints, *frames])


def robot_frames(robot: Robot, q: Sequence[float] | Array) -> RobotFrames:
    """Frames of a robot at q, in world axes. Raises `UsageError` if q has another length."""
    layout = layout_of(robot)
    if np.shape(q) != (layout.q.size,):
        raise UsageError(f"{robot.name} has {layout.q.size} coordinates, not {np.shape(q)}")
    values = np.asarray(q, dtype=float)
    attitude = _attitude(layout, values[layout.q.attitude])
    origin = values[layout.q.position] + attitude @ base_centre(robot.base)
    return frames_on(robot, Frame(origin, attitude), values[layout.q.joints])


def frames_on(robot: Robot, base: Frame, joints: Sequence[float] | Array) -> RobotFrames:
    """Frames of a robot with a base's frame at the base centre, in the axes that it is given in.

    `joints` are those that move, rad or m.
    """
    bodies = _bodies(robot, base, joints)
    rods = tuple(base.within(*arm_frame(robot.base, k)) for k in range(1, robot.base.rotors + 1))
    rotors = mounted_rotors(robot)
    seats = [bodies[rotor.on].place(rotor.position) for rotor in rotors]
    thrusts = [bodies[rotor.on].axes @ np.array(rotor.direction) for rotor in rotors]
    named = {
        frame.name: bodies[frame.on].within(*pose_frame(frame.pose)) for frame in frames_of(robot)
    }
    return RobotFrames(
        base,
        rods,
        tuple(bodies[BASE + 1 :]),
        np.reshape(seats, (-1, 3)),
        np.reshape(thrusts, (-1, 3)),
        named,
        robot.moving,
    )


def _attitude(layout: Layout, parts: Array) -> Array:
    """Rotation matrix (3, 3) of attitude angles (3), or of a quaternion (4)."""
    attitude = np.eye(3)
    if not layout.is_quaternion:
        for letter, angle in zip(layout.attitude, parts, strict=True):
            attitude = attitude @ turn("xyz".index(letter), angle)
        return attitude
    vector, scalar = parts[:3], parts[3]
    across = np.cross(np.eye(3), vector)
    attitude += 2.0 * (across @ across + scalar * across)
    return attitude


def _bodies(robot: Robot, base: Frame, joints: Sequence[float] | Array) -> list[Frame]:
    """Frames of the base and of all links, also welded or held ones, by the numbers of the bodies.

    `base` is at the base centre, `joints` are those that move, rad or m.
    """
    values = dict(zip(robot.moving, joints, strict=True))
    frames = [base]
    for i, link in enumerate(robot.links, start=1):
        frame = frames[robot.parents[i - 1]].within(*joint_frame(robot, i))
        axis, value = np.array(link.axis), values.get(i, 0.0)
        if link.joint == "prismatic":
            frame = frame.within(np.eye(3), value * axis)
        elif value:
            frame = frame.within(turn_about(axis, value), np.zeros(3))
        frames.append(frame)
    return frames


_ROUNDING = 1e-12


@dataclass(frozen=True)
class MassProperties:
    """Mass (kg), centre of mass (m) and inertia about it (kg m²), from the base centre.

    In the base's axes; `inertia` holds xx, yy, zz, xy, xz, yz (xy = −∫ xy dm).
    """

    mass: float
    com: tuple[float, ...]
    inertia: tuple[float, ...]


def base_properties(robot: Robot) -> MassProperties:
    """Mass properties of the base: its central body and its rods."""
    return _together(_base_bodies(robot, frames_on(robot, AT_ORIGIN, _at_zero(robot))))


def whole_properties(robot: Robot, joints: Sequence[float] | Array | None = None) -> MassProperties:
    """Mass properties of the whole robot, with moving joints at rad or m, at zero if None."""
    frames = frames_on(robot, AT_ORIGIN, _at_zero(robot) if joints is None else joints)
    links = zip((link.body for link in robot.links), frames.links, strict=True)
    return _together([*_base_bodies(robot, frames), *links])


def _at_zero(robot: Robot) -> Array:
    return np.zeros(len(robot.moving))


def _base_bodies(robot: Robot, frames: RobotFrames) -> list[tuple[Body, Frame]]:
    base = robot.base
    rods = [(base.arm(k), frame) for k, frame in enumerate(frames.rods, start=1)]
    return [*rods, *([(base.body, frames.base)] if base.body else [])]


def _together(bodies: Iterable[tuple[Body, Frame]]) -> MassProperties:
    """Mass properties of bodies, each in its frame."""
    mass, moment, second, size = 0.0, np.zeros(3), np.zeros((3, 3)), 0.0
    for given, frame in bodies:
        body = as_rigid_body(given)
        place = frame.place(body.com)
        mass += body.mass
        moment += body.mass * place
        turned = frame.axes @ inertia_matrix(body.inertia) @ frame.axes.T
        second += turned + body.mass * _about_origin(place)
        size = max(size, body.length, float(np.abs(place).max()))
    com: Array = moment / mass if mass else moment
    inertia = second - mass * _about_origin(com)
    entries = rounded(inertia, float(np.abs(second).max()))[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    com = rounded(com, size)
    return MassProperties(mass, tuple(map(float, com)), tuple(map(float, entries)))


def _about_origin(place: Array) -> Array:
    """Inertia of a unit of mass at a place about the origin."""
    matrix: Array = place @ place * np.eye(3) - np.outer(place, place)
    return matrix


def rounded(values: NDArray[np.floating[Any]], size: float) -> Array:
    """Values with zeros for what is rounding, of sums of what is about as large as `size`."""
    clean: Array = np.where(np.abs(values) <= _ROUNDING * size, 0.0, values)
    return clean
