"""Structural numbers: sines and cosines of angles that the robot file fixes.

They decide which terms exist, so they are exact for multiples of 30° and 45° and carry forty
digits otherwise; sums of them that vanish by symmetry are recognised as zero.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import sympy as sp

DIGITS = 40
_VANISHING = sp.Float("1e-25", DIGITS)
# Sums of cosines, squares and products over a regular polygon, with the 1/2, 1/3 of rods before.
_FRACTION = sp.Integer(24)


@cache
def cos_sin_deg(angle: Fraction) -> tuple[sp.Expr, sp.Expr]:
    """Cosine and sine of an angle in degrees: exact for n·30° and n·45°, else to forty digits."""
    angle %= 360
    exact = radians(angle)
    if angle % 30 == 0 or angle % 45 == 0:
        return sp.cos(exact), sp.sin(exact)
    turned = exact.evalf(DIGITS + 5)
    return structural_number(sp.cos(turned)), structural_number(sp.sin(turned))


def structural_number(number: sp.Float) -> sp.Expr:
    """A number that the robot file fixes: an integer where it is whole.

    SymPy drops a factor of one only where it is an integer; whether 1.0 equals 1 depends on its
    version.
    """
    whole = sp.Integer(int(number))
    return whole if (number - whole).is_zero else number


def radians(angle: Fraction) -> sp.Expr:
    """An angle of degrees in radians, as an exact multiple of π."""
    return sp.Rational(angle.numerator, angle.denominator) * sp.pi / 180


def gather(expression: sp.Expr) -> sp.Expr:
    """Expand, add the structural coefficients of like terms, and drop those that vanish.

    Whether a coefficient such as Σ cos² θ_k was summed exactly or to forty digits makes no
    difference: what is within 1e-25 of a multiple of 1/24 is that multiple.
    """
    coefficients: dict[sp.Expr, sp.Expr] = {}
    for term in sp.Add.make_args(sp.expand(expression)):
        numbers, rest = _number_and_rest(term)
        coefficients[rest] = coefficients.get(rest, sp.S.Zero) + numbers
    return sp.Add(*(_settled(number) * rest for rest, number in coefficients.items()))


def _settled(number: sp.Expr) -> sp.Expr:
    if number.is_Rational:
        return number
    multiple = _FRACTION * sp.N(number, DIGITS)
    nearest = sp.Integer(round(multiple))
    return nearest / _FRACTION if abs(multiple - nearest) < _VANISHING else number


def _number_and_rest(term: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    numbers: list[sp.Expr] = []
    rest: list[sp.Expr] = []
    for factor in sp.Mul.make_args(term):
        (numbers if factor.is_number else rest).append(factor)
    return sp.Mul(*numbers), sp.Mul(*rest)
