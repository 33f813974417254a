"""Drawings with sliders in notebook 01: what they say is what the equations say, with no server."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import nbformat
import numpy as np
import pytest
from conftest import ROOT
from support.browser import visit
from support.notebook_cells import run_cells

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow
TANGENT, BOWL = "tangent-to-be-moved", "bowl-drawn"


@pytest.fixture(scope="module")
def cells() -> dict[str, tuple[Any, dict[str, Any]]]:
    notebook = nbformat.read(ROOT / "notebooks/01_gibbs_function.ipynb", as_version=4)
    return run_cells(notebook.cells, {TANGENT, BOWL})


def numbers(page: Page, key: str, attribute: str = "") -> list[float]:
    """Numbers in a text of a drawing, or in an attribute of a part of it."""
    part = page.locator(f".{key}")
    text = part.get_attribute(attribute) if attribute else part.text_content()
    words = str(text).replace("−", "-").replace("M", " ").replace("L", " ").split()
    found = [word.rstrip(",") for word in words]
    return [float(word) for word in found if word.lstrip("-").replace(".", "", 1).isdigit()]


def move(page: Page, *values: float) -> None:
    for slider, value in zip(page.locator("input").all(), values, strict=True):
        slider.evaluate(
            "(one, at) => { one.value = at; one.dispatchEvent(new Event('input')); }", value
        )


def open_drawing(cells: Any, name: str, folder: Path) -> Any:
    (folder / "page.html").write_text(f"<meta charset=utf8>{cells[name][0].data}", encoding="utf-8")
    return visit((folder / "page.html").as_uri())


def test_particle_and_its_slope_follow_the_sliders(cells: Any, tmp_path: Path) -> None:
    with open_drawing(cells, TANGENT, tmp_path) as seen:
        still = {key: numbers(seen.page, key, "d") for key in ("arrow", "slope", "line")}
        for acceleration, rate in ((1.0, 1.0), (-1.5, 0.5), (2.0, 0.0)):
            move(seen.page, acceleration, rate)
            assert numbers(seen.page, "said")[-1] == acceleration  # 1 kg, 1 m
            x, y, *tip = numbers(seen.page, "arrow", "d")
            drawn = np.array([tip[0] - x, y - tip[1]]) / 60.0
            along = np.array([123.0, 86.0]) / np.hypot(123.0, 86.0)
            across = np.array([-along[1], along[0]])
            assert np.allclose(drawn, acceleration * across - rate**2 * along, atol=0.01)
            # On the curve of S, 60 pixels for 1 rad/s² and 42 for 1 N m/s², and along it.
            at_x, at_y = numbers(seen.page, "dot", "cx") + numbers(seen.page, "dot", "cy")
            energy = (acceleration**2 + rate**4) / 2.0
            assert np.allclose([at_x, at_y], [560.0 + 60.0 * acceleration, 250.0 - 42.0 * energy])
            left, low, right, high = numbers(seen.page, "slope", "d")
            assert np.isclose((low - high) / 42.0 / ((right - left) / 60.0), acceleration)
            if (acceleration, rate) == (1.0, 1.0):  # Where the drawing stands without scripts.
                moved = {key: numbers(seen.page, key, "d") for key in still}
                assert all(np.allclose(still[key], moved[key], atol=1.0) for key in still)
        assert (seen.foreign, seen.faults) == ([], [])


def test_bars_of_the_bowl_are_what_is_missing_in_eq_4(cells: Any, tmp_path: Path) -> None:
    _, names = cells[BOWL]
    motion, torques, joints = names["motion"], names["torques"], names["joints"]

    def excess(accelerations: Any) -> float:
        at = names["state"](*accelerations)
        height = names["module"].gibbs(names["posture"], names["rates"], at)
        return float(height - torques @ accelerations)

    with open_drawing(cells, BOWL, tmp_path) as seen:
        for aside in (np.array([15.0, 0.0]), np.zeros(2), np.array([-20.0, 35.0])):
            still = numbers(seen.page, "said") + numbers(seen.page, "height")[:1]
            at = motion + aside
            move(seen.page, *at)
            needed = names["module"].inverse_dynamics(
                names["posture"], names["rates"], names["state"](*at)
            )[joints]
            shown = numbers(seen.page, "said")
            assert np.allclose(shown, needed - torques, atol=0.0051)
            (height,) = numbers(seen.page, "height")
            assert np.isclose(height, excess(at) - excess(motion), atol=0.051)
            if aside[0] == 15.0:
                assert np.allclose(still, [*shown, height], atol=1e-9)
        assert (seen.foreign, seen.faults) == ([], [])
