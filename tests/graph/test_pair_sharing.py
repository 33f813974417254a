"""Terms that sums have in common are added once."""

from __future__ import annotations

from gibbs_codegen.graph.graph import Graph, opposite
from gibbs_codegen.graph.shortening import operations, shared


def test_a_pair_is_added_once_with_either_sign() -> None:
    graph = Graph()
    x, y, z, v, w = (graph.symbol(name) for name in "xyzvw")
    sums = [
        graph.sum([x, opposite(y), z]),
        graph.sum([x, opposite(y), opposite(w)]),
        graph.sum([y, opposite(x), v]),
    ]
    pair = graph.sum([x, opposite(y)])
    found = shared(graph, sums, {})
    expected = [[pair, z], [pair, opposite(w)], [opposite(pair), v]]
    assert found == [graph.sum(terms) for terms in expected]
    assert (operations(graph, sums), operations(graph, found)) == (6, 4)


def test_pairs_are_made_of_pairs() -> None:
    graph = Graph()
    a, b, c, d, e, f = (graph.symbol(name) for name in "abcdef")
    sums = [graph.sum([a, b, c, d]), graph.sum([a, b, c, e]), graph.sum([a, b, f])]
    found = shared(graph, sums, {})
    pair = graph.sum([a, b])
    three = graph.sum([pair, c])
    assert found == [graph.sum([three, d]), graph.sum([three, e]), graph.sum([pair, f])]


def test_the_pair_of_most_sums_comes_first() -> None:
    """Once y + z is added for three sums, x + y is in one sum only."""
    graph = Graph()
    x, y, z, v, w = (graph.symbol(name) for name in "xyzvw")
    sums = [graph.sum([x, y, z]), graph.sum([y, z, v]), graph.sum([y, z, w]), graph.sum([x, y])]
    pair = graph.sum([y, z])
    found = shared(graph, sums, {})
    assert found == [*(graph.sum([pair, term]) for term in (x, v, w)), sums[3]]


def test_a_sum_within_others_is_used_by_them() -> None:
    graph = Graph()
    x, y, z, w = (graph.symbol(name) for name in "xyzw")
    whole, more = graph.sum([x, y, z]), graph.sum([x, y, z, w])
    assert operations(graph, [whole, more]) == 5
    found = shared(graph, [whole, more], {})
    assert operations(graph, found) == 3
