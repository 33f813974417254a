"""What a pass has made stands where that stood which it replaces."""

from __future__ import annotations

import pytest
from support.random_graphs import random_function

from gibbs_codegen.graph.graph import Graph, in_order
from gibbs_codegen.graph.shortening import optimised


def test_a_sum_that_was_factored_stays_in_its_place() -> None:
    graph = Graph()
    x, y, z = (graph.symbol(name) for name in "xyz")
    given = graph.sum([graph.product(x, y), graph.product(x, z)])
    later = graph.product(y, z)
    outputs = [given, later]
    origins: dict[int, int] = {}
    found = optimised(graph, outputs, origins).outputs
    bracket = graph.sum([y, z])
    computed = [bracket, graph.product(x, bracket), later]
    assert found == computed[1:]
    assert in_order(graph, found, origins) == [ref >> 1 for ref in (x, y, z, *computed)]
    assert in_order(graph, outputs, {}) == graph.reached_varying(outputs)


@pytest.mark.parametrize("seed", range(20))
def test_operands_come_first(seed: int) -> None:
    graph, outputs, _ = random_function(seed)
    origins: dict[int, int] = {}
    found = optimised(graph, outputs, origins).outputs
    order = in_order(graph, found, origins)
    assert sorted(order) == graph.reached_varying(found)
    place = {node: i for i, node in enumerate(order)}
    for node in order:
        for ref in graph.operands[node]:
            assert place.get(ref >> 1, -1) < place[node]
