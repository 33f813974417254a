"""Effects of one coordinate on all that it moves: motions, and the wrenches for them.

Per unit of a coordinate the points that it moves are displaced by ξ = l + e×ρ, with ρ from one of
them. Along the motion of the robot, with ẋ against the origin and gravity in ẍ,

    2ξ̇ = 2ė×ρ + 2e×ẋ + l₁,    ξ̈ = ë×ρ + 2ė×ẋ + e×ẍ + l₂.

The force on coordinate i is ∫ξ_i·ẍ dm. So of what both i and j move, M_ij is ∫ξ_i·ξ_j dm, and the
derivatives by v_j and q_j are ∫ξ_i·2ξ̇_j dm and ∫ξ_i·ξ̈_j + (∂ξ_i/∂q_j)·ẍ dm. Where j is carried by
i, these are the moments along i of three wrenches that j takes. Where j carries i, they are dot
products with what j's motion consists of, since ∂ξ_i/∂q_j = e_j×ξ_i cancels e_j×ẍ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import sympy as sp

from gibbs_codegen.derivation.inertia import NO_MOMENTS, Inertia, Moments
from gibbs_codegen.derivation.motion import Motion
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector, times
from gibbs_codegen.symbolic.vectors import ZERO, Rotation, Wrench, Z, axis_vector, minus, moved


@dataclass(frozen=True)
class UnitMotion:
    """e, 2ė and ë, and l, l₁ and l₂ about a point; all in one frame."""

    axis: Vector
    rate: Vector
    twice_rate: Vector
    acceleration: Vector
    linear: Vector
    linear_rate: Vector
    linear_acceleration: Vector

    @classmethod
    def turning(cls, tape: Scalars, axis: int, motion: Motion, velocity: Vector) -> UnitMotion:
        """A turn about an axis of a frame that moves, about the frame's origin.

        `velocity` is 2V, twice that of the origin, in the frame (m/s).
        """
        direction = axis_vector(axis)
        rate = tape.cross(motion.omega, direction)
        falling = tape.cross(motion.acceleration, direction)
        return cls(
            axis=direction,
            rate=rate,
            twice_rate=tape.scale(sp.Integer(2), rate),
            acceleration=motion.gradient[axis],
            linear=ZERO,
            linear_rate=tape.cross(velocity, direction),
            linear_acceleration=tape.add(falling, tape.cross(velocity, rate)),
        )

    @classmethod
    def sliding(cls, tape: Scalars, motion: Motion) -> UnitMotion:
        """A displacement along z of a frame that moves, about any point."""
        direction = axis_vector(Z)
        rate = tape.scale(sp.Integer(2), tape.cross(motion.omega, direction))
        return cls(ZERO, ZERO, ZERO, ZERO, direction, rate, motion.gradient[2])

    def about(self, tape: Scalars, arm: Vector) -> UnitMotion:
        """The same by its linear parts about another point; `arm`: the old from the new (m)."""
        linear, rate, acceleration = (
            tape.add(part, minus(tape.cross(turning, arm)))
            for part, turning in (
                (self.linear, self.axis),
                (self.linear_rate, self.twice_rate),
                (self.linear_acceleration, self.acceleration),
            )
        )
        return replace(self, linear=linear, linear_rate=rate, linear_acceleration=acceleration)

    def beyond(self, tape: Scalars, other: UnitMotion) -> UnitMotion:
        """A turn less a turn about a parallel axis: a motion that turns nothing.

        `other` is the turn about that axis, about the same point and in the same frame.
        """
        return replace(
            STILL,
            linear=tape.add(self.linear, minus(other.linear)),
            linear_rate=tape.add(self.linear_rate, minus(other.linear_rate)),
            linear_acceleration=tape.add(
                self.linear_acceleration, minus(other.linear_acceleration)
            ),
        )


STILL = UnitMotion(*[ZERO] * 7)


@dataclass(frozen=True)
class MovingBody:
    """A body, or several as one, about a point: inertia, moments of velocity, inertia forces."""

    inertia: Inertia
    moments: Moments
    wrench: Wrench

    def turned(self, tape: Scalars, rotations: Sequence[Rotation]) -> MovingBody:
        """The body in another frame, to which `rotations` take components one after the other."""
        return MovingBody(
            moved(tape, self.inertia, rotations),
            moved(tape, self.moments, rotations),
            moved(tape, self.wrench, rotations),
        )


@dataclass(frozen=True)
class Column:
    """The wrenches for a coordinate, and the couple for its row of the derivatives.

    `mass` is ∫ξ, `rate` ∫2ξ̇ and `angle` ∫ξ̈, with the moment of ẍ on the displaced points: columns
    of M and of the derivatives by v and by q. `couple` is 2∫ẋ×ξ.
    """

    mass: Wrench
    rate: Wrench
    angle: Wrench
    couple: Vector

    def turned(self, tape: Scalars, rotations: Sequence[Rotation]) -> Column:
        """The column in another frame, to which `rotations` take components one after another."""
        mass, rate, angle = (
            moved(tape, wrench, rotations) for wrench in (self.mass, self.rate, self.angle)
        )
        couple = self.couple
        for rotation in rotations:
            couple = rotation.vector(tape, couple)
        return Column(mass, rate, angle, couple)

    def by_angle(self, tape: Scalars, motion: UnitMotion) -> sp.Expr:
        """Derivative of this coordinate's force by a coordinate that carries it.

        `motion` is the carrying coordinate's, about the column's point and in its frame.
        """
        turning = tape.let(
            dot_products((motion.acceleration, self.mass.moment), (motion.rate, self.couple))
        )
        return tape.let(turning + dot_products((motion.linear_acceleration, self.mass.force)))

    def by_rate(self, tape: Scalars, motion: UnitMotion) -> sp.Expr:
        """Derivative of this coordinate's force by the rate of one that carries it."""
        turning = tape.let(
            dot_products((motion.twice_rate, self.mass.moment), (motion.axis, self.couple))
        )
        return tape.let(turning + dot_products((motion.linear_rate, self.mass.force)))


def column(tape: Scalars, motion: UnitMotion, body: MovingBody) -> Column:
    """The column of a coordinate by its motion and the body that it moves, about one point."""
    inertia, moments, wrench = body.inertia, body.moments, body.wrench
    second = [inertia.row(i) for i in range(3)]
    rows, columns = moments.rows, tuple(zip(*moments.rows, strict=True))

    def wrench_of(turning: Vector, linear: Vector, *others: Wrench) -> Wrench:
        force = (tape.cross(turning, inertia.moment), tape.scale(inertia.mass, linear))
        moment = (_rest(tape, second, turning), tape.cross(inertia.moment, linear))
        return Wrench(
            tape.add(*force, *(other.force for other in others)),
            tape.add(*moment, *(other.moment for other in others)),
        )

    def moving(turning: Vector) -> Wrench:
        return Wrench(tape.cross(turning, moments.momentum), _rest(tape, rows, turning))

    displaced = Wrench(
        tape.cross(motion.axis, wrench.force),
        tape.add(tape.cross(motion.axis, wrench.moment), tape.cross(motion.linear, wrench.force)),
    )
    return Column(
        mass=wrench_of(motion.axis, motion.linear),
        rate=wrench_of(motion.twice_rate, motion.linear_rate, moving(motion.axis)),
        angle=wrench_of(
            motion.acceleration, motion.linear_acceleration, moving(motion.rate), displaced
        ),
        couple=tape.add(
            _rest(tape, columns, motion.axis), tape.cross(moments.momentum, motion.linear)
        ),
    )


def dot_products(*pairs: tuple[Vector, Vector]) -> sp.Expr:
    """A sum of scalar products, without a name on a tape."""
    return sp.Add(*(times(p, q) for a, b in pairs for p, q in zip(a, b, strict=True)))


def _rest(tape: Scalars, rows: Sequence[Values], vector: Vector) -> Vector:
    """(tr X·1 − Xᵀ) applied to a vector; X by rows."""
    entries = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        diagonal = tape.let(rows[j][j] + rows[k][k]) if vector[i] != 0 else sp.S.Zero
        entries.append(
            tape.let(
                times(diagonal, vector[i])
                - times(rows[j][i], vector[j])
                - times(rows[k][i], vector[k])
            )
        )
    return tuple(entries)


def link_moments(
    tape: Scalars, inertia: Inertia, omega: Vector, velocity: Vector, fixed: bool
) -> Moments:
    """Moments of one link about its joint: 2P = ω×2C + B₀2V, and row i of 2D is ω×2E_i + C_i2V.

    `velocity` is 2V, twice the velocity of the joint; `fixed` says that the inertia is of
    parameters alone, which are doubled for nothing.
    """
    rows = [inertia.row(i) for i in range(3)]
    moment = inertia.moment
    if fixed:
        moment = tape.scale(sp.Integer(2), moment)
        rows = [tape.scale(sp.Integer(2), row) for row in rows]
    else:
        omega = tape.scale(sp.Integer(2), omega)
    momentum = tape.add(tape.cross(omega, moment), tape.scale(inertia.mass, velocity))
    pairs = zip(rows, inertia.moment, strict=True)
    spun = [tape.add(tape.cross(omega, row), tape.scale(c, velocity)) for row, c in pairs]
    return Moments(momentum, tuple(spun))


class JointVelocity(NamedTuple):
    """2V, twice the velocity of a joint against the origin (m/s).

    `before` is that of the point on the axis before the joint moves, in the segment's group frame,
    and `after` that of the segment's own point, in its working frame.
    """

    before: Vector
    after: Vector


def joint_velocities(
    tape: Scalars,
    tree: SegmentTree,
    before: Sequence[Motion],
    motions: Sequence[Motion],
    rates: Values,
) -> list[JointVelocity]:
    """2V of all joints; `before` and `motions` are the segments' before and after joints move."""
    velocities, two = [JointVelocity(ZERO, ZERO)], sp.Integer(2)
    for k, segment in enumerate(tree.segments[1:], start=1):
        with tape.group(f"velocity of {segment.joint_name}"):
            parent = velocities[segment.parent].after
            omega = motions[segment.parent].omega
            if segment.starts_group:
                omega = segment.turn.inverse.vector(tape, omega)
                velocity = segment.turn.inverse.vector(tape, parent)
                velocity = tape.add(velocity, tape.cross(omega, tape.scale(two, segment.step)))
                velocity = segment.twist.inverse.vector(tape, velocity)
                along = axis_vector(Z, tape.let(2 * segment.d))
                velocity = tape.add(velocity, tape.cross(before[k].omega, along))
            else:
                arm = tree.step_in_group(tape, k)
                velocity = tape.add(parent, tape.cross(tape.scale(two, omega), arm))
            after = velocity
            if segment.joint == "prismatic":
                after = tape.add(velocity, axis_vector(Z, tape.let(2 * rates[k])))
            if tree.works_in_own_frame(k):
                after = segment.rotation.inverse.vector(tape, after)
        velocities.append(JointVelocity(velocity, after))
    return velocities


def subtree_moments(
    tape: Scalars, tree: SegmentTree, motions: Sequence[Motion], velocities: Sequence[JointVelocity]
) -> list[Moments]:
    """Moments of each segment and all that it supports, about its joint in its group frame."""
    moments = [NO_MOMENTS for _ in tree.segments]
    for k in range(tree.joints, -1, -1):
        with tape.group(f"moments of velocity of {tree.subtree_about_joint(k)}"):
            fixed = tree.works_in_own_frame(k)
            inertia = tree.working_inertia(tape, k)
            total = link_moments(tape, inertia, motions[k].omega, velocities[k].after, fixed)
            for child in tree.children[k]:
                total = total.plus(tape, tree.passed_in(tape, child, moments[child]))
            moments[k] = tree.to_group_frame(tape, k, total)
    return moments
