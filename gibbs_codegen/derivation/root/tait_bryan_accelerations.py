"""Derivatives of the accelerations of Tait–Bryan angles and of the origin's world coordinates.

They are taken in the frame between the second rotation and the third, where the axes of the angles
are g = cos θ₀·e_a + σ sin θ₀·e_c, e_b and e_c, with σ = 1 for cyclic sequences and −1 for others:

    ω = θ̇₋₁g + θ̇₀e_b + θ̇₁e_c,    dω/dt = θ̈₋₁g + θ̈₀e_b + θ̈₁e_c + b

A change of an angle turns the robot as a whole, which its dynamics relative to free fall do not
notice, and changes ω, b and g; a change of a rate changes ω and b.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.acceleration_column import AccelerationColumn, combination
from gibbs_codegen.derivation.motion import Acceleration
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import ZERO, Rotation, Vector, axis_vector, cross, dot, scale

Row = Sequence[sp.Expr]


@dataclass(frozen=True)
class TaitBryanFrame:
    """The frame between the second rotation and the third, seen from that of the derivatives.

    `axes` are those of the sequence, a, b and c, and `vectors` the frame's axes x, y and z there.
    `cos` is cos θ₀ and `sin` is σ sin θ₀; `outer` are the first two rotations.
    """

    axes: tuple[int, int, int]
    outer: tuple[Rotation, Rotation]
    vectors: tuple[Vector, Vector, Vector]
    cos: sp.Expr
    sin: sp.Expr

    @property
    def sign(self) -> int:
        """σ."""
        a, b, _ = self.axes
        return 1 if (b - a) % 3 == 1 else -1

    def seen(self, tape: Scalars, vector: Vector) -> Vector:
        """A vector of the frame of the derivatives in this frame."""
        x, y, z = (dot(tape, axis, vector) for axis in self.vectors)
        return (x, y, z)

    def rows(self, tape: Scalars) -> Callable[[Acceleration], Row]:
        """θ̈₋₁, θ̈₀, θ̈₁, ẍ, ÿ, z̈ as a linear function of a motion of the base.

        The motion is r̈ and the share of θ̈₋₁, θ̈₀, θ̈₁ in dω/dt, in the frame of the derivatives.
        """
        a, b, c = self.axes
        first = scale(tape, tape.let(1 / self.cos), self.vectors[a])
        images = [self.world(tape, self.seen(tape, axis_vector(k))) for k in range(3)]

        def converted(motion: Acceleration) -> Row:
            angle = dot(tape, first, motion.angular)
            last = dot(tape, self.vectors[c], motion.angular)
            linear = combination(tape, motion.linear, images)
            middle = dot(tape, self.vectors[b], motion.angular)
            return [angle, middle, tape.let(last - tape.let(self.sin * angle)), *linear]

        return converted

    def world(self, tape: Scalars, vector: Vector) -> Vector:
        """World components of a vector of this frame."""
        first, second = self.outer
        return first.vector(tape, second.vector(tape, vector))

    def angles(self, tape: Scalars, vector: Vector) -> Row:
        """θ̈₋₁, θ̈₀, θ̈₁ whose sum times their axes is a vector of this frame."""
        a, b, c = self.axes
        first = tape.let(vector[a] * tape.let(1 / self.cos))
        return [first, vector[b], tape.let(vector[c] - tape.let(self.sin * first))]

    def vector(self, along_a: sp.Expr, along_b: sp.Expr, along_c: sp.Expr) -> Vector:
        """A vector of this frame by its components along e_a, e_b and e_c."""
        entries = dict(zip(self.axes, (along_a, along_b, along_c), strict=True))
        return (entries[0], entries[1], entries[2])


def state_columns(
    tape: Scalars,
    frame: TaitBryanFrame,
    turning: Sequence[AccelerationColumn],
    linear: Vector,
    rates: Sequence[sp.Expr],
    accelerations: Sequence[sp.Expr],
) -> tuple[list[Row], list[Row]]:
    """Columns for θ₋₁, θ₀, θ₁, x, y, z, and for their rates, with the rows of the base first.

    `turning` are columns of dω/dt, r̈ and the joints for a change of each component of ω, in the
    frame of the derivatives; `linear` is r̈ of the origin relative to free fall, in `frame`.
    """
    convert = frame.rows(tape)
    about: list[Row] = []
    for axis in frame.axes:
        column = AccelerationColumn.combined(tape, frame.vectors[axis], turning)
        about.append([*convert(column.root), *column.joints])
    nothing = [sp.S.Zero] * len(about[0])
    changes = _Changes(tape, frame, about, rates, accelerations)
    by_angles = [
        changes.by_first(linear),
        changes.by_second(linear),
        changes.by_third(linear),
    ]
    return [*by_angles, *[nothing] * 3], [*changes.by_rates(), *[nothing] * 3]


@dataclass(frozen=True)
class _Changes:
    """Columns of the angles and of their rates.

    `about` are the columns of a change of ω about e_a, e_b and e_c.
    """

    tape: Scalars
    frame: TaitBryanFrame
    about: list[Row]
    rates: Sequence[sp.Expr]
    accelerations: Sequence[sp.Expr]

    def by_rates(self) -> list[Row]:
        """By θ̇₋₁, θ̇₀ and θ̇₁."""
        let, frame, sign, zero = self.tape.let, self.frame, self.frame.sign, sp.S.Zero
        first, second, third = self.rates[:3]
        a, b, c = self.about
        cos, sin = frame.cos, frame.sin
        turned = let(cos * first)
        by_first = combination(self.tape, (cos, sin), (a, c))
        return [
            self._less(
                by_first,
                frame.vector(
                    let(-sign * sin * second), let(-sign * cos * third), let(sign * cos * second)
                ),
            ),
            self._less(
                b, frame.vector(let(sign * let(third - let(sin * first))), zero, sign * turned)
            ),
            self._less(c, frame.vector(sign * second, -sign * turned, zero)),
        ]

    def by_first(self, r: Vector) -> Row:
        """By θ₋₁, which turns r̈ in the world; r is relative to free fall, in the frame."""
        axis = axis_vector(self.frame.axes[0])
        linear = cross(self.tape, axis, self.frame.world(self.tape, r))
        return self._with([sp.S.Zero] * len(self.about[0]), [sp.S.Zero] * 3, linear)

    def by_second(self, r: Vector) -> Row:
        """By θ₀, which turns g besides."""
        tape, let, frame, sign = self.tape, self.tape.let, self.frame, self.frame.sign
        first, second, third = self.rates[:3]
        a, _, c = self.about
        cos, sin = frame.cos, frame.sin
        along_a, along_c = let(sin * first), let(cos * first)
        column: Row = combination(tape, (-sign * along_a, sign * along_c), (a, c))
        column = self._less(
            column,
            frame.vector(let(-along_c * second), let(along_a * third), let(-along_a * second)),
        )
        gain = let(sign * let(sin * let(1 / cos)) * self.accelerations[0])
        last = let(-let(sin * gain) - let(sign * cos * self.accelerations[0]))
        outer, inner = frame.outer
        linear = outer.vector(tape, cross(tape, axis_vector(frame.axes[1]), inner.vector(tape, r)))
        return self._with(column, [gain, sp.S.Zero, last], linear)

    def by_third(self, r: Vector) -> Row:
        """By θ₁, which turns the base in the frame."""
        tape, let, frame, sign = self.tape, self.tape.let, self.frame, self.frame.sign
        first, second, third = self.rates[:3]
        turned = let(frame.cos * first)
        a, b, _ = self.about
        column = combination(tape, (sign * second, -sign * turned), (a, b))
        along_a = let(
            frame.cos * self.accelerations[0] + sign * second * let(third - let(frame.sin * first))
        )
        along_b = let(self.accelerations[1] - sign * let(third * turned))
        angles = frame.angles(tape, frame.vector(-sign * along_b, sign * along_a, sp.S.Zero))
        linear = frame.world(tape, cross(tape, axis_vector(frame.axes[2]), r))
        return self._with(column, angles, linear)

    def _less(self, column: Row, bias: Vector) -> Row:
        """A column less what a change of b takes from the angles' accelerations."""
        angles = self.frame.angles(self.tape, bias)
        return self._with(column, [-angle for angle in angles], ZERO)

    def _with(self, column: Row, angles: Sequence[sp.Expr], linear: Vector) -> Row:
        """A column with accelerations added for the angles, and for the world coordinates."""
        pairs = zip(column[:6], (*angles, *linear), strict=True)
        return [*(self.tape.let(p + q) for p, q in pairs), *column[6:]]
