"""Exact operation counts of nodes.

    x - 2*y + 1/z

is one addition, one subtraction, one multiplication and one division.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from gibbs_codegen.program.nodes import Call, Node, Product, Reciprocal, Sum


@dataclass(frozen=True)
class Operations:
    """Exact operation counts; signs and their changes count as subtractions.

    Sine–cosine pairs and arctangents are counted apart.
    """

    additions: int = 0
    subtractions: int = 0
    multiplications: int = 0
    divisions: int = 0
    square_roots: int = 0
    sine_cosine_pairs: int = 0
    arctangents: int = 0

    @property
    def total(self) -> int:
        """All but the sine–cosine pairs and arctangents."""
        return (
            self.additions
            + self.subtractions
            + self.multiplications
            + self.divisions
            + self.square_roots
        )


def count_operations(nodes: Iterable[Node]) -> Operations:
    """Operations that it takes to compute each of some nodes once.

    What they have in common counts as often as it occurs, but for sine–cosine pairs, which are
    counted once per angle.
    """
    additions = subtractions = multiplications = divisions = 0
    others: Counter[str] = Counter()
    angles: set[Node] = set()
    stack = list(nodes)
    while stack:
        node = stack.pop()
        match node:
            case Sum(terms):
                negative = sum(sign < 0 for sign, _ in terms)
                subtractions += negative
                additions += max(len(terms) - negative - 1, 0)
            case Product(factors):
                multiplications += len(factors) - 1
            case Reciprocal():
                divisions += 1
            case Call("sin" | "cos", argument) if argument in angles:
                continue
            case Call("sin" | "cos", argument):
                angles.add(argument)
            case Call(function):
                others[function] += 1
        stack.extend(node.operands)
    return Operations(
        additions,
        subtractions + others["sign"],
        multiplications,
        divisions,
        others["sqrt"],
        len(angles),
        others["atan"],
    )
