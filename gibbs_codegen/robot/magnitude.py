"""Sizes of numbers that can be computed with."""

from __future__ import annotations

# Squares, and products of a few, are far from overflow and underflow.
LEAST, MOST = 1e-50, 1e50


def size_fault(value: float) -> str | None:
    """Why a number of a robot cannot be computed with.

    Args:
        value: The number, finite, in its SI unit.

    Returns:
        What is wrong, or None if nothing is.
    """
    if value == 0.0 or LEAST <= abs(value) <= MOST:
        return None
    what = "overflow" if abs(value) > MOST else "vanish"
    return f"must be 0 or from {LEAST:g} to {MOST:g} in size, not {value:g}, whose products {what}"
