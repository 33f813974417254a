"""Signs are chosen so that few have to be changed."""

from __future__ import annotations

import pytest
import sympy as sp
from support.random_graphs import random_function

from gibbs_codegen.graph.graph import Graph, NodeKind, Ref, opposite
from gibbs_codegen.graph.signs import Polarity


def test_a_sum_that_is_only_needed_with_a_minus_sign_is_computed_with_it() -> None:
    graph = Graph()
    x, y = (graph.symbol(name) for name in "xy")
    difference = graph.sum([x, opposite(y)])
    assert Polarity(graph, [opposite(difference)]).negated == {difference >> 1}
    assert Polarity(graph, [opposite(difference)]).changes == 0


def test_a_sum_of_minus_terms_costs_one_more() -> None:
    graph = Graph()
    x, y = (graph.symbol(name) for name in "xy")
    total = opposite(graph.sum([x, y]))
    assert Polarity(graph, [total]).changes == 1
    assert Polarity(graph, [opposite(x)]).changes == 1
    assert Polarity(graph, [opposite(graph.product(x, y))]).changes == 1
    assert Polarity(graph, [graph.number(sp.Integer(-2))]).changes == 0


def test_products_and_odd_functions_pass_signs_on() -> None:
    """−z·sin(x − y)/(x − w) takes no change of sign."""
    graph = Graph()
    x, y, z, w = (graph.symbol(name) for name in "xyzw")
    first, second = graph.sum([x, opposite(y)]), graph.sum([x, opposite(w)])
    quotient = graph.product(graph.call("sin", first), graph.reciprocal(second))
    output = opposite(graph.product(z, quotient))
    assert Polarity(graph, [output]).changes == 0
    assert output >> 1 in Polarity(graph, [output]).negated


def test_a_square_has_no_sign_and_a_root_needs_its_own() -> None:
    graph = Graph()
    x, y = (graph.symbol(name) for name in "xy")
    difference = graph.sum([x, opposite(y)])
    square = opposite(graph.product(difference, difference))
    assert Polarity(graph, [square]).changes == 1
    root = graph.call("sqrt", difference)
    assert Polarity(graph, [root, difference]).negated == set()
    assert Polarity(graph, [graph.call("sqrt", opposite(graph.product(x, y)))]).changes == 1


def test_a_sum_needed_with_both_signs_costs_one() -> None:
    graph = Graph()
    x, y = (graph.symbol(name) for name in "xy")
    difference = graph.sum([x, opposite(y)])
    assert Polarity(graph, [difference, opposite(difference)]).changes == 1


def test_the_sign_of_a_cosine_may_be_changed_for_all_that_use_it() -> None:
    """Three outputs −y·cos x, −z·cos x and −w·cos x take one change of sign."""
    graph = Graph()
    cosine = graph.call("cos", graph.symbol("x"))
    outputs = [opposite(graph.product(cosine, graph.symbol(name))) for name in "yzw"]
    assert Polarity(graph, outputs).changes == 1
    assert Polarity(graph, outputs).negated == {cosine >> 1, *(output >> 1 for output in outputs)}


def test_what_a_change_breaks_is_mended_by_the_next() -> None:
    """−(s + t) with s = x − y and t = z + w: neither −s − t nor y − x alone helps, but both do."""
    graph = Graph()
    x, y, z, w = (graph.symbol(name) for name in "xyzw")
    s, t = graph.sum([x, opposite(y)]), graph.sum([z, w])
    total = graph.sum([s, t])
    assert Polarity(graph, [opposite(total), t]).changes == 0
    assert Polarity(graph, [opposite(total), t]).negated == {total >> 1, s >> 1}


def changes(graph: Graph, outputs: list[Ref], negated: set[int]) -> int:
    """Sign changes with given signs, counted from what they mean."""

    def minus(ref: Ref) -> bool:
        return bool(ref & 1) != (ref >> 1 in negated)

    count = 0
    for node in graph.reached_varying(outputs):
        operands, kind = graph.operands[node], graph.kinds[node]
        if kind is NodeKind.SUM:
            count += all(minus(ref) != (node in negated) for ref in operands)
        elif graph.labels[node] == "sqrt":
            count += minus(operands[0])
        elif graph.labels[node] in ("sin", "cos"):
            odd = graph.labels[node] == "sin" and minus(operands[0])
            count += (node in negated) != odd
        elif operands:
            assert (node in negated) == (sum(minus(ref) for ref in operands) % 2 == 1)
    return count + sum(minus(ref) for ref in set(outputs) if graph.value(ref) is None)


@pytest.mark.parametrize("seed", range(30))
def test_changes_are_those_that_the_signs_bring(seed: int) -> None:
    graph, outputs, _ = random_function(seed)
    negated = Polarity(graph, outputs).negated
    constant = [node for node in negated if graph.constant[node]]
    assert not constant
    found = Polarity(graph, outputs).changes
    assert found == changes(graph, outputs, negated)
    assert found <= changes(graph, outputs, set())
