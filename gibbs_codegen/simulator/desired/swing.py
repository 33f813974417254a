"""The shortest rotation from one moving direction to another, with its derivatives in time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.scenario.orientation import cross_derivatives

Array = NDArray[np.float64]
# A scalar, vector or matrix at s instants, and its first two derivatives in time.
Derivatives = tuple[Array, Array, Array]


def swing(begin: Derivatives, end: Derivatives) -> Derivatives:
    """The shortest rotation (s, 3, 3) of a unit vector to another, with its first two derivatives.

    The vectors and their derivatives are (s, 3), nowhere opposite to each other.
    """
    about = cross_derivatives(begin, end)
    dot = product(lambda a, b: np.sum(a * b, axis=-1), begin, end)
    below = 1.0 + dot[0]
    share = (
        1.0 / below,
        -dot[1] / below**2,
        2.0 * dot[1] ** 2 / below**3 - dot[2] / below**2,
    )
    outer = product(lambda a, b: a[..., :, np.newaxis] * b[..., np.newaxis, :], about, about)
    along = product(_scaled, share, outer)
    # Rodrigues' formula, with the axis times the sine as `about`.
    first, second, third = (
        _scaled(d, np.eye(3)) + skew(w) + p for d, w, p in zip(dot, about, along, strict=True)
    )
    return first, second, third


def product(times: Callable[[Array, Array], Array], a: Derivatives, b: Derivatives) -> Derivatives:
    """A product, linear in both factors, and its first two derivatives."""
    return (
        times(a[0], b[0]),
        times(a[1], b[0]) + times(a[0], b[1]),
        times(a[2], b[0]) + 2.0 * times(a[1], b[1]) + times(a[0], b[2]),
    )


def applied(matrix: Array, vector: Array) -> Array:
    """Products (…, r) of matrices (…, r, c) with vectors (…, c)."""
    product: Array = (matrix @ vector[..., np.newaxis])[..., 0]
    return product


def skew(vector: Array) -> Array:
    """Matrices (…, 3, 3) of cross products with vectors (…, 3)."""
    matrix: Array = np.cross(np.eye(3), vector[..., np.newaxis, :])
    return matrix


def _scaled(scalar: Array, matrix: Array) -> Array:
    scaled: Array = scalar[..., np.newaxis, np.newaxis] * matrix
    return scaled
