"""The Gibbs function of one link (eq. 2) and its partials (eq. 6)."""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.gibbs import (
    ACCELERATION,
    GRADIENT,
    MASS,
    MOMENT,
    OMEGA,
    OMEGA_DOT,
    SECOND,
    inertia_matrix,
    link_gibbs_function,
    link_mass_block,
    link_partials,
    link_partials_by_gradient,
    skew,
)

R, W, W_DOT = (sp.Matrix(v) for v in (ACCELERATION, OMEGA, OMEGA_DOT))


def test_gibbs_function_is_half_the_squared_acceleration_of_point_masses() -> None:
    """Eq. 2 from its integral: Σ ½m|r̈ + ω̇×ρ + ω×(ω×ρ)|² of three particles."""
    points = [(1, 2, -1), (3, -1, 2), (-2, 1, 1)]
    masses = [2, 3, 5]
    direct = sp.S.Zero
    values = {MASS: sp.Integer(sum(masses))}
    for i, name in enumerate(MOMENT):
        values[name] = sp.Integer(sum(m * p[i] for m, p in zip(masses, points, strict=True)))
    for name, (i, j) in zip(SECOND, [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)], strict=True):
        values[name] = sp.Integer(sum(m * p[i] * p[j] for m, p in zip(masses, points, strict=True)))
    for mass, point in zip(masses, points, strict=True):
        rho = sp.Matrix(point)
        acceleration = R + W_DOT.cross(rho) + W.cross(W.cross(rho))
        direct += sp.Rational(mass, 2) * acceleration.dot(acceleration)
    difference = sp.expand(direct - link_gibbs_function().xreplace(values))
    free_of_accelerations = not difference.free_symbols & set(ACCELERATION + OMEGA_DOT)
    assert free_of_accelerations


def test_partials_are_the_papers_vectors() -> None:
    """𝒮 = B₀r̈ − B₁ω̇ − ω̃B₁ω and ℛ = B₁r̈ + (B₂+B₃)ω̇ + ω̃(B₂+B₃)ω."""
    first, second, spin = skew(MOMENT), inertia_matrix(), skew(OMEGA)
    force = MASS * R - first * W_DOT - spin * first * W
    moment = first * R + second * W_DOT + spin * second * W
    ours = link_partials()
    assert sp.expand(sp.Matrix(ours.force) - force).is_zero_matrix
    assert sp.expand(sp.Matrix(ours.moment) - moment).is_zero_matrix


def test_partials_in_the_acceleration_gradient_are_the_same() -> None:
    gradient = skew(OMEGA_DOT) + skew(OMEGA) ** 2
    values = {GRADIENT[i][j]: gradient[i, j] for i in range(3) for j in range(3)}
    for ours, theirs in zip(link_partials_by_gradient(), link_partials(), strict=True):
        for a, b in zip(ours, theirs, strict=True):
            assert sp.expand(a.xreplace(values) - b) == 0


def test_mass_block_is_the_spatial_inertia() -> None:
    """[[B₀1, −B₁], [B₁, B₂+B₃]]."""
    first = skew(MOMENT)
    expected = sp.Matrix(sp.BlockMatrix([[MASS * sp.eye(3), -first], [first, inertia_matrix()]]))
    assert sp.expand(link_mass_block() - expected).is_zero_matrix
