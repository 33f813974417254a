"""From the tape to the graph: each statement of the tape becomes a node."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import sympy as sp

from gibbs_codegen.graph.graph import Graph, Ref
from gibbs_codegen.symbolic.tape import Stage, Tape, is_minus_symbol, whole_power


class ImportedTape:
    """A graph that grows with a tape, statement by statement in the tape's order."""

    def __init__(self, tape: Tape) -> None:
        self.graph = Graph()
        self.tape = tape
        self._refs: dict[sp.Expr, Ref] = {}
        self._symbols = 0
        # Numbers of nodes from which on others are made for themselves, with what is said of them.
        self._starts: list[int] = [0]
        self._words: list[str] = [""]

    def ref(self, expression: sp.Expr) -> Ref:
        """The graph's reference to a number, a symbol of the tape, or an expression of such."""
        stages = self.tape.stages
        if len(stages) > self._symbols:  # The tape has more since the last time.
            for symbol in list(stages)[self._symbols :]:
                statement = self.tape.statements.get(symbol)
                if statement is None:
                    constant = stages[symbol] is Stage.PARAMETER
                    self._refs[symbol] = self.graph.symbol(symbol.name, constant)
                else:
                    self._refs[symbol] = self._imported(statement)
            self._symbols = len(stages)
        ref = self._refs.get(expression)
        if ref is None:
            ref = self._refs[expression] = self._imported(expression)
        return ref

    def words(self, groups: Mapping[sp.Symbol, str]) -> dict[int, str]:
        """First words of each node that is a statement of the tape, by its symbols' groups."""
        words_of: dict[int, str] = {}
        for symbol, words in groups.items():
            words_of.setdefault(self.ref(symbol) >> 1, words)
        return words_of

    @contextmanager
    def group(self, words: str) -> Iterator[None]:
        """Say, as a comment, what nodes are that are made in a `with` block and are no statements.

        After the block counts again what was said before.
        """
        outer = self._words[-1]
        self._say(words)
        try:
            yield
        finally:
            self._say(outer)

    def _say(self, words: str) -> None:
        self._starts.append(len(self.graph))
        self._words.append(words)

    def words_of(self, node: int) -> str:
        """The words of the block in which a node was made, or ""."""
        return self._words[bisect_right(self._starts, node) - 1]

    def _imported(self, expression: sp.Expr) -> Ref:
        graph = self.graph
        if expression.is_Symbol:
            return self._refs[expression]
        if expression.is_Mul and len(expression.args) == 2:
            first, second = expression.args
            if first.is_Symbol and second.is_Symbol:  # The most frequent, and −x.
                return graph.product(self._refs[first], self._refs[second])
            if is_minus_symbol(expression):
                return graph.minus(self._refs[second])
        if expression.is_number:
            return graph.number(expression)
        if expression.is_Add:
            return graph.sum([self._imported(term) for term in expression.args])
        if expression.is_Mul:
            # Older factors come first, as the tape has put them together.
            number = sp.Mul(*(factor for factor in expression.args if factor.is_number))
            factors = [self._imported(f) for f in expression.args if not f.is_number]
            return graph.product(self._imported(number), graph.products(sorted(factors)))
        if expression.is_Pow:
            if expression.exp is sp.S.Half:
                return graph.call("sqrt", self._imported(expression.base))
            base, exponent = whole_power(expression)
            power = graph.products([self._imported(base)] * abs(exponent))
            return power if exponent > 0 else graph.reciprocal(power)
        return graph.call(expression.func.__name__, self._imported(expression.args[0]))
