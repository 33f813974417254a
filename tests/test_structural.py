"""Structural numbers: exact where they can be, and sums that vanish do."""

from __future__ import annotations

from fractions import Fraction

import pytest
import sympy as sp

from gibbs_codegen.structural import cos_sin_deg, gather


@pytest.mark.parametrize(
    ("degrees", "cos", "sin"),
    [
        (0, 1, 0),
        (90, 0, 1),
        (-180, -1, 0),
        (60, sp.Rational(1, 2), sp.sqrt(3) / 2),
        (405, None, None),
    ],
)
def test_multiples_of_30_and_45_are_exact(degrees: int, cos: object, sin: object) -> None:
    c, s = cos_sin_deg(Fraction(degrees))
    if cos is None:
        cos = sin = sp.sqrt(2) / 2
    assert (c, s) == (cos, sin)


def test_other_angles_carry_thirty_digits_at_least() -> None:
    c, s = cos_sin_deg(Fraction(360, 7))
    assert abs(c - sp.cos(2 * sp.pi / 7).evalf(60)) < sp.Float("1e-35")
    assert abs(c * c + s * s - 1) < sp.Float("1e-35")


@pytest.mark.parametrize("count", [3, 5, 6, 7, 8, 11, 24, 40, 250])
def test_sums_over_a_regular_polygon_vanish_exactly(count: int) -> None:
    x = sp.Symbol("x")
    turns = [cos_sin_deg(Fraction(360 * k, count)) for k in range(count)]
    assert gather(sp.Add(*(c * x for c, _ in turns))) == 0
    assert gather(sp.Add(*(s * x for _, s in turns))) == 0
    assert gather(sp.Add(*(c * s * x for c, s in turns))) == 0
    assert gather(sp.Add(*(c * c * x for c, _ in turns))) == sp.Rational(count, 2) * x


def test_what_does_not_vanish_stays() -> None:
    x, y = sp.symbols("x y")
    assert gather(sp.sqrt(3) * x / 2 + sp.sqrt(3) * x / 2 - y + y) == sp.sqrt(3) * x
