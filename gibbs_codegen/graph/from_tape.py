"""From the tape to the graph: each statement of the tape becomes a node."""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.graph.graph import Graph, Ref
from gibbs_codegen.symbolic.tape import Stage, Tape


class ImportedTape:
    """A graph that grows with a tape: what is asked for is imported, with all that it needs."""

    def __init__(self, tape: Tape) -> None:
        self.graph = Graph()
        self.tape = tape
        self._refs: dict[sp.Expr, Ref] = {}

    def ref(self, expression: sp.Expr) -> Ref:
        """The graph's reference to an expression on the tape.

        Args:
            expression: A number, a symbol of the tape, or an expression of such.

        Returns:
            The reference.
        """
        found = self._refs.get(expression)
        if found is None:
            self._import_statements(expression)
            found = self._refs[expression] = self._imported(expression)
        return found

    def _import_statements(self, expression: sp.Expr) -> None:
        """Import the statements that an expression needs, in the order of the tape."""
        statements, stages = self.tape.statements, self.tape.stages
        found: set[sp.Symbol] = set()
        stack = [s for s in _symbols(expression) if s not in self._refs]
        while stack:
            symbol = stack.pop()
            if symbol in found:
                continue
            found.add(symbol)
            if symbol in statements:
                operands = _symbols(statements[symbol])
                stack.extend([s for s in operands if s not in self._refs])
        for symbol in sorted(found, key=self.tape.rank):
            if symbol in statements:
                self._refs[symbol] = self._imported(statements[symbol])
            else:
                constant = stages[symbol] is Stage.PARAMETER
                self._refs[symbol] = self.graph.input(symbol.name, constant)

    def _imported(self, expression: sp.Expr) -> Ref:
        graph = self.graph
        if expression.is_Symbol:
            return self._refs[expression]
        if expression.is_number:
            return graph.number(float(sp.N(expression, 30)))
        if expression.is_Add:
            return graph.sum([self._imported(term) for term in expression.args])
        if expression.is_Mul:
            return self._product(expression)
        if expression.is_Pow:
            base, exponent = expression.args
            ref = self._imported(base)
            if exponent is sp.S.Half:
                return graph.call("sqrt", ref)
            power = graph.products([ref] * abs(int(exponent)))
            return power if exponent > 0 else graph.reciprocal(power)
        return graph.call(expression.func.__name__, self._imported(expression.args[0]))

    def _product(self, expression: sp.Expr) -> Ref:
        """A product, its numbers multiplied before they are rounded."""
        numbers, factors = sp.S.One, []
        for factor in expression.args:
            if factor.is_number:
                numbers *= factor
            else:
                factors.append(self._imported(factor))
        # Constants before what varies, older before younger: as the tape has put them together.
        factors.sort(key=lambda ref: (not self.graph.constant[ref >> 1], ref))
        varying = self.graph.products(factors)
        return self.graph.product(self._imported(numbers), varying)


def _symbols(expression: sp.Expr) -> list[sp.Symbol]:
    """Symbols of an expression, as often as they stand there; SymPy's own way takes longer."""
    if expression.is_Symbol:
        return [expression]
    return [symbol for part in expression.args for symbol in _symbols(part)]
