"""Parts of the reference that follow from the package: keys of files, commands, C functions.

A page has a comment such as `<!-- generated: robot_keys -->` where such a part belongs.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from moving import hybrid_equation
from ways_to_fly import ways_to_fly

from gibbs_codegen.cli.app import argument_parser
from gibbs_codegen.files.table import json_schema
from gibbs_codegen.flight.scenario.file import ScenarioTable
from gibbs_codegen.interface import ARGUMENTS, FUNCTIONS, LISTS, Row
from gibbs_codegen.robot.tables import RobotTable

if TYPE_CHECKING:
    from sphinx.application import Sphinx

# How the C functions' lengths are written, by the letters of `gibbs_codegen.interface.table`.
LENGTHS = {letter: f"n{letter}" for letter in LISTS}
LENGTHS |= {"c": "(nh - nv) / 2", "s": "2 nv", "x": "(2 nv + nu)"}


def robot_keys() -> str:
    """The keys of a robot file in Markdown."""
    return keys(json_schema(RobotTable))


def scenario_keys() -> str:
    """The keys of a scenario file in Markdown."""
    return keys(json_schema(ScenarioTable))


def keys(schema: dict[str, Any]) -> str:
    """A section for the file, and one for each of its tables in the order in which keys name them.

    Args:
        schema: JSON schema of a file.

    Returns:
        Markdown with headings of the second level.
    """
    parts, seen = ["## The file", *table(schema)], []
    waiting = references(schema["properties"])
    while waiting:
        name = waiting.pop(0)
        if name in seen:
            continue
        seen.append(name)
        parts += [f"## {words(name)}", *table(schema["$defs"][name])]
        waiting[:0] = references(schema["$defs"][name]["properties"])
    return "\n".join(parts)


def table(described: dict[str, Any]) -> Iterator[str]:
    """What a table of a file is, and its keys: lines of Markdown."""
    yield from ("", described["description"], "", "| key | value | meaning |", "|---|---|---|")
    required = described.get("required", ())
    for key, value in described["properties"].items():
        needed = ", required" if key in required else ""
        yield f"| `{key}` | {kind(value)}{needed}{default(value)} | {value['description']} |"
    yield ""


def references(part: Any) -> list[str]:
    """Names of the tables that a part of a schema refers to, in order."""
    found = re.findall(r"'#/\$defs/(\w+)'", str(part))
    return list(dict.fromkeys(found))


def words(name: str) -> str:
    """The heading of a table: of `TipForceTable`, Tip force."""
    return re.sub(r"(?<=[a-z])([A-Z])", r" \1", name.removesuffix("Table")).capitalize()


def kind(value: dict[str, Any]) -> str:
    """What a value may be, in words, with bounds and links to tables."""
    if "$ref" in value:
        (name,) = references(value)
        return f"[{words(name).lower()}](#{words(name).lower().replace(' ', '-')})"
    if "anyOf" in value:
        return " or ".join(map(kind, value["anyOf"]))
    if "enum" in value or "const" in value:
        return ", ".join(f"`{choice}`" for choice in value.get("enum", [value.get("const")]))
    if value["type"] == "array":
        return array(value)
    if value["type"] == "object":
        (entry,) = value.get("patternProperties", {"": value["additionalProperties"]}).values()
        return f"table of names, for each {kind(entry)}"
    ends = ((sign, value.get(key)) for sign, key in (("≥", "minimum"), ("≤", "maximum")))
    bounds = " and ".join(f"{sign} {end:g}" for sign, end in ends if end is not None)
    name = {"integer": "whole number", "boolean": "true or false"}.get(value["type"], value["type"])
    return f"{name} {bounds}".strip()


def array(value: dict[str, Any]) -> str:
    """A list in words: of so many numbers, or of what its items are."""
    if "prefixItems" in value or "minItems" in value:
        first = value.get("prefixItems", [value.get("items")])[0]
        return f"{value['minItems']} {kind(first)}".replace("number", "numbers")
    return f"list of {kind(value['items'])}".replace("of number", "of numbers")


def default(value: dict[str, Any]) -> str:
    """The default, where the schema has one and the meaning does not say it."""
    if "default" not in value or "default" in value["description"]:
        return ""
    whole = re.sub(r"\.0\b", "", str(value["default"]).lower())
    return f"; default `{whole or chr(34) * 2}`"


def commands() -> str:
    """Every command with its usage and options, from the parser, in Markdown."""
    (chosen,) = (a for a in argument_parser()._actions if isinstance(a.choices, dict))
    parts = []
    for name, parser in chosen.choices.items():
        (says,) = (action.help for action in chosen._choices_actions if action.dest == name)
        usage = parser.format_usage().removeprefix("usage: ").rstrip()
        parts += [
            f"## {name}",
            "",
            f"{says[0].upper()}{says[1:]}.",
            "",
            "```text",
            usage,
            "```",
            "",
        ]
        for action in parser._actions:
            if action.help != argparse.SUPPRESS and action.dest != "help":
                meaning = re.sub(
                    r"(?<!\w)--[a-z-]+|<[^>]+>", r"`\g<0>`", action.help % vars(action)
                )
                parts += [f"`{invocation(action)}`", f": {meaning}", ""]
    return "\n".join(parts)


def invocation(action: argparse.Action) -> str:
    """An option as it is written, with what follows it."""
    choices = "|".join(map(str, action.choices)) if action.choices else ""
    if not action.option_strings:
        return choices or str(action.metavar)
    takes = choices or action.metavar or action.dest.upper()
    value = "" if action.nargs == 0 else f" {takes}"
    return ", ".join(action.option_strings) + value


def c_functions() -> str:
    """The C functions that every module has, and those generated on request, in Markdown."""
    parts = []
    for title, on_request in (("In every module", False), ("On request", True)):
        parts += [f"## {title}", ""]
        for row in FUNCTIONS.values():
            if row.on_request == on_request:
                parts += [f"### {row.name}", "", row.summary, "", "```c", prototype(row), "```", ""]
                parts += [f"From {row.source}.", ""]
    return "\n".join(parts)


def prototype(row: Row) -> str:
    """The declaration of a C function, with the lengths of its arrays."""
    takes = ["const ROBOT_constants *constants"]
    for name in row.arguments:
        shape = ARGUMENTS[name].shape
        takes.append(f"const ROBOT_real {name}{dimensions(shape)}" if shape else "ROBOT_real h")
    takes += [f"ROBOT_real {output.name}{dimensions(output.shape)}" for output in row.outputs]
    return f"void ROBOT_{row.name}(\n    " + ",\n    ".join(takes) + ");"


def dimensions(shape: str) -> str:
    """The lengths of an array that C keeps in one row."""
    return f"[{' * '.join(LENGTHS.get(letter, letter) for letter in shape) or 1}]"


PARTS: dict[str, Callable[[], str]] = {
    part.__name__: part
    for part in (robot_keys, scenario_keys, commands, c_functions, ways_to_fly, hybrid_equation)
}


def fill_in(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put what is generated in place of the comments that ask for it."""
    source[0] = re.sub(r"<!-- generated: (\w+) -->", lambda asks: PARTS[asks[1]](), source[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("source-read", fill_in)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
