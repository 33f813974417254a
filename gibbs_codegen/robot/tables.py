"""The tables of a robot file: what each key may hold, and the robot that they make.

A key is one field with its description: of rods and bodies, of the base and its arms, of rotors,
frames and links, and of the top table, in this order. What names refer to is in `references`.
`docs/reference/robot-file.md` explains them at length.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    AllowInfNan,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from pydantic.config import JsonDict

from gibbs_codegen.files.table import (
    Bounds,
    Place,
    Table,
    Tables,
    at_most,
    fault,
    list_of,
    listed,
    refusal,
    shown,
)
from gibbs_codegen.robot.model import (
    AXES,
    BASE,
    MAX_FRAMES,
    MAX_LINKS,
    MAX_ROTORS,
    ROD_ORIGINS,
    Angles3,
    Attitude,
    Base,
    Body,
    Frame,
    JointLimits,
    Link,
    LinkKind,
    Origin,
    Passive,
    Pose,
    RigidBody,
    Robot,
    Rod,
    Rotor,
    Vector3,
    alternating_thrust,
)
from gibbs_codegen.robot.names import LONGEST_LABEL, NAME_PATTERN, name_fault
from gibbs_codegen.robot.references import body_numbers, reference_faults
from gibbs_codegen.robot.rigid_body import body_fault, size_fault

_SIGNED_AXES = AXES | {
    f"-{letter}": (0.0 - x, 0.0 - y, 0.0 - z) for letter, (x, y, z) in AXES.items()
}


def _sized(number: float) -> float:
    if words := size_fault(number):
        raise fault(words)
    return number


def _bound(number: float) -> float:
    if math.isnan(number):
        raise fault("must be a number, or inf where there is no limit, not nan")
    return number if math.isinf(number) else _sized(number)


def _in_order(limits: tuple[float, float]) -> tuple[float, float]:
    low, high = limits
    if not low <= high or low == math.inf or high == -math.inf:
        raise fault(f"must be [lower, upper], not [{low:g}, {high:g}]")
    return limits


def _named(name: str) -> str:
    if words := name_fault(name):
        raise fault(words)
    return name


def _label(text: str) -> str:
    if not 0 < len(text) <= LONGEST_LABEL:
        raise fault(f"must be 1 to {LONGEST_LABEL} characters, not {len(text)}")
    return text


def _axis(value: object) -> object:
    if not isinstance(value, str):
        return tuple(list_of(value, 3))
    if value not in _SIGNED_AXES:
        letters = ", ".join(f'"{axis}"' for axis in _SIGNED_AXES)
        raise fault(f"must be {letters} or a direction [x, y, z], not {shown(value)}")
    return _SIGNED_AXES[value]


def _unit_vector(direction: Vector3) -> Vector3:
    x, y, z = direction
    largest = max(abs(x), abs(y), abs(z))
    if largest == 0.0:
        raise fault("a direction of length zero; give at least one entry that is not 0")
    if abs(math.hypot(x, y, z) - 1.0) < 1e-15:  # A unit vector stays what it is, bit for bit.
        return (x, y, z)
    # Scaled by the largest entry first, so that tiny and huge vectors neither vanish nor overflow.
    x, y, z = x / largest, y / largest, z / largest
    norm = math.hypot(x, y, z)
    return (x / norm, y / norm, z / norm)


def exact(angle: float) -> Fraction:
    """An angle, degrees, as the shortest decimal that is its float: what the file says."""
    return Fraction(repr(angle))


def exact3(angles: tuple[float, float, float]) -> Angles3:
    """Roll, pitch and yaw, degrees, each as `exact` gives it."""
    roll, pitch, yaw = angles
    return (exact(roll), exact(pitch), exact(yaw))


Size = Annotated[float, AfterValidator(_sized)]
NotNegative = Annotated[Size, Bounds(0.0)]
# In radians huge angles lose the part of a turn that they end in.
Angle = Annotated[float, Bounds(-360.0, 360.0, " degrees", "; leave out whole turns")]
Sizes3 = Annotated[tuple[Size, Size, Size], listed(3)]
_ENTRIES = "numbers, xx, yy, zz, xy, xz, yz"
Sizes6 = Annotated[tuple[Size, Size, Size, Size, Size, Size], listed(6, _ENTRIES)]
Turns3 = Annotated[tuple[Angle, Angle, Angle], listed(3)]
Range = Annotated[tuple[Size, Size], listed(2), AfterValidator(_in_order)]
_Bound = Annotated[float, AllowInfNan(True), AfterValidator(_bound)]
OpenRange = Annotated[tuple[_Bound, _Bound], listed(2), AfterValidator(_in_order)]

Name = Annotated[
    str, AfterValidator(_named), WithJsonSchema({"type": "string", "pattern": NAME_PATTERN})
]
Label = Annotated[
    str,
    AfterValidator(_label),
    WithJsonSchema({"type": "string", "minLength": 1, "maxLength": LONGEST_LABEL}),
]
Direction = Annotated[
    Vector3,
    BeforeValidator(_axis),
    AfterValidator(_unit_vector),
    WithJsonSchema(
        {
            "anyOf": [
                {"enum": list(_SIGNED_AXES)},
                {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
            ]
        }
    ),
]


# Key of the robot file that lets inertias pass that no body has.
ALLOWED = "allow_impossible_inertia"
RIGID_NEEDS_MASS: JsonDict = {"com": ["mass"], "inertia": ["mass"]}
NOT_BOTH_BODIES: JsonDict = {
    "mass": {"properties": {"mass_per_length": False, "section_inertia": False}},
}


class RigidTable(Table):
    """Mass, centre of mass and inertia of a rigid body."""

    mass: NotNegative | None = Field(default=None, description="mass of a rigid body, kg")
    com: Sizes3 | None = Field(
        default=None,
        description="centre of mass of a rigid body, in the axes of its link or of the base, m; "
        "default 0",
    )
    inertia: Sizes6 | None = Field(
        default=None,
        description="inertia xx, yy, zz, xy, xz, yz of a rigid body about its centre of mass, in "
        "the same axes, with xy = −∫ xy dm, kg m²; default 0",
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Fault of a rigid body without a mass."""
        if ("com" in values or "inertia" in values) and "mass" not in values:
            yield "mass", "missing: a rigid body needs its mass in kg"

    @model_validator(mode="after")
    def _is_possible(self, info: ValidationInfo) -> Self:
        body = self.body()
        allowed = (info.context or {}).get(ALLOWED) is True
        if body is None or allowed or not (words := body_fault(body)):
            return self
        key = "section_inertia" if isinstance(body, Rod) else "inertia"
        raise refusal([((key,), f"{words}; {ALLOWED} = true lets it pass")])

    def body(self) -> Body | None:
        """The body that the table describes, or None where it gives no mass."""
        return self.rigid_body(0.0)

    def rigid_body(self, length: float) -> RigidBody | None:
        """The rigid body, None without mass; `length`, m, is the way along x to what comes next."""
        if self.mass is None:
            return None
        return RigidBody(length, self.mass, self.com or (0.0,) * 3, self.inertia or (0.0,) * 6)


class RodTable(Table):
    """What is known of a rod, or of any body, along x."""

    length: NotNegative = Field(
        default=0.0,
        description="distance along x to what comes next, a motor, a joint or the tip, m",
    )
    mass_per_length: NotNegative | None = Field(
        default=None, description="mass per length of a rod, kg/m; default 0"
    )
    section_inertia: Sizes3 | None = Field(
        default=None,
        description="inertia xx, yy, zz of a whole rod, added about its centre of mass, kg m²; "
        "default 0",
    )


class BodyTable(RigidTable, RodTable):
    """A rod, with mass_per_length and section_inertia, or any rigid body, with mass."""

    model_config = ConfigDict(
        json_schema_extra={
            "dependentRequired": RIGID_NEEDS_MASS,
            "dependentSchemas": NOT_BOTH_BODIES,
        }
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of a body that is both a rod and a rigid body, or has no mass."""
        rigid = [key for key in ("mass", "com", "inertia") if key in values]
        rod = [key for key in ("mass_per_length", "section_inertia") if key in values]
        if rigid and rod:
            yield (
                rod[0],
                f"belongs to a rod, but {rigid[0]} describes a rigid body: give mass_per_length "
                "and section_inertia, or mass, com and inertia",
            )
        yield from super().key_faults(values)

    def body(self) -> Body:
        """The body that the table describes."""
        rod = Rod(self.length, self.mass_per_length or 0.0, self.section_inertia or (0.0,) * 3)
        return self.rigid_body(self.length) or rod


class ArmTable(BodyTable):
    """An arm of the base, with a motor at its end."""

    length: NotNegative = Field(description="the distance from the base centre to the motor, in m")


_ARMS = TypeAdapter(list[ArmTable])
# The keys of rods and of the motors at their ends.
ROD_KEYS = ("rotors", "arm", "thrust", "drag", "azimuth_deg")


class BaseTable(RigidTable):
    """The flying base, rigid: a central body, rods with a motor at the end of each, or both."""

    model_config = ConfigDict(
        json_schema_extra={
            "dependentRequired": {
                **RIGID_NEEDS_MASS,
                **{key: [other for other in ROD_KEYS[:2] if other != key] for key in ROD_KEYS},
            }
        }
    )

    rotors: Annotated[int, Bounds(2, MAX_ROTORS)] | None = Field(
        default=None, description="the number of rotors and arms, N"
    )
    attitude: Attitude = Field(
        default="xyz", description="intrinsic sequence of the attitude angles, or quaternion"
    )
    origin: Origin | None = Field(
        default=None,
        description="the point whose position is x, y, z: motor1 or centre where the base has "
        "arms, base where it has none; default: motor1 with arms, base without",
    )
    thrust: list[Direction] | None = Field(
        default=None,
        description="direction of the thrust of each motor in its arm's frame: an axis, or "
        "[x, y, z]; default: z for odd motors, y for even ones",
    )
    drag: list[Size] | None = Field(
        default=None,
        description="reaction torque of each motor about its thrust's direction per unit of "
        "thrust, m; default 0",
    )
    azimuth_deg: list[Angle] | None = Field(
        default=None,
        description="angle of each arm about the base's normal z, from the base's x axis, degrees; "
        "default: equal angles, with arm 1 seen from its motor",
    )
    arm: ArmTable | list[ArmTable] | None = Field(
        default=None, description="one table for all arms, or a list of one for each"
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of arms that are not whole, or not as many as there are rotors."""
        yield from super().key_faults(values)
        if any(key in values for key in ROD_KEYS):
            for key in ROD_KEYS[:2]:
                if key not in values:
                    yield key, f"missing: {cls.model_fields[key].description}"
        elif values.get("origin") in ROD_ORIGINS:
            yield "origin", 'must be "base" where the base has no arms (base.rotors and base.arm)'
        arms, rotors = values.get("arm"), values.get("rotors")
        if not isinstance(arms, list) or not isinstance(rotors, int):
            return
        if 1 < rotors <= MAX_ROTORS and rotors != len(arms) <= MAX_ROTORS:
            what = f"a list of {len(arms)} for {rotors} rotors"
            yield "arm", f"{what}; give one table for all, or one each"

    @field_validator("thrust", "drag", "azimuth_deg", mode="before")
    @classmethod
    def _one_per_motor(cls, value: object, info: ValidationInfo) -> object:
        rotors = info.data.get("rotors")
        if rotors is None:  # How many there must be is not known; a flood there is not.
            return value[:MAX_ROTORS] if isinstance(value, list) else value
        if info.field_name != "thrust":
            return list_of(value, rotors)
        if not isinstance(value, list) or len(value) != rotors:
            raise fault(f"must be a list of {rotors} directions, one per motor")
        return value

    @field_validator("arm", mode="wrap")
    @classmethod
    def _one_or_each(
        cls, value: object, _: object, info: ValidationInfo
    ) -> ArmTable | list[ArmTable]:
        """One checked table for all arms, or a list of them.

        The field's own validator would try both forms and tell faults of both.
        """
        if isinstance(value, list):
            arms = at_most(value, MAX_ROTORS, "arms")
            return _ARMS.validate_python(arms, context=info.context)
        return ArmTable.model_validate(value, context=info.context)

    def built(self) -> Base:
        """The base that the table describes."""
        body = self.rigid_body(0.0)
        if self.rotors is None or self.arm is None:
            return Base(attitude=self.attitude, origin=self.origin or "base", body=body)
        arms = self.arm if isinstance(self.arm, list) else [self.arm]
        return Base(
            self.rotors,
            tuple(arm.body() for arm in arms),
            tuple(self.thrust) if self.thrust else alternating_thrust(self.rotors),
            tuple(self.drag or (0.0,) * self.rotors),
            self.attitude,
            self.origin or "motor1",
            body,
            tuple(map(exact, self.azimuth_deg)) if self.azimuth_deg else None,
        )


_ON = 'what carries it: "base" or the name of a link'


class PoseTable(Table):
    """A pose in the frame of a body."""

    xyz: Sizes3 | None = Field(
        default=None, description="place in the frame of what carries it, m; default [0, 0, 0]"
    )
    rpy_deg: Turns3 | None = Field(
        default=None,
        description="roll, pitch and yaw in that frame, R = R_z·R_y·R_x as in URDF, degrees; "
        "default [0, 0, 0]",
    )

    @classmethod
    def synonyms(cls) -> Mapping[str, str]:
        """Rotors have a position."""
        return {"position": "xyz"}

    def pose(self) -> Pose:
        """The pose that the table describes."""
        return Pose(self.xyz or (0.0,) * 3, exact3(self.rpy_deg or (0.0,) * 3))


class RotorTable(Table):
    """A rotor on the base or on a link."""

    name: Label | None = Field(
        default=None, description="name of the rotor, any text; without it its number counts"
    )
    on: Label = Field(default="base", description=_ON)
    position: Sizes3 = Field(
        default=(0.0, 0.0, 0.0), description="place in the frame of what carries it, m"
    )
    direction: Direction = Field(
        default=AXES["z"],
        description='direction of its thrust in that frame: an axis such as "x" or "-y", or '
        "[x, y, z]",
        json_schema_extra={"default": "z"},
    )
    drag: Size = Field(
        default=0.0,
        description="reaction torque about its direction per unit of thrust, m: negative for a "
        "rotor that spins counter-clockwise, seen from the tip of its thrust",
    )
    limits: Range | None = Field(
        default=None,
        description="least and greatest thrust, for simulators and controllers, N; default: none",
    )
    time_constant: NotNegative | None = Field(
        default=None, description="time constant of its thrust, for simulators, s; default: none"
    )
    spin_inertia: NotNegative | None = Field(
        default=None,
        description="moment of inertia of what spins with it, about its axis, for gyroscopic "
        "torques in simulators, kg m^2; default: none",
    )
    speed_per_sqrt_thrust: NotNegative | None = Field(
        default=None,
        description="its speed by the square root of its thrust, for simulators, (rad/s)/sqrt(N); "
        "default: none",
    )

    @classmethod
    def synonyms(cls) -> Mapping[str, str]:
        """Links and frames have their place in xyz."""
        return {"xyz": "position"}

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of a rotor of which the angular momentum is not known."""
        for key, other in itertools.permutations(("spin_inertia", "speed_per_sqrt_thrust")):
            if key in values and other not in values:
                yield key, f"needs {other} beside it: give both or none"
        if "spin_inertia" in values and values.get("drag", 0.0) == 0.0:
            yield "spin_inertia", "needs a drag that is not 0: its sign tells which way it spins"

    def rotor(self, on: int) -> Rotor:
        """The rotor that the table describes, on the body of that number."""
        return Rotor(
            self.position,
            self.direction,
            self.drag,
            on,
            self.name,
            self.limits,
            self.time_constant,
            self.spin_inertia,
            self.speed_per_sqrt_thrust,
        )


class FrameTable(PoseTable):
    """A named frame, such as an end effector or a sensor."""

    name: Label = Field(description="name of the frame, any text")
    on: Label = Field(default="base", description=_ON)

    def frame(self, on: int) -> Frame:
        """The frame that the table describes, on the body of that number."""
        return Frame(self.name, on, self.pose())


DH_KEYS = ("alpha_deg", "a", "d", "theta_deg")
POSE_KEYS = ("xyz", "rpy_deg")
PASSIVE_KEYS = ("damping", "armature", "stiffness", "rest")
LIMIT_KEYS = ("limits", "limits_deg", "effort", "velocity")


class PlaceTable(PoseTable):
    """Where a link's joint is, by modified Denavit–Hartenberg parameters or a pose."""

    name: Label | None = Field(
        default=None, description="name of the link, any text; without it link 2 is called link2"
    )
    parent: Label | None = Field(
        default=None,
        description='what carries the link: "base" or the name of a link given earlier; default: '
        "the link before, the base for the first",
    )
    alpha_deg: Angle = Field(
        default=0.0, description="twist about x of the parent's frame, degrees"
    )
    a: Size | None = Field(
        default=None,
        description="distance along x of the parent's frame, m; default: the length of the "
        "parent, 0 where it is the base",
    )
    d: Size = Field(default=0.0, description="offset along the joint's axis z, m")
    theta_deg: Angle = Field(default=0.0, description="offset of the joint angle, degrees")
    axis: Direction = Field(
        default=AXES["z"],
        description="axis of a joint that xyz or rpy_deg places, in the link's frame: an axis such "
        'as "x" or "-y", or a direction [x, y, z]',
        json_schema_extra={"default": "z"},
    )


def _not_continuous(kind: object) -> object:
    if kind == "continuous":
        raise fault('must be "revolute", without limits, for what URDF calls "continuous"')
    return kind


class JointTable(Table):
    """What a link's joint does."""

    joint: Annotated[LinkKind, BeforeValidator(_not_continuous)] = Field(
        default="revolute",
        description="what the joint does: it turns about its axis, slides along it, or is fixed",
    )
    constrained: bool = Field(
        default=False,
        description="whether a fixed link is held by a constraint torque about its axis, which the "
        "hybrid system has, instead of welded",
    )
    coordinate: Label | None = Field(
        default=None,
        description="name of the joint's coordinate, any text; default: the link's name, or "
        "theta_… or d_… with the joint's number",
    )
    damping: NotNegative = Field(
        default=0.0, description="torque or force against the joint's rate, N m s/rad or N s/m"
    )
    armature: NotNegative = Field(
        default=0.0,
        description="inertia of what turns with the joint alone, such as a geared motor, kg m² or "
        "kg",
    )
    stiffness: NotNegative = Field(default=0.0, description="of a spring, N m/rad or N/m")
    rest: Size = Field(default=0.0, description="coordinate at which the spring rests, rad or m")
    limits: OpenRange | None = Field(
        default=None,
        description="least and greatest coordinate, rad or m; inf where there is none. Limits are "
        "for simulators and controllers",
    )
    limits_deg: OpenRange | None = Field(
        default=None, description="limits of a joint that turns, degrees"
    )
    effort: NotNegative | None = Field(
        default=None, description="greatest torque or force of the joint, N m or N; default: none"
    )
    velocity: NotNegative | None = Field(
        default=None, description="greatest rate of the joint, rad/s or m/s; default: none"
    )

    def passive(self) -> Passive:
        """What acts on the joint by itself."""
        return Passive(self.damping, self.armature, self.stiffness, self.rest)

    def bounds(self) -> JointLimits:
        """The limits of the joint, in rad or m."""
        low, high = self.limits or (-math.inf, math.inf)
        if self.limits_deg:
            low, high = map(math.radians, self.limits_deg)
        return JointLimits(
            low if math.isfinite(low) else None,
            high if math.isfinite(high) else None,
            self.effort,
            self.velocity,
        )


class LinkTable(BodyTable, JointTable, PlaceTable):
    """A link, with the joint that carries it."""

    model_config = ConfigDict(
        json_schema_extra={
            "dependentRequired": RIGID_NEEDS_MASS,
            "dependentSchemas": {
                **NOT_BOTH_BODIES,
                **{key: {"properties": dict.fromkeys(DH_KEYS, False)} for key in POSE_KEYS},
                "axis": {"anyOf": [{"required": [key]} for key in POSE_KEYS]},
                "limits": {"properties": {"limits_deg": False}},
                "limits_deg": {"properties": {"joint": {"const": "revolute"}}},
            },
        }
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of keys that do not go with each other."""
        yield from super().key_faults(values)
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
                "needs a pose, since by Denavit–Hartenberg parameters the axis is z: give xyz or "
                "rpy_deg",
            )
        yield from cls._joint_faults(values)

    @classmethod
    def _joint_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        kind, constrained = values.get("joint", "revolute"), values.get("constrained") is True
        if kind == "fixed":
            for key in (*PASSIVE_KEYS, *LIMIT_KEYS):
                if key in values:
                    yield key, "must be left out, since a fixed joint does not move"
            if "coordinate" in values and not constrained:
                yield "coordinate", "must be left out, since a welded joint has no coordinate"
        elif constrained:
            yield "constrained", 'needs a joint that does not move: give joint = "fixed"'
        if kind != "fixed" and "limits_deg" in values:
            if "limits" in values:
                yield "limits_deg", "must be left out, or limits: give one of the two"
            elif kind == "prismatic":
                yield "limits_deg", "belongs to a joint that turns: give limits, in m"

    def link(self, parent: int | None) -> Link:
        """The link that the table describes; `parent` numbers its carrier, None the link before."""
        return Link(
            self.body(),
            exact(self.alpha_deg),
            self.a,
            self.d,
            exact(self.theta_deg),
            self.joint,
            parent,
            self.pose() if self.xyz or self.rpy_deg else None,
            self.axis,
            self.constrained,
            self.name,
            self.coordinate,
            self.passive(),
            self.bounds(),
        )


class RobotTable(Table):
    """An aerial robot: a base, rotors, links that branch from the base as a tree, and frames.

    SI units: kg, m, s. Angles are in degrees, in keys that end in `_deg`.
    """

    model_config = ConfigDict(title="Robot file of gibbs_codegen")

    name: Name = Field(
        description="the robot's name, which becomes that of the module and the prefix in C"
    )
    gravity: NotNegative = Field(default=9.81, description="acceleration of gravity, m/s²")
    allow_impossible_inertia: bool = Field(
        default=False,
        description="whether inertias pass that no body has, as some published models have them; "
        "a warning names the body",
    )
    base: BaseTable = Field(description="the flying base, [base]")
    rotor: Annotated[list[RotorTable], Tables("rotor", MAX_ROTORS, "rotors")] = Field(
        default_factory=list, description="rotors on the base or on links, instead of base.rotors"
    )
    link: Annotated[list[LinkTable], Tables("link", MAX_LINKS, "links")] = Field(
        default_factory=list, description="the links, each after the one that carries it"
    )
    frame: Annotated[list[FrameTable], Tables("frame", MAX_FRAMES, "frames")] = Field(
        default_factory=list, description="named frames on the base or on links"
    )

    @classmethod
    def mistaken(cls) -> tuple[str, frozenset[str]]:
        """Scenarios, by keys of theirs."""
        return "a scenario", frozenset({"duration", "control", "motors", "integration"})

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
        """Faults of names and references, and of two forms of rotors at once."""
        base = values.get("base")
        given = [key for key in ROD_KEYS if isinstance(base, dict) and key in base]
        if given and values.get("rotor"):
            yield (
                ("rotor",),
                f"belongs to a base without arms, but base.{given[0]} gives them motors: give "
                "[[rotor]] tables, or base.rotors and base.arm",
            )
        yield from reference_faults(values)

    @model_validator(mode="after")
    def _has_mass(self) -> Self:
        if self.robot().total_mass <= 0:
            place = ("base", "arm") if self.base.arm else ("base",)
            raise refusal([(place, "the robot has no mass; give its base or links some")])
        return self

    def robot(self) -> Robot:
        """The robot that the file describes, as far as its names can be resolved."""
        numbers = body_numbers([link.name for link in self.link])
        parents = [numbers.get(link.parent or "", before) for before, link in enumerate(self.link)]
        return Robot(
            self.name,
            self.base.built(),
            tuple(
                link.link(None if parent == before else parent)
                for before, (link, parent) in enumerate(zip(self.link, parents, strict=True))
            ),
            self.gravity,
            tuple(rotor.rotor(numbers.get(rotor.on, BASE)) for rotor in self.rotor),
            tuple(frame.frame(numbers.get(frame.on, BASE)) for frame in self.frame),
            self.allow_impossible_inertia,
        )
