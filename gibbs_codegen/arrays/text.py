"""Array programs as text: what languages have in common, and NumPy and MATLAB, which have arrays.

There a statement computes what is called, what has a name, and what is read more than once; all
else is an expression where it is read. Languages say how an operation on arrays is written.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.contents import externals_of, owners_of
from gibbs_codegen.arrays.nodes import Node, Program, is_all
from gibbs_codegen.interface import FUNCTIONS

_SAME = (nodes.Entries, nodes.Coordinates)
_LOOKS = (*_SAME, nodes.RowRange, nodes.Transposition, nodes.Reshaping)
_CALLS = (nodes.Call, nodes.Invocation, nodes.External, nodes.Solution)
# Precedence of the parts of an expression.
WHOLE, PRODUCT, SUM = 0, 1, 2


class Text(NamedTuple):
    """An expression, and how tightly it holds together."""

    text: str
    level: int = WHOLE

    def within(self, level: int) -> str:
        """The same, in parentheses where it holds together less tightly."""
        return f"({self.text})" if self.level > level else self.text


def infix(x: Node, operands: Sequence[Text], times: str = "*", over: str = "/") -> Text | None:
    """The sum, difference, product or quotient of operands; None of another function."""
    match x.operation:
        case nodes.Elementary("add" | "subtract" as name):
            one, two = operands
            sign = "+" if name == "add" else "-"
            return Text(f"{one.within(SUM)} {sign} {two.within(PRODUCT)}", SUM)
        case nodes.Elementary("multiply" | "divide" as name):
            one, two = operands
            if name == "multiply" and is_all(x.arguments[0], -1.0):
                return Text(f"-{two.within(WHOLE)}", PRODUCT)
            sign = times if name == "multiply" else over
            return Text(f"{one.within(PRODUCT)} {sign} {two.within(WHOLE)}", PRODUCT)
    return None


def call_of(x: Node) -> object:
    """A key that nodes share if one call computes them."""
    match x.operation:
        case nodes.Elementary("sin" | "cos"):
            return ("sin", "cos"), x.arguments
        case nodes.Call(functions, name):
            return functions, name, x.arguments
        case nodes.Invocation(program):
            return program, x.arguments
    return None


class NodeNames:
    """Names of variables, which tell what they are where the program does."""

    def __init__(self, program: Program, reserved: Iterable[str]) -> None:
        self._taken = {*program.names, *program.outputs, *reserved}
        self._taken |= {*owners_of(program), *externals_of(program)}
        self._labels = program.labels
        self._chosen: dict[Node, str] = {}

    def of(self, x: Node) -> str:
        """The name of a node's variable."""
        if x not in self._chosen:
            self._chosen[x] = self._free(self._wanted(x))
        return self._chosen[x]

    def give(self, x: Node, name: str) -> None:
        """Give a node the name of an output, if it has none."""
        self._chosen.setdefault(x, name)

    def has(self, x: Node) -> bool:
        """True if a node has a name of its own."""
        return x in self._chosen or x in self._labels

    def _free(self, wanted: str) -> str:
        name = wanted
        for number in itertools.count(2):
            if name not in self._taken:
                break
            name = f"{wanted}_{number}"
        self._taken.add(name)
        return name

    def _wanted(self, x: Node) -> str:
        if x in self._labels:
            return self._labels[x].name
        match x.operation:
            case nodes.Elementary("sin" | "cos" as function):
                return "sines" if function == "sin" else "cosines"
            case nodes.Call(_, name, output):
                return FUNCTIONS[name].outputs[output].name
            case nodes.Invocation(_, name) | nodes.External(name):
                return name
            case nodes.Constant():
                return "table"
        return "value"


class ArrayText(ABC):
    """The statements of a program in one language."""

    # Operators of the language, and what no variable is called.
    times, over = "*", "/"
    reserved: tuple[str, ...] = ()

    def __init__(self, program: Program) -> None:
        self.program, self.readers = program, program.readers
        self.names = NodeNames(program, self.reserved)
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
        names = {_output_of(x): self.names.of(x) for x in group}
        match group[0].operation:
            case nodes.Call(_, name):
                outputs: Sequence[object] = range(len(FUNCTIONS[name].outputs))
            case nodes.Invocation(program):
                outputs = [*program.outputs]
            case _:
                return [self.names.of(group[0])]
        return [names.get(output, self.unread) for output in outputs]

    @property
    @abstractmethod
    def unread(self) -> str:
        """The name of a result that nothing reads."""

    def _is_named(self, x: Node) -> bool:
        if isinstance(x.operation, (nodes.Input, nodes.Constant, *_SAME)):
            return False
        if isinstance(x.operation, _CALLS) or self.names.has(x):
            return True
        if isinstance(x.operation, nodes.Joining):
            readers = self.readers[x]
            return not all(isinstance(y.operation, nodes.Transposition) for y in readers)
        return not isinstance(x.operation, _LOOKS) and self._times_read(x) > 1

    def _times_read(self, x: Node) -> int:
        """The number of times that a node is read, also by those that look at parts of it."""
        return sum(
            self._times_read(y) if isinstance(y.operation, _LOOKS) else 1 for y in self.readers[x]
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
        is_elementary = isinstance(x.operation, nodes.Elementary)
        operands = [self.operand(y, x) for y in x.arguments] if is_elementary else []
        return infix(x, operands, self.times, self.over) or self.operation(x)

    @abstractmethod
    def operand(self, y: Node, x: Node) -> Text:
        """An argument of an elementary function, with axes that go with those of its result."""

    @abstractmethod
    def operation(self, x: Node) -> Text:
        """An operation that languages write in different ways."""


def _inner(x: Node) -> Node:
    """A node without the mark of coordinates."""
    return _inner(x.arguments[0]) if isinstance(x.operation, _SAME) else x


def _output_of(x: Node) -> object:
    """The output of a call that a node is."""
    return x.operation.output if isinstance(x.operation, nodes.Call | nodes.Invocation) else None
