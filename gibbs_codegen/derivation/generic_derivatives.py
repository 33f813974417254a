"""Derivatives of any function by passes over its graph, in the tangent space of the coordinates.

What is derived here is exact whatever the robot. It serves where no shorter recursion is known, and
as the oracle of those that are. A displacement of q is along the velocities: the derivative by it
is that of δ ↦ f(q ⊕ δ) at δ = 0. So the coordinates' rates at unit velocities are the directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.graph.differentiate import Direction, Matrix, hessian, jacobian, jvp, vjp
from gibbs_codegen.graph.from_tape import ImportedTape
from gibbs_codegen.graph.graph import Ref
from gibbs_codegen.robot.layout import layout_of

Exprs = Sequence[sp.Expr]


@dataclass(frozen=True)
class GenericDerivatives:
    """A robot in symbols with the graph on which its functions are differentiated."""

    imported: ImportedTape
    symbolic: SymbolicRobot

    def refs(self, entries: Sequence[sp.Expr | Ref]) -> list[Ref]:
        """References to entries: expressions of the tape, or references already."""
        return [e if isinstance(e, int) else self.imported.ref(e) for e in entries]

    def directions(self, argument: str) -> list[Direction]:
        """Directions in which an argument moves: rates of its entries, by their nodes.

        There is one for each column of a derivative by it; "q" moves along the velocities.
        """
        one = self.imported.graph.one
        if argument != "q":
            return [{ref >> 1: one} for ref in self.refs(getattr(self.symbolic, argument))]
        size = len(self.symbolic.v)
        units = [[sp.Integer(i == j) for i in range(size)] for j in range(size)]
        return [self._moved_along(velocities) for velocities in units]

    def _moved_along(self, velocities: Exprs) -> Direction:
        """Rates of the coordinates at some velocities, by their nodes."""
        symbolic = self.symbolic
        entries = self.refs(symbolic.coordinate_rates(velocities))
        return {ref >> 1: rate for ref, rate in zip(self.refs(symbolic.q), entries, strict=True)}

    def jacobian(self, outputs: Sequence[sp.Expr | Ref], argument: str) -> Matrix:
        """Derivatives of outputs (rows) by the directions of "q", "v", "a" or "u" (columns)."""
        with self.imported.group(f"derivatives by {argument}, column by column"):
            return jacobian(self.imported.graph, self.refs(outputs), self.directions(argument))

    def jvp(self, outputs: Exprs, arguments: str) -> list[Ref]:
        """Derivatives of outputs as `arguments`, by letters, move by q_dot, v_dot, …."""
        direction: dict[int, Ref] = {}
        for argument in arguments:
            given = getattr(self.symbolic, f"{argument}_dot")
            if argument == "q":
                direction |= self._moved_along(given)
            else:
                nodes = [ref >> 1 for ref in self.refs(getattr(self.symbolic, argument))]
                direction |= zip(nodes, self.refs(given), strict=True)
        with self.imported.group("derivative in the given direction"):
            return jvp(self.imported.graph, self.refs(outputs), direction)

    def gradient(self, outputs: Exprs, arguments: str) -> list[list[Ref]]:
        """Derivatives of the outputs' sum with weights w, by each argument's directions."""
        graph = self.imported.graph
        inputs = {letter: self.refs(getattr(self.symbolic, letter)) for letter in arguments}
        every = [ref for refs in inputs.values() for ref in refs]
        with self.imported.group("gradient, backward from the result"):
            weights = self.refs(self.symbolic.w)
            found = vjp(graph, self.refs(outputs), weights, every)
            by_node = {ref >> 1: entry for ref, entry in zip(every, found, strict=True)}
            return [
                [
                    graph.sum(graph.product(rate, by_node[node]) for node, rate in way.items())
                    for way in self.directions(letter)
                ]
                for letter in arguments
            ]

    def hessian(self, outputs: Exprs, arguments: str) -> Matrix:
        """Second derivatives of the outputs' sum with the weights w, symmetric.

        The directions of the arguments, which are letters, follow one another. Displacements of the
        attitude do not commute; the second derivative of δ ↦ f(q ⊕ δ) is the mean of both orders.
        """
        graph = self.imported.graph
        gradient = [ref for part in self.gradient(outputs, arguments) for ref in part]
        directions: list[Direction] = []
        starts: dict[str, int] = {}
        for letter in arguments:
            starts[letter] = len(directions)
            directions.extend(self.directions(letter))
        with self.imported.group("second derivatives, the lower triangle column by column"):
            matrix = hessian(graph, gradient, directions)
            layout = layout_of(self.symbolic.robot)
            if not layout.is_quaternion or "q" not in arguments:
                return matrix
            half = graph.number(0.5)
            base = [starts["q"] + place for place in layout.v.base]
            for j in base:
                others = [i for i in base if i < j]
                columns = jvp(graph, [gradient[i] for i in others], directions[j])
                for i, entry in zip(others, columns, strict=True):
                    mean = graph.product(half, graph.sum([entry, matrix[i][j]]))
                    matrix[i][j] = matrix[j][i] = mean
        return matrix
