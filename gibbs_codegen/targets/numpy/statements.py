"""Statements in Python as lines: how they are written and broken is decided here alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from gibbs_codegen.files.line_breaks import INDENT, WIDTH, broken
from gibbs_codegen.program.nodes import Node, Output
from gibbs_codegen.targets.printers import StatementPrinter


class PythonStatements(StatementPrinter):
    """Prints statements in Python."""

    def assign(self, name: str, value: Node) -> list[str]:
        """A local variable, its value in parentheses where it takes more than a line."""
        start, text = f"{name} = ", self._expressions.expression(value)
        if len(start) + len(text) <= WIDTH - INDENT:
            return [start + text]
        return [f"{start}(", *(f"{' ' * INDENT}{line}" for line in _wrapped(text)), ")"]

    def entries(self, outputs: Sequence[Output]) -> list[str]:
        """Lines between the parentheses of a tuple of all entries of outputs."""
        nodes = (entry for output in outputs for entry in output.entries)
        return elements([self._expressions.expression(node) for node in nodes])


def load(name: str, array: str, place: int | str) -> str:
    """A local variable that is an entry of a sequence by index, or of a dictionary by key."""
    index = f'"{place}"' if isinstance(place, str) else place
    return f"{name} = {array}[{index}]"


def load_all(names: Sequence[str], array: str, places: Sequence[int], whole: bool) -> list[str]:
    """Local variables that are entries of a sequence, of which they are all if it is `whole`."""
    if len(names) < 2:
        return [load(name, array, place) for name, place in zip(names, places, strict=True)]
    values = array if whole else ", ".join(f"{array}[{place}]" for place in places)
    text = f"{', '.join(names)} = {values}"
    if len(text) <= WIDTH - INDENT:
        return [text]
    lines = ["(", *_indented(_wrapped(f"{', '.join(names)},"))]
    if whole:
        return [*lines, f") = {array}"]
    return [*lines, ") = (", *_indented(_wrapped(f"{values},")), ")"]


def listed(begin: str, items: Sequence[str], end: str = "") -> list[str]:
    """Items in parentheses, in one line where they fit, or each in a line of its own."""
    inside = ", ".join(items)
    if len(begin) + len(inside) + len(end) + 2 <= WIDTH - INDENT:
        return [f"{begin}({inside}){end}"]
    if len(inside) <= WIDTH - 2 * INDENT:
        return [f"{begin}(", *_indented([inside]), f"){end}"]
    return [f"{begin}(", *_indented(f"{item}," for item in items), f"){end}"]


def assignment(statement: str) -> list[str]:
    """A statement in a function of a function, what it computes in parentheses where it is long."""
    if len(statement) <= WIDTH - 2 * INDENT:
        return [statement]
    start, _, value = statement.partition(" = ")
    lines = broken(value, WIDTH - 3 * INDENT, hanging="")
    return [f"{start} = (", *_indented(lines), ")"]


def _indented(lines: Iterable[str]) -> list[str]:
    return [f"{' ' * INDENT}{line}" for line in lines]


def elements(texts: Sequence[str]) -> list[str]:
    """Lines between the parentheses of a tuple."""
    return _wrapped(f"{', '.join(texts)},") if texts else []


def literal(value: object) -> str:
    """A constant as Python has it: text, a number, None, a slice, or a tuple of such."""
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, slice):
        return f"slice({value.start}, {value.stop})"
    if isinstance(value, tuple):
        return f"({', '.join(map(literal, value))}{',' * (len(value) == 1)})"
    return repr(value)


def literals(values: Iterable[object]) -> list[str]:
    """Lines between the parentheses of a tuple of constants, none of which ends in a text."""
    text = " ".join(f"{literal(v)}," for v in values)
    return broken(text, WIDTH - INDENT, whole='"[^"]*"', hanging="") if text else []


def integers(numbers: Iterable[int]) -> list[str]:
    """Text between the parentheses of a tuple of integers in a tuple; nothing without any."""
    text = " ".join(f"{number}," for number in numbers)
    return broken(text, WIDTH - 3 * INDENT, hanging="") if text else []


def result(outputs: Sequence[Output]) -> str:
    """The return value of a function, from `entries` of all its outputs and `batch`."""
    calls, start = [], 0
    for output in outputs:
        stop = start + len(output.entries)
        part = "entries" if len(outputs) == 1 else f"entries[{start}:{stop}]"
        calls.append(f"shaped({part}, {output.shape!r}, batch)")
        start = stop
    return ", ".join(calls)


def result_type(outputs: int) -> str:
    """The annotation of what a function of so many outputs returns."""
    array = "NDArray[np.float64]"
    return array if outputs == 1 else f"tuple[{', '.join([array] * outputs)}]"


def _wrapped(text: str) -> list[str]:
    """Lines of an expression that stands in parentheses in the body of a function."""
    return broken(text, WIDTH - 2 * INDENT, hanging="")
