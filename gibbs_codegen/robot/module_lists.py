"""What a generated module lists of its robot, by the names of the module's constants."""

from __future__ import annotations

from collections.abc import Collection

from gibbs_codegen.interface import FUNCTIONS, LISTS
from gibbs_codegen.robot.base_parameters import base_parameters
from gibbs_codegen.robot.coordinates import frame_names, hybrid_coordinates, inputs, points
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import default_prefix, identifier


def module_lists(robot: Robot, derivatives: Collection[str] = ()) -> dict[str, tuple[str, ...]]:
    """Names of what arguments and results have entries or rows for, by the constant that has them.

    Base parameters are among them where a function of `derivatives`, those on request, has entries
    for them.
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


def body_names(robot: Robot) -> tuple[str, ...]:
    """Identifiers of bodies that a joint, which may be held or welded, connects to another.

    They are the base's rods base_arm2 … base_armN, then the links.
    """
    rods = (f"base_arm{k}" for k in range(2, robot.base.rotors + 1))
    links = (
        identifier(link.name) if link.name else default_prefix("link", i)
        for i, link in enumerate(robot.links, start=1)
    )
    return (*rods, *links)
