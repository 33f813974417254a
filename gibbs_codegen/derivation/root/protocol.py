"""What the derivation asks of the base's coordinates, whatever they are.

The root turns the coordinates of the base into the motion of the frame that the tree begins with,
the *root's group frame*, and wrenches in that frame back into generalised forces. The root segment
(arm 1) may turn against the group frame about z, the base normal.

Values of the base are those of attitude and then of position, without the joints': what
`Places.split` gives and `Places.joined` takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import sympy as sp

from gibbs_codegen.derivation.inertia import Inertia
from gibbs_codegen.derivation.motion import Motion
from gibbs_codegen.robot.layout import Places
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import Matrix, Rotation, Vector, Wrench

Values = Sequence[sp.Expr]


class Root(Protocol):
    """Coordinates of the base: how they move the group frame, and which forces act along them."""

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
        """Places of the coordinates in q, v and a.

        Args:
            joints: Number of joints after the base.

        Returns:
            Places of the base and of the joints.
        """
        ...

    def origin(self, coordinates: Values) -> Vector:
        """World position of the origin.

        Args:
            coordinates: Those of the base.

        Returns:
            Position in world axes (m).
        """
        ...

    def frame_motion(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> Motion:
        """Motion of the root's group frame.

        Args:
            rates, accelerations: Those of the base's coordinates.
            gravity: Gravity (m/s²), included as an upward acceleration.

        Returns:
            The motion in the frame's own axes.
        """
        ...

    def segment_spin(self, values: Values) -> sp.Expr:
        """The rate or acceleration of the root segment against its group frame.

        Args:
            values: Rates or accelerations of the base's coordinates.

        Returns:
            That about z (rad/s or rad/s²).
        """
        ...

    def rows(self, tape: Scalars, wrench: Wrench) -> tuple[sp.Expr, ...]:
        """Generalised forces of a wrench along the base's coordinates.

        Args:
            wrench: About the origin, in the root's group frame (N, N m).

        Returns:
            One force for each coordinate of the base.
        """
        ...

    def inertia_rows(
        self,
        tape: Scalars,
        wrench: Wrench,
        mass: sp.Expr,
        accelerations: Values,
        gravity: sp.Expr,
    ) -> tuple[sp.Expr, ...]:
        """∂S/∂θ̈ of the base's coordinates.

        Args:
            wrench: 𝒮 and ℛ of all segments about the origin, in the root's group frame, without the
                root's B₀r̈ (N, N m).
            mass: The root's B₀ (kg).
            accelerations: Those of the base's coordinates.
            gravity: Gravity (m/s²), included as an upward acceleration.

        Returns:
            One row for each coordinate of the base.
        """
        ...

    def mass_block(self, tape: Scalars, composite: Inertia) -> Matrix:
        """The base's block of the mass matrix.

        Args:
            composite: Inertia of the whole robot about the origin, in the root's group frame.

        Returns:
            Rows and columns of the base's coordinates.
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
        """Velocities of a point for a unit rate of each coordinate of the base.

        Args:
            point: A point of the robot from the origin, in world axes (m).

        Returns:
            Linear and angular velocity in world axes, for each coordinate.
        """
        ...

    def accelerations(
        self, tape: Scalars, linear: Vector, angular: Vector, gravity: sp.Expr
    ) -> list[sp.Expr]:
        """Accelerations of the base's coordinates, recovered from a motion of the root's group
        frame.

        Args:
            linear: Acceleration of the origin relative to free fall, in the root's group frame
                (m/s²).
            angular: What the accelerations of the coordinates add to the angular acceleration, in
                the root's group frame (rad/s²).
            gravity: Gravity (m/s²).

        Returns:
            One acceleration for each coordinate of the base.
        """
        ...
