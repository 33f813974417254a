"""Derivatives on the graph: by hand, and exactly: forward, backward and twice."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
import sympy as sp
from support.random_graphs import exact, random_function

from gibbs_codegen.graph.differentiate import hessian, jacobian, jvp, vjp
from gibbs_codegen.graph.graph import Graph, NodeKind, Ref


def test_the_chain_rule_by_hand() -> None:
    graph = Graph()
    x, y = graph.symbol("x"), graph.symbol("y")
    sine = graph.call("sin", x)
    entry = graph.product(sine, y)
    cosine = graph.call("cos", x)
    (row,) = jacobian(graph, [entry], [{x >> 1: graph.one}, {y >> 1: graph.one}])
    assert row == [graph.product(cosine, y), sine]
    assert vjp(graph, [entry], [graph.one], [x, y]) == row
    square = graph.product(entry, entry)
    (rate,) = jvp(graph, [square], {y >> 1: graph.one})
    assert rate == graph.product(graph.number(sp.Integer(2)), graph.product(sine, entry))
    inverse = graph.reciprocal(y)
    assert jvp(graph, [inverse, x], {y >> 1: graph.one})[0] == graph.minus(
        graph.product(inverse, inverse)
    )
    assert jvp(graph, [inverse, x], {y >> 1: graph.one})[1] == graph.zero


def test_a_sign_does_not_move_and_an_unknown_function_is_an_error() -> None:
    graph = Graph()
    x = graph.symbol("x")
    direction = {x >> 1: graph.one}
    assert jvp(graph, [graph.call("sign", x)], direction) == [graph.zero]
    with pytest.raises(ValueError, match="derivative of the function 'tan' is not known"):
        jvp(graph, [graph.call("tan", x)], direction)


def moving(graph: Graph) -> list[Ref]:
    """Inputs that are no parameters."""
    pairs = enumerate(zip(graph.kinds, graph.constant, strict=True))
    return [2 * node for node, (kind, fixed) in pairs if kind is NodeKind.INPUT and not fixed]


def rates(graph: Graph, outputs: Sequence[Ref]) -> list[list[int]]:
    """Exact derivatives of outputs (rows) by the inputs that are no parameters."""
    inputs = [node for node, kind in enumerate(graph.kinds) if kind is NodeKind.INPUT]
    units = [[int(2 * node == x) for node in inputs] for x in moving(graph)]
    columns = [[rate for _, rate in exact(graph, outputs, unit)] for unit in units]
    return [list(row) for row in zip(*columns, strict=True)]


def exactly(graph: Graph, matrix: Sequence[Sequence[Ref]]) -> list[list[int]]:
    return [[value for value, _ in exact(graph, row)] for row in matrix]


@pytest.mark.parametrize("seed", range(12))
def test_forward_backward_and_second_derivatives_are_exact(seed: int) -> None:
    graph, outputs, _ = random_function(seed, size=30)
    xs = moving(graph)
    directions = [{x >> 1: graph.one} for x in xs]
    expected = rates(graph, outputs)
    assert exactly(graph, jacobian(graph, outputs, directions)) == expected
    backward = [vjp(graph, [output], [graph.one], xs) for output in outputs]
    assert exactly(graph, backward) == expected
    gradient = vjp(graph, outputs, [graph.one] * len(outputs), xs)
    matrix = hessian(graph, gradient, directions)
    assert exactly(graph, matrix) == rates(graph, gradient)
    assert all(matrix[i][j] == matrix[j][i] for i in range(len(xs)) for j in range(i))
