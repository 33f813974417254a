"""Angular velocity of attitude angles, by the axes that each of them turns about."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.flight.vectors import Array, rotation_about


def rate_matrix(sequence: str, angles: ArrayLike) -> Array:
    """E (…, 3, 3), with ω = E θ̇ in world axes, of angles θ₋₁, θ₀, θ₁ (…, 3), rad."""
    angles = np.asarray(angles, dtype=np.float64)
    first, second, third = (np.eye(3)["xyz".index(letter)] for letter in sequence)
    outer = rotation_about(first, angles[..., 0])
    both = outer @ rotation_about(second, angles[..., 1])
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
