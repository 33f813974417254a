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
from moving import frames, hybrid_equation, panel
from support.browser import visit
from support.notebook_cells import run_cells

from gibbs_codegen import UsageError, generate, load
from gibbs_codegen.flight import Allocation, Vehicle, inputs_and_constraint_torques
from gibbs_codegen.robot.chains import decompose
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.text import robot_text

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.slow
TANGENT, PENDULUM = "tangent-to-be-moved", "pendulum-to-be-dragged"


@pytest.fixture(scope="module")
def cells() -> dict[str, tuple[Any, dict[str, Any]]]:
    notebook = nbformat.read(ROOT / "notebooks/01_gibbs_function.ipynb", as_version=4)
    return run_cells(notebook.cells, {TANGENT, PENDULUM})


@pytest.fixture(scope="module")
def hybrid() -> str:
    return hybrid_equation()


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


def test_pendulum_swings_is_dragged_and_has_its_bowl(cells: Any, tmp_path: Path) -> None:
    """The motion keeps its energy; bowl and bars are those of the posture that is shown."""
    drawing, names = cells[PENDULUM]
    module = names["module"]

    def state(seen: Any) -> tuple[Any, Any, float]:
        data = seen.page.locator("figure").evaluate("one => ({...one.dataset})")
        return *(np.array(json.loads(data[x])) for x in "qv"), float(data["energy"])

    def look(seen: Any, point: Any) -> None:
        move(seen.page, *point)
        q, v, energy = state(seen)
        assert np.isclose(energy, module.kinetic_energy(q, v) + module.potential_energy(q))
        needed = module.inverse_dynamics(q, v, point)
        shown = [numbers(seen.page, f"by-{k}")[-1] for k in (1, 2)]
        assert np.allclose(shown, needed, atol=0.0051)
        # The curve of the bowl, in rad/s², has equal heights above its lowest point.
        mass, real = module.mass_matrix(q), module.forward_dynamics(q, v, [0.0, 0.0])
        curve = np.reshape(numbers(seen.page, "bowl", "d"), (6, -1, 2))
        off = (curve - (200.0, 120.0)) / (1.5, -0.5) - real
        heights = np.einsum("hki,ij,hkj->hk", off, mass, off) / 2.0
        assert np.allclose(heights[2:], [[64.0], [256.0], [1024.0], [4096.0]], rtol=0.06)
        height = numbers(seen.page, "height")[0]
        assert np.isclose(height, (point - real) @ mass @ (point - real) / 2.0, atol=0.06)

    with open_page(drawing.data, tmp_path) as seen:
        figure = stood_still(seen)
        look(seen, (40.0, 0.0))
        before, _, energy = state(seen)
        figure.evaluate("one => one.advance(10)")
        after, _, kept = state(seen)
        assert np.linalg.norm(after - before) > 0.1
        assert abs(kept - energy) < 1e-6
        look(seen, (-20.0, 90.0))
        box = seen.page.locator(".end").bounding_box()
        assert box is not None
        seen.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        seen.page.mouse.down()
        pivot = seen.page.locator(".rods").evaluate(
            "one => { const {a, e, f} = one.getScreenCTM(); return [e + 180 * a, f + 130 * a, a]; }"
        )
        seen.page.mouse.move(pivot[0] + 80 * pivot[2], pivot[1] - 60 * pivot[2])
        figure.evaluate("one => one.advance(1)")  # It waits while it is held.
        q, v, _ = state(seen)
        assert np.allclose(module.positions(q)[-1, ::2], [80 / 125, 60 / 125], atol=0.01)
        assert not v.any()
        # Arrows of S and R, by the accelerations of the fall, of rods of 0.4 kg and 0.5 m.
        real, h = module.forward_dynamics(q, v, [0.0, 0.0]), 1e-3
        ahead, still, behind = (module.positions(q + x * real)[:, ::2] for x in (h, 0.0, -h))
        joints = ((ahead - behind) / (2.0 * h))[-3:]
        turns = np.cumsum(real) * 0.4 * 0.5**2 / 12.0
        for k in range(2):
            x, y, *tip = numbers(seen.page, f"force-{k + 1}", "d")
            force = 0.4 * np.add(joints[k : k + 2].mean(axis=0), (0.0, 9.81))
            assert np.allclose([tip[0] - x, y - tip[1]], 7.0 * force, atol=0.15)
            lever = (still[-2 + k] - still[-3 + k]) / 2.0
            moment = turns[k] + lever[0] * force[1] - lever[1] * force[0]
            arc = np.reshape(numbers(seen.page, f"moment-{k + 1}", "d"), (-1, 2)) - (
                (180.0, 130.0) + 125.0 * still[-3 + k] * (1.0, -1.0)
            )
            swept = np.unwrap(np.arctan2(-arc[:, 1], arc[:, 0]))
            assert np.isclose(swept[-1] - swept[0], np.clip(1.2 * moment, -5, 5), atol=0.02)
        look(seen, (0.0, 0.0))
        seen.page.mouse.up()
        figure.evaluate("one => one.advance(0.1)")
        assert state(seen)[1].any()
        seen.page.locator(".elbow").focus()
        seen.page.keyboard.press("ArrowLeft")
        assert not state(seen)[1].any()
        assert (seen.foreign, seen.faults) == ([], [])


def open_page(text: str, folder: Path, width: int = 1280) -> Any:
    (folder / "page.html").write_text(f"<!doctype html><meta charset=utf8>{text}", encoding="utf-8")
    return visit((folder / "page.html").as_uri(), width)


def test_sweeps_carry_what_newton_and_euler_find_about_centres_of_mass(tmp_path: Path) -> None:
    """Forces are mass times acceleration of the places that are drawn, by differences."""
    notebook = nbformat.read(ROOT / "notebooks/02_chains.ipynb", as_version=4)
    wanted = [c for c in notebook.cells if c.id in ("setup", "two-recursions", "both-sweeps")]
    drawing, _ = run_cells(wanted, {"both-sweeps"})["both-sweeps"]
    with open_page(drawing.data, tmp_path) as seen:
        figure = stood_still(seen)

        def items(time: float) -> Any:
            move(seen.page, 5.0, time)
            return np.array(json.loads(str(figure.get_attribute("data-items"))))

        h = 1e-3
        before, now, after = (items(time) for time in (2.0 - h, 2.0, 2.0 + h))
        ends = np.array([before, now, after])[:, :, :4].reshape(3, 3, 2, 2)
        joint, centre = ends[1, :, 0], ends[1].mean(axis=1)
        at_joint, at_centre = (
            (x[0] - 2.0 * x[1] + x[2]) / h**2 for x in (ends[:, :, 0], ends.mean(2))
        )
        up = np.array([0.0, 9.81])
        assert np.allclose(now[:, 6:8], at_joint + up, atol=1e-4)
        assert np.allclose(now[:, 5], (after - before)[:, 4] / (2.0 * h), atol=1e-4)
        force = 0.4 * (at_centre + up)
        assert np.allclose(now[:, 8:10], force, atol=1e-4)
        turn = 0.4 * 0.5**2 / 12.0 * now[:, 5]
        for k in range(3):
            assert np.allclose(now[k, 11:], force[k:].sum(axis=0), atol=1e-4)
            levers = centre[k:] - joint[k]
            moments = turn[k:] + levers[:, 0] * force[k:, 1] - levers[:, 1] * force[k:, 0]
            assert np.isclose(now[k, 10], moments.sum(), atol=1e-4)
        assert seen.page.locator(".said").text_content() == "inwards, joint of rod 1"
        marked = "all => all.map(one => one.style.background !== '')"
        assert seen.page.locator(".formula").evaluate_all(marked) == [False] * 3 + [True] * 3
        figure.evaluate("one => one.advance(3)")
        assert seen.page.locator(".formula").evaluate_all(marked) == [True] * 3 + [False] * 3
        assert (seen.foreign, seen.faults) == ([], [])


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


def test_entries_of_the_hybrid_system_are_what_a_touch_says(hybrid: str, tmp_path: Path) -> None:
    """Values are the module's, expressions give them, and what has an arm's mass names the arm."""
    module = load(ROOT / "generated/hexarotor_3link")
    with open_page(hybrid, tmp_path) as seen:
        figure = stood_still(seen)
        figure.evaluate("one => one.advance(3.1)")
        q, v = (np.array(json.loads(figure.get_attribute(f"data-{x}"))) for x in "qv")
        arrays = {"I": module.hybrid_mass_matrix(q), "B": module.hybrid_input_matrix(q)}
        arrays["R"] = module.hybrid_residual(q, v)[:, np.newaxis]
        heavier = {}
        for name in ("base_arm", "link2", "link3"):
            constants = module.prepare({f"{name}_mass_per_length": 2})
            matrix = module.hybrid_mass_matrix(q, constants=constants)
            residual = module.hybrid_residual(q, v, constants=constants)[:, np.newaxis]
            heavier[name] = {"I": abs(matrix - arrays["I"]), "R": abs(residual - arrays["R"])}
        # Constraint torques: those that the reduced functions find for the same accelerations.
        found = np.array(json.loads(str(figure.get_attribute("data-found"))))
        free = [module.HYBRID_COORDINATES.index(x) for x in module.COORDINATES]
        vehicle = Vehicle(module)
        allocation = Allocation(vehicle.thrust_wrenches())
        _, torques = inputs_and_constraint_torques(vehicle, allocation, q, v, found[free])
        assert np.allclose(found[14:], torques, atol=1e-6)
        for k, torque in enumerate(torques, start=2):
            arc = np.reshape(numbers(seen.page, f"torque-{k}", "d"), (-1, 2)) - [90.0, 255.0]
            swept = np.unwrap(np.arctan2(-arc[:, 1], arc[:, 0]))
            assert np.isclose(swept[0], np.radians(60.0 * (k - 4)), atol=0.01)
            assert np.isclose(swept[-1] - swept[0], np.clip(torque / 3.0, -5, 5), atol=0.02)
        postures = [dict(zip(module.COORDINATES, x, strict=True)) for x in (q, v)]
        for cell in seen.page.locator("[data-at]").all():
            cell.evaluate("one => one.click()")
            letter, row, column = str(cell.get_attribute("data-at")).split(" ")
            value = arrays[letter][int(row), int(column)]
            assert np.isclose(float(str(figure.get_attribute("data-value"))), value, atol=1e-9)
            said = seen.page.locator(".terms p").evaluate_all(
                "all => all.map(one => one.innerHTML)"
            )
            shown = str(seen.page.locator(".value").text_content()).replace("−", "-").split()
            assert np.isclose(float(shown[1]), value, rtol=1e-4, atol=1e-11)
            assert " ".join(shown[2:]) == unit(letter, int(row), int(column))
            assert said, (letter, row, column)
            terms = sum(in_numbers(text, *postures) for text in said)
            assert np.isclose(terms, value, atol=1e-9), (letter, row, column)
            coloured = {
                k
                for k in range(1, 10)
                if seen.page.locator(f".arm-{k}").get_attribute("stroke-width") == "4"
            }
            if letter == "B":
                assert coloured == {int(column) + 1}
                kind = "rotor" if int(column) < 6 else "joint"
                assert all(f", {kind} of arm {int(column) + 1}:" in text for text in said)
            elif max(int(row), int(column)) >= 14:  # The border: the arm that is held.
                assert coloured == {min(int(row), int(column)) - 1}
            else:
                heads = [re.split("arms? ", text.partition(": ")[0])[1] for text in said]
                arms = {int(k) for head in heads for k in re.findall(r"\d+", head)}
                for name, own in (("base_arm", {*range(1, 7)}), ("link2", {8}), ("link3", {9})):
                    changes = heavier[name][letter][int(row), int(column)] > 1e-9
                    assert changes == bool(arms & own), (letter, row, column, name)
                assert coloured == arms
        # It follows the motion that is asked for.
        assert np.isclose(q[3], 0.4 + 0.8 * np.sin(0.6 * 3.1), atol=5e-3)
        assert "−0.0" not in "".join(figure.evaluate(TORQUES))
        assert (seen.foreign, seen.faults) == ([], [])


def test_every_entry_is_reached_by_the_keyboard(hybrid: str, tmp_path: Path) -> None:
    """Tab leads into each array, and arrows lead to all its entries."""
    with open_page(hybrid, tmp_path) as seen:
        stood_still(seen)
        at, places = "document.activeElement.dataset.at ?? ''", []
        for _ in range(5):
            seen.page.keyboard.press("Tab")
            places.append(str(seen.page.evaluate(at)))
        assert [place[:1] for place in places] == ["", "I", "R", "B", ""]
        for place in places[1:4]:
            reached, waiting = set(), [place]
            while waiting:
                reached.add(here := waiting.pop())
                found = seen.page.evaluate(FOUR_WAYS, here)
                waiting += [x for x in {*found} - reached if x not in waiting]
            cells = seen.page.locator(f'[data-at^="{place[0]}"]').count()
            assert len(reached) == cells
            seen.page.keyboard.press("Tab")
            seen.page.keyboard.press("Shift+Tab")
            assert str(seen.page.evaluate(at))[0] == place[0]


TORQUES = """one => [...Array(60)].map(() => {
  one.advance(0.1);
  return one.querySelector(".torques").textContent;
})"""
FOUR_WAYS = """place => ["Left", "Right", "Up", "Down"].map(way => {
  const cell = document.querySelector(`[data-at="${place}"]`);
  cell.focus();
  cell.dispatchEvent(new KeyboardEvent("keydown", {key: "Arrow" + way, bubbles: true}));
  return document.activeElement.dataset.at;
})"""


def test_other_robots_move_or_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="quadrotor_2link: the drawing needs as many inputs as"):
        hybrid_equation("quadrotor_2link")
    path = tmp_path / "short.toml"
    path.write_text(robot_text(paper_family(6, 2), "short"), encoding="utf-8")
    with open_page(hybrid_equation(str(path)), tmp_path) as seen:
        figure = stood_still(seen)
        figure.evaluate("one => one.advance(2)")
        q = np.array(json.loads(str(figure.get_attribute("data-q"))))
        assert q.shape == (8,)
        assert np.isclose(q[3], 0.4 + 0.8 * np.sin(0.6 * 2.0), atol=5e-3)
        assert np.isclose(q[7], 0.3 * np.sin(0.6 * 2.0), atol=5e-3)
        assert "θ̈6, column of ẍ" in str(seen.page.locator(".entry").text_content())
        assert (seen.foreign, seen.faults) == ([], [])


@pytest.mark.parametrize("width", [390, 1280])
def test_rows_are_named_and_cells_are_large_on_a_phone(
    hybrid: str, tmp_path: Path, width: int
) -> None:
    with open_page(hybrid, tmp_path, width) as seen:
        page = seen.page
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        box = page.locator('[data-at^="B"]').first.bounding_box()
        assert box is not None
        assert box["width"] >= 21.0 + 3.0 * (width == 390)
        names = page.locator("[aria-label=B_H] [role=row] > span:first-child")
        assert names.last.is_visible() == (width == 390)
        assert names.last.text_content() == "τ'6"


def unit(letter: str, row: int, column: int) -> str:
    """The unit of an entry: rows 11 to 13 are forces, and 14 to 18 numbers."""
    turns = [k not in (11, 12, 13) for k in (row, column)]
    if letter == "R":
        return "N m" if turns[0] else "N"
    if letter == "B":
        return "N m for each N" if turns[0] and column < 6 else ""
    return "" if max(row, column) > 13 else ("kg", "kg m", "kg m²")[sum(turns)]


def in_numbers(said: str, q: dict[str, float], v: dict[str, float]) -> float:
    """The value of an expression as it stands on the page, of the paper's robot in motion."""
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
        if letter == "θ̇":
            return v.get(coordinates[int(index.split(",")[1]) - 1], 0.0)
        if letter == "B3":
            return float(section[index.split(",")[1]])
        lengths = {"l": 0.5 if index == "1" else 3.0, "μ": 1.0}
        return lengths.get(letter) or defined[f"{letter}<sub>{index}</sub>"]

    def value(text: str) -> float:
        known: dict[str, float] = {"g": 9.81}

        def named(symbol: re.Match[str]) -> str:
            known[f"x{len(known)}"] = meant(*symbol.groups())
            return f"x{len(known) - 1}"

        plain = re.sub(r"(\w\u0307?\w*)<sub>([^<]*)</sub>", named, text)
        for mark, sign in zip("·−²³", ("*", "-", "**2", "**3"), strict=True):
            plain = plain.replace(mark, sign)
        return float(sp.sympify(plain, locals=known))

    expression, *letters = re.split(r", with |, (?=\w+<sub>[^=]*=)", said.partition(": ")[2])
    defined.update((name, value(text)) for name, text in (x.split(" = ") for x in letters))
    return value(expression.rpartition(" = ")[2])


def cells_of(notebook: str, *names: str, changes: dict[str, str] | None = None) -> Any:
    """The last of some cells of a notebook, run in its order: what it shows, and the namespace."""
    book = nbformat.read(ROOT / f"notebooks/{notebook}.ipynb", as_version=4)
    wanted = [c for c in book.cells if c.id in names]
    for cell in wanted:
        cell.source = (changes or {}).get(cell.id, cell.source)
    return run_cells(wanted, {names[-1]})[names[-1]]


def drawings_of(figure: Any) -> list[dict[str, dict[str, str]]]:
    """The drawings that a slider chooses from."""
    line = next(x for x in figure.data.splitlines() if x.startswith("const frames = "))
    drawings, _ = json.JSONDecoder().raw_decode(line.removeprefix("const frames = "))
    return list(drawings)


def points(line: str) -> Any:
    """Places (n, 2), px, at which parts of a path begin or lines of it end."""
    return np.array(re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", line), dtype=float)


def test_step_response_grows_beyond_the_limits_found_by_hand(tmp_path: Path) -> None:
    """Roots are those of the matrix of exercise 1, and say how the error that is drawn grows."""
    drawing, _ = cells_of("06_your_own_controller", "setup", "step-response")
    with open_drawing({"drawn": (drawing,)}, "drawn", tmp_path) as seen:

        def growth(h: float, delay: float, lag: float) -> tuple[float, float]:
            move(seen.page, h, delay, lag)
            data = seen.page.locator("figure").evaluate("one => ({...one.dataset})")
            return float(data["growth"]), float(data["slowest"])

        # As it opens, any one slider can be moved past its limit.
        for slider in seen.page.locator("input[type=range]").all():
            assert slider.get_attribute("value") == slider.get_attribute("min")
        assert growth(0.005, 0.0, 1e-4)[0] < 1e-3
        for below, above in (
            ((0.19, 0.0, 1e-4), (0.21, 0.0, 1e-4)),
            ((0.005, 0.12, 1e-4), (0.005, 0.132, 1e-4)),
            ((0.005, 0.0, 0.38), (0.005, 0.0, 0.42)),
        ):
            (before, left), (after, right) = growth(*below), growth(*above)
            assert before < 1.0 < after
            assert left < 0.0 < right
            # Peaks of two seconds, some of which fall between samples.
            assert np.isclose(before, np.exp(2.0 * left), rtol=0.15)
            assert np.isclose(after, np.exp(2.0 * right), rtol=0.15)
        h = 0.15
        by_hand = np.array([[1 - 12.5 * h**2, h - 5.0 * h**2], [-25.0 * h, 1 - 10.0 * h]])
        expected = np.log(np.abs(np.linalg.eigvals(by_hand)).max()) / h
        assert np.isclose(growth(h, 0.0, 1e-4)[1], expected, rtol=1e-3)
        assert (seen.foreign, seen.faults) == ([], [])


def test_pendulum_follows_the_ring_within_the_limits(tmp_path: Path) -> None:
    """With a fast loop errors are those of the formula; weight helps a lag while it hangs."""
    drawing, _ = cells_of("06_your_own_controller", "setup", "pendulum-in-the-loop")
    with open_page(drawing.data, tmp_path) as seen:
        figure = stood_still(seen)

        def error() -> Any:
            data = figure.evaluate("one => ({...one.dataset})")
            return np.subtract(json.loads(data["target"]), json.loads(data["q"]))

        def largest(*settings: float) -> list[float]:
            """Largest errors of the third and of the fifth second, from the same start."""
            seen.page.reload()
            move(seen.page, *settings)
            found = []
            for ready in (2.0, 1.0):
                figure.evaluate("(one, ready) => one.advance(ready)", ready)
                tops = []
                for _ in range(10):
                    figure.evaluate("one => one.advance(0.1)")
                    tops.append(np.abs(error()).max())
                found.append(max(tops))
            return found

        move(seen.page, 0.005, 0.0, 1e-4)
        begin = error()
        figure.evaluate("one => one.advance(0.5)")
        assert np.allclose(error(), begin * 3.5 * np.exp(-2.5), atol=0.02)
        for inside in ((0.17, 0.0, 1e-4), (0.005, 0.12, 1e-4), (0.005, 0.0, 0.5)):
            early, late = largest(*inside)
            assert late < early
        for beyond in ((0.21, 0.0, 1e-4), (0.005, 0.135, 1e-4)):
            assert max(largest(*beyond)) > 1.0
        # Over its pivot.
        move(seen.page, 0.005, 0.0, 0.02)
        seen.page.locator(".target").focus()
        for _ in range(16):
            seen.page.keyboard.press("ArrowUp")
        figure.evaluate("one => one.advance(6)")
        assert np.abs(error()).max() < 1e-3
        move(seen.page, 0.005, 0.0, 0.3)
        seen.page.keyboard.press("ArrowLeft")
        figure.evaluate("one => one.advance(10)")
        assert np.abs(error()).max() > 0.3
        assert (seen.foreign, seen.faults) == ([], [])


def test_hydrus_follows_its_joints(tmp_path: Path) -> None:
    module = load(generate("hydrus", tmp_path, verify=False))
    loaded = f"hydrus = load({str(tmp_path / 'hydrus')!r})"
    drawing, _ = cells_of(
        "04_quasi_velocities",
        "setup",
        "compare-with-pinocchio",
        "hydrus-drawn",
        changes={"compare-with-pinocchio": loaded},
    )
    drawings = drawings_of(drawing)
    assert len(drawings) == 91
    for angle in (0, 60, 90):
        posture = np.array([0, 0, 0, 0, 0, 0, 1, *[np.deg2rad(angle)] * 3])
        centres = np.add(points(drawings[angle]["d"]["rotors"]), (14.0, 0.0))
        at = dict(zip(module.POINTS, module.positions(posture), strict=True))
        off = [at[f"rotor{k}"] - module.centre_of_mass(posture) for k in (1, 2, 3, 4)]
        assert np.allclose(centres, [200, 130] + [130, -130] * np.array(off)[:, :2], atol=0.06)


def test_books_end_a_third_of_a_turn_apart() -> None:
    """The corners of their covers are turned by matrices of rotation."""
    drawing, _ = cells_of("04_quasi_velocities", "setup", "two-turns", "book-that-is-turned")
    drawings = drawings_of(drawing)
    assert drawings[0]["words"]["apart"] == "apart by a turn of 0°"
    assert drawings[-1]["words"]["apart"] == "apart by a turn of 120°"
    about_x = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    about_y = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    sine, cosine = np.sin(np.radians([25.0, -50.0])), np.cos(np.radians([25.0, -50.0]))
    right = [-sine[1], cosine[1], 0.0]
    up = [-sine[0] * cosine[1], -sine[0] * sine[1], cosine[0]]
    cover = np.array([(x, y, 0.18) for x in (-1, 1) for y in (-0.65, 0.65)])
    for k, turned in enumerate((about_x @ about_y, about_y @ about_x)):
        drawn = points(drawings[-1]["d"][f"cover-{k}"])
        expected = cover @ turned.T @ np.array([right, up]).T * [85, -85] + [145 + 270 * k, 145]
        assert np.allclose(
            np.linalg.norm(drawn[:, None] - expected, axis=2).min(axis=0), 0, atol=0.1
        )


def test_arrows_of_the_wheel_give_the_thrust_of_motor_3() -> None:
    """By the levers of the page; inverse dynamics found the shares that stand beside them."""
    drawing, names = cells_of(
        "05_flight",
        "generate-the-robot",
        "fly-the-paper",
        "eqs-20-and-21",
        "attitude-and-its-rates",
        "desired-motion",
        "required-inputs",
        "static-share",
        "split-of-the-peak",
        "wheel-in-motion",
        changes={"fly-the-paper": 'scenario = read_scenario("paper")'},
    )
    drawings = drawings_of(drawing)
    arm = np.array([np.cos(np.radians(-60.0)), np.sin(np.radians(-60.0))])
    largest = 0.0
    for drawn in drawings:
        for name in ("rates", "joint"):
            start, tip = points(drawn["d"][name])
            moment = (tip - start) / [58.0, -58.0] * 200.0
            share = 2.0 / 3.0 * moment @ arm / 0.5
            said = float(drawn["words"][f"{name}-now"].split()[-2])
            # The base turns about O1, not about axis 7.
            assert np.isclose(share, said, atol=12.0)
        whole = float(drawn["words"]["whole-now"].split()[-2])
        assert abs(whole) <= 533
        largest = max(largest, whole)
    assert largest == 533
    assert len(drawings) == len(names["near_peak"])


def test_plans_are_what_is_flown_next() -> None:
    """Places that are predicted are reached, along a circle, by thrusts that were planned."""
    drawing, names = cells_of(
        "07_derivatives",
        "setup",
        "generate-the-robot",
        "model-predictive-controller",
        "horizon-flown",
    )
    drawings, per_metre = drawings_of(drawing), 800.0
    assert drawings[0]["words"]["off"] == "off by 59.2 mm"
    at = [points(drawn["d"]["gripper"])[0] for drawn in drawings]
    # Drawings are two calls apart. The first plans are for steps in which joints are fast.
    for k, drawn in enumerate(drawings[3:-10], start=3):
        ahead = points(drawn["d"]["predicted"])
        assert len(ahead) == 20
        assert np.allclose(ahead[1::2], at[k + 1 : k + 11], atol=0.2 + 1e-4 * per_metre)
    share = np.arange(0.0, 4.0, 0.04)[: len(at)] / 4.0
    angle = 2.0 * np.pi * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    asked = np.transpose([185 + 80 * np.sin(angle), 150 - 80 * np.cos(angle)])
    assert np.allclose(at[25:], asked[25:], atol=1.0)
    assert np.allclose(names["acted"][1:, :6], names["thrusts_planned"][:-1, 0], atol=1.2)
    assert np.allclose(names["acted"][21:, :6], names["thrusts_planned"][20:-1, 0], atol=0.02)


def test_sleigh_keeps_its_energy_and_ends_straight(tmp_path: Path) -> None:
    """Chaplygin's sleigh ends at the speed of exercise 1, the wrong one goes round for ever."""
    drawing, names = cells_of("08_other_bases", "setup", "rover-robot", "sleigh-to-be-pushed")
    rover = names["rover"]
    with open_page(drawing.data, tmp_path) as seen:
        figure = stood_still(seen)

        def state() -> tuple[Any, Any, float]:
            data = figure.evaluate("one => ({...one.dataset})")
            return *(np.array(json.loads(data[x])) for x in ("right", "wrong")), float(
                data["energy"]
            )

        begin, _, energy = state()
        assert np.isclose(energy, rover.kinetic_energy(begin[:3], [-0.6, 0.0, 2.0]))
        assert np.isclose(energy, 0.4 * 0.36 + 0.5 * (0.03 + 0.8 * 0.09) * 4.0)
        figure.evaluate("one => one.advance(8)")
        right, wrong, kept = state()
        assert np.isclose(kept, energy, atol=1e-6)
        assert np.isclose(right[3], np.sqrt(0.87), atol=1e-3)
        assert abs(right[4]) < 1e-2
        # Round a circle of 0.3 m.
        circle = [-0.3 * np.sin(16.0), -0.3 * (1.0 - np.cos(16.0)), 16.0, -0.6, 2.0]
        assert np.allclose(wrong, circle, atol=1e-4)
        # The keyboard pushes it by its centre of mass, along the axes of the picture.
        seen.page.locator(".mass").focus()
        seen.page.keyboard.press("ArrowUp")
        pushed, alike, _ = state()
        assert np.array_equal(pushed, alike)
        assert np.linalg.norm(pushed[3:] - right[3:]) > 1e-3
        move(seen.page, 1.0, 0.0)
        figure.evaluate("one => one.advance(1)")
        assert np.allclose(state()[0], [1.0, 0.0, 0.0, 1.0, 0.0])
        box = seen.page.locator(".mass").bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        seen.page.mouse.move(x, y)
        seen.page.mouse.down()
        seen.page.mouse.move(x, y - 60)
        figure.evaluate("one => one.advance(0.2)")
        seen.page.mouse.up()
        right, wrong, _ = state()
        assert right[4] > 0.3
        assert np.array_equal(right, wrong)
        assert (seen.foreign, seen.faults) == ([], [])


def test_time_and_the_slider_choose_a_drawing(tmp_path: Path) -> None:
    drawings = [{"d": {"line": f"M0 {k}h9"}, "words": {"said": str(-k)}} for k in range(5)]
    inner = panel("five", "Five lines.", (9, 9), '<path class="line"/><text class="said"/>')
    text = frames("five", inner, ("time", 1, 3, 1, "s", 1), drawings, pace=0.5)
    with open_page(text, tmp_path) as seen:
        figure = stood_still(seen)
        for value, expected in ((1.0, 0), (2.0, 2), (3.0, 4)):
            move(seen.page, value)
            assert figure.get_attribute("data-frame") == str(expected)
            assert seen.page.locator(".line").get_attribute("d") == f"M0 {expected}h9"
        assert seen.page.locator(".said").text_content() == "−4"
        move(seen.page, 1.5)
        figure.evaluate("one => one.advance(2)")
        assert figure.get_attribute("data-frame") == "3"
        figure.evaluate("one => one.advance(2)")  # From the last it begins again.
        assert figure.get_attribute("data-frame") == "1"
        assert (seen.foreign, seen.faults) == ([], [])
