"""Derivatives by the numbers of the bodies: by the parameters, and the regressor.

A function f(k(p)) is differentiated by the constants k that it reads, as if nothing else were known
of them. What `prepare` makes the constants of is constant itself, so their derivatives by the
parameters are computed once per set of parameters, and a call only forms sums of products with
these.

The regressor has the derivatives of inverse dynamics by the base parameters, in which it is linear.
The inertias of the regrouped tree take the place of symbols, which are no parameters, so that the
derivatives are computed anew at every state. They hold no such symbol themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import sympy as sp

from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.segment_tree import Segment, SegmentTree
from gibbs_codegen.derivation.systems import Systems
from gibbs_codegen.derivation.tree_dynamics import generalised_inertia_forces
from gibbs_codegen.graph.differentiate import Matrix, jacobian, vjp
from gibbs_codegen.graph.graph import Graph, Kind, Ref
from gibbs_codegen.graph.shortening import operations
from gibbs_codegen.robot.module_lists import GIVEN, NUMBERS
from gibbs_codegen.symbolic.tape import Stage


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


def base_parameters(systems: Systems) -> list[sp.Expr]:
    """Numbers of the bodies that their joints feel, in the order of the base parameters."""
    return [
        segment.inertia.entries[place]
        for k, segment in enumerate(systems.symbolic.reduced_tree.segments)
        for place in _places(segment, k)
    ]


def regressor(systems: Systems) -> Matrix:
    """The matrix whose product with the base parameters is ∂S/∂θ̈; rows in the order of v."""
    symbolic, tape, imported = systems.symbolic, systems.tape, systems.imported
    symbols: list[sp.Expr] = []
    segments = []
    for k, segment in enumerate(symbolic.reduced_tree.segments):
        entries: list[sp.Expr] = [sp.S.Zero] * len(NUMBERS)
        for place in _places(segment, k):
            # No name that a robot can give is like that.
            entries[place] = tape.symbol(f"number {place} of segment {k}", Stage.MOTION)
            symbols.append(entries[place])
        segments.append(replace(segment, inertia=Inertia.of(entries)))
    tree = SegmentTree(tuple(segments))
    forces = generalised_inertia_forces(tape, symbolic.root, tree, symbolic.state)
    directions = [{ref >> 1: imported.graph.one} for ref in systems.generic.refs(symbols)]
    with imported.group("columns of the regressor"):
        return jacobian(imported.graph, systems.generic.refs(forces), directions)


def _places(segment: Segment, k: int) -> list[int]:
    """Which numbers of the inertia of segment k are base parameters; of the base all are."""
    given = GIVEN[segment.joint] if k else ()
    return [place for place, name in enumerate(NUMBERS) if name not in given]
