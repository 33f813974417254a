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


def or_one(tape: Scalars, above: sp.Expr, x: sp.Expr) -> sp.Expr:
    """A finite x where `above` is 1, else 1.

    The square keeps apart what would be summed as 1 + x − 1, without the last digits of a small x.
    """
    rest = tape.let(1 - above)
    return tape.let(tape.let(above * x) + tape.let(rest * rest))
