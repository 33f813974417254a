"""Robots of files of other formats as trees of parts, before any welding.

Links and joints are named as in the file. Placements are in m and degrees, axes are unit vectors.

Angles that were meant to be multiples of 15°, and numbers that are rounding or CAD noise, are
snapped: a robot file's angles are structural, and 1.5708 for 90° makes terms of 1e-6 that the
equations then carry everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from gibbs_codegen.errors import Fault, RefusedFileError
from gibbs_codegen.robot.parts.base import Motion
from gibbs_codegen.robot.parts.body import RigidBody
from gibbs_codegen.robot.parts.constraint import Constraint, LoopJoint
from gibbs_codegen.robot.parts.frame import Frame
from gibbs_codegen.robot.parts.friction import Friction
from gibbs_codegen.robot.parts.link import JointLimits, Link
from gibbs_codegen.robot.parts.numbers import AXES, Vector3
from gibbs_codegen.robot.parts.pose import HERE, Pose, vector
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.robot.rotations import Array, snapped_angle

JointKind = Literal["revolute", "prismatic", "fixed", "floating", "planar"]
# The mass, kg, and inertia, kg m², of links in files whose readers take none without: far below the
# rounding of what robots weigh.
NOTHING = 1e-13
# A joint that may turn ten times either way, rad, turns a rotor or a wheel. Files that come from
# Gazebo give ±1e16 where URDF has the type continuous.
_MANY_TURNS = 20.0 * math.pi
NO_BODY = RigidBody()
NO_LINK = Link(NO_BODY)
# A joint that nothing drives.
IDLE_LINK = Link(NO_BODY, limits=JointLimits(effort=0.0))
Kind = Literal[
    "base",
    "attached",
    "locked",
    "welded",
    "snapped",
    "rotor",
    "gear",
    "motor",
    "constraint",
    "left out",
    "note",
]


class SourceFileError(RefusedFileError):
    """A URDF, xacro, MJCF or SDF file, or a file of rotors, that is rejected."""

    kind = "file to import"


def refusal(
    file: str | Path, message: str, line: int | None = None, where: str = ""
) -> SourceFileError:
    """The error, to be raised, for a single fault of a file."""
    return SourceFileError(str(file), [Fault(where, message, line)])


@dataclass(frozen=True, eq=False)
class SourceBody:
    """A link: a body in a frame at `pose` in the link's; `line` is where the file has it."""

    name: str
    body: RigidBody = NO_BODY
    pose: Pose = HERE
    line: int | None = None

    @property
    def seat(self) -> Pose:
        """The centre of mass in the link's frame, with the axes of the inertia."""
        return self.pose @ Pose(self.body.com)

    @property
    def weighs(self) -> bool:
        """True if it has mass or inertia that counts."""
        return max(self.body.mass, *map(abs, self.body.inertia)) > NOTHING


class SourceGear(NamedTuple):
    """A joint that others move, to Σ ratio times their coordinates and an offset.

    Ratios are by the names of these joints.
    """

    ratios: Mapping[Any, float]
    offset: float

    def renamed(self, names: Any) -> SourceGear:
        """The gear with other names of these joints, by those that they have."""
        return SourceGear({names[x]: ratio for x, ratio in self.ratios.items()}, self.offset)

    @property
    def words(self) -> str:
        """The joints that move it, in words."""
        names = " and ".join(self.ratios)
        return f"joint{'s' * (len(self.ratios) > 1)} {names}"


@dataclass(frozen=True, eq=False)
class SourceJoint:
    """A joint between two links, which any of both may carry as long as the tree has no root.

    The child's frame is that of the parent after `pose`, the motion about or along the axis, and
    `offset`. `link` has all else that the child as a part has of the joint that carries it, but for
    its gear, and no body. `driven` is whether a motor is known to drive it.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    pose: Pose = HERE
    link: Link = NO_LINK
    offset: Pose = HERE
    line: int | None = None
    gear: SourceGear | None = None
    driven: bool = False

    @property
    def continuous(self) -> bool:
        """True if it turns without end: ten times either way, as no joint does that is one."""
        low, high = self.link.limits.low, self.link.limits.high
        endless = (low is None or low <= -_MANY_TURNS) and (high is None or high >= _MANY_TURNS)
        return self.kind == "revolute" and endless


def dry_friction(coulomb: float) -> Friction | None:
    """Dry friction of a joint of which a file says how large it is at speed, N m or N."""
    return Friction(coulomb, coulomb) if coulomb else None


@dataclass(frozen=True, eq=False, kw_only=True)
class SourceRotor(Rotor):
    """A rotor on a link, with the joint that lets it spin, and by what it was taken for one."""

    name: str
    link: str
    joint: str | None = None
    evidence: str = ""
    line: int | None = None


WORLD = ""  # What carries a frame that no link does.


@dataclass(frozen=True, eq=False, kw_only=True)
class SourceFrame(Frame):
    """A frame on a link, such as a site, or on `WORLD`."""

    link: str = WORLD


@dataclass(frozen=True, eq=False, kw_only=True)
class SourceConstraint(Constraint):
    """A loop between two frames, by the names of their links, at most one of them on `WORLD`."""

    ends: tuple[SourceFrame, SourceFrame]

    @staticmethod
    def between(
        name: str,
        joint: LoopJoint,
        ends: tuple[SourceFrame, SourceFrame],
        axis: Vector3 = AXES["z"],
    ) -> SourceConstraint:
        """The loop that a joint closes between two frames."""
        held, anchor = (frame.name for frame in ends)
        return SourceConstraint(name, "loop", held, anchor, joint=joint, axis=axis, ends=ends)


@dataclass(frozen=True)
class Finding:
    """A line of the report: what was done with what, and why."""

    kind: Kind
    subject: str
    detail: str


@dataclass(frozen=True, eq=False)
class Source:
    """A file: its name for messages, the robot's name, and what it holds in the file's order.

    `spinning` names joints that let rotors spin, whether or not these rotors are replaced,
    `anchors` those that were left out with a root in the world, and `root` the link that all
    others hang on, once this has been checked. `motion` is what of that moves, as of a base, and
    None where nothing says so; `reason` is what says it, and `pose` where it is in the world.
    """

    file: str
    name: str
    links: dict[str, SourceBody]
    joints: tuple[SourceJoint, ...]
    rotors: tuple[SourceRotor, ...] = ()
    spinning: frozenset[str] = frozenset()
    anchors: frozenset[str] = frozenset()
    frames: tuple[SourceFrame, ...] = ()
    constraints: tuple[SourceConstraint, ...] = ()
    gravity: float = 9.81
    findings: tuple[Finding, ...] = ()
    root: str = ""
    motion: Motion | None = None
    reason: str = ""
    pose: Pose = HERE

    @cached_property
    def below(self) -> dict[str, list[SourceJoint]]:
        """The joints that each link carries, in the order of the file."""
        joints: dict[str, list[SourceJoint]] = {name: [] for name in self.links}
        for joint in self.joints:
            joints.setdefault(joint.parent, []).append(joint)
        return joints

    def reported(self, *findings: Finding, **changes: Any) -> Source:
        """The file with changes, and with findings added to those of its report."""
        return replace(self, findings=(*self.findings, *findings), **changes)

    def refused(self, message: str, line: int | None = None, where: str = "") -> SourceFileError:
        """The error, to be raised, for a fault: what is wrong, and what would be right."""
        return refusal(self.file, message, line, where)


AnyPlace = TypeVar("AnyPlace", Pose, Vector3)
SNAP = 2e-5
_SNAP_DEG = Fraction(math.degrees(SNAP))
# Lengths in m, and products of inertia in parts of the trace, that nobody has measured.
_NOISE = 1e-12


def snapped_source(source: Source) -> Source:
    """A file with every angle and axis exact; it tells of each that changes."""
    findings: list[Finding] = []

    def exact(name: str, value: AnyPlace) -> AnyPlace:
        snap: Any = snapped if isinstance(value, Pose) else _snapped_axis
        made: AnyPlace = snap(value)
        if (old := _shown(value)) != (new := _shown(made)):
            findings.append(Finding("snapped", name, f"{old} to {new}"))
        return made

    def placed(frame: SourceFrame, name: str) -> SourceFrame:
        return replace(frame, pose=exact(name, frame.pose))

    joints = []
    for joint in source.joints:
        pose, link = exact(joint.name, joint.pose), joint.link
        if joint.kind != "fixed":
            link = replace(link, axis=exact(joint.name, link.axis))
        joints.append(replace(joint, pose=pose, link=link, offset=snapped(joint.offset)))
    links = {
        name: replace(link, pose=exact(f"inertia of {name}", link.pose))
        for name, link in source.links.items()
    }
    frames = [placed(frame, frame.name) for frame in source.frames]
    rotors = [replace(r, direction=exact(r.name, r.direction)) for r in source.rotors]
    constraints = []
    for loop in source.constraints:
        held, anchor = (placed(end, loop.name) for end in loop.ends)
        axis = exact(loop.name, loop.axis)
        constraints.append(replace(loop, ends=(held, anchor), axis=axis))
    return source.reported(
        *findings,
        joints=tuple(joints),
        links=links,
        frames=tuple(frames),
        rotors=tuple(rotors),
        constraints=tuple(constraints),
        pose=exact(source.root, source.pose),
    )


def snapped(pose: Pose) -> Pose:
    """The pose, its angles that are all but multiples of 15° made exact; itself if none is."""
    roll, pitch, yaw = (snapped_angle(angle, _SNAP_DEG) for angle in pose.rpy_deg)
    exact = (roll, pitch, yaw)
    if abs(pitch) == 90 and not all(angle % 15 == 0 for angle in exact):
        # Here roll and yaw turn about one axis: what counts is their sum or difference.
        roll = snapped_angle(roll - yaw if pitch == 90 else roll + yaw, _SNAP_DEG)
        exact = (roll, pitch, Fraction(0))
    return pose if exact == pose.rpy_deg else Pose(pose.xyz, exact)


def _snapped_axis(axis: Vector3) -> Vector3:
    """The axis, or the coordinate axis that it all but is."""
    k = int(np.argmax(np.abs(axis)))
    if sum(abs(value) > SNAP for value in axis) > 1:
        return quiet(axis)
    exact = [0.0, 0.0, 0.0]
    exact[k] = math.copysign(1.0, axis[k])
    return vector(exact)


def quiet(values: Vector3) -> Vector3:
    """Lengths in m, or components of a unit vector, (3): what is below 1e-12 is set to 0."""
    return vector([0.0 if abs(value) < _NOISE else value for value in values])


def quiet_pose(pose: Pose, snap: bool) -> Pose:
    """The pose, with noise in its origin set to zero if so asked."""
    return Pose(quiet(pose.xyz), pose.rpy_deg) if snap else pose


def quiet_inertia(matrix: Array) -> Array:
    """An inertia (3, 3) whose products below 1e-12 of its trace are set to 0."""
    noise = np.abs(matrix) < _NOISE * abs(np.trace(matrix))
    return np.where(noise & ~np.eye(3, dtype=bool), 0.0, matrix)


def _shown(value: Pose | Vector3) -> str:
    """The angles of a pose in degrees, or an axis."""
    if isinstance(value, Pose):
        return "rpy_deg " + " ".join(f"{float(angle):.9g}" for angle in value.rpy_deg)
    return "axis " + " ".join(f"{number:.9g}" for number in value)


# What a robot file takes, 128 characters, less the room for a number.
_LONGEST = 120


class FreeNames:
    """Names of one kind of thing in a file, and others that are free."""

    def __init__(self, used: Iterable[str] = ()) -> None:
        self._taken = set(used)

    def __contains__(self, name: str) -> bool:
        """True if something has the name."""
        return name in self._taken

    def free(self, name: str) -> str:
        """A name as near as can be that no other thing of the kind has, which takes it.

        Its characters are printable, and XML can hold them.
        """
        readable = "".join(c if c.isprintable() else "_" for c in name).strip() or "_"
        free, number = readable, 2
        while free in self._taken:
            free, number = f"{readable[:_LONGEST]}_{number}", number + 1
        self._taken.add(free)
        return free
