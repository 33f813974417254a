"""Drawings for teaching: every name can be read, and what they are drawn to show is true."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest
from ideas import IDEAS, books_sketch
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from sketches import chain_sketch, frames_sketch, link_sketch, pendulum_sketch, tangent_sketch
from support.names import assert_names_are_apart

SKETCHES = [link_sketch, tangent_sketch, pendulum_sketch, frames_sketch, chain_sketch, *IDEAS]


@pytest.mark.parametrize("draw", SKETCHES)
def test_no_name_hides_another_or_is_cut_off(draw: Callable[[], Figure]) -> None:
    assert_names_are_apart(draw(), smallest=10.0)


def test_the_sum_of_books_is_named() -> None:
    figure = books_sketch({1: (1, 2), 2: (3, 7)}, 9.0)
    assert_names_are_apart(figure, smallest=10.0)
    assert "9 kg" in [text.get_text() for text in figure.axes[-1].texts]


def vectors(figure: Figure, panel: int) -> list[np.ndarray]:
    """Straight arrows of a panel, from end to end, in its units."""
    marks = [text for text in figure.axes[panel].texts if isinstance(text, Annotation)]
    arrows = [mark for mark in marks if mark.arrow_patch is not None]
    return [np.subtract(arrow.xy, arrow.xyann) for arrow in arrows]


def test_accelerations_differ_by_the_tangent_of_the_path() -> None:
    figure = tangent_sketch()
    steps = np.diff(vectors(figure, 1), axis=0)
    tangent = vectors(figure, 0)[-1]
    assert len(steps) == 2
    for step in steps:
        assert np.isclose(np.cross([*step, 0.0], [*tangent, 0.0])[2], 0.0)
        assert step @ tangent > 0.0
    assert np.allclose(steps[0], steps[1])


def test_a_link_and_its_particle_make_a_triangle() -> None:
    drawn = vectors(link_sketch(), 0)
    assert any(
        np.allclose(a + b, c)
        for a, b in combinations(drawn, 2)
        for c in drawn
        if np.hypot(*c) > 3.0
    )
