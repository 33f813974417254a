"""Wheels of the base, which the ground turns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

from gibbs_codegen.files.table import Place
from gibbs_codegen.robot.parts.body import Inertia, RigidBody
from gibbs_codegen.robot.parts.gear import Rolling
from gibbs_codegen.robot.parts.link import JointLimits, Link, Passive
from gibbs_codegen.robot.parts.numbers import (
    AXES,
    BASE,
    NO_ANGLE,
    Direction,
    Label,
    NotNegative,
    Sizes3,
)
from gibbs_codegen.robot.parts.part import again, entry, number
from gibbs_codegen.robot.parts.pose import Pose

MAX_WHEELS = 16
# What a wheel has that turns with a joint.
_OF_JOINTS = ("axis", "inertia_across", "damping", "armature", "effort")


@dataclass(frozen=True)
class Disc(RigidBody):
    """A body of a wheel: alike all around its axis y, with two moments of inertia."""

    inertia: Inertia = number(
        "inertia across, about, across the axis, {kg m^2}",
        (0.0,) * 6,
        ends=("across", "axial", "across", "xy", "xz", "yz"),
    )


@dataclass(frozen=True, kw_only=True)
class WheelTable(Rolling):
    """A wheel of the base that rolls on level ground without slip, or a caster."""

    elsewhere: ClassVar[str] = "; all wheels are on the base and do not steer"
    name: Label = entry("name of the wheel, any text", ...)
    joint: Label | None = entry("name of its angle in q; default: none, as of a caster")
    xyz: Sizes3 = entry("place of the centre in the frame of the base, m", ...)
    axis: Direction = entry("level axis of the angle, on the base", AXES["y"], written="y")
    mass: NotNegative = entry("mass of the wheel, kg", 0.0)
    inertia: NotNegative = entry("inertia of the wheel about its axis, kg m²", 0.0)
    inertia_across: NotNegative | None = entry(
        "inertia about diameters, kg m²; default: half of inertia"
    )
    damping: NotNegative = again(Passive, "damping")
    armature: NotNegative = again(Passive, "armature")
    effort: NotNegative | None = entry("greatest torque about the axis, N m; default: none")

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of keys of other wheels than these."""
        if values.get("joint") is None:
            for key in _OF_JOINTS:
                if key in values:
                    yield key, "applies to a wheel that turns; give it a joint, or leave this out"

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """The fault of an axis that is not level."""
        if self.axis[2] != 0.0:
            yield (
                ("axis",),
                "must be level; wheels of a base cannot lean or turn about a vertical axis",
            )

    def link(self) -> Link:
        """The wheel as a link on the base, with its axis y and x ahead."""
        x, y, _ = self.axis
        # Without the last digits, which are rounding: many angles of wheels are exact.
        yaw = Fraction(repr(round(math.degrees(math.atan2(0.0 - x, y)), 12)))
        across = self.inertia / 2.0 if self.inertia_across is None else self.inertia_across
        return Link(
            Disc(0.0, self.mass, inertia=(across, self.inertia, across, 0.0, 0.0, 0.0)),
            Pose(self.xyz, (NO_ANGLE, NO_ANGLE, yaw)),
            Passive(damping=self.damping, armature=self.armature),
            JointLimits(effort=self.effort),
            name=self.name,
            parent=BASE,
            axis=AXES["y"],
            joint="revolute" if self.joint else "fixed",
            coordinate=self.joint,
            rolling=Rolling(radius=self.radius),
        )
