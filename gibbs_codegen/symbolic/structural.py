"""Rotations that the robot file fixes, as matrices, and as turns about coordinate axes.

They decide which terms exist, so their entries carry forty digits, and what is within 1e-30 of
zero, or of a multiple of 15° as an angle, is exactly that.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cache

import sympy as sp

from gibbs_codegen.symbolic.numbers import DIGITS
from gibbs_codegen.symbolic.tape import Vector
from gibbs_codegen.symbolic.vectors import Rotation, X, Z, cos_sin_deg

# By rows: takes components in the turned frame to components in the frame it was turned from.
Turn = tuple[Vector, ...]

_GUARD = DIGITS + 10
_VANISHING = sp.Float("1e-30", DIGITS)
_COMMON_DEGREES = 15

NO_TURN: Turn = (
    (sp.S.One, sp.S.Zero, sp.S.Zero),
    (sp.S.Zero, sp.S.One, sp.S.Zero),
    (sp.S.Zero, sp.S.Zero, sp.S.One),
)


def turn_about(axis: int, angle: Fraction) -> Turn:
    """Matrix of a rotation about axis X, Y or Z by an angle in degrees."""
    cos, sin = cos_sin_deg(angle)
    p, q = (axis + 1) % 3, (axis + 2) % 3
    rows = [list(row) for row in NO_TURN]
    rows[p][p] = rows[q][q] = cos
    rows[p][q], rows[q][p] = -sin, sin
    return _turn(rows)


def turned_by_rpy(angles: Sequence[Fraction]) -> Turn:
    """Matrix of a rotation by roll, pitch and yaw in degrees, R_z·R_y·R_x."""
    x, y, z = (turn_about(axis, angle) for axis, angle in enumerate(angles))
    return product(z, product(y, x))


def z_onto(direction: Sequence[float]) -> Turn:
    """A rotation R_z·R_x that takes the z axis to a direction, any vector but zero.

    For z it is the identity.
    """
    x, y, z = (sp.Float(entry, _GUARD) for entry in direction)
    about_x = _degrees(sp.sqrt(x**2 + y**2), z)
    about_z = _degrees(x, -y) if about_x % 180 else Fraction(0)
    return product(turn_about(Z, about_z), turn_about(X, about_x))


@cache
def product(first: Turn, second: Turn) -> Turn:
    """The rotation `second`, seen in the frame that `first` turns from: the matrix product."""
    rows = []
    for row in first:
        entries = []
        for column in zip(*second, strict=True):
            entry = sp.Add(*(p * q for p, q in zip(row, column, strict=True)))
            if not entry.is_Rational:  # Exact where it is whole, or where it is short and exact.
                value = _number(entry)
                whole = sp.Integer(round(value))
                if abs(value - whole) < _VANISHING:
                    entry = whole
                elif not entry.is_number or entry.has(sp.Float):
                    entry = sp.Float(value, DIGITS)
            entries.append(entry)
        rows.append(entries)
    return _turn(rows)


def back(turn: Turn) -> Turn:
    """The rotation back, its transpose."""
    return _turn(list(zip(*turn, strict=True)))


def applied(turn: Turn, vector: Vector) -> Vector:
    """A vector of the turned frame in the frame turned from, without names on a tape."""
    x, y, z = (sp.Add(*(p * q for p, q in zip(row, vector, strict=True))) for row in turn)
    return (x, y, z)


def euler_zxz(turn: Turn) -> tuple[Fraction, Fraction, Fraction]:
    """Angles γ, α, β (degrees) of R_z(γ)·R_x(α)·R_z(β); γ is zero where both z axes are in line."""
    (xx, _, xz), (yx, _, yz), (zx, zy, zz) = turn
    alpha = _degrees(sp.sqrt(_number(xz) ** 2 + _number(yz) ** 2), zz)
    if alpha % 180:
        return _degrees(xz, -yz), alpha, _degrees(zx, zy)
    return Fraction(0), alpha, _degrees(yx if alpha == 0 else -yx, xx)


def elementary(turn: Turn) -> list[Rotation]:
    """Rotations about axes, the innermost first, that make up `turn`.

    There are at most three.
    """
    gamma, alpha, beta = euler_zxz(turn)
    steps = (Rotation.degrees(Z, beta), Rotation.degrees(X, alpha), Rotation.degrees(Z, gamma))
    return [step for step in steps if not step.is_identity]


@cache
def _degrees(sine: sp.Expr, cosine: sp.Expr) -> Fraction:
    """The angle of a sine and a cosine, in degrees from 0 to 360."""
    angle = sp.atan2(_number(sine), _number(cosine)).evalf(_GUARD) * 180 / sp.pi.evalf(_GUARD)
    common = _COMMON_DEGREES * round(angle / _COMMON_DEGREES)
    if abs(angle - common) < _VANISHING:
        return Fraction(common) % 360
    return Fraction(str(angle)) % 360


def _number(entry: sp.Expr) -> sp.Float:
    return sp.Float(sp.N(entry, _GUARD), _GUARD)


def _turn(rows: Sequence[Sequence[sp.Expr]]) -> Turn:
    (a, b, c), (d, e, f), (g, h, i) = rows
    return ((a, b, c), (d, e, f), (g, h, i))
