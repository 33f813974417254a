"""The root with Tait–Bryan angles: how attitude and position move arm 1, and take forces back.

The tree knows only the root's group frame and what moves in it. This module knows the angles:
R₁ = R_a(θ₋₁)·R_b(θ₀)·R_c(θ₁), intrinsic. Where the last rotation is about z, the base normal, it is
left to the root segment, because the arm's first joint may turn about the same axis: the
group frame is then the frame before that rotation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.acceleration_column import AccelerationColumn
from gibbs_codegen.derivation.inertia import ANGULAR, Inertia
from gibbs_codegen.derivation.motion import Acceleration, Motion
from gibbs_codegen.derivation.root.protocol import Values
from gibbs_codegen.derivation.root.tait_bryan_accelerations import TaitBryanFrame, state_columns
from gibbs_codegen.derivation.root.tait_bryan_derivatives import TaitBryanDerivatives
from gibbs_codegen.derivation.unit_motions import UnitMotion
from gibbs_codegen.robot.layout import Places, velocity_places
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    NO_ROTATION,
    ZERO,
    Matrix,
    Rotation,
    Vector,
    Wrench,
    add,
    axis_vector,
    cross,
    identity,
    scale,
    turned_axes,
    zeros,
)

Rows = tuple[sp.Expr, ...]


@dataclass(frozen=True)
class TaitBryanRoot:
    """Attitude by three intrinsic rotations, position in world axes."""

    axes: tuple[int, int, int]
    rotations: tuple[Rotation, Rotation, Rotation]
    angle: sp.Expr

    @classmethod
    def make(cls, tape: Scalars, sequence: str, angles: Sequence[sp.Expr]) -> TaitBryanRoot:
        """The root of a sequence of axes, such as "xyz", and of θ₋₁, θ₀ and θ₁ (rad)."""
        a, b, c = ("xyz".index(letter) for letter in sequence)
        first, second, third = (
            Rotation.angle(tape, axis, angle) for axis, angle in zip((a, b, c), angles, strict=True)
        )
        return cls((a, b, c), (first, second, third), angles[2])

    @property
    def spins_about_normal(self) -> bool:
        """Whether the last rotation is about z and therefore belongs to the root segment."""
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

    def frame_motion(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> Motion:
        """Motion of the group frame in its own axes, by the rates of θ₋₁, θ₀, θ₁, x, y, z."""
        return self._motion_after(tape, self._outer, rates, accelerations, gravity)

    def _motion_after(
        self, tape: Scalars, count: int, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> Motion:
        """Motion of a frame turned by the first `count` rotations, in its own axes."""
        x, y, z = self.origin_acceleration(tape, rates, accelerations, gravity)
        omega, omega_dot, acceleration = ZERO, ZERO, (x, y, tape.let(z))
        for i in range(count):
            back, axis = self.rotations[i].inverse, self.axes[i]
            omega = back.vector(tape, omega)
            gain = scale(tape, rates[i], cross(tape, omega, axis_vector(axis)))
            omega_dot = add(
                tape,
                back.vector(tape, omega_dot),
                gain,
                axis_vector(axis, accelerations[i]),
            )
            omega = add(tape, omega, axis_vector(axis, rates[i]))
            acceleration = back.vector(tape, acceleration)
        return Motion.of(tape, omega, omega_dot, acceleration)

    def origin_acceleration(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> Vector:
        """Acceleration of the origin in world axes with gravity upwards (m/s²)."""
        x, y, z = accelerations[3:]
        return (x, y, z + gravity)

    def segment_spin(self, values: Values) -> sp.Expr:
        """The rate or acceleration of θ₁ where the root segment has it to itself, or zero."""
        return values[2] if self.spins_about_normal else sp.S.Zero

    def rows(self, tape: Scalars, wrench: Wrench) -> Rows:
        """Generalised forces on θ₋₁, θ₀, θ₁, x, y, z."""
        rows = [sp.S.Zero] * 3
        for i in (2, 1, 0):
            rows[i] = wrench.moment[self.axes[i]]
            if i < self._outer:
                wrench = wrench.rotated(tape, self.rotations[i])
        return (*rows, *wrench.force)

    def derivatives(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> TaitBryanDerivatives:
        """How forces depend on the angles and their rates."""
        # Of the first two angles the frame between, and of the third the one between it and them.
        frames = [
            self._motion_after(tape, count, rates, accelerations, gravity) for count in (1, 1, 2)
        ]
        first, second, third = (
            UnitMotion.turning(tape, axis, motion, ZERO)
            for axis, motion in zip(self.axes, frames, strict=True)
        )
        inner = self.rotations[2 : self._outer]
        return TaitBryanDerivatives(self.axes, self.rotations, inner, (first, second, third))

    def world(self, tape: Scalars, vector: Vector) -> Vector:
        """World components of a vector of the group frame."""
        for i in range(self._outer - 1, -1, -1):
            vector = self.rotations[i].vector(tape, vector)
        return vector

    def velocities_at(self, tape: Scalars, point: Vector) -> list[tuple[Vector, Vector]]:
        """Linear and angular velocity of a point per unit rate, in world axes."""
        turning = [(cross(tape, axis, point), axis) for axis in self._world_axes(tape)]
        return [*turning, *((axis_vector(k), ZERO) for k in range(3))]

    def _world_axes(self, tape: Scalars) -> list[Vector]:
        """Axes of θ₋₁, θ₀, θ₁ in the world."""
        axes = []
        for i, axis in enumerate(self.axes):
            vector = axis_vector(axis)
            for j in range(i - 1, -1, -1):
                vector = self.rotations[j].vector(tape, vector)
            axes.append(vector)
        return axes

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
        self, tape: Scalars, linear: Vector, angular: Vector, rates: Values, gravity: sp.Expr
    ) -> list[sp.Expr]:
        """Those of θ₋₁, θ₀, θ₁, x, y, z, from a motion of the group frame.

        Divides by cos θ₀, which is zero where the sequence is singular. `angular` is the sum of
        θ̈₋₁, θ̈₀, θ̈₁ times their axes.
        """
        with tape.group("acceleration of the origin, in world axes"):
            x, y, z = self.world(tape, linear)
        with tape.group("accelerations of the attitude angles"):
            angles = self._angle_accelerations(tape, angular)
        with tape.group("acceleration of the origin, in world axes"):
            return [*angles, x, y, tape.let(z - gravity)]

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
        self,
        tape: Scalars,
        turning: Sequence[AccelerationColumn],
        linear: Vector,
        rates: Values,
        accelerations: Values,
        gravity: sp.Expr,
    ) -> tuple[list[Values], list[Values]]:
        """Columns for each coordinate of the base, and for its rate."""
        frame = self._frame(tape, [])
        if not self.spins_about_normal:
            linear = self.rotations[2].vector(tape, linear)
        return state_columns(tape, frame, turning, linear, rates, accelerations)

    def _frame(self, tape: Scalars, turns: Sequence[Rotation]) -> TaitBryanFrame:
        """The frame between the second rotation and the third, seen from another."""
        third = [] if self.spins_about_normal else [self.rotations[2].inverse]
        vectors = turned_axes(tape, [*third, *(turn.inverse for turn in reversed(turns))])
        first_axis = self.rotations[1].inverse.vector(tape, axis_vector(self.axes[0]))
        cos, sin = first_axis[self.axes[0]], first_axis[self.axes[2]]
        return TaitBryanFrame(self.axes, self.rotations[:2], vectors, cos, sin)

    def _angle_accelerations(self, tape: Scalars, angular: Vector) -> Vector:
        a, b, c = self.axes
        if not self.spins_about_normal:
            angular = self.rotations[2].vector(tape, angular)
        first_axis = self.rotations[1].inverse.vector(tape, axis_vector(a))
        first = tape.let(angular[a] * tape.let(1 / first_axis[a]))
        return (first, angular[b], tape.let(angular[c] - first_axis[c] * first))

    def integrated_by_place(self, tape: Scalars, step: Values) -> Matrix:
        """The identity."""
        return identity(6)

    def integrated_by_step(self, tape: Scalars, step: Values) -> Matrix:
        """The identity."""
        return identity(6)
