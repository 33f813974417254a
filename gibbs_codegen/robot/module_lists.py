"""What a generated module lists of its robot, by the names of the module's constants."""

from __future__ import annotations

from collections.abc import Collection

from gibbs_codegen.interface import FUNCTIONS, LISTS
from gibbs_codegen.robot.base_parameters import base_parameters
from gibbs_codegen.robot.coordinates import (
    frame_names,
    frames_of,
    hybrid_coordinates,
    inputs,
    points,
)
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import BASE, Robot
from gibbs_codegen.robot.names import default_prefix, identifier


def module_lists(robot: Robot, derivatives: Collection[str] = ()) -> dict[str, tuple[str, ...]]:
    """Names of all that arguments and results of the functions have entries or rows for.

    Args:
        robot: The robot.
        derivatives: Names of the functions generated on request that the module has.

    Returns:
        Names in order, by the constant that has them; the base parameters where a function has
        entries for them.
    """
    layout = layout_of(robot)
    lists = {
        "COORDINATES": layout.q.names,
        "VELOCITIES": layout.v.names,
        "HYBRID_COORDINATES": tuple(c.name for c in hybrid_coordinates(robot)),
        "INPUTS": tuple(c.name for c in inputs(robot)),
        "POINTS": points(robot),
        "FRAMES": frame_names(robot),
        "BODIES": body_names(robot),
    }
    outputs = [output for name in derivatives for output in FUNCTIONS[name].outputs]
    if any(LISTS.get(letter) == "BASE_PARAMETERS" for o in outputs for letter in o.shape):
        lists["BASE_PARAMETERS"] = tuple(entry.name for entry in base_parameters(robot))
    return lists


def carriers(robot: Robot) -> tuple[str, ...]:
    """What carries each of the points: the point of the joint that moves it, or the base centre."""
    names, rods = points(robot), robot.base.rotors
    joints = iter(names[names.index("O2" if rods else "base") + 1 + robot.rotors :])
    of_body = {BASE: "O2" if rods else "base"}
    for i, link in enumerate(robot.links, start=1):
        of_body[i] = next(joints) if link.moves else of_body[robot.parents[i - 1]]
    bodies = [BASE] * (2 + rods if rods else 1)
    bodies += [rotor.on for rotor in robot.thrusters]
    bodies += [robot.parents[i - 1] for i in robot.moving]
    bodies += [frame.on for frame in frames_of(robot)[1:]]
    return tuple(of_body[body] for body in bodies)


def body_names(robot: Robot) -> tuple[str, ...]:
    """Names of the bodies that a joint, which may be held or welded, connects to another.

    Args:
        robot: The robot, of N rotors.

    Returns:
        Identifiers: of the base's rods base_arm2 … base_armN, then of the links.
    """
    rods = (f"base_arm{k}" for k in range(2, robot.base.rotors + 1))
    links = (
        identifier(link.name) if link.name else default_prefix("link", i)
        for i, link in enumerate(robot.links, start=1)
    )
    return (*rods, *links)
