"""Derivatives by the parameters: f(k(p)) by way of the constants k that `prepare` makes of them.

A function is differentiated by the constants that it reads, as if nothing else were known of them.
What the constants are made of is constant itself, so their derivatives by the parameters are
computed once per set of parameters, and a call only forms sums of products with these.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

from gibbs_codegen.derivation.systems import Systems
from gibbs_codegen.graph.differentiate import Matrix, jacobian, vjp
from gibbs_codegen.graph.graph import Graph, Kind, Ref
from gibbs_codegen.graph.optimise import operations


def parameter_jacobian(systems: Systems) -> Matrix:
    """Derivatives of inverse dynamics by the parameters: a row for each force."""
    imported = systems.imported
    graph, forces = imported.graph, systems.generic.refs(systems.inverse_dynamics)
    constants = _constants(graph, forces)
    with imported.group("derivatives by the constants, column by column"):
        rows = jacobian(graph, forces, [{ref >> 1: graph.one} for ref in constants])
    return _by_parameters(systems, constants, rows)


def parameter_gradient(systems: Systems) -> list[Ref]:
    """Derivatives by the parameters of the sum of the accelerations with the weights w."""
    imported, generic = systems.imported, systems.generic
    graph, accelerations = imported.graph, generic.refs(systems.dynamics[1])
    constants = _constants(graph, accelerations)
    with imported.group("gradient by the constants, backward from the result"):
        row = vjp(graph, accelerations, generic.refs(systems.symbolic.w), constants)
    return _by_parameters(systems, constants, [row])[0]


def _constants(graph: Graph, outputs: Sequence[Ref]) -> list[Ref]:
    """Constants that a function reads, oldest first."""
    read = [ref for node in graph.reached_varying(outputs) for ref in graph.operands[node]]
    nodes = {ref >> 1 for ref in [*read, *outputs]}
    return [
        2 * node
        for node in sorted(nodes)
        if graph.constant[node] and graph.kinds[node] is not Kind.NUMBER
    ]


def _by_parameters(systems: Systems, constants: Sequence[Ref], rows: Matrix) -> Matrix:
    """Derivatives of outputs (rows) by the parameters, from `rows`, those by the constants.

    Either the derivatives of the constants by the parameters are there as numbers, or the sums go
    back from constant to constant, and those of many parameters have parts in common: which is
    shorter differs from robot to robot.
    """
    graph, parameters = systems.imported.graph, [*systems.parameters.values()]
    with systems.imported.group("derivatives by the parameters"):
        columns = jacobian(graph, constants, [{ref >> 1: graph.one} for ref in parameters])
        products = [
            [
                graph.sum(map(graph.product, by_parameter, row))
                for by_parameter in zip(*columns, strict=True)
            ]
            for row in rows
        ]
        backward = [vjp(graph, constants, row, parameters) for row in rows]
    return min(products, backward, key=lambda found: operations(graph, [*chain(*found)]))
