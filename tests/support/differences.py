"""Derivatives by central differences of eighth order, to hold closed forms against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)


def rate(function: Callable[[Array], Array], time: Array, step: float = 0.01) -> Array:
    """Derivative of `function`, which takes times (s) to arrays (s, …), at times (s)."""
    total = sum(
        weight * (function(time + k * step) - function(time - k * step))
        for k, weight in enumerate(_WEIGHTS, start=1)
    )
    derivative: Array = np.asarray(total) / step
    return derivative


def series_rate(series: Array, step: float) -> Array:
    """Derivative of samples (s, …), equally spaced, at all but the first and last four."""
    inner = range(4, len(series) - 4)
    total = sum(
        weight * (series[[i + k for i in inner]] - series[[i - k for i in inner]])
        for k, weight in enumerate(_WEIGHTS, start=1)
    )
    derivative: Array = np.asarray(total) / step
    return derivative
