"""Axes of autopilots: a body's x forwards, y to the right, z down, the world's north, east, down.

Here a base has x forwards, y to the left and z up, and the world X to the east, Y to the north and
Z up. Half a turn leads from either body to the other, and half a turn from either world to the
other, so both functions of vectors are the same both ways.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

_OVER = np.array([1.0, -1.0, -1.0])
_UNDER = np.array([1.0, 1.0, -1.0])
_HALF = np.sqrt(0.5)
# Entries of a quaternion, x y z w, of which sums and differences are those of the turned one.
_FIRST, _SECOND = np.array([[3, 0, 0, 3], [2, 1, 1, 2]])
_SIGNS = np.array([1.0, 1.0, -1.0, -1.0])


def turned_over(vectors: ArrayLike) -> NDArray[np.float64]:
    """Vectors (…, 3) of the base's axes in FRD, or the other way."""
    turned: NDArray[np.float64] = np.asarray(vectors, float) * _OVER + 0.0
    return turned


def north_east_down(vectors: ArrayLike) -> NDArray[np.float64]:
    """Vectors (…, 3) of the world's axes in NED, or the other way."""
    turned: NDArray[np.float64] = np.asarray(vectors, float)[..., [1, 0, 2]] * _UNDER + 0.0
    return turned


def turned_attitude(quaternion: ArrayLike) -> NDArray[np.float64]:
    """The quaternions (…, 4), real part first, from a body's FRD axes to NED.

    Of those, real part last, from the base's axes to the world's; they are the products with both
    half turns.
    """
    parts = np.asarray(quaternion, float)
    return _HALF * (parts.take(_FIRST, axis=-1) + _SIGNS * parts.take(_SECOND, axis=-1))


def attitude_turned_back(quaternion: ArrayLike) -> NDArray[np.float64]:
    """The quaternions (…, 4) of which `turned_attitude` makes these."""
    # Twice both half turns are none.
    return np.roll(turned_attitude(np.roll(quaternion, -1, axis=-1)), -1, axis=-1)
