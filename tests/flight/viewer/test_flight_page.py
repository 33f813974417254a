"""The page of a flight, opened in headless Chromium."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from support.browser import visit
from support.pixels import count, differing, pixels
from support.synthetic_flight import synthetic_flight

import gibbs_codegen
from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.figures.appearance import COLOURS
from gibbs_codegen.flight.viewer import page as viewer_page
from gibbs_codegen.flight.viewer.flight_view import FlightScene
from gibbs_codegen.flight.viewer.machine import RELAXED, rgb
from gibbs_codegen.flight.viewer.page import empty_server
from gibbs_codegen.flight.viewer.view import viewing

Shipped = Callable[[str], ModuleType]


@pytest.mark.slow
def test_a_page_plays_a_flight_and_asks_for_nothing(shipped: Shipped, tmp_path: Path) -> None:
    page = gibbs_codegen.view_html(synthetic_flight(shipped("hexarotor_3link"), samples=200))
    page.save(tmp_path / "flight.html")
    assert (tmp_path / "flight.html").stat().st_size < 2_000_000
    with visit((tmp_path / "flight.html").as_uri(), 600, 400) as seen:
        pictures, time = [], "parseFloat(document.querySelector('input')?.value)"
        reached = f"{time} > 0.5"
        for _ in range(2):
            seen.page.wait_for_function(reached)
            seen.page.keyboard.press("Space")
            pictures.append(pixels(seen.page))
            # From where it stands, since a busy machine is late to stop it.
            reached = f"Math.abs({time} - {seen.page.evaluate(time)}) > 1"
            seen.page.keyboard.press("Space")
        key = seen.page.locator("#key").inner_text()
        assert (seen.foreign, seen.faults) == ([], [])
    # The paths of base centre and tip stand still, and the robot moves.
    for picture in pictures:
        assert count(picture, COLOURS[0]) > 100
        assert count(picture, COLOURS[1]) > 100
    # It is thin, and is 600 pixels wide with all of its paths.
    assert differing(*pictures) > 0.0005
    assert "synthetic" in key
    assert "path of the tip" in key


@pytest.mark.parametrize(("torque", "shown"), [(1e-8, False), (1e-2, True)])
def test_torques_that_rounding_leaves_are_no_load(
    torque: float, shown: bool, shipped: Shipped
) -> None:
    flight = synthetic_flight(shipped("hexarotor_3link"), samples=5)
    applied = flight.applied.copy()
    applied[:, flight.rotors :] *= torque / 15.0
    held = torque * flight.constraint_torques
    flight = dataclasses.replace(flight, applied=applied, constraint_torques=held)
    with empty_server() as server:
        scene = FlightScene(server, flight, frames=0)
        scene.show(3)
        colours = scene.machine.rods.node.batched_colors
    assert (colours != rgb(RELAXED)).any() == shown
    assert any("at a joint" in words for _, words in scene.key()) == shown


def test_what_cannot_be_drawn_or_written_is_told(shipped: Shipped, tmp_path: Path) -> None:
    flight = synthetic_flight(shipped("hexarotor_3link"), samples=3)
    page = gibbs_codegen.view_html(flight)
    (tmp_path / "taken").mkdir()
    with pytest.raises(OutputError, match="taken: cannot be written"):
        page.save(tmp_path / "taken")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]
    nowhere = dataclasses.replace(flight, positions=np.full_like(flight.positions, np.nan))
    with pytest.raises(UsageError, match="no sample can be drawn"):
        gibbs_codegen.view_html(nowhere)
    with pytest.raises(UsageError, match="no sample can be drawn"), viewing(nowhere, 8450):
        pass
    (tmp_path / "no.npz").write_text("no")
    with pytest.raises(UsageError, match="is not a saved flight"):
        gibbs_codegen.view_html(tmp_path / "no.npz")


def test_a_flight_that_ends_nowhere_is_shown_until_then(shipped: Shipped) -> None:
    flight = synthetic_flight(shipped("hexarotor_3link"), samples=20)
    positions = flight.positions.copy()
    positions[15:] = np.nan
    ended = gibbs_codegen.view_html(dataclasses.replace(flight, positions=positions))
    assert len(ended.text) < len(gibbs_codegen.view_html(flight).text)


def test_a_flight_without_a_desired_path_is_shown_without_one(shipped: Shipped) -> None:
    flight = synthetic_flight(shipped("hexarotor_3link"), samples=3)
    nowhere = np.full_like(flight.centre_desired, np.nan)
    without = dataclasses.replace(flight, centre_desired=nowhere)
    assert gibbs_codegen.view_html(without).size < gibbs_codegen.view_html(flight).size


def test_the_room_of_a_page_is_in_bytes() -> None:
    assert viewer_page.ViewPage("λ", "λλ").size == 4
