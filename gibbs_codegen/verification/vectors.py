"""Arrays of vectors and rotations."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

# Real or complex: the Lagrangian formulation differentiates by complex steps.
Array = NDArray[Any]
COMPLEX_STEP = 1e-40


class Sized(NamedTuple):
    """Numbers (s, …), and the sizes of the terms that they are made of."""

    value: Array
    size: Array


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
