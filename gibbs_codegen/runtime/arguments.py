"""Arguments of compiled functions, taken and refused in the words of the emitted NumPy module.

The two are apart because an emitted module depends on nothing but NumPy; a test keeps them alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

# NumPy had at most 32 before version 2, and results have one more than arguments.
_MOST_AXES = 31


def state_array(name: str, values: Any, width: int) -> NDArray[np.float64]:
    """An argument as an array (..., width) of float64.

    Raises `TypeError` for what is no real number, and `ValueError` for numbers that do not fit into
    a float, masked entries and any other shape.
    """
    array = _numbers(name, values)
    if array.ndim == 0 or array.shape[-1] != width:
        raise ValueError(
            f"{name} must have {width} entries along its last axis, not shape {array.shape}"
        )
    if array.ndim > _MOST_AXES:
        raise ValueError(f"{name} must have at most {_MOST_AXES} axes, not {array.ndim}")
    return array


def _numbers(name: str, values: Any) -> NDArray[np.float64]:
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "biufO":
            raise TypeError(f"not {array.dtype}")
        if array.dtype.kind == "O":
            # None would become NaN, and text would be read.
            for entry in array.flat:
                if not hasattr(entry, "__float__"):
                    raise TypeError(f"not {type(entry).__name__}")
        if np.ma.is_masked(values):
            raise ValueError("not masked")
        return array.astype(np.float64, copy=False)
    except TypeError as error:
        raise TypeError(f"{name} must be real numbers: {error}") from None
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{name} must be real numbers: {error}") from None


def common_batch(arrays: Sequence[NDArray[np.float64]]) -> tuple[int, ...]:
    """Shape of the batch that the leading axes broadcast to. Raises `ValueError`."""
    shapes = [array.shape[:-1] for array in arrays]
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError:
        raise ValueError(f"leading axes {shapes} do not broadcast") from None
