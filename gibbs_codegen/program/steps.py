"""A straight-line function as a row of steps, split into pieces that a vectorising compiler takes.

A step computes a name or stores an entry; each entry is stored as soon as its value is known, so
that few values are alive at once. Compilers give up on loops with too many memory references, so a
long row is split. Among the steps may be loops, each a piece by itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from gibbs_codegen.program.nodes import Node, Number, Output, Statement, names_in


@dataclass(frozen=True)
class Store:
    """Entry `place` of output `output` becomes `value`."""

    output: int
    place: int
    value: Node


Step = Statement | Store
AnyStep = TypeVar("AnyStep", bound=Step)


@dataclass(frozen=True)
class Loop:
    """`body` done `count` times, which is the same as `unrolled`.

    Its names are those of one of the blocks of steps: `operands` and `results` have, for each that
    is not the same in every block, the row of its names, one a block; results are only those that
    are read elsewhere. The stores of the first block go to `places`, which move on by `strides`
    from block to block.
    """

    count: int
    body: tuple[Step, ...]
    operands: Mapping[str, tuple[str, ...]]
    results: Mapping[str, tuple[str, ...]]
    places: tuple[int, ...]
    strides: tuple[int, ...]
    unrolled: tuple[Step, ...]

    @property
    def group(self) -> str:
        """Words of the group that all its statements are of, or "" where they are of several."""
        groups = {step.group for step in self.unrolled if isinstance(step, Statement)}
        return groups.pop() if len(groups) == 1 else ""

    @property
    def invariants(self) -> list[str]:
        """Names that every block reads."""
        own = {*self.operands, *(s.name for s in self.body if isinstance(s, Statement))}
        read = [name for step in self.body for name in names_in(step.value)]
        return [name for name in dict.fromkeys(read) if name not in own]


Item = Step | Loop


def used_names(item: Item) -> list[str]:
    """Names that a step or a loop reads and, if it is a loop, does not make."""
    if not isinstance(item, Loop):
        return names_in(item.value)
    return [*item.invariants, *(name for row in item.operands.values() for name in row)]


def defined_names(item: Item) -> list[str]:
    """Names that a step or a loop makes for others."""
    if isinstance(item, Loop):
        return [name for row in item.results.values() for name in row]
    return [item.name] if isinstance(item, Statement) else []


def schedule_stores(
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


def headed(steps: Iterable[AnyStep]) -> Iterator[tuple[str, AnyStep]]:
    """Steps in order, each with the words of its group where a group begins, and "" elsewhere.

    A store belongs to the statement before it.
    """
    last = ""
    for step in steps:
        group = step.group if isinstance(step, Statement) else last
        yield (group if group != last else ""), step
        last = group


def split_into_sections(items: Sequence[Item], limit: int) -> list[tuple[Item, ...]]:
    """Cut steps into pieces in a row that refer to memory at most `limit` times each.

    Each goes on until the next step would be too much; a step that is too much by itself is a piece
    by itself, and so is a loop. Whatever a piece reads that no step defines counts as a reference,
    whether it is an input or a constant.
    """
    defined = {name: i for i, item in enumerate(items) for name in defined_names(item)}
    last_use: dict[str, int] = {}
    for i, item in enumerate(items):
        last_use.update(dict.fromkeys(used_names(item), i))
    starts = [0]
    read: set[str] = set()
    alive = stores = 0
    for i, item in enumerate(items):
        names = set(used_names(item))
        outside = {name for name in names if defined.get(name, -1) < starts[-1]}
        ended = sum(last_use[name] == i for name in names - outside)
        begun = sum(last_use.get(name, -1) > i for name in defined_names(item))
        stored = int(isinstance(item, Store))
        full = len(read | outside) + alive - ended + begun + stores + stored > limit
        if i > starts[-1] and (full or isinstance(item, Loop) or isinstance(items[i - 1], Loop)):
            starts.append(i)
            read, alive, stores = names, begun, stored
        else:
            read |= outside
            alive += begun - ended
            stores += stored
    ends = [*starts[1:], len(items)]
    return [tuple(items[start:end]) for start, end in zip(starts, ends, strict=True)]
