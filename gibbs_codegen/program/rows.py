"""Rows: names that a loop reads or writes one an iteration, and that must lie side by side.

    for i in 0 … 7:  u[i] = c*x[i]          x: x0 x1 … x7
    for i in 0 … 7:  w[i] = c*z[i]          z: x1 … x7 p

Slots that keep their distances form a tuple. The first row makes one of `x0` to `x7`, and the
second extends it, since both read the same `x1`. But `p` is an input and has no slot, so it is
copied before the loop, and the copy lies after `x7`. A loop that would need many copies, or whose
rows cannot lie side by side at all, is left unrolled.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import replace

from gibbs_codegen.program.nodes import Name, Statement
from gibbs_codegen.program.steps import Item, Loop, defined_names

# A loop may have one operand in so many copied.
_OPERANDS_PER_COPY = 8


class SlotTuples:
    """Tuples of slots: names with offsets, at fixed distances from each other.

    `members` has the names at each offset of each tuple; those at one offset share a slot.
    """

    def __init__(self) -> None:
        self.members: dict[int, dict[int, list[str]]] = {}
        self._places: dict[str, tuple[int, int]] = {}

    def add(self, name: str) -> None:
        """Put a name into a tuple of its own, unless it is in one."""
        if name not in self._places:
            number = len(self._places)
            self._places[name] = (number, 0)
            self.members[number] = {0: [name]}

    def keep(self, names: Container[str]) -> None:
        """Forget all names but some."""
        for number, members in self.members.items():
            kept = {offset: [n for n in there if n in names] for offset, there in members.items()}
            self.members[number] = {offset: there for offset, there in kept.items() if there}
        self.members = {number: members for number, members in self.members.items() if members}

    def coalesce(
        self, first: str, second: str, distance: int, can_share: Callable[[str, str], bool]
    ) -> bool:
        """Join the tuples of two names, unless names would share a slot that cannot.

        `distance` is in slots from the first to the second; the result tells whether it holds now.
        """
        (number, offset), (other, other_offset) = self._places[first], self._places[second]
        shift = offset + distance - other_offset
        kept, moved = self.members[number], self.members[other]
        if number == other:
            return shift == 0
        for place, names in moved.items():
            there = kept.get(place + shift, [])
            if not all(can_share(a, b) for a in there for b in names):
                return False
        for place, names in moved.items():
            kept.setdefault(place + shift, []).extend(names)
            self._places.update(dict.fromkeys(names, (number, place + shift)))
        del self.members[other]
        return True


def insert_copies(items: Sequence[Item], tuples: SlotTuples) -> tuple[list[Item], dict[str, str]]:
    """Put copies before the loops whose operands do not lie side by side, or unroll the loops.

    `tuples` takes the rows of all loops that are kept; the second result says what each copy is a
    copy of.
    """
    defined = {name for item in items for name in defined_names(item)}
    placed: list[Item] = []
    copies: dict[str, str] = {}
    for item in items:
        if not isinstance(item, Loop):
            placed.append(item)
            continue
        here: dict[str, str] = {}
        operands: dict[str, tuple[str, ...]] = {}
        for i, (name, row) in enumerate(item.operands.items()):
            own = {name for name in row if name in defined}
            operands[name] = _place_row(row, f"{row[-1]}_{len(copies)}_{i}_", own, here, tuples)
        fits = all(operands.values())
        if not fits or len(here) * _OPERANDS_PER_COPY > item.count * len(operands):
            placed += item.unrolled
            continue
        for row in item.results.values():
            _place_row(row, "", set(row), here, tuples)
        copies |= here
        placed += [Statement(copy, Name(name), item.group) for copy, name in here.items()]
        placed.append(replace(item, operands=operands))
    return placed, copies


def _place_row(
    row: tuple[str, ...], prefix: str, defined: set[str], copies: dict[str, str], tuples: SlotTuples
) -> tuple[str, ...]:
    """Put a row, one name an iteration, into one tuple, with copies of names that cannot lie in it.

    `defined` are the names of the row that steps define, which therefore can have slots. Empty if
    the place of a copy is not free.
    """
    found: list[str] = []
    for i, name in enumerate(reversed(row)):
        copy = f"{prefix}{i}"
        for candidate in (name, copy) if name in defined and name not in found else (copy,):
            tuples.add(candidate)
            anchor = found[0] if found else candidate
            if tuples.coalesce(anchor, candidate, -i, _never_share):
                found.append(candidate)
                break
        else:
            return ()
        if found[-1] == copy:
            copies[copy] = name
    return tuple(reversed(found))


def _never_share(_first: str, _second: str) -> bool:
    return False
