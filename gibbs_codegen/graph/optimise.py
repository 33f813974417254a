"""Shortening a function: passes are applied as long as one of them saves operations."""

from __future__ import annotations

import sys
from collections.abc import MutableMapping, Sequence

from gibbs_codegen.graph.factoring import factored
from gibbs_codegen.graph.graph import Graph, Kind, Ref
from gibbs_codegen.graph.pair_sharing import shared
from gibbs_codegen.graph.polarity import sign_changes

# Rounds of passes; they end where one saves less than one operation in so many.
_MOST_ROUNDS = 4
_WORTH_ANOTHER = 400
# Operations above which a function is left as it is. The lines of a long arm repeat from link to
# link, which C writes as loops; passes would hide that, to save one operation in a hundred.
_LONGEST = 10_000


def operations(graph: Graph, outputs: Sequence[Ref]) -> int:
    """Operations that a function takes, as the emitted program counts them.

    Args:
        graph: The graph.
        outputs: What the function returns.

    Returns:
        All operations but the sine–cosine pairs and arctangents.
    """
    return _without_signs(graph, outputs) + sign_changes(graph, outputs)


def optimised(
    graph: Graph,
    outputs: Sequence[Ref],
    origins: MutableMapping[int, int],
) -> list[Ref]:
    """Shorten a function.

    Args:
        graph: The graph.
        outputs: What the function returns.
        origins: Of each node that a pass has made, the one in whose place it stands; added to.

    Returns:
        The same values, in the same order.
    """
    present = list(outputs)
    if _without_signs(graph, present) > _LONGEST:
        return present
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


def _shortest(graph: Graph, found: list[tuple[int, list[Ref]]]) -> list[Ref]:
    """Of functions with their operations without signs, the first of the shortest with signs."""
    best: list[Ref] = []
    least = sys.maxsize
    for count, outputs in sorted(found, key=lambda f: f[0]):
        if count >= least:  # Signs, which take long to choose, can only add to this.
            break
        total = count + sign_changes(graph, outputs)
        if total < least:
            best, least = outputs, total
    return best
