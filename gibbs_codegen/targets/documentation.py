"""What a robot's functions take and return, in words, and their documentation in each language."""

from __future__ import annotations

import textwrap

from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, Output
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function
from gibbs_codegen.program.operations import count_operations
from gibbs_codegen.program.stack import stack_bytes
from gibbs_codegen.program.trigonometry import gather_angles
from gibbs_codegen.robot.coordinates import (
    Coordinate,
    constraint_torque,
    held_arms,
    hybrid_coordinates,
    inputs,
    points,
    reduced_coordinates,
)
from gibbs_codegen.robot.layout import ATTITUDE
from gibbs_codegen.robot.model import Robot

# Of a docstring's lines, which are indented by four, and of a C comment's, which begin with " * ".
_DOCSTRING_WIDTH, _DOXYGEN_WIDTH = 96, 97
_HANGING = "    "


def docstring(model: Model, function: Function) -> list[str]:
    """Documentation of a Python function, as it stands between quotes.

    Args:
        model: The derived robot.
        function: One of its program's.

    Returns:
        Lines without indentation.
    """
    robot, row = model.robot, FUNCTIONS[function.name]
    takes = [f"{a}: {ARGUMENTS[a].meaning}, {argument_text(robot, a)}" for a in function.arguments]
    takes.append("constants: what `prepare` returns; those of the default parameters if omitted")
    returns = ["Returns:"]
    for output, shaped in zip(row.outputs, function.outputs, strict=True):
        shape = ", ".join(["...", *map(str, shaped.shape)])
        returns.append(f"{output.name}: array ({shape}); {output_text(robot, output)}")
    returns.append(f"Source: {row.source}. {_operations(function)}.")
    lines = [row.summary]
    if row.details:
        lines += ["", *_wrapped([row.details], _DOCSTRING_WIDTH, "")]
    for items in (takes, returns):
        lines += ["", *_wrapped(items, _DOCSTRING_WIDTH, _HANGING)]
    return lines


def doxygen(model: Model, function: Function) -> list[str]:
    """Documentation of a C function, as it stands in a comment.

    Args:
        model: The derived robot.
        function: One of its program's.

    Returns:
        Lines without what a comment begins with.
    """
    robot, row = model.robot, FUNCTIONS[function.name]
    items = [
        f"@param[in] constants what {robot.name}_init_constants() made, or "
        f"&{robot.name}_default_constants"
    ]
    for a in function.arguments:
        width = len(model.program.inputs[a])
        items.append(
            f"@param[in] {a} {ARGUMENTS[a].meaning}, {width} entries: {argument_text(robot, a)}"
        )
    for output, shaped in zip(row.outputs, function.outputs, strict=True):
        shape = " x ".join(map(str, shaped.shape)) or "1"
        items.append(f"@param[out] {output.name} {shape}: {output_text(robot, output)}")
    stack = stack_bytes(gather_angles(function))
    items += [
        f"@note {_operations(function)}; about {stack} bytes of stack for one state of doubles, "
        "optimised.",
        f"@par Source: {row.source}.",
    ]
    lines = [f"@brief {row.summary}", ""]
    if row.details:
        lines += [*_wrapped([row.details], _DOXYGEN_WIDTH, ""), ""]
    return lines + _wrapped(items, _DOXYGEN_WIDTH, _HANGING)


def _operations(function: Function) -> str:
    counts = count_operations(function.nodes())
    return f"{counts.total} operations, {counts.sine_cosine_pairs} sine-cosine pairs"


def _wrapped(items: list[str], width: int, hanging: str) -> list[str]:
    """Lines of items, each on lines of its own.

    Args:
        items: Text.
        width: Characters in a line.
        hanging: What the lines of an item after its first begin with.

    Returns:
        Lines.
    """
    return [
        line for item in items for line in textwrap.wrap(item, width, subsequent_indent=hanging)
    ]


def argument_text(robot: Robot, argument: str) -> str:
    """Entries of an argument with their units, in order.

    Args:
        robot: Whose entries they are.
        argument: q, v, a or u.

    Returns:
        Names with units, as "theta_m1 [rad], theta_0 [rad]".
    """
    row = ARGUMENTS[argument]
    listed = inputs(robot) if row.width == "u" else reduced_coordinates(robot)
    return ", ".join(f"{row.prefix}{c.name} [{c.unit}{row.per_time}]" for c in listed)


def output_text(robot: Robot, output: Output) -> str:
    """What the entries of a function's output are, with their units.

    Args:
        robot: Whose function it is.
        output: One of the function's row.

    Returns:
        Names with units, or the units alone.
    """
    torques = [constraint_torque(robot, arm) for arm in held_arms(robot)]
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
    """The attitude as a product of rotations, such as R_x(theta_m1) R_y(theta_0) R_z(theta_1).

    Args:
        robot: Whose attitude it is.

    Returns:
        The product as text.
    """
    angles = zip(robot.base.attitude, ATTITUDE, strict=True)
    return " ".join(f"R_{axis}({angle})" for axis, angle in angles)


def coordinate_table(coordinates: tuple[Coordinate, ...]) -> list[str]:
    """Lines that explain coordinates one by one.

    Args:
        coordinates: In order.

    Returns:
        A line each: name, unit, meaning.
    """
    width = max(len(c.name) for c in coordinates)
    return [f"{c.name:<{width}}  [{c.unit}]  {c.meaning}" for c in coordinates]
