"""Figures of the machine and of its chains show what the robot's data and the decomposition say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from support.emitted import emitted_module
from support.names import assert_names_are_apart
from support.random_robots import robots

from gibbs_codegen.errors import UsageError
from gibbs_codegen.figures.appearance import DARK, GOLD
from gibbs_codegen.figures.chains import chains_figure
from gibbs_codegen.figures.machine import machine_figure
from gibbs_codegen.figures.marks import CONSTRAINT, THRUST, TORQUE, X_AXIS, Y_AXIS, Z_AXIS
from gibbs_codegen.robot.chains import decompose
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.posture import default_posture, robot_frames

PAPER = read_robot("hexarotor_3link")[0]


@pytest.fixture(scope="module")
def paper() -> Figure:
    """The paper's machine in its default posture, drawn once for all that look at it."""
    return machine_figure("hexarotor_3link")


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts if text.get_text()]


def arrows(axes: Axes, colour: str) -> int:
    """Number of arrows of a colour, whichever way they are drawn."""
    patches = [text.arrow_patch for text in axes.texts if getattr(text, "arrow_patch", None)]
    patches += [patch for patch in axes.patches if type(patch).__name__ == "FancyArrowPatch"]
    return sum(to_hex(patch.get_edgecolor()) == colour for patch in patches)


@pytest.mark.slow
@settings(max_examples=2)
@given(robot=robots(most_rotors=7, most_links=3))
def test_frames_are_where_the_emitted_functions_put_them(robot: Robot) -> None:
    module = emitted_module(robot, "positions", "tip_pose", "input_matrix")
    q = np.random.default_rng(2).normal(size=len(module.COORDINATES))
    frames = robot_frames(robot, q)
    assert np.allclose(frames.points, module.positions(q), atol=1e-12)
    last = frames.links[-1] if frames.links else frames.base
    assert np.allclose(last.axes, module.tip_pose(q)[:3, :3], atol=1e-12)
    # A thrust pushes the origin of the coordinates along itself.
    assert np.allclose(frames.thrusts.T, module.input_matrix(q)[-3:, : robot.rotors], atol=1e-12)


TREES = ["hydrus", "dual_arm", "everything"]


def tree(name: str) -> Robot:
    """A robot that ships, or the one with nearly all keys of robot files."""
    path = Path(__file__).parents[1] / "robots" / f"{name}.toml"
    return read_robot(str(path) if path.exists() else name)[0]


def test_machine_of_a_tree_has_every_rotor_and_joint() -> None:
    robot = tree("everything")
    q = default_posture(robot)
    assert all(
        (low is None or value >= low) and (high is None or value <= high)
        for value, limits in (
            (q[place], robot.links[i - 1].limits)
            for place, i in zip(layout_of(robot).q.joint_places, robot.moving, strict=True)
        )
        for low, high in [(limits.low, limits.high)]
    )
    figure = machine_figure(robot, q)
    whole = figure.axes[0]
    assert arrows(whole, Z_AXIS) == arrows(whole, X_AXIS) == len(robot.moving)
    assert sum(arrows(axes, THRUST) for axes in figure.axes) == robot.rotors
    # From above the base is there once more.
    seen = [whole, *figure.axes[2:]]
    discs = [c for axes in seen for c in axes.collections if isinstance(c, Poly3DCollection)]
    assert sum(len(np.reshape(c._faces, (-1, 24, 3))) for c in discs) == robot.rotors
    (links,) = [line for line in whole.lines if line.get_marker() == "o"]
    ends = np.transpose(links.get_data_3d())
    joints = [frame.origin for frame in robot_frames(robot, q).links]
    assert all(np.isclose(ends, joint).all(axis=1).any() for joint in joints)


@pytest.mark.parametrize("name", TREES)
def test_chains_of_a_tree_show_what_the_decomposition_says(name: str) -> None:
    robot = tree(name)
    panels = [axes for axes in chains_figure(robot).axes if axes.get_title(loc="left")]
    for chain, axes in zip(decompose(robot), panels, strict=True):
        shown = texts(axes)
        assert (f"$\\theta_{{{chain.number},1}}$" in shown) == (robot.base.attitude != "quaternion")
        if len(chain.path) <= 4:
            moving = [i for i in chain.path if i in robot.moving]
            assert arrows(axes, TORQUE) == len(moving)
            assert bars(axes).count(DARK) == len(chain.own) + chain.has_core
        acting = {robot.thrusters[k - 1].on for k in chain.motors}
        assert arrows(axes, THRUST) == len(acting)


ARM = """
[[link]]
xyz = [0, 0, 0.1]
axis = "y"
length = 0.4
mass = 1
com = [0, 0, 0.3]
"""


@pytest.mark.parametrize(
    ("motion", "travel", "angles", "root", "moved"),
    [
        ('"fixed"', [], [], [], [0.1, 0.0, 0.1]),
        ('["x"]', ["$x$"], [], ["$x_{1}$"], [0.2, 0.0, 0.1]),
        (
            '["x", "z", "pitch"]',
            ["$(x, z)$"],
            [r"$\theta$"],
            ["$x_{1}$", "$z_{1}$"],
            [0.2, 0, 0.15],
        ),
        ('"planar"', ["$(x, y)$"], [r"$\psi$"], [r"$v_{1}$, $\omega_{1}$"], [0.2, 0.1, 0.1]),
    ],
)
def test_bases_are_drawn_where_they_are_with_what_moves(
    motion: str, travel: list[str], angles: list[str], root: list[str], moved: list[float]
) -> None:
    text = f'name = "based"\n[base]\nmotion = {motion}\nxyz = [0.1, 0, 0.1]\n{ARM}'
    robot = parse_robot(text)
    coordinates = {"x": 0.1, "y": 0.1, "z": 0.05, "theta_1": -0.4}
    q = [coordinates.get(name, 0.0) for name in layout_of(robot).q.names]
    (axes,) = machine_figure(robot, q).axes
    assert {"$X_0$", *travel, *angles} <= set(texts(axes))
    (links,) = [line for line in axes.lines if line.get_marker() == "o"]
    assert np.transpose(links.get_data_3d())[0] == pytest.approx(moved)
    figure = chains_figure(robot)
    shown = texts(figure.axes[0])
    assert set(root) <= set(shown)
    assert rf"$\theta_{{1,{len(q)}}}$, $\tau_{{1,{len(q)}}}$" in shown
    assert any(patch.get_hatch() for patch in figure.axes[0].patches) == (motion != '"planar"')


def test_an_arm_that_does_not_fly_stands_up_from_its_base() -> None:
    for turn, side in ((0, 1.0), (180, -1.0)):
        robot = parse_robot(
            f'name = "arm"\n[base]\nmotion = "fixed"\nrpy_deg = [{turn}, 0, 0]\n{ARM}'
        )
        tip = robot_frames(robot, default_posture(robot)).named["tip"].origin
        assert side * tip[2] > 0.2


def test_coordinates_of_another_number_are_refused() -> None:
    with pytest.raises(UsageError, match="9 coordinates"):
        machine_figure(PAPER, [0.0] * 8)


@pytest.mark.slow
def test_base_is_numbered_and_has_a_thrust_at_every_motor(paper: Figure) -> None:
    _, above, base = paper.axes
    common = {"$O_1$", "$O_2$", *"123456"}
    assert {*common, *(f"$F_{{{k}}}$" for k in range(1, 7))} <= set(texts(base))
    assert arrows(base, THRUST) == 6
    assert arrows(base, Z_AXIS) == 1
    # From above, thrusts along the line of sight would be points.
    assert {*common, *(f"$F_{{{k}}}$" for k in (2, 4, 6))} == set(texts(above))
    assert arrows(above, THRUST) == 3
    assert arrows(above, X_AXIS) == arrows(above, Y_AXIS) == 6


@pytest.mark.slow
def test_arm_has_the_frame_of_every_link(paper: Figure) -> None:
    whole, _, _ = paper.axes
    expected = {f"$x_{{{k}}}$" for k in (7, 8, 9)}
    expected |= {rf"$z_{{{k}}}$: $\theta_{{{k}}}$, $\tau_{{{k}}}$" for k in (7, 8, 9)}
    expected |= {"$X_0$", "$Y_0$", "$Z_0$", "$(x, y, z)$"}
    # Link 7 has no length: no place for its number.
    assert expected | {"$O_1$", "$O_2$", "tip", "8", "9"} == set(texts(whole))


def test_names_at_the_machine_can_be_read() -> None:
    assert_names_are_apart(machine_figure(read_robot("hydrus")[0]), smallest=9.0)


@pytest.mark.parametrize("name", ["quadrotor_2link", "octorotor_7link", "hexarotor"])
def test_every_chain_shows_what_the_decomposition_says(name: str) -> None:
    robot = read_robot(name)[0]
    panels = [axes for axes in chains_figure(robot).axes if axes.get_title(loc="left")]
    for chain, axes in zip(decompose(robot), panels, strict=True):
        j = chain.number
        shown = texts(axes)
        assert axes.get_title(loc="left") == f"chain {j}"
        assert {"−1", "0", "1"} <= set(shown)
        for item in (1, 2, 3):
            assert f"$\\theta_{{{j},{item}}}$" in shown
        assert (f"$F_{{{j},3}}$" in shown) == (1 in chain.motors)
        assert (f"$F_{{{j},5}}$" in shown) == chain.is_constrained
        assert (f"$\\tau′_{{{j},4}}$" in shown) == chain.is_constrained
        assert arrows(axes, CONSTRAINT) == chain.is_constrained
        assert arrows(axes, TORQUE) == (0 if chain.is_constrained else min(len(robot.links), 4))


@pytest.mark.slow
def test_mass_is_solid_once() -> None:
    """Arm 1 is filled in chain 1 and hollow in the others; arm 7 of the paper has no mass."""
    first, second, *_, last = chains_figure(PAPER).axes
    assert bars(first) == [DARK, GOLD]
    assert bars(second) == ["white", DARK]
    assert bars(last) == ["white", "white", DARK, DARK]


def bars(axes: Axes) -> list[str]:
    """Fillings of the links, in order."""
    return [line.get_color() for line in axes.lines if line.get_linewidth() == 3.6]


@pytest.mark.slow
def test_names_in_chains_can_be_read() -> None:
    assert_names_are_apart(chains_figure(read_robot("quadrotor_2link")[0]), smallest=9.0)


def test_arm_in_gold_is_explained() -> None:
    (legend,) = chains_figure(PAPER).legends
    keys = dict(zip((t.get_text() for t in legend.texts), legend.legend_handles, strict=True))
    gold = keys["base arm 2, mass counted"]
    assert isinstance(gold, Line2D)
    assert to_hex(gold.get_color()) == GOLD


@pytest.mark.slow
def test_angles_are_the_true_ones_even_where_arms_are_drawn_apart() -> None:
    shown = texts(chains_figure(paper_family(40, 0), [1, 20]).axes[0])
    assert "$\\theta_{1,4}$ = −171°" in shown


def test_many_rotors_and_links_are_left_out() -> None:
    panels = chains_figure(paper_family(40, 30)).axes
    assert [axes.get_title(loc="left") for axes in panels] == [
        f"chain {j}" for j in (1, 2, 3, 38, 39, 40)
    ]
    assert {"…", "41", "42", "43", "70"} <= set(texts(panels[-1]))


@pytest.mark.slow
def test_legend_fits_every_width() -> None:
    numbers = [5]
    figure = chains_figure(PAPER, numbers)
    figure.draw_without_rendering()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    low, high = box.p0, box.p1
    assert np.all(low >= 0.0)
    assert np.all(high <= figure.bbox.size)
    assert high[1] <= min(axes.get_window_extent().y0 for axes in figure.axes)


@pytest.mark.parametrize("numbers", [[0], [7], []])
def test_chains_that_do_not_exist_are_refused(numbers: list[int]) -> None:
    with pytest.raises(UsageError, match="chains 1 to 6"):
        chains_figure(PAPER, numbers)
