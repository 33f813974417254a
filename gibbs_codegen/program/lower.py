"""Lowering: from the tape to the program, one slice of the tape per function, in plain nodes.

    h1 = 2*p              (stage of the parameters)
    h2 = sin(x)           (stage of the configuration)
    h3 = y/p              (stage of the configuration, and no output needs it)
    out = [h1*h2*h2]

becomes `k1 = 2*p` in `prepare`, which all functions share and which runs once per set of
parameters, and `t1 = sin(x)`, `out = [k1*t1*t1]` in the function. A function takes from the tape
the statements that its outputs need, in the tape's order.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import sympy as sp

from gibbs_codegen.program.inlining import inline_single_uses, substituted
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
)
from gibbs_codegen.program.operations import count_operations
from gibbs_codegen.symbolic.quick import signed
from gibbs_codegen.symbolic.tape import Stage, Tape


@dataclass(frozen=True)
class Slice:
    """A function before it is lowered: its name, its arguments, and its output arrays.

    `groups` has the words of the groups as this function's derivation says them; other statements
    have those of the tape.
    """

    name: str
    arguments: tuple[str, ...]
    outputs: tuple[tuple[tuple[int, ...], tuple[sp.Expr, ...]], ...]
    groups: Mapping[sp.Symbol, str] = field(default_factory=dict)


def lower(
    tape: Tape,
    inputs: Mapping[str, tuple[str, ...]],
    parameters: Sequence[str],
    slices: Sequence[Slice],
) -> Program:
    """Lower every slice of the tape into one program.

    Args:
        tape: The tape.
        inputs: Names of the scalars in each argument.
        parameters: Names of all parameters, in order.
        slices: The functions.

    Returns:
        The program. Of `parameters` it has those that a function depends on.
    """
    lowering = _Lowering(tape)
    drafts = [lowering.draft(piece) for piece in slices]
    needed = set().union(*(draft.constants for draft in drafts))
    prepare = lowering.reachable(needed, Stage.PARAMETER)
    # Numbered from 1 in the order of `prepare`, so that the emitted names have no gaps.
    names = {name: f"k{i}" for i, name in enumerate(prepare, start=1)}
    constants: dict[str, Node] = {old: Name(new) for old, new in names.items()}
    read = needed.union(*(lowering.operands(name) for name in prepare))
    return Program(
        inputs=dict(inputs),
        parameters=tuple(name for name in parameters if name in read),
        constants=tuple(names.get(name, name) for name in lowering.in_order(needed)),
        prepare=tuple(
            Statement(
                names[name], substituted(lowering.value(name), constants), lowering.groups[name]
            )
            for name in prepare
        ),
        functions=tuple(
            Function(
                draft.piece.name,
                draft.piece.arguments,
                tuple(names.get(name, name) for name in lowering.in_order(draft.constants)),
                *_renamed(draft, constants),
            )
            for draft in drafts
        ),
    )


def operations(tape: Tape, entries: Sequence[sp.Expr]) -> int:
    """Operations that a function with certain entries takes.

    Args:
        tape: The tape.
        entries: What the function returns.

    Returns:
        All operations but the sine–cosine pairs.
    """
    draft = _Lowering(tape).draft(Slice("", (), (((len(entries),), tuple(entries)),)))
    nodes = (*(s.value for s in draft.statements), *dict.fromkeys(draft.outputs[0].entries))
    return count_operations(nodes).total


@dataclass(frozen=True)
class _Draft:
    """A function with the tape's own names, and those of the parameter stage that it reads."""

    piece: Slice
    constants: set[str]
    statements: list[Statement]
    outputs: list[Output]


class _Lowering:
    """Lowers statements, remembering what it has lowered. It knows symbols by their names."""

    def __init__(self, tape: Tape) -> None:
        self._nodes: dict[sp.Expr, Node] = {}
        self._stages = {symbol.name: stage for symbol, stage in tape.stages.items()}
        self._ages = {name: age for age, name in enumerate(self._stages)}
        self._expressions = {symbol.name: value for symbol, value in tape.statements.items()}
        self._values: dict[str, Node] = {}
        self.groups = {symbol.name: words for symbol, words in tape.groups.items()}

    def in_order(self, names: Iterable[str]) -> list[str]:
        return sorted(names, key=self._ages.__getitem__)

    def value(self, name: str) -> Node:
        """What a temporary is defined as."""
        if name not in self._values:
            self._values[name] = self.node(self._expressions[name])
        return self._values[name]

    def draft(self, piece: Slice) -> _Draft:
        """Lower one slice, with what is used once written where it is used."""
        outputs = [
            Output(shape, tuple(self.node(entry) for entry in output))
            for shape, output in piece.outputs
        ]
        roots = {name for output in outputs for entry in output.entries for name in entry.names}
        order = self.reachable(roots, Stage.CONFIGURATION)
        read = roots.union(*(self.operands(name) for name in order))
        constants = {name for name in read if self._stages[name] is Stage.PARAMETER}
        said = {symbol.name: words for symbol, words in piece.groups.items()}
        statements = [
            Statement(name, self.value(name), said.get(name, self.groups[name])) for name in order
        ]
        return _Draft(piece, constants, inline_single_uses(statements, outputs), outputs)

    def reachable(self, roots: set[str], earliest: Stage) -> list[str]:
        """Statements that `roots` need, back to stage `earliest`, in the tape's order."""
        found: set[str] = set()
        stack = list(roots)
        while stack:
            name = stack.pop()
            if name in found or name not in self._expressions or self._stages[name] < earliest:
                continue
            found.add(name)
            stack.extend(self.operands(name))
        return self.in_order(found)

    def operands(self, name: str) -> tuple[str, ...]:
        """Names that the definition of a temporary reads."""
        return self.value(name).names

    def node(self, expression: sp.Expr) -> Node:
        """Plain node of a tape expression."""
        if expression not in self._nodes:
            self._nodes[expression] = self._lowered(expression)
        return self._nodes[expression]

    def _lowered(self, expression: sp.Expr) -> Node:
        if expression.is_Symbol:
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
            if exponent is sp.S.Half:
                return Call("sqrt", self.node(base))
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


def _renamed(
    draft: _Draft, constants: Mapping[str, Node]
) -> tuple[tuple[Statement, ...], tuple[Output, ...]]:
    """Number the temporaries of a function from 1, so that each function reads by itself."""
    names = dict(constants)
    names.update({s.name: Name(f"t{i}") for i, s in enumerate(draft.statements, start=1)})
    statements = tuple(
        Statement(f"t{i}", substituted(statement.value, names), statement.group)
        for i, statement in enumerate(draft.statements, start=1)
    )
    outputs = tuple(
        Output(output.shape, tuple(substituted(entry, names) for entry in output.entries))
        for output in draft.outputs
    )
    return statements, outputs
