"""Paths: derivatives against differences, and what each kind of path promises."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose, assert_array_equal
from support.differences import rate

from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.paths import (
    Array,
    Circle,
    Fixed,
    Harmonic,
    Line,
    Path,
    Sum,
    Term,
    Waypoints,
)

SPIRAL = Harmonic(
    x=(Term(2.0, -0.05, 1.0), Term(0.3, 0.0, 2.5, 0.7)), y=(Term(1.0, 0.2),), z=(Term(-1.5),)
)
CORNERS = Waypoints([1, 2, 4, 4.5, 7], [(0, 0, 1), (1, -2, 1), (3, 0, 4), (3, 1, 4), (0, 5, 0.5)])
PATHS: dict[str, Path] = {
    "fixed": Fixed((1.0, -2.0, 3.0)),
    "harmonic": SPIRAL,
    "line": Line((1, 2, 3), (-4, 0, 3.5), duration=7.0, begin=0.5),
    "circle": Circle((1, 2, 3), 1.5, -6.0, normal=(1, -2, 0.5), phase=0.4),
    "waypoints": CORNERS,
    "sum": Sum((SPIRAL, Circle((0, 0, 0), 0.5, 3.0), Fixed((0, 0, 1)))),
}
# Between the times at which the fourth derivative of some of them jumps.
SMOOTH = np.array([1.3, 1.5, 1.71, 2.2, 3.0, 3.3, 3.8, 4.2, 4.3, 5.0, 5.5, 6.6])

numbers = st.floats(-3.0, 3.0)
vectors = st.tuples(numbers, numbers, numbers)
terms = st.lists(
    st.builds(Term, numbers, st.floats(-0.5, 0.5), st.floats(-4.0, 4.0), numbers), max_size=3
).map(tuple)
normals = vectors.filter(lambda n: np.linalg.norm(n) > 0.1)
periods = st.floats(1.5, 20.0) | st.floats(-20.0, -1.5)
moving = (
    st.builds(Harmonic, terms, terms, terms)
    | st.builds(Circle, vectors, st.floats(0.0, 4.0), periods, normals, numbers)
    | st.builds(Line, vectors, vectors, st.floats(7.0, 9.0), st.just(0.5))
)


def assert_derivatives(path: Path, time: Array) -> None:
    exact = path(time)
    for order in range(3):
        found = rate(lambda t, k=order: path(t)[:, k], time)
        assert_allclose(found, exact[:, order + 1], rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("kind", PATHS)
def test_derivatives(kind: str) -> None:
    assert_derivatives(PATHS[kind], SMOOTH)


@pytest.mark.slow
@settings(max_examples=60)
@given(path=moving)
def test_derivatives_of_any(path: Path) -> None:
    assert_derivatives(path, SMOOTH)


@pytest.mark.parametrize("kind", PATHS)
@pytest.mark.parametrize("shape", [(), (0,), (1,), (5,), (2, 3), (2, 1, 2)])
def test_times_of_any_shape(kind: str, shape: tuple[int, ...]) -> None:
    # From before the beginning of some of them to after their end.
    time = np.linspace(-1.0, 9.0, int(np.prod(shape))).reshape(shape)
    found = PATHS[kind](time)
    assert found.shape == (*shape, 4, 3)
    for place in np.ndindex(shape):
        alone = PATHS[kind](float(time[place]))
        assert_allclose(found[place], alone, rtol=1e-13, atol=1e-13)


def test_equations_20_and_21() -> None:
    paper = read_scenario("paper")
    t = np.linspace(0.0, 4.0 * np.pi, 301)
    decay, cos, sin = np.exp(-0.05 * t), np.cos(t), np.sin(t)
    assert paper.duration == pytest.approx(4.0 * np.pi, rel=1e-15)
    assert paper.arm.tip is not None
    base, tip = paper.base(t), paper.arm.tip(t)
    equation_20 = [2 * decay * cos, 2 * decay * sin, np.exp(0.1 * t)]
    equation_21 = [-2 * np.cos(np.pi / 2 + t), np.full_like(t, -2.0), -2 * np.sin(2 * t)]
    assert_allclose(base[:, 0], np.stack(equation_20, axis=1), rtol=0, atol=1e-14)
    assert_allclose(tip[:, 0], np.stack(equation_21, axis=1), rtol=0, atol=1e-14)
    # Their first derivatives, by hand as well.
    speed_20 = [-2 * decay * (0.05 * cos + sin), 2 * decay * (cos - 0.05 * sin)]
    speed_21 = [2 * np.sin(np.pi / 2 + t), np.zeros_like(t), -4 * np.cos(2 * t)]
    assert_allclose(base[:, 1, :2], np.stack(speed_20, axis=1), rtol=0, atol=1e-14)
    assert_allclose(base[:, 1, 2], 0.1 * np.exp(0.1 * t), rtol=1e-14)
    assert_allclose(tip[:, 1], np.stack(speed_21, axis=1), rtol=0, atol=1e-14)


def test_fixed_stays() -> None:
    assert_array_equal(Fixed((1, 2, 3))([0.0, 1e6])[:, 0], [(1, 2, 3)] * 2)
    assert not Fixed((1, 2, 3))([0.0, 1e6])[:, 1:].any()


def test_harmonic_without_terms_is_at_the_origin() -> None:
    assert_array_equal(Harmonic()(np.linspace(0, 1, 3)), np.zeros((3, 4, 3)))


def test_line_is_at_rest_at_both_ends_and_straight() -> None:
    start, end = np.array([1.0, 2.0, 3.0]), np.array([-4.0, 0.0, 3.5])
    line = Line(tuple(start), tuple(end), duration=7.0, begin=0.5)
    before, after = line([-100.0, 0.0, 0.5]), line([7.5, 8.0, 1e9])
    assert_array_equal(before[:, 0], [start] * 3)
    assert_allclose(after[:, 0], [end] * 3, rtol=0, atol=1e-15)
    assert not before[:, 1:3].any()
    assert_allclose(after[:, 1:3], 0.0, rtol=0, atol=1e-15)
    assert not after[1:, 3].any()
    assert_allclose(line(4.0)[0], (start + end) / 2)
    way = line(np.linspace(0.5, 7.5, 50))[:, 0] - start
    assert_allclose(np.cross(way, end - start), 0.0, atol=1e-13)
    assert np.all(np.diff(way @ (end - start)) > 0.0)


@settings(max_examples=30)
@given(coefficients=st.lists(st.floats(-5, 5), min_size=1, max_size=4))
def test_line_has_the_least_integral_of_squared_jerk(coefficients: list[float]) -> None:
    duration = 2.5
    line = Line((0, 0, 0), (3, 0, 0), duration)
    points, weights = np.polynomial.legendre.leggauss(20)
    time = (points + 1.0) / 2.0 * duration
    jerk = line(time)[:, 3, 0]
    # What starts and ends at rest as well: s³(1 − s)³ times anything.
    s = Polynomial([0.0, 1.0 / duration])
    other = (s**3 * (1 - s) ** 3 * Polynomial(coefficients)).deriv(3)(time)
    assert weights @ (jerk * other) == pytest.approx(0.0, abs=1e-9)
    assert weights @ (jerk + other) ** 2 >= weights @ jerk**2 - 1e-9


@pytest.mark.slow
@settings(max_examples=50)
@given(
    centre=vectors,
    radius=st.floats(0.1, 4.0),
    period=periods,
    normal=normals,
    phase=st.floats(-7, 7),
)
def test_circle(
    centre: tuple[float, float, float],
    radius: float,
    period: float,
    normal: tuple[float, float, float],
    phase: float,
) -> None:
    circle = Circle(centre, radius, period, normal, phase)
    time = np.linspace(-3.0, 10.0, 40)
    place, speed = (circle(time)[:, order] for order in (0, 1))
    outwards = place - centre
    axis = np.array(normal) / np.linalg.norm(normal)
    assert_allclose(np.linalg.norm(outwards, axis=1), radius)
    assert_allclose(outwards @ axis, 0.0, atol=1e-12)
    # Anticlockwise about the normal, once a period: v = ω × r, which has the period's sign.
    assert_allclose(speed, np.cross(2 * np.pi / period * axis, outwards), atol=1e-12)
    assert_allclose(circle(time + period), circle(time), rtol=1e-9, atol=1e-9)


def test_circle_begins_along_x_or_y() -> None:
    assert_allclose(Circle((1, 2, 3), 2.0, 8.0)(0.0)[0], (3, 2, 3))
    assert_allclose(Circle((1, 2, 3), 2.0, 8.0)(2.0)[0], (1, 4, 3))
    assert_allclose(Circle((1, 2, 3), 2.0, -8.0)(2.0)[0], (1, 0, 3))
    assert_allclose(Circle((1, 2, 3), 2.0, 8.0, phase=np.pi / 2)(0.0)[0], (1, 4, 3))
    about_x = Circle((0, 0, 0), 2.0, 8.0, normal=(5, 0, 0))
    assert_allclose(about_x([0.0, 2.0])[:, 0], [(0, 2, 0), (0, 0, 2)], atol=1e-15)
    # On a slope the projection of X: steeper, but straight ahead.
    slope = Circle((0, 0, 0), 1.0, 8.0, normal=(-1, 0, 1))
    assert_allclose(slope(0.0)[0], np.array([1, 0, 1]) / np.sqrt(2))


@pytest.mark.parametrize("scale", [1e-8, 1e11])
def test_the_length_of_a_normal_does_not_matter(scale: float) -> None:
    scaled = Circle((0, 0, 0), 1.0, 2.0, normal=(scale, 2 * scale, -scale))
    assert_allclose(scaled(0.3), Circle((0, 0, 0), 1.0, 2.0, normal=(1, 2, -1))(0.3), rtol=1e-13)


def test_a_sum_adds_all_derivatives() -> None:
    time = np.linspace(0.0, 9.0, 20)
    total = Sum((CORNERS, SPIRAL))(time)
    assert_allclose(total, CORNERS(time) + SPIRAL(time))


@pytest.mark.parametrize(
    "path",
    [
        Harmonic(x=(Term(1.0, growth=1e12),)),
        Harmonic(x=(Term(1e12, growth=1.0, frequency=1e12),)),
        Waypoints([0.0, 1e-200], [(0, 0, 0), (1, 0, 0)]),
    ],
)
def test_what_overflows_is_not_finite_and_warns_of_nothing(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not np.all(np.isfinite(path(np.linspace(0.0, 1e3, 7))))
