"""Vectors, elementary rotations and wrenches over scalars that a tape names."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from gibbs_codegen.symbolic.exact_angles import cos_sin_deg
from gibbs_codegen.symbolic.tape import Scalars

Vector = tuple[sp.Expr, sp.Expr, sp.Expr]

ZERO: Vector = (sp.S.Zero,) * 3
X, Y, Z = 0, 1, 2


def axis_vector(axis: int, length: sp.Expr = sp.S.One) -> Vector:
    """`length` along a coordinate axis."""
    x, y, z = (length if i == axis else sp.S.Zero for i in range(3))
    return (x, y, z)


def add(tape: Scalars, *vectors: Vector) -> Vector:
    """Sum of vectors."""
    x, y, z = (tape.let(sp.Add(*entries)) for entries in zip(*vectors, strict=True))
    return (x, y, z)


def scale(tape: Scalars, factor: sp.Expr, vector: Vector) -> Vector:
    """Vector times scalar."""
    x, y, z = (tape.let(factor * entry) for entry in vector)
    return (x, y, z)


def cross(tape: Scalars, a: Vector, b: Vector) -> Vector:
    """Vector product a × b."""
    x, y, z = (
        tape.let(a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
        for i in range(3)
    )
    return (x, y, z)


def dot(tape: Scalars, a: Vector, b: Vector) -> sp.Expr:
    """Scalar product a·b."""
    return tape.let(sp.Add(*(p * q for p, q in zip(a, b, strict=True))))


@dataclass(frozen=True)
class Rotation:
    """Rotation by an angle about a coordinate axis, given by its cosine and sine.

    It takes components in the turned frame to components in the frame it was turned from.
    """

    axis: int
    cos: sp.Expr
    sin: sp.Expr

    @classmethod
    def degrees(cls, axis: int, angle: Fraction) -> Rotation:
        """Rotation by a structural angle."""
        return cls(axis, *cos_sin_deg(angle))

    @classmethod
    def angle(cls, tape: Scalars, axis: int, angle: sp.Expr) -> Rotation:
        """Rotation by an angle in radians."""
        angle = tape.let(angle)
        return cls(axis, tape.let(sp.cos(angle)), tape.let(sp.sin(angle)))

    @property
    def inverse(self) -> Rotation:
        """The rotation back."""
        return Rotation(self.axis, self.cos, -self.sin)

    @property
    def is_identity(self) -> bool:
        """Whether nothing turns."""
        return bool(self.cos == 1)

    def vector(self, tape: Scalars, v: Vector) -> Vector:
        """Components of `v` in the frame turned from."""
        p, q = (self.axis + 1) % 3, (self.axis + 2) % 3
        turned = list(v)
        turned[p] = tape.let(self.cos * v[p] - self.sin * v[q])
        turned[q] = tape.let(self.sin * v[p] + self.cos * v[q])
        return (turned[0], turned[1], turned[2])


NO_ROTATION = Rotation(Z, sp.S.One, sp.S.Zero)


@dataclass(frozen=True)
class Wrench:
    """A force and a moment about a point, or any pair of vectors that moves like one."""

    force: Vector
    moment: Vector

    def rotated(self, tape: Scalars, rotation: Rotation) -> Wrench:
        """The same wrench in the frame turned from."""
        return Wrench(rotation.vector(tape, self.force), rotation.vector(tape, self.moment))

    def shifted(self, tape: Scalars, arm: Vector) -> Wrench:
        """The same wrench about a point from which its old point is at `arm`."""
        lever = tuple(
            arm[(i + 1) % 3] * self.force[(i + 2) % 3] - arm[(i + 2) % 3] * self.force[(i + 1) % 3]
            for i in range(3)
        )
        x, y, z = (tape.let(n + m) for n, m in zip(self.moment, lever, strict=True))
        return Wrench(self.force, (x, y, z))

    def plus(self, tape: Scalars, other: Wrench) -> Wrench:
        """Sum of two wrenches about one point."""
        return Wrench(add(tape, self.force, other.force), add(tape, self.moment, other.moment))


NO_WRENCH = Wrench(ZERO, ZERO)
