"""Shortening a function: rounds of passes as long as one saves enough, and the shortest is kept.

Factoring takes out of each sum what its products have in common:

    k·a + m·a + a·x + y·z        is   a·((k + m) + x) + y·z

where the products are used nowhere else, so that their multiplications are saved. Constants that
meet in a bracket cost nothing, and so a·((k + m) + x) has an addition less too. Sums within a sum
that are used once are first put into it. What parameters alone determine is left as it is, because
its rounding is arranged with care. Sums of what varies may be regrouped: a compensated sum of
such would not survive.

Pair sharing adds once what several sums have in common:

    s = x + y + z                p = x + y
    t = x + y − w       is       s = p + z
    u = w − x − y                t = p − w
                                 u = w − p

This is the greedy method of C. Paar (Optimized arithmetic for Reed–Solomon encoders, 1997): the
pair of terms that most sums have in common, with the same sign between the two, becomes a term of
its own, until no two sums have a pair in common. It can lose, where it hides a better choice.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, MutableMapping, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from itertools import chain, combinations
from operator import itemgetter

from gibbs_codegen.graph.graph import PRODUCT, RECIPROCAL, SUM, Graph, Ref
from gibbs_codegen.graph.signs import Polarity


class Rebuilding(ABC):
    """A function that is rebuilt. Nodes are made in the order of those that they replace."""

    def __init__(self, graph: Graph, outputs: Sequence[Ref]) -> None:
        self.graph = graph
        self.outputs = outputs
        self.nodes = graph.reached_varying(outputs)
        self.uses = graph.uses(self.nodes, outputs)
        # Those that are used once: they can be taken apart where they are used.
        once = [node for node in self.nodes if self.uses[node] == 1]
        self.single_sums = {node for node in once if graph.kinds[node] is SUM}
        self.single_products = {node for node in once if graph.kinds[node] is PRODUCT}
        self._new: dict[int, Ref] = {}

    @abstractmethod
    def sum(self, node: int) -> Ref:
        """The replacement of a sum, from those of its operands."""

    def rebuilt(self, origins: MutableMapping[int, int]) -> list[Ref]:
        """The outputs after replacement; `origins` is as of `optimised`."""
        graph, new = self.graph, self._new
        for node in self.nodes:
            is_sum = graph.kinds[node] is SUM
            if not is_sum and new.keys().isdisjoint(graph.varying[node]):
                continue
            size = len(graph)
            ref = self.sum(node) if is_sum else self.remade(node)
            if ref != 2 * node:
                new[node] = ref
                # The younger may be there already, made for another function.
                for made in (*range(size, len(graph)), max(ref >> 1, node)):
                    origins.setdefault(made, origins.get(node, node))
        return [self.new(output) for output in self.outputs]

    def new(self, ref: Ref) -> Ref:
        """The value that stands now for a value of the function as it was."""
        replacement = self._new.get(ref >> 1)
        if replacement is None:
            return ref
        return self.graph.minus(replacement) if ref & 1 else replacement

    def remade(self, node: int) -> Ref:
        """A node on its replaced operands, itself where none has changed."""
        if self._new.keys().isdisjoint(self.graph.varying[node]):
            return 2 * node
        return self.graph.remade(node, [self.new(ref) for ref in self.graph.operands[node]])


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
            if graph.kinds[node] is SUM
            for ref in graph.operands[node]
            if ref >> 1 in self.single_sums
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
            if ref >> 1 in self.single_sums:
                yield from self._terms(self.graph.operands[ref >> 1], sign ^ ref & 1)
            else:
                yield ref ^ sign

    def _factors(self, ref: Ref) -> Iterator[Ref]:
        """Factors of a term without signs; of products only those that are used once."""
        if ref >> 1 in self.single_products:
            for factor in self.graph.operands[ref >> 1]:
                yield from self._factors(factor)
        else:
            yield ref & ~1

    def _best(self, terms: Sequence[Ref]) -> tuple[Ref, list[Ref]]:
        """The factor that saves most, and the terms that it is found in."""
        holders: dict[Ref, list[Ref]] = {}
        for term in terms:
            for factor in dict.fromkeys(self._factors(term)):
                holders.setdefault(factor, []).append(term)
        best, most = 0, 0
        for factor, members in holders.items():
            if len(members) > 1:
                # Operations that it saves to take the factor out of these terms.
                constants = 0
                products = 0
                for term in members:
                    if term & ~1 == factor:
                        constants += 1
                    else:
                        products += 1
                        first, second = self.graph.operands[term >> 1]
                        constants += self.graph.constant[first >> 1] and second == factor
                saved = products - 1 + max(constants - 1, 0)
                if saved > most:
                    best, most = factor, saved
        return best, holders[best] if most else []

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


# Two terms and whether they have opposite signs, in one number, which sorts and hashes fast.
_Pair = int
_BITS = 31
# Longer sums go without their other terms, which have too many pairs.
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
            node: _signs(graph.operands[node]) for node in self.nodes if graph.kinds[node] is SUM
        }
        self._first = len(graph)
        self._pairs: list[_Pair] = []
        self._made: dict[int, Ref] = {}
        # The pair that most sums have becomes a term, until no two sums have a pair in common.
        often = Counter(chain.from_iterable(self._sums.values()))
        users: dict[_Pair, list[int]] = {}
        for node, signs in self._sums.items():
            terms = sorted([(term, sign) for term, sign in signs.items() if often[term] > 1])
            for (first, sign), (second, other) in combinations(terms[:_MOST_TERMS], 2):
                users.setdefault(_pair(first, second, sign ^ other), []).append(node)
        heap = [(-len(sums), pair) for pair, sums in users.items() if len(sums) > 1]
        heapify(heap)
        while heap:
            count, pair = heappop(heap)
            first, second, _ = _parts(pair)
            # Those whose terms have not gone into other pairs since.
            sums = [n for n in users[pair] if first in self._sums[n] and second in self._sums[n]]
            if len(sums) == -count:
                pairs = self._replace(pair, sums)
                users.update(pairs)
                for new, new_sums in pairs.items():
                    heappush(heap, (-len(new_sums), new))
            elif len(sums) > 1:
                users[pair] = sums
                heappush(heap, (-len(sums), pair))

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

    def _replace(self, pair: _Pair, sums: Sequence[int]) -> dict[_Pair, list[int]]:
        """Make a pair a term of some sums, and find the pairs that these have with it."""
        first, second, _ = _parts(pair)
        new = self._first + len(self._pairs)
        self._pairs.append(pair)
        common: dict[_Pair, list[int]] = {}
        for node in sums:
            terms = self._sums[node]
            sign = terms.pop(first)
            del terms[second]
            for term, other in terms.items():
                common.setdefault(_pair(term, new, sign ^ other), []).append(node)
            terms[new] = sign
        return {pair: sums for pair, sums in common.items() if len(sums) > 1}


def _signs(terms: Sequence[Ref]) -> dict[int, int]:
    """The sign of each term of a sum, 1 for minus."""
    signs = {ref >> 1: ref & 1 for ref in terms}
    if len(signs) < len(terms):
        raise ValueError(f"the sum of {list(terms)} has like terms")
    return signs


def _pair(first: int, second: int, sign: int) -> _Pair:
    """A pair of terms, the older first, as one number; the sign between them is 1 for minus."""
    return first << _BITS + 1 | second << 1 | sign


def _parts(pair: _Pair) -> tuple[int, int, int]:
    return pair >> _BITS + 1, (pair >> 1) & (1 << _BITS) - 1, pair & 1


# Rounds of passes; they end where one saves less than one operation in so many.
_MOST_ROUNDS = 4
_WORTH_ANOTHER = 400
# Operations above which a function whose lines repeat from link to link is left as it is. C writes
# such lines as loops; passes would hide that, to save one operation in a hundred.
_LONGEST = 10_000


def operations(graph: Graph, outputs: Sequence[Ref]) -> int:
    """Operations that a function takes, as the emitted program counts them.

    Sine–cosine pairs and arctangents are not among them.
    """
    return _without_signs(graph, outputs) + Polarity(graph, outputs).changes


@dataclass(frozen=True)
class Shortened:
    """A function's outputs, and the signs with which what they are made of is computed."""

    outputs: list[Ref]
    polarity: Polarity


def optimised(
    graph: Graph, outputs: Sequence[Ref], origins: MutableMapping[int, int], repeats: bool = True
) -> Shortened:
    """Shorten a function: the same values in the same order.

    `origins` has for each node that a pass has made the one in whose place it stands; it is added
    to. `repeats`: whether the lines of a long function repeat, which passes would hide.
    """
    present = list(outputs)
    if repeats and _without_signs(graph, present) > _LONGEST:
        return Shortened(present, Polarity(graph, present))
    counts = {tuple(present): _without_signs(graph, present)}
    for _ in range(_MOST_ROUNDS):
        least = min(counts.values())
        for apply in (factored, shared):
            present = apply(graph, present, origins)
            if (key := tuple(present)) not in counts:
                counts[key] = _without_signs(graph, present)
        if least - min(counts.values()) <= least // _WORTH_ANOTHER:
            break
    (first, count), *rest = sorted(counts.items(), key=itemgetter(1))
    best = Shortened([*first], Polarity(graph, first))
    least = count + best.polarity.changes
    for outputs, count in rest:
        if count >= least:  # Signs, which take long to choose, can only add to this.
            break
        other = Shortened([*outputs], Polarity(graph, outputs))
        if count + other.polarity.changes < least:
            best, least = other, count + other.polarity.changes
    return best


def _without_signs(graph: Graph, outputs: Sequence[Ref]) -> int:
    count, kinds = 0, graph.kinds
    for node in graph.reached_varying(outputs):
        kind = kinds[node]
        if kind is SUM or kind is PRODUCT:
            count += len(graph.operands[node]) - 1
        elif kind is RECIPROCAL or graph.labels[node] in ("sqrt", "sign"):
            count += 1
    return count
