"""Graphs at random, and what their values are."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence

import sympy as sp

from gibbs_codegen.graph.graph import Graph, NodeKind, Ref

# Fractions modulo this prime are exact, and stay short.
PRIME = 2**61 - 1

_NUMBERS = [sp.Integer(1), sp.Integer(-1), sp.Integer(2), sp.Integer(-2), sp.S.Half]

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
            case NodeKind.INPUT:
                found.append(next(given))
            case NodeKind.NUMBER:
                found.append(float(sp.N(label)))
            case NodeKind.SUM:
                found.append(math.fsum(of))
            case NodeKind.PRODUCT:
                found.append(of[0] * of[1])
            case NodeKind.RECIPROCAL:
                found.append(1.0 / of[0])
            case NodeKind.CALL:
                found.append(_FUNCTIONS[str(label)](of[0]))
    return [value(ref) for ref in refs]


def exact(graph: Graph, refs: Sequence[Ref], rates: Sequence[int] = ()) -> list[tuple[int, int]]:
    """Values modulo a prime, and their derivatives, where inputs have these rates or none.

    Functions are others of the same parity, which know sine and cosine as each other's derivatives.
    """
    inputs = iter([*rates, *[0] * len(graph)])
    found: list[tuple[int, int]] = []

    def value(ref: Ref) -> tuple[int, int]:
        x, rate = found[ref >> 1]
        return (-x, -rate) if ref & 1 else (x, rate)

    for node, label in enumerate(graph.labels):
        of = [value(ref) for ref in graph.operands[node]]
        match graph.kinds[node]:
            case NodeKind.INPUT:
                made = 3**node + 11, next(inputs)
            case NodeKind.NUMBER:
                number = sp.Rational(label)
                made = number.p * pow(number.q, -1, PRIME), 0
            case NodeKind.SUM:
                made = sum(x for x, _ in of), sum(rate for _, rate in of)
            case NodeKind.PRODUCT:
                (x, dx), (y, dy) = of
                made = x * y, x * dy + y * dx
            case NodeKind.RECIPROCAL:
                inverse = pow(of[0][0], -1, PRIME)
                made = inverse, -inverse * inverse * of[0][1]
            case NodeKind.CALL:
                ((x, dx),) = of
                sine, cosine, root = 7 * x**3 + x, 5 * x**2 + 2, x**2 + x + 9
                value_of, by_x = {
                    "sin": (sine, cosine),
                    "cos": (cosine, -sine),
                    "sqrt": (root, pow(2 * root, -1, PRIME)),
                    "atan": (x**3, pow(1 + x**2, -1, PRIME)),
                    "sign": (x**5, 0),
                }[str(label)]
                made = value_of, by_x * dx
        found.append((made[0] % PRIME, made[1] % PRIME))
    return [(x % PRIME, rate % PRIME) for x, rate in map(value, refs)]


def random_function(
    seed: int, graph: Graph | None = None, size: int = 60
) -> tuple[Graph, list[Ref], list[float]]:
    """A function with much to factor and to share: graph, outputs and inputs to try it with."""
    draw = random.Random(seed)  # noqa: S311
    graph = graph or Graph()
    refs = [graph.symbol(f"p{i}", constant=True) for i in range(3)]
    refs += [graph.symbol(f"x{i}") for i in range(6)]
    inputs = [draw.uniform(0.5, 2.0) for _ in refs]
    refs += [graph.number(sp.Integer(2)), graph.number(sp.Rational(-3, 4))]

    def operand() -> Ref:
        return graph.minus(draw.choice(refs)) if draw.random() < 0.5 else draw.choice(refs)

    for _ in range(size):
        match draw.randrange(8):
            case 0 | 1 | 2:
                made = graph.product(operand(), operand())
            case 3:
                made = graph.sum([operand() for _ in range(draw.randrange(2, 6))])
            case 4:  # Like terms, some of which cancel.
                few = [operand() for _ in range(3)]
                numbers = [graph.number(draw.choice(_NUMBERS)) for _ in range(6)]
                made = graph.sum([graph.product(number, draw.choice(few)) for number in numbers])
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
