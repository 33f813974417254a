"""Shortening a function: rounds of passes as long as one saves enough, and the shortest is kept."""

from __future__ import annotations

from collections.abc import MutableMapping, Sequence
from dataclasses import dataclass

from gibbs_codegen.graph.factoring import factored
from gibbs_codegen.graph.graph import Graph, Kind, Ref
from gibbs_codegen.graph.pair_sharing import shared
from gibbs_codegen.graph.polarity import Polarity

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
    graph: Graph,
    outputs: Sequence[Ref],
    origins: MutableMapping[int, int],
    repeats: bool = True,
) -> Shortened:
    """Shorten a function: the same values in the same order.

    `origins` has for each node that a pass has made the one in whose place it stands; it is added
    to. `repeats`: whether the lines of a long function repeat, which passes would hide.
    """
    present = list(outputs)
    if repeats and _without_signs(graph, present) > _LONGEST:
        return Shortened(present, Polarity(graph, present))
    found = [(_without_signs(graph, present), present)]
    for _ in range(_MOST_ROUNDS):
        least = min(count for count, _ in found)
        for apply in (factored, shared):
            present = apply(graph, present, origins)
            found.append((_without_signs(graph, present), present))
        if least - min(count for count, _ in found) <= least // _WORTH_ANOTHER:
            break
    return _shortest(graph, found)


def _without_signs(graph: Graph, outputs: Sequence[Ref]) -> int:
    count = 0
    for node in graph.reached_varying(outputs):
        kind = graph.kinds[node]
        if kind in (Kind.SUM, Kind.PRODUCT):
            count += len(graph.operands[node]) - 1
        elif kind is Kind.RECIPROCAL or graph.labels[node] in ("sqrt", "sign"):
            count += 1
    return count


def _shortest(graph: Graph, found: list[tuple[int, list[Ref]]]) -> Shortened:
    """Of functions with their operations without signs, the first of the shortest with signs."""
    (count, outputs), *rest = sorted(found, key=lambda f: f[0])
    best = Shortened(outputs, Polarity(graph, outputs))
    least = count + best.polarity.changes
    for count, outputs in rest:
        if count >= least:  # Signs, which take long to choose, can only add to this.
            break
        other = Shortened(outputs, Polarity(graph, outputs))
        if count + other.polarity.changes < least:
            best, least = other, count + other.polarity.changes
    return best
