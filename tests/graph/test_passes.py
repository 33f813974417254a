"""What holds for every pass: values are what they were, and the same is made in every run."""

from __future__ import annotations

from collections.abc import Callable, MutableMapping, Sequence

import pytest
import sympy as sp
from support.random_graphs import exact, random_function

from gibbs_codegen.graph.graph import Graph, NodeKind, Ref
from gibbs_codegen.graph.shortening import factored, operations, optimised, shared

Pass = Callable[[Graph, Sequence[Ref], MutableMapping[int, int]], list[Ref]]


def shortest(graph: Graph, outputs: Sequence[Ref], origins: MutableMapping[int, int]) -> list[Ref]:
    """All passes, one after the other."""
    return optimised(graph, outputs, origins).outputs


PASSES: list[Pass] = [factored, shared, shortest]


@pytest.mark.parametrize("shorten", PASSES)
@pytest.mark.parametrize("seed", range(40))
def test_values_are_exactly_what_they_were(shorten: Pass, seed: int) -> None:
    graph, outputs, _ = random_function(seed)
    assert exact(graph, shorten(graph, outputs, {})) == exact(graph, outputs)


def test_like_terms_are_one_term_and_a_sum_that_has_them_is_refused() -> None:
    graph = Graph()
    k, x, y = graph.symbol("k", constant=True), graph.symbol("x"), graph.symbol("y")
    two, four = graph.number(sp.Integer(2)), graph.number(sp.Integer(-4))
    for like in (x, k, graph.product(k, x), graph.product(x, graph.product(two, y))):
        twice = graph.product(two, like)
        assert graph.sum([like, like, graph.minus(twice), y]) == y
        thrice = graph.sum([twice, like])
        assert graph.kinds[thrice >> 1] is NodeKind.PRODUCT
        assert exact(graph, [thrice]) == exact(
            graph, [graph.product(graph.number(sp.Integer(3)), like)]
        )
        assert graph.sum([like, graph.product(four, like), y, like, twice]) == y
    total = graph.sum([x, y])
    graph.operands[total >> 1] = (x, x)
    with pytest.raises(ValueError, match="has like terms"):
        shared(graph, [total], {})


@pytest.mark.parametrize("seed", range(40))
def test_functions_never_get_longer(seed: int) -> None:
    graph, outputs, _ = random_function(seed)
    before = operations(graph, outputs)
    assert operations(graph, optimised(graph, outputs, {}).outputs) <= before


def test_functions_get_much_shorter_where_there_is_much_to_share() -> None:
    before = after = 0
    for seed in range(10):
        graph, outputs, _ = random_function(seed)
        before += operations(graph, outputs)
        after += operations(graph, optimised(graph, outputs, {}).outputs)
    assert after < 0.9 * before


@pytest.mark.parametrize("shorten", PASSES)
def test_the_same_is_made_in_every_run(shorten: Pass) -> None:
    made = []
    for _ in range(2):
        graph, outputs, _ = random_function(seed=3)
        made.append((shorten(graph, outputs, {}), graph.kinds, graph.operands, graph.labels))
    assert made[0] == made[1]


@pytest.mark.parametrize("shorten", PASSES)
def test_what_is_short_stays_the_same(shorten: Pass) -> None:
    graph = Graph()
    x, y, z = (graph.symbol(name) for name in "xyz")
    outputs = [graph.sum([graph.product(x, y), z]), graph.call("cos", graph.sum([x, z]))]
    size = len(graph)
    assert shorten(graph, outputs, {}) == outputs
    assert len(graph) == size


@pytest.mark.parametrize("shorten", PASSES)
def test_what_parameters_alone_determine_is_left_as_it_is(shorten: Pass) -> None:
    graph = Graph()
    a, b, c, d = (graph.symbol(name, constant=True) for name in "abcd")
    twice = graph.sum([graph.product(a, b), graph.product(a, c)])
    outputs = [twice, graph.sum([twice, d]), graph.sum([graph.product(a, b), d])]
    assert shorten(graph, outputs, {}) == outputs


@pytest.mark.parametrize("shorten", [factored, shared])
def test_what_replaces_a_sum_is_known_to(shorten: Pass) -> None:
    graph = Graph()
    x, y, z, w = (graph.symbol(name) for name in "xyzw")
    if shorten is factored:
        given = graph.sum([graph.product(x, y), graph.product(x, z)])
    else:
        given = graph.sum([x, y, z])
    outputs = [graph.call("sin", given), graph.sum([x, y, w])]
    origins: dict[int, int] = {}
    sine, _ = shorten(graph, outputs, origins)
    (argument,) = graph.operands[sine >> 1]
    assert argument != given
    assert (origins[argument >> 1], origins[sine >> 1]) == (given >> 1, outputs[0] >> 1)
