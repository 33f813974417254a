"""Printers: a node of the program as an expression of a language."""

from __future__ import annotations

from typing import assert_never

from gibbs_codegen.program.nodes import Call, Name, Node, Number, Product, Reciprocal, Sum


class InfixPrinter:
    """Prints nodes with + − * / and calls, as Python, C and most languages write them.

    A language that differs overrides `name`, `number` or `call`, or has other signs.
    """

    TIMES = "*"
    OVER = "/"

    def name(self, name: str) -> str:
        """A variable of the language.

        Args:
            name: What the program calls it.

        Returns:
            What it is called in the language.
        """
        return name

    def number(self, value: float) -> str:
        """A literal of the language.

        Args:
            value: Its value.

        Returns:
            Text that reads back as the same double.
        """
        return repr(value)

    def call(self, function: str, argument: str) -> str:
        """A call of a function.

        Args:
            function: One of those of `nodes.Call`.
            argument: The number that it takes, as text.

        Returns:
            The call as text.
        """
        return f"{function}({argument})"

    def expression(self, node: Node) -> str:
        """A node as an expression.

        Args:
            node: What is computed.

        Returns:
            Text without outer parentheses.
        """
        match node:
            case Name(name):
                return self.name(name)
            case Number(value):
                return self.number(value)
            case Sum(terms):
                return self._sum(terms)
            case Product(factors):
                return f" {self.TIMES} ".join(map(self._factor, factors))
            case Reciprocal(argument):
                return f"{self.number(1.0)} {self.OVER} {self._divisor(argument)}"
            case Call(function, argument):
                return self.call(function, self.expression(argument))
            case _:
                assert_never(node)

    def _sum(self, terms: tuple[tuple[int, Node], ...]) -> str:
        text = ""
        for sign, term in terms:
            operator = "-" if sign < 0 else "+" if text else ""
            space = " " if text else ""
            text += f"{space}{operator}{space}{self._term(term)}"
        return text

    def _divisor(self, node: Node) -> str:
        text = self._factor(node)
        return f"({text})" if isinstance(node, Product) else text

    def _term(self, node: Node) -> str:
        text = self.expression(node)
        return f"({text})" if isinstance(node, Sum) or text.startswith("-") else text

    def _factor(self, node: Node) -> str:
        text = self.expression(node)
        compound = isinstance(node, Sum | Reciprocal) or text.startswith("-")
        return f"({text})" if compound else text


class CPrinter(InfixPrinter):
    """Prints nodes as C, with every literal of the type that the module is compiled for."""

    def number(self, value: float) -> str:
        """A literal within the macro that gives it its type.

        Args:
            value: Its value.

        Returns:
            Text of 17 digits at most.
        """
        return f"-R({c_literal(-value)})" if value < 0 else f"R({c_literal(value)})"

    def call(self, function: str, argument: str) -> str:
        """A call of a function of <math.h>, by the macro that takes the one of the right type.

        Args:
            function: "sqrt", "atan" or "sign": sines and cosines are computed before.
            argument: The number that it takes, as text.

        Returns:
            The call as text.
        """
        if function == "sign":
            return f"LIBRARY(copysign)({self.number(1.0)}, {argument})"
        return f"LIBRARY({function})({argument})"


def c_literal(value: float) -> str:
    """A floating literal of C.

    Args:
        value: Its value.

    Returns:
        Text of 17 digits at most, which reads back as the same double.
    """
    text = format(value, ".17g")
    return text if "." in text or "e" in text else f"{text}.0"
