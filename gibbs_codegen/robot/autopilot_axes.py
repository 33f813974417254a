"""Axes of autopilots: x forwards, y to the right, z down (FRD), where a base has y left and z up.

Half a turn about x leads from either to the other, so it is the same function both ways.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def turned_over(vectors: ArrayLike) -> NDArray[np.float64]:
    """Vectors (…, 3) of the base's axes in FRD, or the other way."""
    found: NDArray[np.float64] = np.asarray(vectors, float) * [1.0, -1.0, -1.0] + 0.0
    return found
