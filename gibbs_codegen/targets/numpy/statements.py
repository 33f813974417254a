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

        Args:
            name: Of the variable.
            value: Its value.

        Returns:
            Lines without their indentation, as everywhere here.
        """
        start, text = f"{name} = ", self._expressions.expression(value)
        if len(start) + len(text) <= WIDTH - _INDENT:
            return [start + text]
        return [f"{start}(", *(f"{' ' * _INDENT}{line}" for line in _wrapped(text)), ")"]

    def assign_all(self, statements: Iterable[Statement]) -> list[str]:
        """Local variables, with a comment above each group.

        Args:
            statements: In order.

        Returns:
            Lines.
        """
        lines: list[str] = []
        for words, statement in headed(statements):
            lines += comment(words)
            lines += self.assign(statement.name, statement.value)
        return lines

    def entries(self, outputs: Sequence[Output]) -> list[str]:
        """What stands in the parentheses of a tuple of all entries of outputs.

        Args:
            outputs: One after the other.

        Returns:
            Lines.
        """
        nodes = (entry for output in outputs for entry in output.entries)
        return elements([self._expressions.expression(node) for node in nodes])


def comment(words: str) -> list[str]:
    """A comment above a group of statements.

    Args:
        words: What the group computes; "" where no group begins.

    Returns:
        Lines, of which the first is empty.
    """
    return ["", f"# {words}"] if words else []


def load(name: str, array: str, place: int | str) -> str:
    """A local variable that is an entry of a sequence, or of a dictionary.

    Args:
        name: Of the variable.
        array: What it is an entry of.
        place: Its index, or its key.

    Returns:
        A line.
    """
    index = f'"{place}"' if isinstance(place, str) else place
    return f"{name} = {array}[{index}]"


def elements(texts: Sequence[str]) -> list[str]:
    """What stands in the parentheses of a tuple.

    Args:
        texts: Expressions.

    Returns:
        Lines; none where there are no expressions.
    """
    return _wrapped(f"{', '.join(texts)},") if texts else []


def strings(texts: Iterable[str]) -> list[str]:
    """What stands in the parentheses of a tuple of strings; nothing where there are none.

    Args:
        texts: Strings without quotes.

    Returns:
        Lines.
    """
    text = " ".join(f'"{text}",' for text in texts)
    return textwrap.wrap(text, WIDTH - _INDENT)


def integers(numbers: Iterable[int]) -> list[str]:
    """What stands in the parentheses of a tuple of integers in a tuple; nothing without any.

    Args:
        numbers: The integers.

    Returns:
        Lines.
    """
    text = " ".join(f"{number}," for number in numbers)
    return textwrap.wrap(text, WIDTH - 3 * _INDENT)


def result(outputs: Sequence[Output]) -> str:
    """What a function returns, given `entries` of all its outputs and `batch`.

    Args:
        outputs: In order.

    Returns:
        An expression.
    """
    calls, start = [], 0
    for output in outputs:
        stop = start + len(output.entries)
        part = "entries" if len(outputs) == 1 else f"entries[{start}:{stop}]"
        calls.append(f"shaped({part}, {output.shape!r}, batch)")
        start = stop
    return ", ".join(calls)


def result_type(outputs: int) -> str:
    """The type of what a function returns.

    Args:
        outputs: Number of its outputs.

    Returns:
        An annotation.
    """
    array = "NDArray[np.float64]"
    return array if outputs == 1 else f"tuple[{', '.join([array] * outputs)}]"


def _wrapped(text: str) -> list[str]:
    """Lines of an expression that stands in parentheses in the body of a function."""
    return textwrap.wrap(text, WIDTH - 2 * _INDENT, break_long_words=False, break_on_hyphens=False)
