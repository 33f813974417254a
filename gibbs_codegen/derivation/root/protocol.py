"""What the derivation asks of the base's coordinates and velocities, whatever they are.

The root turns the velocities of the base and their rates into the motion of the frame that the tree
begins with, the *root's group frame*, and wrenches in that frame back into generalised forces. The
root segment (arm 1) may turn against the group frame about z, the base normal. Velocities are rates
of coordinates, or quasi-velocities, for which the Gibbs–Appell equations are the same.

Values of the base are those of attitude and then of position, without the joints': what
`Places.split` gives and `Places.joined` takes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import sympy as sp

from gibbs_codegen.derivation.acceleration_column import AccelerationColumn
from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.motion import Acceleration, Motion
from gibbs_codegen.derivation.unit_motions import Column, MovingBody
from gibbs_codegen.robot.layout import Places
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import Matrix, Rotation, Vector, Wrench

Values = Sequence[sp.Expr]


class BaseDerivatives(Protocol):
    """How forces depend on the coordinates and velocities of the base, in one state of motion.

    By coordinates they are derivatives in the tangent space: by the displacements of
    `Root.integrated`.
    """

    def coriolis(self, tape: Scalars) -> BaseDerivatives:
        """The same with 2C, C the Coriolis matrix, in place of the derivatives by velocities.

        2C has the entries ∫ξ_i·2ξ̇_j dm, as between joints. C v are the velocity terms of the
        forces, and Ṁ − 2C is skew-symmetric.
        """
        ...

    def row(self, tape: Scalars, joint: Column) -> tuple[Values, Values]:
        """Derivatives of the force on a joint by the base's displacements, and by its velocities.

        `joint` is the joint's column about the origin, in the root's group frame.
        """
        ...

    def blocks(self, tape: Scalars, body: MovingBody, mass_block: Matrix) -> tuple[Matrix, Matrix]:
        """Derivatives of the forces on the base, by its velocities; columns as of `row`.

        `body` is the whole robot about the origin, in the root's group frame, its mass and its
        inertia force without those of the root's own mass; `mass_block` is the base's block of M.
        """
        ...


class Root(Protocol):
    """The base: how its velocities move the group frame, and which forces act along them."""

    @property
    def spins_about_normal(self) -> bool:
        """Whether the last rotation is about the base normal and belongs to the root segment."""
        ...

    @property
    def segment_angle(self) -> sp.Expr:
        """Angle of the root segment against its group frame (rad)."""
        ...

    @property
    def segment_rotation(self) -> Rotation:
        """Rotation of the root segment against its group frame."""
        ...

    def places(self, joints: int) -> Places:
        """Places in v and a of the base, and of the joints after it."""
        ...

    def frame_motion(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> Motion:
        """Motion of the root's group frame, in its own axes.

        Gravity (m/s²) is included as an upward acceleration; `rates` are the base's velocities.
        """
        ...

    def origin_acceleration(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> Vector:
        """Acceleration of the origin (m/s²), along the directions in which linear velocities count.

        These are the world's for Tait–Bryan angles, the base's for a quaternion. Gravity (m/s²) is
        included as an upward acceleration.
        """
        ...

    def segment_spin(self, values: Values) -> sp.Expr:
        """Rate or acceleration about z of the root segment against its group frame."""
        ...

    def rows(self, tape: Scalars, wrench: Wrench) -> tuple[sp.Expr, ...]:
        """Generalised forces along the base's velocities of a wrench (N, N m).

        It is about the origin, in the root's group frame.
        """
        ...

    def mass_block(self, tape: Scalars, composite: Inertia) -> Matrix:
        """The base's block of M, by the robot's inertia about the origin in the group frame."""
        ...

    def derivatives(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> BaseDerivatives:
        """How forces depend on the base's coordinates and velocities, in this state of motion.

        Gravity (m/s²) is included as an upward acceleration.
        """
        ...

    def world(self, tape: Scalars, vector: Vector) -> Vector:
        """World components of a vector of the root's group frame."""
        ...

    def velocities_at(self, tape: Scalars, point: Vector) -> list[tuple[Vector, Vector]]:
        """Linear and angular velocity of a point per unit of each velocity of the base.

        All are in world axes; the point is from the origin (m).
        """
        ...

    def accelerations(
        self, tape: Scalars, linear: Vector, angular: Vector, rates: Values, gravity: sp.Expr
    ) -> list[sp.Expr]:
        """Rates of the base's velocities, recovered from a motion of the root's group frame.

        `linear` is the acceleration of the origin relative to free fall (m/s²), `angular` what the
        rates of the velocities add to the angular acceleration (rad/s²); both are in that frame.
        """
        ...

    def coordinate_rates(self, tape: Scalars, coordinates: Values, rates: Values) -> Values:
        """q̇ of the base's coordinates, from its velocities."""
        ...

    def integrated(self, tape: Scalars, coordinates: Values, step: Values) -> Values:
        """The base's coordinates after a displacement: velocities times a time that they last."""
        ...

    def difference(self, tape: Scalars, start: Values, end: Values) -> Values:
        """The displacement from one place to another, one entry for each velocity of the base."""
        ...

    def acceleration_rows(
        self, tape: Scalars, turns: Sequence[Rotation]
    ) -> Callable[[Acceleration], Values]:
        """How changes of the base's motion change the rates of its velocities.

        It is a linear function of an acceleration in the frame of the changes: of the origin, and
        what the rates of the velocities add to the angular acceleration. `turns` lead from that
        frame to the group frame.
        """
        ...

    def state_columns(
        self,
        tape: Scalars,
        turning: Sequence[AccelerationColumn],
        linear: Vector,
        rates: Values,
        accelerations: Values,
        gravity: sp.Expr,
    ) -> tuple[list[Values], list[Values]]:
        """Derivatives of all accelerations by attitude and position, and by the base's velocities.

        `turning` are the columns for a change of each component of the base's ω, with the
        acceleration of the origin and dω/dt; `linear` is the acceleration of the origin relative to
        free fall, in the group frame (m/s²). The first are in the tangent space of the base's
        coordinates. In each, the rows of the base come before those of the joints.
        """
        ...

    def integrated_by_place(self, tape: Scalars, step: Values) -> Matrix:
        """Derivatives (6×6) of `integrated` by the place before, in both tangent spaces."""
        ...

    def integrated_by_step(self, tape: Scalars, step: Values) -> Matrix:
        """Derivatives (6×6) of `integrated` by the displacement, in the tangent space after it."""
        ...
