"""The help texts of functions in MATLAB."""

from __future__ import annotations

import re
from dataclasses import replace

from gibbs_codegen.interface import FUNCTIONS, Row, Signature
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.targets.documentation import (
    HANGING,
    argument_text,
    details,
    meaning,
    output_text,
    wrapped,
)
from gibbs_codegen.targets.matlab.lists import LISTS

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
