"""The root with Tait–Bryan angles: how attitude and position move arm 1, and take forces back.

The tree knows only the root's group frame and what moves in it. This module knows the angles:
R₁ = R_a(θ₋₁)·R_b(θ₀)·R_c(θ₁), intrinsic. Where the last rotation is about z, the base normal, it is
left to the root segment, because the arm's first joint may turn about the same axis: the
group frame is then the frame before that rotation.

For derivatives of forces the angles are joints about axes through the origin. The first two are
taken in the frame between their rotations and the third in the frame between it and the second,
where their axes are coordinate axes. The position and its rate enter no force.

Derivatives of the accelerations are taken in the frame between the second rotation and the third,
where the axes of the angles are g = cos θ₀·e_a + σ sin θ₀·e_c, e_b and e_c, with σ = 1 for cyclic
sequences and −1 for others:

    ω = θ̇₋₁g + θ̇₀e_b + θ̇₁e_c,    dω/dt = θ̈₋₁g + θ̈₀e_b + θ̈₁e_c + b

A change of an angle turns the robot as a whole, which its dynamics relative to free fall do not
notice, and changes ω, b and g; a change of a rate changes ω and b.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.inertia import ANGULAR, Inertia
from gibbs_codegen.derivation.motion import Acceleration, Motion, TreeState
from gibbs_codegen.derivation.unit_motions import Column, MovingBody, UnitMotion, column
from gibbs_codegen.robot.layout import Places, velocity_places
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    ZERO,
    Matrix,
    Rotation,
    Wrench,
    axis_vector,
    identity,
    turned_axes,
    zeros,
)


@dataclass(frozen=True)
class TaitBryanDerivatives:
    """Axes and rotations of the angles, and the motion of each in its frame.

    `inner` are the rotations from the root's group frame to the frame between the second and the
    third angle.
    """

    axes: tuple[int, int, int]
    rotations: Sequence[Rotation]
    inner: Sequence[Rotation]
    units: Sequence[UnitMotion]

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
        """Values for θ₋₁, θ₀, θ₁, x, y, z, and columns as of `row`; `mass_block` is not used."""
        by_angle, by_rate = zeros(6, 6), zeros(6, 6)
        with tape.group("derivatives of the forces on attitude and position by themselves"):
            body = body.turned(tape, self.inner)
            for j in (2, 1, 0):
                body = body.turned(tape, self._turns(j))
                turned = column(tape, self.units[j], body)
                for i in range(j, -1, -1):
                    turned = turned.turned(tape, self._turns(i)) if i < j else turned
                    by_angle[j][i] = turned.by_angle(tape, self.units[i])
                    by_rate[j][i] = turned.by_rate(tape, self.units[i])
                    by_angle[i][j] = turned.angle.moment[self.axes[i]]
                    by_rate[i][j] = turned.rate.moment[self.axes[i]]
                turned = turned.turned(tape, self.rotations[:1])
                for i in range(3):
                    by_angle[3 + i][j] = turned.angle.force[i]
                    by_rate[3 + i][j] = turned.rate.force[i]
        return by_angle, by_rate

    def _turns(self, i: int) -> Sequence[Rotation]:
        """Rotations from the frame of the next angle to that of angle i: one for the second."""
        return self.rotations[1:2] if i == 1 else ()


@dataclass(frozen=True)
class TaitBryanFrame:
    """The frame between the second rotation and the third, seen from that of the derivatives.

    `axes` are those of the sequence, a, b and c, and `vectors` the frame's axes x, y and z there.
    `cos` is cos θ₀ and `sin` is σ sin θ₀; `outer` are the first two rotations.
    """

    axes: tuple[int, int, int]
    outer: Sequence[Rotation]
    vectors: tuple[Vector, ...]
    cos: sp.Expr
    sin: sp.Expr

    @property
    def sign(self) -> int:
        """σ."""
        a, b, _ = self.axes
        return 1 if (b - a) % 3 == 1 else -1

    def seen(self, tape: Scalars, vector: Vector) -> Vector:
        """A vector of the frame of the derivatives in this frame."""
        return tuple(tape.dot(axis, vector) for axis in self.vectors)

    def rows(self, tape: Scalars) -> Callable[[Acceleration], Values]:
        """θ̈₋₁, θ̈₀, θ̈₁, ẍ, ÿ, z̈ as a linear function of a motion of the base.

        The motion is r̈ and the share of θ̈₋₁, θ̈₀, θ̈₁ in dω/dt, in the frame of the derivatives.
        """
        a, b, c = self.axes
        first = tape.scale(tape.let(1 / self.cos), self.vectors[a])
        images = [self.world(tape, self.seen(tape, axis_vector(k))) for k in range(3)]

        def converted(motion: Acceleration) -> Values:
            angle = tape.dot(first, motion.angular)
            last = tape.dot(self.vectors[c], motion.angular)
            linear = tape.combination(motion.linear, images)
            middle = tape.dot(self.vectors[b], motion.angular)
            return [angle, middle, tape.let(last - tape.let(self.sin * angle)), *linear]

        return converted

    def world(self, tape: Scalars, vector: Vector) -> Vector:
        """World components of a vector of this frame."""
        first, second = self.outer
        return first.vector(tape, second.vector(tape, vector))

    def angles(self, tape: Scalars, vector: Vector) -> Values:
        """θ̈₋₁, θ̈₀, θ̈₁ whose sum times their axes is a vector of this frame."""
        a, b, c = self.axes
        first = tape.let(vector[a] * tape.let(1 / self.cos))
        return [first, vector[b], tape.let(vector[c] - tape.let(self.sin * first))]

    def vector(self, along_a: sp.Expr, along_b: sp.Expr, along_c: sp.Expr) -> Vector:
        """A vector of this frame by its components along e_a, e_b and e_c."""
        entries = dict(zip(self.axes, (along_a, along_b, along_c), strict=True))
        return (entries[0], entries[1], entries[2])


@dataclass(frozen=True)
class _Changes:
    """Columns of the angles and of their rates.

    `about` are the columns of a change of ω about e_a, e_b and e_c.
    """

    tape: Scalars
    frame: TaitBryanFrame
    about: list[Values]
    base: TreeState

    def by_rates(self) -> list[Values]:
        """By θ̇₋₁, θ̇₀ and θ̇₁."""
        let, frame, sign, zero = self.tape.let, self.frame, self.frame.sign, sp.S.Zero
        first, second, third = self.base.rates[:3]
        a, b, c = self.about
        cos, sin = frame.cos, frame.sin
        turned = let(cos * first)
        by_first = self.tape.combination((cos, sin), (a, c))
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

    def by_first(self, r: Vector) -> Values:
        """By θ₋₁, which turns r̈ in the world; r is relative to free fall, in the frame."""
        axis = axis_vector(self.frame.axes[0])
        linear = self.tape.cross(axis, self.frame.world(self.tape, r))
        return self._with([sp.S.Zero] * len(self.about[0]), [sp.S.Zero] * 3, linear)

    def by_second(self, r: Vector) -> Values:
        """By θ₀, which turns g besides."""
        tape, let, frame, sign = self.tape, self.tape.let, self.frame, self.frame.sign
        first, second, third = self.base.rates[:3]
        a, _, c = self.about
        cos, sin = frame.cos, frame.sin
        along_a, along_c = let(sin * first), let(cos * first)
        column: Values = tape.combination((-sign * along_a, sign * along_c), (a, c))
        column = self._less(
            column,
            frame.vector(let(-along_c * second), let(along_a * third), let(-along_a * second)),
        )
        gain = let(sign * let(sin * let(1 / cos)) * self.base.accelerations[0])
        last = let(-let(sin * gain) - let(sign * cos * self.base.accelerations[0]))
        outer, inner = frame.outer
        linear = outer.vector(tape, tape.cross(axis_vector(frame.axes[1]), inner.vector(tape, r)))
        return self._with(column, [gain, sp.S.Zero, last], linear)

    def by_third(self, r: Vector) -> Values:
        """By θ₁, which turns the base in the frame."""
        tape, let, frame, sign = self.tape, self.tape.let, self.frame, self.frame.sign
        first, second, third = self.base.rates[:3]
        turned = let(frame.cos * first)
        a, b, _ = self.about
        column = tape.combination((sign * second, -sign * turned), (a, b))
        along_a = let(
            frame.cos * self.base.accelerations[0]
            + sign * second * let(third - let(frame.sin * first))
        )
        along_b = let(self.base.accelerations[1] - sign * let(third * turned))
        angles = frame.angles(tape, frame.vector(-sign * along_b, sign * along_a, sp.S.Zero))
        linear = frame.world(tape, tape.cross(axis_vector(frame.axes[2]), r))
        return self._with(column, angles, linear)

    def _less(self, column: Values, bias: Vector) -> Values:
        """A column less the effect of a change of b on the angles' accelerations."""
        angles = self.frame.angles(self.tape, bias)
        return self._with(column, [-angle for angle in angles], ZERO)

    def _with(self, column: Values, angles: Values, linear: Vector) -> Values:
        """A column with accelerations added for the angles, and for the world coordinates."""
        pairs = zip(column[:6], (*angles, *linear), strict=True)
        return [*(self.tape.let(p + q) for p, q in pairs), *column[6:]]


@dataclass(frozen=True)
class TaitBryanRoot:
    """Attitude by three intrinsic rotations, position in world axes."""

    axes: tuple[int, int, int]
    rotations: Sequence[Rotation]
    angle: sp.Expr

    @classmethod
    def make(cls, tape: Scalars, sequence: str, angles: Values) -> TaitBryanRoot:
        """The root of a sequence of axes, such as "xyz", and of θ₋₁, θ₀ and θ₁ (rad)."""
        a, b, c = ("xyz".index(letter) for letter in sequence)
        pairs = zip((a, b, c), angles, strict=True)
        return cls((a, b, c), [Rotation.angle(tape, *pair) for pair in pairs], angles[2])

    @property
    def spins_about_normal(self) -> bool:
        """True if the last rotation is about z and therefore belongs to the root segment."""
        return self.axes[2] == 2

    @property
    def segment_angle(self) -> sp.Expr:
        """Angle of the root segment against its group frame (rad)."""
        return self.angle if self.spins_about_normal else sp.S.Zero

    @property
    def segment_rotation(self) -> Rotation:
        """Rotation of the root segment against its group frame."""
        return self.rotations[2] if self.spins_about_normal else NO_ROTATION

    def places(self, joints: int) -> Places:
        """The attitude first, then the joints, then the position; in q, v and a alike."""
        return velocity_places("".join("xyz"[axis] for axis in self.axes), joints)

    @property
    def _outer(self) -> int:
        """Number of rotations between the world and the group frame."""
        return 2 if self.spins_about_normal else 3

    def frame_motion(self, tape: Scalars, base: TreeState) -> Motion:
        """Motion of the group frame in its own axes, by the rates of θ₋₁, θ₀, θ₁, x, y, z."""
        return self._motion_after(tape, self._outer, base)

    def _motion_after(self, tape: Scalars, count: int, base: TreeState) -> Motion:
        """Motion of a frame turned by the first `count` rotations, in its own axes."""
        x, y, z = self.origin_acceleration(tape, base)
        omega, omega_dot, acceleration = ZERO, ZERO, (x, y, tape.let(z))
        for i in range(count):
            back, axis = self.rotations[i].inverse, self.axes[i]
            omega = back.vector(tape, omega)
            gain = tape.scale(base.accelerated[i], tape.cross(omega, axis_vector(axis)))
            turn = axis_vector(axis, base.accelerations[i])
            omega_dot = tape.add(back.vector(tape, omega_dot), gain, turn)
            omega = tape.add(omega, axis_vector(axis, base.rates[i]))
            acceleration = back.vector(tape, acceleration)
        reference: Vector = ()
        if base.references:
            at_rest = TreeState.resting(base.references)
            reference = self._motion_after(tape, count, at_rest).omega_dot
        return Motion.of(tape, omega, omega_dot, acceleration, reference)

    def origin_acceleration(self, tape: Scalars, base: TreeState) -> Vector:
        """Acceleration of the origin in world axes with gravity upwards (m/s²)."""
        x, y, z = base.accelerations[3:]
        return (x, y, z + base.gravity)

    def segment_spin(self, values: Values) -> sp.Expr:
        """The rate or acceleration of θ₁ where the root segment has it to itself, or zero."""
        return values[2] if self.spins_about_normal else sp.S.Zero

    def rows(self, tape: Scalars, wrench: Wrench) -> Values:
        """Generalised forces on θ₋₁, θ₀, θ₁, x, y, z."""
        rows = [sp.S.Zero] * 3
        for i in (2, 1, 0):
            rows[i] = wrench.moment[self.axes[i]]
            if i < self._outer:
                wrench = wrench.rotated(tape, self.rotations[i])
        return (*rows, *wrench.force)

    def momentum_rates(self, tape: Scalars, base: TreeState, momentum: Wrench) -> Values:
        """Rates by the motion of the angles' axes; velocities are in place of accelerations."""
        rows = [sp.S.Zero] * 6
        for i in (2, 1, 0):
            motion = self._motion_after(tape, min(i + 1, self._outer), base)
            turned = momentum.turned_with(tape, motion.acceleration, motion.omega_dot)
            rows[i] = turned.moment[self.axes[i]]
            if i < self._outer:
                momentum = momentum.rotated(tape, self.rotations[i])
        return rows

    def derivatives(self, tape: Scalars, base: TreeState) -> TaitBryanDerivatives:
        """Derivatives of forces by the angles and their rates."""
        # For the first two angles the frame between them, for the third the one before it.
        frames = [self._motion_after(tape, count, base) for count in (1, 1, 2)]
        units = [
            UnitMotion.turning(tape, axis, motion, ZERO)
            for axis, motion in zip(self.axes, frames, strict=True)
        ]
        return TaitBryanDerivatives(
            self.axes, self.rotations, self.rotations[2 : self._outer], units
        )

    def world(self, tape: Scalars, vector: Vector) -> Vector:
        """World components of a vector of the group frame."""
        for i in range(self._outer - 1, -1, -1):
            vector = self.rotations[i].vector(tape, vector)
        return vector

    def velocities_at(self, tape: Scalars, point: Vector) -> list[tuple[Vector, Vector]]:
        """Linear and angular velocity of a point per unit rate, in world axes."""
        axes = [axis_vector(axis) for axis in self.axes]  # In the world, once they are turned.
        for i in (1, 2):
            for rotation in reversed(self.rotations[:i]):
                axes[i] = rotation.vector(tape, axes[i])
        turning = [(tape.cross(axis, point), axis) for axis in axes]
        return [*turning, *((axis_vector(k), ZERO) for k in range(3))]

    def mass_block(self, tape: Scalars, composite: Inertia) -> Matrix:
        """6×6 entries for θ₋₁, θ₀, θ₁, x, y, z."""
        block = zeros(6, 6)
        for k in range(3):
            block[3 + k][3 + k] = composite.mass
        for i in (2, 1, 0):
            axis = self.axes[i]
            moment = composite.response(tape, ANGULAR + axis).moment
            if i < self._outer:
                # The force comes from the turned composite: that saves turning the force.
                moment = self.rotations[i].vector(tape, moment)
                composite = composite.rotated(tape, self.rotations[i])
            wrench = Wrench(composite.response(tape, ANGULAR + axis).force, moment)
            block[i][i] = moment[axis]
            for j in range(i - 1, -1, -1):
                block[i][j] = block[j][i] = wrench.moment[self.axes[j]]
                wrench = wrench.rotated(tape, self.rotations[j])
            for k, force in enumerate(wrench.force):
                block[i][3 + k] = block[3 + k][i] = force
        return block

    def accelerations(
        self, tape: Scalars, linear: Vector, angular: Vector, base: TreeState
    ) -> list[sp.Expr]:
        """Those of θ₋₁, θ₀, θ₁, x, y, z, from a motion of the group frame.

        Divides by cos θ₀, which is zero where the sequence is singular. `angular` is the sum of
        θ̈₋₁, θ̈₀, θ̈₁ times their axes.
        """
        with tape.group("acceleration of the origin, in world axes"):
            x, y, z = self.world(tape, linear)
        with tape.group("accelerations of the attitude angles"):
            a, b, c = self.axes
            if not self.spins_about_normal:
                angular = self.rotations[2].vector(tape, angular)
            first_axis = self.rotations[1].inverse.vector(tape, axis_vector(a))
            first = tape.let(angular[a] * tape.let(1 / first_axis[a]))
            angles = (first, angular[b], tape.let(angular[c] - first_axis[c] * first))
        with tape.group("acceleration of the origin, in world axes"):
            return [*angles, x, y, tape.let(z - base.gravity)]

    def coordinate_rates(self, tape: Scalars, coordinates: Values, rates: Values) -> Values:
        """The rates themselves."""
        return rates

    def integrated(self, tape: Scalars, coordinates: Values, step: Values) -> Values:
        """The sums of coordinates and step."""
        return [tape.let(q + v) for q, v in zip(coordinates, step, strict=True)]

    def difference(self, tape: Scalars, start: Values, end: Values) -> Values:
        """The differences of the coordinates."""
        return [tape.let(q - p) for p, q in zip(start, end, strict=True)]

    def acceleration_rows(
        self, tape: Scalars, turns: Sequence[Rotation]
    ) -> Callable[[Acceleration], Values]:
        """Accelerations of the base's coordinates, by a change of the base's motion."""
        return self._frame(tape, turns).rows(tape)

    def state_columns(
        self, tape: Scalars, turning: Sequence[Values], linear: Vector, base: TreeState
    ) -> tuple[list[Values], list[Values]]:
        """Columns for θ₋₁, θ₀, θ₁, x, y, z, and for their rates."""
        frame = self._frame(tape, [])
        if not self.spins_about_normal:
            linear = self.rotations[2].vector(tape, linear)
        convert = frame.rows(tape)
        about: list[Values] = []
        for axis in frame.axes:
            column = tape.combination(frame.vectors[axis], turning)
            about.append([*convert(Acceleration.of(column[:6])), *column[6:]])
        nothing = [[sp.S.Zero] * len(about[0])] * 3
        changes = _Changes(tape, frame, about, base)
        by_angles = [changes.by_first(linear), changes.by_second(linear), changes.by_third(linear)]
        return [*by_angles, *nothing], [*changes.by_rates(), *nothing]

    def _frame(self, tape: Scalars, turns: Sequence[Rotation]) -> TaitBryanFrame:
        """The frame between the second rotation and the third, seen from another."""
        third = [] if self.spins_about_normal else [self.rotations[2].inverse]
        vectors = turned_axes(tape, [*third, *(turn.inverse for turn in reversed(turns))])
        first_axis = self.rotations[1].inverse.vector(tape, axis_vector(self.axes[0]))
        cos, sin = first_axis[self.axes[0]], first_axis[self.axes[2]]
        return TaitBryanFrame(self.axes, self.rotations[:2], vectors, cos, sin)

    def integrated_by_place(self, tape: Scalars, step: Values) -> Matrix:
        """The identity."""
        return identity(6)

    def integrated_by_step(self, tape: Scalars, step: Values) -> Matrix:
        """The identity."""
        return identity(6)

    def difference_by_start(self, tape: Scalars, start: Values, end: Values) -> Matrix:
        """Minus the identity."""
        return [[-entry for entry in row] for row in identity(6)]

    def difference_by_end(self, tape: Scalars, start: Values, end: Values) -> Matrix:
        """The identity."""
        return identity(6)
