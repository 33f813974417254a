"""Signs: which values a function computes with the opposite sign, so that few signs are changed.

    s = x − y
    out = [−s, z − s]

takes no change of sign if s is computed as y − x. A sum costs an operation more where all its terms
come with a minus sign; so does an output that comes with the wrong one. A product, a reciprocal or
an odd function has its sign from its operands, at no cost; a square root needs its operand with its
own sign; inputs and constants are given with theirs. So sums have a choice, and sines and cosines,
whose sign may be worth changing once and for all.
"""

from __future__ import annotations

from collections.abc import Sequence

from gibbs_codegen.graph.graph import EVEN, Graph, Kind, Ref
from gibbs_codegen.graph.sign_search import Conditions


class Polarity:
    """The signs with which a function computes its values.

    A choice has the number of the node whose sign it is.
    """

    def __init__(self, graph: Graph, outputs: Sequence[Ref]) -> None:
        self._graph = graph
        self.conditions = Conditions()
        # What the sign of a node depends on, where it depends on anything.
        self.choices: dict[int, tuple[int, ...]] = {}
        for node in graph.reached_varying(outputs):
            if graph.operands[node]:
                self._read(node)
        for output in dict.fromkeys(outputs):
            if graph.value(output) is None:
                self._require([output])
        self.conditions.search()

    @property
    def changes(self) -> int:
        """Operations that only change signs."""
        return len(self.conditions.broken())

    @property
    def negated(self) -> set[int]:
        """Nodes computed with the opposite sign, what has its sign from others included."""
        changed = self.conditions.changed
        return {
            node
            for node, choices in self.choices.items()
            if sum([choice in changed for choice in choices]) % 2 == 1
        }

    def _read(self, node: int) -> None:
        """Find what the sign of a node depends on, and what the node requires."""
        graph, choices = self._graph, self.choices
        kind, operands, label = graph.kinds[node], graph.operands[node], graph.labels[node]
        if kind is Kind.PRODUCT:
            first, second = (choices.get(ref >> 1, ()) for ref in operands)
            # What changes both factors changes nothing.
            both = set(first).intersection(second)
            found = tuple([choice for choice in first + second if choice not in both])
        elif kind is Kind.SUM or label in ("sin", "cos"):
            found = (node,)
            self._require([graph.one] if label in EVEN else operands, found)
        elif label == "sqrt":
            found = ()
            self._require(operands)
        else:
            found = choices.get(operands[0] >> 1, ())
        if found:
            choices[node] = found

    def _require(self, refs: Sequence[Ref], own: tuple[int, ...] = ()) -> None:
        """One of some values must come with a plus, all of them changed by a choice of its own."""
        choices = self.choices
        self.conditions.add(
            [ref & 1 for ref in refs], [own + choices.get(ref >> 1, ()) for ref in refs]
        )
