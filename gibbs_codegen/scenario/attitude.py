"""Attitude angles: from rotations and their rates to the three angles of an intrinsic sequence.

R = R_a(θ₋₁)·R_b(θ₀)·R_c(θ₁) turns vectors of arm 1's frame into the world's. The angular velocity
in world axes is ω = E(θ)·θ̇, where the columns of E are the axes that the three angles turn about.
All functions take any leading axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError

Array = NDArray[np.float64]

# |cos θ₀| below which angles count as singular: within a quarter of a degree.
SINGULAR_COSINE = 0.005
# The same for angles that began between −90° and 90°, rad; a cosine would not tell of whole turns.
LARGEST_THETA_0 = math.acos(SINGULAR_COSINE)


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
