"""Derivatives on the graph, exact, by the chain rule from node to node.

    s = sin(x), p = s·y, in the direction (x', y'):    s' = cos(x)·x',  p' = s'·y + s·y'

Forward, as above, a derivative passes from the inputs to the outputs: one pass a direction.
Backward, a weighted sum of all outputs is differentiated by every node that it is made of: one
pass gives its derivatives by all inputs. What is made is made of nodes again, so it can be
differentiated once more. Any nodes can be the inputs: what they are made of does not move.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import sympy as sp

from gibbs_codegen.graph.graph import PRODUCT, RECIPROCAL, SUM, Graph, Ref

# The rate of each input that moves, by its node.
Direction: TypeAlias = Mapping[int, Ref]
Matrix: TypeAlias = list[list[Ref]]


def partials(graph: Graph, node: int) -> list[tuple[int, Ref]]:
    """Operands of a node, each with the derivative by it; twice where it stands twice."""
    kind, operands = graph.kinds[node], graph.operands[node]
    if kind is SUM:
        return [(ref >> 1, graph.one ^ (ref & 1)) for ref in operands]
    if kind is PRODUCT:
        x, y = operands
        return [(x >> 1, y), (y >> 1, x)]
    if not operands:
        return []
    (ref,) = operands
    match "reciprocal" if kind is RECIPROCAL else graph.labels[node]:
        case "reciprocal":
            outer = graph.minus(graph.product(2 * node, 2 * node))
        case "sin":
            outer = graph.call("cos", ref)
        case "cos":
            outer = graph.minus(graph.call("sin", ref))
        case "sqrt":
            outer = graph.product(graph.number(sp.S.Half), graph.reciprocal(2 * node))
        case "atan":
            square = graph.product(ref, ref)
            outer = graph.reciprocal(graph.sum([graph.one, square]))
        case "sign":
            outer = graph.zero
        case unknown:
            raise ValueError(f"the derivative of the function {unknown!r} is not known")
    return [(ref >> 1, graph.minus(outer) if ref & 1 else outer)]


def jvp(graph: Graph, outputs: Sequence[Ref], direction: Direction) -> list[Ref]:
    """Derivatives of outputs in one direction, the rates of the inputs: J·d."""
    return _pushed(graph, outputs, [direction])[0]


def jacobian(graph: Graph, outputs: Sequence[Ref], directions: Sequence[Direction]) -> Matrix:
    """Derivatives of outputs (rows) in several directions (columns), forward."""
    columns = _pushed(graph, outputs, directions)
    return [list(row) for row in zip(*columns, strict=True)]


def _pushed(
    graph: Graph, outputs: Sequence[Ref], directions: Sequence[Direction]
) -> list[list[Ref]]:
    """For each direction, the rates of the inputs, the derivatives of the outputs."""
    order = graph.reached(outputs)
    inputs = {node for direction in directions for node in direction}
    moving = set(inputs)
    steps: list[tuple[int, list[tuple[int, Ref]]]] = []
    for node in order:
        inner = [ref >> 1 for ref in graph.operands[node]]
        if node not in inputs and any(operand in moving for operand in inner):
            moving.add(node)
            kept = [(m, partial) for m, partial in partials(graph, node) if m in moving]
            steps.append((node, kept))
    columns = []
    for direction in directions:
        rates = {node: rate for node, rate in direction.items() if not graph.is_zero(rate)}
        for node, parts in steps:
            terms = [graph.product(part, rates[m]) for m, part in parts if m in rates]
            if terms and not graph.is_zero(rate := graph.sum(terms)):
                rates[node] = rate
        reached = [rates.get(ref >> 1, graph.zero) for ref in outputs]
        pairs = zip(reached, outputs, strict=True)
        columns.append([graph.minus(rate) if ref & 1 else rate for rate, ref in pairs])
    return columns


def vjp(
    graph: Graph, outputs: Sequence[Ref], weights: Sequence[Ref], inputs: Sequence[Ref]
) -> list[Ref]:
    """Derivatives of a weighted sum of outputs by inputs, backward: Jᵀ·w.

    Inputs are references without signs.
    """
    order = graph.reached(outputs)
    ends = {ref >> 1 for ref in inputs}
    active = set(ends)
    for node in order:
        if any((ref >> 1) in active for ref in graph.operands[node]):
            active.add(node)
    received: dict[int, list[Ref]] = {}
    for output, weight in zip(outputs, weights, strict=True):
        share = graph.minus(weight) if output & 1 else weight
        received.setdefault(output >> 1, []).append(share)
    adjoints: dict[int, Ref] = {}
    for node in reversed(order):
        if node not in received or node not in active:
            continue
        adjoint = adjoints[node] = graph.sum(received[node])
        if node in ends or graph.is_zero(adjoint):
            continue
        for operand, partial in partials(graph, node):
            if operand in active:
                share = graph.product(partial, adjoint)
                received.setdefault(operand, []).append(share)
    return [adjoints.get(ref >> 1, graph.zero) for ref in inputs]


def hessian(graph: Graph, gradient: Sequence[Ref], directions: Sequence[Direction]) -> Matrix:
    """Second derivatives of a function, forward over its gradient: the lower triangle, mirrored.

    The gradient is in the directions, as `vjp` gives it.
    """
    size = len(directions)
    matrix = [[graph.zero] * size for _ in range(size)]
    for j, direction in enumerate(directions):
        column = jvp(graph, gradient[j:], direction)
        for i, entry in enumerate(column, start=j):
            matrix[i][j] = matrix[j][i] = entry
    return matrix
