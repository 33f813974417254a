"""What all accelerations of a tree are per unit of something: a column of a derivative."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.motion import Acceleration
from gibbs_codegen.symbolic.tape import Scalars, times

# Products in a line.
_PRODUCTS = 3


@dataclass(frozen=True)
class AccelerationColumn:
    """Accelerations of the root, in one frame, and of the joints after it."""

    root: Acceleration
    joints: list[sp.Expr]

    @property
    def entries(self) -> list[sp.Expr]:
        """Six components of the root's acceleration, and those of the joints."""
        return [*self.root.entries, *self.joints]

    @classmethod
    def combined(
        cls, tape: Scalars, factors: Sequence[sp.Expr], columns: Sequence[AccelerationColumn]
    ) -> AccelerationColumn:
        """Σ factors·columns; the columns are in one frame."""
        entries = combination(tape, factors, [column.entries for column in columns])
        return cls(Acceleration.of(entries[:6]), entries[6:])


def combination(
    tape: Scalars, factors: Sequence[sp.Expr], lists: Sequence[Sequence[sp.Expr]]
) -> list[sp.Expr]:
    """Lists of one length, each times its factor, added up entry by entry."""
    return [sum_of_products(tape, factors, entries) for entries in zip(*lists, strict=True)]


def sum_of_products(
    tape: Scalars, a: Sequence[sp.Expr], b: Sequence[sp.Expr], *others: sp.Expr
) -> sp.Expr:
    """Σ a_i·b_i, and `others` added.

    It is named after every third product, so that the same sum in another column is written in the
    same lines, and lines that repeat become loops.
    """
    products = [tape.let(times(p, q)) for p, q in zip(a, b, strict=True) if p != 0 and q != 0]
    total: sp.Expr = sp.S.Zero
    for first in range(0, len(products), _PRODUCTS):
        last = first + _PRODUCTS >= len(products)
        part = products[first : first + _PRODUCTS]
        total = tape.let(sp.Add(total, *part, *(others if last else ())))
    return total if products else tape.let(sp.Add(*others))
