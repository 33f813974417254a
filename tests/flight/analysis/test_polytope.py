"""Polytopes of supports are those of all their points."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from support.differences import Array

from gibbs_codegen.robot.reach import Polytope, polytope


def of_points(points: Array) -> Polytope:
    return polytope(lambda direction: points[np.argmax(points @ direction)], points.shape[1])


def test_a_cube_has_eight_corners_and_six_faces() -> None:
    corners = np.array(list(itertools.product((1.0, 3.0), (-2.0, 0.0), (5.0, 6.0))))
    found = of_points(corners)
    assert {tuple(v) for v in found.vertices} == {tuple(c) for c in corners}
    assert found.normals.shape == (6, 3)
    assert found.contains(np.array([2.0, -1.0, 5.5]))
    assert not found.contains(np.array([2.0, -1.0, 6.1]))


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 5))
def test_nothing_of_a_hull_is_left_out(seed: int, size: int) -> None:
    points = np.random.default_rng(seed).normal(size=(30, size))
    found = of_points(points)
    vertices = points[ConvexHull(points).vertices]
    assert {tuple(v) for v in found.vertices} == {tuple(v) for v in vertices}
    assert all(found.contains(point) for point in points)


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_flat_sets_are_polytopes_of_their_own_dimension(rank: int) -> None:
    rng = np.random.default_rng(rank)
    plane = rng.normal(size=(rank, 4))
    points = 2.0 + rng.normal(size=(40, rank)) @ plane
    found = of_points(points)
    assert found.basis.shape == (4, rank)
    assert all(found.contains(point) for point in points)
    middle = points.mean(axis=0)
    assert found.contains(middle)
    aside = np.linalg.svd(plane)[2][-1]
    assert not found.contains(middle + 1e-3 * aside)
    if rank:
        assert not found.contains(middle + 100.0 * plane[0])
