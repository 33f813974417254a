"""Inlining of values used once (forward substitution) while lines stay short enough to read.

    t1 = a*b
    t2 = c + t1
    t3 = t2*t2

becomes two statements: `t1` is used once and gives way, `t2` is used twice and stays.

    t2 = c + a*b
    t3 = t2*t2
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from operator import itemgetter

from gibbs_codegen.program.nodes import (
    Call,
    Name,
    Node,
    Number,
    Output,
    Product,
    Reciprocal,
    Statement,
    Sum,
    names_in,
)

_SIGN = itemgetter(0)
# Names and literals in one line, at most: keeps statements short enough to be read.
_LEAVES = 7


def inline_single_uses(
    statements: Sequence[Statement], outputs: Sequence[Output], products_only: bool = False
) -> list[Statement]:
    """Write a value that is used once where it is used, as long as the line stays short.

    The outputs stay as they are, and with `products_only` sums do too, where their rounding is
    arranged with care.
    """
    uses = Counter(chain.from_iterable([names_in(s.value) for s in statements]))
    for output in outputs:
        for entry in output.entries:
            # An output entry keeps its name: what is returned twice must not be computed twice.
            for name in {*names_in(entry)}:
                uses[name] += 2
    kinds = (Product,) if products_only else (Product, Sum, Name, Number)
    pending: dict[str, Node] = {}
    kept = []
    for statement in statements:
        value = _inlined(statement.value, pending)
        if uses[statement.name] == 1 and isinstance(value, kinds):
            pending[statement.name] = value
            continue
        kept.append(_with_value(statement, value))
    # Names that found no room have their definitions again, in their places.
    used = {name for statement in kept for name in names_in(statement.value)}
    missing = [name for name in used if name in pending]
    needed: set[str] = set()
    while missing:
        name = missing.pop()
        if name not in needed:
            needed.add(name)
            missing.extend(n for n in names_in(pending[name]) if n in pending)
    values = {statement.name: statement.value for statement in kept}
    values.update({name: pending[name] for name in needed})
    return [_with_value(s, values[s.name]) for s in statements if s.name in values]


def _inlined(node: Node, pending: Mapping[str, Node]) -> Node:
    """`node` with pending definitions written in, the shortest first, while the line is short."""
    names = [name for name in names_in(node) if name in pending]
    if not names:
        return node
    room = _LEAVES - node.leaves
    chosen: dict[str, Node] = {}
    for name in sorted(names, key=lambda name: pending[name].leaves):
        cost = pending[name].leaves - 1
        if cost <= room:
            chosen[name] = pending[name]
            room -= cost
    return substituted(node, chosen) if chosen else node


def _with_value(statement: Statement, value: Node) -> Statement:
    return statement if value is statement.value else replace(statement, value=value)


def substituted(node: Node, values: Mapping[str, Node]) -> Node:
    """Substitute nodes for names, and open up sums in sums and products in products.

    It takes the same operations as both together, or fewer.
    """
    if isinstance(node, Name):
        return values.get(node.name, node)
    if isinstance(node, Number):
        return node
    # Names are the most frequent by far.
    parts = [
        values.get(part.name, part) if isinstance(part, Name) else substituted(part, values)
        for part in node.operands
    ]
    match node:
        case Sum(terms):
            # A sum among them is opened up: a + (b − c) is a + b − c, and no more work.
            opened: list[tuple[int, Node]] = []
            for (sign, _), value in zip(terms, parts, strict=True):
                if isinstance(value, Sum):
                    opened.extend([(sign * inner, node) for inner, node in value.terms])
                else:
                    opened.append((sign, value))
            opened.sort(key=_SIGN, reverse=True)
            return Sum(tuple(opened))
        case Product():
            merged: list[Node] = []
            for part in parts:
                merged.extend(part.factors if isinstance(part, Product) else (part,))
            merged.sort(key=lambda factor: not isinstance(factor, Number))  # Numbers come first.
            return Product(tuple(merged))
        case Reciprocal():
            return Reciprocal(parts[0])
        case Call(function):
            return Call(function, parts[0])
