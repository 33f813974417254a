"""SymPy's products and sums of symbols, made in a fraction of the time that SymPy takes.

SymPy looks through all factors and terms for what can be put together. Where they are different
symbols there is nothing to find: what is left is to put them in SymPy's order.
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp


def times(a: sp.Expr, b: sp.Expr) -> sp.Expr:
    """SymPy's a·b."""
    if a is sp.S.Zero or b is sp.S.Zero:
        return sp.S.Zero
    if a.is_Symbol and b.is_Symbol and a is not b:
        factors = (a, b) if a.name < b.name else (b, a)
        return sp.Mul._from_args(factors, is_commutative=True)
    if is_minus_symbol(a):
        return -times(a.args[1], b)
    if is_minus_symbol(b):
        return -times(a, b.args[1])
    return a * b


def sum_of_signed(terms: Sequence[tuple[int, sp.Expr]]) -> sp.Expr:
    """SymPy's sum of two or more symbols, each once, and numbers, with their signs 1 or −1."""
    numbers = [sign * term for sign, term in terms if not term.is_Symbol]
    if len(numbers) > 1 or not all(number.is_Number for number in numbers):  # As √2 is not.
        return sp.Add(*(sign * term for sign, term in terms))
    named = [(sign, term) for sign, term in terms if term.is_Symbol]
    named.sort(key=lambda term: (-term[0], term[1].name))
    parts = (*numbers, *(term if sign > 0 else -term for sign, term in named))
    return sp.Add._from_args(parts, is_commutative=True)


def signed(atom: sp.Expr) -> tuple[int, sp.Expr]:
    """Sign, 1 or −1, and magnitude of what `let` returns."""
    if atom.is_Symbol:
        return 1, atom
    if is_minus_symbol(atom):
        return -1, atom.args[1]
    return (-1, -atom) if atom.is_negative else (1, atom)


def is_minus_symbol(term: sp.Expr) -> bool:
    """Whether an expression is a symbol with a minus sign."""
    if not term.is_Mul or len(term.args) != 2:
        return False
    sign, rest = term.args
    return sign is sp.S.NegativeOne and bool(rest.is_Symbol)


def whole_power(factor: sp.Expr) -> tuple[sp.Expr, int]:
    """√x and n of a factor x^(n/2), x and n of xⁿ.

    Raises `TypeError` where twice the exponent is not a whole number.
    """
    base, exponent = factor.as_base_exp()
    if exponent.is_Integer:
        return base, int(exponent)
    if (2 * exponent).is_Integer:
        return sp.sqrt(base), int(2 * exponent)
    raise TypeError(f"no program has a power like {factor}: twice its exponent must be whole")
