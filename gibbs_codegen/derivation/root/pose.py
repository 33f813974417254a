"""Poses by quaternion and position: rotation matrix, rate, exponential map and logarithm of SE(3).

A pose is q = (x, y, z, w), the scalar last, with a position; it takes the base's frame to the
world. A twist is an angular and a linear part in the base's frame. Everything is straight-line:
2^-120 is added to the squared angle, so that sin θ/θ and the like are evaluated at θ ≥ 1e-18
instead of 0/0.

Derivatives of the exponential map are in the tangent spaces where it begins and ends. Of the turn φ
by the angle θ they are made of

    a = sin θ/θ,   b = (1 − cos θ)/θ²,   c = (θ − sin θ)/θ³

and of the rates b′ = (a − 2b)/θ² and c′ = (b − 3c)/θ² of b and c by θ, over θ; that of a is c − b.
Rounding of a and b over θ² does no harm, since b′ is multiplied by φ twice. That of 1 − a would:
c stands by one φ. So a series gives c up to θ = 1.
"""

from __future__ import annotations

import math

import sympy as sp

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

Quaternion = tuple[sp.Expr, sp.Expr, sp.Expr, sp.Expr]

# Added to squares of angles: far below the square of a rounding error, yet neither it nor its
# inverse is out of the range of single precision.
_TINY = sp.Rational(1, 2**120)


def rotation_columns(tape: Scalars, q: Quaternion) -> tuple[Vector, Vector, Vector]:
    """Columns of a unit quaternion's rotation matrix: the base's axes in the world."""
    let, (x, y, z, w) = tape.let, q
    dx, dy, dz = (let(2 * part) for part in (x, y, z))
    xx, yy, zz = let(x * dx), let(y * dy), let(z * dz)
    xy, xz, yz = let(y * dx), let(z * dx), let(z * dy)
    wx, wy, wz = let(w * dx), let(w * dy), let(w * dz)
    return (
        (let(1 - yy - zz), let(xy + wz), let(xz - wy)),
        (let(xy - wz), let(1 - xx - zz), let(yz + wx)),
        (let(xz + wy), let(yz - wx), let(1 - xx - yy)),
    )


def upward(tape: Scalars, q: Quaternion, length: sp.Expr) -> Vector:
    """A vector of a length along the world's Z in the base's frame."""
    let, (x, y, z, w) = tape.let, q
    a, b = let(2 * length * x), let(2 * length * y)
    return (let(a * z - b * w), let(b * z + a * w), let(length - a * x - b * y))


def turned(tape: Scalars, columns: tuple[Vector, Vector, Vector], vector: Vector) -> Vector:
    """A vector of the base's frame in the world, by the base's axes there."""
    x, y, z = (dot(tape, row, vector) for row in zip(*columns, strict=True))
    return (x, y, z)


def quaternion_rate(tape: Scalars, q: Quaternion, omega: Vector) -> Quaternion:
    """q̇ = ½ q ω, with ω in the base's frame (rad/s)."""
    x, y, z = scale(tape, sp.Rational(1, 2), omega)
    return _product(tape, q, (x, y, z, sp.S.Zero))


def displaced(
    tape: Scalars, q: Quaternion, position: Vector, turn: Vector, step: Vector
) -> tuple[Quaternion, Vector]:
    """The pose after a screw motion, `turn` (rad) and `step` (m): the exponential map of SE(3).

    With θ = |turn|, the attitude is turned by the quaternion of half that angle, and the step is ν
    + (1 − cos θ)/θ²·turn×ν + (θ − sin θ)/θ³·turn×(turn×ν). A quaternion that is not of unit length
    is normalised; where the square of its length is zero or overflows, the pose is not finite. Of q
    and −q the result is the one on the side of the quaternion that it starts from.
    """
    let = tape.let
    square, cosine, share = half_angle(tape, turn)
    with tape.group("angle of the displacement, and its functions"):
        first = let(2 * share * share)
        second = let(let(1 - 2 * share * cosine) * let(1 / square))
    with tape.group("the quaternion, of unit length, on the side of the new one"):
        squared = let(sp.Add(*(part * part for part in q)))
        # Not 1/√, which would make of a quaternion that is too long one that is zero.
        inverse = let(let(sp.sqrt(squared)) * let(1 / squared))
        q = _scaled(tape, let(inverse * let(sp.sign(cosine))), q)
    with tape.group("position after the displacement"):
        once = cross(tape, turn, step)
        twice = cross(tape, turn, once)
        way = add(tape, step, scale(tape, first, once), scale(tape, second, twice))
        moved = add(tape, position, turned(tape, rotation_columns(tape, q), way))
    with tape.group("attitude after the displacement"):
        x, y, z = scale(tape, share, turn)
        return _product(tape, q, (x, y, z, cosine)), moved


def displacement(
    tape: Scalars, start: tuple[Quaternion, Vector], end: tuple[Quaternion, Vector]
) -> tuple[Vector, Vector]:
    """Turn (rad, half a turn at most) and step (m) between two poses: the logarithm of SE(3).

    They are in the frame of the first pose; quaternions are of unit length. With φ half the angle
    the turn is twice φ/sin φ times the vector part of the quaternion between them, and the step is
    p − ½turn×p + (1 − φ cot φ)/(4φ²)·turn×(turn×p).
    """
    let, (q, origin) = tape.let, start
    back: Quaternion = (-q[0], -q[1], -q[2], q[3])
    with tape.group("quaternion from the first attitude to the second"):
        x, y, z, w = _product(tape, back, end[0])
        part: Vector = (x, y, z)
    with tape.group("half the angle between them, over its sine"):
        side = let(sp.sign(w))
        cosine = let(side * w)
        square = let(dot(tape, part, part) + _TINY)
        sine = let(sp.sqrt(square))
        quarter = let(sp.atan(let(sine * let(1 / let(1 + cosine)))))
        ratio = let(2 * quarter * let(1 / sine))
    with tape.group("displacement"):
        columns = rotation_columns(tape, back)
        way = turned(tape, columns, add(tape, end[1], minus(origin)))
        twice = let(2 * side * ratio)
        turn = scale(tape, twice, part)
        bend = let(let(1 - ratio * cosine) * let(1 / square))
        across = cross(tape, part, way)
        again = scale(tape, bend, cross(tape, part, across))
        return turn, add(tape, way, minus(scale(tape, let(side * ratio), across)), again)


def half_angle(tape: Scalars, turn: Vector) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    """θ², cos θ/2, and sin(θ/2)/θ of the angle θ of a turn, axis times angle (rad)."""
    let = tape.let
    with tape.group("angle of the displacement, and its functions"):
        square = let(dot(tape, turn, turn) + _TINY)
        angle = let(sp.sqrt(square))
        half = let(angle / 2)
        return square, let(sp.cos(half)), let(let(sp.sin(half)) * let(1 / angle))


def _product(tape: Scalars, p: Quaternion, q: Quaternion) -> Quaternion:
    (a, b, c, d), (x, y, z, w) = p, q
    return (
        tape.let(d * x + a * w + b * z - c * y),
        tape.let(d * y + b * w + c * x - a * z),
        tape.let(d * z + c * w + a * y - b * x),
        tape.let(d * w - a * x - b * y - c * z),
    )


def _scaled(tape: Scalars, factor: sp.Expr, q: Quaternion) -> Quaternion:
    x, y, z, w = (tape.let(factor * part) for part in q)
    return (x, y, z, w)


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
