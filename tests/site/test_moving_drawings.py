"""Drawings that move: what they say is what the equations say, with no server."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import nbformat
import numpy as np
import pytest
import sympy as sp
from conftest import ROOT
from moving import hybrid_equation
from support.browser import visit
from support.notebook_cells import run_cells

from gibbs_codegen import load
from gibbs_codegen.robot.chains import decompose
from gibbs_codegen.robot.file import read_robot

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


def open_page(text: str, folder: Path, width: int = 1280) -> Any:
    (folder / "page.html").write_text(f"<!doctype html><meta charset=utf8>{text}", encoding="utf-8")
    return visit((folder / "page.html").as_uri(), width)


def stood_still(seen: Any) -> Any:
    """The figure for a reader who wants no motion: it stands until it is asked."""
    seen.page.emulate_media(reduced_motion="reduce")
    seen.page.reload()
    figure = seen.page.locator("figure")
    before = figure.evaluate("one => ({...one.dataset})")
    seen.page.wait_for_timeout(200)
    assert before
    assert figure.evaluate("one => ({...one.dataset})") == before
    return figure


def test_entries_of_the_hybrid_system_are_what_a_touch_says(tmp_path: Path) -> None:
    """Values are the module's, expressions give them, and what has an arm's mass names the arm."""
    module = load(ROOT / "generated/hexarotor_3link")
    with open_page(hybrid_equation(), tmp_path) as seen:
        figure = stood_still(seen)
        figure.evaluate("one => one.advance(3.1)")
        q, v = (np.array(json.loads(figure.get_attribute(f"data-{x}"))) for x in "qv")
        arrays = {"I": module.hybrid_mass_matrix(q), "B": module.hybrid_input_matrix(q)}
        arrays["R"] = module.hybrid_residual(q, v)[:, np.newaxis]
        heavier = {
            name: abs(
                module.hybrid_mass_matrix(
                    q, constants=module.prepare({f"{name}_mass_per_length": 2})
                )
                - arrays["I"]
            )
            for name in ("base_arm", "link2", "link3")
        }
        for cell in seen.page.locator("[data-at]").all():
            cell.evaluate("one => one.click()")
            letter, row, column = str(cell.get_attribute("data-at")).split(" ")
            value = arrays[letter][int(row), int(column)]
            assert np.isclose(float(str(figure.get_attribute("data-value"))), value, atol=1e-9)
            said = seen.page.locator(".terms p").evaluate_all(
                "all => all.map(one => one.innerHTML)"
            )
            if letter == "R" or not said:
                continue
            terms = sum(
                in_numbers(text, dict(zip(module.COORDINATES, q, strict=True))) for text in said
            )
            assert np.isclose(terms, value, atol=1e-9), (letter, row, column)
            if letter == "I":
                heads = [re.split("arms? ", text.partition(": ")[0])[1] for text in said]
                arms = {int(k) for head in heads for k in re.findall(r"\d+", head)}
                for name, own in (("base_arm", {*range(1, 7)}), ("link2", {8}), ("link3", {9})):
                    changes = heavier[name][int(row), int(column)] > 1e-9
                    assert changes == bool(arms & own), (letter, row, column, name)
        # It follows the motion that is asked for.
        assert np.isclose(q[3], 0.4 + 0.8 * np.sin(0.6 * 3.1), atol=5e-3)
        assert (seen.foreign, seen.faults) == ([], [])


def in_numbers(said: str, q: dict[str, float]) -> float:
    """The value of an expression as it stands on the page, of the paper's robot in a posture."""
    robot = read_robot("hexarotor_3link")[0]
    number = int(re.findall(r"chain (\d)", said)[0])
    coordinates = decompose(robot)[number - 1].coordinates
    section = dict(zip(("xx", "yy", "zz"), robot.base.arm(1).section_inertia, strict=True))
    defined: dict[str, float] = {}

    def meant(letter: str, index: str) -> float:
        if letter in "sc":
            names = [coordinates[int(k) - 1] for k in index.split(",")[1].split("+")]
            held = np.deg2rad(float(robot.base.arm_angle_deg(min(number + 1, 6))))
            return {"s": np.sin, "c": np.cos}[letter](sum(q.get(x, held) for x in names))
        if letter == "B3":
            return float(section[index.split(",")[1]])
        lengths = {"l": 0.5 if index == "1" else 3.0, "μ": 1.0}
        return lengths.get(letter) or defined[f"{letter}<sub>{index}</sub>"]

    def value(text: str) -> float:
        known: dict[str, float] = {}

        def named(symbol: re.Match[str]) -> str:
            known[f"x{len(known)}"] = meant(*symbol.groups())
            return f"x{len(known) - 1}"

        plain = re.sub(r"(\w+)<sub>([^<]*)</sub>", named, text)
        for mark, sign in zip("·−²³", ("*", "-", "**2", "**3"), strict=True):
            plain = plain.replace(mark, sign)
        return float(sp.sympify(plain, locals=known))

    expression, *letters = re.split(r", with |, (?=\w+<sub>[^=]*=)", said.partition(": ")[2])
    defined.update((name, value(text)) for name, text in (x.split(" = ") for x in letters))
    return value(expression.rpartition(" = ")[2])
