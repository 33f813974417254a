"""What each emitted function is, in words: the same for every target."""

from __future__ import annotations

from dataclasses import dataclass

from gibbs_codegen.robot.coordinates import (
    Coordinate,
    constraint_torque,
    hybrid_coordinates,
    inputs,
    points,
    reduced_coordinates,
)
from gibbs_codegen.robot.layout import ATTITUDE
from gibbs_codegen.robot.model import Robot


@dataclass(frozen=True)
class Description:
    """What a function returns, details, the equation it implements, and its outputs' names."""

    summary: str
    details: str
    source: str
    outputs: tuple[str, ...]


DESCRIPTIONS: dict[str, Description] = {
    "mass_matrix_and_residual": Description(
        "Mass matrix M and residual R of M a = R + B u, in one pass.",
        "R holds the velocity terms and gravity, with the sign of a force.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        ("mass_matrix", "residual"),
    ),
    "mass_matrix": Description(
        "Mass matrix M of M a = R + B u, symmetric, both triangles filled.",
        "The same matrix as Pinocchio's crba gives for these coordinates.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        ("mass_matrix",),
    ),
    "residual": Description(
        "Residual R of M a = R + B u: velocity terms and gravity, with the sign of a force.",
        "It is minus what Pinocchio calls nonLinearEffects.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        ("residual",),
    ),
    "input_matrix": Description(
        "Input matrix B of M a = R + B u.",
        "Column k holds the generalised forces of a unit of input k.",
        "eqs. 7-13",
        ("input_matrix",),
    ),
    "forward_dynamics": Description(
        "Accelerations a of M a = R + B u.",
        "Accurate at every attitude: next to +-90 degrees of the middle attitude angle the "
        "accelerations of the other two grow as the inverse of its cosine, and what is computed "
        "from them loses as many digits. Where links without mass or thickness let joints move "
        "nothing, as a massless wrist with two axes in line, results are huge, infinite or not a "
        "number.",
        "eq. 19, solved for the free coordinates",
        ("acceleration",),
    ),
    "inverse_dynamics": Description(
        "Generalised forces M a - R that the motion needs; B u supplies them.",
        "The partial derivatives of the Gibbs function by the accelerations.",
        "eqs. 4-6",
        ("force",),
    ),
    "hybrid_mass_matrix": Description(
        "Matrix I_H of the hybrid system I_H a_H = R_H + B_H u.",
        "Rows and columns are in the order of HYBRID_COORDINATES; the last rows hold the "
        "constrained joints, the last columns their torques.",
        "eqs. 15, 18 and 19",
        ("mass_matrix",),
    ),
    "hybrid_residual": Description(
        "Residual R_H of the hybrid system I_H a_H = R_H + B_H u.",
        "Entries are in the order of HYBRID_COORDINATES.",
        "eqs. 15, 18 and 19",
        ("residual",),
    ),
    "hybrid_input_matrix": Description(
        "Input matrix B_H of the hybrid system I_H a_H = R_H + B_H u.",
        "Rows are in the order of HYBRID_COORDINATES, columns in that of INPUTS.",
        "eqs. 12, 13 and 18",
        ("input_matrix",),
    ),
    "constraint_torques": Description(
        "Torques that keep the base arms 2 ... N from turning against arm 1.",
        "Linear in the accelerations and inputs, which need not fit each other.",
        "eqs. 14 and 15",
        ("torque",),
    ),
    "gibbs": Description(
        "Gibbs function S up to terms free of accelerations, in W/s.",
        "Gravity enters as the upward acceleration of the base, so that dS/da = M a - R.",
        "eqs. 2 and 3",
        ("value",),
    ),
    "kinetic_energy": Description(
        "Kinetic energy in J.",
        "",
        "eq. 2 with rates for accelerations",
        ("energy",),
    ),
    "potential_energy": Description(
        "Potential energy in J, zero at world Z = 0.",
        "",
        "gravity times the first moment of mass",
        ("energy",),
    ),
    "positions": Description(
        "World positions of POINTS in m, one row each.",
        "",
        "forward kinematics",
        ("position",),
    ),
    "tip_pose": Description(
        "Homogeneous transform from the tip's frame to the world.",
        "The tip's frame has the last link's axes; without an arm it is arm 1's, at O2.",
        "forward kinematics",
        ("pose",),
    ),
    "tip_jacobian": Description(
        "Jacobian of the tip: linear rows, then angular rows, in world axes.",
        "It takes v to the velocity of the tip in m/s and rad/s.",
        "forward kinematics",
        ("jacobian",),
    ),
    "tip_bias_acceleration": Description(
        "Acceleration of the tip where a is zero, gravity left out, in world axes.",
        "It is the Jacobian's rate times v: the tip accelerates at tip_jacobian(q) a plus this, "
        "linear entries first, then angular.",
        "forward kinematics",
        ("bias_acceleration",),
    ),
}

_PREFIXES_AND_UNITS = {"q": ("", ""), "v": ("v_", "/s"), "a": ("a_", "/s^2")}


def argument_text(robot: Robot, argument: str) -> str:
    """Entries of an argument with their units, in order."""
    if argument == "u":
        return _listed(inputs(robot))
    prefix, per_time = _PREFIXES_AND_UNITS[argument]
    return ", ".join(f"{prefix}{c.name} [{c.unit}{per_time}]" for c in reduced_coordinates(robot))


def argument_meaning(argument: str) -> str:
    """What an argument is."""
    return {
        "q": "coordinates",
        "v": "their rates",
        "a": "their accelerations",
        "u": "inputs",
    }[argument]


def output_text(robot: Robot, function: str, output: str) -> str:
    """What the entries of a function's output are, with their units."""
    reduced = reduced_coordinates(robot)
    match output:
        case "acceleration":
            return argument_text(robot, "a")
        case "force" | "residual":
            unknowns = hybrid_coordinates(robot) if "hybrid" in function else reduced
            return ", ".join(f"{c.name} [{_FORCE_UNITS.get(c.unit, c.unit)}]" for c in unknowns)
        case "torque":
            return _listed(tuple(constraint_torque(k) for k in range(2, robot.rotors + 1)))
        case "position":
            return f"{', '.join(points(robot))} [m]"
        case _:
            return _ENTRIES[output]


_FORCE_UNITS = {"rad": "N m", "m": "N", "N m": "rad/s^2"}
_ENTRIES = {
    "mass_matrix": "[kg m^2] between angles, [kg] between lengths, [kg m] between both",
    "input_matrix": "[N/N], [N m/N] and [N m/(N m)], by row and column",
    "value": "[W/s]",
    "energy": "[J]",
    "pose": "axes [1] and position [m]",
    "jacobian": "[m/rad] or [1] in the first rows, [1] or [rad/m] in the others",
    "bias_acceleration": "[m/s^2] in the first three, [rad/s^2] in the others",
}


def attitude_text(robot: Robot) -> str:
    """The attitude as a product of rotations, such as R_x(theta_m1) R_y(theta_0) R_z(theta_1)."""
    angles = zip(robot.base.attitude, ATTITUDE, strict=True)
    return " ".join(f"R_{axis}({angle})" for axis, angle in angles)


def coordinate_table(coordinates: tuple[Coordinate, ...]) -> list[str]:
    """Lines that explain coordinates one by one."""
    width = max(len(c.name) for c in coordinates)
    return [f"{c.name:<{width}}  [{c.unit}]  {c.meaning}" for c in coordinates]


def _listed(coordinates: tuple[Coordinate, ...]) -> str:
    return ", ".join(f"{c.name} [{c.unit}]" for c in coordinates)
