"""What is shortened is counted and emitted as it was counted."""

from __future__ import annotations

import pytest
from support.random_graphs import random_function, values

from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.graph.graph import Graph, NodeKind, opposite
from gibbs_codegen.graph.shortening import operations, optimised
from gibbs_codegen.program.lower import Slice, lower
from gibbs_codegen.program.nodes import count_operations
from gibbs_codegen.symbolic.tape import Tape


def test_each_operation_counts_once() -> None:
    """x·y + z, its square root and one over it, with a sine that costs nothing."""
    graph = Graph()
    k = graph.symbol("k", constant=True)
    x, y, z = (graph.symbol(name) for name in "xyz")
    total = graph.sum([graph.product(x, y), z, graph.product(k, k)])
    root = graph.call("sqrt", total)
    assert operations(graph, [total]) == 3
    assert operations(graph, [root, graph.reciprocal(root), graph.call("sin", x)]) == 5
    assert operations(graph, [graph.call("sign", opposite(total)), graph.call("atan", x)]) == 5


def test_rounds_are_made_as_long_as_they_help() -> None:
    """The pair a·x + b·x that two sums share can be factored once it is shared."""
    graph = Graph()
    a, b, x, y, z = (graph.symbol(name) for name in "abxyz")
    pair = [graph.product(a, x), graph.product(b, x)]
    outputs = [graph.sum([*pair, y]), graph.sum([*pair, z])]
    assert operations(graph, outputs) == 6
    assert operations(graph, optimised(graph, outputs, {}).outputs) == 4


@pytest.mark.parametrize("seed", range(20))
def test_the_program_has_as_many_operations_and_the_same_values(seed: int) -> None:
    imported = ImportedTape(Tape())
    graph, outputs, numbers = random_function(seed, imported.graph)
    names = [
        (str(label), constant)
        for kind, label, constant in zip(graph.kinds, graph.labels, graph.constant, strict=True)
        if kind is NodeKind.INPUT
    ]
    inputs = {"q": tuple(name for name, constant in names if not constant)}
    given = {name: value for (name, _), value in zip(names, numbers, strict=True)}
    piece = Slice("f", ("q",), (((len(outputs),), tuple(outputs)),))
    program = lower(imported, inputs, [name for name, constant in names if constant], [piece])
    expected = operations(graph, optimised(graph, outputs, {}).outputs)
    assert count_operations(program.function("f").nodes()).total == expected
    parameters = {name: given[name] for name in program.parameters}
    (found,) = program.evaluate("f", parameters, {"q": [given[name] for name in inputs["q"]]})
    assert found == pytest.approx(values(graph, outputs, numbers), rel=1e-9, abs=1e-9)
