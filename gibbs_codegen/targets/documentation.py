"""What a robot's functions take and return, in words: the same for every target."""

from __future__ import annotations

from gibbs_codegen.interface import ARGUMENTS, Output
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


def argument_text(robot: Robot, argument: str) -> str:
    """Entries of an argument with their units, in order."""
    row = ARGUMENTS[argument]
    listed = inputs(robot) if row.width == "u" else reduced_coordinates(robot)
    return ", ".join(f"{row.prefix}{c.name} [{c.unit}{row.per_time}]" for c in listed)


def output_text(robot: Robot, output: Output) -> str:
    """What the entries of a function's output are, with their units."""
    torques = [constraint_torque(k) for k in range(2, robot.rotors + 1)]
    return output.entries.format(
        unit=output.unit,
        accelerations=argument_text(robot, "a"),
        forces=_forces(reduced_coordinates(robot)),
        hybrid_forces=_forces(hybrid_coordinates(robot)),
        constraint_torques=", ".join(f"{c.name} [{c.unit}]" for c in torques),
        points=", ".join(points(robot)),
    )


_FORCE_UNITS = {"rad": "N m", "m": "N", "N m": "rad/s^2"}


def _forces(unknowns: tuple[Coordinate, ...]) -> str:
    return ", ".join(f"{c.name} [{_FORCE_UNITS[c.unit]}]" for c in unknowns)


def attitude_text(robot: Robot) -> str:
    """The attitude as a product of rotations, such as R_x(theta_m1) R_y(theta_0) R_z(theta_1)."""
    angles = zip(robot.base.attitude, ATTITUDE, strict=True)
    return " ".join(f"R_{axis}({angle})" for axis, angle in angles)


def coordinate_table(coordinates: tuple[Coordinate, ...]) -> list[str]:
    """Lines that explain coordinates one by one."""
    width = max(len(c.name) for c in coordinates)
    return [f"{c.name:<{width}}  [{c.unit}]  {c.meaning}" for c in coordinates]
