"""Runs in a row of steps: blocks one after the other that do the same with other names.

Blocks are alike if they differ in names, in the order of terms and factors, and in signs. In each
step a name is either made earlier in its block, or the same in all blocks, or another in each.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from gibbs_codegen.program.nodes import Name, Node, Number, Product, Statement, Sum, names_in
from gibbs_codegen.program.steps import Step, Store

# A run of fewer blocks, or of fewer steps in all, is not worth a loop.
_FEWEST_BLOCKS = 4
_FEWEST_STEPS = 40
_LONGEST_BLOCK = 48

Factor = str | float
Term = tuple[int, tuple[Factor, ...]]
Terms = tuple[Term, ...]


@dataclass(frozen=True)
class RepeatedBlocks:
    """Blocks of `length` steps from `start`, with the terms of each step in matching order."""

    start: int
    length: int
    blocks: tuple[tuple[Terms, ...], ...]

    @property
    def stop(self) -> int:
        """Where the steps after the run begin."""
        return self.start + self.length * len(self.blocks)


def is_profitable(count: int, length: int) -> bool:
    """Whether `count` blocks of `length` steps are worth a loop."""
    return count >= _FEWEST_BLOCKS and count * length >= _FEWEST_STEPS


def find_repeated_blocks(steps: Sequence[Step]) -> list[RepeatedBlocks]:
    """Runs that do not overlap, in order; those that cover most are taken first."""
    finder = _Finder(steps)
    queue = list(finder.repeats())
    heapq.heapify(queue)
    taken = [False] * len(steps)
    runs = []
    while queue:
        covered, length, start = heapq.heappop(queue)
        count = -covered // length
        free = [not any(taken[start + r * length : start + (r + 1) * length]) for r in range(count)]
        rest = [(start, count - 1)]
        if not all(free):
            rest = _stretches(free, start, length)
        elif run := finder.matched(start, length, count):
            runs.append(run)
            taken[run.start : run.stop] = [True] * (run.stop - run.start)
            rest = [(start, count - len(run.blocks))]
        for new_start, new_count in rest:
            if is_profitable(new_count, length):
                heapq.heappush(queue, (-new_count * length, length, new_start))
    return sorted(runs, key=lambda run: run.start)


def _stretches(free: Sequence[bool], start: int, length: int) -> list[tuple[int, int]]:
    """Starts and counts of the stretches of free blocks."""
    found = []
    for is_free, group in groupby(free):
        count = len(list(group))
        if is_free:
            found.append((start, count))
        start += count * length
    return found


class _Finder:
    """Steps and what matching needs of them."""

    def __init__(self, steps: Sequence[Step]) -> None:
        self._steps = steps
        self._terms = [_terms(step.value) for step in steps]
        self._made = {s.name: i for i, s in enumerate(steps) if isinstance(s, Statement)}
        self._names = [frozenset(names_in(step.value)) for step in steps]
        self._sources = [sorted(self._made.get(n, -1) for n in names) for names in self._names]

    def repeats(self) -> Iterator[tuple[int, int, int]]:
        """Stretches where shapes repeat: minus the steps covered, the block's length, the start."""
        numbers: dict[object, int] = {}
        shapes = map(_shape, self._steps, self._terms)
        ids = [numbers.setdefault(shape, len(numbers)) for shape in shapes]
        for length in range(1, _LONGEST_BLOCK + 1):
            start = 0
            for same, group in groupby(map(int.__eq__, ids, ids[length:])):
                size = len(list(group))
                if same:
                    for first in range(start, start + min(length, size)):
                        count = (start + size - first) // length + 1
                        if is_profitable(count, length):
                            yield -count * length, length, first
                start += size

    def _reads_alike(self, first: int, last: int, shared: Sequence[frozenset[str]]) -> bool:
        """Whether two blocks read alike what they make and what is shared: soon told, mostly no."""
        return all(
            names <= self._names[first + i]
            and [s - first for s in self._sources[first + i] if s >= first]
            == [s - last for s in self._sources[last + i] if s >= last]
            for i, names in enumerate(shared)
        )

    def matched(self, start: int, length: int, count: int) -> RepeatedBlocks | None:
        """The longest run at the end of `count` blocks of one shape, if it pays."""
        last = start + (count - 1) * length
        shared = [self._names[i] & self._names[i - length] for i in range(last, last + length)]
        for first in range(last - length, last - _FEWEST_BLOCKS * length, -length):
            if not self._reads_alike(first, last, shared):
                return None
        pattern: list[object] = []
        blocks: list[tuple[Terms, ...]] = []
        places: list[list[int]] = []
        read: set[str] = set()
        for first in range(last, start - 1, -length):
            block = self._steps[first : first + length]
            forms, terms = [], []
            for i, names in enumerate(shared, first):
                parts = self._terms[i]
                if parts is None:
                    return None
                form, ordered = _ordered(parts, self._made, first, names)
                forms.append(form)
                terms.append(ordered)
            pattern = pattern or [*forms]
            places.append([step.place for step in block if isinstance(step, Store)])
            made = {step.name for step in block if isinstance(step, Statement)}
            if forms != pattern or made & read or not _even(places[-3:]):
                break
            read.update(*self._names[first : first + length])
            read -= made
            blocks.append(tuple(terms))
        if not is_profitable(len(blocks), length):
            return None
        return RepeatedBlocks(last - (len(blocks) - 1) * length, length, tuple(reversed(blocks)))


def _terms(value: Node) -> Terms | None:
    """A sum of products of names and numbers; None for anything else."""
    terms = []
    for sign, term in value.terms if isinstance(value, Sum) else ((1, value),):
        factors: list[Factor] = []
        for factor in term.factors if isinstance(term, Product) else (term,):
            if not isinstance(factor, Name | Number):
                return None
            factors.append(factor.name if isinstance(factor, Name) else factor.value)
        terms.append((sign, tuple(factors)))
    return tuple(terms)


def _shape(step: Step, terms: Terms | None) -> object:
    """What steps have in common that may do the same in two blocks."""
    if terms is None:
        return step
    output = step.output if isinstance(step, Store) else None
    numbers = (sorted(f for f in factors if isinstance(f, float)) for _, factors in terms)
    return output, tuple(
        sorted((len(factors), *n) for (_, factors), n in zip(terms, numbers, strict=True))
    )


def _ordered(
    parts: Terms, made: Mapping[str, int], first: int, shared: frozenset[str]
) -> tuple[object, Terms]:
    """Terms in an order that is the same in like blocks, and what has to be equal there.

    Names that are others in each block go by age, which is a guess, and any order is right.
    """

    def key(factor: Factor) -> tuple[int, float, str]:
        if isinstance(factor, float):
            return (0, factor, "")
        age = made.get(factor, -1)
        if age >= first:
            return (1, age - first, "")
        return (2, 0, factor) if factor in shared else (3, age, "")

    terms = [(tuple(sorted(factors, key=key)), sign) for sign, factors in parts]
    terms.sort(key=lambda term: [key(factor) for factor in term[0]])
    form = [[k if k[0] < 3 else 3 for k in map(key, factors)] for factors, _ in terms]
    return form, tuple((sign, factors) for factors, sign in terms)


def _even(places: Sequence[Sequence[int]]) -> bool:
    """Whether the places of each store are as far apart from block to block as before."""
    return len(places) < 3 or all(2 * b == a + c for a, b, c in zip(*places, strict=True))
