"""Graphs at random, and what their values are."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence

from gibbs_codegen.graph.graph import Graph, Kind, Ref

_FUNCTIONS: dict[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "sqrt": math.sqrt,
    "atan": math.atan,
    "sign": lambda value: math.copysign(1.0, value),
}


def values(graph: Graph, refs: Sequence[Ref], inputs: Sequence[float]) -> list[float]:
    """Evaluate references; inputs in the order in which the graph got them."""
    given = iter(inputs)
    found: list[float] = []

    def value(ref: Ref) -> float:
        return -found[ref >> 1] if ref & 1 else found[ref >> 1]

    for kind, operands, label in zip(graph.kinds, graph.operands, graph.labels, strict=True):
        of = [value(ref) for ref in operands]
        match kind:
            case Kind.INPUT:
                found.append(next(given))
            case Kind.NUMBER:
                found.append(float(str(label)))
            case Kind.SUM:
                found.append(math.fsum(of))
            case Kind.PRODUCT:
                found.append(of[0] * of[1])
            case Kind.RECIPROCAL:
                found.append(1.0 / of[0])
            case Kind.CALL:
                found.append(_FUNCTIONS[str(label)](of[0]))
    return [value(ref) for ref in refs]


def random_function(
    seed: int, graph: Graph | None = None, size: int = 60
) -> tuple[Graph, list[Ref], list[float]]:
    """A function with much to factor and to share: graph, outputs and inputs to try it with."""
    draw = random.Random(seed)  # noqa: S311
    graph = graph or Graph()
    refs = [graph.symbol(f"p{i}", constant=True) for i in range(3)]
    refs += [graph.symbol(f"x{i}") for i in range(6)]
    inputs = [draw.uniform(0.5, 2.0) for _ in refs]
    refs += [graph.number(2.0), graph.number(-0.75)]

    def operand() -> Ref:
        return graph.minus(draw.choice(refs)) if draw.random() < 0.5 else draw.choice(refs)

    for _ in range(size):
        match draw.randrange(8):
            case 0 | 1 | 2:
                made = graph.product(operand(), operand())
            case 3 | 4:
                made = graph.sum([operand() for _ in range(draw.randrange(2, 6))])
            case 5:
                common = operand()
                terms = [graph.product(common, operand()) for _ in range(draw.randrange(2, 5))]
                made = graph.sum([*terms, operand()])
            case 6:
                made = graph.call(draw.choice(["sin", "cos", "atan", "sign"]), operand())
            case _:
                inner = operand()
                root = graph.call("sqrt", graph.sum([graph.one, graph.product(inner, inner)]))
                made = graph.reciprocal(root)
        if not graph.is_zero(made) and abs(values(graph, [made], inputs)[0]) < 1e3:
            refs.append(made)
    outputs = [operand() for _ in range(12)]
    return graph, outputs, inputs
