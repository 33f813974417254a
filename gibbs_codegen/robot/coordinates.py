"""Names, order and units of coordinates, inputs and points, as section 7 of the method orders them.

Reduced coordinates, with Tait–Bryan angles: θ₋₁, θ₀, θ₁, θ_{N+1} … θ_{N+n}, x, y, z; with a
quaternion: x, y, z, qx, qy, qz, qw, θ_{N+1} … θ_{N+n}. Hybrid unknowns are the accelerations, in
the order of v, with those of the constrained angles θ₂ … θ_N before the joints', and the constraint
torques τ'₂ … τ'_N at the end. A prismatic joint's coordinate is a travel and is called d instead of
θ.
"""

from __future__ import annotations

from dataclasses import dataclass

from gibbs_codegen.robot.layout import JOINT_TERMS, Entries, layout_of
from gibbs_codegen.robot.model import Robot


@dataclass(frozen=True)
class Coordinate:
    """One entry of q, v, a, u or of the hybrid unknowns: its name, unit and meaning."""

    name: str
    unit: str
    meaning: str


def reduced_coordinates(robot: Robot) -> tuple[Coordinate, ...]:
    """Entries of q: attitude and position of the base, and the arm's joints.

    Args:
        robot: The robot, with n links.

    Returns:
        The coordinates, in order: 6 + n with Tait–Bryan angles, 7 + n with a quaternion.
    """
    layout = layout_of(robot)
    if layout.is_quaternion:
        attitude = [f"{part} part of the attitude quaternion" for part in ("x", "y", "z", "scalar")]
    else:
        places = zip(("first", "second", "third"), layout.attitude, strict=True)
        attitude = [f"{place} attitude angle, about {axis}" for place, axis in places]
    position = [f"world {axis} of {_origin(robot)}" for axis in "xyz"]
    what = ("travel" if link.joint == "prismatic" else "angle" for link in robot.links)
    return _listed(robot, layout.q, [*attitude, *position], list(what))


def velocities(robot: Robot) -> tuple[Coordinate, ...]:
    """Entries of v: rates of the coordinates, or of the base its velocities in its own frame.

    Args:
        robot: The robot, with n links.

    Returns:
        The 6 + n velocities, in order.
    """
    layout = layout_of(robot)
    if layout.is_quaternion:
        turning = [f"angular velocity of the base, about its {axis} axis" for axis in "xyz"]
        moving = [f"velocity of {_origin(robot)}, along the base's {axis} axis" for axis in "xyz"]
        base = [*turning, *moving]
    else:
        base = [f"rate of {layout.q.names[place]}" for place in layout.q.base]
    return _listed(robot, layout.v, base, ["rate"] * len(robot.links))


def free_unknowns(robot: Robot) -> tuple[Coordinate, ...]:
    """What the free unknowns of the hybrid system are the accelerations of.

    Args:
        robot: The robot.

    Returns:
        The coordinates, or the velocities where the base has a quaternion.
    """
    return (velocities if layout_of(robot).is_quaternion else reduced_coordinates)(robot)


def _origin(robot: Robot) -> str:
    return "motor 1 (O1)" if robot.base.origin == "motor1" else "the base centre (O2)"


def _listed(
    robot: Robot, entries: Entries, base: list[str], joints: list[str]
) -> tuple[Coordinate, ...]:
    """Entries of q or of v with their meanings.

    Args:
        robot: The robot.
        entries: Their places, names and units.
        base: Meanings of the base's own, attitude first.
        joints: What the entry of each joint is of it.

    Returns:
        The entries, in order.
    """
    numbered = enumerate(joints, start=robot.rotors + 1)
    meanings = entries.joined(base, [f"{what} of joint {number}" for number, what in numbered])
    return tuple(map(Coordinate, entries.names, entries.units, meanings))


def coordinate_text(robot: Robot, place: int) -> str:
    """An entry of v by its name and, of a joint, the link that it moves, for a message.

    Args:
        robot: The robot.
        place: Place in v, from 0.

    Returns:
        Such as "theta_8 (the joint of link 2)".
    """
    v = layout_of(robot).v
    name, joints = v.names[place], v.joint_places
    return f"{name} (the joint of link {joints.index(place) + 1})" if place in joints else name


def constrained_coordinate(k: int) -> Coordinate:
    """θ_k: the angle of a base arm against base arm 1, held constant.

    Args:
        k: Number of the arm, from 2 to N.

    Returns:
        The coordinate.
    """
    return Coordinate(f"theta_{k}", "rad", f"constrained angle of base arm {k}")


def constraint_torque(k: int) -> Coordinate:
    """τ'_k: the torque that keeps a base arm from turning against base arm 1.

    Args:
        k: Number of the arm, from 2 to N.

    Returns:
        The unknown.
    """
    return Coordinate(f"tau_prime_{k}", "N m", f"constraint torque on base arm {k}")


def hybrid_coordinates(robot: Robot) -> tuple[Coordinate, ...]:
    """Hybrid unknowns.

    Args:
        robot: The robot, with N rotors and n links.

    Returns:
        The 6 + n + 2(N − 1) unknowns, in order.
    """
    free, first = free_unknowns(robot), layout_of(robot).constrained.start
    arms = range(2, robot.rotors + 1)
    return (
        *free[:first],
        *(constrained_coordinate(k) for k in arms),
        *free[first:],
        *(constraint_torque(k) for k in arms),
    )


def inputs(robot: Robot) -> tuple[Coordinate, ...]:
    """Entries of u.

    Args:
        robot: The robot, with N rotors and n links.

    Returns:
        Thrusts F₁ … F_N, then n joint torques (forces where prismatic).
    """
    thrusts = tuple(
        Coordinate(f"F_{k}", "N", f"thrust of motor {k}") for k in range(1, robot.rotors + 1)
    )
    joints = []
    for i, link in enumerate(robot.links, start=1):
        kind = "force" if link.joint == "prismatic" else "torque"
        unit, number = JOINT_TERMS[link.joint].effort_unit, robot.rotors + i
        joints.append(Coordinate(f"tau_{number}", unit, f"{kind} of joint {number}"))
    return thrusts + tuple(joints)


def points(robot: Robot) -> tuple[str, ...]:
    """Named points of the robot.

    Args:
        robot: The robot.

    Returns:
        Their names, in the order of `positions`.
    """
    motors = tuple(f"motor{k}" for k in range(1, robot.rotors + 1))
    joints = tuple(f"joint{robot.rotors + i}" for i in range(1, len(robot.links) + 1))
    return ("O1", "O2", *motors, *joints, "tip")
