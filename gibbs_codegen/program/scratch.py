"""Linear-scan allocation of scratch slots for the values that sections hand on.

    section 0:  t1 = x + y              spills t1 to slot 0
    section 1:  t2 = t1*t1              reloads t1, spills t2 to slot 0
    section 2:  t3 = t2 + x             reloads t2, spills t3 to slot 0
    section 3:  out[0] = t3             reloads t3

A slot serves again once its value is no longer used. Rows of loops take slots side by side, and a
loop's results overwrite, iteration by iteration, the operands that they replace.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

from gibbs_codegen.program.live_ranges import LiveRanges
from gibbs_codegen.program.rows import SlotTuples, insert_copies
from gibbs_codegen.program.steps import (
    Item,
    Loop,
    Step,
    defined_names,
    split_into_sections,
    used_names,
)


@dataclass(frozen=True)
class Section:
    """Consecutive steps, or a loop, with the slots that it reloads at its start, and spills to.

    For the row of a loop it is the slot of the first iteration; the others follow.
    """

    code: tuple[Step, ...] | Loop
    reloads: dict[str, int]
    spills: dict[str, int]


@dataclass(frozen=True, eq=False)
class Allocation:
    """Sections in order, how many slots they share, and the names whose slots hold minus them."""

    sections: tuple[Section, ...]
    slots: int
    negated: frozenset[str]

    def sign(self, name: str) -> str:
        """Sign, "-" or "", between a name that is not the row of a loop and what its slot holds."""
        return "-" if name in self.negated else ""


def allocate_scratch(items: Sequence[Item], signs: Mapping[str, int], limit: int) -> Allocation:
    """Split a schedule into sections, and give slots to the values that they hand on.

    The rows of loops hold the names times their `signs`, +1 or −1; without loops these may be
    empty. A section has at most `limit` memory references.
    """
    tuples = SlotTuples()
    placed, copies = insert_copies(items, tuples)
    negated = {name for name, sign in signs.items() if sign < 0}
    negated |= {copy for copy, name in copies.items() if name in negated}
    sections = split_into_sections(placed, limit)
    live = LiveRanges(sections)
    tuples.keep(live.first_definition)
    for name in live.slotted:
        tuples.add(name)
    for loop in placed:
        if isinstance(loop, Loop):
            for result in loop.results.values():
                any(
                    tuples.coalesce(operand[0], result[0], 0, live.can_share)
                    for operand in loop.operands.values()
                )
    slots = _linear_scan(tuples, live)
    return Allocation(
        tuple(_section(i, section, slots, live) for i, section in enumerate(sections)),
        1 + max(slots.values(), default=-1),
        frozenset(negated),
    )


def _linear_scan(tuples: SlotTuples, live: LiveRanges) -> dict[str, int]:
    """Slots of all names: tuples in the order of their live ranges, each as low as it can be."""
    slots: dict[str, int] = {}
    intervals = []
    for members in tuples.members.values():
        names = list(chain(*members.values()))
        start = min(live.first_definition[name] for name in names)
        intervals.append((start, max(live.last_use[name] for name in names), members))
    # Slots that are free, from the first to before the second, and those that are taken, with the
    # section of their last use.
    free = [(0, sys.maxsize)]
    taken: list[tuple[int, int, int]] = []
    present = -1
    for start, end, members in sorted(intervals, key=lambda interval: interval[:2]):
        lowest, size = min(members), max(members) - min(members) + 1
        if start > present:  # A straight section reloads all before it spills.
            present, kept = start, start - live.is_loop(start)
            free = _joined([*free, *(slot[:2] for slot in taken if slot[2] <= kept)])
            taken = [slot for slot in taken if slot[2] > kept]
        place = next(i for i, (base, stop) in enumerate(free) if stop - base >= size)
        base, stop = free[place]
        free[place] = (base + size, stop)
        taken.append((base, base + size, end))
        for offset, names in members.items():
            slots.update(dict.fromkeys(names, base + offset - lowest))
    return slots


def _joined(ranges: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Ranges of slots in order, those that touch as one."""
    joined: list[tuple[int, int]] = []
    for first, stop in sorted(ranges):
        if joined and joined[-1][1] == first:
            joined[-1] = (joined[-1][0], stop)
        elif first < stop:
            joined.append((first, stop))
    return joined


def _section(
    number: int, items: Sequence[Item], slots: Mapping[str, int], live: LiveRanges
) -> Section:
    """Section `number`, from 0, of steps or a loop, with the slots of all names that have one."""
    if items and isinstance(items[0], Loop):
        loop = items[0]
        reloads = {name: slots[name] for name in loop.invariants if name in slots}
        reloads |= {name: slots[row[0]] for name, row in loop.operands.items()}
        return Section(loop, reloads, {name: slots[row[0]] for name, row in loop.results.items()})
    steps = tuple(item for item in items if not isinstance(item, Loop))
    used = dict.fromkeys(name for step in steps for name in used_names(step))
    defined = [name for step in steps for name in defined_names(step)]
    return Section(
        steps,
        {name: slots[name] for name in used if name in slots and name not in defined},
        {name: slots[name] for name in defined if live.last_use[name] > number},
    )
