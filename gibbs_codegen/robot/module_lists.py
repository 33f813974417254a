"""What a generated module lists of its robot, by the names of the module's constants.

Base parameters are the fewest numbers of the bodies that determine the equations of motion. Of a
body's ten numbers, mass, first moment and second moments about its joint, a joint only feels some;
the others are added to those of the parent, as `derivation.group_passage` does it. What is left
with each body is independent of all others, whatever the lengths: the base flies freely, so its ten
can all be told apart, and from the leaves inwards so can what each joint feels. The dynamics is
linear in these parameters.
"""

from __future__ import annotations

from collections.abc import Collection

from gibbs_codegen.interface import FUNCTIONS, LISTS
from gibbs_codegen.robot.layout import (
    Coordinate,
    frame_names,
    frames_of,
    hybrid_coordinates,
    inputs,
    layout_of,
    points,
)
from gibbs_codegen.robot.model import BASE, LinkKind, Robot
from gibbs_codegen.robot.names import default_prefix, identifier, parameter_prefix

# The numbers of a body, ∫dm, ∫r dm and ∫rrᵀ dm, in the order of `derivation.inertia.Inertia`.
NUMBERS = {
    "mass": "kg",
    **{f"moment_{axis}": "kg m" for axis in "xyz"},
    **{f"second_{axes}": "kg m^2" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")},
}
# Those that are its parent's, by the joint along z that carries the body.
GIVEN: dict[LinkKind, tuple[str, ...]] = {
    "revolute": ("mass", "moment_z", "second_zz"),
    "prismatic": tuple(name for name in NUMBERS if name.startswith("second")),
}


def base_parameters(robot: Robot) -> tuple[Coordinate, ...]:
    """The base parameters: of the base, then of each link whose joint moves."""
    found = [Coordinate(f"base_{name}", unit, "") for name, unit in NUMBERS.items()]
    for i in robot.moving:
        prefix, given = parameter_prefix(robot, i), GIVEN[robot.links[i - 1].joint]
        kept = {name: unit for name, unit in NUMBERS.items() if name not in given}
        found += [Coordinate(f"{prefix}_{name}", unit, "") for name, unit in kept.items()]
    return tuple(found)


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
    """Identifiers of bodies that a joint, which may be held or welded, connects to another.

    They are the base's rods base_arm2 … base_armN, then the links.
    """
    rods = (f"base_arm{k}" for k in range(2, robot.base.rotors + 1))
    links = (
        identifier(link.name) if link.name else default_prefix("link", i)
        for i, link in enumerate(robot.links, start=1)
    )
    return (*rods, *links)
