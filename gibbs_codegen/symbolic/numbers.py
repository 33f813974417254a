"""Numbers that the robot file fixes, as sines and cosines of its angles, and results of them.

They decide which terms exist. Rationals and square roots stay exact; others carry forty digits,
and are rounded to doubles only where they are printed:

    total(√3/2 · √3/2, 1/4)     1
    product(cos 20°, cos 20°)   0.8830222215594890 …, to forty digits

What is within 1e-25 of a multiple of 1/24 is that multiple, whether it was summed exactly or to
forty digits: such are sums of cosines, squares and products over a regular polygon, with the 1/2
and 1/3 of rods before them.
"""

from __future__ import annotations

from functools import cache

import sympy as sp

DIGITS = 40
_VANISHING = sp.Float("1e-25", DIGITS)
_FRACTION = sp.Integer(24)
_SQUARES = 192
_NEXT = 1e-15


@cache
def settled(number: sp.Expr) -> sp.Expr:
    """A number in one form, whichever expression it comes as."""
    number = sp.expand(number)
    if number.is_Rational:
        return number
    multiple = _FRACTION * sp.N(number, DIGITS)
    nearest = sp.Integer(int(multiple + (sp.S.Half if multiple > 0 else -sp.S.Half)))
    if abs(multiple - nearest) < _VANISHING:
        return nearest / _FRACTION
    return sp.N(number, DIGITS) if number.has(sp.Float, sp.NumberSymbol) else number


@cache
def exact(number: float) -> sp.Expr:
    """The number that a double between −1 and 1 is next to: a root of a multiple of 1/192, or it.

    Products of cosines and sines of multiples of 30° and 45° are such roots.
    """
    root = sp.sqrt(sp.Rational(round(_SQUARES * number**2), _SQUARES))
    root = -root if number < 0 else root
    return settled(root if abs(number - rounded(root)) < _NEXT else sp.Float(number, DIGITS))


@cache
def product(first: sp.Expr, second: sp.Expr) -> sp.Expr:
    """The product of two settled numbers."""
    return settled(first * second)


@cache
def total(first: sp.Expr, second: sp.Expr) -> sp.Expr:
    """The sum of two settled numbers."""
    return settled(first + second)


@cache
def reciprocal(number: sp.Expr) -> sp.Expr:
    """One over a settled number, without a root in a denominator."""
    return settled(sp.radsimp(1 / number))


@cache
def rounded(number: sp.Expr) -> float:
    """The double next to a number."""
    return float(sp.N(number, DIGITS))
