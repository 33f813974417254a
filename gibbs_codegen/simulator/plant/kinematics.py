"""What differs between a base with attitude angles and one with a quaternion.

Everything else of the simulator works on coordinates q (nq) and velocities v, a (nv) by the places
of the layout. Tracking errors have an entry per velocity: of the attitude and the position of the
base, in the places of its angular and linear velocity, and of the joints.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.robot.layout import Layout
from gibbs_codegen.scenario.attitude import (
    Turning,
    attitude_angles,
    bias_acceleration,
    rate_matrix,
    rotation_matrix,
)
from gibbs_codegen.simulator.plant.quaternion_kinematics import (
    QuaternionKinematics,
    times,
    transposed,
)
from gibbs_codegen.simulator.reference import Motion, Reference

Array = NDArray[np.float64]


class Kinematics(Protocol):
    """The base's part in coordinates, velocities and errors, whose names are `error_names` (nv)."""

    error_names: tuple[str, ...]

    def rotation(self, q: Array) -> Array:
        """R (…, 3, 3), from the base's frame to the world, at coordinates (…, nq)."""
        ...

    def normalised(self, q: Array) -> Array:
        """Coordinates (…, nq) of the same configuration, of which modules may be asked."""
        ...

    def rates(self, q: Array, v: Array) -> Array:
        """Rates (…, nq) of coordinates by v (…, nv).

        By them a quaternion, of any length, keeps that length.
        """
        ...

    def turned(self, turning: Turning) -> tuple[Array, Array, Array]:
        """Entries (s, k) of the attitude in q, v and a, without jumps in time.

        Raises `SingularAttitudeError` where there are none.
        """
        ...

    def continued(self, last: Array, attitude: Array) -> Array:
        """Attitudes (s, k) in q as entries that go on from the `last` (k) without a jump.

        The first of the attitudes is the same as the last.
        """
        ...

    def moved(self, turning: Turning, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
        """Entries (…, 3) of the position in v and a.

        Its velocity and acceleration (…, 3) are in world axes.
        """
        ...

    def kept(self, v: Array, turn: Array) -> Array:
        """Velocities (nv) of a base that is turned but moves on.

        `turn` (3, 3) leads from its frame before to that after.
        """
        ...

    def angular(self, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Angular velocity and acceleration (…, 3) of the base, in its frame."""
        ...

    def attitude_entries(self, q: Array, v: Array, turning: Array) -> Array:
        """Entries (…, 3) of the attitude in a, for angular acceleration (…, 3), base's frame."""
        ...

    def wrench(self, q: Array, generalised_force: Array) -> tuple[Array, Array]:
        """Force, N, and torque, N m, (…, 3) on the base for a generalised force (…, nv).

        They are about the point whose position is x, y, z, in world axes.
        """
        ...

    def errors(self, q: Array, v: Array, q_desired: Array, v_desired: Array) -> tuple[Array, Array]:
        """Errors and their rates (…, nv): how far the desired state is from the actual one."""
        ...

    def corrected(
        self, q: Array, v: Array, desired: tuple[Array, Array, Array], gains: tuple[Array, Array]
    ) -> Array:
        """Accelerations (…, nv) with which errors e obey ë + d ė + k e = 0.

        `desired` are q, v and a, `gains` k, 1/s², and d, 1/s, (nv).
        """
        ...

    def reference(self, motion: Motion) -> Reference:
        """The motion as a function of time, from that at knots."""
        ...


class AngleKinematics:
    """A base with Tait–Bryan angles: v holds the rates of q, and errors are differences."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.sequence = layout.attitude
        self.error_names = layout.q.names

    def rotation(self, q: Array) -> Array:
        """R (…, 3, 3), by the rotations of the three angles."""
        return rotation_matrix(self.sequence, q[..., self.layout.q.attitude])

    def normalised(self, q: Array) -> Array:
        """The coordinates (…, nq) themselves."""
        return q

    def rates(self, q: Array, v: Array) -> Array:
        """The rates (…, nq) that v holds."""
        return v

    def turned(self, turning: Turning) -> tuple[Array, Array, Array]:
        """Angles, rates and accelerations (s, 3) of a rotation with s instants."""
        angles, rates, accelerations = attitude_angles(self.sequence, turning)
        return np.unwrap(angles, axis=0), rates, accelerations

    def continued(self, last: Array, attitude: Array) -> Array:
        """Angles (s, 3) with as many whole turns more as bring the first nearest to the last."""
        whole: Array = 2.0 * np.pi * np.round((last - attitude[0]) / (2.0 * np.pi))
        return attitude + whole

    def moved(self, turning: Turning, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
        """Velocity and acceleration (…, 3) of the position, which are entries of v and a."""
        return velocity, acceleration

    def kept(self, v: Array, turn: Array) -> Array:
        """The same rates (nq): those of angles go on, not the angular velocity."""
        return v

    def angular(self, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Angular velocity and acceleration (…, 3) in the base's frame, by ω = E θ̇."""
        back = transposed(self.rotation(q))
        attitude = self.layout.q.attitude
        angles, rates = q[..., attitude], v[..., attitude]
        matrix = rate_matrix(self.sequence, angles)
        growth = times(matrix, a[..., attitude]) + bias_acceleration(self.sequence, angles, rates)
        return times(back, times(matrix, rates)), times(back, growth)

    def attitude_entries(self, q: Array, v: Array, turning: Array) -> Array:
        """Accelerations (…, 3) of the angles, away from their singularity."""
        attitude = self.layout.q.attitude
        angles, rates = q[..., attitude], v[..., attitude]
        growth = times(self.rotation(q), turning)
        growth = growth - bias_acceleration(self.sequence, angles, rates)
        matrix = rate_matrix(self.sequence, angles)
        return np.asarray(np.linalg.solve(matrix, growth[..., np.newaxis])[..., 0])

    def wrench(self, q: Array, generalised_force: Array) -> tuple[Array, Array]:
        """The wrench on the base, by the inverse of ψ = Jᵀw for attitude and position (eq. 13)."""
        attitude = self.layout.q.attitude
        turn = np.swapaxes(rate_matrix(self.sequence, q[..., attitude]), -1, -2)
        torque = np.linalg.solve(turn, generalised_force[..., attitude, np.newaxis])[..., 0]
        force: Array = generalised_force[..., self.layout.q.position]
        return force, np.asarray(torque, dtype=np.float64)

    def errors(self, q: Array, v: Array, q_desired: Array, v_desired: Array) -> tuple[Array, Array]:
        """Differences of coordinates, and of rates (…, nq)."""
        return q_desired - q, v_desired - v

    def corrected(
        self, q: Array, v: Array, desired: tuple[Array, Array, Array], gains: tuple[Array, Array]
    ) -> Array:
        """Desired accelerations (…, nq), corrected by the errors."""
        stiffness, damping = gains
        corrected: Array = desired[2] + damping * (desired[1] - v) + stiffness * (desired[0] - q)
        return corrected

    def reference(self, motion: Motion) -> Reference:
        """Quintics of all coordinates."""
        return Reference(motion)


def kinematics_of(layout: Layout) -> Kinematics:
    """The kinematics of a base with angles, or with a quaternion."""
    return QuaternionKinematics(layout) if layout.is_quaternion else AngleKinematics(layout)
