"""Array programs as text of languages that have arrays: what NumPy and MATLAB have in common.

A statement computes what is called, what has a name, and what is read more than once; all else is
an expression where it is read. Languages say how an operation on arrays is written.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.c_text import Names, call_of
from gibbs_codegen.arrays.nodes import Node, Program, is_all
from gibbs_codegen.interface import FUNCTIONS

_SAME = (nodes.Entries, nodes.Coordinates)
_LOOKS = (*_SAME, nodes.Part, nodes.Transposition, nodes.Reshaping)
_CALLS = (nodes.Call, nodes.Invocation, nodes.External, nodes.Solution)
# How tightly parts of an expression hold together.
WHOLE, PRODUCT, SUM = 0, 1, 2


class Text(NamedTuple):
    """An expression, and how tightly it holds together."""

    text: str
    level: int = WHOLE

    def within(self, level: int) -> str:
        """The same, in parentheses where it holds together less tightly."""
        return f"({self.text})" if self.level > level else self.text


class ArrayText(ABC):
    """The statements of a program in one language."""

    # Operators of the language, and what no variable is called.
    times, over = "*", "/"
    reserved: tuple[str, ...] = ()

    def __init__(self, program: Program) -> None:
        self.program = program
        self._readers: dict[Node, list[Node]] = {x: [] for x in program.nodes}
        for x in program.nodes:
            for y in x.arguments:
                self._readers[y].append(x)
        self.names = Names(program, self.reserved)
        for name, x in program.outputs.items():
            inner = _inner(x)
            if not isinstance(inner.operation, nodes.Input | nodes.Constant):
                self.names.give(inner, name)

    def statements(self) -> Iterator[tuple[str, list[str], str]]:
        """Words, names of variables, and the expression that gives their values."""
        groups: dict[object, list[Node]] = {}
        for x in self.program.nodes:
            if self._is_named(x):
                is_call = isinstance(x.operation, _CALLS)
                groups.setdefault((is_call and call_of(x)) or x, []).append(x)
        for group in groups.values():
            labels = self.program.labels
            words = next((labels[y].words for y in group if y in labels), "")
            yield words, self._targets(group), self._value(group[0]).text

    def results(self) -> list[str]:
        """Expressions of the outputs."""
        return [self.expression(x).text for x in self.program.outputs.values()]

    def _targets(self, group: Sequence[Node]) -> list[str]:
        """Names of all that a call returns, as far as they are read."""
        found = {_output_of(x): self.names.of(x) for x in group}
        match group[0].operation:
            case nodes.Call(_, name):
                outputs: Sequence[object] = range(len(FUNCTIONS[name].outputs))
            case nodes.Invocation(program):
                outputs = [*program.outputs]
            case _:
                return [self.names.of(group[0])]
        return [found.get(output, self.unread) for output in outputs]

    @property
    @abstractmethod
    def unread(self) -> str:
        """What stands for a result that nothing reads."""

    def _is_named(self, x: Node) -> bool:
        if isinstance(x.operation, (nodes.Input, nodes.Constant, *_SAME)):
            return False
        if isinstance(x.operation, _CALLS) or self.names.has(x):
            return True
        if isinstance(x.operation, nodes.Joining):
            readers = self._readers[x]
            return not all(isinstance(y.operation, nodes.Transposition) for y in readers)
        return not isinstance(x.operation, _LOOKS) and self._times_read(x) > 1

    def _times_read(self, x: Node) -> int:
        """How often a node is read, also by those that look at parts of it."""
        return sum(
            self._times_read(y) if isinstance(y.operation, _LOOKS) else 1 for y in self._readers[x]
        ) + (x in self.program.outputs.values())

    def expression(self, x: Node) -> Text:
        """The expression of a node where it is read."""
        match x.operation:
            case nodes.Input(name):
                return Text(name)
            case nodes.Entries() | nodes.Coordinates():
                return self.expression(x.arguments[0])
        return Text(self.names.of(x)) if self._is_named(x) else self._value(x)

    def _value(self, x: Node) -> Text:
        """The expression that computes a node."""
        match x.operation:
            case nodes.Elementary(name):
                one, two = ([self.operand(y, x) for y in x.arguments] * 2)[:2]
                if name == "add":
                    return Text(f"{one.within(SUM)} + {two.within(PRODUCT)}", SUM)
                if name == "subtract":
                    return Text(f"{one.within(SUM)} - {two.within(PRODUCT)}", SUM)
                if name == "multiply" and is_all(x.arguments[0], -1.0):
                    return Text(f"-{two.within(WHOLE)}", SUM)
                if name in ("multiply", "divide"):
                    sign = self.times if name == "multiply" else self.over
                    return Text(f"{one.within(PRODUCT)} {sign} {two.within(WHOLE)}", PRODUCT)
        return self.operation(x)

    @abstractmethod
    def operand(self, y: Node, x: Node) -> Text:
        """An argument of an elementary function, with axes that go with those of its result."""

    @abstractmethod
    def operation(self, x: Node) -> Text:
        """An operation that languages write in different ways."""


def _inner(x: Node) -> Node:
    """A node without what only says whether it is coordinates."""
    return _inner(x.arguments[0]) if isinstance(x.operation, _SAME) else x


def _output_of(x: Node) -> object:
    """Which output of a call a node is."""
    return x.operation.output if isinstance(x.operation, nodes.Call | nodes.Invocation) else None
