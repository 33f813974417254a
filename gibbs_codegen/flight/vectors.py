"""Vectors and matrices, of one state or of many along leading axes."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]


def transposed(matrix: Array) -> Array:
    """Matrices (…, n, m) of matrices (…, m, n)."""
    return np.swapaxes(matrix, -1, -2)


def times(matrix: Array, vector: Array) -> Array:
    """Products (…, m) of matrices (…, m, n) and vectors (…, n)."""
    return (matrix @ vector[..., np.newaxis])[..., 0]


def skew(vector: Array) -> Array:
    """Matrices (…, 3, 3) of cross products with vectors (…, 3)."""
    return np.cross(np.eye(3), vector[..., np.newaxis, :])


def roll_pitch_yaw(rotation: Array) -> Array:
    """Angles (…, 3), rad, about x, then y, then z of the world, that make rotations (…, 3, 3)."""
    r = np.moveaxis(rotation, (-2, -1), (0, 1))
    pitch = np.arctan2(-r[2, 0], np.hypot(r[2, 1], r[2, 2]))
    angles = (np.arctan2(r[2, 1], r[2, 2]), pitch, np.arctan2(r[1, 0], r[0, 0]))
    return np.stack(angles, axis=-1)


def rotation_about(axis: Array, angles: Array) -> Array:
    """Rotations (…, 3, 3) by angles (…) about a unit vector (3): Rodrigues' formula."""
    cross = np.cross(np.eye(3), axis)
    along = np.outer(axis, axis)
    cosine, sine = (part[..., np.newaxis, np.newaxis] for part in (np.cos(angles), np.sin(angles)))
    return along + cosine * (np.eye(3) - along) + sine * cross


def halton(count: int, dimensions: int) -> Array:
    """The first points (count, dimensions) of Halton's sequence, from 0 to below 1."""
    primes = (p for p in itertools.count(2) if all(p % factor for factor in range(2, p)))
    points = np.zeros((count, dimensions))
    for column, base in zip(points.T, primes, strict=False):
        rest, share = np.arange(count), 1.0
        while np.any(rest):
            rest, digits = np.divmod(rest, base)
            share /= base
            column += share * digits
    return points
