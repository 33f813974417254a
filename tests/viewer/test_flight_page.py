"""The page of a flight, opened in headless Chromium."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from support.browser import Visit, visit
from support.synthetic_flight import synthetic_flight

import gibbs_codegen
from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.figures.style import COLOURS
from gibbs_codegen.viewer import flight_page
from gibbs_codegen.viewer.batch import rgb

Pixels = NDArray[np.int_]


def pixels(seen: Visit) -> Pixels:
    """What the page shows: red, green and blue (h, w, 3)."""
    picture = Image.open(io.BytesIO(seen.page.locator("canvas").first.screenshot()))
    return np.array(picture.convert("RGB")).astype(int)


def count(picture: Pixels, colour: str) -> int:
    """Number of pixels of about that colour."""
    return int(np.sum(np.abs(picture - rgb(colour)).max(axis=-1) < 24))


def test_a_page_plays_a_flight_and_asks_for_nothing(
    shipped: Callable[[str], ModuleType], tmp_path: Path
) -> None:
    page = gibbs_codegen.view_html(synthetic_flight(shipped("hexarotor_3link"), samples=200))
    page.save(tmp_path / "flight.html")
    assert (tmp_path / "flight.html").stat().st_size < 2_000_000
    with visit((tmp_path / "flight.html").as_uri(), 900, 560) as seen:
        seen.page.wait_for_selector("canvas")
        seen.page.wait_for_function("document.querySelector('input')?.value > 0.5")
        first = pixels(seen)
        seen.page.wait_for_timeout(1500)
        then = pixels(seen)
        key = seen.page.locator("#key").inner_text()
        assert (seen.foreign, seen.faults) == ([], [])
    # The paths of base centre and tip stand still, and the robot moves.
    for picture in (first, then):
        assert count(picture, COLOURS[0]) > 300
        assert count(picture, COLOURS[1]) > 300
    assert np.mean(np.abs(first - then).max(axis=-1) > 30) > 0.002
    assert "synthetic" in key
    assert "path of the tip" in key


def test_a_long_flight_has_fewer_frames_rather_than_more_room(
    shipped: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = synthetic_flight(shipped("hexarotor_3link"), samples=2000, duration=400.0)
    whole = len(gibbs_codegen.view_html(flight).text)
    monkeypatch.setattr(flight_page, "_ROOM", whole - 40_000)
    assert whole - 200_000 < len(gibbs_codegen.view_html(flight).text) <= whole - 40_000


def test_what_cannot_be_drawn_or_written_is_told(
    shipped: Callable[[str], ModuleType], tmp_path: Path
) -> None:
    flight = synthetic_flight(shipped("hexarotor_3link"), samples=3)
    page = gibbs_codegen.view_html(flight)
    (tmp_path / "taken").mkdir()
    with pytest.raises(OutputError, match="taken: cannot be written"):
        page.save(tmp_path / "taken")
    assert not list((tmp_path / "taken").iterdir())
    nowhere = dataclasses.replace(flight, positions=np.full_like(flight.positions, np.nan))
    with pytest.raises(UsageError, match="no sample that can be drawn"):
        gibbs_codegen.view_html(nowhere)
    with pytest.raises(UsageError, match="is not a flight"):
        gibbs_codegen.view_html(tmp_path / "taken")
