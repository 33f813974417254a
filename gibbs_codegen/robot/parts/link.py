"""Links, and the joints that carry them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import BeforeValidator, GetPydanticSchema

from gibbs_codegen.files.table import Flag, fault
from gibbs_codegen.robot.parts.body import NOT_BOTH_BODIES, RIGID_NEEDS_MASS, Body, BodyKeys
from gibbs_codegen.robot.parts.friction import Friction
from gibbs_codegen.robot.parts.gear import Gear, Rolling
from gibbs_codegen.robot.parts.motor import Motor
from gibbs_codegen.robot.parts.numbers import (
    AXES,
    NO_ANGLE,
    Angle,
    Direction,
    Label,
    NotNegative,
    OpenRange,
    Size,
)
from gibbs_codegen.robot.parts.part import Part, entry, number, taken
from gibbs_codegen.robot.parts.pose import Pose, Posed
from gibbs_codegen.robot.parts.servo import Servo

JointKind = Literal["revolute", "prismatic"]
LinkKind = Literal["revolute", "prismatic", "fixed"]
JOINT_KINDS: tuple[JointKind, ...] = get_args(JointKind)
LINK_KINDS: tuple[LinkKind, ...] = get_args(LinkKind)
MAX_LINKS = 64
DH_KEYS = ("alpha_deg", "a", "d", "theta_deg")
POSE_KEYS = ("xyz", "rpy_deg")


def _not_continuous(kind: object) -> object:
    if kind == "continuous":
        raise fault('must be "revolute", without limits, for URDF\'s "continuous"')
    return kind


@dataclass(frozen=True, kw_only=True)
class JointKeys(Part):
    """The motion of a joint, and its place by modified Denavit–Hartenberg parameters (Craig)."""

    name: Label | None = entry("name of the link, any text; without it link 2 is called link2")
    # A file names what carries the link; once the robot is whole, None is the link before.
    parent: Annotated[
        int | None, GetPydanticSchema(lambda _, handler: handler.generate_schema(Label))
    ] = entry(
        'what carries the link: "base" or the name of a link given earlier; default: the link '
        "before, the base for the first"
    )
    alpha_deg: Angle = entry("twist about x of the parent's frame, degrees", NO_ANGLE)
    a: Size | None = number(
        "distance along x of the parent's frame, {m}; default: the length of the parent, 0 where "
        "it is the base"
    )
    d: Size = number("offset along the joint's axis z, {m}", 0.0)
    theta_deg: Angle = entry("offset of the joint angle, degrees", NO_ANGLE)
    axis: Direction = entry(
        "axis of a joint that xyz or rpy_deg places, in the link's frame: an axis such as "
        '"x" or "-y", or a direction [x, y, z]',
        AXES["z"],
        written="z",
    )
    joint: Annotated[LinkKind, BeforeValidator(_not_continuous)] = entry(
        "kind of joint: it turns about its axis, slides along it, or is fixed", "revolute"
    )
    constrained: Flag = entry(
        "whether a constraint torque about its axis, which the hybrid system contains, holds a "
        "fixed link; otherwise it is welded",
        False,
    )
    coordinate: Label | None = entry(
        "name of the joint's coordinate, any text; default: the link's name, or theta_… or d_… "
        "with the joint's number"
    )


@dataclass(frozen=True, kw_only=True)
class Passive(Part):
    """Forces on a joint by itself: τ − damping·rate − stiffness·(coordinate − rest)."""

    damping: NotNegative = number(
        "torque or force against the joint's rate, {N m s/rad or N s/m}", 0.0
    )
    armature: NotNegative = number(
        "inertia of what turns with the joint alone, such as a geared motor, {kg m^2 or kg}",
        0.0,
        keeps_sign=True,
    )
    stiffness: NotNegative = number("stiffness of a spring at the joint, {N m/rad or N/m}", 0.0)
    rest: Size = number("coordinate at which the spring rests, {rad or m}", 0.0)


@dataclass(frozen=True)
class JointLimits:
    """Bounds for simulators and controllers, which no equation contains; None is no bound.

    `low` and `high` in rad or m, `effort` in N m or N, `velocity` in rad/s or m/s.
    """

    low: float | None = None
    high: float | None = None
    effort: float | None = None
    velocity: float | None = None


@dataclass(frozen=True, kw_only=True)
class LimitKeys(Part):
    """Bounds of a joint for simulators and controllers."""

    limits: OpenRange | None = entry(
        "least and greatest coordinate, rad or m; inf where there is none. Limits are for "
        "simulators and controllers"
    )
    limits_deg: OpenRange | None = entry("limits of a joint that turns, degrees")
    effort: NotNegative | None = entry(
        "greatest torque or force of the joint, N m or N; default: none"
    )
    velocity: NotNegative | None = entry("greatest rate of the joint, rad/s or m/s; default: none")


@dataclass(frozen=True, kw_only=True)
class DriveKeys(Part):
    """The drive of a joint, and the friction in it."""

    servo: Servo | None = entry(
        "a servo that drives the joint; default: none, and torques or forces are commanded"
    )
    friction: Friction | None = entry("dry friction of the joint; default: none")
    gear: Gear | None = entry(
        "a gear with which another joint moves this one, which then has no coordinate; default: "
        "none"
    )
    motor: Motor | None = entry(
        "a motor behind a gear that turns the joint, with the inertia of its rotor; default: none"
    )


@dataclass(frozen=True)
class Link(JointKeys, DriveKeys):
    """A link with the joint that carries it.

    Where `pose` is None, modified Denavit–Hartenberg parameters (Craig) place it: the link's frame
    relative to its parent's is Rot_x(α)·Trans_x(a)·Rot_z(θ)·Trans_z(d); a revolute joint adds its
    angle to θ, a prismatic one its travel to d. `a` is None where the file leaves it to the length
    of its parent, 0 where that is the base. Otherwise `pose` is that of the joint in the parent's
    frame, and the joint turns about or slides along the unit vector `axis` of the link's frame.

    `parent` is always None for the link before. A link of kind "fixed" is welded to its parent;
    where it is `constrained` it is held by a constraint torque about its axis, which the hybrid
    system has. Wheels of the base, which are `rolling`, are links after all others.
    """

    body: Body
    pose: Pose | None = None
    passive: Passive = Passive()
    limits: JointLimits = JointLimits()
    rolling: Rolling | None = None

    @property
    def slides(self) -> bool:
        """True if its joint slides."""
        return self.joint == "prismatic"

    @property
    def moves(self) -> bool:
        """True if its joint moves, by its own coordinate or by that of another link."""
        return self.joint != "fixed"

    @property
    def drive_limits(self) -> JointLimits:
        """Limits of its joint, where it has a servo with the torque and the rate of that."""
        if (servo := self.servo) is None:
            return self.limits
        rate = servo.rate or self.limits.velocity
        return replace(self.limits, effort=servo.torque, velocity=rate)


# Keys of joints that move, and those of joints with coordinates.
_OF_MOVING = tuple(key.name for kind in (Passive, LimitKeys, DriveKeys) for key in fields(kind))
_OF_COORDINATES = (*(key.name for key in fields(LimitKeys)), "coordinate", "servo", "friction")


@dataclass(frozen=True, kw_only=True)
class LinkTable(BodyKeys, DriveKeys, LimitKeys, Passive, JointKeys, Posed):
    """A link, with the joint that carries it."""

    conditions: ClassVar[dict[str, Any]] = {
        "dependentRequired": RIGID_NEEDS_MASS,
        "dependentSchemas": {
            **NOT_BOTH_BODIES,
            **{key: {"properties": dict.fromkeys(DH_KEYS, False)} for key in POSE_KEYS},
            "axis": {"anyOf": [{"required": [key]} for key in POSE_KEYS]},
            "limits": {"properties": {"limits_deg": False}},
            "limits_deg": {"properties": {"joint": {"const": "revolute"}}},
        },
    }

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of keys that do not go with each other."""
        yield from super()._key_faults(values)
        pose = [key for key in POSE_KEYS if key in values]
        dh = [key for key in DH_KEYS if key in values]
        if pose and dh:
            yield (
                dh[0],
                f"belongs to Denavit–Hartenberg parameters, but {pose[0]} gives a pose: give "
                "alpha_deg, a, d and theta_deg, or xyz, rpy_deg and axis",
            )
        if "axis" in values and not pose:
            yield (
                "axis",
                "needs a pose, because with Denavit–Hartenberg parameters the axis is z; give "
                "xyz or rpy_deg",
            )
        kind, constrained = values.get("joint", "revolute"), values.get("constrained") is True
        if kind == "fixed":
            for key in _OF_MOVING:
                if key in values:
                    yield key, "must be left out, because a fixed joint does not move"
            if "coordinate" in values and not constrained:
                yield "coordinate", "must be left out, because a welded joint has no coordinate"
        elif constrained:
            yield "constrained", 'needs a joint that does not move: give joint = "fixed"'
        if kind == "prismatic" and "motor" in values:
            words = "belongs to a joint that turns; give the rotor its own link, with a gear"
            yield "motor", words
        if values.get("gear") is not None:
            for key in _OF_COORDINATES:
                if key in values:
                    words = "must be left out, because a gear moves the joint; give it to the link"
                    yield key, f"{words} of the gear"
        elif kind != "fixed" and "limits_deg" in values:
            if "limits" in values:
                yield "limits_deg", "must be left out, or limits: give one of the two"
            elif kind == "prismatic":
                yield "limits_deg", "belongs to a joint that turns: give limits, in m"

    def link(self) -> Link:
        """The link that the table describes."""
        low, high = self.limits or map(math.radians, self.limits_deg or (-math.inf, math.inf))
        servo = self.servo
        if servo is not None and servo.torque is None:
            servo = replace(servo, torque=self.effort)
        return Link(
            self.body(),
            self.whole_pose if self.xyz or self.rpy_deg else None,
            taken(Passive, self),
            JointLimits(
                low if math.isfinite(low) else None,
                high if math.isfinite(high) else None,
                self.effort,
                self.velocity,
            ),
            **vars(taken(DriveKeys, self)) | {"servo": servo},
            **vars(taken(JointKeys, self)),
        )
