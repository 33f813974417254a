"""Loop rerolling: repeated blocks of a schedule become loops, which are short and vectorise.

    u0 = c*x0 - s*y0
    u1 = s*y1 - c*x1
    u2 = c*x2 - s*y2
    …
    u39 = c*x39 - s*y39

becomes a loop of forty iterations of `u[i] = c*x[i] - s*y[i]`, with rows of operands x and y and
of results u. The tape names x − y and y − x alike, so columns that are the same by nature differ in
signs all over. Rows hold names times a sign, here minus `u1`.

A recursion that carries many columns from joint to joint leaves such blocks, which are more code
than processors fetch in time. They come with long arms, and pay in C only. Rerolling is therefore
optional: whoever gives the schedule to `allocate_scratch` as it is gets the same function without
loops. The C target makes that choice in one place, where it allocates scratch: it keeps loops for
one state at a time only, and only where they stand for at least `_FEWEST_ROLLED` steps.

Repeated blocks follow one another and do the same with other names.

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

Rows are names that a loop reads or writes one an iteration, and that must lie side by side.

    for i in 0 … 7:  u[i] = c*x[i]          x: x0 x1 … x7
    for i in 0 … 7:  w[i] = c*z[i]          z: x1 … x7 p

Slots that keep their distances form a tuple. The first row makes one of `x0` to `x7`, and the
second extends it, since both read the same `x1`. But `p` is an input and has no slot, so it is
copied before the loop, and the copy lies after `x7`. A loop that would need many copies, or whose
rows cannot lie side by side at all, is left unrolled.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, count, groupby
from math import prod
from operator import eq

from gibbs_codegen.program.nodes import Name, Node, Number, Product, Statement, Sum, names_in
from gibbs_codegen.program.steps import Item, Loop, Step, Store, defined_names

# Fewer blocks, or fewer steps in all, are not worth a loop.
_FEWEST_BLOCKS = 4
_FEWEST_STEPS = 40
_LONGEST_BLOCK = 48

Factor = str | float
Term = tuple[int, tuple[Factor, ...]]
Terms = tuple[Term, ...]
Row = tuple[str, ...]


@dataclass(frozen=True)
class RepeatedBlocks:
    """Blocks of `length` steps from `start`, with the terms of each step in matching order."""

    start: int
    length: int
    blocks: tuple[tuple[Terms, ...], ...]

    @property
    def stop(self) -> int:
        """Index of the first step after the blocks."""
        return self.start + self.length * len(self.blocks)


def is_profitable(count: int, length: int) -> bool:
    """True if `count` blocks of `length` steps are worth a loop."""
    return count >= _FEWEST_BLOCKS and count * length >= _FEWEST_STEPS


def find_repeated_blocks(steps: Sequence[Step]) -> list[RepeatedBlocks]:
    """Repeated blocks of a schedule worth a loop, in order; they do not overlap.

    Candidates that cover most are tried first.
    """
    matcher = _Matcher(steps)
    queue = list(matcher.candidates())
    heapq.heapify(queue)
    occupied = [False] * len(steps)
    repeats = []
    while queue:
        covered, length, start = heapq.heappop(queue)
        count = -covered // length
        free = [
            not any(occupied[start + r * length : start + (r + 1) * length]) for r in range(count)
        ]
        rest = [(start, count - 1)]
        if not all(free):
            # Stretches of blocks of which no step is taken.
            runs = [[*run] for _, run in groupby(range(count), free.__getitem__)]
            rest = [(start + run[0] * length, len(run)) for run in runs if free[run[0]]]
        elif match := matcher.match(start, length, count):
            repeats.append(match)
            occupied[match.start : match.stop] = [True] * (match.stop - match.start)
            rest = [(start, count - len(match.blocks))]
        for new_start, new_count in rest:
            if is_profitable(new_count, length):
                heapq.heappush(queue, (-new_count * length, length, new_start))
    return sorted(repeats, key=lambda match: match.start)


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
            # Stretches in which steps are the same as those one block further: a byte is 1 there.
            same = bytes(map(eq, ids, ids[length:])) + b"\0"
            fewest = max(_FEWEST_BLOCKS, -(-_FEWEST_STEPS // length))
            worth = b"\1" * (length * (fewest - 1))
            start = same.find(worth)
            while start >= 0:
                end = same.index(0, start)
                for first in range(start, min(start + length, end - len(worth) + 1)):
                    count = (end - first) // length + 1
                    yield -count * length, length, first
                start = same.find(worth, end)

    def _independent(self, start: int, length: int, last: int) -> list[int]:
        """First steps of the last blocks, the last one first, whose order is of no account.

        Their stores have one stride. There are none if these are too few for a loop.
        """
        firsts: list[int] = []
        places: list[list[int]] = []
        used_later: set[str] = set()
        for first in range(last, start - 1, -length):
            block = self._steps[first : first + length]
            places.append([step.place for step in block if isinstance(step, Store)])
            defined = {step.name for step in block if isinstance(step, Statement)}
            strides = zip(*places[-3:], strict=True) if len(places) > 2 else ()
            if defined & used_later or not all(2 * b == a + c for a, b, c in strides):
                break
            used_later.update(*self._names[first : first + length])
            used_later -= defined
            firsts.append(first)
        return firsts if is_profitable(len(firsts), length) else []

    def match(self, start: int, length: int, count: int) -> RepeatedBlocks | None:
        """Match the last blocks of a candidate, as many as do the same independently.

        It begins at step `start`, and its blocks are of one signature. None if they are not worth a
        loop.
        """
        last = start + (count - 1) * length
        shared: list[frozenset[str]] = []
        for i in range(last, last + length):
            names = self._names[i] & self._names[i - length]
            inner = [source - last for source in self._sources[i] if source >= last]
            # Names that blocks share or define and read: quick to compare, and mostly different.
            for back in range(length, _FEWEST_BLOCKS * length, length):
                first = last - back
                offsets = [x - first for x in self._sources[i - back] if x >= first]
                if offsets != inner or not names <= self._names[i - back]:
                    return None
            shared.append(names)
        pattern: list[object] = []
        blocks: list[tuple[Terms, ...]] = []
        for first in self._independent(start, length, last):
            forms, terms = [], []
            for i, names in enumerate(shared, first):
                parts = self._terms[i]
                if parts is None:
                    return None
                form, ordered = _canonical(parts, self._defined, first, names)
                forms.append(form)
                terms.append(ordered)
            pattern = pattern or [*forms]
            if forms != pattern:
                break
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
    """A key that steps share if they may do the same in two blocks."""
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
    """The part equal in all blocks, and terms in an order that isomorphic blocks share.

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


def reroll(steps: Sequence[Step]) -> tuple[list[Item], dict[str, int]]:
    """Turn repeated blocks of a schedule into loops, and give each name a sign, +1 or −1.

    What a loop reads and writes in rows are names times their signs; what all its iterations read
    are the names themselves.
    """
    last_use: dict[str, int] = {}
    for i, step in enumerate(steps):
        last_use.update(dict.fromkeys(names_in(step.value), i))
    system = _Signs([step.name for step in steps if isinstance(step, Statement)])
    loops = [(blocks, _consistent(steps, blocks, system)) for blocks in find_repeated_blocks(steps)]
    signs = system.solution()
    items: list[Item] = []
    done = 0
    for blocks, iterations in loops:
        if is_profitable(iterations, blocks.length):
            first = blocks.stop - iterations * blocks.length
            items += [*steps[done:first], _loop(steps, blocks, iterations, signs, last_use)]
            done = blocks.stop
    return [*items, *steps[done:]], signs


class _Signs:
    """Signs of names, as a linear system over the numbers 0 and 1 that is solved as it grows.

    An equation is the sum of its bits: bit 0 a constant, the others the names' own.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._bits = {name: 1 << i for i, name in enumerate(names, start=1)}
        self._rows: dict[int, int] = {}

    def add_equations(self, equations: Iterable[int]) -> bool:
        """Add equations, all or none: none if one contradicts what is there."""
        added: list[int] = []
        for equation in equations:
            while equation > 1 and equation.bit_length() in self._rows:
                equation ^= self._rows[equation.bit_length()]
            if equation == 1:
                for place in added:
                    del self._rows[place]
                return False
            if equation:
                added.append(equation.bit_length())
                self._rows[equation.bit_length()] = equation
        return True

    def term(self, term: Term, result: str = "") -> int:
        """Bits of a term's sign in a step that computes `result` or stores."""
        sign, factors = term
        bits = int(sign < 0) ^ self._bits.get(result, 0)
        for factor in factors:
            if isinstance(factor, str):
                bits ^= self._bits.get(factor, 0)
        return bits

    def solution(self) -> dict[str, int]:
        """A solution, with as many names as can be left as they are."""
        negative = 0
        for _, row in sorted(self._rows.items()):
            top = 1 << (row.bit_length() - 1)
            others = row ^ top
            if ((others & negative).bit_count() + (others & 1)) % 2:
                negative |= top
        return {name: -1 if negative & bit else 1 for name, bit in self._bits.items()}


def _consistent(steps: Sequence[Step], repeated: RepeatedBlocks, signs: _Signs) -> int:
    """The number of last iterations that can have the same signs, as loops before have them.

    `signs` takes the equations of these iterations.
    """
    pattern: list[int] = []
    for done, block in enumerate(reversed(repeated.blocks)):
        first = repeated.stop - (done + 1) * repeated.length
        block_signs = [
            signs.term(term, step.name if isinstance(step, Statement) else "")
            for step, terms in zip(steps[first : first + repeated.length], block, strict=True)
            for term in terms
        ]
        pattern = pattern or block_signs
        if not signs.add_equations(a ^ b for a, b in zip(block_signs, pattern, strict=True)):
            return done
    return len(repeated.blocks)


def _loop(
    steps: Sequence[Step],
    repeated: RepeatedBlocks,
    iterations: int,
    signs: Mapping[str, int],
    last_use: Mapping[str, int],
) -> Loop:
    """The loop of the last `iterations` of repeated blocks; its names are those of the last block.

    `last_use` has the last step that uses a name.
    """
    firsts = range(repeated.stop - iterations * repeated.length, repeated.stop, repeated.length)
    blocks = [steps[first : first + repeated.length] for first in firsts]
    defined = [[s.name for s in block if isinstance(s, Statement)] for block in blocks]
    results = {
        names[-1]: names
        for names in zip(*defined, strict=True)
        if any(
            last_use.get(n, -1) >= i + repeated.length for n, i in zip(names, firsts, strict=True)
        )
    }
    # Names that every block reads mean themselves in the body, as do those that it defines.
    read = [{n for step in block for n in names_in(step.value)} for block in blocks]
    shared = set.intersection(*read)
    operands: dict[str, Row] = {}
    body: list[Step] = []
    for p, step in enumerate(blocks[-1]):
        terms = []
        for rows in zip(*(block[p] for block in repeated.blocks[-iterations:]), strict=True):
            columns = list(zip(*(factors for _, factors in rows), strict=True))
            turned = (signs.get(c[-1], 1) for c in columns if len(set(c)) > 1)
            sign = prod(turned, start=rows[-1][0])
            nodes = tuple(_node(column, defined[-1], shared, operands) for column in columns)
            terms.append((sign, Product(nodes) if len(nodes) > 1 else nodes[0]))
        if isinstance(step, Statement):
            turn = signs[step.name]
            body.append(Statement(step.name, _sum([(turn * s, node) for s, node in terms])))
        else:
            body.append(replace(step, value=_sum(terms)))
    places = [[s.place for s in block if isinstance(s, Store)] for block in blocks[:2]]
    strides = tuple(b - a for a, b in zip(*places, strict=True))
    unrolled = tuple(step for block in blocks for step in block)
    return Loop(iterations, tuple(body), operands, results, tuple(places[0]), strides, unrolled)


def _node(
    column: Sequence[Factor], defined: Sequence[str], shared: set[str], operands: dict[str, Row]
) -> Node:
    """A factor of the body: a number or a name, by that factor in each block.

    `defined` are names that the last block defines, `shared` those that all blocks read. `operands`
    takes the row of names, if they differ from block to block.
    """
    names = tuple(factor for factor in column if isinstance(factor, str))
    if not names:
        return Number(float(column[-1]))
    if names[-1] in defined or len(set(names)) == 1:
        return Name(names[-1])
    # A row goes by a name of its own: another may end in the same name.
    free = chain(reversed(names), (f"{names[-1]}_{i}" for i in count()))
    name = next(n for n in free if n not in shared and operands.get(n, names) == names)
    operands[name] = names
    return Name(name)


def _sum(terms: list[tuple[int, Node]]) -> Node:
    if len(terms) == 1 and terms[0][0] > 0:
        return terms[0][1]
    return Sum(tuple(sorted(terms, key=lambda term: -term[0])))


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
        operands: dict[str, Row] = {}
        for i, (name, row) in enumerate(item.operands.items()):
            local = {name for name in row if name in defined}
            operands[name] = _place_row(row, f"{row[-1]}_{len(copies)}_{i}_", local, here, tuples)
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
    row: Row, prefix: str, defined: set[str], copies: dict[str, str], tuples: SlotTuples
) -> Row:
    """Put a row, one name an iteration, into one tuple, with copies of names that cannot lie in it.

    `defined` are the names of the row that steps define, which therefore can have slots. Empty if
    the place of a copy is not free.
    """
    placed: list[str] = []
    for i, name in enumerate(reversed(row)):
        copy = f"{prefix}{i}"
        for candidate in (name, copy) if name in defined and name not in placed else (copy,):
            tuples.add(candidate)
            anchor = placed[0] if placed else candidate
            if tuples.coalesce(anchor, candidate, -i, lambda *_: False):
                placed.append(candidate)
                break
        else:
            return ()
        if placed[-1] == copy:
            copies[copy] = name
    return tuple(reversed(placed))
