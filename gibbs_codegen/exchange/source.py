"""What a URDF or MJCF file says, as plain data: links, joints, rotors, frames, before any welding.

Links and joints are named as in the file. Placements are in m and degrees, axes are unit vectors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from gibbs_codegen.errors import Fault, RefusedFileError
from gibbs_codegen.exchange.placement import HERE, Array, Placement
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
