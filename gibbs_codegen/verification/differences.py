"""Derivatives by central differences of fourth order."""

from __future__ import annotations

from collections.abc import Callable

from gibbs_codegen.verification.vectors import Array

# Where things change by their size in a unit, rounding of 1e-16/h meets a truncation of some h⁴.
STEP = 1e-3
WEIGHTS = ((-2, 1 / 12), (-1, -8 / 12), (1, 8 / 12), (2, -1 / 12))


def derivative(function: Callable[[Array], Array], steps: Array) -> Array:
    """Derivative of a function of time, at time 0.

    Args:
        function: Takes times (s, 1), one for each state, and returns (s, …).
        steps: The step of time for each state, (s,).

    Returns:
        The derivative, (s, …).
    """
    values = [weight * function(number * steps[:, None]) for number, weight in WEIGHTS]
    total = sum(values[1:], values[0])
    rate: Array = total / steps.reshape(-1, *[1] * (total.ndim - 1))
    return rate
