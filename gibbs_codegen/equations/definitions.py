"""A tape read as a list of definitions, which a reader can follow, not as one long expression.

Closed forms grow about threefold with every link, a tape grows in proportion to the links and to
the entries wanted. Statements that are short, or read only once, are put in place of their names;
the rest become numbered quantities, in order. Quantities with a meaning, such as the components of
ω, keep their own names wherever they are read.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

import sympy as sp

from gibbs_codegen.equations.typeset import Kind, Name, name
from gibbs_codegen.symbolic.tape import Tape, signed

Definition = tuple[sp.Symbol, sp.Expr]

# Leaves of a statement that is repeated wherever it is read, and of one that is read once.
_SHORT = 2
_LONG = 16


class Definitions:
    """Definitions made from a tape for `outputs`, the expressions that are wanted in the end.

    `made` holds them in an order in which each reads earlier ones only.
    """

    def __init__(self, tape: Tape, outputs: Iterable[sp.Expr]) -> None:
        self.made: list[Definition] = []
        self._tape = tape
        self._values: dict[sp.Symbol, sp.Expr] = {}
        self._readers = _readers(tape, outputs)
        self._numbered = 0

    def name(self, symbol: sp.Symbol, value: sp.Expr) -> None:
        """Define `symbol` as what the tape has for `value`, and read it in its place from now on.

        A value that is a number, a symbol or already has a name is defined, but read by that.
        """
        sign, original = signed(value)
        if original in self._values or original not in self._tape.statements:
            self.made.append((symbol, self.expression(value)))
            return
        expression = self.expression(self._tape.statements[original])
        self.made.append((symbol, sign * expression))
        if not signed(expression)[1].is_Symbol:
            self._values[original] = sign * symbol

    def expression(self, value: sp.Expr) -> sp.Expr:
        """A value in names, and numbered quantities, which are defined as need be."""
        symbols = _symbols(value)
        for symbol in symbols:
            statement = self._tape.statements.get(symbol)
            if statement is None or symbol in self._values:
                continue
            is_angle = isinstance(statement, (sp.sin, sp.cos))
            expanded = self._angle(statement) if is_angle else self.expression(statement)
            leaves = _count_leaves(expanded)
            if leaves > _LONG or (leaves > _SHORT and self._readers[symbol] > 1):
                self._numbered += 1
                numbered = sp.Symbol(f"h_{self._numbered}")
                self.made.append((numbered, expanded))
                expanded = numbered
            self._values[symbol] = expanded
        return value.xreplace({symbol: self._values.get(symbol, symbol) for symbol in symbols})

    def _angle(self, expression: sp.Expr) -> sp.Expr:
        """A sine or cosine, whose angle is never a numbered quantity."""
        statements = self._tape.statements
        inner = {s: self._angle(statements[s]) for s in _symbols(expression) if s in statements}
        return expression.xreplace(inner)


def _symbols(expression: sp.Expr) -> Sequence[sp.Symbol]:
    """Symbols of an expression in the order in which they stand in it, which is always the same."""
    return [node for node in sp.preorder_traversal(expression) if node.is_Symbol]


def _readers(tape: Tape, outputs: Iterable[sp.Expr]) -> Counter[sp.Symbol]:
    """The number of readers of each statement that the outputs need."""
    readers: Counter[sp.Symbol] = Counter()
    for output in outputs:
        readers.update(_symbols(output))
    for symbol, expression in reversed(tape.statements.items()):
        if readers[symbol]:
            readers.update(set(_symbols(expression)))
    return readers


def _count_leaves(expression: sp.Expr) -> int:
    if not expression.args or isinstance(expression, (sp.sin, sp.cos)):
        return 1
    return sum(map(_count_leaves, expression.args))


def step_names(lines: Iterable[Definition]) -> dict[sp.Symbol, Name]:
    """Names, by symbol, of the quantities that definitions number."""
    return {
        symbol: name("h", symbol.name.removeprefix("h_"), Kind.STEP, "")
        for symbol, _ in lines
        if symbol.name.startswith("h_")
    }
