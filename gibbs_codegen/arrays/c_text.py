"""Array programs as C, for one state or for a block of states: the same text serves both.

What differs from state to state is a `number`, what all states share is a `real`. For one state
both are the same; for a block a `number` has a lane for each state (`emitted/numbers.c`). Calls of
the module's functions are `EACH(function)(constants, ...)`. Text for one state alone, as users get
it, has a `real` everywhere.

A node is computed by a statement of its own, unless it is only another look at entries that are
there (a part, a transposition), or a sum of entries that one other sum reads. Arrays that live at
the same time share one `room`, which takes no memory beyond the stack.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.contents import check_distinct, externals_of, owners_of
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program, Shape, diagonal_of, numbers_of
from gibbs_codegen.arrays.text import PRODUCT, SUM, WHOLE, NodeNames, Text, call_of, infix
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import FUNCTIONS

# Vectors of as many entries are computed entry by entry, without a loop.
FEW = 4
_VIEWS = (nodes.RowRange, nodes.Transposition, nodes.Entries, nodes.Coordinates, nodes.Reshaping)
_FUNCTIONS = {
    "minimum": "minimum",
    "maximum": "maximum",
    "absolute": "absolute",
    "copysign": "signed_as",
    "sqrt": "square_root",
    "exp": "exponential",
    "arctan2": "arctan2",
    "choose": "choose",
}
# Functions of angles, which one call computes.
_ANGLES = ("sin", "cos")
# Letters for the places of an entry, and for what is added up, of which a program may have some.
_INDICES, _SUMMED = "ijlmnoprstefg", "kwyz"
Index = Sequence[str | int]


class View(NamedTuple):
    """The place of a node's entries: an array in C, the first entry, and how far axes go.

    If it `has_lanes`, an entry is `lanes` reals, one for each state.
    """

    array: str
    offset: int
    strides: tuple[int, ...]
    has_lanes: bool = False

    def entry(self, index: Index) -> str:
        """The text of an entry."""
        place = _place(self.offset, self.strides, index)
        if not self.has_lanes:
            return f"{self.array}[{place}]"
        if place == "0":
            return f"{self.array}[lane]"
        scaled = f"({place})" if " " in place else place
        return f"{self.array}[{scaled} * lanes + lane]"

    @property
    def first(self) -> str:
        """The text of the address of the first entry."""
        offset = f"{self.offset} * lanes" if self.has_lanes else self.offset
        return f"{self.array} + {offset}" if self.offset else self.array


def _place(offset: int, strides: Iterable[int], index: Index) -> str:
    """The text of a place: what is known of it is added up."""
    terms = []
    for stride, i in zip(strides, index, strict=True):
        if isinstance(i, int):
            offset += stride * i
        elif stride:
            terms.append(i if stride == 1 else f"{i} * {stride}")
    return " + ".join([*terms, *([str(offset)] if offset or not terms else [])])


def _strides(shape: Shape) -> tuple[int, ...]:
    """Strides of axes in entries that are stored row by row."""
    return tuple(math.prod(shape[axis + 1 :]) for axis in range(len(shape)))


@dataclass
class Storage:
    """An array of the room, for nodes that are needed from one statement to another."""

    size: int
    first: int
    last: int
    begin: int = 0


class CProgram:
    """The function in C of one program.

    It is text for one state and for blocks, or if it `is_plain` for one state alone.
    """

    # The line before loops whose rounds do not depend on each other.
    before_loops: tuple[str, ...] = ()

    def __init__(self, program: Program, prefix: str = "", *, is_plain: bool = False) -> None:
        self.program, self.readers = program, program.readers
        _check_names(program)
        self.name = f"{prefix}{program.name}"
        self.prefix = prefix
        self.owners = owners_of(program)
        self.is_plain = is_plain
        self.has_context = bool(externals_of(program)) and not is_plain
        taken = {*program.names, *program.outputs}
        self._letters = [letter for letter in _INDICES if letter not in taken]
        self._summed_letter = next((x for x in _SUMMED if x not in taken), "summed")
        self._names = NodeNames(program, {*_RESERVED, *_INDICES, *_SUMMED})
        self._indices: dict[str, int] = {}
        self._uniform: dict[Node, bool] = {}
        self._tables: dict[Node, None] = {}
        self._copies = 0

    # Nodes that are computed where they are read, and nodes with a place of their own.

    @cached_property
    def results(self) -> set[Node]:
        """Nodes that are outputs, or of which an output is another look."""
        return {y for x in self.program.outputs.values() for y in (x, self.base(x))}

    @cached_property
    def inlined(self) -> set[Node]:
        """Sums that are computed where one other reads them."""
        return {x for x in self.program.nodes if self._is_inlined(x)}

    def _in_rows(self, array: str, x: Node, is_uniform: bool | None = None) -> View:
        """An array that has the entries of a node row by row, uniform as the node by itself."""
        return View(array, 0, _strides(x.shape))

    def _is_kept(self, x: Node) -> bool:
        """True if a node has an array, and not a variable."""
        return bool(x.shape)

    def _is_inlined(self, x: Node) -> bool:
        readers = self.readers[x]
        kinds = nodes.Elementary | nodes.Contraction
        if not isinstance(x.operation, kinds) or x in self.results or x in self.program.labels:
            return False
        if _name_of(x) in _ANGLES and not self.is_plain:
            return False
        if len(readers) == 1 and x.shape == () and self._is_piece(readers[0]):
            return isinstance(x.operation, nodes.Elementary)
        if len(readers) != 1 or self.uniform(x) != self.uniform(readers[0]):
            return False
        reader = readers[0]
        if isinstance(x.operation, nodes.Contraction):
            return self._is_added(x, reader)
        if isinstance(reader.operation, nodes.Total):
            return True
        return isinstance(reader.operation, nodes.Elementary) and reader.shape == x.shape

    def _is_added(self, x: Node, reader: Node) -> bool:
        """True if a node is added to others in a statement of its own."""
        if _name_of(reader) != "add" or reader.shape != x.shape:
            return False
        return not self._is_inlined(reader) or self._is_added(reader, self.readers[reader][0])

    def _is_piece(self, x: Node) -> bool:
        """True if a node is a number that one vector has as its entry."""
        readers = self.readers[x]
        joined = len(readers) == 1 and isinstance(readers[0].operation, nodes.Joining)
        return joined and isinstance(x.operation, nodes.Reshaping) and x not in self.results

    def uniform(self, x: Node) -> bool:
        """True if all states share a value; results of functions differ from state to state."""
        if self.is_plain:
            return True
        if x not in self._uniform:
            match x.operation:
                case nodes.Input():
                    uniform = x.is_uniform
                case nodes.Call() | nodes.Solution():
                    uniform = False
                case nodes.Invocation(program, name):
                    uniform = CProgram(program).uniform(program.outputs[name])
                case _:
                    uniform = all(map(self.uniform, x.arguments))
            self._uniform[x] = uniform
        return self._uniform[x]

    def base(self, x: Node) -> Node:
        """The node whose entries a node looks at."""
        while isinstance(x.operation, _VIEWS) and not self._is_copied(x):
            x = x.arguments[0]
        return x

    def _is_copied(self, x: Node) -> bool:
        """True if a reshaping needs entries in another order than they are there."""
        if not isinstance(x.operation, nodes.Reshaping):
            return False
        inner = x.arguments[0]
        return not self._is_in_rows(inner)

    def _is_in_rows(self, x: Node) -> bool:
        """True if entries are stored row by row."""
        match x.operation:
            case nodes.Transposition():
                return False
            case nodes.RowRange() | nodes.Entries() | nodes.Coordinates():
                return self._is_in_rows(x.arguments[0])
        return True

    def is_computed(self, x: Node) -> bool:
        """True if a statement computes a node."""
        if x in self.inlined or isinstance(x.operation, nodes.Input | nodes.Constant):
            return False
        return self.base(x) is x

    def reads(self, x: Node) -> set[Node]:
        """The computed nodes that must be there for the entries of a node."""
        base = self.base(x)
        if base in self.inlined:
            return set().union(*map(self.reads, base.arguments))
        return {base} if self.is_computed(base) else set()

    # Statements and where their results are kept.

    @cached_property
    def statements(self) -> list[list[Node]]:
        """Nodes that one statement computes, in the order of the statements."""
        groups: dict[object, list[Node]] = {}
        for x in self.program.nodes:
            if self.is_computed(x):
                is_alone = self.is_plain and isinstance(x.operation, nodes.Elementary)
                groups.setdefault((not is_alone and call_of(x)) or x, []).append(x)
        waiting, done, statements = list(groups.values()), set[Node](), []
        while waiting:
            group = waiting.pop(0)
            if self._is_sum(group[0]):
                others = [other for other in waiting if self._goes_with(other[0], group, done)]
                waiting = [other for other in waiting if other not in others]
            done |= set(group)
            statements.append(group)
        return statements

    def _is_sum(self, x: Node) -> bool:
        """True if entries of an array are computed one by one."""
        if _name_of(x) in _ANGLES and not self.is_plain:
            return False
        return isinstance(x.operation, nodes.Elementary | nodes.Contraction) and self._is_kept(x)

    def _goes_with(self, x: Node, group: list[Node], done: set[Node]) -> bool:
        """Add a node to the loop of others, if all that it reads is there by then."""
        first = group[0]
        if x.shape != first.shape or self.uniform(x) != self.uniform(first):
            return False
        if not self._is_sum(x) or self._terms(x)[1]:
            return False
        if not self._are_there(x, group, done):
            return False
        group.append(x)
        return True

    def _are_there(self, x: Node, group: list[Node], done: set[Node]) -> bool:
        """True if all that an entry of a node reads is computed, or is where the entry will be."""
        return all(
            self._are_there(y, group, done)
            if y in self.inlined
            else (y in group and y.shape == x.shape) or self.reads(y) <= done
            for y in x.arguments
        )

    @cached_property
    def when(self) -> dict[Node, int]:
        """The number of the statement that computes a node."""
        return {x: number for number, group in enumerate(self.statements) for x in group}

    @cached_property
    def places(self) -> dict[Node, View]:
        """The places of computed arrays."""
        places: dict[Node, View] = {}
        for name, x in self.program.outputs.items():
            self._place(x, self._in_rows(name, x), places)
        for x in reversed(self.program.nodes):
            if isinstance(x.operation, nodes.Joining) and x not in places and self.is_computed(x):
                self._place(x, self._in_rows(self._names.of(x), x), places)
        for x in self.when:
            if x not in places and self._is_kept(x):
                places[x] = self._in_rows(self._names.of(x), x)
        return places

    def _place(self, x: Node, at: View, places: dict[Node, View]) -> None:
        """Let a node be computed where it is wanted, and joined pieces where they are joined."""
        match x.operation:
            case nodes.Entries() | nodes.Coordinates():
                self._place(x.arguments[0], at, places)
            case nodes.Transposition(axes):
                strides = dict(zip(axes, at.strides, strict=True))
                turned = tuple(strides[axis] for axis in sorted(axes))
                self._place(x.arguments[0], at._replace(strides=turned), places)
            case nodes.Reshaping() if at.strides == _strides(x.shape) and not self._is_copied(x):
                inner = at._replace(strides=_strides(x.arguments[0].shape))
                self._place(x.arguments[0], inner, places)
            case _ if self.is_computed(x) and self._is_kept(x) and x not in places:
                if at.strides != _strides(x.shape) and not self._can_be_apart(x):
                    return
                places[x] = at
                pieces = x.arguments if isinstance(x.operation, nodes.Joining) else ()
                offset = at.offset
                for piece in pieces:
                    if self.uniform(piece) == self.uniform(x):
                        self._place(piece, at._replace(offset=offset), places)
                    offset += piece.shape[0] * at.strides[0]

    def _can_be_apart(self, x: Node) -> bool:
        """True if rows of a node can be apart: functions and views need them side by side."""
        is_written = isinstance(x.operation, nodes.Total | nodes.Joining) or self._is_sum(x)
        return is_written and not self._is_reshaped(x)

    def _is_reshaped(self, x: Node) -> bool:
        return any(
            isinstance(reader.operation, nodes.Reshaping)
            or (isinstance(reader.operation, _VIEWS) and self._is_reshaped(reader))
            for reader in self.readers[x]
        )

    @cached_property
    def arrays(self) -> dict[str, Storage]:
        """Arrays of numbers that are kept between statements, with their places in the room."""
        storages: dict[str, Storage] = {}
        outputs = set(self.program.outputs)
        last = dict(self.when)
        for number, group in enumerate(self.statements):
            for x in group:
                for argument in x.arguments:
                    for y in self.reads(argument):
                        last[y] = max(last[y], number)
        for x in self.results & set(last):
            last[x] = len(self.statements)
        sizes: dict[str, int] = {}
        for x in set(self.when) & set(self.places):
            array = self.places[x].array
            sizes[array] = max(sizes.get(array, 0), x.size)
        for x, number in self.when.items():
            array = self.places[x].array if x in self.places else ""
            if not array or array in outputs or not self._is_in_room(x):
                continue
            storage = storages.setdefault(array, Storage(sizes[array], number, last[x]))
            storage.first = min(storage.first, number)
            storage.last = max(storage.last, last[x])
        _settle(list(storages.values()))
        return storages

    def _is_in_room(self, x: Node) -> bool:
        """True if an array between statements is in the room, where others take its place."""
        return self.is_plain or not self.uniform(x)

    # Text of entries.

    def view(self, x: Node) -> View:
        """The place of the entries of a node that is no expression."""
        match x.operation:
            case nodes.Input(name):
                return self._in_rows(name, x)
            case nodes.Constant():
                self._tables[x] = None
                return View(self._names.of(x), 0, _strides(x.shape))
            case nodes.RowRange(begin):
                inner = self.view(x.arguments[0])
                return inner._replace(offset=inner.offset + begin * inner.strides[0])
            case nodes.Transposition(axes):
                inner = self.view(x.arguments[0])
                return inner._replace(strides=tuple(inner.strides[axis] for axis in axes))
            case nodes.Entries() | nodes.Coordinates():
                return self.view(x.arguments[0])
            case nodes.Reshaping() if not self._is_copied(x):
                inner = self.view(x.arguments[0])
                return inner._replace(strides=_strides(x.shape))
        return self.places[x]

    def entry(self, x: Node, index: Index, wanted: bool = False) -> str:
        """An entry of a node; where `wanted`, a number, not a real."""
        text = self._entry(x, index).text
        return self._same(text) if wanted and self.uniform(x) else text

    def _same(self, text: str) -> str:
        """A number that all states share."""
        return f"same({text})"

    def _entry(self, x: Node, index: Index) -> Text:
        if x in self.inlined:
            return self.expression(x, index)
        base = self.base(x)
        if base in self.inlined:
            return self._entry(base, ())
        numbers = numbers_of(base)
        if numbers is not None and (numbers == numbers.flat[0]).all():
            return Text(literal(float(numbers.flat[0])))
        if x is base and (diagonal := diagonal_of(x)):
            return Text(_diagonal(index, *diagonal))
        if self._is_kept(base):
            return Text(self.view(x).entry(index))
        match base.operation:
            case nodes.Input(name):
                return Text(name)
        return Text(self._names.of(base))

    def expression(self, x: Node, index: Index) -> Text:
        """An entry of an elementary function."""
        operands = [self._spread(argument, x, index) for argument in x.arguments]
        if text := infix(x, operands):
            return text
        name, terms = _name_of(x), [operand.text for operand in operands]
        if self.is_plain and name in _ANGLES:
            return Text(f"LIBRARY({name})({terms[0]})")
        if self.uniform(x):
            return Text(f"real_{_FUNCTIONS[name]}({', '.join(terms)})")
        numbers = [
            self._same(term) if self.uniform(y) else term
            for term, y in zip(terms, x.arguments, strict=True)
        ]
        return Text(f"{_FUNCTIONS[name]}({', '.join(numbers)})")

    def _spread(self, argument: Node, x: Node, index: Index) -> Text:
        """The entry of an argument that goes with an entry of the result."""
        if argument.shape == ():
            return self._entry(argument, ())
        at = [0 if n == 1 else i for n, i in zip(argument.shape, index, strict=True)]
        return self._entry(argument, at)

    def _assignment(
        self, target: View, x: Node, wanted: bool = False
    ) -> Callable[[Index], list[str]]:
        """The assignment to the entry of an index; `wanted` is as of `entry`."""
        return lambda index: [f"{target.entry(index)} = {self.entry(x, index, wanted)};"]

    def pointer(self, x: Node, lines: list[str], wanted_uniform: bool = False) -> str:
        """The text of an array's first entry, copied to where functions can read it if need be."""
        if not x.size:
            return "0"
        uniform = self.uniform(x)
        base = self.base(x)
        numbers = numbers_of(base)
        spread = numbers is not None and (numbers == numbers.flat[0]).all()
        there = self._is_kept(base) and not spread and x not in self.inlined
        if uniform == wanted_uniform and there:
            at = self.view(x)
            if at.strides == _strides(x.shape):
                return at.first
        self._copies += 1
        name = f"copy_{self._copies}"
        lines.append(self._declaration(name, x.size, wanted_uniform))
        target = self._in_rows(name, x, wanted_uniform)
        copy = self._assignment(target, x, wanted=not wanted_uniform)
        lines += self._loops(x.shape, copy, wanted_uniform)
        return name

    def _loops(
        self, shape: Shape, body: Callable[[Index], list[str]], is_uniform: bool
    ) -> list[str]:
        """A statement for each entry: written out where there are few, or else in loops."""
        if math.prod(shape) <= FEW:
            entries = itertools.product(*map(range, shape))
            return self._in_states([line for x in entries for line in body(x)], is_uniform)
        index = [i if n > 1 else 0 for i, n in zip(self._letters, shape, strict=False)]
        if len(index) < len(shape):
            raise UsageError(f"{self.program.name}: no array in C may have {len(shape)} axes")
        lines = self._in_states(body(index), is_uniform)
        before = () if is_uniform else self.before_loops
        for i, n in reversed(list(zip(index, shape, strict=True))):
            if i != 0:
                head = f"for (int {i} = 0; {i} < {n}; ++{i}) {{"
                lines = [*before, head, *_indented(lines), "}"]
                before = ()
        return lines

    def _in_states(self, lines: list[str], is_uniform: bool) -> list[str]:
        """Statements that are done for each state, or once for all."""
        return lines

    # Statements.

    def statement(self, group: list[Node]) -> Iterator[str]:
        """The text that computes the nodes of one statement."""
        x = group[0]
        labels = self.program.labels
        words = dict.fromkeys(labels[y].words for y in group if y in labels)
        yield from (f"/* {text} */" for text in words if text)
        match x.operation:
            case nodes.Elementary("sin" | "cos") if not self.is_plain:
                yield from self._sines_and_cosines(group)
            case nodes.Elementary() | nodes.Contraction():
                yield from self._entries(group)
            case nodes.Total():
                yield from self._total(x)
            case nodes.Reshaping():
                yield from self._copied(x)
            case nodes.Joining():
                yield from self._joined(x)
            case nodes.Solution():
                yield from self._solved(x)
            case nodes.Call(functions, name):
                yield from self._called(
                    *self._function(functions, name),
                    [(y, self.is_plain) for y in x.arguments],
                    {FUNCTIONS[name].outputs[k].name: y for k, y in _numbered(group)},
                    [
                        (output.name, shape, self.is_plain)
                        for output, shape in zip(
                            FUNCTIONS[name].outputs, functions.signatures[name].shapes, strict=True
                        )
                    ],
                )
            case nodes.Invocation(program):
                inner = CProgram(program, self.prefix, is_plain=self.is_plain)
                yield from self._called(
                    inner.name,
                    [*(["context"] if inner.has_context else []), *inner.owners],
                    [
                        (y, taken.is_uniform or self.is_plain)
                        for y, taken in zip(x.arguments, program.inputs, strict=True)
                    ],
                    {_output_of(y): y for y in group},
                    [(name, y.shape, inner.uniform(y)) for name, y in program.outputs.items()],
                )
            case nodes.External(name):
                yield from self._called(
                    f"{name}_of_state" if self.is_plain else name,
                    [] if self.is_plain else ["context"],
                    [(y, self.uniform(y)) for y in x.arguments],
                    {name: x},
                    [(name, x.shape, self.uniform(x))],
                    by_hand=not self.is_plain,
                )

    def _function(self, functions: Functions, name: str) -> tuple[str, list[str]]:
        """The text that calls a function of a module, and its arguments before those of its row."""
        function = f"{functions.name}_{name}"
        return function if self.is_plain else f"EACH({function})", [functions.owner]

    def _kind(self, x: Node) -> str:
        return "real" if self.uniform(x) else "number"

    def _entries(self, group: Sequence[Node]) -> list[str]:
        """The text that computes nodes of one shape, entry by entry."""
        bodies = [self._entry_lines(x) for x in group]
        if not self._is_kept(group[0]):
            return bodies[0](())

        def body(index: Index) -> list[str]:
            return [line for lines_at in bodies for line in lines_at(index)]

        return self._loops(group[0].shape, body, self.uniform(group[0]))

    def _entry_lines(self, x: Node) -> Callable[[Index], list[str]]:
        """The text that computes an entry of a node."""
        is_kept, kind = self._is_kept(x), self._kind(x)
        declared = f"const {kind} {self._names.of(x)}"
        terms, products = self._terms(x)
        if products and max(map(_inner, products)) > FEW:
            return lambda index: self._summed(x, index, terms, products)

        def lines(index: Index) -> list[str]:
            text = self.expression(x, index).text if not products else ""
            if products:
                added = [self._term(y, index, k) for y in products for k in range(_inner(y))]
                text = " + ".join([*self._summands(x, index, terms), *added])
            target = self.view(x).entry(index) if is_kept else declared
            return [f"{target} = {text};"]

        return lines

    def _terms(self, x: Node) -> tuple[list[Node], list[Node]]:
        """The terms of a sum, and the products that are added up in it."""
        if isinstance(x.operation, nodes.Contraction):
            return [], [x]
        terms: list[Node] = []
        products: list[Node] = []
        for y in x.arguments if _name_of(x) == "add" else ():
            inner_terms, added = self._terms(y) if y in self.inlined else ([], [])
            terms += inner_terms if added else [y]
            products += added
        return terms, products

    def _summands(self, x: Node, index: Index, terms: Sequence[Node]) -> list[str]:
        """Terms of an entry that is a sum, from left to right."""
        summands = [self._spread(y, x, index) for y in terms]
        return [text.within(PRODUCT if place else SUM) for place, text in enumerate(summands)]

    def _summed(
        self, x: Node, index: Index, terms: Sequence[Node], products: Sequence[Node]
    ) -> list[str]:
        """An entry that is the sum of others and of products of many terms."""
        kind, is_kept = self._kind(x), self._is_kept(x)
        name = "sum" if is_kept else self._names.of(x)
        start = " + ".join(self._summands(x, index, terms)) or "R(0.0)"
        if kind == "number" and all(map(self.uniform, terms)):
            start = self._same(start)
        # gcc keeps sums of numbers that are wider than registers in memory, but not of their parts.
        in_parts = kind == "number" and all(map(self._has_parts, products))
        parts = f"parts_in_{name}"  # Several sums may stand in one block.
        lines = [f"Parts {parts} = parts_of({start});" if in_parts else f"{kind} {name} = {start};"]
        for inner, group in itertools.groupby(products, _inner):
            k = self._summed_letter
            adding, end = (f"ADD_IN_PARTS({parts}, ", ");") if in_parts else (f"{name} += ", ";")
            sums = [f"    {adding}{self._term(y, index, k, in_parts)}{end}" for y in group]
            lines += [f"for (int {k} = 0; {k} < {inner}; ++{k}) {{", *sums, "}"]
        if in_parts:
            lines.append(f"const number {name} = whole_of({parts});")
        if not is_kept:
            return lines
        lines.append(f"{self.view(x).entry(index)} = {name};")
        return ["{", *_indented(lines), "}"] if x.size <= FEW else lines

    def _has_parts(self, x: Node) -> bool:
        """True if factors of a product that differ from state to state are in arrays."""
        return all(self.uniform(y) or self._is_kept(self.base(y)) for y in x.arguments)

    def _term(self, x: Node, index: Index, k: str | int, in_parts: bool = False) -> str:
        """A term of an entry of a product, or of a part of it."""
        left, right = x.arguments
        lead = len(left.shape) - 1
        one, two = (self._entry(left, [*index[:lead], k]), self._entry(right, [k, *index[lead:]]))
        if in_parts:
            one, two = (
                factor if self.uniform(y) else Text(f"PART({factor.text})")
                for factor, y in zip((one, two), x.arguments, strict=True)
            )
        return f"{one.within(PRODUCT)} * {two.within(WHOLE)}"

    def _total(self, x: Node) -> list[str]:
        inner = x.arguments[0]
        axes = x.operation.axes if isinstance(x.operation, nodes.Total) else ()
        at = self.view(x)
        uniform = self.uniform(x)
        zero = "R(0.0)" if uniform else self._same("R(0.0)")
        lines = self._loops(x.shape, lambda index: [f"{at.entry(index)} = {zero};"], uniform)

        def body(index: Index) -> list[str]:
            kept = [0 if axis in axes else i for axis, i in enumerate(index)]
            return [f"{at.entry(kept)} += {self.entry(inner, index)};"]

        return [*lines, *self._loops(inner.shape, body, uniform)]

    def _copied(self, x: Node) -> list[str]:
        """A reshaping of entries that are stored in another order."""
        inner, at = x.arguments[0], self.view(x)
        rows = at._replace(strides=_strides(inner.shape))
        return self._loops(inner.shape, self._assignment(rows, inner), self.uniform(x))

    def _joined(self, x: Node) -> Iterator[str]:
        at, begin = self.view(x), 0
        for piece in x.arguments:
            target = at._replace(offset=at.offset + begin * at.strides[0])
            begin += piece.shape[0]
            if self._is_there(piece, target):
                continue
            uniform = self.uniform(x)
            copy = self._assignment(target, piece, wanted=not uniform)
            yield from self._loops(piece.shape, copy, uniform)

    def _sines_and_cosines(self, group: Sequence[Node]) -> Iterator[str]:
        """Both functions of the same angles, which cost little more than one."""
        x, angles = group[0], group[0].arguments[0]
        name = "sines_and_cosines" if x.shape else "sine_and_cosine"
        yield from self._called(
            f"real_{name}" if self.uniform(x) else name,
            [str(x.size)] if x.shape else [],
            [(angles, self.uniform(x))],
            {_name_of(y): y for y in group},
            [(function, x.shape, self.uniform(x)) for function in _ANGLES],
        )

    def _solved(self, x: Node) -> Iterator[str]:
        matrix, right = x.arguments
        lines: list[str] = []
        arguments = [self.pointer(y, lines, self.uniform(x)) for y in (matrix, right)]
        width = x.size // x.shape[0]
        yield from lines
        name = "real_solve" if self.uniform(x) else "solve"
        at = self.view(x)
        yield f"{name}({x.shape[0]}, {width}, {', '.join(arguments)}, {at.first});"

    def _called(
        self,
        function: str,
        first: Sequence[str],
        arguments: Iterable[tuple[Node, bool]],
        results: dict[str, Node],
        outputs: Iterable[tuple[str, Shape, bool]],
        by_hand: bool = False,
    ) -> Iterator[str]:
        """A call of a function with arguments and outputs, which are uniform or not.

        What is written by hand takes arrays of either.
        """
        lines: list[str] = []
        passed = [*first]
        for x, is_uniform in arguments:
            if not self._is_kept(x):
                passed.append(self.entry(x, (), wanted=not is_uniform))
            else:
                text = self.pointer(x, lines, is_uniform)
                kind = "shared" if is_uniform else "of_each"
                passed.append(f"{kind}({text})" if by_hand else text)
        for name, shape, is_uniform in outputs:
            kind = "real" if is_uniform else "number"
            if name not in results:
                self._copies += 1
                unused = f"unused_{self._copies}"
                lines.append(self._declaration(unused, math.prod(shape), is_uniform))
                passed.append(unused)
            elif not self._is_kept(results[name]):
                variable = self._names.of(results[name])
                lines.append(f"{kind} {variable};")
                passed.append(f"&{variable}")
            else:
                passed.append(self.places[results[name]].first)
        yield from lines
        yield f"{function}({', '.join(passed)});"

    def _declaration(self, name: str, size: int, is_uniform: bool) -> str:
        """The declaration of an array of so many entries."""
        return f"{'real' if is_uniform else 'number'} {name}[{size}];"

    # Functions.

    def parameters(self) -> list[str]:
        """Declarations of the function's arguments, in their order."""
        declared = ["const void *const *context"] if self.has_context else []
        declared += [f"const Constants *{owner}" for owner in self.owners]
        for name, x in zip(self.program.names, self.program.inputs, strict=True):
            kind = "real" if x.is_uniform or self.is_plain else "number"
            declared.append(f"{kind} {name}" if x.shape == () else f"const {kind} *{name}")
        for name, x in self.program.outputs.items():
            declared.append(f"{'real' if self.uniform(x) else 'number'} *{name}")
        return declared

    def body(self) -> list[str]:
        """Statements of the function."""
        lines = [line for group in self.statements for line in self.statement(group)]
        for name, x in self.program.outputs.items():
            target = self._in_rows(name, x)
            if not self._is_kept(x):
                lines.append(f"*{name} = {self.entry(x, ())};")
            elif not self._is_there(x, target):
                lines += self._loops(x.shape, self._assignment(target, x), self.uniform(x))
        inputs = dict(zip(self.program.names, self.program.inputs, strict=True))
        unread = [name for name, x in inputs.items() if x.size and x not in self.readers]
        empty = [name for name, x in (inputs | dict(self.program.outputs)).items() if not x.size]
        unused = [f"(void){name};" for name in (*unread, *empty)]
        return [*unused, *self._declared(), *lines]

    def _is_there(self, x: Node, target: View) -> bool:
        """True if entries of a node are computed where they are wanted."""
        return self.base(x) in self.places and self.view(x) == target

    def _declared(self) -> list[str]:
        """Declarations of the arrays between statements."""
        kind = "real" if self.is_plain else "number"
        lines = [f"{kind} room[{self._room}];"] if self._room else []
        for name, storage in self.arrays.items():
            begin = f" + {storage.begin}" if storage.begin else ""
            lines.append(f"{kind} *const {name} = room{begin};")
        return [*lines, *(f"real {name}[{size}];" for name, size in self._shared.items())]

    @cached_property
    def _room(self) -> int:
        """Entries of the arrays of each state."""
        return max((x.begin + x.size for x in self.arrays.values()), default=0)

    @cached_property
    def _shared(self) -> dict[str, int]:
        """Entries of the arrays of all states."""
        uniform: dict[str, int] = {}
        outputs = self.program.outputs
        for x in self.when:
            if x.shape and not self._is_in_room(x) and self.places[x].array not in outputs:
                array = self.places[x].array
                uniform[array] = max(uniform.get(array, 0), x.size)
        return uniform

    def stack(self, lanes: int) -> int:
        """Reals that its arrays take of the stack in a block of states."""
        return self._room * lanes + sum(self._shared.values())

    def constants(self) -> list[str]:
        """Tables of the numbers that the program has."""
        lines = []
        for x in self._tables:
            numbers = numbers_of(x)
            assert numbers is not None  # noqa: S101 - see `view`
            values = ", ".join(literal(float(value)) for value in numbers.ravel())
            lines.append(f"static const real {self._names.of(x)}[{x.size}] = {{{values}}};")
        return lines

    def function(self, storage: str = "static ") -> list[str]:
        """The text of the function."""
        body = self.body()
        constants = self.constants()
        return [
            f"{storage}void {self.name}(",
            *_listed(self.parameters()),
            "{",
            *_indented([*constants, *body]),
            "}",
        ]


def _numbered(group: Iterable[Node]) -> list[tuple[int, Node]]:
    return [(x.operation.output, x) for x in group if isinstance(x.operation, nodes.Call)]


def _settle(arrays: list[Storage]) -> None:
    """Give arrays places in the room, so that those of the same time do not overlap."""
    settled: list[Storage] = []
    for array in sorted(arrays, key=lambda x: (-x.size, x.first)):
        others = sorted(
            (x for x in settled if x.first <= array.last and array.first <= x.last),
            key=lambda x: x.begin,
        )
        array.begin = 0
        for other in others:
            if array.begin + array.size <= other.begin:
                break
            array.begin = max(array.begin, other.begin + other.size)
        settled.append(array)


def c_functions(programs: Sequence[Program], prefix: str = "", storage: str = "") -> list[str]:
    """Lines of C of programs and those that they invoke, each once, with names that begin so."""
    inner = dict.fromkeys(one for program in programs for one in program.inner)
    check_distinct([*inner, *programs])
    lines: list[str] = []
    for program in inner:
        lines += [*CProgram(program, prefix).function(), ""]
    for program in programs:
        lines += [*CProgram(program, prefix).function(storage), ""]
    return lines


# Names that the text of a program defines, except functions that are written by hand.
_RESERVED = frozenset((*_FUNCTIONS.values(), "sum", "room", "context", "solve", "same"))
_RESERVED |= {"real", "number", "constants", "Constants", "part"}
_RESERVED |= {"Parts", "parts_of", "whole_of"}
_KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline
    int long register restrict return short signed sizeof static struct switch typedef union
    unsigned void volatile while main NAN INFINITY R LIBRARY EACH LANES
"""
_TAKEN = _RESERVED | set(_KEYWORDS.split())


def _check_names(program: Program) -> None:
    """Raise `UsageError` for names that C reserves, that are no names, or that come twice."""
    names = [*program.names, *program.outputs]
    wrong = [
        name
        for name in dict.fromkeys((program.name, *names))
        if not (name.isascii() and name.isidentifier()) or name in _TAKEN or names.count(name) > 1
    ]
    if wrong:
        raise UsageError(
            f"{program.name}: C cannot use the name {', '.join(map(repr, wrong))}; use letters, "
            "digits and underscores, no word of C or of the text around it, and each name once"
        )


def _diagonal(index: Index, shift: int, value: float) -> str:
    """An entry of a matrix with a value on the diagonal that begins in column `shift`."""
    i, j = index
    if isinstance(i, int) and isinstance(j, int):
        return literal(value if j == i + shift else 0.0)
    return f"({_place(shift, (1,), (i,))} == {j} ? {literal(value)} : R(0.0))"


def _inner(x: Node) -> int:
    """The number of terms in an entry of a product."""
    return x.arguments[0].shape[-1]


def literal(value: float) -> str:
    """A real as C writes it."""
    if math.isnan(value):
        return "(real)NAN"
    if math.isinf(value):
        return "(real)INFINITY" if value > 0 else "(-(real)INFINITY)"
    return f"R({value!r})" if math.copysign(1.0, value) > 0 else f"(-R({-value!r}))"


def _indented(lines: Iterable[str]) -> list[str]:
    return [f"    {line}" if line else line for line in lines]


def _listed(parameters: Sequence[str]) -> list[str]:
    return [f"    {text}{',' if text is not parameters[-1] else ')'}" for text in parameters]


def _output_of(x: Node) -> str:
    """The name of a program's result."""
    return x.operation.output if isinstance(x.operation, nodes.Invocation) else ""


def _name_of(x: Node) -> str:
    """The name of an elementary function."""
    return x.operation.name if isinstance(x.operation, nodes.Elementary) else ""
