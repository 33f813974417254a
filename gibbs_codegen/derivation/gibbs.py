"""The Gibbs function of one link (eq. 2) and its partial derivatives (eq. 6), by SymPy's `diff`.

The inertia of a link about its joint is its mass B₀, its first moment C (B₁ is the skew matrix of
C) and its second moments E = ∫ρρᵀdm, which move more simply than the inertia matrix
B₂ + B₃ = tr(E)·1 − E that they stand for. The Gibbs function is linear in all ten.

𝒮 and ℛ are written in the *acceleration gradient* of the link, A = dω/dt~ + ω̃ω̃: a point at ρ
from the joint has the acceleration r̈ + Aρ, so the entries of A are shared with the kinematics.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import sympy as sp

ACCELERATION = sp.symbols("r_ddot_x:z")
OMEGA = sp.symbols("omega_x:z")
OMEGA_DOT = sp.symbols("omega_dot_x:z")
MASS = sp.Symbol("B_0")
MOMENT = sp.symbols("C_x:z")
SECOND = sp.symbols("E_xx E_yy E_zz E_xy E_xz E_yz")
GRADIENT = tuple(sp.symbols(f"A_{row}x:z") for row in "xyz")


class Partials(NamedTuple):
    """𝒮 = ∂S/∂r̈ and ℛ = ∂S/∂ω̇ of one link, each with three components."""

    force: tuple[sp.Expr, ...]
    moment: tuple[sp.Expr, ...]


def skew(vector: tuple[sp.Expr, ...]) -> sp.Matrix:
    """Skew matrix ã of a vector: ãb = a × b.

    Args:
        vector: Three components.

    Returns:
        3×3 matrix.
    """
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
    r, w, w_dot = (sp.Matrix(v) for v in (ACCELERATION, OMEGA, OMEGA_DOT))
    first, second, spin = skew(MOMENT), inertia_matrix(), skew(OMEGA)
    half = sp.Rational(1, 2)
    gibbs = (
        half * MASS * r.T * r
        - r.T * first * w_dot
        - r.T * spin * first * w
        + half * w_dot.T * second * w_dot
        + w_dot.T * spin * second * w
    )
    return sp.expand(gibbs[0])


@cache
def link_partials() -> Partials:
    """𝒮 and ℛ of one link (eq. 6), as polynomials in r̈, ω̇ and ω."""
    gibbs = link_gibbs_function()
    return Partials(
        tuple(sp.expand(sp.diff(gibbs, r)) for r in ACCELERATION),
        tuple(sp.expand(sp.diff(gibbs, w)) for w in OMEGA_DOT),
    )


@cache
def link_partials_by_gradient() -> Partials:
    """𝒮 and ℛ in r̈ and the acceleration gradient A, collected by the link's inertia."""
    back = _motion_by_gradient()

    def rewritten(partial: sp.Expr) -> sp.Expr:
        terms = sp.Poly(partial, *OMEGA).terms()
        by_gradient = sp.Add(
            *(
                coefficient.xreplace(back)
                * back[sp.Mul(*(w**e for w, e in zip(OMEGA, powers, strict=True)))]
                for powers, coefficient in terms
            )
        )
        return sp.collect(sp.expand(by_gradient), (MASS, *MOMENT, *SECOND))

    force, moment = link_partials()
    return Partials(tuple(map(rewritten, force)), tuple(map(rewritten, moment)))


@cache
def link_mass_block() -> sp.Matrix:
    """Hessian of S in (r̈, ω̇): the link's 6×6 mass matrix about its joint."""
    return sp.hessian(link_gibbs_function(), (*ACCELERATION, *OMEGA_DOT))


def _motion_by_gradient() -> dict[sp.Expr, sp.Expr]:
    """ω̇ and the products ω_iω_j in terms of the entries of A."""
    half = sp.Rational(1, 2)
    a = GRADIENT
    back: dict[sp.Expr, sp.Expr] = {sp.S.One: sp.S.One}
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        back[OMEGA_DOT[i]] = half * (a[k][j] - a[j][k])
        back[OMEGA[j] * OMEGA[k]] = half * (a[k][j] + a[j][k])
        back[OMEGA[i] ** 2] = half * (a[i][i] - a[j][j] - a[k][k])
    return back
