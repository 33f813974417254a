"""Statements and arrays in C as lines: how they are written and broken is decided here alone.

The entries of an array follow each other; where states are side by side, in blocks of LANES, those
of a state are `stride` reals apart.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence

from gibbs_codegen.files.line_breaks import INDENT, WIDTH, broken
from gibbs_codegen.program.nodes import Node, Statement
from gibbs_codegen.targets.printers import InfixPrinter, StatementPrinter

# A short statement: what begins a declaration, and whether its value is copied, not computed.
_SHORT = re.compile(
    r"(?P<declared>const (?:\w+ )?real )?\w+(?:\[[^]]*\]|\(\w+\)|->\w+)? = "
    r"(?:(?P<copied>-?\w+(?:\[[^]]*\]|\(\w+\)|->\w+))|.*);"
)


class CStatements(StatementPrinter):
    """Prints statements in C, for one state or for one `of_several` that are side by side.

    Local constants are of a `kind` of number; `depth` counts the blocks that the lines stand in.
    """

    COMMENT = "/* {} */"

    def __init__(
        self,
        expressions: InfixPrinter,
        depth: int = 1,
        kind: str = "real",
        *,
        of_several: bool = False,
    ) -> None:
        super().__init__(expressions)
        self.depth = depth
        self._kind = kind
        self.of_several = of_several

    @property
    def inside(self) -> CStatements:
        """The printer of what stands in a loop, where lines are shorter."""
        depth, of_several = self.depth + 1, self.of_several
        return CStatements(self._expressions, depth, self._kind, of_several=of_several)

    def assign(self, name: str, value: Node) -> list[str]:
        """A local constant."""
        return self._assignment(f"const {self._kind} {name}", self._expressions.expression(value))

    def assign_all(self, statements: Iterable[Statement]) -> list[str]:
        """Local constants, short ones side by side, with a comment above each group."""
        return side_by_side(super().assign_all(statements), self.depth)

    def store(self, array: str, place: int | str, value: Node) -> list[str]:
        """An assignment to an entry of an array; `place` is as of `entry`."""
        return self._assignment(self.entry(array, place), self._expressions.expression(value))

    def entry(self, array: str, place: int | str) -> str:
        """An entry of an array by its number, or by what `place` or `place_in_loop` returns."""
        if not self.of_several:
            return f"{array}[{place}]"
        return f"{array}[({place}) * stride]" if " " in str(place) else f"{array}[{place} * stride]"

    def load(self, name: str, array: str, place: int | str, sign: str = "") -> str:
        """A line with a local constant that is an entry of an array; `place` is as of `entry`.

        `sign` is "-" where the array has minus the constant.
        """
        return f"const real {name} = {sign}{self.entry(array, place)};"

    def spill(self, array: str, place: int | str, name: str, sign: str = "") -> str:
        """A line that assigns a local constant to an entry, from which `load` reads it.

        `sign` is "-" where minus the constant is stored.
        """
        return f"{self.entry(array, place)} = {sign}{name};"

    def constant(self, name: str) -> str:
        """One of those that `constants` points to, by its name."""
        return f"CONSTANT({name})" if self.of_several else f"constants->{name}"

    def load_constant(self, name: str) -> str:
        """A local constant that is the one of its name that `constants` points to."""
        return f"const real {name} = {self.constant(name)};"

    def helper(self, name: str, parameters: Sequence[str], body: Sequence[str]) -> list[str]:
        """Definition of a function that computes a part of another one for a state.

        `parameters` stand after the constants, and of several states before the stride.
        """
        arguments = ["const Constants *RESTRICT constants", *parameters]
        idle: list[str] = []
        if self.of_several:
            arguments.append("const int stride")
            idle = [] if any("stride" in line for line in body) else [unused("stride")]
        return [*head(f"static INLINE void {name}", arguments), "{", *indented([*idle, *body]), "}"]

    def call_helper(self, name: str, arrays: Sequence[str]) -> list[str]:
        """A call of what `helper` defines, for one state or for each lane of a block."""
        if not self.of_several:
            return call(name, ["constants", *arrays])
        beginning_at_lane = [f"{array} + lane" for array in arrays]
        of_lane = ["OF_LANE(constants, lane)", *beginning_at_lane, "LANES"]
        return vector_loop("lane", "LANES", call(name, of_lane))

    def clear(self, array: str, size: str) -> list[str]:
        """A loop that makes all entries of an array zero; `size` is of `statements.array_size`."""
        return loop("i", size, [f"{array}[i] = {self._expressions.number(0.0)};"])

    def _assignment(self, target: str, value: str) -> list[str]:
        """An assignment, broken where it is too long for a line."""
        return broken(f"{target} = {value};", WIDTH - self.depth * INDENT)


def unused(name: str) -> str:
    """A line that tells compilers that a parameter is unused on purpose."""
    return f"(void){name};"


def call(name: str, arguments: Sequence[str]) -> list[str]:
    """A call of a function that returns nothing; it may stand in a loop."""
    return _listed(f"{name}(", arguments, ");", WIDTH - 4 * INDENT)


def head(name: str, parameters: Sequence[str], end: str = "") -> list[str]:
    """The head of a function, from its type on; with `end` a semicolon, its declaration."""
    return _listed(f"{name}(", parameters, f"){end}", WIDTH)


def _listed(begin: str, items: Sequence[str], end: str, width: int) -> list[str]:
    """Items with commas between them, as many in a line as there is room for."""
    lines = [begin]
    for item, after in zip(items, [*([", "] * (len(items) - 1)), end], strict=True):
        if len(lines[-1]) + len(item) + len(after.rstrip()) > width:
            lines.append(" " * INDENT)
        lines[-1] += item + after
    return [line.rstrip() for line in lines]


def loop(index: str, count: int | str, body: Sequence[str]) -> list[str]:
    """A loop over an index from 0, of `count` rounds."""
    head = f"for (int {index} = 0; {index} < {count}; ++{index}) {{"
    return [head, *indented(body), "}"]


def vector_loop(index: str, count: int | str, body: Sequence[str]) -> list[str]:
    """A loop with independent rounds, marked for compilers to vectorise."""
    return ["VECTORISE", *loop(index, count, body)]


def side_by_side(lines: Iterable[str], depth: int = 1) -> list[str]:
    """Lines that stand in `depth` blocks, short statements of a kind in one.

    Of constants that are computed a line has two, so that a reader finds them.
    """
    merged: list[str] = []
    before: re.Match[str] | None = None
    count = 0
    for line in lines:
        short = _SHORT.fullmatch(line)
        if short and before and short["declared"] == before["declared"]:
            declared = short["declared"] or ""
            rest = f", {line.removeprefix(declared)}" if declared else f"; {line}"
            same = bool(short["copied"]) == bool(before["copied"]) or not declared
            room = count < 2 or short["copied"] or not declared
            if same and room and len(merged[-1]) + len(rest) <= WIDTH - depth * INDENT + 1:
                merged[-1] = f"{merged[-1][:-1]}{rest}"
                count += 1
                continue
        merged.append(line)
        before, count = short, 1
    return merged


def indented(lines: Iterable[str]) -> list[str]:
    """Lines of a block."""
    return [f"{' ' * INDENT}{line}".rstrip() for line in lines]


def place(shape: Sequence[int], number: int) -> str:
    """Number of an entry of an array of a shape, by row and column, as 1 * 9 + 3."""
    terms = []
    for axis in range(1, len(shape)):
        size = math.prod(shape[axis:])
        index, number = divmod(number, size)
        terms.append(f"{index} * {size}")
    return " + ".join([*terms, str(number)])


def place_in_loop(first: int, step: int = 0) -> str:
    """Number of an entry in round `i` of a loop, moving by `step` or one."""
    return f"{first} + {step} * i" if step else f"{first} + i"


def array_size(entries: int | str, lanes: bool) -> str:
    """Reals in an array, by the entries of one state: a number, or an expression that is a factor.

    With `lanes` it holds a block of states.
    """
    return f"{entries} * LANES" if lanes else str(entries)


def local_arrays(sizes: Mapping[str, str]) -> list[str]:
    """A declaration of local arrays by their sizes, as `array_size` returns them, or none."""
    arrays = [f"{name}[{size}]" for name, size in sizes.items()]
    return _listed("real ", arrays, ";", WIDTH - 2 * INDENT) if arrays else []


def from_entry(array: str, entry: int) -> str:
    """An array without its first `entry` entries, as an argument of a call for one state."""
    return f"{array} + {entry}"


def from_block(array: str, width: int, block: str) -> str:
    """An array without its first blocks of states, as many as the variable `block` says.

    `width` is the number of entries of one state.
    """
    return f"{array} + {block} * ({width} * LANES)"


def read_arrays(
    names: Iterable[str], real: str = "real", qualifier: str = "RESTRICT "
) -> list[str]:
    """Declarations of parameters that are arrays from which a function reads."""
    return [f"const {parameter}" for parameter in written_arrays(names, real, qualifier)]


def written_arrays(
    names: Iterable[str], real: str = "real", qualifier: str = "RESTRICT "
) -> list[str]:
    """Declarations of parameters that are arrays to which a function writes."""
    return [f"{real} *{qualifier}{name}" for name in names]
