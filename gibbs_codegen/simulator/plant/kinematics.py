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
    """The base's part in coordinates, velocities and errors.

    `error_names` (nv) are those of the tracking errors.
    """

    error_names: tuple[str, ...]

    def rotation(self, q: Array) -> Array:
        """R (…, 3, 3), from the base's frame to the world, at coordinates (…, nq).

        Args:
            q: Coordinates (…, nq).

        Returns:
            R (…, 3, 3).
        """
        ...

    def normalised(self, q: Array) -> Array:
        """Coordinates (…, nq) of which the functions of a module may be asked.

        Args:
            q: Coordinates (…, nq).

        Returns:
            Coordinates (…, nq) of the same configuration.
        """
        ...

    def rates(self, q: Array, v: Array) -> Array:
        """Rates of coordinates.

        Args:
            q: Coordinates (…, nq), of which a quaternion may have any length.
            v: Velocities (…, nv).

        Returns:
            The rates (…, nq), by which a quaternion keeps its length.
        """
        ...

    def turned(self, turning: Turning) -> tuple[Array, Array, Array]:
        """Entries of the attitude in q, v and a.

        Args:
            turning: Rotation of the base in time, with s instants.

        Returns:
            The entries (s, k), without jumps in time.

        Raises:
            SingularAttitudeError: Where there are none.
        """
        ...

    def continued(self, last: Array, attitude: Array) -> Array:
        """Entries of the attitude that go on from others without a jump.

        Args:
            last: Entries (k) in q of an attitude.
            attitude: Entries (s, k) of attitudes, of which the first is the same.

        Returns:
            Entries (s, k) of the same attitudes.
        """
        ...

    def moved(self, turning: Turning, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
        """Entries of the position in v and a.

        Args:
            turning: Rotation of the base in time.
            velocity, acceleration: Of the point whose position is x, y, z, (…, 3), world axes.

        Returns:
            The entries (…, 3) each.
        """
        ...

    def kept(self, v: Array, turn: Array) -> Array:
        """Velocities of a base that is turned but moves on.

        Args:
            v: Velocities (nv) before.
            turn: From the frame of the base before to that after it is turned (3, 3).

        Returns:
            Velocities (nv) after.
        """
        ...

    def angular(self, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Angular velocity and acceleration of the base.

        Args:
            q: Coordinates (…, nq).
            v, a: Velocities and accelerations (…, nv).

        Returns:
            Both (…, 3), in the base's frame.
        """
        ...

    def attitude_entries(self, q: Array, v: Array, turning: Array) -> Array:
        """Entries of the attitude in the accelerations of a base.

        Args:
            q: Coordinates (…, nq).
            v: Velocities (…, nv).
            turning: Angular acceleration (…, 3), in the base's frame.

        Returns:
            The entries (…, 3) of a.
        """
        ...

    def wrench(self, q: Array, generalised_force: Array) -> tuple[Array, Array]:
        """The wrench on the base that a generalised force amounts to.

        Args:
            q: Coordinates (…, nq).
            generalised_force: Generalised force (…, nv).

        Returns:
            Force, N, and torque, N m, about the point whose position is x, y, z: (…, 3), world
            axes.
        """
        ...

    def errors(self, q: Array, v: Array, q_desired: Array, v_desired: Array) -> tuple[Array, Array]:
        """How far the desired state is from the actual one.

        Args:
            q, v: Coordinates (…, nq) and velocities (…, nv).
            q_desired, v_desired: Those desired.

        Returns:
            Errors and their rates (…, nv).
        """
        ...

    def corrected(
        self, q: Array, v: Array, desired: tuple[Array, Array, Array], gains: tuple[Array, Array]
    ) -> Array:
        """Accelerations with which errors e obey ë + d ė + k e = 0.

        Args:
            q, v: Coordinates (…, nq) and velocities (…, nv).
            desired: Desired coordinates, velocities and accelerations.
            gains: Stiffness k, 1/s², and damping d, 1/s, of the errors (nv).

        Returns:
            The accelerations (…, nv).
        """
        ...

    def reference(self, motion: Motion) -> Reference:
        """The motion as a function of time, from that at knots.

        Args:
            motion: Coordinates, velocities and accelerations at knots.

        Returns:
            Those in time.
        """
        ...


class AngleKinematics:
    """A base with Tait–Bryan angles: v holds the rates of q, and errors are differences.

    Args:
        layout: the layout of the coordinates.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.sequence = layout.attitude
        self.error_names = layout.q.names

    def rotation(self, q: Array) -> Array:
        """R (…, 3, 3), from the base's frame to the world, at coordinates (…, nq).

        Args:
            q: Coordinates (…, nq).

        Returns:
            R (…, 3, 3).
        """
        return rotation_matrix(self.sequence, q[..., self.layout.q.attitude])

    def normalised(self, q: Array) -> Array:
        """The coordinates (…, nq) themselves.

        Args:
            q: Coordinates (…, nq).

        Returns:
            Coordinates (…, nq) of the same configuration.
        """
        return q

    def rates(self, q: Array, v: Array) -> Array:
        """The rates (…, nq) that v holds.

        Args:
            q: Coordinates (…, nq).
            v: Velocities (…, nv).

        Returns:
            The rates (…, nq).
        """
        return v

    def turned(self, turning: Turning) -> tuple[Array, Array, Array]:
        """Angles, rates and accelerations (s, 3) of a rotation with s instants.

        Args:
            turning: Rotation of the base in time, with s instants.

        Returns:
            The entries (s, k) of q, v and a.
        """
        angles, rates, accelerations = attitude_angles(self.sequence, turning)
        return np.unwrap(angles, axis=0), rates, accelerations

    def continued(self, last: Array, attitude: Array) -> Array:
        """Angles (s, 3) with as many whole turns more as bring the first nearest to the last.

        Args:
            last: Entries (k) in q of an attitude.
            attitude: Entries (s, k) of attitudes, of which the first is the same.

        Returns:
            Entries (s, k) of the same attitudes.
        """
        whole: Array = 2.0 * np.pi * np.round((last - attitude[0]) / (2.0 * np.pi))
        return attitude + whole

    def moved(self, turning: Turning, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
        """Velocity and acceleration (…, 3) of the position, which are entries of v and a.

        Args:
            turning: Rotation of the base in time.
            velocity, acceleration: Of the position (…, 3), world axes.

        Returns:
            The entries (…, 3) of v and a.
        """
        return velocity, acceleration

    def kept(self, v: Array, turn: Array) -> Array:
        """The same rates (nq): those of angles go on, not the angular velocity.

        Args:
            v: Velocities (nv) before.
            turn: From the frame of the base before to that after it is turned (3, 3).

        Returns:
            Velocities (nv) after.
        """
        return v

    def angular(self, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Angular velocity and acceleration (…, 3), by ω = E θ̇.

        Args:
            q: Coordinates (…, nq).
            v, a: Rates and accelerations (…, nq).

        Returns:
            Both, in the base's frame.
        """
        back = transposed(self.rotation(q))
        attitude = self.layout.q.attitude
        angles, rates = q[..., attitude], v[..., attitude]
        matrix = rate_matrix(self.sequence, angles)
        growth = times(matrix, a[..., attitude]) + bias_acceleration(self.sequence, angles, rates)
        return times(back, times(matrix, rates)), times(back, growth)

    def attitude_entries(self, q: Array, v: Array, turning: Array) -> Array:
        """Accelerations (…, 3) of the angles, away from their singularity.

        Args:
            q: Coordinates (…, nq).
            v: Rates (…, nq).
            turning: Angular acceleration (…, 3), in the base's frame.

        Returns:
            The entries (…, 3) of a.
        """
        attitude = self.layout.q.attitude
        angles, rates = q[..., attitude], v[..., attitude]
        growth = times(self.rotation(q), turning)
        growth = growth - bias_acceleration(self.sequence, angles, rates)
        matrix = rate_matrix(self.sequence, angles)
        return np.asarray(np.linalg.solve(matrix, growth[..., np.newaxis])[..., 0])

    def wrench(self, q: Array, generalised_force: Array) -> tuple[Array, Array]:
        """The wrench on the base, by the inverse of ψ = Jᵀw for attitude and position (eq. 13).

        Args:
            q: Coordinates (…, nq).
            generalised_force: Generalised force (…, nv).

        Returns:
            Force, N, and torque, N m, about the position: (…, 3), world axes.
        """
        attitude = self.layout.q.attitude
        turn = np.swapaxes(rate_matrix(self.sequence, q[..., attitude]), -1, -2)
        torque = np.linalg.solve(turn, generalised_force[..., attitude, np.newaxis])[..., 0]
        force: Array = generalised_force[..., self.layout.q.position]
        return force, np.asarray(torque, dtype=np.float64)

    def errors(self, q: Array, v: Array, q_desired: Array, v_desired: Array) -> tuple[Array, Array]:
        """Differences of coordinates, and of rates (…, nq).

        Args:
            q, v: Coordinates (…, nq) and velocities (…, nv).
            q_desired, v_desired: Those desired.

        Returns:
            Errors and their rates (…, nv).
        """
        return q_desired - q, v_desired - v

    def corrected(
        self, q: Array, v: Array, desired: tuple[Array, Array, Array], gains: tuple[Array, Array]
    ) -> Array:
        """Desired accelerations (…, nq), corrected by the errors.

        Args:
            q, v: Coordinates (…, nq) and velocities (…, nv).
            desired: Desired coordinates, velocities and accelerations.
            gains: Stiffness, 1/s², and damping, 1/s, of the errors (nv).

        Returns:
            The accelerations (…, nv).
        """
        stiffness, damping = gains
        corrected: Array = desired[2] + damping * (desired[1] - v) + stiffness * (desired[0] - q)
        return corrected

    def reference(self, motion: Motion) -> Reference:
        """Quintics of all coordinates.

        Args:
            motion: Coordinates, velocities and accelerations at knots.

        Returns:
            Those in time.
        """
        return Reference(motion)


def kinematics_of(layout: Layout) -> Kinematics:
    """The kinematics of a base.

    Args:
        layout: The layout of its coordinates.

    Returns:
        Those of angles, or of a quaternion.
    """
    return QuaternionKinematics(layout) if layout.is_quaternion else AngleKinematics(layout)
