"""Expanded, collected forms: the same value, few terms, and an end where there are too many."""

from __future__ import annotations

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gibbs_codegen.equations.normal_form import TooLongError, collected, count_terms

A, B, P, Q, V, W = sp.symbols("a b p q v w")
LEAVES = (A, B, V, W, sp.sin(P), sp.cos(P), sp.sin(P + Q), sp.cos(P + Q), sp.sqrt(6) / 4)
NUMBERS = {A: 0.7, B: -1.3, P: 0.4, Q: 1.9, V: 2.1, W: -0.6}


@st.composite
def expressions(draw: st.DrawFn, depth: int = 3) -> sp.Expr:
    if depth == 0:
        return draw(st.sampled_from(LEAVES)) * draw(st.integers(-3, 3))
    parts = draw(st.lists(expressions(depth - 1), min_size=2, max_size=3))
    return draw(st.sampled_from([sp.Add, sp.Mul]))(*parts)


@pytest.mark.slow
@settings(max_examples=60)
@given(expression=expressions())
def test_value_stays(expression: sp.Expr) -> None:
    difference = expression - collected(expression, (V, W), 10_000)
    size = 1 + abs(float(expression.evalf(30, subs=NUMBERS)))
    assert abs(float(difference.evalf(30, subs=NUMBERS))) <= 1e-12 * size


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (A * sp.sin(P) ** 2 + A * sp.cos(P) ** 2, A),
        (A - A * sp.sin(P) ** 2 + B * sp.sin(P) ** 2, A * sp.cos(P) ** 2 + B * sp.sin(P) ** 2),
        (sp.cos(P + Q) * sp.cos(P) + sp.sin(P + Q) * sp.sin(P), sp.cos(Q)),
        (sp.sin(P + Q) * sp.cos(P) - sp.cos(P + Q) * sp.sin(P), sp.sin(Q)),
        ((V + W) ** 2 - V**2 - W**2, 2 * V * W),
        (sp.sqrt(6) * sp.sqrt(2) * A, 2 * sp.sqrt(3) * A),
        (sp.Integer(0), sp.Integer(0)),
    ],
)
def test_what_is_shorter_is_found(expression: sp.Expr, expected: sp.Expr) -> None:
    assert collected(expression, (V, W), 100) == expected


def test_coefficients_are_collected_and_factored() -> None:
    form = collected(2 * A * V**2 + 4 * A * B * V**2 + W, (V, W), 100)
    assert form == 2 * A * V**2 * (1 + 2 * B) + W
    assert count_terms(form) == 3


def test_too_many_terms_are_refused() -> None:
    with pytest.raises(TooLongError):
        collected((A + B) ** 2 * (V + W) ** 9, (), 10)


def test_what_is_no_polynomial_is_named() -> None:
    with pytest.raises(TypeError, match="no polynomial: exp"):
        collected(sp.exp(A) + B, (), 10)
