"""The page on which a robot flies, in Chromium: it is dragged, loaded and touched."""

from __future__ import annotations

import base64
import gzip
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from support.browser import Visit, visit
from support.pages import run_python
from support.tools import missing

from gibbs_codegen import load
from gibbs_codegen.cli.app import main
from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.shipped import text_of
from gibbs_codegen.flight.viewer.fly import fly_html
from gibbs_codegen.runtime import web

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow
ROBOT = "quadrotor_arm_2link"
KINDS = ("hexarotor_3link", "hextilt_flying_arm_5", "ur5e", "rover_arm", "cart_pole")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    try:
        web.compiler()
    except UsageError as error:
        missing(str(error))
    place = tmp_path_factory.mktemp("page") / "robot.html"
    assert main(["fly", ROBOT, "--html", str(place)]) == 0
    return place


def away(page: Page, seconds: float = 9.0) -> list[float]:
    """How far each handle is from its target after a time, m; the clock is the flight's."""
    found: list[float] = page.evaluate(
        """(steps) => {
          flight.advance(steps); flight.look();
          const off = (k) => flight.handle(k).map((x, i) => x - flight.ghost(k)[i]);
          return flight.R.handles.map((_, k) => Math.hypot(...off(k)));
        }""",
        round(1e3 * seconds),
    )
    return found


def handle(page: Page, number: int) -> tuple[float, float]:
    """Where the target of a handle is on the page, in pixels."""
    x, y, *_ = page.evaluate(f"flight.project(flight.ghost({number}))")
    return x, y


def load_base(page: Page, factor: float) -> None:
    page.locator("#masses input").first.evaluate(
        "(slider, x) => { slider.value = x; slider.dispatchEvent(new Event('input')); }", factor
    )


def quiet(seen: Visit) -> bool:
    return (seen.foreign, seen.faults) == ([], [])


def test_targets_are_reached_and_unknown_masses_are_seen(written: Path) -> None:
    assert written.stat().st_size < 100_000
    with visit(written.as_uri()) as seen:
        page = seen.page
        page.wait_for_function("globalThis.flight")
        for number in (0, 1):
            before = page.evaluate("[...flight.target]")
            x, y = handle(page, number)
            page.mouse.move(x, y)
            page.mouse.down()
            page.mouse.move(x + 60, y - 40, steps=3)
            page.mouse.up()
            after = page.evaluate("[...flight.target]")
            moved = {k for k, (a, b) in enumerate(zip(before, after, strict=True)) if a != b}
            assert moved == ({0, 1, 2} if number == 0 else {7, 8})
            assert max(away(page)) < 1e-3
        load_base(page, 1.1)  # On a step of the slider.
        # The force that is missing, N, against stiffness times the mass that the law knows.
        robot = load(ROBOT)
        mass = robot.mass_matrix([0, 0, 0, 0, 0, 0, 1, 0, 0])[0, 0]
        extra = 0.1 * robot.PARAMETERS["base_mass"] * robot.PARAMETERS["gravity"]
        sag = extra / (mass * page.evaluate("flight.R.stiffness[2]"))
        assert math.isclose(away(page)[0], sag, rel_tol=0.05)
        page.check("#known")
        assert max(away(page)) < 1e-3
        page.focus("#scene")
        page.keyboard.press("PageUp")
        assert away(page, 0.0)[1] > 0.01
        assert quiet(seen)


def test_a_finger_drags_on_a_phone_where_nothing_covers_the_machine(written: Path) -> None:
    with visit(written.as_uri(), 390, 844) as seen:
        page = seen.page
        page.wait_for_function("globalThis.flight")
        picture, panel = (page.locator(name).bounding_box() for name in ("figure", "aside"))
        assert picture is not None
        assert panel is not None
        assert picture["y"] + picture["height"] <= panel["y"] + 0.5
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        session = page.context.new_cdp_session(page)
        session.send("Emulation.setTouchEmulationEnabled", {"enabled": True})
        x, y = handle(page, 0)
        for kind, dx in (("Start", 0), ("Move", 15), ("Move", 30)):
            points = [{"x": x + dx, "y": y}]
            session.send(
                "Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points}
            )
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        start, target = page.evaluate("[flight.R.start, [...flight.target]]")
        assert math.dist(start[:3], target[:3]) > 0.01
        assert max(away(page)) < 1e-3
        assert quiet(seen)


def test_what_no_law_leads_flies_by_the_regulator(written: Path) -> None:
    place = written.with_name("regulated.html")
    fly_html("quadrotor_2link").save(place)
    with visit(place.as_uri()) as seen:
        seen.page.wait_for_function("globalThis.flight")
        seen.page.evaluate("flight.target[flight.R.position[2][1]] += 0.3")
        assert away(seen.page)[0] < 1e-3
        assert quiet(seen)


def slung(place: Path, *changes: tuple[str, str]) -> Path:
    """A robot file whose arm nothing drives, the upper one's mass beside it."""
    text = text_of(ROBOT, "robots", UsageError)[0]
    idle = [(f"effort     = {most}", "effort = 0") for most in (4, 3)]
    beside = ("com        = [0, 0, -0.09]", "com = [0.09, 0, 0]")
    for line, after in (*idle, beside, *changes):
        assert line in text
        text = text.replace(line, after)
    place.write_text(text, encoding="utf-8")
    return place


def test_what_rests_on_a_limit_or_falls_is_refused(tmp_path: Path) -> None:
    swing = 'axis       = "-y"\njoint      = "revolute"\nlimits_deg = [-140, 140]'
    for line, after, words in (
        ("limits_deg = [-100, 100]", "limits_deg = [-20, 20]", r"tau_upper_arm is 0\.08589 N m"),
        (swing, 'axis = "z"\njoint = "prismatic"', r"tau_forearm is 1\.57 N"),
    ):
        with pytest.raises(UsageError, match=f"no inputs within their limits .*{words}"):
            fly_html(slung(tmp_path / "slung.toml", (line, after)))


def test_what_nothing_drives_hangs_at_the_start(written: Path) -> None:
    robot, place = slung(written.with_name("slung.toml")), written.with_name("slung.html")
    fly_html(robot).save(place)
    with visit(place.as_uri()) as seen:
        seen.page.wait_for_function("globalThis.flight")
        first, second = seen.page.evaluate("flight.R.start.slice(-2)")
        # The first one's mass is beside it; the other hangs straight down.
        assert math.isclose(first, -math.atan2(0.22 * 0.09, 0.16 * 0.18), rel_tol=1e-9)
        assert math.isclose(second, -first, rel_tol=1e-9)
        assert max(away(seen.page)) < 1e-6
        assert quiet(seen)


def test_what_is_paused_or_out_of_sight_is_not_drawn_again(written: Path) -> None:
    outer = written.with_name("outer.html")
    outer.write_text(
        fly_html(ROBOT)._repr_html_() + '<div style="height: 9000px"></div>', encoding="utf-8"
    )
    with visit(outer.as_uri()) as seen:
        page = seen.page.frames[1]
        page.wait_for_function("globalThis.flight")

        def comes(still: bool) -> None:
            """Wait until frames within a time are none, or some."""
            page.wait_for_function(
                """async (still) => {
                  const drawn = () => flight.stats().frames, before = drawn();
                  await new Promise((done) => setTimeout(done, 300));
                  return still === (drawn() === before);
                }""",
                arg=still,
                timeout=6e4,
            )

        comes(still=False)
        seen.page.mouse.wheel(0, 5000)
        comes(still=True)
        seen.page.mouse.wheel(0, -5000)
        comes(still=False)
        page.locator("#pause").click()
        comes(still=True)
        drawn = page.evaluate("flight.stats().frames")
        page.locator("#scene").press("+")
        page.wait_for_function("(drawn) => flight.stats().frames > drawn", arg=drawn, timeout=6e4)
        comes(still=True)
        # From afar it starts again in the middle of the picture.
        page.evaluate("flight.target[flight.R.position[0][1]] += 3; flight.advance(9000)")
        page.locator("#pause").click()
        place = "flight.project(flight.handle(0)).slice(0, 2)"
        page.wait_for_function(f"Math.abs({place}[0] - scene.clientWidth / 2) < 99", timeout=6e4)
        page.locator("#pause").click()
        page.locator("#again").click()
        comes(still=True)
        assert page.evaluate(f"Math.abs({place}[0] - scene.clientWidth / 2)") < 9
        assert quiet(seen)


def test_ends_of_sliders_are_held_by_machines_of_every_kind(written: Path) -> None:
    # Errors of coordinates, rad and m: what a law does not know has it hang lower.
    held = """() => {
      const found = [];
      document.getElementById("pause").click();
      const { robot, reference, advance } = flight;
      for (const end of ["min", "max"])
        for (const input of document.querySelectorAll("#aims input, #masses input")) {
          document.getElementById("again").click();
          input.value = input[end];
          input.dispatchEvent(new Event("input"));
          advance(5000);
          const off = Math.hypot(...robot.difference(robot.q, reference.q));
          found.push([`${input.closest("div").id} ${input.parentNode.textContent} ${end}`, off]);
        }
      return found;
    }"""
    with visit(written.as_uri()) as seen:
        for name in (ROBOT, *KINDS):
            page = fly_html(name)
            packed = re.search(r'atob\("([^"]*)"\)', page.text)
            assert packed is not None
            assert len(gzip.decompress(base64.b64decode(packed[1]))) < 60_000
            assert page.size < 100_000
            place = written.with_name(f"{name}.html")
            page.save(place)
            seen.page.goto(place.as_uri())
            seen.page.wait_for_function("globalThis.flight")
            for what, off in seen.page.evaluate(held):
                assert off < (1e-3 if what.startswith("aims") else 10.0), (name, what)
        assert quiet(seen)


def test_page_about_it_runs(written: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    run_python("docs/howto/fly.md")


def test_loops_are_refused_before_anything_is_derived() -> None:
    with pytest.raises(UsageError, match="delta_hexarotor: its joints form loops"):
        fly_html("delta_hexarotor")
