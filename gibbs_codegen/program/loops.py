"""Loops for runs of like blocks in a row of steps.

A recursion that carries many columns from joint to joint leaves, column by column, blocks that do
the same: the same coefficients, other operands. Straight on, that is more code than processors
fetch in time; as a loop over the columns it is a few lines, which compilers vectorise.

The tape names x − y and y − x alike, so columns that are the same by nature differ in signs all
over. A loop therefore reads and makes names times a sign, chosen such that all blocks are the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain, count

from gibbs_codegen.program.nodes import Name, Node, Number, Product, Statement, Sum, names_in
from gibbs_codegen.program.repeated_blocks import (
    RepeatedBlocks,
    Term,
    find_repeated_blocks,
    is_profitable,
)
from gibbs_codegen.program.steps import Item, Loop, Step, Store


def reroll(steps: Sequence[Step]) -> tuple[list[Item], dict[str, int]]:
    """Steps with loops for runs of like blocks, and the signs of names.

    What a loop reads in rows and what it makes is the names times their signs; what all its blocks
    read is as it is.
    """
    last_use: dict[str, int] = {}
    for i, step in enumerate(steps):
        last_use.update(dict.fromkeys(names_in(step.value), i))
    system = _Signs([step.name for step in steps if isinstance(step, Statement)])
    runs = [(run, _agreeing_blocks(steps, run, system)) for run in find_repeated_blocks(steps)]
    signs = system.solved()
    items: list[Item] = []
    done = 0
    for run, size in runs:
        if is_profitable(size, run.length):
            first = run.stop - size * run.length
            items += [*steps[done:first], _loop(steps, run, size, signs, last_use)]
            done = run.stop
    return [*items, *steps[done:]], signs


class _Signs:
    """Signs of names, as a linear system over the numbers 0 and 1 that is solved as it grows.

    An equation is the sum of its bits: bit 0 a constant, the others the names' own.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._bits = {name: 1 << i for i, name in enumerate(names, start=1)}
        self._rows: dict[int, int] = {}

    def agree(self, equations: Iterable[int]) -> bool:
        """Add equations unless one contradicts what is there."""
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

    def solved(self) -> dict[str, int]:
        """A solution, with as many names as can be left as they are."""
        negative = 0
        for _, row in sorted(self._rows.items()):
            top = 1 << (row.bit_length() - 1)
            others = row ^ top
            if ((others & negative).bit_count() + (others & 1)) % 2:
                negative |= top
        return {name: -1 if negative & bit else 1 for name, bit in self._bits.items()}


def _agreeing_blocks(steps: Sequence[Step], run: RepeatedBlocks, signs: _Signs) -> int:
    """How many blocks at the end of a run can have the same signs; `signs` learns what it takes."""
    pattern: list[int] = []
    for done, block in enumerate(reversed(run.blocks)):
        first = run.stop - (done + 1) * run.length
        found = [
            signs.term(term, step.name if isinstance(step, Statement) else "")
            for step, terms in zip(steps[first : first + run.length], block, strict=True)
            for term in terms
        ]
        pattern = pattern or found
        if not signs.agree(a ^ b for a, b in zip(found, pattern, strict=True)):
            return done
    return len(run.blocks)


def _loop(
    steps: Sequence[Step],
    run: RepeatedBlocks,
    size: int,
    signs: Mapping[str, int],
    last_use: Mapping[str, int],
) -> Loop:
    """Loop over the last `size` blocks of a run; its names are those of the last block."""
    firsts = range(run.stop - size * run.length, run.stop, run.length)
    blocks = [steps[first : first + run.length] for first in firsts]
    made = [[s.name for s in block if isinstance(s, Statement)] for block in blocks]
    results = {
        names[-1]: names
        for names in zip(*made, strict=True)
        if any(last_use.get(n, -1) >= i + run.length for n, i in zip(names, firsts, strict=True))
    }
    # Names that every block reads mean themselves in the body, as do those that it makes.
    read = [{n for step in block for n in names_in(step.value)} for block in blocks]
    shared = set.intersection(*read)
    operands: dict[str, tuple[str, ...]] = {}
    body: list[Step] = []
    for p, step in enumerate(blocks[-1]):
        terms = []
        for rows in zip(*(block[p] for block in run.blocks[-size:]), strict=True):
            sign = rows[-1][0]
            columns = list(zip(*(factors for _, factors in rows), strict=True))
            for column in columns:
                if len(set(column)) > 1:
                    sign *= signs.get(column[-1], 1)
            nodes = tuple(_node(column, made[-1], shared, operands) for column in columns)
            terms.append((sign, Product(nodes) if len(nodes) > 1 else nodes[0]))
        if isinstance(step, Statement):
            turn = signs[step.name]
            body.append(Statement(step.name, _sum([(turn * s, node) for s, node in terms])))
        else:
            body.append(replace(step, value=_sum(terms)))
    places = [[s.place for s in block if isinstance(s, Store)] for block in blocks[:2]]
    straight = tuple(step for block in blocks for step in block)
    return Loop(size, tuple(body), operands, results, tuple(places[0]), _gaps(*places), straight)


def _node(
    column: Sequence[str | float],
    made: Sequence[str],
    shared: set[str],
    operands: dict[str, tuple[str, ...]],
) -> Node:
    """A factor of the body, given those of all blocks; adds to `operands` if it is a row."""
    names = tuple(factor for factor in column if isinstance(factor, str))
    if not names:
        return Number(float(column[-1]))
    if names[-1] in made or len(set(names)) == 1:
        return Name(names[-1])
    # A row goes by a name of its own: another may end in the same name.
    free = chain(reversed(names), (f"{names[-1]}_{i}" for i in count()))
    name = next(n for n in free if n not in shared and operands.get(n, names) == names)
    operands[name] = names
    return Name(name)


def _gaps(first: Sequence[int], second: Sequence[int]) -> tuple[int, ...]:
    return tuple(b - a for a, b in zip(first, second, strict=True))


def _sum(terms: list[tuple[int, Node]]) -> Node:
    if len(terms) == 1 and terms[0][0] > 0:
        return terms[0][1]
    return Sum(tuple(sorted(terms, key=lambda term: -term[0])))
