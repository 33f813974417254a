"""Base parameters: the fewest numbers of the bodies that determine the equations of motion.

Of a body's ten numbers, mass, first moment and second moments about its joint, a joint only feels
some; the others are added to those of the parent, as `derivation.regrouping` does it. What is left
with each body is independent of all others, whatever the lengths: the base flies freely, so its ten
can all be told apart, and from the leaves inwards so can what each joint feels. The dynamics is
linear in these parameters.
"""

from __future__ import annotations

from gibbs_codegen.robot.coordinates import Coordinate
from gibbs_codegen.robot.model import LinkKind, Robot
from gibbs_codegen.robot.names import parameter_prefix

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
