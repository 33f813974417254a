"""Desired attitude of the base: along the tangent of its path, level, or turned from level.

Attitude angles are the three of an intrinsic sequence: R = R_a(θ₋₁)·R_b(θ₀)·R_c(θ₁) turns vectors
of arm 1's frame into the world's. The angular velocity in world axes is ω = E(θ)·θ̇, where the
columns of E are the axes that the three angles turn about. All functions take any leading axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.scenario.numbers import require
from gibbs_codegen.flight.scenario.paths import Line, Path, Vector

Array = NDArray[np.float64]

# |cos θ₀| below which angles count as singular: within a quarter of a degree.
SINGULAR_COSINE = 0.005
# The same for angles that began between −90° and 90°, rad; a cosine would not tell of whole turns.
LARGEST_THETA_0 = math.acos(SINGULAR_COSINE)
_VERTICAL = np.array([0.0, 0.0, 1.0])
# Speed under which a path has no direction to follow, m/s.
_STANDSTILL = 1e-6
# Sine of the angle to the vertical under which the base normal has no side to lean to.
_UPRIGHT = 1e-3


class SingularAttitudeError(UsageError):
    """An attitude so near the singularity of the sequence that angles do not describe it.

    `place` is that of the first such attitude among those given.
    """

    def __init__(self, message: str, place: int) -> None:
        self.place = place
        super().__init__(message)


@dataclass(frozen=True)
class Turning:
    """A rotation in time: R (…, 3, 3), ω and dω/dt (…, 3) in world axes, rad/s and rad/s²."""

    rotation: Array
    velocity: Array
    acceleration: Array


def rotation_matrix(sequence: str, angles: ArrayLike) -> Array:
    """R (…, 3, 3), from arm 1's axes to the world's, of angles θ₋₁, θ₀, θ₁ (…, 3), rad.

    They turn about axes in the order of `sequence`, such as "xyz".
    """
    angles = np.asarray(angles, dtype=np.float64)
    flat = Rotation.from_euler(sequence.upper(), angles.reshape(-1, 3)).as_matrix()
    matrix: Array = flat.reshape(*angles.shape[:-1], 3, 3)
    return matrix


def rate_matrix(sequence: str, angles: ArrayLike) -> Array:
    """E (…, 3, 3), with ω = E θ̇ in world axes, of angles θ₋₁, θ₀, θ₁ (…, 3), rad."""
    angles = np.asarray(angles, dtype=np.float64)
    first, second, third = (np.eye(3)["xyz".index(letter)] for letter in sequence)
    outer = _about(first, angles[..., 0])
    both = outer @ _about(second, angles[..., 1])
    columns = [np.broadcast_to(first, (*angles.shape[:-1], 3)), outer @ second, both @ third]
    return np.stack(columns, axis=-1)


def bias_acceleration(sequence: str, angles: ArrayLike, rates: ArrayLike) -> Array:
    """Ė θ̇ (…, 3), rad/s², world axes: what dω/dt is while the rates are constant.

    Each axis is carried round by the rotations before it.
    """
    rates = np.asarray(rates, dtype=np.float64)
    first, second, third = np.moveaxis(rate_matrix(sequence, angles), -1, 0)
    one, two, three = (rates[..., k, np.newaxis] for k in range(3))
    bias: Array = np.cross(one * first, two * second)
    bias += np.cross(one * first + two * second, three * third)
    return bias


def attitude_angles(sequence: str, turning: Turning) -> tuple[Array, Array, Array]:
    """Angles, rates and accelerations (…, 3) of a rotation in time; the inverse of `ω = E θ̇`.

    Angles lie in (−π, π], the second in [−π/2, π/2]. Raises `SingularAttitudeError` within a
    quarter of a degree of θ₀ = ±π/2, where different angles are the same attitude.
    """
    rotation = turning.rotation
    first, _, third = ("xyz".index(letter) for letter in sequence)
    # The entry of R that is ± sin θ₀ in any sequence of three different axes.
    sine = rotation[..., first, third]
    singular = np.ravel(1.0 - sine**2 < SINGULAR_COSINE**2)
    if np.any(singular):
        raise SingularAttitudeError(
            f"the attitude reaches the singularity of the sequence {sequence} (its second angle "
            "to ±90°); choose another sequence in the robot file, or "
            'attitude = "quaternion" where none serves, or a gentler path',
            int(np.argmax(singular)),
        )
    flat = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_euler(sequence.upper())
    angles = flat.reshape(*rotation.shape[:-2], 3)
    inverse = np.asarray(np.linalg.inv(rate_matrix(sequence, angles)), dtype=np.float64)
    rates = _times(inverse, turning.velocity)
    bias = bias_acceleration(sequence, angles, rates)
    return angles, rates, _times(inverse, turning.acceleration - bias)


def _about(axis: Array, angles: Array) -> Array:
    """Rotations (…, 3, 3) by angles (…) about a coordinate axis (3): Rodrigues' formula."""
    cross = np.cross(np.eye(3), axis)
    along = np.outer(axis, axis)
    cosine, sine = (part[..., np.newaxis, np.newaxis] for part in (np.cos(angles), np.sin(angles)))
    matrix: Array = along + cosine * (np.eye(3) - along) + sine * cross
    return matrix


def _times(matrices: Array, vectors: Array) -> Array:
    product: Array = (matrices @ vectors[..., np.newaxis])[..., 0]
    return product


class Orientation(Protocol):
    """Anything that gives the attitude of the base at times (s), for a base on a path.

    `arm_angles` (N) are the angles of the base arms about z of the base, from its x axis, rad.
    """

    def __call__(self, path: Path, time: Array, arm_angles: Array, /) -> Turning:
        """Rotation, angular velocity and angular acceleration at `time`."""
        ...


@dataclass(frozen=True)
class Level:
    """Base normal vertical, arm 1 turned from the world's X by a heading that grows steadily.

    rad and rad/s.
    """

    heading: float = 0.0
    rate: float = 0.0

    def __call__(self, path: Path, time: Array, arm_angles: Array) -> Turning:
        """Rotation, angular velocity and angular acceleration at times (s)."""
        heading = self.heading + self.rate * np.asarray(time, dtype=np.float64)
        rotation = np.zeros((*heading.shape, 3, 3))
        rotation[..., 0, 0] = rotation[..., 1, 1] = np.cos(heading)
        rotation[..., 1, 0] = np.sin(heading)
        rotation[..., 0, 1] = -rotation[..., 1, 0]
        rotation[..., 2, 2] = 1.0
        velocity = np.zeros((*heading.shape, 3))
        velocity[..., 2] = self.rate
        return Turning(rotation, velocity, np.zeros_like(velocity))


@dataclass(frozen=True)
class Turn:
    """From level, with a heading, about an axis of the world: from rest to rest, minimum jerk.

    rad and s; `angle` may be any number of turns.
    """

    axis: Vector
    angle: float
    duration: float
    begin: float = 0.0
    heading: float = 0.0

    def __post_init__(self) -> None:
        is_axis = len(self.axis) == 3 and 0.0 < math.hypot(*self.axis) < math.inf
        require(is_axis, "attitude: the axis of a turn must be a direction, not zero")
        require(0.0 < self.duration < math.inf, "attitude: a turn takes more than 0 s")

    def __call__(self, path: Path, time: Array, arm_angles: Array) -> Turning:
        """Rotation, angular velocity and angular acceleration at times (s)."""
        time = np.asarray(time, dtype=np.float64)
        axis = np.array(self.axis) / math.hypot(*self.axis)
        # Angle, rate and acceleration, as of a point on a line.
        way = Line((0.0, 0.0, 0.0), (self.angle, 0.0, 0.0), self.duration, self.begin)(time)
        angle, rate, growth = (way[..., order, :1] * axis for order in range(3))
        start = Level(self.heading)(path, time, arm_angles).rotation
        turned = Rotation.from_rotvec(angle.reshape(-1, 3)).as_matrix().reshape(start.shape)
        return Turning(turned @ start, rate, growth)


@dataclass(frozen=True)
class Tangent:
    """The paper's attitude (section 4): one base arm along the path, the normal nearest to Z.

    `arm` is the number of that arm, from 1 to N. A base without arms has its x axis along the path.
    """

    arm: int = 2

    def __call__(self, path: Path, time: Array, arm_angles: Array) -> Turning:
        """Rotation, angular velocity and angular acceleration at times (s).

        Raises `UsageError` where there is no such arm, and where the path stands still or goes
        straight up or down.
        """
        if len(arm_angles) and not 1 <= self.arm <= len(arm_angles):
            known = f"there are arms 1 to {len(arm_angles)}"
            raise UsageError(f"base.attitude.arm: {self.arm}: {known}")
        angle = arm_angles[self.arm - 1] if len(arm_angles) else 0.0
        time = np.asarray(time, dtype=np.float64)
        derivatives = path(time)
        along = unit_derivatives(*(derivatives[..., order, :] for order in (1, 2, 3)))
        _check_direction(time, derivatives[..., 1, :], along[0])
        # Of the vertical, what is at right angles to the tangent.
        height, climb, turn = (t[..., 2:] for t in along)
        up = unit_derivatives(
            _VERTICAL - height * along[0],
            -climb * along[0] - height * along[1],
            -turn * along[0] - 2.0 * climb * along[1] - height * along[2],
        )
        side = cross_derivatives(up, along)
        # Columns: the tangent, what lies left of it, the normal; then the base's x in their place.
        cosine, sine = np.cos(angle), np.sin(angle)
        frames = [
            np.stack([cosine * t - sine * s, sine * t + cosine * s, u], axis=-1)
            for t, s, u in zip(along, side, up, strict=True)
        ]
        return turning_of(*frames)


def turning_of(rotation: Array, rate: Array, second: Array) -> Turning:
    """The rotation R(t), given with dR/dt and d²R/dt² (…, 3, 3), with ω and dω/dt in world axes."""
    transposed = np.swapaxes(rotation, -1, -2)
    spin = rate @ transposed
    # d(Ṙ Rᵀ)/dt; what is symmetric in it cancels in `_axis`.
    spin_rate = second @ transposed + rate @ np.swapaxes(rate, -1, -2)
    return Turning(rotation, _axis(spin), _axis(spin_rate))


def heading_error(path: Path, time: ArrayLike, direction: Array) -> Array:
    """Angles (s), rad, between unit vectors (s, 3), world axes, and the tangent of a path."""
    velocity = path(time)[..., 1, :]
    tangent = velocity / np.linalg.norm(velocity, axis=-1, keepdims=True)
    # By the chord: the cosine cannot tell angles below 1e-8.
    half = np.linalg.norm(direction - tangent, axis=-1) / 2.0
    angle: Array = 2.0 * np.arcsin(np.minimum(half, 1.0))
    return angle


def _check_direction(time: Array, velocity: Array, tangent: Array) -> None:
    """Raise `UsageError` if the path stands still, or goes straight up or down.

    `tangent` (s, 3) is the direction of the velocity (s, 3).
    """
    still = np.linalg.norm(velocity, axis=-1) < _STANDSTILL
    if np.any(still):
        raise UsageError(
            f"the path of the base stands still at t = {time[still][0]:.6g} s, where it has no "
            "tangent for an arm to follow; let it move, or choose a level attitude"
        )
    upright = np.linalg.norm(tangent[..., :2], axis=-1) < _UPRIGHT
    if np.any(upright):
        raise UsageError(
            f"the path of the base is vertical at t = {time[upright][0]:.6g} s, where no attitude "
            "along it is nearest to level; bend it, or choose a level attitude"
        )


def unit_derivatives(vector: Array, rate: Array, second: Array) -> tuple[Array, Array, Array]:
    """The unit vector along a vector (…, 3), and its first two derivatives in time."""
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / np.linalg.norm(vector, axis=-1, keepdims=True)
        unit = vector * inverse
        growth = np.sum(unit * rate, axis=-1, keepdims=True) * inverse
        unit_rate = rate * inverse - unit * growth
        growth_rate = (
            np.sum(unit_rate * rate + unit * second, axis=-1, keepdims=True) * inverse - growth**2
        )
        unit_second = (
            second * inverse - rate * inverse * growth - unit_rate * growth - unit * growth_rate
        )
    return unit, unit_rate, unit_second


def cross_derivatives(
    a: tuple[Array, Array, Array], b: tuple[Array, Array, Array]
) -> tuple[Array, Array, Array]:
    """A cross product (…, 3) and its first two derivatives in time, of factors with theirs."""
    return (
        np.cross(a[0], b[0]),
        np.cross(a[1], b[0]) + np.cross(a[0], b[1]),
        np.cross(a[2], b[0]) + 2.0 * np.cross(a[1], b[1]) + np.cross(a[0], b[2]),
    )


def _axis(matrix: Array) -> Array:
    """The vector of the skew part of a matrix."""
    axis: Array = 0.5 * np.stack(
        [
            matrix[..., 2, 1] - matrix[..., 1, 2],
            matrix[..., 0, 2] - matrix[..., 2, 0],
            matrix[..., 1, 0] - matrix[..., 0, 1],
        ],
        axis=-1,
    )
    return axis
