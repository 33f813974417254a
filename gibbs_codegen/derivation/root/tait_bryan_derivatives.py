"""Derivatives by the angles of a base with Tait–Bryan angles, and by their rates.

The angles are joints about axes through the origin. The second and the third axis are taken in the
frame between their rotations, where both are coordinate axes; the first, which the world holds, in
world axes. The position and its rate enter no force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import sympy as sp

from gibbs_codegen.derivation.motion import Motion
from gibbs_codegen.derivation.root.protocol import Values
from gibbs_codegen.derivation.unit_motions import STILL, Column, MovingBody, UnitMotion, column
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    ZERO,
    Matrix,
    Rotation,
    Vector,
    add,
    axis_vector,
    cross,
    zeros,
)


@dataclass(frozen=True)
class TaitBryanDerivatives:
    """Axes and rotations of the angles, and the motion.

    `inner` are the rotations from the root's group frame to the frame between the second and the
    third angle, whose motion is `motion`. `rates` and `accelerations` are those of θ₋₁, θ₀, θ₁, x,
    y and z, and `linear` is the acceleration of the origin in world axes, gravity included (m/s²).
    """

    axes: tuple[int, int, int]
    rotations: tuple[Rotation, Rotation, Rotation]
    inner: Sequence[Rotation]
    motion: Motion
    rates: Values
    accelerations: Values
    linear: Vector

    def row(self, tape: Scalars, joint: Column) -> tuple[Values, Values]:
        """How the force on a joint depends on the base.

        Args:
            joint: Its column about the origin, in the root's group frame.

        Returns:
            Derivatives by θ₋₁, θ₀, θ₁, x, y, z, and by their rates.
        """
        with tape.group("derivatives by attitude and position, and by their rates"):
            first, *others = self._units(tape)
            between = joint.turned(tape, self.inner)
            world = between.turned(tape, self._outer)
            still = [sp.S.Zero] * 3
            by_angle = [between.by_angle(tape, unit) for unit in others]
            by_rate = [between.by_rate(tape, unit) for unit in others]
            return (
                [world.by_angle(tape, first), *by_angle, *still],
                [world.by_rate(tape, first), *by_rate, *still],
            )

    def blocks(self, tape: Scalars, body: MovingBody, mass_block: Matrix) -> tuple[Matrix, Matrix]:
        """How the forces on the base depend on the base.

        Args:
            body: The whole robot about the origin, in the root's group frame, its mass and its
                inertia force without those of the root's own mass.
            mass_block: The base's block of the mass matrix.

        Returns:
            Rows for θ₋₁, θ₀, θ₁, x, y, z, and columns as of `row`.
        """
        by_angle, by_rate = zeros(6, 6), zeros(6, 6)
        units, axes = self._units(tape), self.axes
        with tape.group("derivatives of the forces on attitude and position by themselves"):
            body = body.turned(tape, self.inner)
            in_world = column(tape, units[0], body.turned(tape, self._outer))
            for j, unit in enumerate(units):
                between = column(tape, unit, body)
                world = between.turned(tape, self._outer) if j else in_world
                x, y, z = mass_block[j][3:]
                world = replace(world, mass=replace(world.mass, force=(x, y, z)))
                for matrix, depends, part in (
                    (by_angle, Column.by_angle, attrgetter("angle")),
                    (by_rate, Column.by_rate, attrgetter("rate")),
                ):
                    for i in range(1, j):
                        matrix[j][i] = depends(between, tape, units[i])
                    for i in range(1, j + 1):
                        matrix[i][j] = part(between).moment[axes[i]]
                    matrix[0][j] = part(world).moment[axes[0]]
                    matrix[j][0] = depends(world, tape, units[0])
                    for i, force in enumerate(part(world).force):
                        matrix[3 + i][j] = force
        return by_angle, by_rate

    @property
    def _outer(self) -> tuple[Rotation, Rotation]:
        """Rotations from between the second and the third angle to the world."""
        first, second, _ = self.rotations
        return (second, first)

    def _units(self, tape: Scalars) -> list[UnitMotion]:
        """What the angles do about the origin: the first in world axes, the others between."""
        a, b, c = self.axes
        inward = self.rotations[1].inverse
        rate = inward.vector(tape, axis_vector(a, self.rates[0]))
        turning = inward.vector(tape, axis_vector(a, self.accelerations[0]))
        square = tape.let(self.rates[0] * self.rates[0])
        gain = add(tape, cross(tape, turning, axis_vector(b)), axis_vector(b, -square))
        before = replace(self.motion, omega=rate)
        gradient = [*before.gradient]
        gradient[b] = gain
        x, y, z = gradient
        before = replace(before, gradient=(x, y, z))
        return [
            replace(
                STILL,
                axis=axis_vector(a),
                linear_acceleration=cross(tape, self.linear, axis_vector(a)),
            ),
            UnitMotion.turning(tape, b, before, ZERO),
            UnitMotion.turning(tape, c, self.motion, ZERO),
        ]
