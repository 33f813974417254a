"""The root with a quaternion: the base's velocities in its own frame are the quasi-velocities.

The group frame is the base's own frame, arm 1's axes, and v begins with the velocity of the origin
and the angular velocity there. So the generalised forces of the base are the wrench itself, and
its block of the mass matrix is the inertia itself: neither depends on the attitude, which enters
only through the direction of gravity. Nothing is divided by anything: no attitude is singular.

In derivatives a turn φ of the base changes the upward acceleration g in its frame by g×φ. The
linear velocity enters through ω×v. So what depends on either is what the force takes of an
acceleration of the origin, a column of the mass matrix. A unit of the angular velocity about an
axis e of the base makes the accelerations 2e×ẋ + (ω×e)×ρ, and e×v of the origin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import sympy as sp

from gibbs_codegen.derivation.acceleration_column import AccelerationColumn
from gibbs_codegen.derivation.inertia import ANGULAR, Inertia
from gibbs_codegen.derivation.motion import Acceleration, Motion
from gibbs_codegen.derivation.root.pose import (
    Quaternion,
    displaced,
    displaced_by_motion,
    displaced_by_pose,
    displacement,
    quaternion_rate,
    rotation_columns,
    turned,
    upward,
)
from gibbs_codegen.derivation.root.protocol import Values
from gibbs_codegen.derivation.unit_motions import STILL, Column, MovingBody, column
from gibbs_codegen.robot.layout import QUATERNION, Places, velocity_places
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
    minus,
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


@dataclass(frozen=True)
class QuaternionRoot:
    """Attitude by a unit quaternion, velocities in the base's own frame."""

    attitude: Quaternion
    axes: tuple[Vector, Vector, Vector]

    @classmethod
    def make(cls, tape: Scalars, parts: Sequence[sp.Expr]) -> QuaternionRoot:
        """The root of a quaternion's x, y, z and w."""
        x, y, z, w = parts
        return cls((x, y, z, w), rotation_columns(tape, (x, y, z, w)))

    @property
    def spins_about_normal(self) -> bool:
        """No rotation is left to the root segment."""
        return False

    @property
    def segment_angle(self) -> sp.Expr:
        """The root segment is not turned against its group frame."""
        return sp.S.Zero

    @property
    def segment_rotation(self) -> Rotation:
        """The root segment is not turned against its group frame."""
        return NO_ROTATION

    def places(self, joints: int) -> Places:
        """Linear velocity first, then angular velocity, then the joints."""
        return velocity_places(QUATERNION, joints)

    def frame_motion(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> Motion:
        """Motion of the base in its own frame; rates are ω and the origin's velocity."""
        linear = self.origin_acceleration(tape, rates, accelerations, gravity)
        return Motion.of(tape, _vector(rates[:3]), _vector(accelerations[:3]), linear)

    def origin_acceleration(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> Vector:
        """v̇ + ω×v with gravity upwards, in the base's frame (m/s²)."""
        turning = cross(tape, _vector(rates[:3]), _vector(rates[3:]))
        up = upward(tape, self.attitude, gravity)
        return add(tape, _vector(accelerations[3:]), turning, up)

    def segment_spin(self, values: Values) -> sp.Expr:
        """Zero: the root segment does not turn against its group frame."""
        return sp.S.Zero

    def rows(self, tape: Scalars, wrench: Wrench) -> tuple[sp.Expr, ...]:
        """Moment and force of the wrench itself."""
        return (*wrench.moment, *wrench.force)

    def mass_block(self, tape: Scalars, composite: Inertia) -> Matrix:
        """The Hessian of the Gibbs function, 6×6, angular before linear."""
        block = zeros(6, 6)
        for i in range(3):
            block[3 + i][3 + i] = composite.mass
            wrench = composite.response(tape, ANGULAR + i)
            for j in range(3):
                block[i][j] = wrench.moment[j]
                block[i][3 + j] = block[3 + j][i] = wrench.force[j]
        return block

    def derivatives(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> QuaternionDerivatives:
        """How forces depend on the base's attitude and velocities; no accelerations are needed."""
        up = upward(tape, self.attitude, gravity)
        return QuaternionDerivatives(_vector(rates[:3]), _vector(rates[3:]), up)

    def world(self, tape: Scalars, vector: Vector) -> Vector:
        """World components of a vector of the base's frame."""
        return turned(tape, self.axes, vector)

    def velocities_at(self, tape: Scalars, point: Vector) -> list[tuple[Vector, Vector]]:
        """Linear and angular velocity of a point per unit of ω, and then of v, in world axes."""
        turning = [(cross(tape, axis, point), axis) for axis in self.axes]
        return [*turning, *((axis, ZERO) for axis in self.axes)]

    def accelerations(
        self, tape: Scalars, linear: Vector, angular: Vector, rates: Values, gravity: sp.Expr
    ) -> list[sp.Expr]:
        """ω̇ and v̇; `rates` are ω and the origin's velocity."""
        with tape.group("rate of the base's velocity, in its own frame"):
            zero = [sp.S.Zero] * 6
            known = self.origin_acceleration(tape, rates, zero, gravity)
            return [*angular, *add(tape, linear, minus(known))]

    def coordinate_rates(self, tape: Scalars, coordinates: Values, rates: Values) -> Values:
        """Rates of quaternion and position, from ω and the origin's velocity."""
        quaternion = quaternion_rate(tape, self.attitude, _vector(rates[:3]))
        return [*quaternion, *self.world(tape, _vector(rates[3:]))]

    def integrated(self, tape: Scalars, coordinates: Values, step: Values) -> Values:
        """Quaternion, of unit length, and position, by the exponential map of SE(3)."""
        attitude, position = _pose(coordinates)
        quaternion, moved = displaced(
            tape, attitude, position, _vector(step[:3]), _vector(step[3:])
        )
        return [*quaternion, *moved]

    def difference(self, tape: Scalars, start: Values, end: Values) -> Values:
        """Turn (rad) and step (m) that take the base to another place, in its first frame."""
        turn, step = displacement(tape, _pose(start), _pose(end))
        return [*turn, *step]

    def acceleration_rows(
        self, tape: Scalars, turns: Sequence[Rotation]
    ) -> Callable[[Acceleration], Values]:
        """Rates of ω and v by an acceleration of the origin and angular, in the base's frame."""

        def converted(motion: Acceleration) -> Values:
            for turn in turns:
                motion = motion.rotated(tape, turn)
            return [*motion.angular, *motion.linear]

        return converted

    def state_columns(
        self,
        tape: Scalars,
        turning: Sequence[AccelerationColumn],
        linear: Vector,
        rates: Values,
        accelerations: Values,
        gravity: sp.Expr,
    ) -> tuple[list[Values], list[Values]]:
        """Columns for a turn and a displacement of the base in its own frame, and for ω and v."""
        omega, velocity = _vector(rates[:3]), _vector(rates[3:])
        up = upward(tape, self.attitude, gravity)
        by_attitude, by_turning, by_velocity = [], [], []
        for k, about in enumerate(turning):
            unit = axis_vector(k)
            moved = add(tape, about.root.linear, cross(tape, velocity, unit))
            by_turning.append([*about.root.angular, *moved, *about.joints])
            still = [sp.S.Zero] * len(about.joints)
            by_attitude.append([*ZERO, *cross(tape, unit, up), *still])
            by_velocity.append([*ZERO, *cross(tape, unit, omega), *still])
        nothing = [[sp.S.Zero] * len(by_turning[0])] * 3
        return [*by_attitude, *nothing], [*by_turning, *by_velocity]

    def integrated_by_place(self, tape: Scalars, step: Values) -> Matrix:
        """6×6 entries, angular before linear."""
        return displaced_by_pose(tape, _vector(step[:3]), _vector(step[3:]))

    def integrated_by_step(self, tape: Scalars, step: Values) -> Matrix:
        """6×6 entries, angular before linear."""
        return displaced_by_motion(tape, _vector(step[:3]), _vector(step[3:]))


def _vector(values: Values) -> Vector:
    x, y, z = values
    return (x, y, z)


def _pose(coordinates: Values) -> tuple[Quaternion, Vector]:
    x, y, z, w = coordinates[:4]
    return (x, y, z, w), _vector(coordinates[4:])
