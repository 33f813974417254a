"""The schedule of a function: statements and stores in order, split into sections.

    t1 = x + y
    t2 = t1*z
    out = [t2, t1]

becomes four steps, since each entry is stored as soon as its value is known: few values are then
live at once.

    t1 = x + y
    out[1] = t1
    t2 = t1*z
    out[0] = t2

Compilers do not vectorise loops with too many memory references, so a long schedule is split. With
at most four references a section, the second begins at `t2`: the first reads `x` and `y`, stores an
entry, and hands on `t1`. Among the steps may be loops, each a section of its own.
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
    """A loop of `count` iterations of `body` that does the same as the steps `unrolled`.

    The names in the body are those of one of the unrolled blocks. Of those that differ from block
    to block, `operands` maps each that is read, and `results` each that is read after the loop, to
    its row: the names it stands for, one an iteration. Iteration i of the n-th store in the body
    stores entry `places[n]` + i·`strides[n]`.
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
        """Names that every iteration reads."""
        internal = {*self.operands, *(s.name for s in self.body if isinstance(s, Statement))}
        read = [name for step in self.body for name in names_in(step.value)]
        return [name for name in dict.fromkeys(read) if name not in internal]


Item = Step | Loop


def used_names(item: Item) -> Sequence[str]:
    """Names that a step or a loop reads, as often as it does; a loop's own are not counted."""
    if not isinstance(item, Loop):
        return names_in(item.value)
    return [*item.invariants, *(name for row in item.operands.values() for name in row)]


def defined_names(item: Item) -> list[str]:
    """Names that a step or a loop defines for others; none for a store."""
    if isinstance(item, Loop):
        return [name for row in item.results.values() for name in row]
    return [item.name] if isinstance(item, Statement) else []


def schedule_stores(
    statements: Sequence[Statement], outputs: Sequence[Output], zeros_stored: Sequence[bool]
) -> list[Step]:
    """The statements in their order, and right after each the stores of the entries it completes.

    `zeros_stored` says of each output whether its zero entries are stored too.
    """
    places = {statement.name: i for i, statement in enumerate(statements)}
    ready: dict[int, list[Store]] = {}
    zero = Number(0.0)
    for number, output in enumerate(outputs):
        for entry, value in enumerate(output.entries):
            if zeros_stored[number] or value != zero:
                last = max((places.get(name, -1) for name in names_in(value)), default=-1)
                ready.setdefault(last, []).append(Store(number, entry, value))
    steps: list[Step] = list(ready.get(-1, []))
    for i, statement in enumerate(statements):
        steps.append(statement)
        steps.extend(ready.get(i, []))
    return steps


def headed(steps: Iterable[AnyStep]) -> Iterator[tuple[str, AnyStep]]:
    """Each step with the words of the group that begins with it, or "".

    A store belongs to the group of the statement before it.
    """
    last = ""
    for step in steps:
        group = step.group if isinstance(step, Statement) else last
        yield (group if group != last else ""), step
        last = group


def split_into_sections(items: Sequence[Item], limit: int) -> list[tuple[Item, ...]]:
    """Split a schedule into sections, each as long as the limit permits.

    The limit is of memory references: names read that no step in the section defines, inputs and
    constants too; names that a later section reads; entries stored. A step that exceeds it is a
    section of its own, and so is every loop. Without items there is a single empty section.
    """
    definitions = [defined_names(item) for item in items]
    uses = [set(used_names(item)) for item in items]
    defined = {name: i for i, names in enumerate(definitions) for name in names}
    last_use = {name: i for i, names in enumerate(uses) for name in names}
    starts = [0]
    read: set[str] = set()
    live = stores = 0
    for i, item in enumerate(items):
        names = uses[i]
        outside = {name for name in names if defined.get(name, -1) < starts[-1]}
        ended = sum(last_use[name] == i for name in names - outside)
        begun = sum(last_use.get(name, -1) > i for name in definitions[i])
        stored = int(isinstance(item, Store))
        full = len(read | outside) + live - ended + begun + stores + stored > limit
        if i > starts[-1] and (full or isinstance(item, Loop) or isinstance(items[i - 1], Loop)):
            starts.append(i)
            read, live, stores = names, begun, stored
        else:
            read |= outside
            live += begun - ended
            stores += stored
    ends = [*starts[1:], len(items)]
    return [tuple(items[start:end]) for start, end in zip(starts, ends, strict=True)]
