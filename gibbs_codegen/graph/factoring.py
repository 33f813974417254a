"""Factoring: a·b + a·c becomes a·(b + c), within each sum.

    k·a + m·a + a·x + y·z        is   a·((k + m) + x) + y·z

where the products are used nowhere else, so that their multiplications are saved. Constants that
meet in a bracket cost nothing, and so a·((k + m) + x) has an addition less too. Sums within a sum
that are used once are first put into it. What parameters alone determine is left as it is, because
its rounding is arranged with care. Sums of what varies may be regrouped: a compensated sum of
such would not survive.
"""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping, Sequence

from gibbs_codegen.graph.graph import Graph, Kind, Ref
from gibbs_codegen.graph.rebuilding import Rebuilding


def factored(graph: Graph, outputs: Sequence[Ref], origins: MutableMapping[int, int]) -> list[Ref]:
    """Factor the sums of a function; `origins` is as of `optimised`."""
    return _Factoring(graph, outputs).rebuilt(origins)


class _Factoring(Rebuilding):
    """Replaces each sum by one of as few factors as are found."""

    def __init__(self, graph: Graph, outputs: Sequence[Ref]) -> None:
        super().__init__(graph, outputs)
        # Sums that are put into those that use them.
        self._inner = {
            ref >> 1
            for node in self.nodes
            if graph.kinds[node] is Kind.SUM
            for ref in graph.operands[node]
            if self.single(ref, Kind.SUM)
        }

    def sum(self, node: int) -> Ref:
        """The sum, factored."""
        graph = self.graph
        if node in self._inner:
            return 2 * node
        terms = list(self._terms(graph.operands[node]))
        factor, members = self._best(terms)
        if not members and len(terms) == len(graph.operands[node]):
            return self.remade(node)
        done: list[Ref] = []
        while members:
            bracket = [self._without(term, factor) for term in members]
            done.append(graph.product(self.new(factor), graph.sum(bracket)))
            terms = [term for term in terms if term not in members]
            factor, members = self._best(terms)
        return graph.sum([*done, *map(self.new, terms)])

    def _terms(self, refs: Sequence[Ref], sign: int = 0) -> Iterator[Ref]:
        """Terms, those of sums that are used once in their place."""
        for ref in refs:
            if self.single(ref, Kind.SUM):
                yield from self._terms(self.graph.operands[ref >> 1], sign ^ ref & 1)
            else:
                yield ref ^ sign

    def _factors(self, ref: Ref) -> Iterator[Ref]:
        """Factors of a term without signs; of products only those that are used once."""
        if self.single(ref, Kind.PRODUCT):
            for factor in self.graph.operands[ref >> 1]:
                yield from self._factors(factor)
        else:
            yield ref & ~1

    def _best(self, terms: Sequence[Ref]) -> tuple[Ref, list[Ref]]:
        """The factor that saves most, and the terms that it is found in."""
        found: dict[Ref, list[Ref]] = {}
        for term in terms:
            for factor in dict.fromkeys(self._factors(term)):
                found.setdefault(factor, []).append(term)
        best, most = 0, 0
        for factor, members in found.items():
            if len(members) > 1:
                saved = self._saved(factor, members)
                if saved > most:
                    best, most = factor, saved
        return best, found[best] if most else []

    def _saved(self, factor: Ref, members: Sequence[Ref]) -> int:
        """Operations that it saves to take a factor out of some terms."""
        constants = 0
        products = 0
        for term in members:
            if term & ~1 == factor:
                constants += 1
            else:
                products += 1
                first, second = self.graph.operands[term >> 1]
                constants += self.graph.constant[first >> 1] and second == factor
        return products - 1 + max(constants - 1, 0)

    def _without(self, ref: Ref, factor: Ref) -> Ref:
        """A term without a factor of its, its other factors multiplied as they were."""
        graph = self.graph
        if ref & ~1 == factor:
            return graph.one ^ ref & 1
        first, second = graph.operands[ref >> 1]
        if factor in self._factors(first):
            rest = graph.product(self._without(first, factor), self.new(second))
        else:
            rest = graph.product(self.new(first), self._without(second, factor))
        return graph.minus(rest) if ref & 1 else rest
