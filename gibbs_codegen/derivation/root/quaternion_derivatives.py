"""Derivatives by the motion of a base with a quaternion, in its own frame.

The attitude enters through the direction of gravity alone: a turn φ of the base changes the upward
acceleration g in its frame by g×φ. The linear velocity enters through ω×v. So what depends on
either is what the force takes of an acceleration of the origin, a column of the mass matrix. A unit
of the angular velocity about an axis e of the base makes the accelerations 2e×ẋ + (ω×e)×ρ, and e×v
of the origin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.root.protocol import Values
from gibbs_codegen.derivation.unit_motions import STILL, Column, MovingBody, column
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    ZERO,
    Matrix,
    Vector,
    Wrench,
    add,
    axis_vector,
    cross,
    scale,
    zeros,
)


@dataclass(frozen=True)
class QuaternionDerivatives:
    """ω, the velocity of the origin and the upward acceleration of gravity in the base's frame."""

    omega: Vector
    velocity: Vector
    upward: Vector

    def coriolis(self, tape: Scalars) -> QuaternionDerivatives:
        """The same for the accelerations that make 2C in place of derivatives by velocities.

        They are 2e×ẋ + 2(ω×e)×ρ of a turn about an axis e of the base, and 2ω×e of a motion along
        it.
        """
        return replace(self, omega=scale(tape, sp.Integer(2), self.omega), velocity=ZERO)

    def row(self, tape: Scalars, joint: Column) -> tuple[Values, Values]:
        """Derivatives by turn and displacement of the base, and by ω and v, in its frame."""
        force, moment = joint.mass.force, joint.mass.moment
        with tape.group("derivatives by the attitude"):
            turning = cross(tape, force, self.upward)
        with tape.group("derivatives by the velocity of the base"):
            linear = cross(tape, force, self.omega)
            angular = add(
                tape,
                cross(tape, moment, self.omega),
                cross(tape, self.velocity, force),
                joint.couple,
            )
        return (*turning, *(sp.S.Zero,) * 3), (*angular, *linear)

    def blocks(self, tape: Scalars, body: MovingBody, mass_block: Matrix) -> tuple[Matrix, Matrix]:
        """Rows of the moment and then of the force; the mass is that of `mass_block`."""
        by_place, by_rate = zeros(6, 6), zeros(6, 6)
        body = replace(body, inertia=replace(body.inertia, mass=mass_block[3][3]))
        with tape.group("derivatives of the forces on the base by its own motion"):
            for i in range(3):
                axis = axis_vector(i)
                moved = replace(
                    STILL,
                    linear_rate=cross(tape, self.omega, axis),
                    linear_acceleration=cross(tape, self.upward, axis),
                )
                turned = replace(
                    STILL,
                    axis=axis,
                    twice_rate=cross(tape, self.omega, axis),
                    linear_rate=cross(tape, axis, self.velocity),
                )
                shifting, turning = column(tape, moved, body), column(tape, turned, body)
                _put(by_place, i, shifting.angle)
                _put(by_rate, i, turning.rate)
                _put(by_rate, 3 + i, shifting.rate)
        return by_place, by_rate


def _put(matrix: Matrix, place: int, wrench: Wrench) -> None:
    """Set column `place` of a matrix of six rows to a moment and a force."""
    for row, entry in zip(matrix, (*wrench.moment, *wrench.force), strict=True):
        row[place] = entry
