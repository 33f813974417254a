"""Where the values stand that pieces of a function hand on: numbered slots of one array.

Loops read and write rows, whose names have to stand side by side. A name may be in several rows, so
names are gathered in groups, each name with its offset; what does not fit is copied before the
loop, and a loop that would need many copies goes straight. A slot serves again when its value is
no longer read, and a row is made where the one lies that it replaces, block by block.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

from gibbs_codegen.program.nodes import Name, Statement
from gibbs_codegen.program.steps import (
    Item,
    Loop,
    Step,
    defined_names,
    split_into_sections,
    used_names,
)

# A loop may have one operand in so many copied.
_OPERANDS_PER_COPY = 8


@dataclass(frozen=True)
class Section:
    """Consecutive steps, or a loop, with the slots of the names that it takes over and hands on.

    For a loop's rows they are the slots of the first block.
    """

    code: tuple[Step, ...] | Loop
    reloads: dict[str, int]
    spills: dict[str, int]


@dataclass(frozen=True, eq=False)
class Allocation:
    """Pieces in a row, how many slots they share, and the names that are held negated."""

    sections: tuple[Section, ...]
    slots: int
    negated: frozenset[str]

    def sign(self, name: str) -> str:
        """Sign between a name that is no row's and what is held of it."""
        return "-" if name in self.negated else ""


def allocate_scratch(items: Sequence[Item], signs: Mapping[str, int], limit: int) -> Allocation:
    """Cut items into pieces of at most `limit` references to memory, and give values slots.

    `signs` are those of the names in the rows of loops.
    """
    groups = _Groups()
    fitted, copies = _fitted(items, groups)
    negated = {name for name, sign in signs.items() if sign < 0}
    negated |= {copy for copy, name in copies.items() if name in negated}
    pieces = split_into_sections(fitted, limit)
    lives = _Lives(pieces)
    groups.keep(lives.births)
    for name in lives.crossing:
        groups.add(name)
    for piece in pieces:
        if piece and isinstance(piece[0], Loop):
            for result in piece[0].results.values():
                any(
                    groups.join(operand[0], result[0], 0, lives.can_share)
                    for operand in piece[0].operands.values()
                )
    slots = _slots(groups, lives)
    return Allocation(
        tuple(
            Section(_part(piece), _taken(piece, slots), _held(i, piece, slots, lives))
            for i, piece in enumerate(pieces)
        ),
        1 + max(slots.values(), default=-1),
        frozenset(negated),
    )


class _Groups:
    """Names with offsets in groups: what is in one group keeps its distances."""

    def __init__(self) -> None:
        self.members: dict[int, dict[int, list[str]]] = {}
        self._place: dict[str, tuple[int, int]] = {}

    def add(self, name: str) -> None:
        """Put a name into a group of its own, unless it is in one."""
        if name not in self._place:
            group = len(self._place)
            self._place[name] = (group, 0)
            self.members[group] = {0: [name]}

    def keep(self, names: Container[str]) -> None:
        """Forget all names but these."""
        for group, members in self.members.items():
            kept = {place: [n for n in there if n in names] for place, there in members.items()}
            self.members[group] = {place: there for place, there in kept.items() if there}
        self.members = {group: members for group, members in self.members.items() if members}

    def join(
        self, first: str, second: str, distance: int, can_share: Callable[[str, str], bool]
    ) -> bool:
        """Put `second` `distance` after `first`, with all that is in its group, if that can be.

        `can_share` says which two names can have one place.
        """
        (group, offset), (other, other_offset) = self._place[first], self._place[second]
        shift = offset + distance - other_offset
        kept, moved = self.members[group], self.members[other]
        if group == other:
            return shift == 0
        for place, names in moved.items():
            there = kept.get(place + shift, [])
            if not all(can_share(a, b) for a in there for b in names):
                return False
        for place, names in moved.items():
            kept.setdefault(place + shift, []).extend(names)
            self._place.update(dict.fromkeys(names, (group, place + shift)))
        del self.members[other]
        return True


def _fitted(items: Sequence[Item], groups: _Groups) -> tuple[list[Item], dict[str, str]]:
    """Items with the copies that rows need, which are returned too, by name.

    Where rows cannot lie as they should, the loop's steps are there instead.
    """
    made = {name for item in items for name in defined_names(item)}
    fitted: list[Item] = []
    copies: dict[str, str] = {}
    for item in items:
        if not isinstance(item, Loop):
            fitted.append(item)
            continue
        here: dict[str, str] = {}
        operands: dict[str, tuple[str, ...]] = {}
        for i, (name, row) in enumerate(item.operands.items()):
            own = {name for name in row if name in made}
            operands[name] = _fitted_row(row, f"{row[-1]}_{len(copies)}_{i}_", own, here, groups)
        fits = all(operands.values())
        if not fits or len(here) * _OPERANDS_PER_COPY > item.count * len(operands):
            fitted += item.unrolled
            continue
        for row in item.results.values():
            _fitted_row(row, "", set(row), here, groups)
        copies |= here
        fitted += [Statement(copy, Name(name), item.group) for copy, name in here.items()]
        fitted.append(replace(item, operands=operands))
    return fitted, copies


def _fitted_row(
    row: tuple[str, ...], prefix: str, made: set[str], copies: dict[str, str], groups: _Groups
) -> tuple[str, ...]:
    """The row with copies, which are added to `copies`, of those names that cannot lie in it.

    It is empty if the place of a copy is taken.
    """
    found: list[str] = []
    for i, name in enumerate(reversed(row)):
        copy = f"{prefix}{i}"
        for lain in (name, copy) if name in made and name not in found else (copy,):
            groups.add(lain)
            if groups.join(found[0] if found else lain, lain, -i, _never):
                found.append(lain)
                break
        else:
            return ()
        if found[-1] == copy:
            copies[copy] = name
    return tuple(reversed(found))


def _never(_first: str, _second: str) -> bool:
    return False


class _Lives:
    """In which piece each name is made and in which it is read last."""

    def __init__(self, pieces: Sequence[Sequence[Item]]) -> None:
        self.births: dict[str, int] = {}
        self.deaths: dict[str, int] = {}
        # Of loops: the blocks that read a name, −1 for all of them, and the block that makes it.
        self._readers: dict[int, dict[str, set[int]]] = {}
        self._makers: dict[int, dict[str, int]] = {}
        for i, piece in enumerate(pieces):
            for item in piece:
                self.births.update(dict.fromkeys(defined_names(item), i))
                self.deaths.update(dict.fromkeys(defined_names(item), i))
                self.deaths.update((n, i) for n in used_names(item) if n in self.births)
                if isinstance(item, Loop):
                    self._add_loop(i, item)

    def _add_loop(self, i: int, loop: Loop) -> None:
        readers: dict[str, set[int]] = {name: {-1} for name in loop.invariants}
        for row in loop.operands.values():
            for block, name in enumerate(row):
                readers.setdefault(name, set()).add(block)
        self._readers[i] = readers
        self._makers[i] = {
            name: block for row in loop.results.values() for block, name in enumerate(row)
        }

    @property
    def crossing(self) -> list[str]:
        """Names that a later piece reads, or that stand in the row of a loop."""
        return [n for n, i in self.births.items() if self.deaths[n] > i or i in self._makers]

    def in_loop(self, piece: int) -> bool:
        """Whether a piece is a loop."""
        return piece in self._makers

    def can_share(self, first: str, second: str) -> bool:
        """Whether one name is no longer read when the other is made."""
        if self.births[first] > self.births[second]:
            first, second = second, first
        birth, death = self.births[second], self.deaths[first]
        if death != birth or self.births[first] == birth:
            return death < birth
        # A straight piece reads all before it writes; a loop, all of a block.
        return not self.in_loop(birth) or (
            self._readers[birth][first] == {self._makers[birth][second]}
        )


def _slots(groups: _Groups, lives: _Lives) -> dict[str, int]:
    """Slots of all names, groups first that come first, each as low as it can be."""
    slots: dict[str, int] = {}
    placed: list[tuple[int, int, int]] = []
    spans = []
    for members in groups.members.values():
        names = list(chain(*members.values()))
        birth = min(lives.births[name] for name in names)
        spans.append((birth, max(lives.deaths[name] for name in names), members))
    for birth, death, members in sorted(spans, key=lambda span: span[:2]):
        lowest, size = min(members), max(members) - min(members) + 1
        # A straight piece reads all before it writes.
        placed = [p for p in placed if p[2] > birth or (p[2] == birth and lives.in_loop(birth))]
        start = 0
        for begin, end, _ in sorted(placed):
            if start + size <= begin:
                break
            start = max(start, end)
        placed.append((start, start + size, death))
        for offset, names in members.items():
            slots.update(dict.fromkeys(names, start + offset - lowest))
    return slots


def _part(piece: Sequence[Item]) -> tuple[Step, ...] | Loop:
    if piece and isinstance(piece[0], Loop):
        return piece[0]
    return tuple(item for item in piece if not isinstance(item, Loop))


def _taken(piece: Sequence[Item], slots: Mapping[str, int]) -> dict[str, int]:
    made = {name for item in piece for name in defined_names(item)}
    if piece and isinstance(piece[0], Loop):
        rows = {name: slots[row[0]] for name, row in piece[0].operands.items()}
        return {name: slots[name] for name in piece[0].invariants if name in slots} | rows
    read = dict.fromkeys(name for item in piece for name in used_names(item))
    return {name: slots[name] for name in read if name in slots and name not in made}


def _held(i: int, piece: Sequence[Item], slots: Mapping[str, int], lives: _Lives) -> dict[str, int]:
    if piece and isinstance(piece[0], Loop):
        return {name: slots[row[0]] for name, row in piece[0].results.items()}
    made = (name for item in piece for name in defined_names(item))
    return {name: slots[name] for name in made if lives.deaths[name] > i}
