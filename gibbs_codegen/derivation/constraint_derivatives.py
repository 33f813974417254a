"""Derivatives of what constraints do, without those of what is solved for their forces.

Rows c = J a + γ are zero under the forces λ, as J v is under impulses, or what redundant rows ask
for and cannot have. With λ fixed, their derivatives dc come from passes over the graph; then

    dλ = −A⁺ (dc + A⁺ d(A c)) + (1 − A A⁺) d(A y)    with c and y = A⁺ λ fixed in d(A c), d(A y),

and everything else follows with dλ for the rates of λ. That is the derivative of a pseudo-inverse
of constant rank (Golub and Pereyra, 1973): λ is the least, which turns with the rows that are
independent, and c turns with what they leave. Where no row can be redundant, −A⁺ dc is all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import sympy as sp

from gibbs_codegen.graph.differentiate import Direction, Matrix, jacobian
from gibbs_codegen.graph.graph import Graph, Ref

if TYPE_CHECKING:
    from gibbs_codegen.derivation.systems import Systems


@dataclass(frozen=True)
class ConstraintDerivatives:
    """Derivatives by arguments, with forces or impulses that make rows zero."""

    systems: Systems
    forces: list[sp.Expr]
    rows: list[sp.Expr]

    def of(self, outputs: Sequence[sp.Expr], argument: str) -> Matrix:
        """Derivatives of outputs, which know the forces (rows), by an argument (columns)."""
        systems, graph = self.systems, self.systems.imported.graph
        forces = systems.refs(self.forces)
        fixed = _moved(graph, forces, [graph.zero] * len(forces))
        directions = systems.directions(argument)
        with systems.imported.group(f"derivatives by {argument}, with the forces fixed"):
            held = [{**direction, **fixed} for direction in directions]
            changes = jacobian(graph, systems.refs(self.rows), held)
        with systems.imported.group(f"derivatives of the forces by {argument}"):
            columns = [list(column) for column in zip(*changes, strict=True)]
            columns = self._of_forces(columns, directions if argument == "q" else [])
        with systems.imported.group(f"derivatives by {argument}, with those of the forces"):
            moved = [_moved(graph, forces, column) for column in columns]
            free = [{**x, **y} for x, y in zip(directions, moved, strict=True)]
            return jacobian(graph, systems.refs(outputs), free)

    def _matrix(self, rows: Sequence[Sequence[sp.Expr]]) -> Matrix:
        return [self.systems.refs(row) for row in rows]

    def _of_forces(self, columns: Matrix, turning: Sequence[Direction]) -> Matrix:
        """dλ from dc, by columns; A changes in the directions `turning`, if in any."""
        systems, graph, own = self.systems, self.systems.imported.graph, self.systems.constraints
        inverse = self._matrix(own.solver_inverse)
        added: Matrix = []
        if turning and not own.is_regular:
            tape, matrix = systems.symbolic.tape, self._matrix(own.masked_matrix)
            with tape.group("least forces, seen from the rows, and what rows cannot have"):
                dual = [tape.sum_of_products(row, self.forces) for row in own.solver_inverse]
                left = [tape.let(m * c) for m, c in zip(own.masks, self.rows, strict=True)]
            for by_dual, by_left in zip(
                self._under(dual, turning), self._under(left, turning), strict=True
            ):
                within = _product(graph, matrix, _product(graph, inverse, by_dual))
                added.append(_difference(graph, by_dual, within))
                column = columns[len(added) - 1]
                column[:] = _sum(graph, column, _product(graph, inverse, by_left))
        found = [[graph.minus(x) for x in _product(graph, inverse, column)] for column in columns]
        return [_sum(graph, *pair) for pair in zip(found, added, strict=True)] if added else found

    def _under(self, forces: list[sp.Expr], directions: Sequence[Direction]) -> Matrix:
        """Columns of d(A f) of the active rows, with the forces f fixed."""
        systems, graph, own = self.systems, self.systems.imported.graph, self.systems.constraints
        fixed = _moved(graph, systems.refs(forces), [graph.zero] * len(forces))
        rows = zip(own.masks, own.rows_under(forces), strict=True)
        masked = [systems.symbolic.tape.let(mask * row) for mask, row in rows]
        held = [{**direction, **fixed} for direction in directions]
        changes = jacobian(graph, systems.refs(masked), held)
        return [list(column) for column in zip(*changes, strict=True)]


def _sum(graph: Graph, one: Sequence[Ref], other: Sequence[Ref]) -> list[Ref]:
    return [graph.sum(pair) for pair in zip(one, other, strict=True)]


def _difference(graph: Graph, one: Sequence[Ref], other: Sequence[Ref]) -> list[Ref]:
    return [graph.sum([x, graph.minus(y)]) for x, y in zip(one, other, strict=True)]


def _moved(graph: Graph, refs: Sequence[Ref], rates: Sequence[Ref]) -> Direction:
    """Rates of values, by their nodes."""
    pairs = zip(refs, rates, strict=True)
    return {
        ref >> 1: graph.minus(rate) if ref & 1 else rate
        for ref, rate in pairs
        if not graph.is_zero(ref)
    }


def _product(graph: Graph, matrix: Matrix, column: Sequence[Ref]) -> list[Ref]:
    return [graph.sum(map(graph.product, row, column)) for row in matrix]


def dynamics(systems: Systems) -> ConstraintDerivatives:
    """Of accelerations, with the forces."""
    own = systems.constraints
    return ConstraintDerivatives(systems, own.solver_forces, own.held_rows())


def impact(systems: Systems) -> ConstraintDerivatives:
    """Of velocities after an impact, with the impulses."""
    own = systems.constraints
    return ConstraintDerivatives(systems, own.solver_impulses, own.stopped_rows())


# What a derivative of an output is made of, by the output's derivation.
IMPLICIT: dict[str, Callable[[Systems], ConstraintDerivatives]] = {
    "constrained_acceleration": dynamics,
    "constraint_forces": dynamics,
    "impact_velocities": impact,
    "impact_impulses": impact,
}
