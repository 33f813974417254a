"""The geometric law on SE(3), for a base whose rotors push along one axis (Lee, Leok, McClamroch).

What moves the centre of mass is the force of all rotors less the weight, whatever the arms do. So
the law tracks the centre of mass: its errors and the desired motion tell the force, the direction
of the force tells how the base must lean, and angular accelerations make it lean so. Together with
those of the joints they are turned into inputs by inverse dynamics. That leaves the acceleration of
the base itself: it is what the force along the thrust axis gives, since across it there is none.
Without errors the inputs are those of the desired motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.control.laws import Gains, inputs_of
from gibbs_codegen.flight.plant.allocation import LEANS_BY_THRUST, Allocation, force_axis
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.parts import Law
from gibbs_codegen.flight.vectors import Array, times, transposed

# Greatest force that corrects errors, as a share of the desired one: the sum never turns round.
_AUTHORITY = 0.8
# Share of the greatest thrust of a motion that is none.
_NO_THRUST = 1e-9
# Least sum of 1 and the cosine of an angle by which a direction is turned: none is turned round.
_LEAST = 1e-9


class WantedForce(NamedTuple):
    """Force (…, 3), N, that the motion needs, and the `rate`, N/s, of its part `correction`.

    That is the part that corrects errors; world axes.
    """

    force: Array
    correction: Array
    rate: Array


@dataclass(frozen=True)
class GeometricLaw:
    """Inputs by which centre of mass, attitude and joints follow a reference.

    The gains of position are those of the centre of mass, and of the heading, by which the base is
    turned about its thrust axis; those of attitude are of the thrust axis.
    """

    vehicle: Vehicle
    reference: Reference
    allocation: Allocation
    gains: Gains
    law: Law = "geometric"
    memory: int = 0

    def __call__(
        self, time: float | Array, q: Array, v: Array, memory: Array | None = None
    ) -> Array:
        """Inputs u (…, nu) for states q (…, nq), v (…, nv), and memory (…, m).

        Raises `AllocationError` if no thrusts at all produce the wrench.
        """
        vehicle, places = self.vehicle, self.vehicle.layout.v
        axis = force_axis(vehicle.thrust_wrenches(q if vehicle.rotors_move else None))
        axis = np.broadcast_to(axis, (*q.shape[:-1], 3))
        along = times(vehicle.base_rotation(q), axis)
        jacobian = vehicle.centre_of_mass_jacobian(q)
        error_correction, aimed = np.zeros_like(v), np.array(q)
        if memory is not None and self.memory:
            error_correction = self.gains.integral * memory
        aimed[..., vehicle.arm] -= error_correction[..., vehicle.arm_rates]
        centre = vehicle.centre_of_mass(q)
        push = self._push(
            time, (centre, times(jacobian, v)), error_correction[..., places.position], along
        )
        desired = self.reference(time)
        a = np.zeros_like(v)
        a[..., places.joints] = self._joints(aimed, v, desired)
        turning = self._turning(q, v, desired, axis, push)
        a[..., places.attitude] = vehicle.kinematics.attitude_entries(q, v, turning)
        generalised = vehicle.inverse_dynamics(q, v, a)
        needed = vehicle.kinematics.wrench(q, generalised)[0]
        # Another acceleration of the machine as a whole makes up for what this force is not.
        lacking = _thrust(push, along) - needed
        generalised = generalised + times(transposed(jacobian), lacking)
        return inputs_of(vehicle, self.allocation, q, generalised)

    def growth(self, time: float | Array, q: Array, v: Array, memory: Array) -> Array:
        """Time derivative (…, m) of the integrals of the errors, with nv entries or none.

        The errors of centre of mass and joints; 0 of the attitude, which follows them.
        """
        if not self.memory:
            return memory
        places, found = self.vehicle.layout.v, np.zeros_like(v)
        desired = self.reference(time)[0]
        found[..., places.joints] = (desired - q)[..., self.vehicle.arm]
        found[..., places.position] = self.centre(time)[0] - self.vehicle.centre_of_mass(q)
        return found

    def check_thrust(self) -> None:
        """Raise `UsageError` with the first time at which the motion needs no thrust."""
        time = self.reference.knots
        size = np.linalg.norm(self.mass * self.centre(time)[2] + self.weight, axis=-1)
        none = size <= _NO_THRUST * np.max(size)
        if np.any(none):
            raise UsageError(
                f"{self.vehicle.name}: at t = {time[none][0]:.6g} s the desired motion needs no "
                f"thrust, and {LEANS_BY_THRUST}; choose another motion, or a gravity that is not 0"
            )

    @cached_property
    def weight(self) -> Array:
        """The force (3) that holds the robot, N, world axes."""
        return self._force(self.vehicle.neutral, np.zeros((2, self.vehicle.layout.v.size)))

    @cached_property
    def mass(self) -> float:
        """Mass of the robot, kg."""
        place = self.vehicle.layout.v.position.start
        return float(self.vehicle.mass_matrix(self.vehicle.neutral)[place, place])

    @cached_property
    def centre(self) -> Reference:
        """Desired position, velocity and acceleration (…, 3) of the centre of mass in time."""
        time = self.reference.knots
        q, v, a = self.reference(time)
        acceleration = (self._force(q, np.stack([v, a])) - self.weight) / self.mass
        velocity = times(self.vehicle.centre_of_mass_jacobian(q), v)
        return Reference(Motion(time, self.vehicle.centre_of_mass(q), velocity, acceleration))

    def _force(self, q: Array, rates: Array) -> Array:
        """Force (…, 3) of all rotors, of velocities and accelerations (2, …, nv); world axes."""
        generalised = self.vehicle.inverse_dynamics(q, *rates)
        return self.vehicle.kinematics.wrench(q, generalised)[0]

    def _push(
        self,
        time: float | Array,
        moving: tuple[Array, Array],
        error_correction: Array,
        along: Array,
    ) -> WantedForce:
        """The force that the centre of mass needs.

        Its position and velocity `moving`, and the thrust axis `along`, are (…, 3) in world axes;
        `error_correction` (…, 3), m, is what integral action adds to its error.
        """
        place = self.vehicle.layout.v.position
        stiffness, damping = self.gains.stiffness[place], self.gains.damping[place]
        wanted, speed, acceleration = self.centre(time)
        desired = self.mass * acceleration + self.weight
        off, drift = wanted - moving[0], speed - moving[1]
        most = _AUTHORITY * np.linalg.norm(desired, axis=-1, keepdims=True)
        wish = self.mass * (stiffness * (off + error_correction) + damping * drift)
        share = 1.0 / np.sqrt(1.0 + _dot(wish, wish) / most**2)
        push = WantedForce(desired + share * wish, share * wish, np.zeros_like(wish))
        learning = self.gains.integral * off
        growth = stiffness * self.mass * (drift + learning)
        growth += damping * (desired - _thrust(push, along))
        bend = _dot(wish, growth) * share**3 / most**2
        return push._replace(rate=share * growth - bend * wish)

    def _joints(self, q: Array, v: Array, desired: tuple[Array, Array, Array]) -> Array:
        """Accelerations (…, n) of joints by which their errors decay."""
        at, rate = self.vehicle.arm, self.vehicle.arm_rates
        off = desired[0][..., at] - q[..., at]
        drift = desired[1][..., rate] - v[..., rate]
        return (
            desired[2][..., rate]
            + self.gains.stiffness[rate] * off
            + self.gains.damping[rate] * drift
        )

    def _turning(
        self,
        q: Array,
        v: Array,
        desired: tuple[Array, Array, Array],
        axis: Array,
        push: WantedForce,
    ) -> Array:
        """Angular acceleration (…, 3), base's frame, by which the base leans as the force needs it.

        So is the thrust axis (…, 3).
        """
        kinematics = self.vehicle.kinematics
        spin = kinematics.angular(q, v, np.zeros_like(v))[0]
        spin_desired, acceleration = kinematics.angular(*desired)
        rotation = kinematics.rotation(desired[0])
        carried = transposed(kinematics.rotation(q)) @ rotation
        force, rate = (times(transposed(rotation), each) for each in (push.force, push.rate))
        correction = times(transposed(rotation), push.correction)
        size = np.linalg.norm(force, axis=-1, keepdims=True)
        unit = force / size
        # How fast the force turns, seen from the desired base, in which the desired one does not.
        moving = (rate - np.cross(spin_desired, correction)) / size
        about = np.cross(unit, moving)
        cosine = np.maximum(1.0 + _dot(axis, unit), _LEAST)
        leaning = about - unit * _dot(about, axis) / cosine
        ahead = times(carried, spin_desired + leaning)
        growth = times(carried, acceleration + np.cross(spin_desired, leaning))
        return (
            growth
            - np.cross(spin, ahead)
            + self._weighed(self.gains.stiffness, _attitude_error(carried, axis, unit), axis)
            + self._weighed(self.gains.damping, ahead - spin, axis)
        )

    def _weighed(self, gains: Array, error: Array, axis: Array) -> Array:
        """Attitude errors (…, 3) in the base's frame times gains (nv).

        About the thrust axis (…, 3) the gains are those of the position.
        """
        places = self.vehicle.layout.v
        heading = axis * _dot(axis, error)
        weighed: Array = gains[places.attitude] * (error - heading)
        return weighed + gains[places.position] * heading


def _thrust(push: WantedForce, along: Array) -> Array:
    """The part (…, 3) of a force that thrust makes along its axis, which never pulls."""
    return np.maximum(_dot(push.force, along), 0.0) * along


def _attitude_error(carried: Array, axis: Array, unit: Array) -> Array:
    """How the base must turn: its thrust axis by the shortest way, then about that axis.

    The two rotation vectors added (…, 3), in the base's frame. The more the axis is off, the less
    the heading counts, and where it is opposite, not at all. `carried` (…, 3, 3) leads from the
    desired base's frame to that of the base; `axis` is in the frame of its base, and `unit` where
    that should be, in the desired base's frame.
    """
    swing = np.cross(axis, times(carried, unit))
    sine = np.linalg.norm(swing, axis=-1, keepdims=True)
    angle = np.arctan2(sine, _dot(axis, times(carried, unit)))
    turned = np.concatenate(
        [np.cross(axis, unit), np.maximum(1.0 + _dot(axis, unit), _LEAST)], axis=-1
    )
    whole = carried @ Rotation.from_quat(turned.reshape(-1, 4)).as_matrix().reshape(carried.shape)
    quaternion = Rotation.from_matrix(whole.reshape(-1, 3, 3)).as_quat()
    quaternion = quaternion.reshape(*axis.shape[:-1], 4)
    about, cosine = _dot(quaternion[..., :3], axis), quaternion[..., 3:]
    heading = 2.0 * np.arctan2(about * np.copysign(1.0, cosine), np.abs(cosine))
    lean = swing * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0)
    return lean + axis * heading * (about**2 + cosine**2)


def _dot(a: Array, b: Array) -> Array:
    """Scalar products (…, 1) of vectors (…, 3)."""
    return np.sum(a * b, axis=-1, keepdims=True)
