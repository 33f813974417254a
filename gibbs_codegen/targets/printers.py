"""Printers: a node of the program as an expression of a language."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, assert_never

from gibbs_codegen.program import nodes
from gibbs_codegen.program.nodes import Call, Name, Node, Number, Product, Reciprocal, Sum
from gibbs_codegen.program.steps import headed

# Lines of a text, without their ends; and what a template, or a part of it, reads by name.
Lines = list[str]
Context = dict[str, Any]


class InfixPrinter:
    """Prints nodes with + − * / and calls, as Python, C and most languages write them.

    A language that differs overrides `name`, `number` or `call`, or has other signs.
    """

    TIMES = "*"
    OVER = "/"

    def name(self, name: str) -> str:
        """A variable of the language, by what the program calls it."""
        return name

    def number(self, value: float) -> str:
        """A literal of the language that reads back as the same double."""
        return repr(value)

    def call(self, function: str, argument: str) -> str:
        """A call of a function of `nodes.Call`, its argument as text."""
        return f"{function}({argument})"

    def expression(self, node: Node) -> str:
        """A node as an expression without outer parentheses."""
        match node:
            case Name(name):
                return self.name(name)
            case Number(value):
                return self.number(value)
            case Sum(terms):
                text = ""
                for sign, term in terms:
                    operator = "-" if sign < 0 else "+" if text else ""
                    space = " " if text else ""
                    inner = self.expression(term)
                    inner = f"({inner})" if isinstance(term, Sum) or inner[0] == "-" else inner
                    text += f"{space}{operator}{space}{inner}"
                return text
            case Product(factors):
                return f" {self.TIMES} ".join(map(self._factor, factors))
            case Reciprocal(argument):
                divisor = self._factor(argument)
                divisor = f"({divisor})" if isinstance(argument, Product) else divisor
                return f"{self.number(1.0)} {self.OVER} {divisor}"
            case Call(function, argument):
                return self.call(function, self.expression(argument))
            case _:
                assert_never(node)

    def _factor(self, node: Node) -> str:
        text = self.expression(node)
        compound = text[0] == "-" or isinstance(node, (Sum, Reciprocal))
        return f"({text})" if compound else text


class StatementPrinter:
    """Prints statements that compute: right-hand sides are nodes, printed by `expressions`.

    Every language has comments of its own, and breaks long assignments in its own way. Lines are
    without their indentation.
    """

    COMMENT = "# {}"

    def __init__(self, expressions: InfixPrinter) -> None:
        self._expressions = expressions

    def assign(self, name: str, value: Node) -> Lines:
        """A local variable."""
        raise NotImplementedError

    def assign_all(self, statements: Iterable[nodes.Statement]) -> Lines:
        """Local variables, with a comment above each group."""
        lines: Lines = []
        for words, statement in headed(statements):
            lines += self.comment(words)
            lines += self.assign(self._expressions.name(statement.name), statement.value)
        return lines

    def comment(self, words: str) -> Lines:
        """A comment above a group of statements, after an empty line; none for ""."""
        return ["", self.COMMENT.format(words)] if words else []


class CPrinter(InfixPrinter):
    """Prints nodes as C, with every literal of the type that the module is compiled for."""

    def number(self, value: float) -> str:
        """A literal, of 17 digits at most, within the macro that gives it its type."""
        return f"-R({c_literal(-value)})" if value < 0 else f"R({c_literal(value)})"

    def call(self, function: str, argument: str) -> str:
        """A call of a function of <math.h>, by the macro that takes the one of the right type.

        The function is "sqrt", "atan" or "sign": sines and cosines are computed before.
        """
        if function == "atan":
            return f"arctangent({argument})"
        if function == "sign":
            return f"LIBRARY(copysign)({self.number(1.0)}, {argument})"
        return f"LIBRARY({function})({argument})"


def c_literal(value: float) -> str:
    """A floating literal of C, of 17 digits at most, that reads back as the same double."""
    text = format(value, ".17g")
    return text if "." in text or "e" in text else f"{text}.0"
