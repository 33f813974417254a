"""The order in which a function computes its nodes after passes have made new ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gibbs_codegen.graph.graph import Graph, Ref


def in_order(graph: Graph, outputs: Sequence[Ref], origins: Mapping[int, int]) -> list[int]:
    """Nodes that a function computes, inputs included, each in the place of what it was made for.

    `origins` has for each node that a pass has made the one in whose place it stands. A node comes
    after those that it is made of.
    """
    nodes = graph.reached_varying(outputs)
    stack = sorted(nodes, key=lambda node: (origins.get(node, node), node), reverse=True)
    found: dict[int, None] = {}
    while stack:
        node = stack[-1]
        operands = [ref >> 1 for ref in graph.operands[node]]
        missing = [n for n in operands if n not in found and not graph.constant[n]]
        if missing:
            stack.extend(reversed(missing))
        else:
            found.setdefault(stack.pop())
    return list(found)
