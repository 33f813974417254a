"""The lines and discs that a robot of any form is drawn with, and a posture that shows its parts.

A link is a line from joint to joint; where nothing follows, to its end: along x by its length, or
else to its farthest frame or rotor, or to its centre of mass.
"""

from __future__ import annotations

import numpy as np

from gibbs_codegen.figures.robot_artists import Shapes, disc_corners, disc_radius
from gibbs_codegen.robot.chains import decompose
from gibbs_codegen.robot.layout import frames_of, layout_of
from gibbs_codegen.robot.model import BASE, Link, Robot, as_rigid_body
from gibbs_codegen.robot.placement import Array, mounted_rotors
from gibbs_codegen.robot.posture import RobotFrames, robot_frames

# Of the whole robot's size: discs of rotors that are alone.
_LARGEST_DISC = 0.15


def default_posture(robot: Robot) -> Array:
    """Coordinates q (nq) in which a robot shows its parts.

    The base is level, with the origin of the coordinates at the world's. Revolute joints are bent
    by 40° or 140°, those of links with rotors by 40° only, within their limits, each so that the
    ends of the arms move down and away. Prismatic ones stand in the middle of their limits, or at
    half of the longest link.
    """
    layout = layout_of(robot)
    q = np.array(layout.neutral)
    for place, i in 2 * list(zip(layout.q.joint_places, robot.moving, strict=True)):
        values, scores = _bends(robot, i), []
        for q[place] in values:
            frames = robot_frames(robot, q)
            far = np.array([link_end(robot, frames, leaf) for leaf in _leaves(robot)])
            away = np.linalg.norm(far - frames.centre, axis=1)
            scores.append(float(np.sum(far[:, 2] - away)))
        q[place] = values[int(np.argmin(np.round(scores, 9)))]
    return q


def _bends(robot: Robot, i: int) -> list[float]:
    """Values that the joint of a link may have in a drawing; of equally good ones the first."""
    link = robot.links[i - 1]
    low = -np.inf if link.limits.low is None else link.limits.low
    high = np.inf if link.limits.high is None else link.limits.high
    if link.joint == "prismatic":
        longest = max(link.body.length for link in robot.links)
        middle = (low + high) / 2.0
        return [middle if np.isfinite(middle) else float(np.clip(longest / 2.0, low, high))]
    carries = any(rotor.on == i for rotor in robot.thrusters)
    angles = [-40.0, 40.0] if carries else [-40.0, 40.0, -140.0, 140.0]
    return [float(np.clip(angle, low, high)) for angle in np.deg2rad(angles)]


def _leaves(robot: Robot) -> list[int]:
    """Numbers of the links that carry no other."""
    return [i for i in range(1, len(robot.links) + 1) if i not in robot.parents]


def link_end(robot: Robot, frames: RobotFrames, i: int) -> Array:
    """Where (3) the drawing of link `i`, from 1, ends in the world, m."""
    link, frame = robot.links[i - 1], frames.links[i - 1]
    children = [k for k in range(1, len(robot.links) + 1) if robot.parents[k - 1] == i]
    if children:
        return frames.links[children[0] - 1].origin
    if link.body.length:
        return frame.point(link.body.length)
    placed = [frames.named[found.name].origin for found in frames_of(robot) if found.on == i]
    rotors = zip(mounted_rotors(robot), frames.motors, strict=True)
    placed += [seat for rotor, seat in rotors if rotor.on == i]
    placed.append(frame.place(as_rigid_body(link.body).com))
    return max(placed, key=lambda place: float(np.linalg.norm(place - frame.origin)))


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
        jointed = [place + k for k, i in enumerate(new, start=1) if _has_joint(robot.links[i - 1])]
        marked += [place, *jointed, place + len(new) + 1]
    return _shapes(robot, frames, range(1, robot.rotors + 1), arms, marked)


def base_shapes(robot: Robot, frames: RobotFrames) -> Shapes:
    """Lines and discs of the base, with its centre marked."""
    return _shapes(robot, frames, base_rotors(robot), [frames.centre[np.newaxis]], [0])


def base_rotors(robot: Robot) -> list[int]:
    """Numbers, from 1, of the rotors on the base."""
    return [k for k, rotor in enumerate(mounted_rotors(robot), start=1) if rotor.on == BASE]


def _has_joint(link: Link) -> bool:
    return link.moves or link.constrained


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
    found = disc_radius(frames.motors, frames.thrusts, away)
    return min(found, _LARGEST_DISC * size) if robot.thrusters else found
