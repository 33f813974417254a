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
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain, count
from math import prod

from gibbs_codegen.program.nodes import Name, Node, Number, Product, Statement, Sum, names_in
from gibbs_codegen.program.repeated_blocks import (
    RepeatedBlocks,
    Term,
    find_repeated_blocks,
    is_profitable,
)
from gibbs_codegen.program.steps import Item, Loop, Step, Store


def reroll(steps: Sequence[Step]) -> tuple[list[Item], dict[str, int]]:
    """Turn repeated blocks of a schedule into loops, and give each name a sign, +1 or −1.

    What a loop reads and writes in rows are names times their signs; what all its iterations read
    are the names themselves.
    """
    last_use: dict[str, int] = {}
    for i, step in enumerate(steps):
        last_use.update(dict.fromkeys(names_in(step.value), i))
    system = _Signs([step.name for step in steps if isinstance(step, Statement)])
    found = [(blocks, _consistent(steps, blocks, system)) for blocks in find_repeated_blocks(steps)]
    signs = system.solution()
    items: list[Item] = []
    done = 0
    for blocks, iterations in found:
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
    """How many of the last iterations can have the same signs, as loops before have them.

    `signs` takes the equations of these iterations.
    """
    pattern: list[int] = []
    for done, block in enumerate(reversed(repeated.blocks)):
        first = repeated.stop - (done + 1) * repeated.length
        found = [
            signs.term(term, step.name if isinstance(step, Statement) else "")
            for step, terms in zip(steps[first : first + repeated.length], block, strict=True)
            for term in terms
        ]
        pattern = pattern or found
        if not signs.add_equations(a ^ b for a, b in zip(found, pattern, strict=True)):
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
    operands: dict[str, tuple[str, ...]] = {}
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
    column: Sequence[str | float],
    defined: Sequence[str],
    shared: set[str],
    operands: dict[str, tuple[str, ...]],
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
