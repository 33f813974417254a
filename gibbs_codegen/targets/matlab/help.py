"""The help texts of functions in MATLAB, and those of the lists of a module."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass, replace

from gibbs_codegen.interface import FUNCTIONS, Row, Signature
from gibbs_codegen.robot.layout import (
    Coordinate,
    hybrid_coordinates,
    inputs,
    reduced_coordinates,
    velocities,
)
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.module_lists import base_parameters, module_lists
from gibbs_codegen.targets.documentation import (
    HANGING,
    argument_text,
    attitude_lines,
    coordinate_table,
    details,
    meaning,
    output_text,
    unknown_table,
    wrapped,
)
from gibbs_codegen.targets.matlab.statements import column

Lines = list[str]

# What the entries of each list are, by the constant that has it in other languages. As files differ
# in more than capitals, no list has the name of a function.
LISTS = {
    "COORDINATES": ("coordinate_names", "coordinates q"),
    "VELOCITIES": ("velocity_names", "velocities v, whose rates are a"),
    "HYBRID_COORDINATES": ("hybrid_coordinate_names", "unknowns of the hybrid system"),
    "INPUTS": ("input_names", "inputs u"),
    "POINTS": ("point_names", "points"),
    "FRAMES": ("frame_names", "frames, also of rows in W"),
    "BODIES": ("body_names", "bodies"),
    "BASE_PARAMETERS": ("base_parameter_names", "base parameters"),
}


@dataclass(frozen=True)
class ListText:
    """A list: its function, what its entries are, and these, as what stands in braces.

    `table` explains the entries, and `results` is what the function returns. Whether entries have
    units goes by the kind of list, not by whether this robot has any entries.
    """

    header: Lines
    package: str
    name: str
    title: str
    what: str
    results: str
    table: Lines
    names: Lines
    has_units: bool
    units: Lines


def list_texts(robot: Robot, derivatives: Collection[str], header: Lines) -> dict[str, ListText]:
    """The texts of all lists, by the names of their functions."""
    explained: dict[str, tuple[Coordinate, ...]] = {
        "COORDINATES": reduced_coordinates(robot),
        "VELOCITIES": velocities(robot),
        "HYBRID_COORDINATES": hybrid_coordinates(robot),
        "INPUTS": inputs(robot),
        "BASE_PARAMETERS": base_parameters(robot),
    }
    texts = {}
    for constant, names in module_lists(robot, derivatives).items():
        name, what = LISTS[constant]
        has_units = constant in explained
        entries = explained.get(constant, ())
        table = coordinate_table(entries)
        if constant == "HYBRID_COORDINATES":
            table = unknown_table(robot)
        if constant == "COORDINATES":
            table = [*table, "", *attitude_lines(robot)]
        texts[name] = ListText(
            header=header,
            package=robot.name,
            name=name,
            title=name.upper(),
            what=what,
            results="[names, units]" if has_units else "names",
            table=["", *table] if table else [],
            names=column([f"'{entry}'" for entry in names]),
            has_units=has_units,
            units=column([f"'{entry.unit}'" for entry in entries]),
        )
    return texts


# The package's functions that return what other languages have as constants.
_NAMED = {constant: name for constant, (name, _) in LISTS.items()}
_NAMED |= {"PARAMETERS": "parameters", "PATTERNS": "patterns"}
# Of a line, which begins with "%   ".
_WIDTH = 96


def help_text(robot: Robot, signature: Signature, work: str, constants: int) -> list[str]:
    """Documentation of a function as MATLAB's `help` shows it, without the sign of a comment.

    `work` is as of `documentation.docstring`; `constants` is how many there are.
    """
    row = _in_own_names(FUNCTIONS[signature.name])
    places = zip(signature.arguments, signature.argument_shapes, strict=True)
    takes = [
        f"{a}  {_size(shape)}: {meaning(robot, a)}, {argument_text(robot, a)}"
        for a, shape in places
    ]
    takes.append(
        f"constants  {_size((constants,))}: what {robot.name}.prepare() returns; those of the "
        "default parameters if omitted"
    )
    returns = [
        f"{output.name}  {_size(sizes)}: {output_text(robot, output)}"
        for output, sizes in zip(row.outputs, signature.shapes, strict=True)
    ]
    sections = {
        "Arguments, of k states each, or of one that serves for all:": takes,
        "Results:": returns,
        f"Source: {row.source}. {work}.": [],
    }
    names = [output.name for output in row.outputs]
    results = names[0] if len(names) == 1 else f"[{', '.join(names)}]"
    called = f"{results} = {robot.name}.{signature.name}"
    given = ", ".join(signature.arguments), ", ".join([*signature.arguments, "constants"])
    lines = wrapped([f"{called}({one})" for one in given], _WIDTH, HANGING)
    lines += ["", *wrapped([details(robot, row)], _WIDTH, "")] if row.details else []
    for heading, items in sections.items():
        body = [f"{HANGING}{line}" for line in wrapped(items, _WIDTH - len(HANGING), HANGING)]
        lines += ["", *wrapped([heading], _WIDTH, ""), *body]
    calls = [f"   {line}".rstrip() for line in lines]
    return [f"{signature.name.upper()} {row.summary}", *calls]


def _in_own_names(row: Row) -> Row:
    """A row whose words name functions of the package in place of constants."""

    def named(text: str) -> str:
        return re.sub(r"\b[A-Z_]+\b", lambda found: _NAMED.get(found[0], found[0]), text)

    outputs = tuple(replace(output, entries=named(output.entries)) for output in row.outputs)
    return replace(row, outputs=outputs, summary=named(row.summary), details=named(row.details))


def _size(shape: tuple[int, ...]) -> str:
    """The size of an array in MATLAB, with an axis for states."""
    return " x ".join([*map(str, shape or (1,)), "k"])
