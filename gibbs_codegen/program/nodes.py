"""The program: what is to be emitted, by stage, knowing neither SymPy's tree nor a target.

    t1 = x - 2*y

is `Statement("t1", Sum(((1, Name("x")), (-1, Product((Number(2.0), Name("y")))))))`. Right-hand
sides are built from six kinds of node; a target's printer must know each of them and nothing else:
names, numbers, sums of signed terms, products, reciprocals, and calls of a function. There are no
powers, no conditions and no loops. A `ScalarProgram` holds `prepare`, which turns parameters into
constants, and the functions.

Operations of nodes are counted exactly:

    x - 2*y + 1/z

is one addition, one subtraction, one multiplication and one division.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from itertools import chain
from typing import Any, Generic, Literal, TypeVar

Value = TypeVar("Value")


class _Once(Generic[Value]):
    """A `functools.cached_property` without the lock that takes most of its time in Python 3.11."""

    def __init__(self, find: Callable[[Any], Value]) -> None:
        self._find = find
        self.__doc__ = find.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, node: object, owner: type) -> Value:
        value = node.__dict__[self._name] = self._find(node)
        return value


class _Expression:
    """A right-hand side with the answers that passes over the program ask for again and again."""

    @_Once
    def operands(self) -> tuple[Node, ...]:
        """Terms, factors or argument, from left to right."""
        return ()

    @_Once
    def names(self) -> tuple[str, ...]:
        """Names from left to right, as often as they stand there."""
        return tuple(chain.from_iterable([part.names for part in self.operands]))

    @_Once
    def leaves(self) -> int:
        """Number of names and literals."""
        return sum([part.leaves for part in self.operands]) or 1

    @_Once
    def calls(self) -> tuple[Call, ...]:
        """Calls from left to right, as often as they stand there."""
        return tuple(chain.from_iterable([part.calls for part in self.operands]))


@dataclass(frozen=True)
class Name(_Expression):
    """An input, a constant or a temporary."""

    name: str

    @_Once
    def names(self) -> tuple[str, ...]:
        """The name."""
        return (self.name,)


@dataclass(frozen=True)
class Number(_Expression):
    """A literal."""

    value: float


@dataclass(frozen=True)
class Sum(_Expression):
    """Sum of terms, each with its sign, +1 or −1."""

    terms: tuple[tuple[int, Node], ...]

    @_Once
    def operands(self) -> tuple[Node, ...]:
        """The terms, without their signs."""
        return tuple([term for _, term in self.terms])


@dataclass(frozen=True)
class Product(_Expression):
    """Product of factors."""

    factors: tuple[Node, ...]

    @_Once
    def operands(self) -> tuple[Node, ...]:
        """The factors."""
        return self.factors


@dataclass(frozen=True)
class Reciprocal(_Expression):
    """1/x."""

    argument: Node

    @_Once
    def operands(self) -> tuple[Node, ...]:
        """The argument."""
        return (self.argument,)


@dataclass(frozen=True)
class Call(_Expression):
    """A function of one number; `sign` is 1 or −1, and of zero either."""

    function: Literal["sin", "cos", "sqrt", "atan", "sign"]
    argument: Node

    @_Once
    def operands(self) -> tuple[Node, ...]:
        """The argument."""
        return (self.argument,)

    @_Once
    def calls(self) -> tuple[Call, ...]:
        """The call itself, and those in its argument."""
        return (self, *self.argument.calls)


_FUNCTIONS: dict[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "sqrt": math.sqrt,
    "atan": math.atan,
    "sign": lambda value: math.copysign(1.0, value),
}

Node = Name | Number | Sum | Product | Reciprocal | Call


@dataclass(frozen=True)
class Statement:
    """`name` = `value`; `group` says what it is a part of, as "motion of link 3"."""

    name: str
    value: Node
    group: str = ""


@dataclass(frozen=True)
class Output:
    """An array that a function returns: its shape and its entries in C order."""

    shape: tuple[int, ...]
    entries: tuple[Node, ...]


@dataclass(frozen=True)
class Function:
    """A straight-line function.

    `arguments` are those of `interface.ARGUMENTS` that it takes, `constants` the names that it
    reads of `prepare`.
    """

    name: str
    arguments: tuple[str, ...]
    constants: tuple[str, ...]
    statements: tuple[Statement, ...]
    outputs: tuple[Output, ...]

    def nodes(self) -> Iterator[Node]:
        """Every right-hand side and every output entry that is computed in place."""
        for statement in self.statements:
            yield statement.value
        for output in self.outputs:
            yield from dict.fromkeys(output.entries)

    @_Once
    def operations(self) -> Operations:
        """The operations that it takes."""
        return count_operations(self.nodes())


@dataclass(frozen=True)
class ScalarProgram:
    """Everything that a target emits for one robot.

    `inputs` gives the scalar names in each argument, `parameters` the names that `prepare` takes,
    `constants` those it returns, in order.
    """

    inputs: Mapping[str, tuple[str, ...]]
    parameters: tuple[str, ...]
    constants: tuple[str, ...]
    prepare: tuple[Statement, ...]
    functions: tuple[Function, ...]

    def function(self, name: str) -> Function:
        """The function of a name."""
        return next(function for function in self.functions if function.name == name)

    def only(self, name: str) -> ScalarProgram:
        """The program of one function, with what it reads of `prepare`."""
        function = self.function(name)
        prepare = needed(self.prepare, map(Name, function.constants))
        return replace(self, prepare=tuple(prepare), functions=(function,))

    def prepared(self, parameters: Mapping[str, float]) -> dict[str, float]:
        """Values by name of the parameters and of all that `prepare` computes from them."""
        values = dict(parameters)
        for statement in self.prepare:
            values[statement.name] = node_value(statement.value, values)
        return values

    def evaluate(
        self, name: str, parameters: Mapping[str, float], arguments: Mapping[str, Sequence[float]]
    ) -> list[list[float]]:
        """Interpret a function: the entries of each output, in C order."""
        values = self.prepared(parameters)
        function = self.function(name)
        for argument in function.arguments:
            values.update(zip(self.inputs[argument], arguments[argument], strict=True))
        for statement in function.statements:
            values[statement.name] = node_value(statement.value, values)
        return [
            [node_value(entry, values) for entry in output.entries] for output in function.outputs
        ]


def names_in(node: Node) -> tuple[str, ...]:
    """Names in a node from left to right, as often as they stand there."""
    return node.names


def needed(statements: Sequence[Statement], roots: Iterable[Node]) -> list[Statement]:
    """Those of some statements, in order, that `roots` need."""
    wanted = {name for root in roots for name in names_in(root)}
    kept = []
    for statement in reversed(statements):
        if statement.name in wanted:
            kept.append(statement)
            wanted.update(names_in(statement.value))
    return kept[::-1]


def node_value(node: Node, values: Mapping[str, float]) -> float:
    """The value of a node, given those of the names in it."""
    match node:
        case Name(name):
            return values[name]
        case Number(value):
            return value
        case Sum(terms):
            total = 0.0
            for sign, term in terms:
                total += sign * node_value(term, values)
            return total
        case Product(factors):
            return math.prod(node_value(factor, values) for factor in factors)
        case Reciprocal(argument):
            return 1.0 / node_value(argument, values)
        case Call(function, argument):
            return _FUNCTIONS[function](node_value(argument, values))


@dataclass(frozen=True)
class Operations:
    """Exact operation counts; signs and their changes count as subtractions.

    Sine–cosine pairs and arctangents are counted apart.
    """

    additions: int = 0
    subtractions: int = 0
    multiplications: int = 0
    divisions: int = 0
    square_roots: int = 0
    sine_cosine_pairs: int = 0
    arctangents: int = 0

    @property
    def total(self) -> int:
        """All but the sine–cosine pairs and arctangents."""
        return sum(astuple(self)[:5])


def count_operations(nodes: Iterable[Node]) -> Operations:
    """Operations that it takes to compute each of some nodes once.

    What they have in common counts as often as it occurs, but for sine–cosine pairs, which are
    counted once per angle.
    """
    counts: Counter[str] = Counter()
    angles: set[Node] = set()
    stack = list(nodes)
    while stack:
        node = stack.pop()
        match node:
            case Sum(terms):
                negative = sum(sign < 0 for sign, _ in terms)
                counts["-"] += negative
                counts["+"] += max(len(terms) - negative - 1, 0)
            case Product(factors):
                counts["*"] += len(factors) - 1
            case Reciprocal():
                counts["/"] += 1
            case Call("sin" | "cos", argument) if argument in angles:
                continue
            case Call("sin" | "cos", argument):
                angles.add(argument)
            case Call(function):
                counts[function] += 1
        stack.extend(node.operands)
    return Operations(
        *(counts["+"], counts["-"] + counts["sign"], counts["*"], counts["/"], counts["sqrt"]),
        *(len(angles), counts["atan"]),
    )
