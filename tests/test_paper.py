"""The page on the paper: its numbers against statements of the paper and of mechanics."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.browser import visit
from support.command import run

from gibbs_codegen import load, paper, read_robot, read_scenario, simulate
from gibbs_codegen.cli.app import main
from gibbs_codegen.errors import UsageError
from gibbs_codegen.paper import (
    ROBOT,
    base_arm_angles_off,
    desired_paths,
    path_errors,
    residuals,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the command writes, after the residuals that it prints."""
    place = tmp_path_factory.mktemp("paper")
    told = run("paper", "--out", "new", cwd=place)
    assert (told.returncode, told.stderr.count("\n")) == (0, told.stderr.count("hexarotor_3link:"))
    assert "\nwritten to new: the page, index.html, index.md;" in told.stdout
    assert told.stdout.count("digits") == 1
    return place / "new"


@pytest.mark.slow
def test_the_page_has_the_papers_numbers_and_every_figure(folder: Path) -> None:
    page = (folder / "index.md").read_text(encoding="utf-8")
    rows = dict(
        line.strip("| ").split(" | ")[::2] for line in page.splitlines() if "kg/m |" in line
    )
    assert rows["base links"] == "0.5 m, 1 kg/m"
    assert rows["links of the arm"] == "0 m, 0 kg/m; 3 m, 1 kg/m; 3 m, 1 kg/m"
    assert "| diag(212, 21.2, 190.8) | 212, 21.2, 190.8 |" in page
    assert "| 9.81 m/s² | 9.81 m/s² |" in page
    figures = sorted(path.name for path in folder.glob("*.png"))
    assert [name for name in figures if f'src="{name}"' in page] == figures
    assert len(figures) == 7
    for name in figures:  # Something is drawn.
        assert np.ptp(np.asarray(Image.open(folder / name).convert("L"))) > 200
    assert "](" not in page
    # Chain 5 has seven coordinates and a border, the arm's chain nine coordinates.
    five, six = page.partition("Chain 5 is")[2].partition("Chain 6 is")[::2]
    assert "{ccccccc|c}" in five
    assert r"-\zeta_{5,4}" in five
    assert "{ccccccccc}" in six


@pytest.mark.slow
def test_a_browser_shows_the_page_without_a_request(folder: Path) -> None:
    """Where formulas are set: each of them, with rows where it has some."""
    pytest.importorskip("latex2mathml")
    page = (folder / "index.html").read_text(encoding="utf-8")
    text = (folder / "index.md").read_text(encoding="utf-8")
    assert page.count("<math") == len(re.findall(r"\$\$.+?\$\$|\$.+?\$", text, re.DOTALL))
    for left in ("$", "\\begin", "&amp;", "\ue000"):
        assert left not in page
    with visit((folder / "index.html").as_uri(), 390, 844) as seen:
        widths = "[...document.images].map((x) => x.naturalWidth)"
        assert min(seen.page.evaluate(widths)) > 300
        assert seen.page.evaluate("document.images.length") == 7
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= 390
        # Those of both chains, from whose rows letters take heights.
        tall = seen.page.locator("math[display=block] > mrow > mtable")
        assert [x.locator("> mtr").count() for x in tall.all()] == [3, 3]
        assert (seen.foreign, seen.faults) == ([], [])


def test_without_the_extra_formulas_stand_as_latex_and_that_is_said_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(paper, "SETS_FORMULAS", False)
    page = paper._as_html("| a | b |\n|:--|--:|\n| $x_1 <y_2$ | 2 |", tmp_path)
    assert re.search(r"<td[^>]*><code>x_1 &lt;y_2</code></td>", page)

    def stopped(*_: object) -> None:
        raise UsageError("stopped")

    monkeypatch.setattr(paper, "write_paper", stopped)
    assert main(["paper", "--out", str(tmp_path / "new")]) == 2
    assert "its extra paper, and run this again" in capsys.readouterr().out


@pytest.mark.slow
def test_what_the_flight_agrees_with_it_agrees_with_to_eight_digits(folder: Path) -> None:
    with (folder / "residuals.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    for row in rows:
        assert float(row["digits"]) > 8.0, row
        share = max(float(row["error"]) / float(row["size"]), 2.0**-52)
        assert float(row["digits"]) == pytest.approx(-np.log10(share))


def test_residuals_are_those_of_faults_that_are_known() -> None:
    """A path that is 0.1 m too wide, 1 m/s² too much, 1 N m too much, and 5 J."""
    robot, module = read_robot(ROBOT)[0], load(ROBOT, "numpy")
    t = np.array([0.0, np.pi])
    base, tip = desired_paths(t)
    np.testing.assert_allclose(
        base[1], [-2 * np.exp(-0.05 * np.pi), 0, np.exp(0.1 * np.pi)], atol=1e-15
    )
    np.testing.assert_allclose(tip[0], [0, -2, 0], atol=1e-15)
    wide = [{"amplitude": 2.1, "growth": -0.05, "frequency": 1}]
    off = simulate(module, read_scenario("paper", {"duration": 0.1, "base": {"path": {"x": wide}}}))
    assert path_errors(off)["base centre"][0] == pytest.approx(0.1, rel=1e-6)
    flight = simulate(module, read_scenario("paper", {"duration": 0.1}))
    a, torques = flight.a.copy(), flight.constraint_torques.copy()
    a[:, module.COORDINATES.index("z")] += 1.0
    torques[:, 1] += 1.0

    def largest(**changes: np.ndarray) -> dict[str, float]:
        flown = replace(flight, **changes)
        angles = base_arm_angles_off(module, flown)
        found = residuals(robot, module, flown, path_errors(flown), angles)
        return {residual.what: residual.error for residual in found}

    eq_18 = "Eq. 18 against Newton and Euler, body by body"
    energy = "Energy against work of the inputs"
    arms = "Fig. 10 B: arms on flown torques against held arms"
    # Rods of 0.5 m and two of 3 m, of 1 kg/m each; a moment about O₁ may be larger than 9 N.
    for what, error in largest(a=a).items():
        assert error > 9.0 - 1e-9 if what.startswith("Eq. 18") else error < 1e-6, what
    for what, error in largest(constraint_torques=torques).items():
        if what.startswith("Eq. 18"):
            assert error == pytest.approx(1.0, rel=1e-9)
        else:
            assert (error > 0.1) == (what == arms), what
    assert largest(applied=flight.applied + 3.0)[eq_18] > 1.0
    assert largest(work=flight.work + 5.0)[energy] == pytest.approx(5.0)


def test_base_arms_turn_and_tilt_by_faults_that_are_known() -> None:
    """1 N m too much on arm 3, a push that no torque holds, and a base that flies backwards."""
    module = load(ROBOT, "numpy")
    flight = simulate(module, read_scenario("paper", {"duration": 0.1}))
    assert np.abs(base_arm_angles_off(module, flight)).max() < 1e-14
    torques = flight.constraint_torques.copy()
    torques[:, 1] += 1.0
    # A loose rod of 0.5 kg and 0.5 m about its end, at least: the base turns the other way.
    turned = base_arm_angles_off(module, replace(flight, constraint_torques=torques))[-1]
    assert turned[1] > 0.99 / (0.5 * 0.5**2 / 3.0) * 0.1**2 / 2.0
    applied = flight.applied.copy()
    applied[:, 3] += 1.0  # Along y of arm 4, at its end.
    turned = base_arm_angles_off(module, replace(flight, applied=applied))[-1]
    assert turned[2] > 0.99 * 0.5 / (0.5 * 0.5**2 / 3.0) * 0.1**2 / 2.0
    positions, rotation = flight.positions.copy(), flight.base_rotation.copy()
    motor, centre = flight.points.index("motor2"), flight.points.index("O2")
    positions[:, motor] = 2.0 * positions[:, centre] - positions[:, motor]
    rotation[:, :, 2] *= -1.0
    off = path_errors(replace(flight, positions=positions, base_rotation=rotation))
    for name in ("base arm 2", "base normal"):
        np.testing.assert_allclose(off[name], 2.0, rtol=1e-9)


def test_the_command_leaves_what_is_there_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "index.md").write_text("mine")
    refused = run("paper", "--out", "mine", cwd=tmp_path)
    assert refused.returncode == 2
    assert "exists already; choose another name" in refused.stderr
    assert (tmp_path / "mine" / "index.md").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
