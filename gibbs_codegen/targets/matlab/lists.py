"""What a package in MATLAB lists of its robot: a function for each list, with names and units."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from gibbs_codegen.robot.base_parameters import base_parameters
from gibbs_codegen.robot.coordinates import (
    Coordinate,
    hybrid_coordinates,
    inputs,
    reduced_coordinates,
    velocities,
)
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.module_lists import module_lists
from gibbs_codegen.targets.documentation import attitude_lines, coordinate_table, unknown_table
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
