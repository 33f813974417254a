"""Signs: which values a function computes with the opposite sign, so that few signs are changed.

    s = x − y
    out = [−s, z − s]

takes no change of sign if s is computed as y − x. A sum costs an operation more where all its terms
come with a minus sign; so does an output that comes with the wrong one. A product, a reciprocal or
an odd function has its sign from its operands, at no cost; a square root needs its operand with its
own sign; inputs and constants are given with theirs. So sums have a choice, and sines and cosines,
whose sign may be worth changing once and for all.

Each choice changes signs in some conditions. A condition is a list of signs of which one at least
must be plus. It is broken where all are minus, and that costs an operation. To find the best of 2ⁿ
choices takes too long. So one choice after another is changed as long as less is broken; then each
condition that still is broken is mended, though that breaks others, which are mended next, and what
did not help in the end is taken back.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence

from gibbs_codegen.graph.graph import EVEN, PRODUCT, SUM, Graph, Ref

# How often all that is broken is gone through; how many conditions are visited from one, or choices
# changed, before that is taken back; and on how many conditions a choice may bear to mend others.
_ROUNDS, _VISITED, _STEPS, _MOST_PLACES = 3, 100, 200, 50


class Conditions:
    """Conditions, and the choices that their signs depend on. Choices are numbers."""

    def __init__(self) -> None:
        # Signs are bits, 1 for minus; a condition is broken where all its bits are 1.
        self._signs: list[int] = []
        self._broken: list[int] = []
        self._choices: list[list[int]] = []
        # For each choice, the conditions that depend on it, and the bits that it changes there.
        self._places: dict[int, list[tuple[int, int]]] = {}
        self.changed: set[int] = set()

    def add(self, signs: Sequence[int], choices: Iterable[Iterable[int]]) -> None:
        """Add a condition by its signs if nothing is changed, 1 for minus.

        `choices` are what changes each sign; each choice stands there once.
        """
        bits: dict[int, int] = {}
        number, minus, bit = len(self._signs), 0, 1
        for sign, changing in zip(signs, choices, strict=True):
            minus += sign * bit
            for choice in changing:
                bits[choice] = bits.get(choice, 0) | bit
            bit *= 2
        for choice, changed in bits.items():
            self._places.setdefault(choice, []).append((number, changed))
        self._choices.append(list(bits))
        self._signs.append(minus)
        self._broken.append(bit - 1)

    def broken(self) -> list[int]:
        """Numbers of the conditions with minus as every sign."""
        return [i for i, signs in enumerate(self._signs) if signs == self._broken[i]]

    def search(self) -> None:
        """Change choices, the greatest numbers first, until no way is found to break less."""
        for choice in sorted(self._places, reverse=True):
            if self._gain(choice) > 0:
                self._change(choice)
        for _ in range(_ROUNDS):
            helped = False
            for mend in (self._pass_on, self._mend_greedily):
                for condition in self.broken():
                    if self._is_broken(condition):
                        helped |= mend(condition, {condition})
            if not helped:
                return

    def _is_broken(self, condition: int) -> bool:
        return self._signs[condition] == self._broken[condition]

    def _broken_near(self, choice: int) -> list[int]:
        return [condition for condition, _ in self._places[choice] if self._is_broken(condition)]

    def _gain(self, choice: int) -> int:
        """The number of broken conditions that changing a choice saves."""
        signs, broken, gain = self._signs, self._broken, 0
        for condition, bits in self._places[choice]:
            missing = signs[condition] ^ broken[condition]
            gain += (missing == 0) - (missing == bits)
        return gain

    def _change(self, choice: int) -> None:
        self.changed ^= {choice}
        for condition, bits in self._places[choice]:
            self._signs[condition] ^= bits

    def _pass_on(self, condition: int, visited: set[int]) -> bool:
        """Mend a condition though that breaks another, which is mended in the same way."""
        for choice in self._choices[condition]:
            before = self._broken_near(choice)
            self._change(choice)
            after = self._broken_near(choice)
            if len(after) < len(before):
                return True
            broken = [other for other in after if other not in before]
            if len(after) == len(before) and len(broken) == 1 and len(visited) < _VISITED:
                (other,) = broken
                if other not in visited:
                    visited.add(other)
                    if self._pass_on(other, visited):
                        return True
            self._change(choice)
        return False

    def _mend_greedily(self, condition: int, _: set[int]) -> bool:
        """Mend a condition though that breaks others, and then as many of those as can be.

        The part of the changes that helps most is kept.
        """
        for first in self._choices[condition]:
            choice: int | None = first
            changed: dict[int, None] = {}
            gain = best = kept = 0
            broken: dict[int, None] = {}
            for steps_left in range(_STEPS, 0, -1):
                if choice is None or gain < -steps_left:  # There is nothing to mend, or too much.
                    break
                gain += self._gain(choice)
                self._change(choice)
                changed[choice] = None
                if gain > best:
                    best, kept = gain, len(changed)
                for other, _bits in self._places[choice]:
                    if self._is_broken(other):
                        broken[other] = None
                    else:
                        broken.pop(other, None)
                choice = self._best_near(broken, changed)
            for choice in list(changed)[kept:]:
                self._change(choice)
            if kept:
                return True
        return False

    def _best_near(self, broken: dict[int, None], changed: Container[int]) -> int | None:
        """The choice that helps most in what was last broken, of those not changed before."""
        while broken:
            condition, _ = broken.popitem()
            near = [
                choice
                for choice in self._choices[condition]
                if choice not in changed and len(self._places[choice]) <= _MOST_PLACES
            ]
            if near:
                return max(near, key=self._gain)
        return None


class Polarity:
    """The signs with which a function computes its values.

    A choice has the number of the node whose sign it is.
    """

    def __init__(self, graph: Graph, outputs: Sequence[Ref]) -> None:
        self.conditions = Conditions()
        # The choices that the sign of a node depends on, where it depends on any.
        self.choices: dict[int, tuple[int, ...]] = {}
        for node in graph.reached_varying(outputs):
            if operands := graph.operands[node]:
                kind, label = graph.kinds[node], graph.labels[node]
                if kind is PRODUCT:
                    first, second = [self.choices.get(ref >> 1, ()) for ref in operands]
                    # A choice that changes both factors changes nothing.
                    both = set(first).intersection(second) if first and second else ()
                    changing = tuple([i for i in first + second if i not in both])
                elif kind is SUM or label in ("sin", "cos"):
                    changing = (node,)
                    self._require([graph.one] if label in EVEN else operands, changing)
                elif label == "sqrt":
                    changing = ()
                    self._require(operands)
                else:
                    changing = self.choices.get(operands[0] >> 1, ())
                if changing:
                    self.choices[node] = changing
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
        """Nodes computed with the opposite sign, those with signs from others included."""
        changed = self.conditions.changed
        return {
            node
            for node, choices in self.choices.items()
            if sum([choice in changed for choice in choices]) % 2 == 1
        }

    def _require(self, refs: Sequence[Ref], choice: tuple[int, ...] = ()) -> None:
        """One of some values must come with a plus, all of them changed by a choice of its own."""
        choices = self.choices
        self.conditions.add(
            [ref & 1 for ref in refs], [choice + choices.get(ref >> 1, ()) for ref in refs]
        )
