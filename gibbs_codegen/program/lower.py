"""From the tape to the program: slices of the tape, one per function, in plain nodes.

A function takes from the tape the statements that its outputs need, in the tape's order. Those of
the parameter stage go to `prepare`, shared by all functions. What is used once is written where it
is used, as long as the line stays short.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.program.nodes import (
    Call,
    Function,
    Name,
    Node,
    Number,
    Output,
    Product,
    Program,
    Reciprocal,
    Statement,
    Sum,
    names_in,
)
from gibbs_codegen.program.operations import count_operations
from gibbs_codegen.symbolic.tape import Stage, Tape, signed

# Names and literals in one line, at most: keeps statements short enough to be read.
_LEAVES = 7


@dataclass(frozen=True)
class Slice:
    """A function before it is lowered: its name, its arguments, and its output arrays."""

    name: str
    arguments: tuple[str, ...]
    outputs: tuple[tuple[tuple[int, ...], tuple[sp.Expr, ...]], ...]


def lower(
    tape: Tape,
    inputs: Mapping[str, tuple[str, ...]],
    parameters: Sequence[str],
    slices: Sequence[Slice],
) -> Program:
    """Lower every slice of the tape into one program.

    Of `parameters` the program has those that a function depends on, in the same order.
    """
    lowering = _Lowering(tape)
    drafts = [lowering.draft(piece) for piece in slices]
    needed = {symbol for draft in drafts for symbol in draft.constants}
    prepare = lowering.reachable(needed, Stage.PARAMETER)
    # Numbered from 1 in the order of `prepare`, so that the emitted names have no gaps.
    names = {symbol.name: f"k{i}" for i, symbol in enumerate(prepare, start=1)}
    constants: dict[str, Node] = {old: Name(new) for old, new in names.items()}
    read = {s.name for s in needed.union(*(tape.statements[s].free_symbols for s in prepare))}
    return Program(
        inputs=dict(inputs),
        parameters=tuple(name for name in parameters if name in read),
        constants=tuple(names.get(s.name, s.name) for s in lowering.in_order(needed)),
        prepare=tuple(
            Statement(
                names[s.name],
                _replaced(lowering.node(tape.statements[s]), constants),
                tape.groups[s],
            )
            for s in prepare
        ),
        functions=tuple(
            Function(
                draft.piece.name,
                draft.piece.arguments,
                tuple(names.get(s.name, s.name) for s in lowering.in_order(draft.constants)),
                *_renamed(draft, constants),
            )
            for draft in drafts
        ),
    )


def operations(tape: Tape, entries: Sequence[sp.Expr]) -> int:
    """Operations that a function with these entries takes, sine–cosine pairs apart."""
    draft = _Lowering(tape).draft(Slice("", (), (((len(entries),), tuple(entries)),)))
    nodes = (*(s.value for s in draft.statements), *dict.fromkeys(draft.outputs[0].entries))
    return count_operations(nodes).total


@dataclass(frozen=True)
class _Draft:
    """A function with the tape's own names, and the symbols of the parameter stage it reads."""

    piece: Slice
    constants: set[sp.Symbol]
    statements: list[Statement]
    outputs: list[Output]


class _Lowering:
    """Lowers statements, remembering what it has lowered."""

    def __init__(self, tape: Tape) -> None:
        self._tape = tape
        self._nodes: dict[sp.Expr, Node] = {}
        self._ages: dict[str, int] = {}
        self._uses: dict[sp.Symbol, tuple[sp.Symbol, ...]] = {}

    def in_order(self, symbols: set[sp.Symbol]) -> list[sp.Symbol]:
        return sorted(symbols, key=self._tape.rank)

    def draft(self, piece: Slice) -> _Draft:
        """Lower one slice, with what is used once written where it is used."""
        tape = self._tape
        roots = {symbol for _, output in piece.outputs for e in output for symbol in e.free_symbols}
        order = self.reachable(roots, Stage.CONFIGURATION)
        read = roots.union(*(self._operands(symbol) for symbol in order))
        constants = {symbol for symbol in read if tape.stage(symbol) is Stage.PARAMETER}
        statements = [
            Statement(s.name, self.node(tape.statements[s]), tape.groups[s]) for s in order
        ]
        outputs = [
            Output(shape, tuple(self.node(entry) for entry in output))
            for shape, output in piece.outputs
        ]
        return _Draft(piece, constants, _folded(statements, outputs), outputs)

    def reachable(self, roots: set[sp.Symbol], earliest: Stage) -> list[sp.Symbol]:
        """Statements that `roots` need, back to stage `earliest`, in the tape's order."""
        tape = self._tape
        found: set[sp.Symbol] = set()
        stack = list(roots)
        while stack:
            symbol = stack.pop()
            if symbol in found or symbol not in tape.statements or tape.stage(symbol) < earliest:
                continue
            found.add(symbol)
            stack.extend(self._operands(symbol))
        return self.in_order(found)

    def _operands(self, symbol: sp.Symbol) -> tuple[sp.Symbol, ...]:
        if symbol not in self._uses:
            self._uses[symbol] = tuple(self._tape.statements[symbol].free_symbols)
        return self._uses[symbol]

    def node(self, expression: sp.Expr) -> Node:
        """Plain node of a tape expression."""
        if expression not in self._nodes:
            self._nodes[expression] = self._lowered(expression)
        return self._nodes[expression]

    def _lowered(self, expression: sp.Expr) -> Node:
        if expression.is_Symbol:
            self._ages[expression.name] = self._tape.rank(expression)
            return Name(expression.name)
        if expression.is_number:
            return Number(float(sp.N(expression, 30)))
        if expression.is_Add:
            return self._sum(expression)
        if expression.is_Mul:
            return self._product(expression)
        if expression.is_Pow:
            base, exponent = expression.args
            if exponent == -1:
                return Reciprocal(self.node(base))
            return Product((self.node(base),) * int(exponent))
        return Call(expression.func.__name__, self.node(expression.args[0]))

    def _sum(self, expression: sp.Expr) -> Sum:
        terms = []
        for term in expression.args:
            sign, rest = signed(term)
            terms.append((sign, self.node(rest)))
        # Positive terms first, oldest names first: a line then seldom begins with a minus sign.
        terms.sort(key=lambda term: (-term[0], self._age(term[1])))
        return Sum(tuple(terms))

    def _product(self, expression: sp.Expr) -> Node:
        number, factors = expression.as_coeff_Mul()
        if number.is_negative:
            return Sum(((-1, self.node(-expression)),))
        nodes: list[Node] = [] if number == 1 else [self.node(number)]
        for factor in sp.Mul.make_args(factors):
            node = self.node(factor)
            nodes.extend(node.factors if isinstance(node, Product) else (node,))
        numbers = [node.value for node in nodes if isinstance(node, Number)]
        names = sorted((n for n in nodes if not isinstance(n, Number)), key=self._age)
        if len(numbers) > 1:
            return Product((Number(float(sp.N(number * _numeric(factors), 30))), *names))
        return Product((*map(Number, numbers), *names))

    def _age(self, node: Node) -> int:
        return self._ages[node.name] if isinstance(node, Name) else -1


def _numeric(factors: sp.Expr) -> sp.Expr:
    return sp.Mul(*(factor for factor in sp.Mul.make_args(factors) if factor.is_number))


def _folded(statements: list[Statement], outputs: list[Output]) -> list[Statement]:
    """Write what is used once where it is used, as long as the line stays short."""
    uses: Counter[str] = Counter()
    for statement in statements:
        uses.update(names_in(statement.value))
    for output in outputs:
        for entry in output.entries:
            # An output entry keeps its name: what is returned twice must not be computed twice.
            uses.update(dict.fromkeys(names_in(entry), 2))
    pending: dict[str, Node] = {}
    kept = []
    for statement in statements:
        value = _substituted(statement.value, pending)
        if uses[statement.name] == 1 and not isinstance(value, Call | Reciprocal):
            pending[statement.name] = value
            continue
        kept.append(replace(statement, value=value))
    return _spilled(kept, pending, statements)


def _substituted(node: Node, pending: Mapping[str, Node]) -> Node:
    """`node` with pending definitions written in, the shortest first, while the line is short."""
    names = [name for name in dict.fromkeys(names_in(node)) if name in pending]
    room = _LEAVES - _leaves(node)
    chosen: dict[str, Node] = {}
    for name in sorted(names, key=lambda name: _leaves(pending[name])):
        cost = _leaves(pending[name]) - 1
        if cost <= room:
            chosen[name] = pending[name]
            room -= cost
    return _replaced(node, chosen) if chosen else node


def _spilled(
    kept: list[Statement], pending: Mapping[str, Node], statements: list[Statement]
) -> list[Statement]:
    """Restore, in place, the definitions of pending names that found no room."""
    used = {name for statement in kept for name in names_in(statement.value)}
    missing = [name for name in used if name in pending]
    needed = set()
    while missing:
        name = missing.pop()
        if name not in needed:
            needed.add(name)
            missing.extend(n for n in names_in(pending[name]) if n in pending)
    values = {statement.name: statement.value for statement in kept}
    values.update({name: pending[name] for name in needed})
    return [replace(s, value=values[s.name]) for s in statements if s.name in values]


def _replaced(node: Node, values: Mapping[str, Node]) -> Node:
    match node:
        case Name(name):
            return values.get(name, node)
        case Number():
            return node
        case Sum(terms):
            return Sum(tuple(_merged_terms(terms, values)))
        case Product(factors):
            return _merged_product([_replaced(factor, values) for factor in factors])
        case Reciprocal(argument):
            return Reciprocal(_replaced(argument, values))
        case Call(function, argument):
            return Call(function, _replaced(argument, values))


def _merged_product(factors: Sequence[Node]) -> Product:
    """Factors with products among them opened up, numbers first."""
    merged: list[Node] = []
    for factor in factors:
        merged.extend(factor.factors if isinstance(factor, Product) else (factor,))
    return Product(tuple(sorted(merged, key=lambda factor: not isinstance(factor, Number))))


def _merged_terms(
    terms: tuple[tuple[int, Node], ...], values: Mapping[str, Node]
) -> list[tuple[int, Node]]:
    """Terms with sums among them opened up: a + (b − c) is a + b − c, and no more work."""
    merged: list[tuple[int, Node]] = []
    for sign, term in terms:
        value = _replaced(term, values)
        if isinstance(value, Sum):
            merged.extend((sign * inner, node) for inner, node in value.terms)
        else:
            merged.append((sign, value))
    return sorted(merged, key=lambda term: -term[0])


def _renamed(
    draft: _Draft, constants: Mapping[str, Node]
) -> tuple[tuple[Statement, ...], tuple[Output, ...]]:
    """Number the temporaries of a function from 1, so that each function reads by itself."""
    names = dict(constants)
    names.update({s.name: Name(f"t{i}") for i, s in enumerate(draft.statements, start=1)})
    statements = tuple(
        Statement(f"t{i}", _replaced(statement.value, names), statement.group)
        for i, statement in enumerate(draft.statements, start=1)
    )
    outputs = tuple(
        Output(output.shape, tuple(_replaced(entry, names) for entry in output.entries))
        for output in draft.outputs
    )
    return statements, outputs


def _leaves(node: Node) -> int:
    match node:
        case Sum(terms):
            return sum(_leaves(term) for _, term in terms)
        case Product(factors):
            return sum(map(_leaves, factors))
        case Reciprocal(argument) | Call(_, argument):
            return _leaves(argument)
        case Name() | Number():
            return 1
