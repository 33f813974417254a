"""The fastest way along a course whose inputs are linear in acceleration and squared speed.

Between two nodes the acceleration along the course is constant, so that the squared speed grows
linearly. Limits hold at both ends of each interval (Pham and Pham, 2018: time-optimal path
parameterisation by reachability analysis): a pass backward finds the greatest squared speed from
which the end can still be reached, a pass forward takes the greatest acceleration that stays below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.simulator.plant.vehicle import Array

# No speed is greater: a length of the course per s.
_FASTEST = 1e6


@dataclass(frozen=True)
class Rows:
    """Limits `acceleration` · σ̈ + `square` · σ̇² ≤ `most` at nodes, each (nodes, rows).

    `most` is positive everywhere: whatever rests stays within the limits.
    """

    acceleration: Array
    square: Array
    most: Array


def fastest(lengths: Array, rows: Rows, ends: tuple[float, float]) -> Array:
    """The greatest squared speeds (s) at nodes at lengths (s), with at most `ends` at both ends."""
    steps = np.diff(lengths)
    count = len(lengths)
    reachable = np.empty(count)
    last = _greatest(rows.square[-1], rows.acceleration[-1], rows.most[-1])
    reachable[-1] = min(ends[1], last, _FASTEST**2)
    for k in reversed(range(count - 1)):
        square, acceleration, most = _interval(rows, k, steps[k], reachable[k + 1])
        reachable[k] = min(_greatest(square, acceleration, most), _FASTEST**2)
    squares = np.empty(count)
    squares[0] = min(ends[0], reachable[0])
    for k in range(count - 1):
        square, acceleration, most = _interval(rows, k, steps[k], reachable[k + 1])
        left = most - square * squares[k]
        up = acceleration > 0.0
        growth = np.min(left[up] / acceleration[up])
        squares[k + 1] = np.clip(squares[k] + 2.0 * steps[k] * growth, 0.0, reachable[k + 1])
    return squares


def _interval(rows: Rows, k: int, step: float, greatest: float) -> tuple[Array, Array, Array]:
    """Limits of the squared speed at node k and the acceleration after it.

    Coefficients of both, and right sides; `step` is the length to the next node, `greatest` its
    greatest squared speed.
    """
    ahead = rows.acceleration[k + 1] + 2.0 * step * rows.square[k + 1]
    return (
        np.concatenate([rows.square[k], rows.square[k + 1], [1.0, -1.0]]),
        np.concatenate([rows.acceleration[k], ahead, [2.0 * step, -2.0 * step]]),
        np.concatenate([rows.most[k], rows.most[k + 1], [greatest, 0.0]]),
    )


def _greatest(square: Array, acceleration: Array, most: Array) -> float:
    """The greatest b with square · b + acceleration · u ≤ most for some u; all `most` (rows) ≥ 0.

    Infinite if there is none.
    """
    up, down = acceleration > 0.0, acceleration < 0.0
    flat = ~up & ~down
    # u lies between what rows of both signs allow: each pair of them bounds b.
    weights_up, weights_down = acceleration[up][:, np.newaxis], -acceleration[down]
    slopes = square[up][:, np.newaxis] * weights_down + square[down] * weights_up
    bounds = most[up][:, np.newaxis] * weights_down + most[down] * weights_up
    slopes = np.concatenate([slopes.ravel(), square[flat]])
    bounds = np.concatenate([bounds.ravel(), most[flat]])
    limiting = slopes > 0.0
    return float(np.min(bounds[limiting] / slopes[limiting], initial=np.inf))
