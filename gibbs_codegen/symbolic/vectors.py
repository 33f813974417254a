"""Vectors, matrices, elementary rotations and wrenches over scalars that a tape names.

Sines and cosines of angles that the robot file fixes are exact for multiples of 30° and 45°;
coefficients that are made of them, and vanish by symmetry, are recognised as zero.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import Protocol, Self, TypeVar

import sympy as sp

from gibbs_codegen.symbolic.numbers import DIGITS, settled
from gibbs_codegen.symbolic.tape import Scalars, Vector, negated, plus, times


@cache
def cos_sin_deg(angle: Fraction) -> tuple[sp.Expr, sp.Expr]:
    """Cosine and sine of an angle in degrees: exact for n·30° and n·45°, else to forty digits."""
    angle %= 360
    exact = radians(angle)
    if angle % 30 == 0 or angle % 45 == 0:
        return sp.cos(exact), sp.sin(exact)
    turned = exact.evalf(DIGITS + 5)
    return structural_number(sp.cos(turned)), structural_number(sp.sin(turned))


def structural_number(number: sp.Float) -> sp.Expr:
    """A number that the robot file fixes: an integer where it is whole.

    SymPy drops a factor of one only where it is an integer; whether 1.0 equals 1 depends on its
    version.
    """
    whole = sp.Integer(int(number))
    return whole if (number - whole).is_zero else number


def radians(angle: Fraction) -> sp.Expr:
    """An angle of degrees in radians, as an exact multiple of π."""
    return sp.Rational(angle.numerator, angle.denominator) * sp.pi / 180


def gather(expression: sp.Expr) -> sp.Expr:
    """Expand, add the structural coefficients of like terms, and drop those that vanish."""
    coefficients: dict[sp.Expr, sp.Expr] = {}
    for term in sp.Add.make_args(sp.expand(expression)):
        factors = sp.Mul.make_args(term)
        number = sp.Mul(*(factor for factor in factors if factor.is_number))
        rest = sp.Mul(*(factor for factor in factors if not factor.is_number))
        coefficients[rest] = coefficients.get(rest, sp.S.Zero) + number
    return sp.Add(*(settled(number) * rest for rest, number in coefficients.items()))


Matrix = list[list[sp.Expr]]

ZERO: Vector = (sp.S.Zero,) * 3
X, Y, Z = 0, 1, 2


def zeros(rows: int, columns: int) -> Matrix:
    """A matrix of zeros by rows, to be filled."""
    return [[sp.S.Zero] * columns for _ in range(rows)]


def identity(size: int) -> Matrix:
    """An identity matrix, by rows."""
    return [[sp.Integer(i == j) for j in range(size)] for i in range(size)]


def axis_vector(axis: int, length: sp.Expr = sp.S.One) -> Vector:
    """A vector along X, Y or Z."""
    return tuple(length if i == axis else sp.S.Zero for i in range(3))


def minus(vector: Vector) -> Vector:
    """The opposite of a vector of symbols and numbers, whose signs need no names on a tape."""
    x, y, z = vector
    return (-x, -y, -z)


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
        """Rotation by a structural angle in degrees, exact where its sine and cosine are."""
        return cls(axis, *cos_sin_deg(angle))

    @classmethod
    def angle(cls, tape: Scalars, axis: int, angle: sp.Expr) -> Rotation:
        """Rotation by an angle that varies (rad), with sine and cosine named on the tape."""
        angle = tape.let(angle)
        return cls(axis, tape.let(sp.cos(angle)), tape.let(sp.sin(angle)))

    @property
    def inverse(self) -> Rotation:
        """The rotation back."""
        return Rotation(self.axis, self.cos, -self.sin)

    @property
    def is_identity(self) -> bool:
        """True if nothing turns."""
        return bool(self.cos == 1)

    @property
    def plane(self) -> tuple[int, int]:
        """The two axes that turn, in cyclic order after the axis of rotation."""
        return (self.axis + 1) % 3, (self.axis + 2) % 3

    def turned(self, tape: Scalars, p: sp.Expr, q: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
        """Two components along the plane's axes, from the turned frame to the one turned from."""
        c, s = self.cos, self.sin
        return tape.less(times(c, p), times(s, q)), tape.let(plus(times(s, p), times(c, q)))

    def vector(self, tape: Scalars, v: Vector) -> Vector:
        """A vector of the turned frame in the frame turned from."""
        p, q = self.plane
        turned = list(v)
        turned[p], turned[q] = self.turned(tape, v[p], v[q])
        return (turned[0], turned[1], turned[2])


NO_ROTATION = Rotation(Z, sp.S.One, sp.S.Zero)


def turned_axes(tape: Scalars, rotations: Sequence[Rotation]) -> tuple[Vector, ...]:
    """Axes of a frame in another, to which `rotations` take components one after the other."""
    axes = [axis_vector(axis) for axis in (X, Y, Z)]
    for rotation in rotations:
        axes = [rotation.vector(tape, axis) for axis in axes]
    return (axes[0], axes[1], axes[2])


@dataclass(frozen=True)
class Wrench:
    """A force and a moment about a point, or any pair of vectors that moves like one."""

    force: Vector
    moment: Vector

    @classmethod
    def of(cls, entries: Iterable[sp.Expr]) -> Wrench:
        """A wrench by its six components, of the force and then of the moment."""
        x, y, z, p, q, r = entries
        return cls((x, y, z), (p, q, r))

    @property
    def entries(self) -> list[sp.Expr]:
        """The six components."""
        return [*self.force, *self.moment]

    @property
    def opposite(self) -> Wrench:
        """The wrench that balances this one."""
        return Wrench(minus(self.force), minus(self.moment))

    def rotated(self, tape: Scalars, rotation: Rotation) -> Wrench:
        """The same wrench in another frame, to which `rotation` takes components."""
        return Wrench(rotation.vector(tape, self.force), rotation.vector(tape, self.moment))

    def shifted(self, tape: Scalars, arm: Vector) -> Wrench:
        """The same wrench about another point; `arm` is the old point from the new one (m)."""
        lever = tuple(
            (times(arm[i - 2], self.force[i - 1]), negated(times(arm[i - 1], self.force[i - 2])))
            for i in range(3)
        )
        x, y, z = (tape.let(plus(n, *m)) for n, m in zip(self.moment, lever, strict=True))
        return Wrench(self.force, (x, y, z))

    def plus(self, tape: Scalars, other: Wrench) -> Wrench:
        """Sum of two wrenches about one point, in one frame."""
        return Wrench(tape.add(self.force, other.force), tape.add(self.moment, other.moment))

    def turned_with(self, tape: Scalars, velocity: Vector, omega: Vector) -> Wrench:
        """Rates of the components of momenta along axes that move with a velocity and ω."""
        moment = tape.cross(self.moment, omega), tape.cross(self.force, velocity)
        return Wrench(tape.cross(self.force, omega), tape.add(*moment))


NO_WRENCH = Wrench(ZERO, ZERO)


class Movable(Protocol):
    """A quantity that is seen from a frame and about its origin, such as a wrench or an inertia."""

    def rotated(self, tape: Scalars, rotation: Rotation) -> Self:
        """The same in another frame, to which `rotation` takes components."""

    def shifted(self, tape: Scalars, arm: Vector) -> Self:
        """The same about another point; `arm` is the old point from the new one (m)."""


# Rotations and shifts, one after the other, from one frame to another.
Transform = Sequence[Rotation | Vector]
Moved = TypeVar("Moved", bound=Movable)


def moved(tape: Scalars, item: Moved, transform: Transform) -> Moved:
    """The same from where a transform ends as an item from where it begins."""
    for step in transform:
        item = item.rotated(tape, step) if isinstance(step, Rotation) else item.shifted(tape, step)
    return item
