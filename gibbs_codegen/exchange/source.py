"""What a URDF or MJCF file says, as plain data: links, joints, rotors, frames, before any welding.

Links and joints are named as in the file. Placements are in m and degrees, axes are unit vectors.

Angles that were meant to be multiples of 15°, and numbers that are rounding or CAD noise, are
snapped: a robot file's angles are structural, and 1.5708 for 90° makes terms of 1e-6 that the
equations then carry everywhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Literal

import numpy as np

from gibbs_codegen.errors import Fault, RefusedFileError
from gibbs_codegen.exchange.placement import HERE, Array, Placement, vector
from gibbs_codegen.robot.model import AXES, JointLimits, Passive, Vector3

SourceKind = Literal["revolute", "prismatic", "fixed", "floating", "planar"]
# A joint that may turn ten times either way, rad, turns a rotor or a wheel. Files that come from
# Gazebo give ±1e16 where URDF has the type continuous.
_MANY_TURNS = 20.0 * math.pi
NO_PASSIVE, NO_LIMITS = Passive(), JointLimits()
Kind = Literal["base", "locked", "welded", "snapped", "rotor", "left out", "note"]


def endless(limits: JointLimits) -> bool:
    """Whether the limits of a revolute joint let it turn without end."""
    low, high = limits.low, limits.high
    return (low is None or low <= -_MANY_TURNS) and (high is None or high >= _MANY_TURNS)


class SourceFileError(RefusedFileError):
    """A URDF, xacro or MJCF file, or a file of rotors, that is rejected."""

    kind = "file to import"


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass in kg, its frame in the link's, and the inertia (3, 3) about that frame in kg m²."""

    mass: float = 0.0
    pose: Placement = HERE
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True, eq=False)
class SourceLink:
    """A link; `line` is where the file has it, if that is known."""

    name: str
    inertial: Inertial = Inertial()
    line: int | None = None


@dataclass(frozen=True, eq=False)
class SourceJoint:
    """A joint between two links.

    The child's frame is that of the parent after `pose`, the motion about or along `axis`, and
    `offset`. `continuous` tells a revolute joint that turns without end.
    """

    name: str
    kind: SourceKind
    parent: str
    child: str
    pose: Placement = HERE
    axis: Vector3 = AXES["z"]
    offset: Placement = HERE
    passive: Passive = NO_PASSIVE
    limits: JointLimits = NO_LIMITS
    continuous: bool = False
    line: int | None = None


@dataclass(frozen=True, eq=False)
class SourceRotor:
    """A rotor on a link: as `Rotor`, with the joint that lets it spin, and by what it was found."""

    name: str
    on: str
    position: Vector3 = (0.0, 0.0, 0.0)
    direction: Vector3 = AXES["z"]
    drag: float = 0.0
    limits: tuple[float, float] | None = None
    time_constant: float | None = None
    joint: str | None = None
    found_by: str = ""


@dataclass(frozen=True, eq=False)
class SourceFrame:
    """A named frame on a link, such as a site."""

    name: str
    on: str
    pose: Placement = HERE


@dataclass(frozen=True)
class Told:
    """A line of the report: what was done with what, and why."""

    kind: Kind
    subject: str
    detail: str


@dataclass(frozen=True, eq=False)
class Source:
    """A file: its name for messages, the robot's name, and what it holds in the file's order.

    `spinning` names joints that let rotors spin, whether or not these rotors are replaced, and
    `anchors` those that were left out with a root in the world.
    """

    file: str
    name: str
    links: dict[str, SourceLink]
    joints: tuple[SourceJoint, ...]
    rotors: tuple[SourceRotor, ...] = ()
    spinning: frozenset[str] = frozenset()
    anchors: frozenset[str] = frozenset()
    frames: tuple[SourceFrame, ...] = ()
    gravity: float = 9.81
    told: tuple[Told, ...] = ()

    def refused(self, message: str, line: int | None = None, where: str = "") -> SourceFileError:
        """The error, to be raised, for a fault: what is wrong, and what would be right."""
        return SourceFileError(self.file, [Fault(where, message, line)])


SNAP = 2e-5
_SNAP_DEG = Fraction(math.degrees(SNAP))
# Lengths in m, and products of inertia in parts of the trace, that nobody has measured.
_NOISE = 1e-12


def snapped_source(source: Source) -> Source:
    """A file with every angle and axis exact; it tells of each that changes."""
    told = list(source.told)

    def tell(name: str, before: Placement | Vector3, after: Placement | Vector3) -> None:
        if (old := _shown(before)) != (new := _shown(after)):
            told.append(Told("snapped", name, f"{old} to {new}"))

    joints = [_snapped_joint(joint) for joint in source.joints]
    for joint, exact in zip(source.joints, joints, strict=True):
        tell(joint.name, joint.pose, exact.pose)
        tell(joint.name, joint.axis, exact.axis)
    links = {
        name: replace(link, inertial=replace(link.inertial, pose=snapped(link.inertial.pose)))
        for name, link in source.links.items()
    }
    for name, link in source.links.items():
        tell(f"inertia of {name}", link.inertial.pose, links[name].inertial.pose)
    frames = [replace(frame, pose=snapped(frame.pose)) for frame in source.frames]
    for frame, made in zip(source.frames, frames, strict=True):
        tell(frame.name, frame.pose, made.pose)
    rotors = [replace(rotor, direction=_snapped_axis(rotor.direction)) for rotor in source.rotors]
    for rotor, turned in zip(source.rotors, rotors, strict=True):
        tell(rotor.name, rotor.direction, turned.direction)
    return replace(
        source,
        joints=tuple(joints),
        links=links,
        frames=tuple(frames),
        rotors=tuple(rotors),
        told=tuple(told),
    )


def _snapped_joint(joint: SourceJoint) -> SourceJoint:
    axis = joint.axis if joint.kind == "fixed" else _snapped_axis(joint.axis)
    return replace(joint, pose=snapped(joint.pose), offset=snapped(joint.offset), axis=axis)


def snapped(pose: Placement) -> Placement:
    """The pose, its angles that are all but multiples of 15° made exact; itself if none is."""
    roll, pitch, yaw = map(_snapped_angle, pose.rpy_deg)
    exact = (roll, pitch, yaw)
    if abs(pitch) == 90 and not all(angle % 15 == 0 for angle in exact):
        # Here roll and yaw turn about one axis: what counts is their sum or difference.
        roll = _snapped_angle(roll - yaw if pitch == 90 else roll + yaw)
        exact = (roll, pitch, Fraction(0))
    return pose if exact == pose.rpy_deg else Placement(pose.xyz, exact)


def _snapped_angle(angle: Fraction) -> Fraction:
    multiple = Fraction(15 * round(angle / 15))
    return multiple if abs(angle - multiple) <= _SNAP_DEG else angle


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


def quiet_inertia(matrix: Array) -> Array:
    """An inertia (3, 3) whose products below 1e-12 of its trace are set to 0."""
    noise = np.abs(matrix) < _NOISE * abs(np.trace(matrix))
    found: Array = np.where(noise & ~np.eye(3, dtype=bool), 0.0, matrix)
    return found


def _shown(value: Placement | Vector3) -> str:
    """The angles of a pose in degrees, or an axis."""
    if isinstance(value, Placement):
        return "rpy_deg " + " ".join(f"{float(angle):.9g}" for angle in value.rpy_deg)
    return "axis " + " ".join(f"{number:.9g}" for number in value)
