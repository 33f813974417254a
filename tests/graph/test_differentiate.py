"""Derivatives on the graph: by hand, against central differences, and forward against backward."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from support.random_graphs import random_function, values

from gibbs_codegen.graph.differentiate import hessian, jacobian, jvp, vjp
from gibbs_codegen.graph.graph import Graph, Kind, Ref

STEP = 1e-6


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
    assert rate == graph.product(graph.number(2.0), graph.product(sine, entry))
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
    return [2 * node for node, (kind, fixed) in pairs if kind is Kind.INPUT and not fixed]


def differences(graph: Graph, outputs: Sequence[Ref], inputs: list[float]) -> np.ndarray:
    """Central differences by the inputs that are no parameters."""
    columns = []
    first = len(inputs) - len(moving(graph))
    for place in range(first, len(inputs)):
        at = [np.array(inputs), np.array(inputs)]
        at[0][place] += STEP
        at[1][place] -= STEP
        up, down = (np.array(values(graph, outputs, list(point))) for point in at)
        columns.append((up - down) / (2 * STEP))
    return np.array(columns).T


@pytest.mark.parametrize("seed", range(6))
def test_forward_and_backward_agree_with_differences(seed: int) -> None:
    graph, outputs, inputs = random_function(seed, size=30)
    xs = moving(graph)
    directions = [{x >> 1: graph.one} for x in xs]
    forward = jacobian(graph, outputs, directions)
    backward = [vjp(graph, [output], [graph.one], xs) for output in outputs]
    flat = [entry for row in (*forward, *backward) for entry in row]
    found = np.array(values(graph, flat, inputs)).reshape(2, len(outputs), len(xs))
    scale = max(1.0, np.abs(found).max())
    assert np.abs(found[0] - found[1]).max() <= 1e-12 * scale
    assert np.abs(found[0] - differences(graph, outputs, inputs)).max() <= 1e-6 * scale


@pytest.mark.parametrize("seed", range(3))
def test_second_derivatives_are_symmetric_and_agree_with_differences(seed: int) -> None:
    graph, outputs, inputs = random_function(seed, size=20)
    xs = moving(graph)
    gradient = vjp(graph, outputs, [graph.one] * len(outputs), xs)
    directions = [{x >> 1: graph.one} for x in xs]
    matrix = hessian(graph, gradient, directions)
    whole = jacobian(graph, gradient, directions)
    flat = [entry for row in (*matrix, *whole) for entry in row]
    found = np.array(values(graph, flat, inputs)).reshape(2, len(xs), len(xs))
    scale = max(1.0, np.abs(found).max())
    assert np.abs(found[0] - found[1]).max() <= 1e-12 * scale
    assert np.abs(found[0] - differences(graph, gradient, inputs)).max() <= 1e-5 * scale
    assert all(matrix[i][j] == matrix[j][i] for i in range(len(xs)) for j in range(i))
