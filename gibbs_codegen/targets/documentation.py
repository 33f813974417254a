"""Arguments and results of a robot's functions in words, and documentation in each language."""

from __future__ import annotations

import textwrap
from functools import lru_cache

from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, LISTS, Output, Row, Signature
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Function
from gibbs_codegen.robot.description import Coordinate, Description
from gibbs_codegen.targets.printers import Context, InfixPrinter

# Widths of a docstring's lines, indented by four, and of a C comment's, which begin with " * ".
_DOCSTRING_WIDTH, _DOXYGEN_WIDTH = 96, 97
HANGING = "    "
# Arguments whose entries the header lists before its functions.
_LISTED_ABOVE = ("q", "v", "a", "u")


def docstring(description: Description, signature: Signature, work: str) -> list[str]:
    """Documentation of a Python function as it stands between quotes, without indentation.

    `work` is what a call takes: what `operations` or `calls` returns.
    """
    row = FUNCTIONS[signature.name]
    takes = [
        f"{a}: {meaning(description, a)}, {argument_text(description, a)}"
        for a in signature.arguments
    ]
    takes.append("constants: result of `prepare`; default: the constants of the default parameters")
    returns = ["Returns:"]
    for output, sizes in zip(row.outputs, signature.shapes, strict=True):
        shape = ", ".join(["...", *map(str, sizes)])
        returns.append(f"{output.name}: array ({shape}); {output_text(description, output)}")
    returns.append(f"Source: {row.source}. {work}.")
    lines = [row.summary]
    if row.details:
        lines += ["", *wrapped([details(description, row)], _DOCSTRING_WIDTH, "")]
    for items in (takes, returns):
        lines += ["", *wrapped(items, _DOCSTRING_WIDTH, HANGING)]
    return lines


def doxygen(description: Description, signature: Signature, work: str, stack: int) -> list[str]:
    """Documentation of a C function as it stands in a comment, without what that begins with.

    `work` is as of `docstring`; `stack` is what it takes for one state of doubles (bytes).
    """
    row = FUNCTIONS[signature.name]
    items = [
        f"@param[in] constants result of {description.robot.name}_init_constants(), or "
        f"&{description.robot.name}_default_constants"
    ]
    for a, width in zip(signature.arguments, signature.widths, strict=True):
        listed = ", as above" if a in _LISTED_ABOVE else f": {argument_text(description, a)}"
        items.append(f"@param[in] {a} {meaning(description, a)}, {width} entries{listed}")
    for output, sizes in zip(row.outputs, signature.shapes, strict=True):
        shape = " x ".join(map(str, sizes)) or "1"
        items.append(f"@param[out] {output.name} {shape}: {output_text(description, output)}")
    if row.parts:
        items.append(
            "@note One output may be NULL, if the module has the function of the other output."
        )
    items += [f"@note {work}; about {stack} bytes of stack for one state of doubles, optimised."]
    lines = [f"@brief {row.summary}", ""]
    if row.details:
        lines += [*wrapped([details(description, row)], _DOXYGEN_WIDTH, ""), ""]
    # What stands beside @par is a title, and what it is the title of begins on the next line.
    return [*lines, *wrapped(items, _DOXYGEN_WIDTH, HANGING), "@par Source", f"{row.source}."]


def sparse_doxygen(signature: Signature, lengths: dict[str, int], stack: int) -> list[str]:
    """Documentation of a C function that writes matrices without their zeros.

    The signature is that of the function that writes whole matrices; `lengths` are how many entries
    it writes of each matrix, `stack` is as of `doxygen`.
    """
    as_there = f"as of {signature.name}"
    items = [f"@param[in] {name} {as_there}" for name in ("constants", *signature.arguments)]
    for output in FUNCTIONS[signature.name].outputs:
        entries = as_there
        if output.name in lengths:
            places = f"{output.name}_rows and {output.name}_columns"
            entries = f"{lengths[output.name]}: the entries at {places}"
        items.append(f"@param[out] {output.name} {entries}")
    items.append(
        f"@note It calls {signature.name}, and picks the entries; about {stack} bytes of stack for "
        "one state of doubles, optimised."
    )
    brief = f"@brief As {signature.name}, with only the nonzero entries of its matrices."
    return [brief, "", *wrapped(items, _DOXYGEN_WIDTH, HANGING)]


def meaning(description: Description, argument: str) -> str:
    """Words for an argument, one of `interface.ARGUMENTS`, that its entries follow."""
    row = ARGUMENTS[argument]
    return (description.layout.turns_with_base and row.with_quaternion) or row.meaning


def details(description: Description, row: Row) -> str:
    """Details of a function beyond its summary, or ""."""
    has_three_angles = len(description.layout.angle_axes) == 3
    return row.details.format(singularity=_SINGULARITY if has_three_angles else "")


_SINGULARITY = (
    ": near +-90 degrees of the middle attitude angle the accelerations of the other two grow "
    "as the inverse of its cosine, and results that depend on them lose as many digits"
)


def operations(function: Function) -> str:
    """The number of operations of a function, in words."""
    counts = function.operations
    arctangents = f", {counts.arctangents} arctangents" if counts.arctangents else ""
    return f"{counts.total} operations, {counts.sine_cosine_pairs} sine-cosine pairs{arctangents}"


def calls(description: Description, name: str) -> str:
    """The functions that a composed one calls, and how often, in words."""
    counts = {**FUNCTIONS[name].composed}
    if not description.layout.turns_with_base:  # Sums need no matrices.
        counts.pop("integrate_derivatives", None)
    return f"Calls: {', '.join(f'{count} of {part}' for part, count in counts.items())}"


def wrapped(items: list[str], width: int, hanging: str) -> list[str]:
    """Items, each on lines of its own; those after an item's first begin with `hanging`."""
    return [
        line for item in items for line in textwrap.wrap(item, width, subsequent_indent=hanging)
    ]


def argument_text(description: Description, argument: str) -> str:
    """Entries of an argument with units, as "theta_m1 [rad], theta_0 [rad]"."""
    row, shape = ARGUMENTS[argument], ARGUMENTS[argument].shape
    if shape == "f6":
        return f"force [N] and torque [N m], a row for each of {', '.join(description.frames)}"
    if len(shape) > 1:
        v, u = _names(description.velocities), _names(description.inputs)
        axes = {"3": "x, y, z", "v": v, "u": u}
        first, second = (axes[letter] for letter in shape)
        return f"[{row.unit}], a row for each of {first}, a column for each of {second}"
    # Velocities along and about the base's axes have names of their own, and none that is in q.
    own_names = argument == "v" and description.layout.turns_with_base
    prefix = "" if own_names else row.prefix
    if not shape:
        return f"{prefix} [{row.unit}]"
    if shape == "g":
        listed = [Coordinate(name, "1", "") for name in description.lists().get("CONSTRAINTS", ())]
    else:
        listed = [*description.explained[LISTS[shape]]]
    units = {c.name: row.unit.format(unit=c.unit, step=c.unit.removesuffix("/s")) for c in listed}
    return ", ".join(f"{prefix}{name} [{unit}]" for name, unit in units.items())


def output_text(description: Description, output: Output) -> str:
    """The entries of an output: names with units, or the units alone."""
    return output.entries.format(unit=output.unit, **_entry_lists(description))


@lru_cache(maxsize=1)
def _entry_lists(description: Description) -> dict[str, str]:
    """Entries of the outputs with their units, by the words that stand for them in the table."""
    return {
        "accelerations": argument_text(description, "a"),
        "forces": _forces(description.free_unknowns),
        "hybrid_forces": _forces(description.hybrid_coordinates),
        "coordinates": _units(description.coordinates),
        "coordinate_rates": _units(description.coordinates, "/s"),
        "velocities": argument_text(description, "v"),
        "displacement": _units(description.velocities).replace("/s]", "]"),
        "constraint_torques": _units(description.constraint_torques),
        "points": ", ".join(description.points),
        "frames": ", ".join(description.frames),
        "bodies": ", ".join(description.bodies),
        "base_parameters": _units(description.base_parameters),
        "inputs": _units(description.inputs),
        "rotors": _units(description.inputs[: description.robot.rotors]),
        "rotor_names": _names(description.inputs[: description.robot.rotors]),
        "commands": _units(description.commands),
        "actuator_states": _units(description.actuator_states),
        "actuator_rates": _units(description.actuator_states, "/s"),
        "constraint_errors": _units(description.constraint_rows),
        "constraint_rows": _names(description.constraint_rows),
        "constraint_accelerations": _units(description.constraint_rows, "/s^2"),
        "constraint_forces": _forces(description.constraint_rows),
        "constraint_impulses": _forces(description.constraint_rows).replace("]", " s]"),
    }


def _names(listed: tuple[Coordinate, ...]) -> str:
    return ", ".join(c.name for c in listed)


def _units(listed: tuple[Coordinate, ...], per_time: str = "") -> str:
    return ", ".join(f"{c.name} [{c.unit}{per_time}]".replace("/s/s", "/s^2") for c in listed)


_FORCE_UNITS = {"rad": "N m", "m": "N", "rad/s": "N m", "m/s": "N", "N m": "rad/s^2"}


def _forces(unknowns: tuple[Coordinate, ...]) -> str:
    return ", ".join(f"{c.name} [{_FORCE_UNITS[c.unit]}]" for c in unknowns)


def attitude_text(description: Description) -> str:
    """The attitude as a product, as R_x(theta_m1) R_y(theta_0) R_z(theta_1), or a quaternion."""
    layout = description.layout
    names = layout.q.names[layout.q.attitude]
    if layout.is_quaternion:
        return f"the unit quaternion {', '.join(names)}, its scalar part last"
    product = " ".join(
        f"R_{axis}({angle})" for axis, angle in zip(layout.angle_axes, names, strict=True)
    )
    if layout.moves_freely:
        return product
    pose = "the pose of the base in the robot file"
    return f"{product} times {pose}" if product else pose


def base_frame(description: Description) -> str:
    """The name of the frame of the base.

    It is that of arm 1 where the base is made of rods by the paper's rule.
    """
    by_rule = description.robot.base.rotors and description.robot.base.azimuth_deg is None
    return "base arm 1's frame" if by_rule else "the base's frame"


def attitude_lines(description: Description) -> list[str]:
    """The attitude of a module for a comment, without the comment's sign."""
    says = f"From {base_frame(description)} to the world the attitude is"
    if description.layout.moves_freely and not description.layout.is_quaternion:
        says = f"Intrinsic sequence of the attitude angles. {says}"
    return [says, f"{attitude_text(description)}."]


def state_tables(description: Description) -> dict[str, list[str]]:
    """Lines that explain the entries of q, v and a, by headings."""
    coordinates = coordinate_table(description.coordinates)
    if not description.layout.turns_with_base:
        title = "Coordinates q, in order (v: their rates, a: their accelerations)"
        return {title: coordinates}
    return {
        "Coordinates q, in order": coordinates,
        "Velocities v, in order (a: their rates)": coordinate_table(description.velocities),
    }


_DERIVATIVES = {
    "rad": ("rad/s^2", "second derivative of the "),
    "m": ("m/s^2", "second derivative of the "),
    "rad/s": ("rad/s^2", "derivative of the "),
    "m/s": ("m/s^2", "derivative of the "),
    "N m": ("N m", ""),
}


def unknown_table(description: Description) -> list[str]:
    """A table of the unknowns of the hybrid system: accelerations, then constraint torques."""
    unknowns = []
    for entry in description.hybrid_coordinates:
        unit, prefix = _DERIVATIVES[entry.unit]
        unknowns.append(Coordinate(entry.name, unit, f"{prefix}{entry.meaning}"))
    return coordinate_table(tuple(unknowns))


def entry_lines(tables: dict[str, list[str]]) -> list[str]:
    """Tables one below the other, under their headings; none without lines."""
    lines = []
    for heading, entries in ((h, e) for h, e in tables.items() if e):
        lines += ["", f"{heading}:", "", *(f"    {entry}" for entry in entries)]
    return lines[1:]


def coordinate_table(coordinates: tuple[Coordinate, ...]) -> list[str]:
    """Lines that explain coordinates one by one: name, unit, meaning."""
    width = max((len(c.name) for c in coordinates), default=0)
    return [f"{c.name:<{width}}  [{c.unit}]  {c.meaning}" for c in coordinates]


def parameter_texts(model: Model, printer: InfixPrinter) -> list[Context]:
    """The parameters: name, default as a literal, and unit of each."""
    return [
        {"name": printer.name(name), "value": printer.number(value), "unit": model.units[name]}
        for name, value in model.defaults.items()
    ]
