"""A straight-line function as a row of steps, cut into pieces that a vectorising compiler takes.

A step computes a name or stores an entry; each entry is stored as soon as its value is known, so
that few values are alive at once. Compilers give up on loops with too many memory references, so a
long row is cut; what a later piece needs of an earlier one is held in numbered slots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gibbs_codegen.program import Node, Number, Output, Statement, names_in


@dataclass(frozen=True)
class Store:
    """Entry `place` of output `output` becomes `value`."""

    output: int
    place: int
    value: Node


Step = Statement | Store


@dataclass(frozen=True)
class Piece:
    """Consecutive steps, with the slots of the names that they take over and hand on."""

    steps: tuple[Step, ...]
    taken: dict[str, int]
    held: dict[str, int]


def interleaved(
    statements: Sequence[Statement], outputs: Sequence[Output], zeros_stored: Sequence[bool]
) -> list[Step]:
    """Statements in order, each followed by the stores of the entries that it completes.

    Zero entries of an output are left out unless `zeros_stored` says so for it.
    """
    places = {statement.name: i for i, statement in enumerate(statements)}
    ready: dict[int, list[Store]] = {}
    for number, output in enumerate(outputs):
        for entry, value in enumerate(output.entries):
            if zeros_stored[number] or value != Number(0.0):
                last = max((places.get(name, -1) for name in names_in(value)), default=-1)
                ready.setdefault(last, []).append(Store(number, entry, value))
    steps: list[Step] = list(ready.get(-1, []))
    for i, statement in enumerate(statements):
        steps.append(statement)
        steps.extend(ready.get(i, []))
    return steps


def cut(steps: Sequence[Step], limit: int) -> list[Piece]:
    """Cut steps into pieces in a row that refer to memory at most `limit` times each.

    Each goes on until the next step would be too much; a step that is too much by itself is a piece
    by itself. Whatever a piece reads that no step defines counts as a reference, whether it is an
    input or a constant.
    """
    defined = {step.name: i for i, step in enumerate(steps) if isinstance(step, Statement)}
    last_use: dict[str, int] = {}
    for i, step in enumerate(steps):
        last_use.update(dict.fromkeys(names_in(step.value), i))
    starts = [0]
    read: set[str] = set()
    alive = stores = 0
    for i, step in enumerate(steps):
        names = set(names_in(step.value))
        outside = {name for name in names if defined.get(name, -1) < starts[-1]}
        ended = sum(last_use[name] == i for name in names - outside)
        begun = int(isinstance(step, Statement) and last_use.get(step.name, -1) > i)
        stored = int(isinstance(step, Store))
        if len(read | outside) + alive - ended + begun + stores + stored > limit and i > starts[-1]:
            starts.append(i)
            read, alive, stores = names, begun, stored
        else:
            read |= outside
            alive += begun - ended
            stores += stored
    return _with_slots(steps, starts, last_use)


def _with_slots(
    steps: Sequence[Step], starts: Sequence[int], last_use: dict[str, int]
) -> list[Piece]:
    slots: dict[str, int] = {}
    free: list[int] = []
    pieces = []
    for start, stop in zip(starts, [*starts[1:], len(steps)], strict=True):
        part = steps[start:stop]
        read = dict.fromkeys(name for step in part for name in names_in(step.value))
        taken = {name: slots[name] for name in read if name in slots}
        for name in [name for name in slots if last_use[name] < stop]:
            free.append(slots.pop(name))
        held = {}
        for step in part:
            if isinstance(step, Statement) and last_use.get(step.name, -1) >= stop:
                used = len(slots) + len(free)
                held[step.name] = slots[step.name] = free.pop(0) if free else used
        pieces.append(Piece(tuple(part), taken, held))
    return pieces
