"""Constraints of frames, which hold while they are active."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any, ClassVar, Literal

from gibbs_codegen.robot.parts.numbers import (
    AXES,
    LEVEL,
    ORIGIN,
    XYZ,
    Angles,
    Direction,
    Label,
    NotNegative,
    Positive,
    Sizes3,
)
from gibbs_codegen.robot.parts.part import Parameter, Part, entry, number, sized
from gibbs_codegen.robot.parts.pose import Pose

ConstraintKind = Literal["point", "frame", "distance", "loop", "plane"]
LoopJoint = Literal["fixed", "revolute", "spherical"]
# What a constraint holds, whether a frame or a loop does it.
Holding = Literal["point", "frame", "hinge", "distance", "plane"]
_TURNS = ("turn_x", "turn_y", "turn_z")
# Rows of a constraint: errors along axes of the anchor, then turns about them.
ROWS: dict[Holding, tuple[str, ...]] = {
    "point": XYZ,
    "frame": (*XYZ, *_TURNS),
    "hinge": (*XYZ, *_TURNS[:2]),
    "distance": ("distance",),
    "plane": ("normal",),
}
# Parameters of the attitude of a whole frame's anchor in the world.
QUATERNION = Parameter("1", ("qx", "qy", "qz", "qw"), name="", no_zero=True)
# What keys each type of constraint has besides those that all have.
_OF_TYPE: dict[ConstraintKind, tuple[str, ...]] = {
    "point": (),
    "frame": ("rpy_deg",),
    "distance": ("distance",),
    "loop": ("rpy_deg", "joint", "axis"),
    "plane": ("normal",),
}


@dataclass(frozen=True)
class Constraint(Part):
    """A hold of a frame against another frame of the robot, or against the world."""

    array: ClassVar[str] = "constraint"
    most: ClassVar[int] = 16
    # What its frame is to the other end, in messages.
    other_end: ClassVar[str] = "that is held itself"
    derived: ClassVar[Mapping[str, Parameter]] = {"quaternion": QUATERNION}

    # An error e gives way as ë + 2ζω ė + ω² e = 0, with the frequency ω and the damping ratio ζ.
    name: Label = entry("name of the constraint, any text", ...)
    kind: ConstraintKind = entry(
        "what is held at the anchor: the origin of the frame (point), its axes too (frame), its "
        "distance from there, a joint between two frames of the robot (loop), or the plane "
        "through it",
        ...,
        key="type",
    )
    frame: Label = entry('the frame that is held: "base", "tip" or a name of a [[frame]]', ...)
    to: Label | None = entry(
        "the frame that carries the anchor; default: the world. A loop needs it"
    )
    xyz: Sizes3 = number(
        "place of the anchor in the frame that carries it, {m}", ORIGIN, name="", ends=XYZ
    )
    rpy_deg: Angles = entry(
        "roll, pitch and yaw of the anchor in that frame, R = R_z·R_y·R_x, of a frame or a loop, "
        "degrees",
        LEVEL,
    )
    distance: Positive = sized("of a distance: the distance from the anchor, {m}", unsaid=0.0)
    normal: Direction = entry(
        'of a plane: its normal in the frame that carries it: an axis such as "x" or "-y", or '
        "[x, y, z]",
        AXES["z"],
        written="z",
    )
    joint: LoopJoint = entry("of a loop: the joint between the frames at the anchor", "fixed")
    axis: Direction = entry(
        "of a loop that is revolute: its axis, in the anchor's frame and in the one that is held",
        AXES["z"],
        written="z",
    )
    frequency: NotNegative = sized(
        "frequency with which errors go back to zero (Baumgarte), {rad/s}; 0: not at all", 0.0
    )
    damping_ratio: NotNegative = number(
        "damping ratio of that motion", 1.0, keeps_sign=True, unit="1"
    )

    def parameters(self) -> dict[str, Parameter]:
        """Numbers that can be parameters and count for its kind."""
        left_out = set() if self.kind == "distance" else {"distance"}
        left_out |= set() if self.frequency else {"frequency", "damping_ratio"}
        marks = super().parameters()
        if self.to is None and self.kind == "frame":
            marks = {"xyz": marks["xyz"], "quaternion": QUATERNION} | marks
        return {key: mark for key, mark in marks.items() if key not in left_out}

    @property
    def holds(self) -> Holding:
        """The motions that it holds, of a loop by its joint."""
        if self.kind == "loop":
            by_joint: dict[LoopJoint, Holding] = {"fixed": "frame", "spherical": "point"}
            return by_joint.get(self.joint, "hinge")
        return self.kind

    @cached_property
    def anchor(self) -> Pose:
        """The anchor: a frame fixed in that of `to`, in the world where that is None."""
        return Pose(self.xyz, self.rpy_deg)

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """Attitude of the anchor, the scalar part last, a parameter of a whole frame in the world.

        Others are structural.
        """
        return self.anchor.quaternion

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of keys that do not go with the type."""
        kind = values.get("type")
        if not isinstance(kind, str) or kind not in _OF_TYPE:
            return
        for key in dict.fromkeys(chain.from_iterable(_OF_TYPE.values())):
            if key in values and key not in _OF_TYPE[kind]:
                owners = [f'"{other}"' for other, keys in _OF_TYPE.items() if key in keys]
                yield key, f"belongs to a constraint of type {' or '.join(owners)}"
        if kind == "distance" and "distance" not in values:
            yield "distance", "missing: the distance from the anchor, m"
        if kind == "loop" and "to" not in values:
            yield "to", "missing: a loop is between two frames of the robot"
        if kind == "loop" and "axis" in values and values.get("joint") != "revolute":
            yield "axis", 'belongs to a loop that turns: give joint = "revolute"'
        if "damping_ratio" in values and values.get("frequency", 0.0) == 0.0:
            yield "damping_ratio", "needs frequency beside it, rad/s"
