"""Statements in Python: their text, their comments, and what a function returns."""

from __future__ import annotations

import pytest

from gibbs_codegen.program.nodes import Name, Number, Output, Product, Statement, Sum
from gibbs_codegen.targets.numpy.statements import (
    PythonStatements,
    elements,
    literals,
    load,
    result,
    result_type,
)
from gibbs_codegen.targets.printers import InfixPrinter

PRINTER = PythonStatements(InfixPrinter())
TWICE = Product((Number(2.0), Name("x")))


def test_statements_are_python() -> None:
    assert PRINTER.assign("t1", TWICE) == ["t1 = 2.0 * x"]
    assert load("x", "q", 4) == "x = q[4]"
    assert load("mass", "values", "mass") == 'mass = values["mass"]'
    assert elements(["a", "b"]) == ["a, b,"]
    assert literals(["a", "b"]) == ['"a", "b",']
    assert literals([]) == []


@pytest.mark.parametrize("length", range(1, 60))
def test_a_long_value_stands_in_parentheses(length: int) -> None:
    """Its lines are within 100 columns in a function, whose body is indented once."""
    names = ["n" * length, *(f"name_{i}" for i in range(12))]
    first, *lines, last = PRINTER.assign("t1", Sum(tuple((1, Name(name)) for name in names)))
    assert (first, last) == ("t1 = (", ")")
    assert all(line.startswith("    ") and len(line) <= 96 for line in lines)
    assert " ".join(map(str.strip, lines)) == " + ".join(names)


def test_a_group_begins_with_its_comment() -> None:
    rows = [Statement("a", TWICE, "p"), Statement("b", TWICE, "p"), Statement("c", TWICE, "q")]
    lines = [line for line in PRINTER.assign_all(rows) if " = " not in line]
    assert lines == ["", "# p", "", "# q"]


def test_a_function_returns_one_array_or_several() -> None:
    one, two = Output((2,), (TWICE, TWICE)), Output((), (TWICE,))
    assert PRINTER.entries([one, two]) == ["2.0 * x, 2.0 * x, 2.0 * x,"]
    assert result([one]) == "shaped(entries, (2,), batch)"
    assert result([one, two]) == (
        "shaped(entries[0:2], (2,), batch), shaped(entries[2:3], (), batch)"
    )
    assert result_type(1) == "NDArray[np.float64]"
    assert result_type(2) == "tuple[NDArray[np.float64], NDArray[np.float64]]"
