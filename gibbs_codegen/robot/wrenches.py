"""Directions of wrenches on the base in words, for messages and reports."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

# Components of a wrench, force rows first.
DIRECTIONS = (
    "force along x",
    "force along y",
    "force along z",
    "torque about x",
    "torque about y",
    "torque about z",
)


def directions(basis: NDArray[np.float64], names: Sequence[str] = DIRECTIONS) -> tuple[str, ...]:
    """Directions, such as "force along x", of the columns of `basis` (m, k), or sums of such.

    The m components have `names`; wrenches have force first.
    """
    rest, pivots = basis.T.copy(), []
    for _ in rest:
        pivots.append(int(np.argmax(np.linalg.norm(rest, axis=0))))
        axis = rest[:, pivots[-1]] / np.linalg.norm(rest[:, pivots[-1]])
        rest -= np.outer(axis, axis @ rest)
    # Reduced so that each direction has a component of its own, and is that alone if it can be.
    reduced = basis @ np.linalg.inv(basis[sorted(pivots)])
    return tuple(_in_words(direction, names) for direction in reduced.T)


def _in_words(direction: NDArray[np.float64], names: Sequence[str]) -> str:
    parts: list[str] = []
    for component, name in zip(direction, names, strict=True):
        if abs(component) > 1e-6:
            factor = "" if abs(abs(component) - 1.0) < 1e-6 else f"{abs(component):.3g} × "
            sign = ("− " if component < 0 else "+ ") if parts else ("−" if component < 0 else "")
            parts.append(f"{sign}{factor}{name}")
    return " ".join(parts)
