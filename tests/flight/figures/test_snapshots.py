"""Snapshots show the machine where it was: equal axes, all instants, the gold arm."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from numpy.typing import NDArray
from support.synthetic_flight import names, synthetic_flight

from gibbs_codegen.figures.appearance import GOLD
from gibbs_codegen.figures.scene import project
from gibbs_codegen.figures.style import FULL
from gibbs_codegen.flight.figures.snapshots import snapshots, snapshots_panels
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.series import point_parents
from gibbs_codegen.flight.sweeps.sources import robot_data

Drawn = Callable[[Callable[[Flight], Figure], str], Figure]
Array = NDArray[Any]


@pytest.fixture(scope="module")
def paper(shipped: Callable[[str], ModuleType]) -> Flight:
    return synthetic_flight(shipped("hexarotor_3link"))


@pytest.fixture(scope="module")
def flights(shipped: Callable[[str], ModuleType], paper: Flight) -> dict[str, Flight]:
    """One flight of every kind that a drawing could stumble on."""
    bare = [name for name in paper.points if not name.startswith("joint")]
    return {
        "paper": paper,
        "no arm": replace(
            paper,
            points=tuple(bare),
            positions=paper.positions[:, [paper.points.index(name) for name in bare]],
            parents=np.array([-1, -1, *[1] * (len(bare) - 2)]),
            tip_desired=paper.centre_desired,
        ),
        "stopped": replace(
            synthetic_flight(shipped("hexarotor_3link"), samples=1),
            stopped="at t = 0 s: $5 of θ₀ is too_much " * 4,
        ),
    }


@pytest.fixture(scope="module")
def drawn(flights: dict[str, Flight]) -> Drawn:
    """A drawing of a kind of flight, drawn once."""

    @functools.cache
    def figure(draw: Callable[[Flight], Figure], kind: str) -> Figure:
        return draw(flights[kind])

    return figure


def gold_arm(axes: Any) -> Array:
    (line,) = [line for line in axes.get_lines() if to_hex(line.get_color()) == GOLD]
    points: Array = np.transpose(line.get_data_3d())
    return points


@pytest.mark.parametrize(
    ("draw", "kind"),
    [(snapshots, "stopped"), pytest.param(snapshots_panels, "paper", marks=pytest.mark.slow)],
)
def test_axes_in_space_are_equal(drawn: Drawn, kind: str, draw: Callable[[Flight], Figure]) -> None:
    axes: Any
    figure: Any = drawn(draw, kind)
    for axes in figure.axes:
        limits = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
        shape = np.ptp(limits, axis=1) / axes._box_aspect  # what set_box_aspect was given
        assert np.allclose(shape, shape[0], rtol=1e-12)
        # Panels show some instants, and so are limited to them.
        shown = np.concatenate([np.transpose(line.get_data_3d()) for line in axes.get_lines()])
        shown = shown[np.isfinite(shown).all(axis=1)]  # what is not, separates lines
        assert np.all((limits[:, 0] < shown) & (shown < limits[:, 1]))
    named = [[axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()] for axes in figure.axes]
    # Panels are alike, so that one of them says it for all.
    assert named.count(["$x$ (m)", "$y$ (m)", "$z$ (m)"]) == 1
    assert named.count(["", "", ""]) == len(named) - 1


def test_panels_stay_on_the_page_and_off_each_other(drawn: Drawn) -> None:
    figure: Any = drawn(snapshots_panels, "paper")
    figure.draw_without_rendering()
    boxes = []
    for axes in figure.axes:
        texts = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
        outlines = [axes.transData.transform(project(axes, corners(axes)))]
        outlines += [box.get_points() for box in texts if box is not None]
        points = np.concatenate(outlines)
        boxes.append(Bbox([points.min(axis=0), points.max(axis=0)]))
    for box in boxes:
        assert figure.bbox.x0 <= box.x0
        assert box.x1 <= figure.bbox.x1
        assert figure.bbox.y0 <= box.y0
        assert box.y1 <= figure.bbox.y1
    for one, other in itertools.combinations(boxes, 2):
        assert not one.overlaps(other)


def corners(axes: Any) -> Array:
    limits = (axes.get_xlim(), axes.get_ylim(), axes.get_zlim())
    return np.array(list(itertools.product(*limits)))


def test_heading_says_why_it_stopped(drawn: Drawn) -> None:
    assert drawn(snapshots, "paper").get_suptitle() == "hexarotor_3link, synthetic"
    assert "stopped at t = 0 s: $5 of θ₀ is too_much" in drawn(snapshots, "stopped").get_suptitle()


def test_twelve_instants(drawn: Drawn) -> None:
    axes: Any = drawn(snapshots, "paper").axes[0]
    discs = axes.collections
    assert len(discs) == 12
    assert all(len(each._faces) == 6 for each in discs)  # no public way to ask for them
    times = [float(name.removesuffix(" s")) for name in names(axes)]
    assert np.allclose(times, np.linspace(0.0, 4.0 * np.pi, 12), atol=0.1)


def test_panels_are_large_and_have_one_colour_of_arms(drawn: Drawn) -> None:
    """In twelve panels, a quarter of the page wide at most, the base could hardly be seen."""
    figure: Any = drawn(snapshots_panels, "paper")
    assert len(figure.axes) == 6
    (legend,) = figure.legends
    *_, arm = legend.get_lines()
    for axes in figure.axes:
        width, _ = np.ptp(axes.transData.transform(project(axes, corners(axes))), axis=0)
        assert width > 0.29 * figure.bbox.width
        assert axes.get_lines()[-1].get_color() == arm.get_color()


@pytest.mark.slow
def test_instants_in_one_place_share_a_label(paper: Flight) -> None:
    samples = np.zeros(len(paper.time), dtype=int)
    still = replace(paper, positions=paper.positions[samples])
    axes: Any = snapshots(still).axes[0]
    assert names(axes) == ["0.0 … 12.6 s"]
    # Robots drawn over each other would not be translucent.
    (discs,) = axes.collections
    # The label covers no rotor.
    (label,) = [text for text in axes.texts if text.get_text()]
    box = Text.get_window_extent(label)  # without the line from it to the robot
    corners = axes.transData.transform(project(axes, np.asarray(discs._faces)).reshape(-1, 2))
    assert not np.any(np.all((corners > box.p0) & (corners < box.p1), axis=1))
    ring = replace(still, positions=paper.positions.copy())
    ring.positions[-1] = ring.positions[0]
    assert "0.0, 12.6 s" in names(snapshots(ring).axes[0])
    # Of slow motion several instants are at one that is drawn, not each at the one before.
    along = np.linspace(0.0, 0.2, len(paper.time))[:, None, None] * [1.0, 0.0, 0.0]
    creeping = names(snapshots(replace(still, positions=still.positions + along)).axes[0])
    assert 1 < len(creeping) < 6
    # And those of a small robot are as far apart as those of a large one.
    places = ("positions", "centre_desired", "tip_desired", "disc_radii")
    small = replace(paper, **{name: 0.01 * getattr(paper, name) for name in places})
    assert len(names(snapshots(small).axes[0])) == 12


def test_joints_that_gears_move_are_drawn_on_what_carries_them(tmp_path: Path) -> None:
    body = "axis = 'z'\nmass = 1\ninertia = [1, 1, 1, 0, 0, 0]\n"
    hand = "[[link]]\nname = 'hand'\nxyz = [0, 0, 1]\n" + body
    fingers = "".join(
        f"[[link]]\nname = '{name}'\nparent = 'hand'\nxyz = [0, {y}, 0]\n{body}{gear}\n"
        f"[[frame]]\nname = '{name}_end'\non = '{name}'\nxyz = [1, 0, 0]\n"
        for name, y, gear in (("left", 1, ""), ("right", -1, "gear = {of = 'left', ratio = -1}"))
    )
    (tmp_path / "hand.toml").write_text(f"name = 'hand'\n[base]\nmotion = 'fixed'\n{hand}{fingers}")
    robot = robot_data(tmp_path / "hand.toml")
    parents = dict(zip(robot.points, point_parents(robot).tolist(), strict=True))
    carriers = {"joint_left": "joint_hand", "joint_right": "joint_hand", "right_end": "joint_right"}
    assert {name: robot.points[parents[name]] for name in carriers} == carriers


@pytest.mark.parametrize("kind", ["paper", "no arm"])
def test_drawing_fills_its_figure(drawn: Drawn, kind: str) -> None:
    figure = drawn(snapshots, kind)
    axes: Any = figure.axes[0]
    grid = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    whole = figure.bbox
    assert min(box.x0 for box in grid) < 0.12 * whole.width
    assert max(box.x1 for box in grid) > 0.88 * whole.width
    assert 0.0 <= min(box.y0 for box in grid) < 0.06 * whole.height
    assert figure.get_figwidth() <= FULL


@pytest.mark.parametrize("draw", [snapshots, snapshots_panels])
def test_paths_are_explained_once(drawn: Drawn, draw: Callable[[Flight], Figure]) -> None:
    figure: Any = drawn(draw, "paper")
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert np.all((figure.bbox.min <= box.min) & (box.max <= figure.bbox.max))
    names = [text.get_text() for text in legend.get_texts()]
    assert names == ["base centre", "tip", "desired", "base arm 2", "arm"]


def test_both_drawings_are_seen_from_the_same_side(drawn: Drawn) -> None:
    one, first = (drawn(draw, "paper").axes[0] for draw in (snapshots, snapshots_panels))
    assert (one.elev, one.azim) == (first.elev, first.azim)


def test_snapshot_shows_where_the_machine_is(paper: Flight, drawn: Drawn) -> None:
    """Of the first panel: gold arm, manipulator and discs, against the positions."""
    axes: Any = drawn(snapshots_panels, "paper").axes[0]
    lines = [np.transpose(line.get_data_3d()) for line in axes.get_lines()]
    at = dict(zip(paper.points, paper.positions[0], strict=True))
    assert np.array_equal(gold_arm(axes), [at["O2"], at["motor2"]])
    arm = [at[name] for name in ("O2", "joint7", "joint8", "joint9", "tip")]
    assert any(np.array_equal(points, arm) for points in lines)
    corners = axes.collections[0]._faces
    for k in range(6):
        assert np.allclose(corners[k].mean(axis=0), at[f"motor{k + 1}"])
        normal = paper.base_rotation[0] @ paper.thrust_directions[k]
        assert np.allclose((corners[k] - at[f"motor{k + 1}"]) @ normal, 0.0, atol=1e-12)


def test_gold_arm_follows_the_path(paper: Flight) -> None:
    first = replace(paper, tangent_arm=5, time=paper.time[:1])
    axes = snapshots_panels(first).axes[0]
    assert np.array_equal(gold_arm(axes)[1], paper.point("motor5")[0])


@pytest.mark.slow
def test_no_label_covers_another(paper: Flight) -> None:
    """Twelve instants within half a metre."""
    middle = paper.positions.mean(axis=0)
    near = replace(paper, positions=middle + 0.1 * (paper.positions - middle))
    figure = snapshots(near)
    figure.draw_without_rendering()
    axes: Any = figure.axes[0]
    boxes = [Text.get_window_extent(text) for text in axes.texts if text.get_text()]
    assert len(boxes) > 9
    for one, other in itertools.combinations(boxes, 2):
        assert not one.overlaps(other)


@pytest.mark.slow
def test_a_wall_is_drawn_where_it_is(paper: Flight) -> None:
    normal, point = np.array([1.0, -0.5, 0.2]), np.array([0.3, 0.0, 1.0])
    walls = np.array([[*point, *normal], [0.0, 0.0, 500.0, 0.0, 0.0, 1.0]])
    figure = snapshots(replace(paper, walls=walls))
    axes: Any = figure.axes[0]
    (edge,) = [line for line in axes.get_lines() if line.get_label() == "wall"]
    corners = np.transpose(edge.get_data_3d())
    assert np.allclose((corners - point) @ normal, 0.0, atol=1e-12)
    limits = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    on_side = np.isclose(corners[..., np.newaxis], limits).any(axis=2)
    assert np.all(on_side.sum(axis=1) >= 2)  # on edges of the box
    assert "wall" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_cylinder_is_drawn_around_its_axis(paper: Flight) -> None:
    walls = np.array([[0.3, 0.2, 1.0, 0.0, 0.6, 0.8, 0.25]])
    figure = snapshots(replace(paper, walls=walls, wall_kinds=("cylinder",)))
    (edge,) = [line for line in figure.axes[0].get_lines() if line.get_label() == "wall"]
    corners = np.transpose(edge.get_data_3d())
    corners = corners[np.isfinite(corners).all(axis=1)] - walls[0, :3]
    away = np.linalg.norm(np.cross(corners, walls[0, 3:6]), axis=1)
    # On the sides of a polygon in place of a circle.
    assert len(away) > 30
    assert away.max() == pytest.approx(0.25)
    assert away.min() > 0.24
