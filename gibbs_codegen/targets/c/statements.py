"""Statements in C as lines: how they are written and broken is decided here alone.

What lies in an array is `stride` reals away from what lies beside it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from gibbs_codegen.program.nodes import Node, Statement
from gibbs_codegen.program.steps import headed
from gibbs_codegen.targets.printers import InfixPrinter

WIDTH = 100
# Of every line in the body of a function, and of every line in a loop there.
_INDENT = 4


class StatementPrinter:
    """Prints statements that compute: right-hand sides are nodes, printed by `expressions`.

    Constants of the function are of a `kind` of number.
    """

    def __init__(self, expressions: InfixPrinter, depth: int = 1, kind: str = "real") -> None:
        self._expressions = expressions
        self._depth = depth
        self._kind = kind

    @property
    def inside(self) -> StatementPrinter:
        """The printer of what stands in a loop, where lines are shorter."""
        return StatementPrinter(self._expressions, self._depth + 1, self._kind)

    def declare(self, name: str, value: Node) -> list[str]:
        """A constant of the function."""
        return self._assignment(f"const {self._kind} {name}", self._expressions.expression(value))

    def declare_all(self, statements: Iterable[Statement]) -> list[str]:
        """Constants of the function, with a comment above each group."""
        lines: list[str] = []
        for words, statement in headed(statements):
            lines += heading(words)
            lines += self.declare(statement.name, statement.value)
        return lines

    def store(self, array: str, place: int | str, value: Node) -> list[str]:
        """An entry of an array."""
        return self._assignment(f"{array}[{place} * stride]", self._expressions.expression(value))

    def clear(self, array: str, size: str) -> list[str]:
        """All entries of an array of so many reals become zero."""
        return loop("i", size, [f"{array}[i] = {self._expressions.number(0.0)};"])

    def _assignment(self, target: str, value: str) -> list[str]:
        width = WIDTH - self._depth * _INDENT
        text = f"{target} = {value};"
        if len(text) <= width:
            return [text]
        return textwrap.wrap(
            text,
            width,
            subsequent_indent=" " * _INDENT,
            break_long_words=False,
            break_on_hyphens=False,
        )


def heading(words: str) -> list[str]:
    """A comment above a group of statements, if one begins."""
    return ["", f"/* {words} */"] if words else []


def load(name: str, array: str, place: int | str, sign: str = "") -> str:
    """A constant of the function that is an entry of an array, or minus it."""
    return f"const real {name} = {sign}{array}[{place} * stride];"


def hold(array: str, place: int | str, name: str, sign: str = "") -> str:
    """An entry of an array that is a constant of the function, or minus it."""
    return f"{array}[{place} * stride] = {sign}{name};"


def unused(name: str) -> str:
    """What tells compilers that an argument is not used on purpose."""
    return f"(void){name};"


def local_arrays(names: Sequence[str], size: str) -> str:
    """Arrays of so many reals each."""
    return f"real {', '.join(f'{name}[{size}]' for name in names)};"


def call(name: str, arguments: Sequence[str]) -> list[str]:
    """A call of a function that returns nothing; it may stand in a loop."""
    text = f"{name}({', '.join(arguments)});"
    return textwrap.wrap(text, WIDTH - 4 * _INDENT, subsequent_indent=" " * _INDENT)


def loop(index: str, count: int | str, body: Sequence[str]) -> list[str]:
    """A loop over an index from 0."""
    head = f"for (int {index} = 0; {index} < {count}; ++{index}) {{"
    return [head, *(f"{' ' * _INDENT}{line}" for line in body), "}"]


def vector_loop(index: str, count: int | str, body: Sequence[str]) -> list[str]:
    """A loop whose rounds do not depend on each other, which compilers are told to vectorise."""
    return ["VECTORISE", *loop(index, count, body)]
