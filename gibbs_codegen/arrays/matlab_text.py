"""Array programs as MATLAB and GNU Octave: functions of one state, and statements for many.

Arrays of one state have the axes that they have in a program; vectors are columns. Of many states
numbers are rows, vectors have a column and matrices a page for each state.
"""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from gibbs_codegen.arrays import nodes
from gibbs_codegen.arrays.contents import check_distinct, externals_of, owners_of
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program, Shape, numbers_of
from gibbs_codegen.arrays.text import PRODUCT, WHOLE, ArrayText, Text
from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.line_breaks import INDENT, WIDTH, broken
from gibbs_codegen.files.staging import writing
from gibbs_codegen.version import __version__

_CONTINUED = " ..."
# Functions that have another name than in NumPy.
_FUNCTIONS = {"minimum": "min", "maximum": "max", "absolute": "abs", "arctan2": "atan2"}
# Names that no variable may have: words, and functions that the text calls.
_TAKEN = """
    break case catch continue do else elseif end for function global if otherwise persistent return
    switch try until while abs atan2 choose constants copysign cos count exp eye max min nargin
    narginchk permute repmat reshape sin size sqrt sum zeros
"""
_BY_HAND = {
    "choose": """
function value = choose(a, b, above, other)
    spread = zeros(size(a + b + above + other));
    is_above = a + spread > b;
    above = above + spread;
    value = other + spread;
    value(is_above) = above(is_above);
end
""",
    "copysign": """
function value = copysign(a, sign)
    is_negative = sign < 0.0 | 1.0 ./ sign < 0.0;
    value = abs(a) .* (1.0 - 2.0 .* is_negative);
end
""",
}


def continued(text: str) -> list[str]:
    """A statement of the body of a function, in several lines where it is long."""
    if len(text) <= WIDTH - INDENT:
        return [text]
    lines = broken(text, WIDTH - INDENT - len(_CONTINUED), whole=r"\([^()]{,30}\)")
    return [*(f"{line}{_CONTINUED}" for line in lines[:-1]), lines[-1]]


class MatlabText(ArrayText):
    """The statements of a program for one state."""

    times, over, unread = ".*", "./", "~"

    def __init__(self, program: Program) -> None:
        self.programs = [*program.inner, program]
        operations = (x.operation for part in self.programs for x in part.nodes)
        owners = (x.functions for x in operations if isinstance(x, nodes.Call))
        self.packages = {functions.owner: functions.name for functions in owners}
        self.reserved = (*_TAKEN.split(), *self.packages.values(), *(x.name for x in self.programs))
        super().__init__(program)

    def lines(self) -> list[str]:
        """Statements, of which the last give the outputs their values."""
        lines = []
        for words, targets, value in self.statements():
            lines += textwrap.wrap(words, WIDTH - INDENT, initial_indent="% ") if words else []
            left = targets[0] if len(targets) == 1 else f"[{', '.join(targets)}]"
            lines += continued(f"{left} = {value};")
        for name, value in zip(self.program.outputs, self.results(), strict=True):
            lines += continued(f"{name} = {value};") if name != value else []
        return lines

    def function(self, opening: Iterable[str] = ()) -> str:
        """The program as a function of MATLAB, whose body some lines open."""
        body = [f"    {line}" for line in self.lines()]
        return "\n".join([*continued(f"function {self.heading}"), *opening, *body, "end\n"])

    @property
    def heading(self) -> str:
        """The call of the function."""
        outputs = [*self.program.outputs]
        results = outputs[0] if len(outputs) == 1 else f"[{', '.join(outputs)}]"
        arguments = [*self.program.names, *self.constants(self.program)]
        return f"{results} = {self.program.name}({', '.join(arguments)})"

    def constants(self, program: Program) -> list[str]:
        """Names of the constants that a program within this one is given."""
        return [self._constants_of(owner) for owner in owners_of(program)]

    def _is_named(self, x: Node) -> bool:
        looks = (nodes.Input, nodes.Entries, nodes.Coordinates)
        is_other = not isinstance(x.operation, looks)
        return super()._is_named(x) or (is_other and self._is_indexed(x))

    def _is_indexed(self, x: Node) -> bool:
        """True if rows or columns are taken of a node, which no expression has in MATLAB."""
        if isinstance(x.operation, nodes.RowRange) or self._gives_columns(x):
            return False
        return any(
            isinstance(y.operation, nodes.RowRange)
            or (isinstance(y.operation, nodes.Entries | nodes.Coordinates) and self._is_indexed(y))
            or self._gives_columns(y)
            for y in self.readers.get(x, ())  # Pieces that are turned have none.
        )

    def _gives_columns(self, x: Node) -> bool:
        """True if a node is a transposed matrix whose rows are read as columns alone."""
        readers = self.readers.get(x, [])
        is_turned = isinstance(x.operation, nodes.Transposition) and bool(readers)
        return is_turned and all(
            isinstance(part.operation, nodes.RowRange)
            and not self.names.has(part)
            and all(isinstance(y.operation, nodes.Transposition) for y in self.readers[part])
            for part in readers
        )

    def operand(self, y: Node, x: Node) -> Text:
        """An argument of an elementary function: MATLAB's own rules let axes go together."""
        return self.expression(y)

    def operation(self, x: Node) -> Text:
        """An operation as MATLAB has it."""
        texts = [self.expression(y) for y in x.arguments]
        shapes = [y.shape for y in x.arguments]
        listed = ", ".join(text.text for text in texts)
        match x.operation:
            case nodes.Constant():
                return _literal(x)
            case nodes.Elementary(name):
                return Text(f"{_FUNCTIONS.get(name, name)}({listed})")
            case nodes.Contraction():
                return self.product(x, *texts)
            case nodes.Solution():
                return Text(f"{texts[0].within(WHOLE)} \\ {texts[1].within(WHOLE)}", PRODUCT)
            case nodes.RowRange(begin, end):
                return Text(f"{texts[0].text}({_range(begin, end)}{self.rest(x.shape)})")
            case nodes.Transposition(axes):
                return self.turned(x, axes)
            case nodes.Reshaping():
                return _by_rows(texts[0], shapes[0], x.shape)
            case nodes.Joining():
                return Text(f"[{'; '.join(text.text for text in texts)}]")
            case nodes.Total(axes):
                text = texts[0].text
                for axis in axes:
                    text = f"sum({text}, {axis + 1})"
                return Text(text)
            case nodes.Call(functions, name):
                called = [*(text.text for text in texts), self._constants_of(functions.owner)]
                return Text(f"{functions.name}.{name}({', '.join(called)})")
            case nodes.Invocation(program):
                called = [*(text.text for text in texts), *self.constants(program)]
                return Text(f"{program.name}({', '.join(called)})")
        raise UsageError(f"{self.program.name}: {x} is not written in MATLAB")

    def _constants_of(self, owner: str) -> str:
        return "constants" if len(self.packages) == 1 else f"{owner}_constants"

    def rest(self, shape: Shape) -> str:
        """The index for axes behind the first."""
        return ", :" * (len(shape) - 1)

    def product(self, x: Node, one: Text, two: Text) -> Text:
        """The sum over the last axis of the first and the first of the second argument."""
        left, right = (y.shape for y in x.arguments)
        first, second = one.within(PRODUCT), two.within(WHOLE)
        if len(left) == 1:
            first = f"{one.within(WHOLE)}.'"
        elif len(left) > 2:
            first = f"reshape({one.text}, [], {left[-1]})"
        if len(right) > 2:
            second = f"reshape({two.text}, {right[0]}, [])"
        text = Text(f"{first} * {second}", PRODUCT)
        if (len(left), len(right)) in ((1, 1), (2, 1), (2, 2)):
            return text
        return Text(f"reshape({text.text}, {_sizes(x.shape)})")

    def turned(self, x: Node, axes: tuple[int, ...]) -> Text:
        """A transposed array: columns of a matrix, or matrices side by side."""
        (inner,) = x.arguments
        if len(axes) > 2:
            order = " ".join(str(axis + 1) for axis in axes)
            return Text(f"permute({self.expression(inner).text}, [{order}])")
        if not self._is_named(inner):
            match inner.operation:
                case nodes.Joining():
                    pieces = [nodes.transposed(y, (1, 0)) for y in inner.arguments]
                    return Text(f"[{', '.join(self.expression(y).text for y in pieces)}]")
                case nodes.RowRange(begin, end) if self._gives_columns(inner.arguments[0]):
                    return self.columns(inner.arguments[0].arguments[0], begin, end)
        return Text(f"{self.expression(inner).within(WHOLE)}.'")

    def columns(self, matrix: Node, begin: int, end: int) -> Text:
        """Columns of a matrix, or of rows of it."""
        rows, rest = ":", self.rest(matrix.shape).removeprefix(", :")
        if isinstance(matrix.operation, nodes.RowRange) and not self._is_named(matrix):
            rows = _range(matrix.operation.begin, matrix.operation.end)
            (matrix,) = matrix.arguments
        return Text(f"{self.expression(matrix).text}({rows}, {_range(begin, end)}{rest})")


class MatlabPages(MatlabText):
    """The statements of a program for many states, of which `count` says how many there are."""

    def __init__(self, program: Program, product: str) -> None:
        super().__init__(program)
        self._product = product

    def operand(self, y: Node, x: Node) -> Text:
        """An argument of an elementary function; a number has pages where its result has."""
        if isinstance(y.operation, nodes.Constant) and y.size == 1:
            return _literal(y)
        return self._in_pages(y) if len(x.shape) == 2 else self.expression(y)

    def _in_pages(self, y: Node) -> Text:
        if y.shape:
            return self.expression(y)
        return Text(f"reshape({self.expression(y).text}, 1, 1, [])")

    def operation(self, x: Node) -> Text:
        """An operation as MATLAB has it, of matrices, vectors and numbers that have one entry."""
        match x.operation:
            case nodes.Constant() if len(x.shape) == 2:
                text = _literal(x).text
                if text.startswith("zeros("):
                    return Text(f"{text.removesuffix(')')}, count)")
                return Text(f"repmat({text}, 1, 1, count)")
            case nodes.Constant() | nodes.Elementary() | nodes.Call() | nodes.RowRange():
                return super().operation(x)
            case nodes.Contraction() | nodes.Joining() | nodes.Transposition() if len(x.shape) == 2:
                return super().operation(x)
            case nodes.Reshaping() if not x.arguments[0].shape and len(x.shape) == 2:
                return self._in_pages(x.arguments[0])
        raise UsageError(f"{self.program.name}: {x} is not written in MATLAB for many states")

    def product(self, x: Node, one: Text, two: Text) -> Text:
        """Products of matrices page by page, by a function."""
        return Text(f"{self._product}({one.text}, {two.text})")

    def rest(self, shape: Shape) -> str:
        """The index for axes behind the first, one of which has the states."""
        return ", :" * len(shape)


def _range(begin: int, end: int) -> str:
    return f"{begin + 1}:{end}" if end > begin + 1 else f"{end}"


def _sizes(shape: Shape) -> str:
    return ", ".join(map(str, (*shape, 1, 1)[: max(2, len(shape))]))


def _by_rows(entries: Text, shape: Shape, wanted: Shape) -> Text:
    """The same entries, row by row, in another shape."""
    if (*shape, 1, 1)[:2] == (*wanted, 1, 1)[:2] and max(len(shape), len(wanted)) < 3:
        return entries
    text = entries.text
    if sum(size != 1 for size in shape) > 1:
        text = f"permute({text}, [{' '.join(map(str, range(len(shape), 0, -1)))}])"
    if sum(size != 1 for size in wanted) < 2:
        return Text(f"reshape({text}, {_sizes(wanted)})")
    text = f"reshape({text}, {', '.join(map(str, reversed(wanted)))})"
    return Text(f"permute({text}, [{' '.join(map(str, range(len(wanted), 0, -1)))}])")


def _literal(x: Node) -> Text:
    """Numbers: those of zeros and of diagonals in short."""
    numbers = numbers_of(x)
    assert numbers is not None  # noqa: S101 - it is a constant
    if x.size == 1:
        text = repr(float(numbers.flat[0]))
        return Text(f"({text})" if text.startswith("-") else text)
    if not numbers.any():
        return Text(f"zeros({_sizes(x.shape)})")
    if len(x.shape) > 2:
        entries = "; ".join(repr(float(value)) for value in numbers.ravel(order="F"))
        return Text(f"reshape([{entries}], {_sizes(x.shape)})")
    rows, columns = (*x.shape, 1)[:2]
    if diagonal := nodes.diagonal_of(x):
        shift, value = diagonal
        blocks = [f"zeros({rows}, {shift})"] if shift else []
        blocks.append(f"eye({rows}, {columns - shift})")
        unit = f"[{', '.join(blocks)}]" if shift else blocks[0]
        return Text(unit) if value == 1.0 else Text(f"{value!r} .* {unit}", PRODUCT)
    lines = (", ".join(repr(float(value)) for value in row) for row in numbers.reshape(rows, -1))
    return Text(f"[{'; '.join(lines)}]")


def write_matlab(
    program: Program, robot: Functions, folder: str | os.PathLike[str], words: str = ""
) -> Path:
    """Write a program as a function of MATLAB and Octave, `<robot>_<program>`, for one state.

    It takes the program's inputs in their order, vectors as columns, and returns its outputs. Last
    it takes the constants of each robot that it calls, or those of the robot files if left out. The
    robots' packages, as `--target matlab` emits them, must be on the path.

    Args:
        program: The program.
        robot: The robot whose functions it calls.
        folder: Where the file is written, outside the module's folder.
        words: What it does, in a sentence for its help.

    Returns:
        Path of the file.

    Raises:
        UsageError: If the program has external functions, or names that MATLAB does not take or
            that two different programs within it have.
        OutputError: If the file cannot be written.
    """
    if unknown := sorted(externals_of(program)):
        raise UsageError(
            f"{program.name}: {', '.join(unknown)} is written by hand and has no MATLAB; use "
            "other nodes, or give its values as inputs"
        )
    path = Path(folder) / f"{robot.name}_{program.name}.m"
    called = replace(program, name=path.stem)
    text = MatlabText(called)
    check_distinct(text.programs)
    for name in (*called.names, *called.outputs):
        if name in text.reserved or name.startswith("_"):
            raise UsageError(f"{program.name}: MATLAB cannot name a variable {name}; rename it")
    if both := sorted({*called.names} & {*called.outputs}):
        raise UsageError(
            f"{program.name}: an input and an output are both called {both[0]}; rename one of them"
        )
    owners = owners_of(called)
    constants = dict(zip(owners, text.constants(called), strict=True))
    least = len(called.inputs)
    comment = [
        f"{path.stem.upper()} {words or f'The array program {program.name}.'}",
        f"    {text.heading}",
        f"Printed by gibbs_codegen {__version__}; MIT-0: yours without conditions.",
    ]
    opening = [
        line
        for part in comment
        for line in textwrap.wrap(part, WIDTH, initial_indent="%", subsequent_indent="%       ")
    ]
    opening += ["", f"    narginchk({least}, {least + len(owners)});"]
    for place, (owner, name) in enumerate(constants.items(), least + 1):
        opening += [
            f"    if nargin < {place}",
            f"        {name} = {text.packages[owner]}.prepare();",
        ]
        opening.append("    end")
    functions = [text.function(opening), *(MatlabText(x).function() for x in text.programs[:-1])]
    source = "\n".join(functions)
    source += "".join(part for name, part in _BY_HAND.items() if f"{name}(" in source)
    with writing(path):
        path.write_text(source, encoding="utf-8")
    return path
