"""The robot as plain frozen data: what a robot file says, checked, with its defaults filled in.

SI units throughout: kg, m, s; angles in degrees where a name ends in `_deg`. Nothing here knows
SymPy. Lengths and masses are floats; angles are exact fractions of a degree, since they are
structural: they decide which terms exist.

Bodies are counted with the base as number 0 and link i as number i: `parent` and `on` are such
numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Literal, get_args

Vector3 = tuple[float, float, float]
Angles3 = tuple[Fraction, Fraction, Fraction]
JointKind = Literal["revolute", "prismatic"]
Command = Literal["thrust", "speed", "throttle"]
ServoCommand = Literal["position", "rate"]
LinkKind = Literal["revolute", "prismatic", "fixed"]
Origin = Literal["motor1", "centre", "base"]
Attitude = Literal["xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "quaternion"]
ConstraintKind = Literal["point", "frame", "distance", "loop", "plane"]
LoopJoint = Literal["fixed", "revolute", "spherical"]
# What a constraint holds, whether a frame or a loop does it.
Holding = Literal["point", "frame", "hinge", "distance", "plane"]

ATTITUDES: tuple[Attitude, ...] = get_args(Attitude)
# The intrinsic sequences of Tait–Bryan angles.
SEQUENCES = ATTITUDES[:-1]
# Those of a base that has rods.
ROD_ORIGINS: tuple[Origin, ...] = ("motor1", "centre")
COMMANDS: tuple[Command, ...] = get_args(Command)
JOINT_KINDS: tuple[JointKind, ...] = get_args(JointKind)
LINK_KINDS: tuple[LinkKind, ...] = get_args(LinkKind)
BASE = 0
MAX_ROTORS = 256
MAX_LINKS = 64
MAX_FRAMES = 256
MAX_VOLTAGES = 64
MAX_CONSTRAINTS = 16
AXES: dict[str, Vector3] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_TURNS = ("turn_x", "turn_y", "turn_z")
# Rows of a constraint: errors along axes of the anchor, then turns about them.
ROWS: dict[Holding, tuple[str, ...]] = {
    "point": tuple(AXES),
    "frame": (*AXES, *_TURNS),
    "hinge": (*AXES, *_TURNS[:2]),
    "distance": ("distance",),
    "plane": ("normal",),
}


@dataclass(frozen=True)
class Rod:
    """A straight rod along x from the link's joint, with the inertia of its cross-section (B₃).

    `length` in m, `mass_per_length` in kg/m, `section_inertia` the diagonal about the centre of
    mass in kg m².
    """

    length: float
    mass_per_length: float = 0.0
    section_inertia: Vector3 = (0.0, 0.0, 0.0)

    @property
    def total_mass(self) -> float:
        """Mass in kg."""
        return self.length * self.mass_per_length


@dataclass(frozen=True)
class RigidBody:
    """Any rigid body: `mass` in kg, `com` in m, `inertia` in kg m².

    `inertia` holds xx, yy, zz, xy, xz, yz of the inertia matrix about the centre of mass in link
    axes (xy = −∫ xy dm). `length` in m is the distance along x to what comes next: a motor, a
    joint or the tip.
    """

    length: float
    mass: float
    com: Vector3 = (0.0, 0.0, 0.0)
    inertia: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def total_mass(self) -> float:
        """Mass in kg."""
        return self.mass


Body = Rod | RigidBody


def as_rigid_body(body: Body) -> RigidBody:
    """The same body by mass, centre of mass and inertia about it."""
    if isinstance(body, RigidBody):
        return body
    mass, (xx, yy, zz) = body.total_mass, body.section_inertia
    slender = mass * body.length**2 / 12
    inertia = (xx, yy + slender, zz + slender, 0.0, 0.0, 0.0)
    return RigidBody(body.length, mass, (body.length / 2, 0.0, 0.0), inertia)


@dataclass(frozen=True)
class Pose:
    """Where a frame is in another: `xyz` in m, then R = R_z·R_y·R_x of `rpy_deg`, as in URDF."""

    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy_deg: Angles3 = (Fraction(0), Fraction(0), Fraction(0))

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """Its attitude, the scalar part last."""
        pairs = [_half(angle) for angle in self.rpy_deg]
        (cr, sr), (cp, sp), (cy, sy) = pairs
        return (
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        )


def _half(angle: Fraction) -> tuple[float, float]:
    """Cosine and sine of half an angle in degrees."""
    half = math.radians(float(angle) / 2.0)
    return math.cos(half), math.sin(half)


@dataclass(frozen=True)
class Passive:
    """What acts on a joint by itself: τ − damping·rate − stiffness·(coordinate − rest).

    `damping` in N m s/rad or N s/m, `stiffness` in N m/rad or N/m, `rest` in rad or m. `armature`
    in kg m² or kg is the inertia of what turns with the joint alone, such as a geared motor.
    """

    damping: float = 0.0
    armature: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0


# Units of these, of joints that turn and that slide.
PASSIVE_UNITS: dict[JointKind, tuple[str, ...]] = {
    "revolute": ("N m s/rad", "kg m^2", "N m/rad", "rad"),
    "prismatic": ("N s/m", "kg", "N/m", "m"),
}
# Entries of inertias, and of other symmetric matrices, in their order everywhere.
AXIS_PAIRS = ("xx", "yy", "zz", "xy", "xz", "yz")


@dataclass(frozen=True)
class JointLimits:
    """Bounds for simulators and controllers, which no equation contains; None is no bound.

    `low` and `high` in rad or m, `effort` in N m or N, `velocity` in rad/s or m/s.
    """

    low: float | None = None
    high: float | None = None
    effort: float | None = None
    velocity: float | None = None


@dataclass(frozen=True)
class Servo:
    """What holds a joint where it is commanded to be, or moves it at the rate that is commanded.

    Its torque is stiffness·(reference − coordinate) − damping·rate, at most `torque`; within
    `backlash` (the whole play) it pushes neither way. The reference follows the command with the
    time constant `delay`, s, at most at `rate`. Where rates are commanded, its torque is
    damping·(reference − rate), without stiffness and backlash, and `rate` is the greatest command.
    Units as of `Passive`, `torque` in N m or N, `rate` in rad/s or m/s, `backlash` in rad or m;
    None is no limit.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    torque: float | None = None
    rate: float | None = None
    delay: float = 0.0
    backlash: float = 0.0
    command: ServoCommand = "position"

    @property
    def numbers(self) -> dict[str, float | None]:
        """What is a number and plays a part, by name."""
        unused = ("stiffness", "backlash", "rate") if self.command == "rate" else ()
        return {n: x for n, x in vars(self).items() if n not in (*unused, "command")}


@dataclass(frozen=True)
class Friction:
    """Dry friction of a joint: `coulomb` at speed, `static` about rest, both N m or N.

    Between the two it falls with (rate/`velocity`)², rad/s or m/s, as Stribeck's curve does.
    """

    coulomb: float
    static: float
    velocity: float = 0.1


@dataclass(frozen=True)
class Link:
    """A link with the joint that carries it.

    Where `pose` is None, modified Denavit–Hartenberg parameters (Craig) place it: the link's frame
    relative to its parent's is Rot_x(α)·Trans_x(a)·Rot_z(θ)·Trans_z(d); a revolute joint adds its
    angle to θ, a prismatic one its travel to d. `a` is None where the file leaves it to the length
    of its parent, 0 where that is the base. Otherwise `pose` is that of the joint in the parent's
    frame, and the joint turns about or slides along the unit vector `axis` of the link's frame.

    `parent` is always None for the link before. A link of kind "fixed" is welded to its parent;
    where it is `constrained` it is held by a constraint torque about its axis, which the hybrid
    system has.
    """

    body: Body
    alpha_deg: Fraction = Fraction(0)
    a: float | None = None
    d: float = 0.0
    theta_deg: Fraction = Fraction(0)
    joint: LinkKind = "revolute"
    parent: int | None = None
    pose: Pose | None = None
    axis: Vector3 = AXES["z"]
    constrained: bool = False
    name: str | None = None
    coordinate: str | None = None
    passive: Passive = Passive()
    limits: JointLimits = JointLimits()
    servo: Servo | None = None
    friction: Friction | None = None

    @property
    def moves(self) -> bool:
        """Whether its joint has a coordinate."""
        return self.joint != "fixed"


@dataclass(frozen=True)
class Drive:
    """What a rotor makes of its command.

    The command is a thrust, N, a speed, rad/s, or a throttle, 1, and so is its level, which follows
    the command with the time constants `up` and `down`, s; 0 is at once. The thrust is `curve`, a
    polynomial of second degree in the level, constant term first. `limits` are those of the
    command, `full_speed` in rad/s is the speed of a throttle of 1.
    """

    command: Command = "thrust"
    curve: Vector3 = (0.0, 1.0, 0.0)
    limits: tuple[float, float] | None = None
    up: float = 0.0
    down: float = 0.0
    full_speed: float | None = None

    @property
    def speed_per_sqrt_thrust(self) -> float:
        """Speed by the square root of the thrust, (rad/s)/√N, at the greatest command."""
        level = self.limits[1] if self.limits else 1e3
        return self.speed(level) / math.sqrt(max(self.thrust(level), 1e-12))

    def speed(self, level: float) -> float:
        """Speed, rad/s, at a level that is a speed or a throttle; 0 where it is not known."""
        return level if self.command == "speed" else level * (self.full_speed or 0.0)

    @property
    def thrust_limits(self) -> tuple[float, float] | None:
        """Least and greatest thrust, N, by the limits of its command where the curve rises."""
        if self.limits is None:
            return None
        low, high = (min(max(limit, self.rising[0]), self.rising[1]) for limit in self.limits)
        return self.thrust(low), self.thrust(high)

    @property
    def rising(self) -> tuple[float, float]:
        """Levels between which the thrust rises."""
        _, slope, square = self.curve
        if square == 0.0:
            return (-math.inf if slope > 0.0 else math.inf), math.inf
        turn = -slope / (2.0 * square) + 0.0
        return (-math.inf, turn) if square < 0.0 else (turn, math.inf)

    @property
    def lags(self) -> bool:
        """Whether its level follows the command with a lag."""
        return self.up > 0.0

    def thrust(self, level: float) -> float:
        """Thrust, N, at a level."""
        constant, slope, square = self.curve
        return constant + level * (slope + level * square)

    def level(self, thrust: float) -> float:
        """Level at a thrust, N, on the rising side of the curve."""
        constant, slope, square = self.curve
        rest = thrust - constant
        if square == 0.0:
            return rest / slope
        root = math.sqrt(max(slope * slope + 4.0 * square * rest, 0.0))
        return (root - slope) / (2.0 * square)


@dataclass(frozen=True)
class RotorAir:
    """What the air does to a rotor besides its thrust in still air, of an air speed v at its hub.

    With the speed Ω, rad/s, either way, and the thrust's direction n: `drag`, kg, −Ω·drag·v across
    n; `inflow`, kg, −Ω·inflow·v along n; `lift`, kg/m, lift·v² across n, along n. `radius`, m, is
    that of the disc, by which the ground raises the thrust (Cheeseman and Bennett, 1955) where
    there is ground effect. `advance` has pairs of the advance ratio, v along n by Ω·radius, and a
    factor of the thrust.
    """

    drag: float = 0.0
    inflow: float = 0.0
    lift: float = 0.0
    radius: float = 0.0
    ground_effect: bool = False
    advance: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Battery:
    """The battery, which all rotors share; full speed is that at the `nominal` voltage, V.

    `voltages`, V, are those without load at equal steps of charge, from empty to full. `resistance`
    is in ohm, `capacity` in A h, `auxiliary` the power of all else, W; of the power of motors
    `efficiency` is the share that rotors get.
    """

    voltages: tuple[float, ...]
    nominal: float
    resistance: float
    capacity: float
    efficiency: float
    auxiliary: float = 0.0


@dataclass(frozen=True)
class Rotor:
    """A rotor on a body: `position` in m and unit `direction` in the body's frame.

    `drag` is the reaction torque about the direction per unit of thrust, in m: negative for a rotor
    that spins counter-clockwise, seen from the tip of its thrust. `limits` of the thrust in N and
    `time_constant` in s are for simulators and controllers. So are `spin_inertia` in kg m² of what
    turns with the rotor, and its `speed_per_sqrt_thrust` in (rad/s)/√N, both or none. Without a
    `drive` its input is its thrust.
    """

    position: Vector3 = (0.0, 0.0, 0.0)
    direction: Vector3 = AXES["z"]
    drag: float = 0.0
    on: int = BASE
    name: str | None = None
    limits: tuple[float, float] | None = None
    time_constant: float | None = None
    spin_inertia: float | None = None
    speed_per_sqrt_thrust: float | None = None
    drive: Drive | None = None
    air: RotorAir | None = None


@dataclass(frozen=True)
class Frame:
    """A named frame on a body, such as an end effector, a sensor or the place of a payload.

    `rotor` is the number, from 1, of the rotor at whose hub it is.
    """

    name: str
    on: int = BASE
    pose: Pose = Pose()
    rotor: int | None = None


@dataclass(frozen=True)
class Constraint:
    """What holds a frame against another frame of the robot, or against the world.

    The anchor is a frame fixed in that of `to`, in the world where that is None. There is the
    frame's origin ("point") or the whole frame ("frame"); or the origin is at a `distance`, m, or
    in the plane through the anchor across the unit vector `normal`. A "loop" has a `joint` there,
    which turns about the unit vector `axis` of both frames. An error e gives way as
    ë + 2ζω ė + ω² e = 0, with the `frequency` ω, rad/s, and the `damping_ratio` ζ.
    """

    name: str
    kind: ConstraintKind
    frame: str
    to: str | None = None
    anchor: Pose = Pose()
    distance: float = 0.0
    normal: Vector3 = AXES["z"]
    joint: LoopJoint = "fixed"
    axis: Vector3 = AXES["z"]
    frequency: float = 0.0
    damping_ratio: float = 1.0

    @property
    def holds(self) -> Holding:
        """What it holds, of a loop by its joint."""
        if self.kind == "loop":
            by_joint: dict[LoopJoint, Holding] = {"fixed": "frame", "spherical": "point"}
            return by_joint.get(self.joint, "hinge")
        return self.kind


@dataclass(frozen=True)
class Base:
    """The flying base: a central body, N rods with a motor at the end of each, or both, rigid.

    `rotors` is the number of rods, each with its motor. `thrust` holds a unit direction per motor
    in its rod's frame, `drag` the reaction torque about that direction per unit of thrust, in m.
    `arms` has one entry when all rods share one table, else N. `azimuth_deg` holds the angles of
    the rods about the base normal, from the x axis of the base; None is the paper's rule, in which
    rod 1 is seen from its motor.
    """

    rotors: int = 0
    arms: tuple[Body, ...] = ()
    thrust: tuple[Vector3, ...] = ()
    drag: tuple[float, ...] = ()
    attitude: Attitude = "xyz"
    origin: Origin = "motor1"
    body: RigidBody | None = None
    azimuth_deg: tuple[Fraction, ...] | None = None

    @property
    def shares_one_arm(self) -> bool:
        """Whether one table serves all arms."""
        return len(self.arms) == 1

    def arm(self, k: int) -> Body:
        """Body of base arm k, from 1 to N, in the arm's frame."""
        return self.arms[0] if self.shares_one_arm else self.arms[k - 1]

    def arm_angle_deg(self, k: int) -> Fraction:
        """Angle θ_k of arm k against the base, in degrees.

        It is −180° + 360°(k−1)/N by default; k is from 1 or, by the paper's rule, from 2 to N.
        """
        if self.azimuth_deg is not None:
            return self.azimuth_deg[k - 1]
        return Fraction(-180) + Fraction(360 * (k - 1), self.rotors)


@dataclass(frozen=True)
class Robot:
    """An aerial robot: a flying base, and links that branch from it as a tree.

    Its rotors are those at the ends of the base's rods, or the placed ones, `thrusters`.
    """

    name: str
    base: Base
    links: tuple[Link, ...] = ()
    gravity: float = 9.81
    thrusters: tuple[Rotor, ...] = ()
    frames: tuple[Frame, ...] = ()
    allow_impossible_inertia: bool = False
    battery: Battery | None = None
    constraints: tuple[Constraint, ...] = ()

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """What each rotor makes of its command; without a word for it that is its thrust."""
        plain = [Drive() for _ in range(self.base.rotors)]
        return (*plain, *map(drive_of, self.thrusters))

    @property
    def has_actuators(self) -> bool:
        """Whether any command is not the thrust, torque or force itself, with one lag or none."""
        moved = [self.links[i - 1] for i in self.moving]
        return (
            self.battery is not None
            or any(rotor.drive or rotor.air for rotor in self.thrusters)
            or any(link.servo or link.friction for link in moved)
        )

    @property
    def rotors(self) -> int:
        """N, the number of rotors."""
        return self.base.rotors + len(self.thrusters)

    @cached_property
    def parents(self) -> tuple[int, ...]:
        """For each link the number of the body that carries it."""
        return tuple(
            before if link.parent is None else link.parent for before, link in enumerate(self.links)
        )

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Numbers of the links whose joints have coordinates, in order."""
        return tuple(i for i, link in enumerate(self.links, start=1) if link.moves)

    @cached_property
    def rigid(self) -> tuple[int, ...]:
        """For each body the number of the base or moving link that it is, or is welded to."""
        found = [BASE]
        for i, (link, parent) in enumerate(zip(self.links, self.parents, strict=True), start=1):
            found.append(i if link.moves else found[parent])
        return tuple(found)

    @cached_property
    def constrained(self) -> tuple[int, ...]:
        """Numbers of the links that a constraint torque holds, in order."""
        return tuple(i for i, link in enumerate(self.links, start=1) if link.constrained)

    @property
    def is_serial(self) -> bool:
        """Whether its links are one arm, each on the link before."""
        return self.parents == tuple(range(len(self.links)))

    @property
    def total_mass(self) -> float:
        """Mass of the whole robot in kg."""
        arms = sum(self.base.arm(k).total_mass for k in range(1, self.base.rotors + 1))
        body = self.base.body.total_mass if self.base.body else 0.0
        return arms + body + sum(link.body.total_mass for link in self.links)


def drive_of(rotor: Rotor) -> Drive:
    """What a placed rotor makes of its command."""
    if rotor.drive is not None:
        return rotor.drive
    lag = rotor.time_constant or 0.0
    return Drive(limits=rotor.limits, up=lag, down=lag)


def alternating_thrust(rotors: int) -> tuple[Vector3, ...]:
    """Default directions: odd motors push along z, even motors along y of their arm's frame."""
    return tuple(AXES["y" if k % 2 else "z"] for k in range(rotors))
