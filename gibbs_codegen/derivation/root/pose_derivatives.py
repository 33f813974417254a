"""Derivatives of the exponential map of SE(3), in the tangent spaces where it begins and ends.

Of the turn φ by the angle θ they are made of

    a = sin θ/θ,   b = (1 − cos θ)/θ²,   c = (θ − sin θ)/θ³

and of the rates b′ = (a − 2b)/θ² and c′ = (b − 3c)/θ² of b and c by θ, over θ; that of a is c − b.
Rounding of a and b over θ² does no harm, since b′ is multiplied by φ twice. That of 1 − a would:
c stands by one φ. So a series gives c up to θ = 1.
"""

from __future__ import annotations

import math

import sympy as sp

from gibbs_codegen.derivation.root.pose import half_angle, rotation_columns
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    Matrix,
    Vector,
    add,
    axis_vector,
    cross,
    dot,
    minus,
    scale,
    zeros,
)

# Terms of the series of c: up to θ = 1 the next is 3e-18 of the first.
_TERMS = 9


def displaced_by_pose(tape: Scalars, turn: Vector, step: Vector) -> Matrix:
    """How the pose after a screw motion moves with the pose before: Ad of the inverse motion.

    These are 6×6 entries [[Rᵀ, 0], [−Rᵀp̃, Rᵀ]], angular before linear, in the frames of the poses.
    """
    let = tape.let
    square, cosine, share = half_angle(tape, turn)
    _, first, second = _coefficients(tape, square, cosine, share)
    with tape.group("motion as a rotation and a way"):
        x, y, z = scale(tape, share, turn)
        axes = rotation_columns(tape, (x, y, z, cosine))
        once = cross(tape, turn, step)
        twice = cross(tape, turn, once)
        way = add(tape, step, scale(tape, first, once), scale(tape, second, twice))
    with tape.group("what the motion makes of a displacement before it"):
        block = zeros(6, 6)
        for i, axis in enumerate(axes):
            lever = cross(tape, way, axis)
            for j in range(3):
                block[i][j] = block[3 + i][3 + j] = axis[j]
                block[3 + i][j] = let(lever[j])
    return block


def displaced_by_motion(tape: Scalars, turn: Vector, step: Vector) -> Matrix:
    """How the pose after a screw motion moves with the motion: the right Jacobian of SE(3).

    It is [[J, 0], [Q, J]], angular before linear, in the frame of the pose after the motion, with J
    = a·1 − b·φ̃ + c·φφᵀ, and with Q the rate of J as φ moves by the linear part.
    """
    let = tape.let
    square, cosine, share = half_angle(tape, turn)
    a, b, c = _coefficients(tape, square, cosine, share)
    with tape.group("rates of the functions of the angle"):
        along = dot(tape, turn, step)
        inverse = let(1 / square)
        b_rate = let(along * let(let(a - 2 * b) * inverse))
        c_rate = let(along * let(let(b - 3 * c) * inverse))
        a_rate = let(along * let(c - b))
    with tape.group("what is made of a change of the motion"):
        block = zeros(6, 6)
        for j in range(3):
            unit = axis_vector(j)
            turned = cross(tape, turn, unit)
            column = add(
                tape,
                scale(tape, a, unit),
                minus(scale(tape, b, turned)),
                scale(tape, let(c * turn[j]), turn),
            )
            rate = add(
                tape,
                scale(tape, a_rate, unit),
                minus(scale(tape, b_rate, turned)),
                minus(scale(tape, b, cross(tape, step, unit))),
                scale(tape, let(c_rate * turn[j] + c * step[j]), turn),
                scale(tape, let(c * turn[j]), step),
            )
            for i in range(3):
                block[i][j] = block[3 + i][3 + j] = column[i]
                block[3 + i][j] = rate[i]
    return block


def _coefficients(
    tape: Scalars, square: sp.Expr, cosine: sp.Expr, share: sp.Expr
) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    """Functions a, b, c of an angle from `half_angle`, as accurate as numbers are at any angle."""
    let = tape.let
    with tape.group("functions of the angle"):
        a, b = let(2 * share * cosine), let(2 * share * share)
        small = let(sp.Rational(1, 2) + sp.Rational(1, 2) * let(sp.sign(let(1 - square))))
        bounded = let(small * square)
        series = sp.S.Zero
        for k in reversed(range(_TERMS)):
            term = sp.Rational((-1) ** k, math.factorial(2 * k + 3))
            series = let(term + bounded * series)
        closed = let(let(1 - a) * let(1 / square))
        return a, b, let(small * series + let(1 - small) * closed)
