"""Statements in Python as lines: how they are written and broken is decided here alone."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from gibbs_codegen.program.nodes import Node, Output, Statement
from gibbs_codegen.program.steps import headed
from gibbs_codegen.targets.printers import InfixPrinter

WIDTH = 100
# Of every line in the body of a function, and of every line in parentheses there.
_INDENT = 4


class StatementPrinter:
    """Prints statements that compute: right-hand sides are nodes, printed by `expressions`."""

    def __init__(self, expressions: InfixPrinter) -> None:
        self._expressions = expressions

    def assign(self, name: str, value: Node) -> list[str]:
        """A local variable, its value in parentheses where it takes more than a line.

        Lines are without their indentation, as everywhere here.
        """
        start, text = f"{name} = ", self._expressions.expression(value)
        if len(start) + len(text) <= WIDTH - _INDENT:
            return [start + text]
        return [f"{start}(", *(f"{' ' * _INDENT}{line}" for line in _wrapped(text)), ")"]

    def assign_all(self, statements: Iterable[Statement]) -> list[str]:
        """Local variables, with a comment above each group."""
        lines: list[str] = []
        for words, statement in headed(statements):
            lines += comment(words)
            lines += self.assign(statement.name, statement.value)
        return lines

    def entries(self, outputs: Sequence[Output]) -> list[str]:
        """What stands in the parentheses of a tuple of all entries of outputs."""
        nodes = (entry for output in outputs for entry in output.entries)
        return elements([self._expressions.expression(node) for node in nodes])


def comment(words: str) -> list[str]:
    """A comment above a group of statements, after an empty line; none for ""."""
    return ["", f"# {words}"] if words else []


def load(name: str, array: str, place: int | str) -> str:
    """A local variable that is an entry of a sequence by index, or of a dictionary by key."""
    index = f'"{place}"' if isinstance(place, str) else place
    return f"{name} = {array}[{index}]"


def elements(texts: Sequence[str]) -> list[str]:
    """What stands in the parentheses of a tuple."""
    return _wrapped(f"{', '.join(texts)},") if texts else []


def strings(texts: Iterable[str]) -> list[str]:
    """What stands in the parentheses of a tuple of strings, which come without quotes."""
    text = " ".join(f'"{text}",' for text in texts)
    return textwrap.wrap(text, WIDTH - _INDENT)


def integers(numbers: Iterable[int]) -> list[str]:
    """What stands in the parentheses of a tuple of integers in a tuple; nothing without any."""
    text = " ".join(f"{number}," for number in numbers)
    return textwrap.wrap(text, WIDTH - 3 * _INDENT)


def result(outputs: Sequence[Output]) -> str:
    """What a function returns, given `entries` of all its outputs and `batch`."""
    calls, start = [], 0
    for output in outputs:
        stop = start + len(output.entries)
        part = "entries" if len(outputs) == 1 else f"entries[{start}:{stop}]"
        calls.append(f"shaped({part}, {output.shape!r}, batch)")
        start = stop
    return ", ".join(calls)


def result_type(outputs: int) -> str:
    """The annotation of what a function of so many outputs returns."""
    array = "NDArray[np.float64]"
    return array if outputs == 1 else f"tuple[{', '.join([array] * outputs)}]"


def _wrapped(text: str) -> list[str]:
    """Lines of an expression that stands in parentheses in the body of a function."""
    return textwrap.wrap(text, WIDTH - 2 * _INDENT, break_long_words=False, break_on_hyphens=False)
