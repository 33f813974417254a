"""The layout of coordinates: where entries of q, v and a stand, what they are, and their names.

With Tait–Bryan angles q is θ₋₁, θ₀, θ₁, the joints θ_{N+1} … θ_{N+n}, x, y, z, and v holds their
rates in the same places. With a quaternion q is x, y, z, qx, qy, qz, qw, the joints, and v holds
the linear and the angular velocity of the base in its own frame, then the joints' rates. a has the
places of v. A prismatic joint's coordinate is a travel and is called d instead of θ.

Hybrid unknowns are the accelerations, in the order of v, with those of the constrained angles
θ₂ … θ_N before the joints', and the constraint torques τ'₂ … τ'_N at the end (section 7 of the
method).

In emitted functions an entry that the robot file gives no name is called as in the lists of a
module, such as theta_7 and v_theta_7. Names that people give may be anything: a word of C or
Python, or what another variable is called. They get endings that nothing else has: forearm_q,
forearm_v, forearm_F.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.model import Frame, JointKind, Pose, Robot
from gibbs_codegen.robot.names import (
    coordinate_of,
    default_prefix,
    identifier,
    joint_label,
    link_label,
    rotor_identifier,
)

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


@dataclass(frozen=True)
class Places:
    """Where attitude and position of the base and the joints stand in q, or in v and a.

    The base's own entries, taken by themselves, are those of attitude and then of position; in v
    the angular and then the linear velocity.
    """

    attitude: slice
    joints: slice
    position: slice

    @property
    def size(self) -> int:
        """Number of all entries."""
        size: int = max(self.attitude.stop, self.joints.stop, self.position.stop)
        return size

    @property
    def base(self) -> list[int]:
        """Places of attitude and position: the entries that thrusts act on."""
        every = range(self.size)
        return [*every[self.attitude], *every[self.position]]

    @property
    def joint_places(self) -> list[int]:
        """Places of the joints, from the base outwards."""
        return [*range(self.size)[self.joints]]

    def split(self, values: Sequence[Entry]) -> tuple[list[Entry], list[Entry]]:
        """The values of the base, attitude first, and those of the joints."""
        return [values[place] for place in self.base], [*values[self.joints]]

    def joined(self, base: Sequence[Entry], joints: Sequence[Entry]) -> list[Entry]:
        """Values of the base, attitude first, and of the joints in the order of the entries."""
        values = dict(zip(self.base, base, strict=True))
        values |= zip(self.joint_places, joints, strict=True)
        return [values[place] for place in range(self.size)]


@dataclass(frozen=True)
class Entries(Places):
    """Places, names and units of the entries of q, or of those of v."""

    names: tuple[str, ...]
    units: tuple[str, ...]

    @classmethod
    def of(
        cls, places: Places, base: Sequence[str], names: Sequence[str], units: Sequence[str]
    ) -> Entries:
        """The entries of a base with joints.

        `base` are the base's own, attitude first, each by name and unit with a blank between.
        """
        own_names, own_units = zip(*(entry.split() for entry in base), strict=True)
        return cls(
            places.attitude,
            places.joints,
            places.position,
            tuple(places.joined(own_names, names)),
            tuple(places.joined(own_units, units)),
        )


@dataclass(frozen=True)
class Layout:
    """The entries of q, and those of v and a, of one robot.

    `attitude` is "quaternion" or the sequence of the Tait–Bryan angles. `constrained` are the
    places of the constrained angles θ₂ … θ_N among the hybrid unknowns, and its start is the place
    in v that they are put in at.
    """

    attitude: str
    q: Entries
    v: Entries
    constrained: slice

    @classmethod
    def of(
        cls, attitude: str, names: Sequence[str], units: Sequence[str], constrained: int
    ) -> Layout:
        """Layout of a base with joints of such names and units, and N − 1 constrained angles."""
        pose: Sequence[str] = _ANGLES
        twist: Sequence[str] = [f"{entry}/s" for entry in _ANGLES]
        if attitude == QUATERNION:
            pose, twist = _POSE, _TWIST
        joints, rates = len(names), [f"{unit}/s" for unit in units]
        q = Entries.of(coordinate_places(attitude, joints), pose, names, units)
        v = Entries.of(velocity_places(attitude, joints), twist, names, rates)
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
        own = coordinate_places(attitude, 0)
        joints = coordinate_places(attitude, max(len(names) - own.size, 0)).joints
        layout = cls.of(attitude, names[joints], units[joints], constrained)
        if layout.q.names != tuple(names):
            base = ", ".join(cls.of(attitude, (), (), 0).q.names)
            raise UsageError(
                f"the coordinates {', '.join(names)} are not {base} with the joints' at place "
                f"{joints.start + 1}"
            )
        return layout

    @property
    def middle_angle(self) -> int:
        """Place of θ₀, the attitude angle at whose ±90° the sequence is singular."""
        return range(self.q.size)[self.q.attitude][1]

    @property
    def is_quaternion(self) -> bool:
        """Whether the attitude is a quaternion, not three angles."""
        return self.attitude == QUATERNION

    @property
    def neutral(self) -> list[float]:
        """Coordinates of zero, the base level: of a quaternion qw is 1."""
        return [float(name == "qw") for name in self.q.names]

    @property
    def effort_units(self) -> tuple[str, ...]:
        """Units of what drives the joints: N m of a torque, N of a force."""
        by_unit = {terms.unit: terms.effort_unit for terms in JOINT_TERMS.values()}
        return tuple(by_unit[unit] for unit in self.q.units[self.q.joints])

    @property
    def free(self) -> list[int]:
        """Places of the entries of v among the hybrid unknowns."""
        first, after = self.constrained.start, self.constrained.stop
        return [*range(first), *range(after, after + self.v.size - first)]


_ANGLES = ("theta_m1 rad", "theta_0 rad", "theta_1 rad", "x m", "y m", "z m")
_POSE = ("qx 1", "qy 1", "qz 1", "qw 1", "x m", "y m", "z m")
_TWIST = ("wx rad/s", "wy rad/s", "wz rad/s", "vx m/s", "vy m/s", "vz m/s")
# Names of the base's own entries, whatever describes its attitude.
BASE_ENTRIES = tuple(dict.fromkeys(entry.split()[0] for entry in (*_ANGLES, *_POSE, *_TWIST)))


def coordinate_places(attitude: str, joints: int) -> Places:
    """Places of the entries of q; `attitude` is "quaternion" or a sequence of Tait–Bryan angles."""
    if attitude == QUATERNION:
        return Places(slice(3, 7), slice(7, 7 + joints), slice(0, 3))
    return velocity_places(attitude, joints)


def velocity_places(attitude: str, joints: int) -> Places:
    """Places of the entries of v and a; `attitude` is as of `coordinate_places`."""
    if attitude == QUATERNION:
        return Places(slice(3, 6), slice(6, 6 + joints), slice(0, 3))
    end = 3 + joints
    return Places(slice(0, 3), slice(3, end), slice(end, end + 3))


def layout_of(robot: Robot) -> Layout:
    """Layout of the coordinates of a robot."""
    return Layout.of(
        robot.base.attitude,
        [coordinate_of(robot, i) for i in robot.moving],
        [joint_terms(robot, i).unit for i in robot.moving],
        max(robot.base.rotors - 1, 0) + len(robot.constrained),
    )


_ORIGINS = {
    "motor1": "motor 1 (O1)",
    "centre": "the base centre (O2)",
    "base": "the base's frame",
}


@dataclass(frozen=True)
class Coordinate:
    """One entry of q, v, a, u or of the hybrid unknowns: its name, unit and meaning."""

    name: str
    unit: str
    meaning: str


def reduced_coordinates(robot: Robot) -> tuple[Coordinate, ...]:
    """Entries of q: attitude and position of the base, and the arm's joints.

    With n links 6 + n with Tait–Bryan angles, 7 + n with a quaternion.
    """
    layout = layout_of(robot)
    if layout.is_quaternion:
        attitude = [f"{part} part of the attitude quaternion" for part in ("x", "y", "z", "scalar")]
    else:
        places = zip(("first", "second", "third"), layout.attitude, strict=True)
        attitude = [f"{place} attitude angle, about {axis}" for place, axis in places]
    position = [f"world {axis} of {_origin(robot)}" for axis in "xyz"]
    units = layout.q.units[layout.q.joints]
    what = ["travel" if unit == "m" else "angle" for unit in units]
    return _listed(robot, layout.q, [*attitude, *position], what)


def velocities(robot: Robot) -> tuple[Coordinate, ...]:
    """The 6 + n entries of v: rates of q, or of the base its velocities in its own frame."""
    layout = layout_of(robot)
    if layout.is_quaternion:
        turning = [f"angular velocity of the base, about its {axis} axis" for axis in "xyz"]
        moving = [f"velocity of {_origin(robot)}, along the base's {axis} axis" for axis in "xyz"]
        base = [*turning, *moving]
    else:
        base = [f"rate of {layout.q.names[place]}" for place in layout.q.base]
    return _listed(robot, layout.v, base, ["rate"] * len(robot.moving))


def free_unknowns(robot: Robot) -> tuple[Coordinate, ...]:
    """What the free unknowns of the hybrid system are the accelerations of.

    The coordinates, or the velocities where the base has a quaternion.
    """
    return (velocities if layout_of(robot).is_quaternion else reduced_coordinates)(robot)


def _origin(robot: Robot) -> str:
    return _ORIGINS[robot.base.origin]


def _listed(
    robot: Robot, entries: Entries, base: list[str], joints: list[str]
) -> tuple[Coordinate, ...]:
    """Entries of q or of v with meanings: the base's own, attitude first, and of the joints.

    `joints` say what the entry of each is of it.
    """
    labels = (joint_label(robot, i) for i in robot.moving)
    own = [f"{what} of {label}" for what, label in zip(joints, labels, strict=True)]
    meanings = entries.joined(base, own)
    return tuple(map(Coordinate, entries.names, entries.units, meanings))


def coordinate_text(robot: Robot, place: int) -> str:
    """An entry of v in a message, such as "theta_8 (the joint of link 2)"; places are from 0."""
    v = layout_of(robot).v
    name, joints = v.names[place], v.joint_places
    if place not in joints:
        return name
    return f"{name} (the joint of {link_label(robot, robot.moving[joints.index(place)])})"


def held_coordinate(robot: Robot, arm: int) -> Coordinate:
    """The angle of a joint that a constraint torque holds, such as θ_k of a base rod.

    `arm` is that of the rod, 2 to N, or N + i for link i.
    """
    if arm <= robot.base.rotors:
        return Coordinate(f"theta_{arm}", "rad", f"constrained angle of base arm {arm}")
    i = arm - robot.rotors
    return Coordinate(
        coordinate_of(robot, i), "rad", f"constrained angle of {joint_label(robot, i)}"
    )


def constraint_torque(robot: Robot, arm: int) -> Coordinate:
    """The torque that holds a joint, such as τ'_k of a base rod.

    `arm` is that of the rod, 2 to N, or N + i for link i.
    """
    if arm <= robot.base.rotors:
        return Coordinate(f"tau_prime_{arm}", "N m", f"constraint torque on base arm {arm}")
    i = arm - robot.rotors
    name = coordinate_of(robot, i)
    suffix = name.removeprefix("theta_") if robot.links[i - 1].name is None else name
    return Coordinate(f"tau_prime_{suffix}", "N m", f"constraint torque of {joint_label(robot, i)}")


def held_arms(robot: Robot) -> tuple[int, ...]:
    """What constraint torques hold: base rods 2 to N, then N + i for links i."""
    rods = range(2, robot.base.rotors + 1)
    return (*rods, *(robot.rotors + i for i in robot.constrained))


def hybrid_coordinates(robot: Robot) -> tuple[Coordinate, ...]:
    """The 6 + n + 2c hybrid unknowns, of n joints that move and c that are held."""
    free, first = free_unknowns(robot), layout_of(robot).constrained.start
    arms = held_arms(robot)
    return (
        *free[:first],
        *(held_coordinate(robot, arm) for arm in arms),
        *free[first:],
        *(constraint_torque(robot, arm) for arm in arms),
    )


def inputs(robot: Robot) -> tuple[Coordinate, ...]:
    """Entries of u: N thrusts, then n torques of joints that move (forces where prismatic)."""
    thrusts = []
    for k in range(1, robot.rotors + 1):
        label = rotor_identifier(robot, k)
        thrusts.append(Coordinate(f"F_{label}", "N", f"thrust of motor {label}"))
    joints = []
    for i in robot.moving:
        link, name = robot.links[i - 1], coordinate_of(robot, i)
        unit = joint_terms(robot, i).effort_unit
        kind = "force" if unit == "N" else "torque"
        named = link.name or link.coordinate
        suffix = name if named else name.partition("_")[2]
        joints.append(Coordinate(f"tau_{suffix}", unit, f"{kind} of {joint_label(robot, i)}"))
    return (*thrusts, *joints)


def points(robot: Robot) -> tuple[str, ...]:
    """Names of points, in the order of `positions`.

    No two are of one name: the later of two says what it is as well.
    """
    names = ["O1", "O2"] if robot.base.rotors else ["base"]
    names += [f"motor{k}" for k in range(1, robot.base.rotors + 1)]
    # No rotor may pass for the tip, nor a frame for the base centre.
    own = {"O1", "O2", "base"}
    for kind, name in _placed_names(robot):
        reserved = own if kind == "frame" else own | {"tip"}
        while name in reserved or name in names:
            name = f"{kind}_{name}"
        names.append(name)
    return tuple(names)


def _placed_names(robot: Robot) -> Iterator[tuple[str, str]]:
    """Points of the rotors, joints and frames: what each is, and its name."""
    for k, rotor in enumerate(robot.thrusters, start=1):
        yield "rotor", identifier(rotor.name) if rotor.name else default_prefix("rotor", k)
    for i in robot.moving:
        link = robot.links[i - 1].name
        yield "joint", f"joint_{identifier(link)}" if link else f"joint{robot.rotors + i}"
    yield from (("frame", name) for name in frame_names(robot)[1:])


def frames_of(robot: Robot) -> tuple[Frame, ...]:
    """Frames in the order of FRAMES: the base's, the tip where there is one, and the file's.

    Where the links are one arm, the tip is the end of the last link, along x; the paper's base
    without an arm has it at its centre.
    """
    frames = [Frame("base")]
    if has_default_tip(robot):
        links = len(robot.links)
        length = robot.links[-1].body.length if links else 0.0
        frames.append(Frame("tip", links, Pose((length, 0.0, 0.0))))
    return (*frames, *robot.frames)


def has_default_tip(robot: Robot) -> bool:
    """Whether the end of the arm is a frame of its own accord.

    So it is of one arm, or a base of rods without any, if no frame is named "tip".
    """
    arm = robot.is_serial and bool(robot.links or robot.base.rotors)
    return arm and all(frame.name != "tip" for frame in robot.frames)


def frame_names(robot: Robot) -> tuple[str, ...]:
    """Identifiers of the frames, as FRAMES of a generated module has them."""
    return tuple(identifier(frame.name) for frame in frames_of(robot))


# Components of a wrench.
WRENCH_PARTS = ("fx", "fy", "fz", "tx", "ty", "tz")
# How names end of entries that people named, and how other names begin, by argument.
_ENDINGS = {"q": "q", "a": "rate"}
_BEGINNINGS = {"q": ""}
_OF_COORDINATES = ("q", "q0", "q1")
_OF_VELOCITIES = ("v", "a", "w", "q_dot", "v_dot", "a_dot")


def local_names(robot: Robot) -> dict[str, tuple[str, ...]]:
    """Names of the entries of all arguments, by the names of `interface.ARGUMENTS`."""
    layout = layout_of(robot)
    given = {
        coordinate_of(robot, i)
        for i in robot.moving
        if robot.links[i - 1].coordinate or robot.links[i - 1].name
    }
    names = {}
    for argument in (*_OF_COORDINATES, *_OF_VELOCITIES):
        entries = (layout.v if argument in _OF_VELOCITIES else layout.q).names
        ending = _ENDINGS.get(argument, argument)
        beginning = _BEGINNINGS.get(argument, f"{argument}_")
        names[argument] = tuple(
            f"{entry}_{ending}" if entry in given else f"{beginning}{entry}" for entry in entries
        )
    names["u"] = _input_names(robot, given)
    names["u_dot"] = tuple(f"{name}_dot" for name in names["u"])
    names["h"] = ("time_step",)
    names["W"] = tuple(f"W_{frame}_{part}" for frame in frame_names(robot) for part in WRENCH_PARTS)
    return names


def _input_names(robot: Robot, given: set[str]) -> tuple[str, ...]:
    """Names of the inputs: F_1, or rotor_F where it has a name, and likewise of the joints."""
    named = [rotor.name is not None for rotor in robot.thrusters] or [False] * robot.rotors
    named += [coordinate_of(robot, i) in given for i in robot.moving]
    names = []
    for entry, has_name in zip(inputs(robot), named, strict=True):
        letter, _, rest = entry.name.partition("_")
        names.append(f"{rest}_{letter}" if has_name else entry.name)
    return tuple(names)
