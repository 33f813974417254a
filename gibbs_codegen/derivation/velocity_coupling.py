"""What a subtree feels when all of it is turned at an additional rate: its Coriolis force.

Every point that moves with ẋ is accelerated by 2ε×ẋ more when all turns at the rate ε besides. With
P = ∫ẋdm and D = ∫ρẋᵀdm about a joint, that takes the force ε×2P and the moment 2(tr D·1 − Dᵀ)ε:
two 3×3 matrices, which move like a wrench with three columns. Velocities are against that of the
root's origin, the same for all links, so nothing changes when the sum passes a joint; a free joint
takes its direction out, as it does with the articulated inertia.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.articulated_inertia import Block, rotated_block
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.symbolic.quick import times
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import ZERO, Rotation, Vector, add, cross, scale


@dataclass(frozen=True)
class VelocityCoupling:
    """The matrices by rows: force and moment for a rate ε."""

    force: Block
    moment: Block

    @classmethod
    def rigid(
        cls, tape: Scalars, inertia: Inertia, omega: Vector, velocity: Vector
    ) -> VelocityCoupling:
        """Of a rigid body about a point; `omega` and `velocity` are twice its ω and the point's."""
        first = inertia.moment
        x, y, z = add(tape, cross(tape, omega, first), scale(tape, inertia.mass, velocity))
        spins = [cross(tape, omega, _row(inertia, i)) for i in range(3)]
        d = [add(tape, spins[i], scale(tape, first[i], velocity)) for i in range(3)]

        def entry(i: int, j: int) -> sp.Expr:
            if i != j:
                return -d[j][i]
            return tape.let(d[i - 2][i - 2] + d[i - 1][i - 1])

        zero = sp.S.Zero
        return cls(
            ((zero, z, -y), (-z, zero, x), (y, -x, zero)),
            _block([[entry(i, j) for j in range(3)] for i in range(3)]),
        )

    @property
    def rows(self) -> list[Vector]:
        """All six rows."""
        return [*self.force, *self.moment]

    def plus(self, tape: Scalars, other: VelocityCoupling) -> VelocityCoupling:
        """Of both subtrees about one point, in one frame."""
        return _of_rows([add(tape, a, b) for a, b in zip(self.rows, other.rows, strict=True)])

    def rotated(self, tape: Scalars, rotation: Rotation) -> VelocityCoupling:
        """The same in another frame, to which `rotation` takes components."""
        if rotation.is_identity:
            return self
        return VelocityCoupling(
            rotated_block(tape, rotation, self.force), rotated_block(tape, rotation, self.moment)
        )

    def shifted(self, tape: Scalars, arm: Vector) -> VelocityCoupling:
        """The same about another point; `arm` is the old point from the new one (m)."""
        if arm == ZERO:
            return self
        force, moment = self.force, self.moment
        rows = [
            [
                tape.let(
                    moment[i][j]
                    + times(arm[i - 2], force[i - 1][j])
                    - times(arm[i - 1], force[i - 2][j])
                )
                for j in range(3)
            ]
            for i in range(3)
        ]
        return VelocityCoupling(force, _block(rows))

    def without(
        self, tape: Scalars, direction: int, ratios: Sequence[sp.Expr], left: Vector
    ) -> VelocityCoupling:
        """What the parent feels while a joint, of direction 0 … 5, is free.

        `ratios` are those of its solved equation, row by row. `left` is what is left of the joint's
        own row, zero without armature: written as a difference it would cancel.
        """
        own = self.rows[direction]
        return _of_rows(
            [
                left if i == direction else add(tape, row, scale(tape, -ratio, own))
                for i, (row, ratio) in enumerate(zip(self.rows, ratios, strict=True))
            ]
        )


NO_COUPLING = VelocityCoupling((ZERO,) * 3, (ZERO,) * 3)


def _row(inertia: Inertia, i: int) -> Vector:
    return (inertia.entry(i, 0), inertia.entry(i, 1), inertia.entry(i, 2))


def _of_rows(rows: Sequence[Vector]) -> VelocityCoupling:
    return VelocityCoupling((rows[0], rows[1], rows[2]), (rows[3], rows[4], rows[5]))


def _block(rows: Sequence[Sequence[sp.Expr]]) -> Block:
    x, y, z = ((a, b, c) for a, b, c in rows)
    return (x, y, z)
