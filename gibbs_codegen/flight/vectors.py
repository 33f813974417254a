"""Vectors, matrices and quaternions, of one state or of many along leading axes.

A quaternion is x, y, z, w, its scalar part last.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def transposed(matrix: Array) -> Array:
    """Matrices (…, n, m) of matrices (…, m, n)."""
    return np.swapaxes(matrix, -1, -2)


def times(matrix: Array, vector: Array) -> Array:
    """Products (…, m) of matrices (…, m, n) and vectors (…, n)."""
    return (matrix @ vector[..., np.newaxis])[..., 0]


def skew(vector: Array) -> Array:
    """Matrices (…, 3, 3) of cross products with vectors (…, 3)."""
    return np.cross(np.eye(3), vector[..., np.newaxis, :])


def rotation_about(axis: Array, angles: Array) -> Array:
    """Rotations (…, 3, 3) by angles (…) about a coordinate axis (3): Rodrigues' formula."""
    cross = np.cross(np.eye(3), axis)
    along = np.outer(axis, axis)
    cosine, sine = (part[..., np.newaxis, np.newaxis] for part in (np.cos(angles), np.sin(angles)))
    return along + cosine * (np.eye(3) - along) + sine * cross


def quaternion_product(first: Array, second: Array) -> Array:
    """Products (…, 4) of quaternions."""
    one, two = first[..., :3], second[..., :3]
    scalars = first[..., 3:], second[..., 3:]
    vector = scalars[0] * two + scalars[1] * one + np.cross(one, two)
    scalar = scalars[0] * scalars[1] - np.sum(one * two, axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def conjugate(quaternion: Array) -> Array:
    """Quaternions (…, 4) that turn back."""
    return np.asarray(quaternion * np.array([-1.0, -1.0, -1.0, 1.0]))


def pure(vector: Array) -> Array:
    """Quaternions (…, 4) of vectors (…, 3)."""
    return np.concatenate([vector, np.zeros_like(vector[..., :1])], axis=-1)


def rotation_vector(quaternion: Array) -> Array:
    """Rotation vectors (…, 3), rad, of quaternions; no longer than half a turn."""
    sine = np.linalg.norm(quaternion[..., :3], axis=-1, keepdims=True)
    cosine = quaternion[..., 3:]
    half = np.arctan2(sine, np.abs(cosine))
    safe = np.where(sine > 0.0, sine, 1.0)
    # Near none, the angle is twice the sine's share, and so is the factor's limit.
    factor = np.where(sine > 0.0, half / safe, 1.0 / np.maximum(np.abs(cosine), 1e-300))
    return 2.0 * np.copysign(factor, cosine) * quaternion[..., :3]
