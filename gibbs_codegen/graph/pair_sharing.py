"""Pair sharing: what several sums have in common is added once.

    s = x + y + z                p = x + y
    t = x + y − w       is       s = p + z
    u = w − x − y                t = p − w
                                 u = w − p

This is the greedy method of C. Paar (Optimized arithmetic for Reed–Solomon encoders, 1997): the
pair of terms that most sums have in common, with the same sign between the two, becomes a term of
its own, until no two sums have a pair in common. It can lose, where it hides a better choice.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, MutableMapping, Sequence
from heapq import heapify, heappop, heappush
from itertools import chain, combinations

from gibbs_codegen.graph.graph import Graph, Kind, Ref
from gibbs_codegen.graph.rebuilding import Rebuilding

# Two terms and whether they have opposite signs, in one number, which sorts and hashes fast.
_Pair = int
_BITS = 31
# Of longer sums the other terms are left out: their pairs would be too many.
_MOST_TERMS = 200


def shared(graph: Graph, outputs: Sequence[Ref], origins: MutableMapping[int, int]) -> list[Ref]:
    """Share pairs of terms between the sums of a function; `origins` is as of `optimised`."""
    return _Sharing(graph, outputs).rebuilt(origins)


class _Sharing(Rebuilding):
    """Sums as mappings of terms to signs, 1 for minus, and the pairs that became terms.

    A term is a node, or the number of all nodes and the number of a pair.
    """

    def __init__(self, graph: Graph, outputs: Sequence[Ref]) -> None:
        super().__init__(graph, outputs)
        self._sums = {
            node: {ref >> 1: ref & 1 for ref in graph.operands[node]}
            for node in self.nodes
            if graph.kinds[node] is Kind.SUM
        }
        self._first = len(graph)
        self._pairs: list[_Pair] = []
        self._made: dict[int, Ref] = {}
        self._share()

    def sum(self, node: int) -> Ref:
        """The sum of its terms, pairs among them."""
        terms = self._sums[node]
        if len(terms) == len(self.graph.operands[node]):
            return self.remade(node)
        return self.graph.sum([self._term(term, sign) for term, sign in terms.items()])

    def _term(self, term: int, sign: int) -> Ref:
        """A term by its reference; a pair is added where it is first used."""
        if term < self._first:
            return self.new(2 * term ^ sign)
        made = self._made.get(term)
        if made is None:
            first, second, sign_between = _parts(self._pairs[term - self._first])
            made = self.graph.sum([self._term(first, 0), self._term(second, sign_between)])
            self._made[term] = made
        return self.graph.minus(made) if sign else made

    def _share(self) -> None:
        """Make the pair that most sums have a term, until no two sums have a pair in common."""
        users = _users(self._sums)
        heap = [(-len(sums), pair) for pair, sums in users.items()]
        heapify(heap)
        while heap:
            count, pair = heappop(heap)
            first, second, _ = _parts(pair)
            # Those whose terms have not gone into other pairs since.
            sums = [n for n in users[pair] if first in self._sums[n] and second in self._sums[n]]
            if len(sums) == -count:
                found = self._replace(pair, sums)
                users.update(found)
                for new, new_sums in found.items():
                    heappush(heap, (-len(new_sums), new))
            elif len(sums) > 1:
                users[pair] = sums
                heappush(heap, (-len(sums), pair))

    def _replace(self, pair: _Pair, sums: Sequence[int]) -> dict[_Pair, list[int]]:
        """Make a pair a term of some sums, and find the pairs that these have with it."""
        first, second, _ = _parts(pair)
        new = self._first + len(self._pairs)
        self._pairs.append(pair)
        found: dict[_Pair, list[int]] = {}
        for node in sums:
            terms = self._sums[node]
            sign = terms.pop(first)
            del terms[second]
            for term, other in terms.items():
                found.setdefault(_pair(term, new, sign ^ other), []).append(node)
            terms[new] = sign
        return {pair: sums for pair, sums in found.items() if len(sums) > 1}


def _users(sums: Mapping[int, Mapping[int, int]]) -> dict[_Pair, list[int]]:
    """Sums by pair of terms, of pairs that more than one sum has."""
    often = Counter(chain.from_iterable(sums.values()))
    users: dict[_Pair, list[int]] = {}
    for node, signs in sums.items():
        terms = sorted([(term, sign) for term, sign in signs.items() if often[term] > 1])
        for (first, sign), (second, other) in combinations(terms[:_MOST_TERMS], 2):
            users.setdefault(_pair(first, second, sign ^ other), []).append(node)
    return {pair: sums for pair, sums in users.items() if len(sums) > 1}


def _pair(first: int, second: int, sign: int) -> _Pair:
    """A pair of terms, the older first, as one number; the sign between them is 1 for minus."""
    return first << _BITS + 1 | second << 1 | sign


def _parts(pair: _Pair) -> tuple[int, int, int]:
    return pair >> _BITS + 1, (pair >> 1) & (1 << _BITS) - 1, pair & 1
