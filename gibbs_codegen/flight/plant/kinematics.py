"""Coordinates, errors and rates of a base with attitude angles, and of one with a quaternion.

Everything else of a flight works on coordinates q (nq) and velocities v, a (nv) by the places
of the layout. Tracking errors have an entry per velocity: of the attitude and the position of the
base, in the places of its angular and linear velocity, and of the joints.

With a quaternion no attitude is singular, and v holds the linear and the angular velocity of the
base in its own frame. Quaternions are qx, qy, qz, qw; where none of unit length is asked for, any
length means the same attitude.
"""

from __future__ import annotations

from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gibbs_codegen.arrays import Program, variable
from gibbs_codegen.arrays.base import quaternion_motion
from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.arrays.nodes import Space
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.orientation import (
    Turning,
    attitude_angles,
    rotation_matrix,
)
from gibbs_codegen.flight.vectors import (
    Array,
    conjugate,
    pure,
    quaternion_product,
    rotation_vector,
    times,
    transposed,
)
from gibbs_codegen.robot.layout import Layout

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
    """A base with a quaternion: `AngleKinematics` has the same methods for angles.

    `error_names` has a name for each entry of v. Errors of the position are in world axes. Those of
    the attitude are the rotation vector from the actual to the desired attitude in the base's
    frame, and the difference of angular velocities there.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        names = [*layout.v.names]
        names[layout.v.position] = layout.q.names[layout.q.position]
        names[layout.v.attitude] = [f"attitude about the base's {axis}" for axis in "xyz"]
        self.error_names = tuple(names)

    @property
    def space(self) -> Space:
        """How many entries coordinates and displacements have."""
        return Space(self.layout.q.size, self.layout.v.size)

    @cached_property
    def motion(self) -> Evaluator:
        """What turns entries c (…, nq) with a quaternion of any length, `rates` and `growth`.

        Into q, v and a.
        """
        given = tuple(variable(name, self.layout.q.size) for name in ("c", "rates", "growth"))
        outputs = dict(zip("qva", quaternion_motion(self, *given), strict=True))
        return Evaluator(Program("motion", given, outputs), {})

    def rotation(self, q: Array) -> Array:
        """R (…, 3, 3), from the base's frame to the world, at q (…, nq) of unit length."""
        # A copy, since SciPy refuses an empty array that is read-only.
        quaternion = np.array(q[..., self.layout.q.attitude])
        flat = Rotation.from_quat(quaternion.reshape(-1, 4)).as_matrix()
        return flat.reshape(*quaternion.shape[:-1], 3, 3)

    def normalised(self, q: Array) -> Array:
        """Coordinates (…, nq) of which modules may be asked: with quaternions of unit length."""
        unit, attitude = np.array(q), self.layout.q.attitude
        unit[..., attitude] /= np.linalg.norm(q[..., attitude], axis=-1, keepdims=True)
        return unit

    def rates(self, q: Array, v: Array) -> Array:
        """Rates (…, nq) of coordinates by v (…, nv), which keep the length of a quaternion."""
        places, rates = self.layout, np.empty_like(q)
        rates[..., places.q.joints] = v[..., places.v.joints]
        rates[..., places.q.position] = times(self.rotation(q), v[..., places.v.position])
        turn = 0.5 * pure(v[..., places.v.attitude])
        rates[..., places.q.attitude] = quaternion_product(q[..., places.q.attitude], turn)
        return rates

    def turned(self, turning: Turning) -> tuple[Array, Array, Array]:
        """Entries of the attitude in q (s, 4), v and a (s, 3), without jumps in time."""
        quaternion = np.asarray(Rotation.from_matrix(turning.rotation).as_quat())
        # Of a quaternion and its opposite, which are the same attitude, the one nearer to the last.
        turns_back = np.einsum("si,si->s", quaternion[1:], quaternion[:-1]) < 0.0
        quaternion[1:][np.cumsum(turns_back) % 2 == 1] *= -1.0
        world = turning.velocity, turning.acceleration
        velocity, acceleration = (times(transposed(turning.rotation), each) for each in world)
        return quaternion, velocity, acceleration

    def continued(self, last: Array, attitude: Array) -> Array:
        """Quaternions (s, 4), or their opposites if the first of those is nearer to the last."""
        return np.copysign(1.0, attitude[0] @ last) * attitude

    def moved(self, turning: Turning, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
        """Entries (…, 3) of the position in v and a, by its rates (…, 3) in world axes."""
        inverse = transposed(turning.rotation)
        linear = times(inverse, velocity)
        carried = np.cross(times(inverse, turning.velocity), linear)
        return linear, times(inverse, acceleration) - carried

    def kept(self, v: Array, turn: Array) -> Array:
        """Velocities (nv) of a base that is turned but moves on.

        `turn` (3, 3) leads from its frame before to that after.
        """
        after = v.copy()
        for part in (self.layout.v.position, self.layout.v.attitude):
            after[part] = turn @ v[part]
        return after

    def errors(self, q: Array, v: Array, q_desired: Array, v_desired: Array) -> tuple[Array, Array]:
        """Errors and their rates (…, nv), those of the position in world axes."""
        places = self.layout.q, self.layout.v
        (attitude, position, joints), (spin, linear, rates) = (
            (each.attitude, each.position, each.joints) for each in places
        )
        off, off_rate = v_desired - v, v_desired - v
        rotation, desired = self.rotation(q), self.rotation(q_desired)
        off[..., linear] = q_desired[..., position] - q[..., position]
        between = quaternion_product(conjugate(q[..., attitude]), q_desired[..., attitude])
        off[..., spin] = rotation_vector(between)
        off[..., rates] = q_desired[..., joints] - q[..., joints]
        carried = times(desired, v_desired[..., linear])
        off_rate[..., linear] = carried - times(rotation, v[..., linear])
        off_rate[..., spin] = self._carried(rotation, desired, v_desired[..., spin]) - v[..., spin]
        return off, off_rate

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
        growth[:, layout.q.attitude] += 0.5 * quaternion_product(turning, pure(spin))
        super().__init__(Motion(motion.time, motion.q, rates, growth))

    def __call__(self, time: float | Array) -> tuple[Array, Array, Array]:
        """Evaluate q (…, nq), v and a (…, nv) at times (…), as those of `Reference` are."""
        given = zip(("c", "rates", "growth"), super().__call__(time), strict=True)
        found = self.kinematics.motion(dict(given))
        return found["q"], found["v"], found["a"]


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
        """Angles, rates and accelerations (s, 3) of a rotation with s instants.

        Raises `SingularAttitudeError` where there are none.
        """
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

    def errors(self, q: Array, v: Array, q_desired: Array, v_desired: Array) -> tuple[Array, Array]:
        """Differences of coordinates, and of rates (…, nq)."""
        return q_desired - q, v_desired - v

    def reference(self, motion: Motion) -> Reference:
        """Quintics of all coordinates."""
        return Reference(motion)


Kinematics = AngleKinematics | QuaternionKinematics


def kinematics_of(layout: Layout) -> Kinematics:
    """The kinematics of a base with angles, or with a quaternion."""
    return QuaternionKinematics(layout) if layout.is_quaternion else AngleKinematics(layout)
