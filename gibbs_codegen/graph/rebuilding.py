"""Rebuilding a function, as the passes that shorten it do: its sums are replaced, oldest first."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import MutableMapping, Sequence

from gibbs_codegen.graph.graph import Graph, Kind, Ref


class Rebuilding(ABC):
    """A function that is rebuilt. Nodes are made in the order of those that they replace."""

    def __init__(self, graph: Graph, outputs: Sequence[Ref]) -> None:
        self.graph = graph
        self.outputs = outputs
        self.nodes = graph.reached_varying(outputs)
        self.uses = graph.uses(self.nodes, outputs)
        self._new: dict[int, Ref] = {}

    @abstractmethod
    def sum(self, node: int) -> Ref:
        """What is computed in the place of a sum, from what its operands have become."""

    def rebuilt(self, origins: MutableMapping[int, int]) -> list[Ref]:
        """What the outputs have become; `origins` is as of `optimised`."""
        graph, new = self.graph, self._new
        for node in self.nodes:
            size = len(graph)
            ref = self.sum(node) if graph.kinds[node] is Kind.SUM else self.remade(node)
            if ref != 2 * node:
                new[node] = ref
                # The younger may be there already, made for another function.
                for made in (*range(size, len(graph)), max(ref >> 1, node)):
                    origins.setdefault(made, origins.get(node, node))
        return [self.new(output) for output in self.outputs]

    def new(self, ref: Ref) -> Ref:
        """The value that stands now for a value of the function as it was."""
        found = self._new.get(ref >> 1)
        if found is None:
            return ref
        return self.graph.minus(found) if ref & 1 else found

    def remade(self, node: int) -> Ref:
        """A node on what its operands have become, itself where none has changed."""
        operands = self.graph.operands[node]
        if self._new.keys().isdisjoint([operand >> 1 for operand in operands]):
            return 2 * node
        return self.graph.remade(node, [self.new(operand) for operand in operands])

    def single(self, ref: Ref, kind: Kind) -> bool:
        """Whether a value is of a kind, varies and is used once: it can be taken apart there."""
        node = ref >> 1
        graph = self.graph
        return self.uses[node] == 1 and graph.kinds[node] is kind and not graph.constant[node]
