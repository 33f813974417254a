"""Repeated blocks in a schedule: blocks one after the other that do the same with other names.

    u0 = c*x0 - s*y0
    w0 = s*x0 + c*y0
    u1 = c*x1 - s*y1
    w1 = c*y1 + s*x1
    …
    u19 = c*x19 - s*y19
    w19 = s*x19 + c*y19

are twenty isomorphic blocks of two steps. Blocks may differ in names, in the order of terms and
factors, and in signs. In each step a name is either defined earlier in its block (as nothing here
is), or the same in all blocks (`c`, `s`), or another in each (`x0`, `x1` …).
"""

from __future__ import annotations

import heapq
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from gibbs_codegen.program.nodes import Name, Node, Number, Product, Statement, Sum, names_in
from gibbs_codegen.program.steps import Step, Store

# Fewer blocks, or fewer steps in all, are not worth a loop.
_FEWEST_BLOCKS = 4
_FEWEST_STEPS = 40
_LONGEST_BLOCK = 48
# Stretches in which steps are the same as those one block further: there, a byte is 1.
_RUNS = re.compile(b"\x01+")

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
        """Where the steps after the blocks begin."""
        return self.start + self.length * len(self.blocks)


def is_profitable(count: int, length: int) -> bool:
    """Whether `count` blocks of `length` steps are worth a loop."""
    return count >= _FEWEST_BLOCKS and count * length >= _FEWEST_STEPS


def find_repeated_blocks(steps: Sequence[Step]) -> list[RepeatedBlocks]:
    """Repeated blocks of a schedule worth a loop, in order; they do not overlap.

    Candidates that cover most are tried first.
    """
    matcher = _Matcher(steps)
    queue = list(matcher.candidates())
    heapq.heapify(queue)
    taken = [False] * len(steps)
    found = []
    while queue:
        covered, length, start = heapq.heappop(queue)
        count = -covered // length
        free = [not any(taken[start + r * length : start + (r + 1) * length]) for r in range(count)]
        rest = [(start, count - 1)]
        if not all(free):
            rest = _free_stretches(free, start, length)
        elif match := matcher.match(start, length, count):
            found.append(match)
            taken[match.start : match.stop] = [True] * (match.stop - match.start)
            rest = [(start, count - len(match.blocks))]
        for new_start, new_count in rest:
            if is_profitable(new_count, length):
                heapq.heappush(queue, (-new_count * length, length, new_start))
    return sorted(found, key=lambda match: match.start)


def _free_stretches(free: Sequence[bool], start: int, length: int) -> list[tuple[int, int]]:
    """First step and number of blocks of each stretch of blocks of which no step is taken.

    `free` says that of each block; the first block begins at step `start`.
    """
    found = []
    for is_free, group in groupby(free):
        count = len(list(group))
        if is_free:
            found.append((start, count))
        start += count * length
    return found


class _Matcher:
    """Steps and what matching needs of them."""

    def __init__(self, steps: Sequence[Step]) -> None:
        self._steps = steps
        self._terms = [_terms(step.value) for step in steps]
        self._defined = {s.name: i for i, s in enumerate(steps) if isinstance(s, Statement)}
        self._names = [frozenset(names_in(step.value)) for step in steps]
        self._sources = [sorted(self._defined.get(n, -1) for n in names) for names in self._names]

    def candidates(self) -> Iterator[tuple[int, int, int]]:
        """Stretches in which signatures repeat: minus the steps covered, block length, start."""
        numbers: dict[object, int] = {}
        signatures = map(_signature, self._steps, self._terms)
        ids = [numbers.setdefault(signature, len(numbers)) for signature in signatures]
        for length in range(1, _LONGEST_BLOCK + 1):
            same = bytes(map(int.__eq__, ids, ids[length:]))
            for run in _RUNS.finditer(same):
                for first in range(run.start(), min(run.start() + length, run.end())):
                    count = (run.end() - first) // length + 1
                    if not is_profitable(count, length):
                        break
                    yield -count * length, length, first

    def _same_sources(self, first: int, last: int, shared: Sequence[frozenset[str]]) -> bool:
        """Whether two blocks agree in what they read of shared names and of their own.

        This is quickly told, and mostly false. `first` is the first step of one block, `last` that
        of the last; `shared` has for each step of a block the names that all blocks read.
        """
        return all(
            names <= self._names[first + i]
            and [s - first for s in self._sources[first + i] if s >= first]
            == [s - last for s in self._sources[last + i] if s >= last]
            for i, names in enumerate(shared)
        )

    def match(self, start: int, length: int, count: int) -> RepeatedBlocks | None:
        """Match the last blocks of a candidate, as many as do the same independently.

        It begins at step `start`, and its blocks are of one signature. None if they are not worth a
        loop.
        """
        last = start + (count - 1) * length
        shared = [self._names[i] & self._names[i - length] for i in range(last, last + length)]
        for first in range(last - length, last - _FEWEST_BLOCKS * length, -length):
            if not self._same_sources(first, last, shared):
                return None
        pattern: list[object] = []
        blocks: list[tuple[Terms, ...]] = []
        places: list[list[int]] = []
        used_later: set[str] = set()
        for first in range(last, start - 1, -length):
            block = self._steps[first : first + length]
            forms, terms = [], []
            for i, names in enumerate(shared, first):
                parts = self._terms[i]
                if parts is None:
                    return None
                form, ordered = _canonical(parts, self._defined, first, names)
                forms.append(form)
                terms.append(ordered)
            pattern = pattern or [*forms]
            places.append([step.place for step in block if isinstance(step, Store)])
            defined = {step.name for step in block if isinstance(step, Statement)}
            if forms != pattern or defined & used_later or not _is_affine(places[-3:]):
                break
            used_later.update(*self._names[first : first + length])
            used_later -= defined
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


def _signature(step: Step, terms: Terms | None) -> object:
    """What steps have in common that may do the same in two blocks."""
    if terms is None:
        return step
    output = step.output if isinstance(step, Store) else None
    numbers = (sorted(f for f in factors if isinstance(f, float)) for _, factors in terms)
    return output, tuple(
        sorted((len(factors), *n) for (_, factors), n in zip(terms, numbers, strict=True))
    )


def _canonical(
    parts: Terms, defined: Mapping[str, int], first: int, shared: frozenset[str]
) -> tuple[object, Terms]:
    """What must be equal in all blocks, and terms in an order that isomorphic blocks share.

    Names that are others in each block go by age, which is a guess, and any order is right.
    `defined` has the step that defines a name, `first` is the first of the block.
    """

    def key(factor: Factor) -> tuple[int, float, str]:
        if isinstance(factor, float):
            return (0, factor, "")
        age = defined.get(factor, -1)
        if age >= first:
            return (1, age - first, "")
        return (2, 0, factor) if factor in shared else (3, age, "")

    terms = [(tuple(sorted(factors, key=key)), sign) for sign, factors in parts]
    terms.sort(key=lambda term: [key(factor) for factor in term[0]])
    form = [[k if k[0] < 3 else 3 for k in map(key, factors)] for factors, _ in terms]
    return form, tuple((sign, factors) for factors, sign in terms)


def _is_affine(places: Sequence[Sequence[int]]) -> bool:
    """Whether the places of each store have one stride over three blocks."""
    return len(places) < 3 or all(2 * b == a + c for a, b, c in zip(*places, strict=True))
