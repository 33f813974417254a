"""Signs: which values a function computes with the opposite sign, so that few signs are changed.

    s = x + y
    out = [−s, w − s]

is best computed as s' = −x − y only where x or y is at hand as −x or −y. A sum costs an operation
more where all its terms come with a minus sign. A product, a reciprocal or an odd function has its
sign from its operands, at no cost. A square root and an output need their operand with its own
sign, and inputs and constants are given with theirs. So only sums have a choice: a bit each. A
choice costs an operation for each *condition* that it breaks: in a list of signs, that of a sum's
terms or that of an output alone, there must be a plus. Bits are changed one after another as long
as that breaks less.
"""

from __future__ import annotations

from collections.abc import Sequence

from gibbs_codegen.graph.graph import EVEN, Graph, Kind, Ref


def polarity(graph: Graph, outputs: Sequence[Ref]) -> set[int]:
    """Choose the signs with which values are computed.

    Args:
        graph: The graph.
        outputs: What the function returns.

    Returns:
        Nodes that are computed with the opposite sign: sums, and what has its sign from them.
    """
    return _Signs(graph, outputs).negated()


def sign_changes(graph: Graph, outputs: Sequence[Ref]) -> int:
    """Operations that only change signs, with the signs that `polarity` chooses.

    Args:
        graph: The graph.
        outputs: What the function returns.

    Returns:
        Their number.
    """
    return _Signs(graph, outputs).broken()


class _Signs:
    """Conditions, each a list of signs, 1 for minus, and how many of them are minus."""

    def __init__(self, graph: Graph, outputs: Sequence[Ref]) -> None:
        self._graph = graph
        # Sums of which the sign of a node is the product, where there are any.
        self._bits: dict[int, tuple[int, ...]] = {}
        self._conditions: list[list[int]] = []
        self._minus: list[int] = []
        # Of each sum, the conditions that its sign is found in, and the places in each.
        self._places: dict[int, list[tuple[int, list[int]]]] = {}
        for node in graph.reached_varying(outputs):
            self._read(node)
        for output in dict.fromkeys(outputs):
            if graph.value(output) is None:
                self._require((output,))
        self._changed: set[int] = set()
        self._search()

    def negated(self) -> set[int]:
        """Nodes that are computed with the opposite sign."""
        changed = self._changed
        return {
            node
            for node, bits in self._bits.items()
            if sum([bit in changed for bit in bits]) % 2 == 1
        }

    def broken(self) -> int:
        """Number of conditions in which every sign is minus."""
        return sum(map(self._is_broken, range(len(self._conditions))))

    def _is_broken(self, condition: int) -> bool:
        return self._minus[condition] == len(self._conditions[condition])

    def _read(self, node: int) -> None:
        graph, bits = self._graph, self._bits
        kind, operands = graph.kinds[node], graph.operands[node]
        if kind is Kind.SUM:
            bits[node] = (node,)
            self._places[node] = []
            self._require(operands, node)
        elif kind is Kind.PRODUCT:
            first, second = (bits.get(ref >> 1, ()) for ref in operands)
            # A sum that is found in both has no say.
            product = first + second
            if first and second:
                product = tuple([bit for bit in product if (bit in first) != (bit in second)])
            if product:
                bits[node] = product
        elif kind is Kind.CALL and graph.labels[node] == "sqrt":
            self._require(operands)
        elif operands and graph.labels[node] not in EVEN and operands[0] >> 1 in bits:
            bits[node] = bits[operands[0] >> 1]

    def _require(self, refs: Sequence[Ref], chosen: int | None = None) -> None:
        """One of these values, or with a choice one of their opposites, has to have a plus."""
        number = len(self._conditions)
        places: dict[int, list[int]] = {}
        for i, ref in enumerate(refs):
            for bit in self._bits.get(ref >> 1, ()):
                places.setdefault(bit, []).append(i)
        if chosen is not None:
            places[chosen] = list(range(len(refs)))
        for bit, where in places.items():
            self._places[bit].append((number, where))
        signs = [ref & 1 for ref in refs]
        self._conditions.append(signs)
        self._minus.append(sum(signs))

    def _search(self) -> None:
        """Change signs, those of the youngest sums first, until no single change helps."""
        bits = sorted(self._places, reverse=True)
        helped = True
        while helped:
            helped = False
            for bit in bits:
                if self._gain(bit) > 0:
                    self._change(bit)
                    helped = True

    def _gain(self, bit: int) -> int:
        """How many conditions fewer are broken where the sign of a sum is changed."""
        gain = 0
        for condition, places in self._places[bit]:
            signs, minus = self._conditions[condition], self._minus[condition]
            after = minus + len(places) - 2 * sum([signs[i] for i in places])
            gain += (minus == len(signs)) - (after == len(signs))
        return gain

    def _change(self, bit: int) -> None:
        self._changed ^= {bit}
        for condition, places in self._places[bit]:
            signs = self._conditions[condition]
            for i in places:
                signs[i] ^= 1
            self._minus[condition] = sum(signs)
