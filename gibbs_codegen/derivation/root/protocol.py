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
        """The same with the Coriolis matrix C in place of half the derivatives by the velocities.

        Returns:
            What gives, row by row, 2C with the entries ∫ξ_i·2ξ̇_j dm, as between joints. C v are the
            velocity terms of the forces, and Ṁ − 2C is skew-symmetric.
        """
        ...

    def row(self, tape: Scalars, joint: Column) -> tuple[Values, Values]:
        """How the force on a joint depends on the base.

        Args:
            joint: Its column, about the origin, in the root's group frame.

        Returns:
            Derivatives by each displacement of the base, and by each of its velocities.
        """
        ...

    def blocks(self, tape: Scalars, body: MovingBody, mass_block: Matrix) -> tuple[Matrix, Matrix]:
        """How the forces on the base depend on the base.

        Args:
            body: The whole robot about the origin, in the root's group frame, its mass and its
                inertia force without those of the root's own mass.
            mass_block: The base's block of the mass matrix.

        Returns:
            Rows of the forces along the base's velocities, columns as of `row`.
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
        """Places of the entries of v and a.

        Args:
            joints: Number of joints after the base.

        Returns:
            Places of the base and of the joints.
        """
        ...

    def frame_motion(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> Motion:
        """Motion of the root's group frame.

        Args:
            rates, accelerations: The base's velocities, and their rates.
            gravity: Gravity (m/s²), included as an upward acceleration.

        Returns:
            The motion in the frame's own axes.
        """
        ...

    def origin_acceleration(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> Vector:
        """Acceleration of the origin, along the directions in which the linear velocities count.

        Args:
            rates, accelerations: The base's velocities, and their rates.
            gravity: Gravity (m/s²), included as an upward acceleration.

        Returns:
            Its components (m/s²): the world's for Tait–Bryan angles, the base's for a quaternion.
        """
        ...

    def segment_spin(self, values: Values) -> sp.Expr:
        """The rate or acceleration of the root segment against its group frame.

        Args:
            values: The base's velocities, or their rates.

        Returns:
            That about z (rad/s or rad/s²).
        """
        ...

    def rows(self, tape: Scalars, wrench: Wrench) -> tuple[sp.Expr, ...]:
        """Generalised forces of a wrench along the base's velocities.

        Args:
            wrench: About the origin, in the root's group frame (N, N m).

        Returns:
            One force for each velocity of the base.
        """
        ...

    def mass_block(self, tape: Scalars, composite: Inertia) -> Matrix:
        """The base's block of the mass matrix.

        Args:
            composite: Inertia of the whole robot about the origin, in the root's group frame.

        Returns:
            Rows and columns of the base's velocities.
        """
        ...

    def derivatives(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> BaseDerivatives:
        """How forces depend on the base's coordinates and velocities.

        Args:
            rates, accelerations: The base's velocities, and their rates.
            gravity: Gravity (m/s²), included as an upward acceleration.

        Returns:
            What makes the derivatives in this state of motion.
        """
        ...

    def world(self, tape: Scalars, vector: Vector) -> Vector:
        """World components of a vector.

        Args:
            vector: Its components in the root's group frame.

        Returns:
            Its components in world axes.
        """
        ...

    def velocities_at(self, tape: Scalars, point: Vector) -> list[tuple[Vector, Vector]]:
        """Velocities of a point for a unit of each velocity of the base.

        Args:
            point: A point of the robot from the origin, in world axes (m).

        Returns:
            Linear and angular velocity in world axes, for each.
        """
        ...

    def accelerations(
        self, tape: Scalars, linear: Vector, angular: Vector, rates: Values, gravity: sp.Expr
    ) -> list[sp.Expr]:
        """Rates of the base's velocities, recovered from a motion of the root's group frame.

        Args:
            linear: Acceleration of the origin relative to free fall, in the root's group frame
                (m/s²).
            angular: What the rates of the velocities add to the angular acceleration, in
                the root's group frame (rad/s²).
            rates: The base's velocities.
            gravity: Gravity (m/s²).

        Returns:
            One acceleration for each velocity of the base.
        """
        ...

    def coordinate_rates(self, tape: Scalars, coordinates: Values, rates: Values) -> Values:
        """q̇ of the base's coordinates.

        Args:
            coordinates: The base's.
            rates: Its velocities.

        Returns:
            One rate for each coordinate of the base.
        """
        ...

    def integrated(self, tape: Scalars, coordinates: Values, step: Values) -> Values:
        """The base's coordinates after a displacement.

        Args:
            coordinates: The base's.
            step: The displacement: velocities times a time in which they are constant.

        Returns:
            The new coordinates.
        """
        ...

    def difference(self, tape: Scalars, start: Values, end: Values) -> Values:
        """The displacement that leads from one place to another.

        Args:
            start, end: Coordinates of the base.

        Returns:
            The displacement, one entry for each velocity of the base.
        """
        ...

    def acceleration_rows(
        self, tape: Scalars, turns: Sequence[Rotation]
    ) -> Callable[[Acceleration], Values]:
        """How changes of the base's motion change the rates of its velocities.

        Args:
            turns: Rotations from the frame of the changes to the group frame.

        Returns:
            A linear function of an acceleration in that frame: of the origin, and what the rates of
            the velocities add to the angular acceleration.
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
        """Derivatives of all accelerations by attitude and position, and by the velocities.

        Args:
            turning: Columns for a change of each component of the angular velocity ω of the base,
                with the acceleration of the origin and dω/dt.
            linear: Acceleration of the origin relative to free fall, in the group frame (m/s²).
            rates, accelerations: The base's velocities, and their rates.
            gravity: Gravity (m/s²).

        Returns:
            Columns in the tangent space of the base's coordinates, and for each of its velocities;
            first come the rows of the base, then those of the joints.
        """
        ...

    def integrated_by_place(self, tape: Scalars, step: Values) -> Matrix:
        """How the base after a displacement moves with the base before it.

        Args:
            step: The displacement.

        Returns:
            6×6 entries, in the tangent spaces at both places.
        """
        ...

    def integrated_by_step(self, tape: Scalars, step: Values) -> Matrix:
        """How the base after a displacement moves with the displacement.

        Args:
            step: The displacement.

        Returns:
            6×6 entries, in the tangent space at the place after it.
        """
        ...
