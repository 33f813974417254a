"""Attitudes: rotations as matrices, angles and quaternions, and how they turn in time.

Attitude angles are the three of an intrinsic sequence: R = R_a(θ₋₁)·R_b(θ₀)·R_c(θ₁) turns vectors
of arm 1's frame into the world's. The angular velocity in world axes is ω = E(θ)·θ̇, where the
columns of E are the axes that the three angles turn about. All functions take any leading axes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.vectors import Array, rotation_about, skew, transposed

# |cos θ₀| below which angles count as singular: within a quarter of a degree.
SINGULAR_COSINE = 0.005
# The same for angles that began between −90° and 90°, rad; a cosine would not tell of whole turns.
LARGEST_THETA_0 = math.acos(SINGULAR_COSINE)
# A scalar, vector or matrix at s instants, and its first two derivatives in time.
Derivatives = tuple[Array, Array, Array]


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
    axes = np.eye(3)[["xyz".index(letter) for letter in sequence]]
    first, second, third = (rotation_about(axes[k], angles[..., k]) for k in range(3))
    return first @ second @ third


def attitude_angles(sequence: str, rotation: Array) -> Array:
    """Angles (…, 3) of rotations (…, 3, 3), the inverse of `rotation_matrix`.

    They lie in (−π, π], the second in [−π/2, π/2]. Raises `SingularAttitudeError` within a
    quarter of a degree of θ₀ = ±π/2, where different angles are the same attitude.
    """
    first, second, third = ("xyz".index(letter) for letter in sequence)
    # The entry of R that is ± sin θ₀ in any sequence of three different axes.
    sine = rotation[..., first, third]
    singular = np.ravel(1.0 - sine**2 < SINGULAR_COSINE**2)
    if np.any(singular):
        raise SingularAttitudeError(
            f"the attitude reaches the singularity of the sequence {sequence} (second angle near "
            '±90°); choose another sequence or attitude = "quaternion" in the robot file, or a '
            "gentler path",
            int(np.argmax(singular)),
        )
    # The sign of the sequence of the axes.
    sign = 1.0 if (first + 1) % 3 == second else -1.0
    level = np.hypot(rotation[..., first, first], rotation[..., first, second])
    angles = (
        np.arctan2(-sign * rotation[..., second, third], rotation[..., third, third]),
        np.arctan2(sign * sine, level),
        np.arctan2(-sign * rotation[..., first, second], rotation[..., first, first]),
    )
    return np.stack(angles, axis=-1)


def quaternion_of(rotation: Array) -> Array:
    """Unit quaternions (…, 4), x y z w, of rotations (…, 3, 3)."""
    trace = np.trace(rotation, axis1=-2, axis2=-1)[..., np.newaxis, np.newaxis]
    # The quaternion times each of its entries, and 4.
    products = np.empty((*rotation.shape[:-2], 4, 4))
    products[..., :3, :3] = rotation + transposed(rotation) + (1.0 - trace) * np.eye(3)
    products[..., :3, 3] = products[..., 3, :3] = 2.0 * _axis(rotation)
    products[..., 3:, 3:] = 1.0 + trace
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    quaternion = np.take_along_axis(products, largest[..., np.newaxis, np.newaxis], axis=-2)[
        ..., 0, :
    ]
    return quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)


def rotation_vector(rotation: Array) -> Array:
    """Vectors (…, 3), rad, along the axes and as long as the angles, 0 to π, of rotations."""
    quaternion = quaternion_of(rotation)
    quaternion = np.where(quaternion[..., 3:] < 0.0, -quaternion, quaternion)
    vector, scalar = quaternion[..., :3], quaternion[..., 3:]
    sine = np.linalg.norm(vector, axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, scalar)
    return vector * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)


def rotation_of(quaternion: Array) -> Array:
    """Rotations (…, 3, 3) of quaternions (…, 4), x y z w, of any length."""
    vector, scalar = quaternion[..., :3], quaternion[..., 3, np.newaxis, np.newaxis]
    square = np.sum(quaternion**2, axis=-1)[..., np.newaxis, np.newaxis]
    outer = vector[..., :, np.newaxis] * vector[..., np.newaxis, :]
    turned = (2.0 * scalar**2 / square - 1.0) * np.eye(3)
    return turned + 2.0 / square * (outer + scalar * skew(vector))


def turning_of(rotation: Array, rate: Array, second: Array) -> Turning:
    """The rotation R(t), given with dR/dt and d²R/dt² (…, 3, 3), with ω and dω/dt in world axes."""
    transposed = np.swapaxes(rotation, -1, -2)
    spin = rate @ transposed
    # d(Ṙ Rᵀ)/dt; what is symmetric in it cancels in `_axis`.
    spin_rate = second @ transposed + rate @ np.swapaxes(rate, -1, -2)
    return Turning(rotation, _axis(spin), _axis(spin_rate))


def unit_derivatives(vector: Array, rate: Array, second: Array) -> Derivatives:
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


def product_derivatives(
    times: Callable[[Array, Array], Array], a: Derivatives | Array, b: Derivatives | Array
) -> Derivatives:
    """A product, linear in both factors, and its first two derivatives in time."""
    return (
        times(a[0], b[0]),
        times(a[1], b[0]) + times(a[0], b[1]),
        times(a[2], b[0]) + 2.0 * times(a[1], b[1]) + times(a[0], b[2]),
    )


def _axis(matrix: Array) -> Array:
    """The vector of the skew part of a matrix."""
    return 0.5 * (matrix - np.swapaxes(matrix, -1, -2))[..., (2, 0, 1), (1, 2, 0)]
