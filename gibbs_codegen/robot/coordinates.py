"""Names, order and units of coordinates, inputs and points, as section 7 of the method orders them.

Reduced coordinates, with Tait–Bryan angles: θ₋₁, θ₀, θ₁, θ_{N+1} … θ_{N+n}, x, y, z; with a
quaternion: x, y, z, qx, qy, qz, qw, θ_{N+1} … θ_{N+n}. Hybrid unknowns are the accelerations, in
the order of v, with those of the constrained angles θ₂ … θ_N before the joints', and the constraint
torques τ'₂ … τ'_N at the end. A prismatic joint's coordinate is a travel and is called d instead of
θ.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gibbs_codegen.robot.layout import Entries, joint_terms, layout_of
from gibbs_codegen.robot.model import Frame, Pose, Robot
from gibbs_codegen.robot.names import (
    coordinate_of,
    default_prefix,
    identifier,
    joint_label,
    link_label,
    rotor_identifier,
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
