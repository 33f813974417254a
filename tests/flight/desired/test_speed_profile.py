"""The fastest motion along a path: analytic optima, and a linear program as another way."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from gibbs_codegen.flight.desired.timing import Rows, greatest_squares
from gibbs_codegen.flight.plant.vehicle import Array


def duration(lengths: Array, squares: Array) -> float:
    speeds = np.sqrt(squares)
    return float(np.sum(2.0 * np.diff(lengths) / (speeds[1:] + speeds[:-1])))


def rows(lengths: Array, *each: tuple[float, float, float]) -> Rows:
    """The same limits (acceleration, square, most) at all nodes."""
    tiled = np.tile(np.transpose(each)[:, np.newaxis], (1, len(lengths), 1))
    return Rows(*tiled)


@pytest.mark.parametrize(("up", "down"), [(1.0, 1.0), (4.0, 0.5)])
def test_a_double_integrator_switches_once(up: float, down: float) -> None:
    lengths = np.linspace(0.0, 3.0, 901)
    squares = greatest_squares(
        lengths, rows(lengths, (1.0, 0.0, up), (-1.0, 0.0, down)), (0.0, 0.0)
    )
    # Half of v t at the greatest speed v, with v² = 2 L up down / (up + down).
    assert duration(lengths, squares) == pytest.approx(
        np.sqrt(2.0 * 3.0 * (1.0 / up + 1.0 / down)), rel=1e-5
    )


def test_a_limit_of_speed_makes_a_trapezoid() -> None:
    lengths = np.linspace(0.0, 5.0, 1001)
    limits = rows(lengths, (1.0, 0.0, 2.0), (-1.0, 0.0, 2.0), (0.0, 1.0, 1.5**2))
    squares = greatest_squares(lengths, limits, (0.0, 0.0))
    assert duration(lengths, squares) == pytest.approx(5.0 / 1.5 + 1.5 / 2.0, rel=1e-5)
    assert squares.max() == pytest.approx(1.5**2, rel=1e-12)


def test_ends_at_speed_are_kept_where_they_can_be() -> None:
    lengths = np.linspace(0.0, 1.0, 501)
    both = rows(lengths, (1.0, 0.0, 1.0), (-1.0, 0.0, 1.0))
    squares = greatest_squares(lengths, both, (4.0, 1.0))
    # 1 m is too short to brake from 2 m/s to 1 m/s at 1 m/s²: it begins slower.
    assert squares[[0, -1]] == pytest.approx([3.0, 1.0])


@pytest.mark.parametrize("seed", range(6))
def test_no_linear_program_finds_greater_speeds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count, each = 60, 5
    lengths = np.cumsum(rng.uniform(0.5, 1.5, count)) / count
    place = lengths[:, np.newaxis]
    waves = [
        np.sin(3.0 * place * rng.uniform(0.3, 1.0, each) + rng.uniform(0, 6, each))
        for _ in range(2)
    ]
    signs = np.concatenate([np.ones(each), -np.ones(each)])
    acceleration, square = (np.concatenate([w, w], axis=1) * signs for w in waves)
    most = 1.0 + 0.5 * np.sin(place + np.arange(2 * each))
    limits = Rows(acceleration, square, most)
    squares = greatest_squares(lengths, limits, (0.2, 0.1))
    # b_k + 2 Δ u = b_(k + 1), limits at both ends of every interval.
    matrix, right = [], []
    for k, step in enumerate(np.diff(lengths)):
        for node in (k, k + 1):
            for row in range(2 * each):
                line = np.zeros(count)
                line[[k, k + 1]] = np.array([-1.0, 1.0]) * acceleration[node, row] / (2 * step)
                line[node] += square[node, row]
                matrix.append(line)
                right.append(most[node, row])
    bounds = [(0.0, None)] * count
    bounds[0], bounds[-1] = (0.0, 0.2), (0.0, 0.1)
    slack = np.array(matrix) @ squares - right
    assert slack.max() < 1e-9
    best = linprog(-np.ones(count), matrix, right, bounds=bounds)
    assert best.success
    assert squares.sum() == pytest.approx(best.x.sum(), rel=1e-6)
