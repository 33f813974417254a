"""The root of a base that stays level: it turns about z alone, and may not move at all.

What moves has the quasi-velocities of the quaternion's root, along and about the base's own axes,
with an angle, the yaw, for its attitude. Components of the six that the base does not have are left
out: `Places` put zeros where they would be and drop what belongs to them. They are the same in
every frame that is turned about z, so nothing has to be projected.

Displacements are those of the exponential map of the plane, and along z. With a = sin θ/θ and
b = (1 − cos θ)/θ, a step (x, y) is a·(x, y) + b·(−y, x) in the axes before it; and back, with
h = θ/2 cot θ/2, it is h·(x, y) + θ/2·(y, −x), for angles up to a whole turn.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.root.quaternion import QuaternionRoot, half_angle
from gibbs_codegen.robot.layout import Places, velocity_places
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector
from gibbs_codegen.symbolic.vectors import ZERO, Rotation, Z, axis_vector, minus


@dataclass(frozen=True)
class LevelRoot(QuaternionRoot):
    """Attitude by the yaw, velocities in the base's own frame; `motion` says what moves."""

    motion: str

    @classmethod
    def of(cls, tape: Scalars, motion: str, attitude: Values) -> LevelRoot:
        """The root of a motion, and of its yaw (rad), if it has one."""
        axes = _axes(tape, attitude[0] if attitude else sp.S.Zero)
        return cls((*ZERO, sp.S.One), axes, motion)

    def places(self, joints: int) -> Places:
        """Linear velocity first, then angular velocity, then the joints, as far as they move."""
        return replace(velocity_places(self.motion, joints), nothing=sp.S.Zero)

    def coordinate_rates(self, tape: Scalars, coordinates: Values, rates: Values) -> Values:
        """The rate of the yaw, and that of the position."""
        return [*rates[:3], *self.world(tape, tuple(rates[3:]))]

    def integrated(self, tape: Scalars, coordinates: Values, step: Values) -> Values:
        """Yaw and position after a screw motion about z, turn (rad) and step (m)."""
        let, turn, (x, y, z) = tape.let, tuple(step[:3]), step[3:]
        with tape.group("yaw after the displacement"):
            yaw = let(coordinates[2] + turn[2])
        _, cosine, share = half_angle(tape, turn)
        with tape.group("position after the displacement"):
            along = let(2 * share * cosine)
            across = let(2 * share * let(share * turn[2]))
            way = (let(along * x - across * y), let(along * y + across * x), z)
            moved = tape.add(tuple(coordinates[3:]), self.world(tape, way))
        return [*coordinates[:2], yaw, *moved]

    def difference(self, tape: Scalars, start: Values, end: Values) -> Values:
        """Turn (rad) and step (m) between two places, in the axes of the first."""
        let = tape.let
        with tape.group("displacement"):
            turn = let(end[2] - start[2])
            way = tape.add(tuple(end[3:]), minus(tuple(start[3:])))
            x, y, z = (tape.dot(axis, way) for axis in _axes(tape, start[2]))
        h, _ = self._bend(tape, start, end, (*ZERO[:2], turn))
        with tape.group("displacement"):
            half = let(turn / 2)
            return [*start[:2], turn, let(h * x + half * y), let(h * y - half * x), z]

    def _bend(
        self, tape: Scalars, start: Values, end: Values, turn: Vector
    ) -> tuple[sp.Expr, sp.Expr]:
        square, cosine, share = half_angle(tape, turn)
        with tape.group("functions of the angle"):
            return tape.let(cosine * tape.let(1 / tape.let(2 * share))), tape.let(sp.sqrt(square))


def _axes(tape: Scalars, yaw: sp.Expr) -> tuple[Vector, ...]:
    """The base's axes in the world at a yaw (rad)."""
    if yaw == 0:
        return tuple(axis_vector(k) for k in range(3))
    rotation = Rotation.angle(tape, Z, yaw)
    return tuple(rotation.vector(tape, axis_vector(k)) for k in range(3))
