"""The layout of coordinates: where entries of q, v and a stand, what they are, and their names.

With Tait–Bryan angles q is θ₋₁, θ₀, θ₁, the joints θ_{N+1} … θ_{N+n}, x, y, z, and v holds their
rates in the same places. With a quaternion q is x, y, z, qx, qy, qz, qw, the joints, and v holds
the linear and the angular velocity of the base in its own frame, then the joints' rates. a has the
places of v. A prismatic joint's coordinate is a travel and is called d instead of θ.

A base that does not move freely has fewer entries, all before the joints'. One that stays level has
x, y, the height z and the yaw in q, as many as move, and velocities along and about its own axes in
v. One whose motion is a list has what is in it, in that order, and v holds the rates. With a drive
it has fewer velocities, and each wheel that turns has an angle at the end of q: of these angles,
whose rates are known by the velocities, v has none.

Hybrid unknowns are the accelerations, in the order of v, with those of the constrained angles
θ₂ … θ_N before the joints', and the constraint torques τ'₂ … τ'_N at the end (section 7 of the
method).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of
from gibbs_codegen.robot.parts.base import DRIVES, LEVEL_KINDS, TRAVELS, TURNS
from gibbs_codegen.robot.parts.frame import Frame
from gibbs_codegen.robot.parts.link import JointKind
from gibbs_codegen.robot.parts.pose import Pose

Entry = TypeVar("Entry")

QUATERNION = "quaternion"


class JointTerms(NamedTuple):
    """The unit of a joint's coordinate, and that of the effort that drives it."""

    unit: str
    effort_unit: str


JOINT_TERMS: dict[JointKind, JointTerms] = {
    "revolute": JointTerms("rad", "N m"),
    "prismatic": JointTerms("m", "N"),
}


def joint_terms(robot: Robot, i: int) -> JointTerms:
    """Units of coordinate and effort of link i's joint, i from 1; a held one is an angle."""
    kind = robot.links[i - 1].joint
    return JOINT_TERMS["prismatic" if kind == "prismatic" else "revolute"]


def check_free_base(name: str, kind: str, feature: str) -> None:
    """Raise `UsageError` where `feature` needs a base that moves freely, and a robot has another.

    `kind` is a module's ATTITUDE.
    """
    if (level := _level(kind)) or _moving(kind):
        motion = repr(level) if level else str(kind.split())
        key = "drive" if level in DRIVES else "motion"
        raise UsageError(
            f"{name}: base.{key} is {motion}; {feature} only for bases that move freely "
            '(base.motion = "free")'
        )


@dataclass(frozen=True)
class Places:
    """The places of the base's attitude and position and of the joints in q, or in v and a.

    The base's own entries, taken by themselves, are those of attitude and then of position; in v
    the angular and then the linear velocity. `missing` are those, of six, that a level base does
    not have; taken by themselves its values have `nothing` there. At the end of q are the angles of
    `wheels`, which belong to neither.
    """

    attitude: slice
    joints: slice
    position: slice
    missing: tuple[int, ...] = ()
    nothing: Any = 0.0
    wheels: int = 0

    @property
    def size(self) -> int:
        """Number of all entries."""
        return max(self.attitude.stop, self.joints.stop, self.position.stop) + self.wheels

    @property
    def angles(self) -> slice:
        """The places of the wheels' angles."""
        return slice(self.size - self.wheels, self.size)

    @property
    def base(self) -> list[int]:
        """Places of attitude and position: the entries that thrusts act on."""
        places = range(self.size)
        return [*places[self.attitude], *places[self.position]]

    @property
    def joint_places(self) -> list[int]:
        """Places of the joints, from the base outwards."""
        return [*range(self.size)[self.joints]]

    def split(self, values: Sequence[Entry]) -> tuple[list[Entry], list[Entry]]:
        """The values of the base, attitude first, and those of the joints."""
        base = [values[place] for place in self.base]
        for place in self.missing:
            base.insert(place, self.nothing)
        return base, [*values[self.joints]]

    def kept(self, base: Sequence[Entry]) -> list[Entry]:
        """Those values of the base, attitude first, that are not missing."""
        return [value for place, value in enumerate(base) if place not in self.missing]

    def joined(self, base: Sequence[Entry], joints: Sequence[Entry]) -> list[Entry]:
        """Values of the base, attitude first, and of joints and wheels in order of the entries."""
        values = dict(zip(self.base, self.kept(base), strict=True))
        places = [*self.joint_places, *range(self.size)[self.angles]]
        values |= zip(places, joints, strict=True)
        return [values[place] for place in range(self.size)]


@dataclass(frozen=True)
class StateEntries(Places):
    """Places, names and units of the entries of q, or of those of v."""

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, places: Places, base: Sequence[str], names: Sequence[str], units: Sequence[str]
    ) -> StateEntries:
        """The entries of a base with joints.

        `base` are the base's own, attitude first, each by name and unit with a blank between.
        """
        base_names, base_units = zip(*(entry.split() for entry in base), strict=True)
        names = tuple(places.joined(base_names, names))
        return cls(**vars(places), names=names, units=tuple(places.joined(base_units, units)))


@dataclass(frozen=True)
class Layout:
    """The entries of q, and those of v and a, of one robot.

    `attitude` is "quaternion" or the sequence of the Tait–Bryan angles or, where a base does not
    move freely, its motion: a name, or what moves with blanks between; with a drive the name of
    that; and then the number of wheels that turn, if there are any. `constrained` are the places
    of the constrained angles θ₂ … θ_N among the hybrid unknowns, and its start is the place in v
    that they are put in at.
    """

    attitude: str
    q: StateEntries
    v: StateEntries
    constrained: slice

    @classmethod
    def of(
        cls, attitude: str, names: Sequence[str], units: Sequence[str], constrained: int
    ) -> Layout:
        """Layout of a base with joints of such names and units, and N − 1 constrained angles.

        Angles of wheels come after the joints.
        """
        pose: Sequence[str] = _ANGLES
        twist: Sequence[str] = [f"{entry}/s" for entry in _ANGLES]
        if attitude == QUATERNION:
            pose, twist = _POSE, _TWIST
        elif _level(attitude):
            pose, twist = _LEVEL, _TWIST
        elif moving := _moving(attitude):
            turning = [f"{part} rad" for part in moving if part in TURNS]
            pose = [*turning, *(f"{part} m" for part in moving if part in TRAVELS)]
            twist = [f"{entry}/s" for entry in pose]
        joints = len(names) - coordinate_places(attitude, 0).wheels
        rates = [f"{unit}/s" for unit in units[:joints]]
        q = StateEntries.of(coordinate_places(attitude, joints), pose, names, units)
        v = StateEntries.of(velocity_places(attitude, joints), twist, names[:joints], rates)
        first = v.joints.start
        return cls(attitude, q, v, slice(first, first + constrained))

    @classmethod
    def listed(
        cls, attitude: str, names: Sequence[str], units: Sequence[str], constrained: int
    ) -> Layout:
        """Layout of what a generated module lists, and N − 1 constrained angles.

        That is its ATTITUDE, COORDINATES and COORDINATE_UNITS. Raises `UsageError` if the names are
        not those of a base with joints.
        """
        of_base = coordinate_places(attitude, 0)
        joints = coordinate_places(attitude, max(len(names) - of_base.size, 0)).joints
        joints = slice(joints.start, joints.stop + of_base.wheels)  # These follow the joints.
        layout = cls.of(attitude, names[joints], units[joints], constrained)
        if layout.q.names != tuple(names):
            base = ", ".join(cls.of(attitude, (), (), 0).q.names)
            raise UsageError(
                f"the coordinates {', '.join(names)} are not {base} with the joints' at place "
                f"{joints.start + 1}"
            )
        return layout

    @classmethod
    def of_module(cls, module: Any) -> Layout:
        """Layout of a generated module; raises as `listed` does."""
        constrained = (len(module.HYBRID_COORDINATES) - len(module.VELOCITIES)) // 2
        names, units = module.COORDINATES, module.COORDINATE_UNITS
        return cls.listed(module.ATTITUDE, names, units, constrained)

    @property
    def middle_angle(self) -> int | None:
        """Place of the angle of three, θ₀, at whose ±90° they are singular; None of others."""
        return self.q.attitude.start + 1 if len(self.angle_axes) == 3 else None

    @property
    def angle_axes(self) -> str:
        """Axes of the attitude's angles in order, such as "xyz"; none of a quaternion."""
        if self.is_quaternion:
            return ""
        if self.moves_freely:
            return self.attitude
        return "".join("xyz"[TURNS[name]] for name in self.q.names[self.q.attitude])

    @property
    def moves_freely(self) -> bool:
        """True if the base has any position and attitude."""
        return not (_level(self.attitude) or _moving(self.attitude))

    @property
    def turns_with_base(self) -> bool:
        """True if velocities of the base are along and about its own axes, not rates."""
        return self.is_quaternion or "yaw" in LEVEL_KINDS.get(_level(self.attitude), ())

    @property
    def is_quaternion(self) -> bool:
        """True if the attitude is a quaternion, not three angles."""
        return self.attitude == QUATERNION

    @property
    def own_axes(self) -> tuple[list[int], list[int]]:
        """Numbers of the base's own axes along which it moves, and about which."""
        along = ["xyz".index(name) for name in self.q.names[self.q.position]]
        return along, ["xyz".index(axis) for axis in self.angle_axes or "xyz" * self.is_quaternion]

    @property
    def driven_axes(self) -> tuple[list[int], list[int]]:
        """As `own_axes`, of those that have velocities: with a drive not sideways."""
        along, about = self.own_axes
        return along[: len(range(self.v.size)[self.v.position])], about

    @property
    def has_drive(self) -> bool:
        """True if a base rolls ahead and turns, and has no velocity sideways."""
        return _level(self.attitude) in DRIVES

    @property
    def carries_wrenches(self) -> bool:
        """True if what thrusts on the base do to what moves of it is the same in its axes anywhere.

        So it is where all directions in which it moves turn with it, and all or one of its turns.
        """
        along, about = map(set, self.own_axes)
        if self.turns_with_base or not about:
            return True
        turned = len(about) == 1 and along in (about, {0, 1, 2} - about)
        return len(about) != 2 and (len(along) in (0, 3) or turned)

    @property
    def base_item(self) -> int:
        """Number of the base among the items of a chain: 3 in the paper, else what moves of it."""
        return 3 if self.moves_freely else len(self.q.base)

    @property
    def displaced(self) -> StateEntries:
        """Places of all directions in which it may be displaced: with a drive sideways too."""
        return self.v if self.moves_freely else replace(self.q, wheels=0)

    @property
    def displacements(self) -> list[tuple[str, str]]:
        """Names of the directions in which it may be displaced, as velocities', and units."""
        pairs = zip(self.v.names, (unit.removesuffix("/s") for unit in self.v.units), strict=True)
        entries = [*pairs]
        return (
            [*entries[:_SIDEWAYS], ("vy", "m"), *entries[_SIDEWAYS:]] if self.has_drive else entries
        )

    @property
    def paired(self) -> list[int]:
        """For each entry of v its place among displacements."""
        places = range(self.displaced.size)
        return [place for place in places if len(places) == self.v.size or place != _SIDEWAYS]

    @property
    def neutral(self) -> list[float]:
        """Coordinates of zero, the base level: of a quaternion qw is 1."""
        return [float(self.is_quaternion and name == "qw") for name in self.q.names]

    @property
    def effort_units(self) -> tuple[str, ...]:
        """Units of what drives joints and wheels: N m of a torque, N of a force."""
        by_unit = {terms.unit: terms.effort_unit for terms in JOINT_TERMS.values()}
        units = (*self.q.units[self.q.joints], *self.q.units[self.q.angles])
        return tuple(by_unit[unit] for unit in units)

    @property
    def free(self) -> list[int]:
        """Places of the entries of v among the hybrid unknowns."""
        first, after = self.constrained.start, self.constrained.stop
        return [*range(first), *range(after, after + self.v.size - first)]


# The place of a planar base's displacement along its y axis.
_SIDEWAYS = 1
_ANGLES = ("theta_m1 rad", "theta_0 rad", "theta_1 rad", "x m", "y m", "z m")
_POSE = ("qx 1", "qy 1", "qz 1", "qw 1", "x m", "y m", "z m")
_LEVEL = ("roll rad", "pitch rad", "yaw rad", "x m", "y m", "z m")
_TWIST = ("wx rad/s", "wy rad/s", "wz rad/s", "vx m/s", "vy m/s", "vz m/s")
# Names of the base's own entries, whatever describes its attitude; and where it moves otherwise.
BASE_ENTRIES = tuple(dict.fromkeys(entry.split()[0] for entry in (*_ANGLES, *_POSE, *_TWIST)))
OTHER_BASE_ENTRIES = tuple(entry.split()[0] for entry in (*_LEVEL, *_TWIST))


def _moving(attitude: str) -> list[str]:
    """What moves of a base with a list of that, else nothing."""
    parts = attitude.split(" ")
    return parts if {*parts} <= {*TRAVELS, *TURNS} else []


def _level(attitude: str) -> str:
    """The motion, or the drive, of a base that stays level, else nothing."""
    name = attitude.partition(" ")[0]
    return name if name in LEVEL_KINDS else ""


def coordinate_places(attitude: str, joints: int) -> Places:
    """Places of the entries of q; `attitude` is as of `Layout`."""
    if attitude == QUATERNION:
        return Places(slice(3, 7), slice(7, 7 + joints), slice(0, 3))
    if level := _level(attitude):
        return _level_places(LEVEL_KINDS[level], joints, int(attitude.partition(" ")[2] or 0))
    return velocity_places(attitude, joints)


def velocity_places(attitude: str, joints: int) -> Places:
    """Places of the entries of v and a; `attitude` is as of `coordinate_places`."""
    if attitude == QUATERNION:
        return Places(slice(3, 6), slice(6, 6 + joints), slice(0, 3))
    if level := _level(attitude):
        return _level_places(DRIVES.get(level) or LEVEL_KINDS[level], joints)
    if moving := _moving(attitude):
        return replace(_level_places(moving, joints), missing=())
    end = 3 + joints
    return Places(slice(0, 3), slice(3, end), slice(end, end + 3))


def _level_places(moving: Sequence[str], joints: int, wheels: int = 0) -> Places:
    """Places of what moves, translations first, before the joints."""
    travels, size = sum(part in TRAVELS for part in moving), len(moving)
    six = enumerate((*TURNS, *TRAVELS))
    missing = tuple(place for place, part in six if part not in moving)
    joined = slice(size, size + joints)
    return Places(slice(travels, size), joined, slice(0, travels), missing, wheels=wheels)


def layout_of(robot: Robot) -> Layout:
    """Layout of the coordinates of a robot."""
    return Layout.of(
        robot.kind,
        [coordinate_of(robot, i) for i in robot.driven],
        [joint_terms(robot, i).unit for i in robot.driven],
        max(robot.base.rotors - 1, 0) + len(robot.constrained),
    )


def frames_of(robot: Robot) -> tuple[Frame, ...]:
    """Frames in the order of FRAMES: the base's, the tip where there is one, and the file's.

    Where the links are one arm, the tip is the end of the last link, along x; the paper's base
    without an arm has it at its centre. The hubs of rotors come last on which the air acts.
    """
    frames = [Frame("base")]
    if has_default_tip(robot):
        links = len(robot.links)
        length = robot.links[-1].body.length if links else 0.0
        frames.append(Frame("tip", links, Pose((length, 0.0, 0.0))))
    frames += robot.frames
    for k, rotor in enumerate(robot.thrusters, start=1):
        if rotor.feels_air:
            name = "hub_" + (rotor.name or str(k))
            while any(name == other.name for other in frames):
                name = f"hub_{name}"
            frames.append(Frame(name, rotor.on, Pose(rotor.position), k))
    return tuple(frames)


def has_default_tip(robot: Robot) -> bool:
    """True if the end of the arm is a frame of its own accord.

    So it is of one arm, or a base of rods without any, if no frame is named "tip".
    """
    arm = robot.is_serial and bool(robot.links or robot.base.rotors)
    return arm and all(frame.name != "tip" for frame in robot.frames)
