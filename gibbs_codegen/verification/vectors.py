"""Arrays of vectors and rotations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Real or complex: the Lagrangian formulation differentiates by complex steps.
Array = NDArray[Any]


def about(axis: int, angle: Array) -> Array:
    """Rotations (…, 3, 3) about a coordinate axis by angles (…) in rad, which may be complex."""
    cosine, sine = np.cos(angle), np.sin(angle)
    following, last = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.zeros((*angle.shape, 3, 3), angle.dtype)
    rotation[..., axis, axis] = 1.0
    rotation[..., following, following] = rotation[..., last, last] = cosine
    rotation[..., last, following] = sine
    rotation[..., following, last] = -sine
    return rotation


def times(matrices: Array, vectors: Array) -> Array:
    """Products (…, i) of matrices (…, i, j) and vectors (…, j)."""
    return (matrices @ vectors[..., None])[..., 0]


def cross(a: Array, b: Array) -> Array:
    """Cross products of vectors, (…, 3)."""
    # np.cross takes four times as long for so few of them.
    return a[..., (1, 2, 0)] * b[..., (2, 0, 1)] - a[..., (2, 0, 1)] * b[..., (1, 2, 0)]


def quaternion_matrices(quaternions: Array) -> Array:
    """Rotations (…, 3, 3) of quaternions x, y, z, w, which need not be of unit length."""
    unit = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    vector, scalar = unit[..., None, :3], unit[..., 3:, None]
    # Rows of e × u over the axes e are the matrix of u×.
    turning = cross(np.eye(3), vector)
    return np.eye(3) + 2.0 * (turning @ turning + scalar * turning)


def quaternions_of_matrices(matrices: Array) -> Array:
    """Quaternions x, y, z, w, of unit length and either sign, of rotations (…, 3, 3).

    Each is the q with the largest qᵀKq, where K is linear in the rotation.
    """
    trace = np.trace(matrices, axis1=-2, axis2=-1)[..., None, None]
    turned = np.swapaxes(matrices, -1, -2)
    twice = matrices - turned
    axis = np.stack([twice[..., 2, 1], twice[..., 0, 2], twice[..., 1, 0]], axis=-1)[..., None]
    vector = matrices + turned - trace * np.eye(3)
    rows = [[vector, axis], [np.swapaxes(axis, -1, -2), trace]]
    return np.linalg.eigh(np.block(rows))[1][..., -1]


def quaternions_of_angles(angles: Array) -> Array:
    """Quaternions x, y, z, w of turns about x, y, z, one by one, each about the turned axis."""
    x, y, z = np.moveaxis(np.sin(0.5 * angles), -1, 0)
    a, b, c = np.moveaxis(np.cos(0.5 * angles), -1, 0)
    parts = (
        x * b * c + a * y * z,
        a * y * c - x * b * z,
        a * b * z + x * y * c,
        a * b * c - x * y * z,
    )
    return np.stack(parts, axis=-1)
