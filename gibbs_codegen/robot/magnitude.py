"""Sizes of numbers that can be computed with."""

from __future__ import annotations

# Squares, and products of a few, are far from overflow and underflow.
LEAST, MOST = 1e-50, 1e50


def size_fault(value: float) -> str | None:
    """Why a finite number of a robot, in its SI unit, cannot be computed with; None if it can."""
    if value == 0.0 or LEAST <= abs(value) <= MOST:
        return None
    what = "overflow" if abs(value) > MOST else "vanish"
    return f"must be 0 or from {LEAST:g} to {MOST:g} in size, not {value:g}, whose products {what}"
