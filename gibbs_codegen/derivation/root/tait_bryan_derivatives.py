"""Derivatives by the angles of a base with Tait–Bryan angles, and by their rates.

The angles are joints about axes through the origin. The first two are taken in the frame between
their rotations and the third in the frame between it and the second, where their axes are
coordinate axes. The position and its rate enter no force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.root.protocol import Values
from gibbs_codegen.derivation.unit_motions import Column, MovingBody, UnitMotion, column
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import Matrix, Rotation, zeros


@dataclass(frozen=True)
class TaitBryanDerivatives:
    """Axes and rotations of the angles, and what each does in its frame.

    `inner` are the rotations from the root's group frame to the frame between the second and the
    third angle.
    """

    axes: tuple[int, int, int]
    rotations: tuple[Rotation, Rotation, Rotation]
    inner: Sequence[Rotation]
    units: tuple[UnitMotion, UnitMotion, UnitMotion]

    def coriolis(self, tape: Scalars) -> TaitBryanDerivatives:
        """Itself: velocities are rates of coordinates."""
        return self

    def row(self, tape: Scalars, joint: Column) -> tuple[Values, Values]:
        """Derivatives by θ₋₁, θ₀, θ₁, x, y, z, and by their rates."""
        by_angle, by_rate = [sp.S.Zero] * 6, [sp.S.Zero] * 6
        with tape.group("derivatives by attitude and position, and by their rates"):
            joint = joint.turned(tape, self.inner)
            for i in (2, 1, 0):
                joint = joint.turned(tape, self._turns(i))
                by_angle[i] = joint.by_angle(tape, self.units[i])
                by_rate[i] = joint.by_rate(tape, self.units[i])
        return by_angle, by_rate

    def blocks(self, tape: Scalars, body: MovingBody, mass_block: Matrix) -> tuple[Matrix, Matrix]:
        """Rows for θ₋₁, θ₀, θ₁, x, y, z, and columns as of `row`; `mass_block` is not used."""
        by_angle, by_rate = zeros(6, 6), zeros(6, 6)
        with tape.group("derivatives of the forces on attitude and position by themselves"):
            body = body.turned(tape, self.inner)
            for j in (2, 1, 0):
                body = body.turned(tape, self._turns(j))
                taken = column(tape, self.units[j], body)
                for i in range(j, -1, -1):
                    taken = taken.turned(tape, self._turns(i)) if i < j else taken
                    by_angle[j][i] = taken.by_angle(tape, self.units[i])
                    by_rate[j][i] = taken.by_rate(tape, self.units[i])
                    by_angle[i][j] = taken.angle.moment[self.axes[i]]
                    by_rate[i][j] = taken.rate.moment[self.axes[i]]
                taken = taken.turned(tape, self.rotations[:1])
                for i in range(3):
                    by_angle[3 + i][j] = taken.angle.force[i]
                    by_rate[3 + i][j] = taken.rate.force[i]
        return by_angle, by_rate

    def _turns(self, i: int) -> Sequence[Rotation]:
        """Rotations from the frame of the next angle to that of angle i: one for the second."""
        return self.rotations[1:2] if i == 1 else ()
