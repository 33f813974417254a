"""Drawings of the coupling show what the coupling map and the chains' systems hold (Figs. 6–9)."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given, settings
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Rectangle
from support.emitted import emitted_module
from support.random_robots import robots

from gibbs_codegen.derivation.hybrid import filled_entries
from gibbs_codegen.figures.coupling import (
    chain_colour,
    coupling_figure,
    hybrid_pattern_figure,
)
from gibbs_codegen.robot.chains import coupling_map
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot

PAPER = read_robot("hexarotor_3link")[0]
FEW = paper_family(2, 0)
DRAWINGS = [coupling_figure, hybrid_pattern_figure]


def named(robot: Robot) -> str:
    return robot.name


def texts(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.axes[0].texts]


def emitted_patterns(robot: Robot) -> list[Any]:
    """Which entries of I_H, R_H and B_H the emitted functions make other than zero, somewhere."""
    names = (f"hybrid_{part}" for part in ("mass_matrix", "residual", "input_matrix"))
    module = emitted_module(robot, *names)
    q, v = np.random.default_rng(5).normal(size=(2, 20, len(module.COORDINATES)))
    arrays = (
        module.hybrid_mass_matrix(q),
        module.hybrid_residual(q, v)[:, :, np.newaxis],
        module.hybrid_input_matrix(q),
    )
    return [(np.abs(array) > 1e-12).any(axis=0) for array in arrays]


def filled_patterns(robot: Robot) -> list[Any]:
    """Which entries any chain fills."""
    filled = filled_entries(robot)
    parts = (filled.matrix, filled.residual, filled.inputs)
    return [np.array([[bool(chains) for chains in row] for row in part]) for part in parts]


@pytest.mark.slow
def test_the_papers_robot_is_filled_where_the_emitted_arrays_are_not_zero() -> None:
    for ours, theirs in zip(filled_patterns(PAPER), emitted_patterns(PAPER), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.slow
@settings(max_examples=2)
@given(robot=robots(most_rotors=5, most_links=3))
def test_what_is_not_filled_is_zero_in_the_emitted_arrays(robot: Robot) -> None:
    """The other way does not hold: what chains add up to may be zero by symmetry."""
    for ours, theirs in zip(filled_patterns(robot), emitted_patterns(robot), strict=True):
        assert not (theirs & ~ours).any()


def test_chains_fill_only_the_rows_and_columns_of_their_own_unknowns() -> None:
    robot = FEW
    filled, places = filled_entries(robot), coupling_map(robot)
    for i, row in enumerate(filled.matrix):
        for j, chains in enumerate(row):
            assert list(chains) == sorted(set(chains))
            assert all(i in places[c - 1] and j in places[c - 1] for c in chains)
    for i, (row, (residual,)) in enumerate(zip(filled.inputs, filled.residual, strict=True)):
        assert all(i in places[c - 1] for chains in (residual, *row) for c in chains)


@pytest.mark.slow
def test_an_entry_of_two_base_arms_is_one_chains_and_the_total_mass_is_everyones() -> None:
    filled = filled_entries(PAPER)
    x, theta_6, theta_9 = 11, 7, 10
    assert filled.matrix[x][x] == (1, 2, 3, 4, 5, 6)
    assert filled.matrix[theta_6][x] == filled.matrix[x][theta_6] == (5,)
    assert filled.matrix[theta_9][x] == (6,)
    assert filled.matrix[theta_6][theta_9] == ()
    # Motor 1 pushes in chain 1 only, as motor 2 does.
    assert filled.inputs[x][:3] == ((1,), (1,), (2,))


@pytest.mark.parametrize("robot", [PAPER, FEW], ids=named)
def test_every_arrow_goes_from_its_chain_to_the_unknown_that_the_map_names(robot: Robot) -> None:
    """The three angles of the attitude share a line, and so do the three coordinates x, y, z."""
    axes: Any = coupling_figure(robot).axes[0]
    arrows = [patch for patch in axes.patches if isinstance(patch, FancyArrowPatch)]
    names = [unknown.name for unknown in Description(robot).hybrid_coordinates]
    x = names.index("x")
    lines = [line for line in range(len(names)) if line not in (1, 2, x + 1, x + 2)]
    wanted = [
        (number, lines.index(place))
        for number, places in enumerate(coupling_map(robot), start=1)
        for place in places
        if place in lines
    ]
    # Middles of boxes, which are as many as the lines after those of the chains.
    boxes = [patch for patch in axes.patches if isinstance(patch, FancyBboxPatch)]
    middles = [box.get_y() + box.get_height() / 2.0 for box in boxes if box.get_x() > 0.0]
    assert len(middles) == len(lines)
    starts = []
    for arrow, (number, line) in zip(arrows, wanted, strict=True):
        path = arrow._path_original
        starts.append(path.vertices[0, 1])
        assert np.abs(np.subtract(middles, path.vertices[-1, 1])).argmin() == line
        assert to_hex(arrow.get_edgecolor()) == chain_colour(number)
    assert starts == sorted(starts)


def test_fewer_arrows_than_unknowns_fit_on_a_screen() -> None:
    figure = coupling_figure(PAPER)
    axes: Any = figure.axes[0]
    arrows = [patch for patch in axes.patches if isinstance(patch, FancyArrowPatch)]
    assert len(arrows) == 25  # Of 49 unknowns: four of each base arm, five of the manipulator.
    width, height = figure.get_size_inches()
    assert height < width


def test_unknowns_are_written_as_in_the_paper() -> None:
    shown = texts(coupling_figure(PAPER))
    symbols = [symbol for text in shown for symbol in text.split(", ")]
    for symbol in (r"$\ddot{\theta}_{5,4}$", r"$\ddot{x}_{o_{6,3}}$", r"$\tau\prime_{5,4}$"):
        assert symbols.count(symbol) == 1
    assert r"$\ddot{\theta}_{-1}$" in symbols
    numbers = [int(t.replace("−", "-")) for t in symbols if t.lstrip("−").isdigit()]
    assert numbers == [*range(-1, 18)]


def test_every_entry_is_covered_by_equal_shares_in_its_chains_colours() -> None:
    robot = FEW
    filled = filled_entries(robot)
    axes: Any = hybrid_pattern_figure(robot).axes[0]
    cells = [c for c in axes.collections if c.get_facecolors().size]
    for part, drawn in zip((filled.matrix, filled.residual, filled.inputs), cells, strict=True):
        boxes = [path.get_extents() for path in drawn.get_paths()]
        colours = [to_hex(colour) for colour in drawn.get_facecolors()]
        first = min(x for row in part for x, chains in enumerate(row) if chains)
        left = min(box.x0 for box in boxes) - first
        covered: dict[tuple[int, int], float] = {}
        seen: dict[tuple[int, int], list[str]] = {}
        for box, colour in zip(boxes, colours, strict=True):
            entry = int((box.y0 + box.y1) / 2), int((box.x0 + box.x1) / 2 - left)
            covered[entry] = covered.get(entry, 0.0) + box.width * box.height
            seen.setdefault(entry, []).append(colour)
        wanted = {
            (y, x): [chain_colour(number) for number in chains]
            for y, row in enumerate(part)
            for x, chains in enumerate(row)
            if chains
        }
        assert seen == wanted
        np.testing.assert_allclose(list(covered.values()), 1.0)


@pytest.mark.slow
def test_blocks_are_those_of_the_equations_of_motion() -> None:
    """I and Γ, R, Ψ and Φ: rows −1 … 12 of the paper's robot, and their columns."""
    axes: Any = hybrid_pattern_figure(PAPER).axes[0]
    frames = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    assert [(frame.get_width(), frame.get_height()) for frame in frames] == [
        *((14, 14), (5, 14)),
        (1, 14),
        *((6, 14), (3, 14)),
    ]
    shown = texts(hybrid_pattern_figure(PAPER))
    assert {"$I$", r"$\Gamma$", "$R$", r"$\Psi$", r"$\Phi$"} <= set(shown)
    # A robot without arms has no columns Φ.
    assert r"$\Phi$" not in texts(hybrid_pattern_figure(paper_family(2, 0)))


def test_texts_are_large_enough_inside_and_apart() -> None:
    robot, draw = FEW, hybrid_pattern_figure
    figure = draw(robot)
    renderer = FigureCanvasAgg(figure).get_renderer()
    boxes = []
    for text in figure.axes[0].texts:
        assert text.get_fontsize() >= 7
        boxes.append(text.get_window_extent(renderer).padded(-1))
    width, height = figure.get_size_inches() * figure.dpi
    assert all(b.x0 > 0 and b.y0 > 0 and b.x1 < width and b.y1 < height for b in boxes)
    for place, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[place + 1 :])


@pytest.mark.parametrize("draw", DRAWINGS)
def test_drawings_leave_the_users_style_alone(draw: Any) -> None:
    before = dict(mpl.rcParams)
    draw(paper_family(2, 1))
    assert dict(mpl.rcParams) == before
