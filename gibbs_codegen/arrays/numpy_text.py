"""Array programs as NumPy: what calls functions of a module, matrices and sums.

Arrays have any leading axes, which broadcast. A number has one axis of its own, of one entry.
"""

from __future__ import annotations

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.nodes import Node, numbers_of
from gibbs_codegen.arrays.text import PRODUCT, WHOLE, ArrayText, Text
from gibbs_codegen.errors import UsageError


class NumpyText(ArrayText):
    """The statements of a program with NumPy."""

    reserved = ("constants", "np")
    unread = "_"

    def lines(self) -> list[str]:
        """Statements, and one that returns the outputs."""
        lines = []
        for words, targets, value in self.statements():
            lines += [f"# {words}"] if words else []
            lines.append(f"{', '.join(targets)} = {value}")
        return [*lines, f"return {', '.join(self.results())}"]

    def results(self) -> list[str]:
        """Expressions of the outputs; what is zero has the leading axes of another one."""
        outputs = self.program.outputs.values()
        other = next(x for x in outputs if not isinstance(x.operation, nodes.Constant))
        lead = f"*{self.expression(other).within(WHOLE)}.shape[:-{len(other.shape)}]"
        return [
            f"np.zeros(({lead}, {', '.join(map(str, x.shape))}))"
            if nodes.is_all(x, 0.0)
            else self.expression(x).text
            for x in outputs
        ]

    def operand(self, y: Node, x: Node) -> Text:
        """An argument of an elementary function; a number has as many axes as its result."""
        return self._with_axes(y, len(x.shape))

    def _with_axes(self, y: Node, axes: int) -> Text:
        if y.shape or isinstance(y.operation, nodes.Constant) or axes < 2:
            return self.expression(y)
        return Text(f"{self.expression(y).within(WHOLE)}[..., {', '.join(['None'] * (axes - 1))}]")

    def operation(self, x: Node) -> Text:
        """An operation as NumPy has it."""
        inner = x.arguments
        match x.operation:
            case nodes.Constant():
                return self._constant(x)
            case nodes.Contraction() if len(inner[0].shape) == len(inner[1].shape) == 2:
                one, two = map(self.expression, inner)
                return Text(f"{one.within(PRODUCT)} @ {two.within(WHOLE)}", PRODUCT)
            case nodes.Reshaping() if not inner[0].shape:
                return self._with_axes(inner[0], len(x.shape))
            case nodes.RowRange(begin, end):
                rest = ", :" * (len(x.shape) - 1)
                return Text(f"{self.expression(inner[0]).within(WHOLE)}[..., {begin}:{end}{rest}]")
            case nodes.Transposition():
                return self._transposed(x)
            case nodes.Joining() if len(x.shape) == 2:
                pieces = [self.expression(piece).text for piece in inner]
                return Text(f"_joined(-2, {', '.join(pieces)})")
            case nodes.Call(_, name):
                arguments = [self.expression(y).text for y in inner]
                return Text(f"{name}({', '.join([*arguments, 'constants'])})")
        raise UsageError(f"{self.program.name}: {x} is not written in NumPy")

    def _constant(self, x: Node) -> Text:
        """Numbers: of a vector or matrix zeros, or a diagonal."""
        numbers = numbers_of(x)
        assert numbers is not None  # noqa: S101 - it is a constant
        if x.size == 1:
            return Text(repr(float(numbers.flat[0])))
        if not numbers.any():
            return Text(f"np.zeros({x.shape})")
        if diagonal := nodes.diagonal_of(x):
            (rows, columns), (shift, value) = x.shape, diagonal
            sizes = [rows, *([columns] if shift or rows != columns else [])]
            sizes += [shift] if shift else []
            unit = f"np.eye({', '.join(map(str, sizes))})"
            return Text(unit) if value == 1.0 else Text(f"{value!r} * {unit}", PRODUCT)
        raise UsageError(f"{self.program.name}: {x} is not written in NumPy")

    def _transposed(self, x: Node) -> Text:
        """Columns of a matrix, or matrices side by side."""
        (inner,) = x.arguments
        if isinstance(inner.operation, nodes.Joining):
            pieces = [self.expression(nodes.transposed(y, (1, 0))).text for y in inner.arguments]
            return Text(f"_joined(-1, {', '.join(pieces)})")
        if isinstance(inner.operation, nodes.RowRange):
            columns = f"{inner.operation.begin}:{inner.operation.end}"
            matrix = nodes.transposed(inner.arguments[0], (1, 0))
            text = self.expression(matrix).within(WHOLE)
            if isinstance(matrix.operation, nodes.RowRange):
                return Text(f"{text.removesuffix(':]')}{columns}]")
            return Text(f"{text}[..., {columns}]")
        raise UsageError(f"{self.program.name}: {x} is not written in NumPy")
