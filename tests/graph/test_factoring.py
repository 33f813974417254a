"""Factors are taken out of sums where that saves operations."""

from __future__ import annotations

from gibbs_codegen.graph.graph import Graph, opposite
from gibbs_codegen.graph.shortening import factored, operations


def test_a_common_factor_is_multiplied_once() -> None:
    graph = Graph()
    a, b, c, d = (graph.symbol(name) for name in "abcd")
    product = graph.product
    given = graph.sum([product(a, b), opposite(product(a, c)), d])
    (found,) = factored(graph, [given], {})
    assert found == graph.sum([product(a, graph.sum([b, opposite(c)])), d])
    assert (operations(graph, [given]), operations(graph, [found])) == (4, 3)


def test_constants_that_meet_cost_nothing() -> None:
    """k·a + m·a + a·x is a·((k + m) + x); a alone counts as 1·a."""
    graph = Graph()
    k, m = (graph.symbol(name, constant=True) for name in "km")
    a, x = (graph.symbol(name) for name in "ax")
    product = graph.product
    (found,) = factored(graph, [graph.sum([product(k, a), product(a, x), product(m, a)])], {})
    assert found == product(a, graph.sum([graph.sum([k, m]), x]))
    assert operations(graph, [found]) == 2
    (found,) = factored(graph, [graph.sum([product(k, a), a])], {})
    assert found == product(graph.sum([k, graph.one]), a)
    assert operations(graph, [found]) == 1


def test_what_saves_most_is_factored_first() -> None:
    """Of a·x + a·y + k·x + m·x the factor x saves most, with the constants k and m."""
    graph = Graph()
    k, m = (graph.symbol(name, constant=True) for name in "km")
    a, x, y = (graph.symbol(name) for name in "axy")
    product = graph.product
    terms = [product(a, x), product(a, y), product(k, x), product(m, x)]
    (found,) = factored(graph, [graph.sum(terms)], {})
    assert found == graph.sum([product(a, y), product(x, graph.sum([graph.sum([k, m]), a]))])


def test_a_factor_is_found_within_products_and_sums_that_are_used_once() -> None:
    """k·(x·y) + (z − x·w) is z + x·(k·y − w)."""
    graph = Graph()
    k = graph.symbol("k", constant=True)
    w, x, y, z = (graph.symbol(name) for name in "wxyz")
    product = graph.product
    inner = graph.sum([z, opposite(product(x, w))])
    (found,) = factored(graph, [graph.sum([product(k, product(x, y)), inner])], {})
    bracket = graph.sum([product(k, y), opposite(w)])
    assert found == graph.sum([z, product(x, bracket)])


def test_products_that_are_used_elsewhere_stay() -> None:
    graph = Graph()
    a, b, c = (graph.symbol(name) for name in "abc")
    shared = graph.product(a, b)
    outputs = [graph.sum([shared, graph.product(a, c)]), shared]
    assert factored(graph, outputs, {}) == outputs


def test_terms_that_cancel_leave_zero() -> None:
    """(x − y) + (y + z) − (x + z), of which each bracket is used once."""
    graph = Graph()
    x, y, z = (graph.symbol(name) for name in "xyz")
    brackets = [graph.sum([x, opposite(y)]), graph.sum([y, z]), opposite(graph.sum([x, z]))]
    assert factored(graph, [graph.sum(brackets)], {}) == [graph.zero]
