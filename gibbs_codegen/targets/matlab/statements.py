"""Statements in MATLAB as lines: how they are written and broken is decided here alone."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

import numpy as np

from gibbs_codegen.program.nodes import Node, Number, Output, Statement
from gibbs_codegen.program.steps import headed
from gibbs_codegen.targets.matlab.names import variable
from gibbs_codegen.targets.printers import InfixPrinter

WIDTH = 100
# Of every line in the body of a function, and of every line that continues another.
_INDENT = 4
_CONTINUED = " ..."


class MatlabPrinter(InfixPrinter):
    """Prints nodes entry by entry: a name is a row, with an entry for each state."""

    TIMES = ".*"
    OVER = "./"

    def name(self, name: str) -> str:
        """As in the program, unless MATLAB does not take that."""
        return variable(name)

    def call(self, function: str, argument: str) -> str:
        """A call on a row; zeros have signs, which MATLAB's own sign does not tell."""
        if function == "sign":
            return f"(1.0 - 2.0 .* (1.0 ./ ({argument}) < 0.0))"
        return super().call(function, argument)


class StatementPrinter:
    """Prints statements that compute: right-hand sides are nodes, printed by `expressions`."""

    def __init__(self, expressions: InfixPrinter) -> None:
        self._expressions = expressions

    def assign_all(self, statements: Iterable[Statement]) -> list[str]:
        """Local variables, with a comment above each group; lines are without indentation here."""
        lines: list[str] = []
        for words, statement in headed(statements):
            lines += ["", f"% {words}"] if words else []
            lines += self.assign(self._expressions.name(statement.name), statement.value)
        return lines

    def assign(self, target: str, value: Node) -> list[str]:
        """A variable, or entries of one."""
        return _continued(f"{target} = {self._expressions.expression(value)};")

    def fill(self, name: str, output: Output) -> list[str]:
        """An output, whose zeros are there before its other entries."""
        lines = ["", f"{name} = zeros({len(output.entries)}, count);"]
        places = column_major(output.shape)
        for place, entry in sorted(zip(places, output.entries, strict=True), key=lambda x: x[0]):
            if entry != Number(0.0):
                lines += self.assign(f"{name}({place}, :)", entry)
        if len(output.shape) > 1:
            sizes = ", ".join(map(str, output.shape))
            lines.append(f"{name} = reshape({name}, {sizes}, count);")
        return lines


def column_major(shape: tuple[int, ...]) -> list[int]:
    """Linear index in MATLAB, from 1, of each entry of an array in C order."""
    size = int(np.prod(shape))
    return (1 + np.arange(size).reshape(shape, order="F")).ravel().tolist()


def load(name: str, array: str, place: int) -> str:
    """A variable that is the row at `place`, from 0, of an array."""
    return f"{variable(name)} = {array}({place + 1}, :);"


def column(texts: Sequence[str]) -> list[str]:
    """What stands in the brackets of a column, or in the braces of a cell column.

    Each expression stays whole, as a line break within a quoted text is an error.
    """
    lines: list[str] = []
    for text in texts:
        if lines and len(f"{lines[-1]}; {text};") <= WIDTH - 2 * _INDENT:
            lines[-1] += f"; {text}"
        else:
            lines.append(text)
    return [*(f"{line};" for line in lines[:-1]), *lines[-1:]]


def _continued(text: str) -> list[str]:
    """Lines of a statement."""
    if len(text) <= WIDTH - _INDENT:
        return [text]
    lines = textwrap.wrap(
        text,
        WIDTH - _INDENT - len(_CONTINUED),
        subsequent_indent=" " * _INDENT,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [*(f"{line}{_CONTINUED}" for line in lines[:-1]), lines[-1]]
