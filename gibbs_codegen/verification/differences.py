"""Derivatives by central differences of eighth order."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gibbs_codegen.verification.vectors import Array

# Where things change by their size in a unit, rounding of 1e-16/h meets a truncation of some h⁸.
STEP = 1e-2
_AHEAD = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
WEIGHTS = (*((-number, -weight) for number, weight in _AHEAD), *_AHEAD)
# Exact for what is quadratic, with steps of any length.
QUADRATIC = ((-1, -1 / 2), (1, 1 / 2))


def derivative(function: Callable[[Array], Array], steps: Array) -> Array:
    """Derivative (s, …) at time 0 of a function of times (s, 1), with steps (s,)."""
    values = [weight * function(number * steps[:, None]) for number, weight in WEIGHTS]
    total = sum(values[1:], values[0])
    rate: Array = total / steps.reshape(-1, *[1] * (total.ndim - 1))
    return rate


def gradient(
    function: Callable[[Array], Array],
    steps: Array,
    axis: int,
    weights: Sequence[tuple[int, float]] = WEIGHTS,
) -> Array:
    """Derivatives of a function by each of its arguments, where these are 0; their axis is last.

    The function takes (m, m), a row for each argument that is not 0, and returns (…, m, …), where
    `axis` is that of the rows. `steps` (m,) are the arguments' steps; `weights` are numbers of
    steps, and what multiplies the function there.
    """
    moves = np.diag(steps)
    values = [weight * function(number * moves) for number, weight in weights]
    slopes: Array = np.moveaxis(sum(values[1:], values[0]), axis, -1) / steps
    return slopes
