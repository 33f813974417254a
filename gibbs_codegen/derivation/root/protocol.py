"""What the derivation asks of the base's coordinates, whatever they are.

The root turns the coordinates of the base into the motion of a frame that the chains hang on, the
*carrier*, and wrenches in that frame back into generalised forces. The root segment (arm 1) may
turn against the carrier about z, the base normal.

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
from gibbs_codegen.symbolic.vectors import Rotation, Vector, Wrench

Values = Sequence[sp.Expr]


class Root(Protocol):
    """Coordinates of the base: how they move the carrier, and which forces act along them."""

    @property
    def spins_about_normal(self) -> bool:
        """Whether the last rotation is about the base normal and belongs to the root segment."""
        ...

    @property
    def segment_angle(self) -> sp.Expr:
        """Angle of the root segment against the carrier."""
        ...

    @property
    def segment_rotation(self) -> Rotation:
        """Rotation of the root segment against the carrier."""
        ...

    def places(self, joints: int) -> Places:
        """Places of the coordinates of this base with `joints` joints."""
        ...

    def origin(self, coordinates: Values) -> Vector:
        """World position of the origin, from the coordinates of the base."""
        ...

    def carrier_motion(
        self, tape: Scalars, rates: Values, accelerations: Values, gravity: sp.Expr
    ) -> Motion:
        """Motion of the carrier, in its own axes, at rates and accelerations of the base.

        Gravity is included as an upward acceleration.
        """
        ...

    def segment_spin(self, values: Values) -> sp.Expr:
        """The rate or acceleration of the root segment against the carrier."""
        ...

    def rows(self, tape: Scalars, wrench: Wrench) -> tuple[sp.Expr, ...]:
        """Generalised forces along the base's coordinates of a wrench in the carrier.

        The wrench is about the origin.
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
            tape: Takes the operations.
            wrench: 𝒮 and ℛ of all segments about the origin, in the carrier, without the root's
                B₀r̈ (N, N m).
            mass: The root's B₀ (kg).
            accelerations: Those of the base's coordinates.
            gravity: Gravity (m/s²), included as an upward acceleration.

        Returns:
            One row for each coordinate of the base.

        """
        ...

    def mass_block(self, tape: Scalars, composite: Inertia) -> list[list[sp.Expr]]:
        """The base's block of the mass matrix.

        `composite` is the inertia of the whole machine about the origin, in the carrier.
        """
        ...

    def world(self, tape: Scalars, vector: Vector) -> Vector:
        """World components of a vector given in the carrier."""
        ...

    def velocities_at(self, tape: Scalars, point: Vector) -> list[tuple[Vector, Vector]]:
        """Linear and angular velocity for a unit rate of each coordinate of the base.

        The linear one is that of a `point` of the machine, given from the origin; world axes.
        """
        ...

    def accelerations(
        self, tape: Scalars, linear: Vector, angular: Vector, gravity: sp.Expr
    ) -> list[sp.Expr]:
        """Accelerations of the base's coordinates, recovered from a motion of the carrier.

        Args:
            tape: Takes the operations.
            linear: Acceleration of the origin relative to free fall, in the carrier (m/s²).
            angular: What the accelerations of the coordinates add to the angular acceleration, in
                the carrier (rad/s²).
            gravity: Gravity (m/s²).

        Returns:
            One acceleration for each coordinate of the base.

        """
        ...
