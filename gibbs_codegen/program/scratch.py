"""Scratch slots for the values that sections hand on, by linear scan, and how much stack is taken.

    section 0:  t1 = x + y              spills t1 to slot 0
    section 1:  t2 = t1*t1              reloads t1, spills t2 to slot 0
    section 2:  t3 = t2 + x             reloads t2, spills t3 to slot 0
    section 3:  out[0] = t3             reloads t3

A slot serves again once its value is no longer used. Rows of loops take slots side by side, and a
loop's results overwrite, iteration by iteration, the operands that they replace.

The live range of a name is that from the section of its first definition to that of its last use.

    section 0:  t1 = x + y
    section 1:  t2 = t1*x
    section 2:  t3 = t2 + t1

Here `t1` is live from section 0 to 2 and `t2` from 1 to 2, so they need a slot each. A straight
section reloads all it needs before it spills, so `t3` may take the slot of either. In a loop, the
result of an iteration may take the slot of a name that no other iteration uses.

The stack that a function takes is estimated from above, by the values that are live at once.

    t1 = x + y
    t2 = t1*x
    out = [t2, t1]

has two values live at once: `x` and `y`, then `t1` and `x`, then `t2` and `t1`. The estimate is
twice two doubles and the frame: 160 bytes.

It is an estimate, since only the compiler knows: one that reorders keeps more values at a time, and
one that vectorises spills whole registers. Twice the values that are live when every output is
kept to the end, and twice the arrays of angles, sines and cosines, has been enough for each of 256
functions, of 16 robots up to 30 links and 40 rotors, as compiled by gcc 12 with -O1, -O2 and -O3
for AVX-512, by clang 14 with -O2, and for Cortex-M by gcc 12 with -O2 and -Os. It was 1.04 times
the stack taken at the least, 2.4 times as a rule, and far more where little had to be kept.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

from gibbs_codegen.program import steps
from gibbs_codegen.program.loops import SlotTuples, insert_copies
from gibbs_codegen.program.nodes import names_in
from gibbs_codegen.program.trigonometry import GatheredFunction

# Stands for every iteration of a loop.
_ALL_ROUNDS = -1


class LiveRanges:
    """The section that defines each name, and the last that uses it.

    `first_definition` and `last_use` have the names that a step or a loop defines, not the inputs;
    a name that nothing uses ends where it is defined.
    """

    def __init__(self, sections: Sequence[Sequence[steps.Item]]) -> None:
        self.first_definition: dict[str, int] = {}
        self.last_use: dict[str, int] = {}
        # For each loop, by section: the iterations that use a name, and the one that defines it.
        self._using: dict[int, dict[str, set[int]]] = {}
        self._defining: dict[int, dict[str, int]] = {}
        for i, section in enumerate(sections):
            for item in section:
                defined = dict.fromkeys(steps.defined_names(item), i)
                self.first_definition.update(defined)
                self.last_use.update(defined)
                self.last_use.update(
                    (name, i) for name in steps.used_names(item) if name in self.first_definition
                )
                if isinstance(item, steps.Loop):
                    using: dict[str, set[int]] = {name: {_ALL_ROUNDS} for name in item.invariants}
                    for row in item.operands.values():
                        for iteration, name in enumerate(row):
                            using.setdefault(name, set()).add(iteration)
                    self._using[i] = using
                    self._defining[i] = {
                        name: iteration
                        for row in item.results.values()
                        for iteration, name in enumerate(row)
                    }

    def is_loop(self, section: int) -> bool:
        """True if a section is a loop, not straight-line steps."""
        return section in self._defining

    def can_share(self, first: str, second: str) -> bool:
        """True if two names can have one slot: one is no longer used when the other is defined."""
        if self.first_definition[first] > self.first_definition[second]:
            first, second = second, first
        start, end = self.first_definition[second], self.last_use[first]
        if end != start or self.first_definition[first] == start:
            return end < start
        # A straight section reloads all before it spills; a loop, all of one iteration.
        return not self.is_loop(start) or (
            self._using[start][first] == {self._defining[start][second]}
        )


@dataclass(frozen=True)
class Section:
    """Consecutive steps, or a loop, with the slots that it reloads at its start, and spills to.

    For the row of a loop it is the slot of the first iteration; the others follow.
    """

    code: tuple[steps.Step, ...] | steps.Loop
    reloads: dict[str, int]
    spills: dict[str, int]


@dataclass(frozen=True, eq=False)
class SlotAllocation:
    """Sections in order, how many slots they share, and the names whose slots hold minus them."""

    sections: tuple[Section, ...]
    slots: int
    negated: frozenset[str]

    def sign(self, name: str) -> str:
        """Sign, "-" or "", between a name that is not the row of a loop and what its slot holds."""
        return "-" if name in self.negated else ""


def allocate_scratch(
    items: Sequence[steps.Item], signs: Mapping[str, int], limit: int
) -> SlotAllocation:
    """Split a schedule into sections, and give slots to the values that they hand on.

    The rows of loops hold the names times their `signs`, +1 or −1; without loops these may be
    empty. A section has at most `limit` memory references.
    """
    tuples = SlotTuples()
    placed, copies = insert_copies(items, tuples)
    negated = {name for name, sign in signs.items() if sign < 0}
    negated |= {copy for copy, name in copies.items() if name in negated}
    sections = steps.split_into_sections(placed, limit)
    live = LiveRanges(sections)
    tuples.keep(live.first_definition)
    for name, i in live.first_definition.items():
        # A later section uses it, or it is a result of a loop.
        if live.last_use[name] > i or live.is_loop(i):
            tuples.add(name)
    for loop in placed:
        if isinstance(loop, steps.Loop):
            for result in loop.results.values():
                any(
                    tuples.coalesce(operand[0], result[0], 0, live.can_share)
                    for operand in loop.operands.values()
                )
    slots = _linear_scan(tuples, live)
    allocated = []
    for number, section in enumerate(sections):
        if section and isinstance(section[0], steps.Loop):
            loop = section[0]
            reloads = {name: slots[name] for name in loop.invariants if name in slots}
            reloads |= {name: slots[row[0]] for name, row in loop.operands.items()}
            allocated.append(
                Section(loop, reloads, {name: slots[row[0]] for name, row in loop.results.items()})
            )
            continue
        straight = tuple(item for item in section if not isinstance(item, steps.Loop))
        used = dict.fromkeys(name for step in straight for name in steps.used_names(step))
        defined = dict.fromkeys(name for step in straight for name in steps.defined_names(step))
        allocated.append(
            Section(
                straight,
                {name: slots[name] for name in used if name in slots and name not in defined},
                {name: slots[name] for name in defined if live.last_use[name] > number},
            )
        )
    return SlotAllocation(tuple(allocated), 1 + max(slots.values(), default=-1), frozenset(negated))


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
    occupied: list[tuple[int, int, int]] = []
    present = -1
    for start, end, members in sorted(intervals, key=lambda interval: interval[:2]):
        lowest, size = min(members), max(members) - min(members) + 1
        if start > present:  # A straight section reloads all before it spills.
            present, kept = start, start - live.is_loop(start)
            ranges = [*free, *(slot[:2] for slot in occupied if slot[2] <= kept)]
            # In order, those that touch as one.
            joined: list[tuple[int, int]] = []
            for first, stop in sorted(ranges):
                if joined and joined[-1][1] == first:
                    joined[-1] = (joined[-1][0], stop)
                elif first < stop:
                    joined.append((first, stop))
            free = joined
            occupied = [slot for slot in occupied if slot[2] > kept]
        place = next(i for i, (base, stop) in enumerate(free) if stop - base >= size)
        base, stop = free[place]
        free[place] = (base + size, stop)
        occupied.append((base, base + size, end))
        for offset, names in members.items():
            slots.update(dict.fromkeys(names, base + offset - lowest))
    return slots


_DOUBLE = 8
_SPARE = 2
# Return address, saved registers, alignment, and the helper that calls the library's functions.
_FRAME = 128


def stack_bytes(function: GatheredFunction) -> int:
    """Stack that a call for one state of doubles takes, compiled with optimisation (bytes).

    Half of it serves for floats. What the library's sine and cosine take comes on top.
    """
    last_use: dict[str, int] = {}
    for i, statement in enumerate(function.statements):
        last_use.update(dict.fromkeys(names_in(statement.value), i))
    for output in function.outputs:
        for entry in output.entries:
            last_use.update(dict.fromkeys(names_in(entry), len(function.statements)))
    names = set(last_use)
    live = most = len(names - {s.name for s in function.statements})
    ends = [0] * (len(function.statements) + 1)
    for last in last_use.values():
        ends[last] += 1
    for i, _ in enumerate(function.statements):
        live += 1 - ends[i]
        most = max(most, live)
    return _FRAME + _SPARE * _DOUBLE * (most + 3 * len(function.angles))
