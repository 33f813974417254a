"""Paths through points: exact, smooth, and never past a point at rest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose, assert_array_equal
from support.differences import rate

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.scenario.paths import Array, Velocity, Waypoints

TIMES = [1, 2, 4, 4.5, 7]
POINTS = [(0, 0, 1), (1, -2, 1), (3, 0, 4), (3, 1, 4), (0, 5, 0.5)]
CORNERS = Waypoints(TIMES, POINTS)
STEPS = st.lists(st.floats(0.2, 3.0), min_size=1, max_size=8)
SEEDS = st.integers(0, 2**32 - 1)


def chosen(steps: list[float], seed: int) -> tuple[Array, Array, list[Velocity]]:
    """Times, points of which some coordinates and some points are repeated, and velocities."""
    rng = np.random.default_rng(seed)
    times = np.concatenate([[-1.0], -1.0 + np.cumsum(steps)])
    points = rng.integers(-2, 3, size=(len(times), 3)) + rng.choice([0.0, 0.3], size=3)
    velocities: list[Velocity] = ["rest"]
    for k in range(1, len(times)):
        kinds: list[Velocity] = ["rest", "free", tuple(rng.normal(size=3))]
        given_ = kinds[rng.integers(3)]
        ends = k == len(times) - 1
        again = np.all(points[k] == points[k - 1]) or (
            not ends and np.all(points[k] == points[k + 1])
        )
        velocities.append("rest" if again or (ends and given_ == "free") else given_)
    return times, points, velocities


@pytest.mark.slow
@settings(max_examples=40)
@given(steps=STEPS, seed=SEEDS)
def test_points_and_velocities_are_exact_and_derivatives_those(
    steps: list[float], seed: int
) -> None:
    times, points, velocities = chosen(steps, seed)
    path = Waypoints(times.tolist(), points.tolist(), velocities)
    assert_allclose(path(times)[:, 0], points, atol=1e-9)
    for time, velocity in zip(times, velocities, strict=True):
        if velocity != "free":
            wanted = np.zeros((3, 3))
            wanted[0] = 0.0 if isinstance(velocity, str) else velocity
            assert_allclose(path(time)[1:], wanted, rtol=0, atol=1e-6)
    middle = (times[:-1] + times[1:]) / 2
    for order in range(3):
        found = rate(lambda t, k=order: path(t)[:, k], middle, step=0.005)
        exact = path(middle)[:, order + 1]
        assert_allclose(found, exact, rtol=1e-7, atol=1e-8 * np.abs(path(times)).max())


@pytest.mark.slow
@settings(max_examples=40)
@given(steps=STEPS, seed=SEEDS)
def test_four_derivatives_are_continuous(steps: list[float], seed: int) -> None:
    times, points, velocities = chosen(steps, seed)
    path = Waypoints(times.tolist(), points.tolist(), velocities)
    h = 1e-5
    for time in times:
        # The slope of the jerk from both sides; outside, the path has none.
        before, here, after = (path(time + by)[3] for by in (-h, 0.0, h))
        scale = max(np.abs(path(time + np.linspace(-0.2, 0.2, 9))[:, 3]).max(), 1.0)
        assert_allclose((here - before) / h, (after - here) / h, atol=0.3 * scale)


@pytest.mark.slow
@settings(max_examples=60)
@given(steps=STEPS, seed=SEEDS)
def test_no_coordinate_passes_a_point_at_rest(steps: list[float], seed: int) -> None:
    times, points, velocities = chosen(steps, seed)
    path = Waypoints(times.tolist(), points.tolist(), velocities)
    for k in range(len(steps)):
        inside = path(np.linspace(times[k], times[k + 1], 60))[:, 0]
        ends = velocities[k], velocities[k + 1]
        low, high = np.sort(points[k : k + 2], axis=0)
        for rest, free in ((0, 1), (1, 0)):
            if ends[rest] != "rest":
                continue
            at_rest, other = points[k + rest], points[k + free]
            if ends[free] == "rest":
                assert np.all((inside > low - 1e-9) & (inside < high + 1e-9))
            elif ends[free] == "free":
                side = np.sign(other - at_rest)
                assert np.all(side * (inside - at_rest) > -1e-9)
                assert_allclose(inside[:, side == 0], np.tile(at_rest[side == 0], (60, 1)))


def test_repeated_points_are_a_rest() -> None:
    path = Waypoints([0, 2, 3, 5], [(0, 0, 1), (1.5, 0, 1), (1.5, 0, 1), (0, 0, 1)])
    time = np.linspace(-1.0, 6.0, 1001)
    assert path(time)[:, 0, 0].max() == pytest.approx(1.5, abs=1e-12)
    assert_allclose(path(np.linspace(2.0, 3.0, 20)), path(2.5) * np.ones((20, 1, 1)), atol=1e-9)
    assert_array_equal(path(2.5), [(1.5, 0, 1), (0, 0, 0), (0, 0, 0), (0, 0, 0)])


def test_two_waypoints_have_the_smoothest_way() -> None:
    """Of degree 9, at rest to the snap at both ends: there is one, found here by its conditions."""
    start, end = np.array([1.0, 2.0, 3.0]), np.array([-4.0, 0.0, 3.5])
    begin, duration = 0.5, 7.0
    rows = [
        Polynomial.basis(k).deriv(n)(s) for s in (0.0, 1.0) for n in range(5) for k in range(10)
    ]
    share = Polynomial(np.linalg.solve(np.reshape(rows, (10, 10)), np.eye(10)[5]))
    time = begin + np.linspace(0.0, 1.0, 21) * duration
    path = Waypoints([begin, begin + duration], [start.tolist(), end.tolist()])
    for order in range(4):
        way = share.deriv(order)((time - begin) / duration) / duration**order
        wanted = way[:, np.newaxis] * (end - start) + (start if order == 0 else 0.0)
        assert_allclose(path(time)[:, order], wanted, rtol=0, atol=1e-9)


def test_free_points_lie_on_the_curve_of_least_jerk() -> None:
    """Between free points, what is left of the least integral of squared jerk: quintics."""
    points = np.random.default_rng(3).normal(size=(8, 3))
    path = Waypoints(list(range(8)), points.tolist())
    for k in range(1, 6):
        s = np.linspace(k, k + 1, 12)
        fitted = Polynomial.fit(s, path(s)[:, 0, 0], 5)
        assert_allclose(fitted(s), path(s)[:, 0, 0], atol=1e-10)


def test_a_path_may_begin_and_end_at_speed() -> None:
    path = Waypoints([0, 1, 2], [(0, 0, 0), (1, 0, 0), (2, 1, 0)], [(1, 0, 0), "free", (0, 2, 1)])
    before, after = path([-2.0, 4.0])
    assert_allclose(before, [(-2, 0, 0), (1, 0, 0), (0, 0, 0), (0, 0, 0)], atol=1e-12)
    assert_allclose(after, [(2, 5, 2), (0, 2, 1), (0, 0, 0), (0, 0, 0)], atol=1e-12)


def test_a_straight_way_at_one_speed_stays_straight() -> None:
    path = Waypoints([0, 1, 3], [(0, 0, 0), (1, 0, 2), (3, 0, 6)], [(1, 0, 2)] * 3)
    time = np.linspace(-1.0, 4.0, 50)
    assert_allclose(path(time)[:, 0], time[:, np.newaxis] * (1, 0, 2), atol=1e-12)


def test_they_pass_through_their_points_and_rest_before_and_after() -> None:
    assert_allclose(CORNERS(TIMES)[:, 0], POINTS, atol=1e-13)
    assert_allclose(CORNERS([1.0, 7.0])[:, 1:], 0.0, atol=1e-11)
    outside = CORNERS([-5.0, 0.9999999, 7.0000001, 100.0])
    assert_allclose(outside[:, 0], [(0, 0, 1)] * 2 + [(0, 5, 0.5)] * 2, atol=1e-13)
    assert_allclose(outside[:, 1:], 0.0, atol=1e-11)


@pytest.mark.parametrize(
    "times", [[0, 1, 1], [0, 2, 1], [1, 1, 1], [0, 0, 1], [0, 1], [0, 5e-324, 1], [0, np.nan, 1]]
)
def test_what_no_curve_joins_is_refused(times: list[float]) -> None:
    with pytest.raises(UsageError, match=r"no smooth curve|must be after|as many of both|finite"):
        Waypoints(times, [(0, 0, 0), (1, 0, 0), (2, 0, 0)])


@pytest.mark.parametrize(
    ("velocities", "words"),
    [
        (["rest", "free", "free", "free"], r"velocities\[3\]: the path ends here"),
        (["free", "free", "free", "rest"], r"velocities\[0\]: the path ends here"),
        (["rest", "free", (1, 0, 0), "rest"], r"velocities\[2\]: this point is repeated"),
        (
            ["rest", "reste", "free", "rest"],
            r"velocities\[1\]: must be one of 'rest', 'free', not 'reste'",
        ),
        (
            ["rest", (0, np.nan, 0), "free", "rest"],
            r"velocities\[1\]\[1\]: must be a finite number",
        ),
        (["rest", (0, 1), "free", "rest"], r"velocities\[1\]: must have 3 numbers, not 2"),
        (["rest", None, "free", "rest"], r"velocities\[1\]: must be a list of 3 numbers"),
        (["rest"], "1 velocities of 4 points; give as many of both"),
    ],
)
def test_velocities_that_points_do_not_allow_are_refused(
    velocities: list[Velocity], words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        Waypoints([0, 1, 2, 3], [(0, 0, 0), (1, 0, 0), (1, 0, 0), (2, 0, 0)], velocities)


def test_arrays_serve_as_well_as_lists() -> None:
    wanted: list[Velocity] = ["rest", (1.0, 0.0, 0.5), "free", "free", "rest"]
    arrays = [word if isinstance(word, str) else np.array(word) for word in wanted]
    path = Waypoints(np.array(TIMES).tolist(), np.array(POINTS).tolist(), arrays)
    time = np.linspace(0.0, 8.0, 50)
    assert_array_equal(path(time), Waypoints(TIMES, POINTS, wanted)(time))
    assert hash(path) == hash(Waypoints(TIMES, POINTS, wanted))


@pytest.mark.parametrize("points", [[(0, 0), (1, 0)], [(0, 0, 0), (1, np.nan, 0)], ["a", "b"], []])
def test_points_that_are_none_are_refused(points: list[tuple[float, ...]]) -> None:
    with pytest.raises(UsageError, match=r"Waypoints\.points"):
        Waypoints([0, 1], points)
