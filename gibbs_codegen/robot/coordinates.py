"""Names, order and units of coordinates, inputs and points, as section 7 of the method orders them.

Reduced coordinates: θ₋₁, θ₀, θ₁, θ_{N+1} … θ_{N+n}, x, y, z. Hybrid unknowns have the constrained
angles θ₂ … θ_N after θ₁ and the constraint torques τ'₂ … τ'_N at the end. A prismatic joint's
coordinate is a travel and is called d instead of θ.
"""

from __future__ import annotations

from dataclasses import dataclass

from gibbs_codegen.robot.layout import ATTITUDE, JOINT_TERMS, POSITION, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import joint_name


@dataclass(frozen=True)
class Coordinate:
    """One entry of q, v, a, u or of the hybrid unknowns: its name, unit and meaning."""

    name: str
    unit: str
    meaning: str


def reduced_coordinates(robot: Robot) -> tuple[Coordinate, ...]:
    """Entries of q: attitude angles, the arm's joints, world position of the coordinates' origin.

    Args:
        robot: The robot, with n links.

    Returns:
        The 6 + n coordinates, in order.
    """
    point = "motor 1 (O1)" if robot.base.origin == "motor1" else "the base centre (O2)"
    attitude = zip(ATTITUDE, ("first", "second", "third"), robot.base.attitude, strict=True)
    base = [
        *(
            Coordinate(n, "rad", f"{place} attitude angle, about {axis}")
            for n, place, axis in attitude
        ),
        *(Coordinate(name, "m", f"world {name} of {point}") for name in POSITION),
    ]
    joints = []
    for number, link in enumerate(robot.links, start=robot.rotors + 1):
        what = "travel" if link.joint == "prismatic" else "angle"
        name, unit = joint_name(link.joint, number), JOINT_TERMS[link.joint].unit
        joints.append(Coordinate(name, unit, f"{what} of joint {number}"))
    return tuple(layout_of(robot).joined(base, joints))


def coordinate_text(robot: Robot, place: int) -> str:
    """A coordinate by its name and the link that it moves, for a message.

    Args:
        robot: The robot.
        place: Place in q, from 0.

    Returns:
        Such as "theta_8 (the joint of link 2)".
    """
    layout = layout_of(robot)
    name, joints = layout.names[place], layout.joint_places
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
    reduced, first = reduced_coordinates(robot), layout_of(robot).constrained.start
    arms = range(2, robot.rotors + 1)
    return (
        *reduced[:first],
        *(constrained_coordinate(k) for k in arms),
        *reduced[first:],
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
