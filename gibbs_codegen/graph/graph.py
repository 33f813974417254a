"""The graph: operations as integers, each made once, for passes over thousands of them.

SymPy derives on the tape; differentiating and shortening what it derived is done here. A node is
an operation on earlier nodes. A *reference* to it is an integer, twice the node's number, and one
more for its opposite: signs are free and never hide that two values are the same.

    x = graph.symbol("x")              2
    y = graph.symbol("y")              4
    s = graph.sum([x, -y])            6      written graph.sum([x, opposite(y)])
    graph.sum([y, opposite(x)])       7      the opposite of the same node

The same operation on the same operands is the same node. Zeros, ones, numbers and like terms are
folded as a node is made; numbers stay exact until a program rounds them. What parameters alone
determine is *constant*: it is computed once per set of parameters and costs a function nothing, so
constant factors and terms are put together first.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from functools import reduce
from operator import itemgetter
from typing import TypeAlias

import sympy as sp

from gibbs_codegen.symbolic import numbers

# Twice the number of a node, and one more for its opposite.
Ref: TypeAlias = int


class NodeKind(IntEnum):
    """The operation of a node."""

    INPUT = 0
    NUMBER = 1
    SUM = 2
    PRODUCT = 3
    RECIPROCAL = 4
    CALL = 5


# Before Python 3.12 members take long to be looked up in their class.
INPUT, NUMBER, SUM, PRODUCT, RECIPROCAL, CALL = NodeKind

# Functions f with f(−x) = −f(x), and with f(−x) = f(x).
ODD = ("sin", "atan", "sign")
EVEN = ("cos",)


def opposite(ref: Ref) -> Ref:
    """The value with the other sign; not of zero, which `Graph.minus` knows."""
    return ref ^ 1


def _sum(terms: Iterable[tuple[int, sp.Expr]]) -> sp.Expr:
    """The sum of numbers, each times an integer."""
    products = (numbers.product(sp.Integer(count), number) for count, number in terms)
    return reduce(numbers.total, products)


class Graph:
    """Nodes by number; operands have smaller numbers than their results.

    Node i is a `kinds[i]`, `operands[i]` has the references that it is made of,
    `labels[i]` the name of an input, the value of a number or the function of a call, and
    `constant[i]` says whether parameters and numbers alone determine it, `varying[i]` has the nodes
    among its operands that are not constant. A sum has two terms or more, the oldest first and
    without a sign; a product has two factors without signs, a constant one first.
    """

    def __init__(self) -> None:
        self.kinds: list[NodeKind] = []
        self.operands: list[tuple[Ref, ...]] = []
        self.labels: list[str | sp.Expr | None] = []
        self.constant: list[bool] = []
        self.varying: list[tuple[int, ...]] = []
        self._numbers: dict[tuple[NodeKind, tuple[Ref, ...], str | sp.Expr | None], int] = {}
        # Each node as a number times what it has in common with like terms, by a key.
        self._scaled: list[tuple[sp.Expr, int]] = []
        self._keys: dict[tuple[int, int], int] = {}
        # Numbers by the double that is printed of them: exact ones, where there are such.
        self._printed: dict[float, sp.Expr] = {}
        # What functions compute, by what they return: passes ask for the same again.
        self._reached: dict[tuple[Ref, ...], list[int]] = {}
        self.zero = self.number(sp.S.Zero)
        self.one = self.number(sp.S.One)

    def __len__(self) -> int:
        return len(self.kinds)

    def _node(
        self, kind: NodeKind, operands: tuple[Ref, ...], label: str | sp.Expr | None, constant: bool
    ) -> Ref:
        """A node, made once; the class says what its parts are."""
        key = (kind, operands, label)
        node = self._numbers.get(key)
        if node is None:
            node = self._numbers[key] = len(self.kinds)
            self.kinds.append(kind)
            self.operands.append(operands)
            self.labels.append(label)
            self.constant.append(constant)
            inner = [ref >> 1 for ref in operands]
            self.varying.append(tuple([n for n in inner if not self.constant[n]]))
            self._scaled.append(self._number_times(node))
        return 2 * node

    def _number_times(self, node: int) -> tuple[sp.Expr, int]:
        """Its number, and the key of the rest: a node, the one of numbers, or below 0 a product."""
        label = self.labels[node]
        if isinstance(label, sp.Expr):
            return label, 1
        if self.kinds[node] is not PRODUCT:
            return sp.S.One, node
        (m, x), (n, y) = sorted(
            (self._scaled[ref >> 1] for ref in self.operands[node]), key=itemgetter(1)
        )
        number = n if m is sp.S.One else numbers.product(m, n)
        if 1 in (x, y):
            return number, x if y == 1 else y
        return number, self._keys.setdefault((x, y), -1 - len(self._keys))

    def _unscaled(self, ref: Ref) -> Ref:
        """A value without the number that it is a multiple of."""
        if self._scaled[ref >> 1][0] is sp.S.One:
            return ref & ~1
        if self.kinds[ref >> 1] is not PRODUCT:
            return self.one
        first, second = self.operands[ref >> 1]
        return self.product(self._unscaled(first), self._unscaled(second))

    def symbol(self, name: str, constant: bool = False) -> Ref:
        """An entry of an argument, or a parameter if constant, by its name in the program."""
        return self._node(INPUT, (), name, constant)

    def number(self, value: sp.Expr) -> Ref:
        """A literal, exact or to forty digits."""
        value = numbers.settled(value)
        if value.is_negative:
            return self.number(-value) ^ 1
        if value.is_Float:  # It may have come in another way before, with other last digits.
            value = self._printed.setdefault(numbers.rounded(value), value)
        else:
            self._printed[numbers.rounded(value)] = value
        return self._node(NUMBER, (), value, True)

    def value(self, ref: Ref) -> sp.Expr | None:
        """The value of a number with its sign, or None where the node is no number."""
        label = self.labels[ref >> 1]
        if not isinstance(label, sp.Expr):
            return None
        return -label if ref & 1 else label

    def is_zero(self, ref: Ref) -> bool:
        """True if a value is zero whatever the arguments: the number zero alone."""
        return ref >> 1 == self.zero >> 1

    def minus(self, ref: Ref) -> Ref:
        """The opposite of a value; zero has none."""
        return ref if self.is_zero(ref) else ref ^ 1

    def sum(self, terms: Iterable[Ref]) -> Ref:
        """A sum; like terms are put together, and so are constants."""
        counts: dict[int, int] = {}
        for term in terms:
            counts[term >> 1] = counts.get(term >> 1, 0) + (-1 if term & 1 else 1)
        alike: dict[int, list[int]] = {}
        for node, count in counts.items():
            if count and self.kinds[node] is not NUMBER:
                alike.setdefault(self._scaled[node][1], []).append(node)
        for nodes in alike.values():
            if len(nodes) > 1:
                total = _sum((counts.pop(node), self._scaled[node][0]) for node in nodes)
                merged = self.product(self.number(total), self._unscaled(2 * nodes[0]))
                counts[merged >> 1] = -1 if merged & 1 else 1
        literals: list[tuple[int, sp.Expr]] = []
        constants: list[Ref] = []
        varying: list[Ref] = []
        for node, count in counts.items():
            value = self.labels[node]
            if isinstance(value, sp.Expr):
                literals.append((count, value))
            elif count:
                term = 2 * node ^ (count < 0)
                if abs(count) > 1:
                    term = self.product(self.number(sp.Integer(count)), 2 * node)
                (constants if self.constant[node] else varying).append(term)
        if literals and (number := _sum(literals)):
            constants.insert(0, self.number(number))
        if varying and len(constants) > 1:
            constants = [self._ordered_sum(constants)]
        return self._ordered_sum(constants + varying)

    def _ordered_sum(self, terms: list[Ref]) -> Ref:
        """The sum of terms that all differ."""
        if not terms:
            return self.zero
        if len(terms) == 1:
            return terms[0]
        terms.sort()
        sign = terms[0] & 1
        refs = tuple([term ^ sign for term in terms])
        constant = all(self.constant[ref >> 1] for ref in refs)
        return self._node(SUM, refs, None, constant) ^ sign

    def product(self, first: Ref, second: Ref) -> Ref:
        """A product of two values; constant factors are put together first."""
        if self.is_zero(first) or self.is_zero(second):
            return self.zero
        sign = (first ^ second) & 1
        x, y = sorted((first & ~1, second & ~1))
        if x == self.one or y == self.one:
            return (x if y == self.one else y) ^ sign
        p, q = self.labels[x >> 1], self.labels[y >> 1]
        if isinstance(p, sp.Expr) and isinstance(q, sp.Expr):
            return self.number(numbers.product(p, q)) ^ sign
        if self.constant[y >> 1] and (not self.constant[x >> 1] or isinstance(q, sp.Expr)):
            x, y = y, x
        # A constant is first now, and a number before others.
        constant = self.constant[x >> 1]
        if constant and self.kinds[y >> 1] is PRODUCT:
            factor, rest = self.operands[y >> 1]
            # k·(k'·t) is (k·k')·t, and 2·(3·k) is 6·k.
            merges = not self.constant[y >> 1] and self.constant[factor >> 1]
            literals = (self.labels[x >> 1], self.labels[factor >> 1])
            if merges or all(isinstance(label, sp.Expr) for label in literals):
                return self.product(self.product(x, factor), rest) ^ sign
        return self._node(PRODUCT, (x, y), None, constant and self.constant[y >> 1]) ^ sign

    def products(self, factors: Sequence[Ref]) -> Ref:
        """A product of any number of values, one where there are none."""
        result = self.one
        for factor in factors:
            result = self.product(result, factor)
        return result

    def reciprocal(self, ref: Ref) -> Ref:
        """One over a value."""
        value = self.value(ref)
        if value is not None:
            return self.number(numbers.reciprocal(value))
        node = ref & ~1
        return self._node(RECIPROCAL, (node,), None, self.constant[ref >> 1]) ^ (ref & 1)

    def call(self, function: str, ref: Ref) -> Ref:
        """A function of one value, of those that `program.nodes.Call` knows."""
        value = self.value(ref)
        if value is not None and function in ("sin", "cos"):
            return self.number(numbers.exact(numbers.rounded(getattr(sp, function)(value))))
        constant = self.constant[ref >> 1]
        if function in ODD:
            return self._node(CALL, (ref & ~1,), function, constant) ^ (ref & 1)
        argument = ref & ~1 if function in EVEN else ref
        return self._node(CALL, (argument,), function, constant)

    def remade(self, node: int, operands: Sequence[Ref]) -> Ref:
        """The same operation of a node on as many other operands."""
        kind, label = self.kinds[node], self.labels[node]
        if kind is SUM:
            return self.sum(operands)
        if kind is PRODUCT:
            return self.products(operands)
        if kind is RECIPROCAL:
            return self.reciprocal(operands[0])
        return self.call(str(label), operands[0])

    def reached(self, refs: Iterable[Ref]) -> list[int]:
        """Nodes that some values are made of, theirs included, in ascending order."""
        nodes: set[int] = set()
        stack = [ref >> 1 for ref in refs]
        while stack:
            node = stack.pop()
            if node not in nodes:
                nodes.add(node)
                stack.extend([ref >> 1 for ref in self.operands[node]])
        return sorted(nodes)

    def reached_varying(self, refs: Iterable[Ref]) -> list[int]:
        """Nodes that a function computes, inputs included: those reached that are not constant."""
        key = tuple(refs)
        if key not in self._reached:
            nodes: set[int] = set()
            stack = [ref >> 1 for ref in key if not self.constant[ref >> 1]]
            varying = self.varying
            while stack:
                node = stack.pop()
                if node not in nodes:
                    nodes.add(node)
                    stack.extend(varying[node])
            self._reached[key] = sorted(nodes)
        return self._reached[key]

    def uses(self, nodes: Iterable[int], outputs: Iterable[Ref]) -> Counter[int]:
        """The number of uses of each node.

        A node that is returned counts as used twice: it must not be computed twice.
        """
        operands = self.operands
        counts = Counter([ref >> 1 for node in nodes for ref in operands[node]])
        for node in {ref >> 1 for ref in outputs}:
            counts[node] += 2
        return counts


def in_order(graph: Graph, outputs: Sequence[Ref], origins: Mapping[int, int]) -> list[int]:
    """Nodes that a function computes, inputs included, each in the place of what it was made for.

    `origins` has for each node that a pass has made the one in whose place it stands. A node comes
    after those that it is made of.
    """
    nodes = graph.reached_varying(outputs)
    stack = sorted(nodes, key=lambda node: (origins.get(node, node), node), reverse=True)
    ordered: dict[int, None] = {}
    while stack:
        node = stack[-1]
        missing = [n for n in graph.varying[node] if n not in ordered]
        if missing:
            stack.extend(reversed(missing))
        else:
            ordered.setdefault(stack.pop())
    return list(ordered)
