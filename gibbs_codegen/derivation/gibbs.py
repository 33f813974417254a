"""The Gibbs function of one link (eq. 2) and its partial derivatives (eq. 6), by `diff`.

The inertia of a link about its joint is its mass B₀, its first moment C (B₁ is the skew matrix of
C) and its second moments E = ∫ρρᵀdm, which move more simply than the inertia matrix
B₂ + B₃ = tr(E)·1 − E that they stand for. The Gibbs function is linear in all ten.

𝒮 and ℛ are written in the *acceleration gradient* of the link, A = dω/dt~ + ω̃ω̃: a point at ρ
from the joint has the acceleration r̈ + Aρ, so the entries of A are shared with the kinematics.

All are polynomials in one ring, where sums, products and derivatives take a fraction of the time
that they take among expressions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import chain
from typing import NamedTuple

import sympy as sp
from sympy.polys.rings import PolyElement, PolyRing

from gibbs_codegen.symbolic.tape import plus, times

ACCELERATION = sp.symbols("r_ddot_x:z")
OMEGA = sp.symbols("omega_x:z")
OMEGA_DOT = sp.symbols("omega_dot_x:z")
MASS = sp.Symbol("B_0")
MOMENT = sp.symbols("C_x:z")
SECOND = sp.symbols("E_xx E_yy E_zz E_xy E_xz E_yz")
GRADIENT = tuple(sp.symbols(f"A_{row}x:z") for row in "xyz")

_INERTIA = (MASS, *MOMENT, *SECOND)
_TURNING = (*OMEGA_DOT, *OMEGA)
_SYMBOLS = (*_TURNING, *ACCELERATION, *_INERTIA, *chain.from_iterable(GRADIENT))
_RING = PolyRing(_SYMBOLS, sp.QQ, sp.lex)
_POLYNOMIALS = dict(zip(_SYMBOLS, _RING.gens, strict=True))


class Partials(NamedTuple):
    """𝒮 = ∂S/∂r̈ and ℛ = ∂S/∂ω̇ of one link, each with three components."""

    force: tuple[sp.Expr, ...]
    moment: tuple[sp.Expr, ...]


def skew(vector: tuple[sp.Expr, ...]) -> sp.Matrix:
    """Skew matrix ã of a vector: ãb = a × b."""
    x, y, z = vector
    return sp.Matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def inertia_matrix() -> sp.Matrix:
    """B₂ + B₃, the inertia matrix about the joint, by the second moments: tr(E)·1 − E."""
    xx, yy, zz, xy, xz, yz = SECOND
    second = sp.Matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return second.trace() * sp.eye(3) - second


@cache
def link_gibbs_function() -> sp.Expr:
    """S of one link up to terms free of accelerations (eq. 2), in the link's own frame."""
    return _gibbs_function().as_expr()


@cache
def _gibbs_function() -> PolyElement:
    r, w, w_dot, first = map(_polynomials, (ACCELERATION, OMEGA, OMEGA_DOT, MOMENT))
    second = [[_RING(entry) for entry in row] for row in inertia_matrix().tolist()]
    return (
        _POLYNOMIALS[MASS] * _dot(r, r) / 2
        - _dot(r, _cross(first, w_dot))
        - _dot(r, _cross(w, _cross(first, w)))
        + _dot(w_dot, [_dot(row, w_dot) for row in second]) / 2
        + _dot(w_dot, _cross(w, [_dot(row, w) for row in second]))
    )


@cache
def _partials() -> list[PolyElement]:
    gibbs = _gibbs_function()
    return [gibbs.diff(direction) for direction in _polynomials((*ACCELERATION, *OMEGA_DOT))]


@cache
def link_partials() -> Partials:
    """𝒮 and ℛ of one link (eq. 6), as polynomials in r̈, ω̇ and ω."""
    partials = [partial.as_expr() for partial in _partials()]
    return Partials(tuple(partials[:3]), tuple(partials[3:]))


@cache
def link_partials_by_gradient() -> Partials:
    """𝒮 and ℛ in r̈ and the acceleration gradient A, collected by the link's inertia."""
    # ω̇ and the products ω_iω_j, by their powers, in terms of the entries of A.
    w, w_dot, a = _polynomials(OMEGA), _polynomials(OMEGA_DOT), list(map(_polynomials, GRADIENT))
    back = {_RING.one: _RING.one}
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        back[w_dot[i]] = (a[k][j] - a[j][k]) / 2
        back[w[j] * w[k]] = (a[k][j] + a[j][k]) / 2
        back[w[i] ** 2] = (a[i][i] - a[j][j] - a[k][k]) / 2
    gradients = {moving.LM[: len(_TURNING)]: gradient for moving, gradient in back.items()}
    size = len(_TURNING)
    still = (0,) * size
    partials = []
    for partial in _partials():
        rewritten = _RING.zero
        for powers, factor in partial.terms():
            rewritten += _RING({(*still, *powers[size:]): factor}) * gradients[powers[:size]]
        collected = [
            symbol * rewritten.diff(_POLYNOMIALS[symbol]).as_expr()  # It is linear in the inertia.
            for symbol in _INERTIA
        ]
        partials.append(sp.Add(*collected))
    return Partials(tuple(partials[:3]), tuple(partials[3:]))


def evaluated(expression: sp.Expr, values: Mapping[sp.Expr, sp.Expr]) -> sp.Expr:
    """One of these functions for a link: SymPy's `xreplace`, but for products with a zero."""
    if expression.is_Symbol:
        return values[expression]
    if not expression.args:
        return expression
    parts = []
    for part in expression.args:
        value = evaluated(part, values)
        if value is sp.S.Zero and expression.is_Mul:
            return value
        parts.append(value)
    if expression.is_Add:
        return plus(*parts)
    return times(*parts) if len(parts) == 2 and expression.is_Mul else expression.func(*parts)


def _polynomials(symbols: Sequence[sp.Symbol]) -> list[PolyElement]:
    return [_POLYNOMIALS[symbol] for symbol in symbols]


def _dot(a: Sequence[PolyElement], b: Sequence[PolyElement]) -> PolyElement:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Sequence[PolyElement], b: Sequence[PolyElement]) -> list[PolyElement]:
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


@cache
def link_mass_block() -> sp.Matrix:
    """Hessian of S in (r̈, ω̇): the link's 6×6 mass matrix about its joint."""
    directions = _polynomials((*ACCELERATION, *OMEGA_DOT))
    partials = _partials()
    return sp.Matrix([[p.diff(d).as_expr() for d in directions] for p in partials])
