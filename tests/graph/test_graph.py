"""The graph by hand: the same value is the same node, and signs, numbers and constants are free."""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.graph.graph import Graph, NodeKind, opposite


def test_the_same_operation_is_the_same_node() -> None:
    graph = Graph()
    x, y = graph.symbol("x"), graph.symbol("y")
    assert graph.sum([x, y]) == graph.sum([y, x])
    assert graph.product(x, y) == graph.product(y, x)
    difference = graph.sum([x, opposite(y)])
    assert graph.sum([y, opposite(x)]) == opposite(difference)
    assert graph.product(opposite(x), y) == opposite(graph.product(x, y))
    assert graph.call("sin", opposite(x)) == opposite(graph.call("sin", x))
    assert graph.call("cos", opposite(x)) == graph.call("cos", x)
    assert graph.call("sqrt", opposite(x)) != graph.call("sqrt", x)


def test_zeros_ones_and_like_terms_are_folded() -> None:
    graph = Graph()
    x, y = graph.symbol("x"), graph.symbol("y")
    assert graph.product(x, graph.zero) == graph.zero
    assert graph.product(x, graph.number(sp.Integer(-1))) == opposite(x)
    assert graph.sum([x, y, opposite(x)]) == y
    assert graph.sum([x, x, x]) == graph.product(graph.number(sp.Integer(3)), x)
    assert graph.sum([graph.number(sp.Integer(2)), graph.number(sp.Integer(-2))]) == graph.zero
    assert graph.minus(graph.zero) == graph.zero
    assert graph.value(graph.reciprocal(graph.number(sp.Integer(-4)))) == sp.Rational(-1, 4)
    assert graph.value(x) is None


def test_constants_are_put_together_first() -> None:
    graph = Graph()
    k, m = (graph.symbol(name, constant=True) for name in "km")
    x, y = graph.symbol("x"), graph.symbol("y")
    together = graph.product(k, graph.product(m, x))
    assert together == graph.product(graph.product(k, m), x)
    total = graph.sum([x, k, y, m])
    assert graph.operands[total >> 1] == (x, y, graph.sum([k, m]))
    twice = graph.product(
        graph.number(sp.Integer(2)), graph.product(graph.number(sp.Integer(3)), k)
    )
    assert twice == graph.product(graph.number(sp.Integer(6)), k)


def test_what_a_function_reaches() -> None:
    graph = Graph()
    k, x, y = graph.symbol("k", constant=True), graph.symbol("x"), graph.symbol("y")
    square = graph.product(k, k)
    entry = graph.sum([graph.product(square, x), k])
    assert graph.reached([entry]) == sorted(ref >> 1 for ref in (k, x, square, entry - 2, entry))
    assert square >> 1 not in graph.reached_varying([entry])
    assert y >> 1 not in graph.reached([entry])
    assert graph.uses(graph.reached([entry]), [entry])[k >> 1] == 3
    assert graph.kinds[entry >> 1] is NodeKind.SUM
    assert graph.remade(entry >> 1, [x, y]) == graph.sum([x, y])
