"""Numbers that callers give, read with errors that say what is wrong and what would be right."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.emitted.preparation import real_numbers
from gibbs_codegen.errors import UsageError, written

Array = NDArray[np.float64]


def numpy_array(name: str, value: Any) -> Array:
    """Real numbers as an array of NumPy, a copy. Raises `UsageError`, which calls them `name`."""
    try:
        return np.array(real_numbers(name, value))
    except (TypeError, ValueError) as error:
        raise UsageError(str(error)) from None


def real(name: str, argument: ArrayLike, wanted: str, *shapes: tuple[int, ...]) -> Array:
    """A copy of real numbers in one of the shapes, which may be infinite or NaN.

    Raises `UsageError` that says what was `wanted`.
    """
    try:
        array = np.array(real_numbers(name, argument))
    except (TypeError, ValueError):  # Rows of different lengths, among others.
        raise UsageError(f"{name}: must be {wanted}, not {written(argument)}") from None
    if array.shape not in shapes:
        raise UsageError(f"{name}: must be {wanted}, not an array of shape {array.shape}")
    return array


def numbers(name: str, argument: ArrayLike, wanted: str, *shapes: tuple[int, ...]) -> Array:
    """A copy of real, finite numbers; else as `real`."""
    array = real(name, argument, wanted, *shapes)
    if not np.isfinite(array).all():
        raise UsageError(f"{name}: must be {wanted}; some are NaN or infinite")
    return array


def vector(name: str, argument: ArrayLike, count: int) -> Array:
    """A copy of so many finite numbers. Raises `UsageError` otherwise."""
    return numbers(name, argument, f"{count} finite numbers", (count,))


def whole(name: str, value: Any, least: int = 1) -> int:
    """A whole number of at least so much. Raises `UsageError` otherwise."""
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < least:
        raise UsageError(f"{name}: must be a whole number of {least} or more, not {written(value)}")
    return int(value)


def seconds(name: str, value: Any) -> float:
    """A time, s, finite and above 0. Raises `UsageError` otherwise."""
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not (is_number and 0.0 < value < math.inf):
        raise UsageError(f"{name}: must be a finite time above 0 s, not {written(value)}")
    return float(value)
