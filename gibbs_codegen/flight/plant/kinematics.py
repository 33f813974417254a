"""Coordinates, errors and rates of a base with attitude angles, and of one with a quaternion.

Everything else of a flight works on coordinates q (nq) and velocities v, a (nv) by the places
of the layout. Tracking errors have an entry per velocity: of the attitude and the position of the
base, in the places of its angular and linear velocity, and of the joints.

With a quaternion no attitude is singular, and v holds the linear and the angular velocity of the
base in its own frame. Quaternions are qx, qy, qz, qw; where none of unit length is asked for, any
length means the same attitude.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.orientation import (
    Turning,
    attitude_angles,
    bias_acceleration,
    rate_matrix,
    rotation_matrix,
)
from gibbs_codegen.robot.layout import Layout

Array = NDArray[np.float64]

# What coordinates must be for `unit_quaternions`.
UNIT = "with a quaternion whose length is between 1e-154 and 1e154"


def unit_quaternions(module: ModuleType, layout: Layout, q: Any, xp: Any = np) -> tuple[Any, Any]:
    """Coordinates (…, nq) with unit quaternions as a module makes them, and which (…) these are."""
    if not layout.is_quaternion:
        return q, xp.ones(q.shape[:-1], bool)
    with np.errstate(invalid="ignore"):
        unit = module.integrate(q, xp.zeros((*q.shape[:-1], layout.v.size)))
    # Of lengths whose squares are too small, rounding leaves others than 1.
    lengths = (unit[..., layout.q.attitude] ** 2).sum(axis=-1)
    return unit, abs(lengths - 1.0) < 1e-6


class QuaternionKinematics:
    """What `Kinematics` says, for a quaternion.

    Errors of the position are in world axes. Those of the attitude are the rotation vector from the
    actual to the desired attitude in the base's frame, and the difference of angular velocities
    there.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        names = [*layout.v.names]
        names[layout.v.position] = layout.q.names[layout.q.position]
        names[layout.v.attitude] = [f"attitude about the base's {axis}" for axis in "xyz"]
        self.error_names = tuple(names)

    def rotation(self, q: Array) -> Array:
        """R (…, 3, 3), from the base's frame to the world, of a quaternion of unit length."""
        # A copy, since SciPy refuses an empty array that is read-only.
        quaternion = np.array(q[..., self.layout.q.attitude])
        flat = Rotation.from_quat(quaternion.reshape(-1, 4)).as_matrix()
        matrix: Array = flat.reshape(*quaternion.shape[:-1], 3, 3)
        return matrix

    def normalised(self, q: Array) -> Array:
        """Coordinates (…, nq) with quaternions of unit length."""
        unit, attitude = np.array(q), self.layout.q.attitude
        unit[..., attitude] /= np.linalg.norm(q[..., attitude], axis=-1, keepdims=True)
        return unit

    def rates(self, q: Array, v: Array) -> Array:
        """Rates (…, nq) of coordinates, by which a quaternion keeps the length that it has."""
        places, rates = self.layout, np.empty_like(q)
        rates[..., places.q.joints] = v[..., places.v.joints]
        rates[..., places.q.position] = times(self.rotation(q), v[..., places.v.position])
        turn = 0.5 * _pure(v[..., places.v.attitude])
        rates[..., places.q.attitude] = _product(q[..., places.q.attitude], turn)
        return rates

    def turned(self, turning: Turning) -> tuple[Array, Array, Array]:
        """Quaternions (s, 4), angular velocity and acceleration (s, 3) in the base's frame."""
        quaternion = np.asarray(Rotation.from_matrix(turning.rotation).as_quat())
        # Of a quaternion and its opposite, which are the same attitude, the one nearer to the last.
        turns_back = np.einsum("si,si->s", quaternion[1:], quaternion[:-1]) < 0.0
        quaternion[1:][np.cumsum(turns_back) % 2 == 1] *= -1.0
        world = turning.velocity, turning.acceleration
        velocity, acceleration = (times(transposed(turning.rotation), each) for each in world)
        return quaternion, velocity, acceleration

    def continued(self, last: Array, attitude: Array) -> Array:
        """Quaternions (s, 4), or their opposites if the first of those is nearer to the last."""
        signed: Array = np.copysign(1.0, attitude[0] @ last) * attitude
        return signed

    def moved(self, turning: Turning, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
        """Linear velocity and its rate (…, 3) in the frame of a base that moves in the world."""
        inverse = transposed(turning.rotation)
        linear = times(inverse, velocity)
        carried = np.cross(times(inverse, turning.velocity), linear)
        return linear, times(inverse, acceleration) - carried

    def kept(self, v: Array, turn: Array) -> Array:
        """Velocities (nv) that are the same in the world, by the `turn` (3, 3) between frames."""
        after = v.copy()
        for part in (self.layout.v.position, self.layout.v.attitude):
            after[part] = turn @ v[part]
        return after

    def angular(self, q: Array, v: Array, a: Array) -> tuple[Array, Array]:
        """Angular velocity and acceleration (…, 3), which are entries of v and a."""
        attitude = self.layout.v.attitude
        return v[..., attitude], a[..., attitude]

    def attitude_entries(self, q: Array, v: Array, turning: Array) -> Array:
        """The angular acceleration (…, 3) itself."""
        return turning

    def wrench(self, q: Array, generalised_force: Array) -> tuple[Array, Array]:
        """Force and torque (…, 3) in world axes: entries of a generalised force, turned."""
        places, rotation = self.layout.v, self.rotation(q)
        force, torque = (
            times(rotation, generalised_force[..., part])
            for part in (places.position, places.attitude)
        )
        return force, torque

    def errors(self, q: Array, v: Array, q_desired: Array, v_desired: Array) -> tuple[Array, Array]:
        """Errors and their rates (…, nv), those of the position in world axes."""
        places = self.layout.q, self.layout.v
        (attitude, position, joints), (spin, linear, rates) = (
            (each.attitude, each.position, each.joints) for each in places
        )
        off, off_rate = v_desired - v, v_desired - v
        rotation, desired = self.rotation(q), self.rotation(q_desired)
        off[..., linear] = q_desired[..., position] - q[..., position]
        between = _product(_conjugate(q[..., attitude]), q_desired[..., attitude])
        off[..., spin] = _rotation_vector(between)
        off[..., rates] = q_desired[..., joints] - q[..., joints]
        carried = times(desired, v_desired[..., linear])
        off_rate[..., linear] = carried - times(rotation, v[..., linear])
        off_rate[..., spin] = self._carried(rotation, desired, v_desired[..., spin]) - v[..., spin]
        return off, off_rate

    def corrected(
        self, q: Array, v: Array, desired: tuple[Array, Array, Array], gains: tuple[Array, Array]
    ) -> Array:
        """Accelerations (…, nv) of a base that moves in the world as desired, but for the gains."""
        q_desired, v_desired, a_desired = desired
        off, off_rate = self.errors(q, v, q_desired, v_desired)
        pull = gains[0] * off + gains[1] * off_rate
        spin, linear = self.layout.v.attitude, self.layout.v.position
        rotation, wanted = self.rotation(q), self.rotation(q_desired)
        turn, turn_desired = v[..., spin], v_desired[..., spin]
        a = a_desired + pull
        carried = a_desired[..., linear] + np.cross(turn_desired, v_desired[..., linear])
        world = times(wanted, carried) + pull[..., linear]
        a[..., linear] = times(transposed(rotation), world) - np.cross(turn, v[..., linear])
        a[..., spin] = (
            self._carried(rotation, wanted, a_desired[..., spin])
            - np.cross(turn, self._carried(rotation, wanted, turn_desired))
            + pull[..., spin]
        )
        return a

    def reference(self, motion: Motion) -> Reference:
        """Quintics of position, quaternion and joints, as `PoseReference` has them."""
        return PoseReference(motion, self)

    def _carried(self, rotation: Array, desired: Array, vector: Array) -> Array:
        """A vector (…, 3) of the desired base's frame in that of the actual base."""
        return times(transposed(rotation) @ desired, vector)


class PoseReference(Reference):
    """A desired motion whose quintics are those of the coordinates, quaternion and all.

    Between knots the quaternion is as good as of unit length, and is made so; velocities and
    accelerations are the exact rates of what that gives.
    """

    def __init__(self, motion: Motion, kinematics: QuaternionKinematics) -> None:
        self.kinematics = kinematics
        layout, rates = kinematics.layout, kinematics.rates(motion.q, motion.v)
        growth = kinematics.rates(motion.q, motion.a)
        spin, linear = motion.v[:, layout.v.attitude], motion.v[:, layout.v.position]
        carried = np.cross(spin, linear)
        growth[:, layout.q.position] += times(kinematics.rotation(motion.q), carried)
        turning = rates[:, layout.q.attitude]
        growth[:, layout.q.attitude] += 0.5 * _product(turning, _pure(spin))
        super().__init__(Motion(motion.time, motion.q, rates, growth))

    def __call__(self, time: float | Array) -> tuple[Array, Array, Array]:
        """Evaluate q (…, nq), v and a (…, nv) at times (…), as those of `Reference` are."""
        c, rates, growth = super().__call__(time)
        layout = self.kinematics.layout
        q = self.kinematics.normalised(c)
        inverse = transposed(self.kinematics.rotation(q))
        v = np.zeros((*c.shape[:-1], layout.v.size))
        a = np.zeros_like(v)
        v[..., layout.v.joints] = rates[..., layout.q.joints]
        a[..., layout.v.joints] = growth[..., layout.q.joints]
        quaternion, turning, bending = (each[..., layout.q.attitude] for each in (c, rates, growth))
        # With c = r p, where p is of unit length, c̄ ċ = r ṙ + r² ω / 2.
        square = np.sum(quaternion**2, axis=-1, keepdims=True)
        stretching = np.sum(quaternion * turning, axis=-1, keepdims=True) / square
        back = _conjugate(quaternion) * (2.0 / square)
        spin = _product(back, turning)[..., :3]
        linear = times(inverse, rates[..., layout.q.position])
        v[..., layout.v.attitude], v[..., layout.v.position] = spin, linear
        a[..., layout.v.attitude] = _product(back, bending)[..., :3] - 2.0 * stretching * spin
        a[..., layout.v.position] = times(inverse, growth[..., layout.q.position]) - np.cross(
            spin, linear
        )
        return q, v, a


def _product(first: Array, second: Array) -> Array:
    """Products (…, 4) of quaternions."""
    one, two = first[..., :3], second[..., :3]
    scalars = first[..., 3:], second[..., 3:]
    vector = scalars[0] * two + scalars[1] * one + np.cross(one, two)
    scalar = scalars[0] * scalars[1] - np.sum(one * two, axis=-1, keepdims=True)
    product: Array = np.concatenate([vector, scalar], axis=-1)
    return product


def _conjugate(quaternion: Array) -> Array:
    conjugate: Array = quaternion * np.array([-1.0, -1.0, -1.0, 1.0])
    return conjugate


def _pure(vector: Array) -> Array:
    """Quaternions (…, 4) of vectors (…, 3)."""
    return np.concatenate([vector, np.zeros_like(vector[..., :1])], axis=-1)


def _rotation_vector(quaternion: Array) -> Array:
    """Rotation vectors (…, 3), rad, of quaternions; no longer than half a turn."""
    sine = np.linalg.norm(quaternion[..., :3], axis=-1, keepdims=True)
    cosine = quaternion[..., 3:]
    half = np.arctan2(sine, np.abs(cosine))
    safe = np.where(sine > 0.0, sine, 1.0)
    # Near none, the angle is twice the sine's share, and so is the factor's limit.
    factor = np.where(sine > 0.0, half / safe, 1.0 / np.maximum(np.abs(cosine), 1e-300))
    vector: Array = 2.0 * np.copysign(factor, cosine) * quaternion[..., :3]
    return vector


def transposed(matrix: Array) -> Array:
    """Matrices (…, n, m) of matrices (…, m, n)."""
    return np.swapaxes(matrix, -1, -2)


def times(matrix: Array, vector: Array) -> Array:
    """Products (…, m) of matrices (…, m, n) and vectors (…, n)."""
    product: Array = (matrix @ vector[..., np.newaxis])[..., 0]
    return product


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
