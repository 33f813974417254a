"""Choices on a tape: sums of products with 0 and 1, which are made of signs.

They are exact, and their derivatives are those of what is chosen.
"""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.symbolic.tape import Scalars

_HALF = sp.Rational(1, 2)


def above(tape: Scalars, x: sp.Expr) -> sp.Expr:
    """1 where x is above 0, and 0 below."""
    return tape.let(_HALF + _HALF * tape.let(sp.sign(tape.let(x))))


def chosen(tape: Scalars, above: sp.Expr, one: sp.Expr, other: sp.Expr) -> sp.Expr:
    """One where `above` is 1, the other where it is 0; both are finite."""
    rest = tape.let(1 - above)
    return tape.let(tape.let(above * one) + tape.let(rest * other))
