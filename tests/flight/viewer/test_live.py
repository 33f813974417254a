"""Robots and flights live, in headless Chromium, as their controls are moved."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import pytest
from support.browser import Visit, visit
from support.pixels import moved_from, still
from support.synthetic_flight import synthetic_flight

from gibbs_codegen.flight.viewer.view import Viewed, viewing

if TYPE_CHECKING:
    from playwright.sync_api import Locator

Shipped = Callable[[str], ModuleType]


@contextmanager
def shown(what: Viewed) -> Iterator[Visit]:
    """The live page of something, which follows its controls while it is open."""
    with viewing(what, 8400) as (panel, place):
        ended = threading.Event()

        def follow() -> None:
            while not ended.is_set():
                panel.step()
                time.sleep(0.03)

        follower = threading.Thread(target=follow)
        follower.start()
        try:
            with visit(place, 1100, 500) as seen:
                yield seen
                assert (seen.foreign, seen.faults) == ([], [])
        finally:
            ended.set()
            follower.join()


def box(seen: Visit, label: str) -> Locator:
    """The box of the number beside a slider."""
    return (
        seen.page.locator("label")
        .get_by_text(label, exact=True)
        .locator("xpath=../../..")
        .locator("input")
        .last
    )


@pytest.mark.slow
def test_a_slider_moves_the_robot_and_lights_what_changed(shipped: Shipped) -> None:
    from playwright.sync_api import expect

    with shown(shipped("hexarotor_3link")) as seen:
        page = seen.page
        expect(page.get_by_text("The inputs hold the robot still.")).to_be_visible()
        before = still(page)
        lit = page.locator("svg path.lit")
        expect(lit).to_have_attribute("d", "")
        box(seen, "theta_9, rad").fill("1.5")
        page.keyboard.press("Enter")
        expect(lit).to_have_attribute("d", re.compile("M.*M"))
        moved_from(page, before, 0.0005)
        page.get_by_text("Back to the first posture").click()
        expect(box(seen, "theta_9, rad")).not_to_have_value("1.5")
        box(seen, "F_1, N").fill("0")
        page.keyboard.press("Enter")
        told = "With these inputs the robot accelerates."
        expect(page.get_by_text(told)).to_be_visible()


@pytest.mark.slow
def test_a_flight_goes_to_the_time_that_is_asked_for(shipped: Shipped, tmp_path: Path) -> None:
    flight = synthetic_flight(shipped("hexarotor_3link"))
    flight.write_npz(tmp_path / "flight.npz")
    with shown(tmp_path) as seen:
        page = seen.page
        page.get_by_text("hexarotor_3link, synthetic").wait_for()
        page.get_by_role("checkbox").first.uncheck()
        picture = still(page)
        for moment in ("3", "5"):
            box(seen, "time, s").fill(moment)
            page.keyboard.press("Enter")
            picture = moved_from(page, picture, 0.0005)
        assert "tip off by" in page.inner_text("body")
