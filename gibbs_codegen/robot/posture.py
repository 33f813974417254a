"""Frames and masses of a robot at one configuration, from which drawings start.

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
from gibbs_codegen.robot import placement
from gibbs_codegen.robot.layout import frames_of, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import Body, as_rigid_body, inertia_matrix
from gibbs_codegen.robot.parts.constraint import Constraint
from gibbs_codegen.robot.parts.numbers import BASE, ORIGIN
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.rotations import Array, turn, turn_about, turn_of_quaternion


@dataclass(frozen=True)
class PlacedFrame:
    """Origin (3) in m and axes (3, 3), a column each, of a frame in another or in the world."""

    origin: Array
    axes: Array

    def point(self, x: float) -> Array:
        """A point (3), m, at a distance along the x axis, in the outer axes."""
        return self.origin + x * self.axes[:, 0]

    def place(self, point: Sequence[float] | Array) -> Array:
        """A point (3) of the frame seen from outside, m."""
        return self.origin + self.axes @ np.asarray(point)

    def within(self, axes: Array, origin: Sequence[float] | Array = ORIGIN) -> PlacedFrame:
        """A frame by its axes (3, 3) and origin (3), m, in this one, in the outer axes."""
        return PlacedFrame(self.place(origin), self.axes @ axes)

    def carried(self, pose: Pose) -> PlacedFrame:
        """A frame by its pose in this one, in the outer axes."""
        return self.within(pose.matrix, pose.xyz)


AT_ORIGIN = PlacedFrame(np.zeros(3), np.eye(3))


@dataclass(frozen=True)
class RobotFrames:
    """Frames of the base, of its rods, of all links and those that have names, in world axes.

    `base` is at the base centre, O₂, and has the base's axes; that of rod 1 is at O₁ by the paper's
    rule. `motors` (N, 3) are the seats of the rotors in m, `thrusts` (N, 3) the unit vectors of
    their thrusts. `named` are those of `frames_of`, the base's among them.
    """

    base: PlacedFrame
    rods: tuple[PlacedFrame, ...]
    links: tuple[PlacedFrame, ...]
    motors: Array
    thrusts: Array
    named: dict[str, PlacedFrame]
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
    attitude, parts = np.eye(3), values[layout.q.attitude]
    if layout.is_quaternion:
        attitude = turn_of_quaternion(*parts)
    else:
        for letter, angle in zip(layout.angle_axes, parts, strict=True):
            attitude = attitude @ turn("xyz".index(letter), angle)
    pose = robot.base.pose
    origin = attitude @ placement.base_centre(robot.base) + np.array(pose.xyz)
    for name, value in zip(
        layout.q.names[layout.q.position], values[layout.q.position], strict=True
    ):
        origin["xyz".index(name)] += value
    base = PlacedFrame(origin, attitude @ pose.matrix)
    turned = values[layout.q.joints], values[layout.q.angles]
    return frames_on(robot, base, np.concatenate(turned))


def frames_on(robot: Robot, base: PlacedFrame, joints: Sequence[float] | Array) -> RobotFrames:
    """Frames of a robot with a base's frame at the base centre, in the axes that it is given in.

    `joints` are those with coordinates, rad or m, and after them angles of wheels.
    """
    values = robot.positions(joints)
    bodies = [base]  # By their numbers, also welded or held ones.
    for i, link in enumerate(robot.links, start=1):
        frame = bodies[robot.parents[i - 1]].carried(placement.joint_pose(robot, i))
        axis, value = np.array(link.axis), values.get(i, 0.0)
        if link.joint == "prismatic":
            frame = frame.within(np.eye(3), value * axis)
        elif value:
            frame = frame.within(turn_about(axis, value))
        bodies.append(frame)
    rods = tuple(
        base.carried(placement.arm_pose(robot.base, k)) for k in range(1, robot.base.rotors + 1)
    )
    rotors = placement.mounted_rotors(robot)
    seats = [bodies[rotor.on].place(rotor.position) for rotor in rotors]
    thrusts = [bodies[rotor.on].axes @ np.array(rotor.direction) for rotor in rotors]
    named = {frame.name: bodies[frame.on].carried(frame.pose) for frame in frames_of(robot)}
    return RobotFrames(
        base,
        rods,
        tuple(bodies[BASE + 1 :]),
        np.reshape(seats, (-1, 3)),
        np.reshape(thrusts, (-1, 3)),
        named,
        tuple(robot.gearing),
    )


def frames_at_origin(robot: Robot, joints: Sequence[float] | Array | None = None) -> RobotFrames:
    """Frames from the base centre in the base's axes; `joints` that move are at zero if None."""
    return frames_on(robot, AT_ORIGIN, np.zeros(len(robot.moving)) if joints is None else joints)


def default_posture(robot: Robot) -> Array:
    """Coordinates q (nq) in which a robot shows its parts.

    The base is where nothing has moved, level if it moves freely. Revolute joints are bent
    by 40° or 140°, those of links with rotors by 40° only, strictly within their limits, each so
    that the ends of the arms move down and away; what does not fly moves them up from its base.
    Prismatic ones stand in the middle of their
    limits, or at half of the longest link. From there joints move to where loops close, if they do.
    """
    layout = layout_of(robot)
    q, bends = np.array(layout.neutral), {i: _bends(robot, i) for i in robot.moving}
    places = dict(zip(robot.moving, layout.q.joint_places, strict=True))
    for i, place in places.items():
        q[place] = 0.0 if robot.links[i - 1].joint == "revolute" else bends[i][0]
    frames = robot_frames(robot, q)
    leaves = [i for i in range(1, len(robot.links) + 1) if i not in robot.parents]
    carried: dict[int, list[int]] = {}  # A link, and all that carry it.
    for i, parent in enumerate(robot.parents, start=1):
        carried[i] = [i, *carried.get(parent, ())]
    # What a joint turns: the joints (n) after it with their axes, and the ends of the arms.
    joints = np.reshape([frames.links[i - 1].origin for i in carried], (-1, 3))
    turned = [frames.links[i - 1].axes @ np.array(robot.links[i - 1].axis) for i in carried]
    axes = np.reshape(turned, (-1, 3))
    ends = np.reshape([link_end(robot, frames, leaf) for leaf in leaves], (-1, 3))
    flies = robot.base.moves_freely or robot.rotors
    height = np.array([0.0, 0.0, 1.0]) if flies else -frames.base.axes[:, 2]
    for i in 2 * [i for i in robot.moving if robot.links[i - 1].joint == "revolute"]:
        after = np.array([i in way for way in carried.values()])
        moved = np.array([i in carried[leaf] for leaf in leaves])
        origin, axis = joints[i - 1].copy(), axes[i - 1].copy()
        turns = [turn_about(axis, value - q[places[i]]) for value in bends[i]]
        far = [origin + (ends[moved] - origin) @ turn.T for turn in turns]
        away = [np.linalg.norm(seats - frames.centre, axis=1) for seats in far]
        scores = [np.sum(e @ height - length) for e, length in zip(far, away, strict=True)]
        best = int(np.argmin(np.round(scores, 9)))
        q[places[i]], ends[moved] = bends[i][best], far[best]
        joints[after] = origin + (joints[after] - origin) @ turns[best].T
        axes[after] = axes[after] @ turns[best].T
    return _closed(robot, q)


def closed_loops(robot: Robot) -> dict[Constraint, list[int]]:
    """Loops of mechanisms, which move with these closed, and numbers of joints in each.

    Those are joints that nothing drives.
    """
    on = {frame.name: frame.on for frame in frames_of(robot)}
    ways: list[set[int]] = [set()]  # The links that carry each body, and itself.
    for i, parent in enumerate(robot.parents, start=1):
        ways.append({i, *ways[parent]})
    loops = {
        loop: [
            i
            for i in sorted(ways[on[loop.frame]] ^ ways[on[loop.to or ""]])
            if i in robot.moving and robot.links[i - 1].limits.effort == 0.0
        ]
        for loop in robot.constraints
        if loop.kind == "loop"
    }
    return {loop: free for loop, free in loops.items() if free}


def _closed(robot: Robot, q: Array) -> Array:
    """Coordinates (nq) near others, within limits of joints, in which loops close, if any do."""
    if not (loops := closed_loops(robot)):
        return q
    from scipy.optimize import least_squares  # Late, as SciPy takes long to import.

    places = np.array(layout_of(robot).q.joint_places)
    ends = [robot.links[i - 1].limits for i in robot.moving]
    low = np.array([-np.inf if end.low is None else end.low for end in ends])
    high = np.array([np.inf if end.high is None else end.high for end in ends])
    # Joints without a range stay, since bounds must differ.
    places, low, high = (values[low < high] for values in (places, low, high))

    def at(joints: Array) -> Array:
        moved = q.copy()
        moved[places] = joints
        return moved

    def errors(joints: Array) -> Array:
        frames, off = robot_frames(robot, at(joints)).named, list[Array]()
        for loop in loops:
            held, anchor = frames[loop.frame], frames[loop.to or ""].carried(loop.anchor)
            off.append(held.origin - anchor.origin)
            axes = {"fixed": np.eye(3), "revolute": np.array([loop.axis])}.get(loop.joint)
            for axis in () if axes is None else axes:
                off.append(np.cross(held.axes @ axis, anchor.axes @ axis))
        return np.concatenate(off)

    exactly = dict.fromkeys(("xtol", "ftol", "gtol"), 1e-15)
    solution = least_squares(errors, q[places], bounds=(low, high), **exactly)
    # Rounded, since no bit of a module may depend on the machine.
    return np.round(at(solution.x), 7) + 0.0 if np.abs(solution.fun).max() < _CLOSED else q


# Loops are closed where their errors, m and rad, are less.
_CLOSED = 1e-9
# How far from its limits a joint is at least, as a share of its range.
_MARGIN = 0.1


def _bends(robot: Robot, i: int) -> list[float]:
    """Values that the joint of a link may have in a drawing; of equally good ones the first."""
    link = robot.links[i - 1]
    low = -np.inf if link.limits.low is None else link.limits.low
    high = np.inf if link.limits.high is None else link.limits.high
    longest = max(link.body.length for link in robot.links)
    bounded, unit = np.isfinite(high - low), 1.0
    carries = any(rotor.on == i for rotor in robot.thrusters)
    values = np.deg2rad([-40.0, 40.0] if carries else [-40.0, 40.0, -140.0, 140.0])
    if link.joint == "prismatic":
        values = np.array([(low + high) / 2.0 if bounded else longest / 2.0])
        unit = longest or 1.0
    margin = _MARGIN * (high - low if bounded else unit)
    return [float(np.clip(value, low + margin, high - margin)) for value in values]


def link_end(robot: Robot, frames: RobotFrames, i: int) -> Array:
    """The end (3) of the drawing of link `i`, from 1, in the world, m."""
    link, frame = robot.links[i - 1], frames.links[i - 1]
    children = [k for k in range(1, len(robot.links) + 1) if robot.parents[k - 1] == i]
    if children:
        return frames.links[children[0] - 1].origin
    if link.body.length:
        return frame.point(link.body.length)
    placed = [frames.named[f.name].origin for f in frames_of(robot) if f.on == i]
    rotors = zip(placement.mounted_rotors(robot), frames.motors, strict=True)
    placed += [seat for rotor, seat in rotors if rotor.on == i]
    placed.append(frame.place(as_rigid_body(link.body).com))
    return max(placed, key=lambda place: float(np.linalg.norm(place - frame.origin)))


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
    return _sum_of_bodies(base_bodies(robot, frames_at_origin(robot)))


def whole_properties(robot: Robot, joints: Sequence[float] | Array | None = None) -> MassProperties:
    """Mass properties of the whole robot, with moving joints at rad or m, at zero if None."""
    frames = frames_at_origin(robot, joints)
    links = zip((link.body for link in robot.links), frames.links, strict=True)
    return _sum_of_bodies([*base_bodies(robot, frames), *links])


def carried_inertia(robot: Robot, i: int) -> float:
    """Inertia, kg m², of all that the joint of link `i` moves, about its axis, joints at zero."""
    frames, carried = frames_at_origin(robot).links, {i}
    for k, parent in enumerate(robot.parents, start=1):
        if parent in carried:
            carried.add(k)
    whole = _sum_of_bodies([(robot.links[k - 1].body, frames[k - 1]) for k in sorted(carried)])
    axis = frames[i - 1].axes @ np.array(robot.links[i - 1].axis)
    arm = np.cross(axis, np.array(whole.com) - frames[i - 1].origin)
    return float(axis @ inertia_matrix(whole.inertia) @ axis + whole.mass * (arm @ arm))


def carrier_inertia(robot: Robot, i: int) -> float:
    """Inertia, kg m², about link `i`'s axis of the rigid body that carries it, about its centre."""
    frames = frames_at_origin(robot)
    carrier = robot.rigid[robot.parents[i - 1]]
    bodies = [(link.body, frame) for link, frame in zip(robot.links, frames.links, strict=True)]
    rigid = [body for body, on in zip(bodies, robot.rigid[1:], strict=True) if on == carrier]
    whole = _sum_of_bodies([*rigid, *(base_bodies(robot, frames) if carrier == BASE else [])])
    axis = frames.links[i - 1].axes @ np.array(robot.links[i - 1].axis)
    return float(axis @ inertia_matrix(whole.inertia) @ axis)


def base_bodies(robot: Robot, frames: RobotFrames) -> list[tuple[Body, PlacedFrame]]:
    """The rods of the base and its central body, each with its frame."""
    base = robot.base
    rods = [(base.arm(k), frame) for k, frame in enumerate(frames.rods, start=1)]
    return [*rods, *([(base.body, frames.base)] if base.body else [])]


def _sum_of_bodies(bodies: Iterable[tuple[Body, PlacedFrame]]) -> MassProperties:
    """Mass properties of bodies, each in its frame."""
    mass, moment, second, size = 0.0, np.zeros(3), np.zeros((3, 3)), 0.0
    for solid, frame in bodies:
        body = as_rigid_body(solid)
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
    return place @ place * np.eye(3) - np.outer(place, place)


def rounded(values: NDArray[np.floating[Any]], size: float) -> Array:
    """Values with zeros for what is rounding, of sums of what is about as large as `size`."""
    return np.where(np.abs(values) <= _ROUNDING * size, 0.0, values)
