"""Printers, by one-line assertions on precedence, signs and literals."""

from __future__ import annotations

from math import sin

import pytest

from gibbs_codegen.program.nodes import (
    Call,
    Name,
    Node,
    Number,
    Product,
    Reciprocal,
    Sum,
    node_value,
)
from gibbs_codegen.targets.printers import CPrinter, InfixPrinter

A, B, C = Name("a"), Name("b"), Name("c")


@pytest.mark.parametrize(
    ("node", "text"),
    [
        (Sum(((1, A), (-1, B))), "a - b"),
        (Sum(((-1, A), (-1, B))), "-a - b"),
        (Sum(((1, A), (-1, Sum(((1, B), (1, C)))))), "a - (b + c)"),
        (Product((A, Sum(((1, B), (-1, C))))), "a * (b - c)"),
        (Product((A, A, B)), "a * a * b"),
        (Sum(((1, Product((A, B))), (-1, Product((B, C))))), "a * b - b * c"),
        (Reciprocal(A), "1.0 / a"),
        (Reciprocal(Product((A, B))), "1.0 / (a * b)"),
        (Product((A, Reciprocal(B))), "a * (1.0 / b)"),
        (Product((Number(-2.0), A)), "(-2.0) * a"),
        (Sum(((1, A), (-1, Number(-2.0)))), "a - (-2.0)"),
        (Call("sin", Sum(((1, A), (1, B)))), "sin(a + b)"),
        (Number(0.1), "0.1"),
        (Number(1 / 3), "0.3333333333333333"),
    ],
)
def test_expression(node: Node, text: str) -> None:
    assert InfixPrinter().expression(node) == text
    values = {"a": 0.3, "b": -1.7, "c": 2.9}
    assert eval(text, {"sin": sin}, values) == pytest.approx(node_value(node, values), rel=1e-15)  # noqa: S307


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (2.0, "R(2.0)"),
        (-2.0, "-R(2.0)"),
        (0.1, "R(0.10000000000000001)"),
        (1e300, "R(1.0000000000000001e+300)"),
    ],
)
def test_a_literal_in_c_is_positive_and_reads_back(value: float, text: str) -> None:
    assert CPrinter().number(value) == text
    assert float(text.replace("R", "").replace("(", "").replace(")", "")) == value
