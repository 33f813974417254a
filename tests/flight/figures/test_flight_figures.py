"""Figures show the data of a flight, in the units they claim, for every kind of machine."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from support.emitted import emitted_module
from support.synthetic_flight import names, synthetic_flight

from gibbs_codegen import parse_robot, read_scenario, simulate
from gibbs_codegen.errors import OutputError
from gibbs_codegen.figures import FORMATS
from gibbs_codegen.flight.figures import flight as figures
from gibbs_codegen.flight.figures.animation import Film
from gibbs_codegen.flight.figures.curves import LOG_FLOOR, symbol
from gibbs_codegen.flight.record.extent import bounds
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.viewer.flight_view import flight_page
from gibbs_codegen.pipeline import generate
from gibbs_codegen.runtime.load import load

pytestmark = pytest.mark.usefixtures("derived_once")

Drawn = Callable[[Callable[[Flight], Figure], str], Figure]
Array = NDArray[Any]
Shipped = Callable[[str], ModuleType]
OWN_TESTS = ("snapshots", "snapshots_panels", "actuators", "battery", "outside", "estimates")
PLOTS = [draw for draw in figures.FIGURES if draw.__name__ not in OWN_TESTS]

TWO_ROTORS = """
name = "two_rotors"
[base]
rotors = 2
thrust = ["z", "z"]
arm = { length = 0.5, mass_per_length = 1.0, section_inertia = [1e-4, 1e-4, 1e-4] }
"""
SLIDING = """
name = "sliding"
[base]
rotors = 10
origin = "centre"
arm = { length = 0.5, mass_per_length = 1.0 }
[[link]]
length = 0.4
mass_per_length = 1.0
[[link]]
alpha_deg = 90
joint = "prismatic"
length = 0.5
mass_per_length = 1.0
"""


@pytest.fixture(scope="module")
def paper(shipped: Shipped) -> Flight:
    return synthetic_flight(shipped("hexarotor_3link"))


@pytest.fixture(scope="module")
def sliding(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return synthetic_flight(_own(SLIDING, tmp_path_factory.mktemp("sliding")))


@pytest.fixture(scope="module")
def flights(
    shipped: Shipped, paper: Flight, sliding: Flight, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Flight]:
    """One flight of every kind that a figure could stumble on."""
    still = synthetic_flight(shipped("hexarotor_3link"), error=0.0)
    gain = still.kinetic_energy + still.potential_energy
    wave = np.sin(np.add.outer(sliding.time, [0.0, 1.0]))
    pressed, across = np.maximum(wave, 0.0), np.multiply.outer(wave, [0.0, 0.3, 0.4])
    sliding = replace(
        sliding,
        contact_walls=np.array([1, 2]),
        contact_frames=("tip", "base"),
        contact_forces=pressed,
        contact_friction=across,
        contact_slip=np.where(across > 0.2, 1.0, 0.0),
        contact_depth=wave,
    )
    return {
        "paper": paper,
        "sliding": sliding,
        "level": replace(sliding, applied=0.0 * sliding.applied + 5.0),
        "no error": replace(still, work=gain - gain[0]),
        # With two rotors and no arm, and at once.
        "stopped": replace(
            synthetic_flight(_own(TWO_ROTORS, tmp_path_factory.mktemp("two")), samples=1),
            contact_walls=np.array([1]),
            contact_frames=("tip",),
            contact_forces=np.ones((1, 1)),
            contact_friction=np.zeros((1, 1, 3)),
            contact_slip=np.zeros((1, 1, 3)),
            contact_depth=np.ones((1, 1)),
            stopped="at t = 0 s: $5 of θ₀ is too_much " * 4,
        ),
    }


@pytest.fixture(scope="module")
def drawn(flights: dict[str, Flight]) -> Drawn:
    """A figure of a kind of flight, drawn once."""

    @functools.cache
    def figure(draw: Callable[[Flight], Figure], kind: str) -> Figure:
        return draw(flights[kind])

    return figure


def _own(text: str, folder: Path) -> ModuleType:
    (folder / "robot.toml").write_text(text, encoding="utf-8")
    return load(generate(folder / "robot.toml", folder, targets=("numpy",), verify=False))


def solid(axes: Any) -> list[Array]:
    return [line.get_ydata() for line in axes.get_lines() if line.get_linestyle() == "-"]


def dashed(axes: Any) -> list[Array]:
    return [line.get_ydata() for line in axes.get_lines() if line.get_linestyle() == "--"]


def panel(figure: Figure, label: str) -> Any:
    (axes,) = [axes for axes in figure.axes if axes.get_ylabel() == label]
    return axes


def colours(axes: Any) -> list[str]:
    return [line.get_color() for line in axes.get_lines() if line.get_linestyle() == "-"]


def legend_texts(axes: Any) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


KINDS = ["stopped"]


@pytest.mark.parametrize("kind", ["sliding", "stopped"])
@pytest.mark.parametrize("draw", [PLOTS[1], PLOTS[3], PLOTS[5]], ids=lambda draw: draw.__name__)
def test_axes_have_labels_with_units(
    drawn: Drawn, kind: str, draw: Callable[[Flight], Figure]
) -> None:
    figure = drawn(draw, kind)
    for axes in figure.axes:
        assert axes.get_ylabel().endswith(("(deg)", "(m)", "(rad)", "(N)", "(N m)", "(J)"))
        low, high = axes.get_ylim()
        values = np.concatenate([*solid(axes), *dashed(axes)])
        assert low <= np.nanmin(values) <= np.nanmax(values) <= high
    assert figure.axes[-1].get_xlabel() == "time (s)"


def test_contacts_are_the_flight_and_shaded_while_one_slides(drawn: Drawn) -> None:
    figure = drawn(figures.contacts, "sliding")
    wave = np.sin(np.linspace(0.0, 4.0 * np.pi, 121))
    assert np.allclose(solid(panel(figure, "normal force (N)"))[0], np.maximum(wave, 0.0))
    assert np.allclose(solid(panel(figure, "friction (N)"))[0], 0.5 * np.abs(wave))
    assert legend_texts(figure.axes[0]) == ["slides"]


@pytest.mark.parametrize("kind", KINDS)
def test_coordinates_are_the_flight(flights: dict[str, Flight], kind: str) -> None:
    still = flights[kind]
    # As if constrained angles had been integrated, and drifted.
    flight = replace(still, base_arm_angles=still.base_arm_angles + 1e-6)
    figure = figures.coordinates(flight)
    arms = panel(figure, "base arms (deg)")
    assert np.array_equal(solid(arms), np.degrees(flight.base_arm_angles.T))
    assert np.allclose(dashed(arms), np.degrees(flight.base_arm_angles_desired)[:, np.newaxis])
    others = [axes for axes in figure.axes if axes is not arms]
    factor = [np.degrees(1.0) if n.startswith("theta") else 1.0 for n in flight.coordinates]
    for pick, series in ((solid, flight.q), (dashed, flight.q_desired)):
        values = [each for axes in others for each in pick(axes)]
        # Panels put revolute joints before prismatic ones, as the robots here have them.
        assert np.allclose(values, (series * factor).T, rtol=1e-14)


def test_actuators_are_what_motors_and_servos_do(sliding: Flight) -> None:
    """Two throttles, of which one lags, a speed, servos of either kind, and the battery."""
    random = np.random.default_rng(2)
    sent = random.uniform(0.2, 0.9, (len(sliding.time), 12))
    state = random.uniform(0.2, 0.9, (len(sliding.time), 2))
    flight = replace(
        sliding,
        command_names=(
            *("throttle_1", "throttle_2", "speed_3", *sliding.input_names[3:10]),
            *(f"{name}_position" for name in sliding.coordinates[sliding.layout.q.joints]),
        ),
        command_units=("1", "1", "rad/s", *("N",) * 7, "rad", "m"),
        commands=sent,
        actuator_names=("throttle_2", "charge"),
        actuators=state,
    )
    figure = figures.actuators(flight)
    joints = flight.q[:, flight.layout.q.joints].T
    for label, actual, commanded in (
        ("throttle (%)", [100 * sent[:, 0], 100 * state[:, 0]], 100 * sent[:, :2].T),
        ("rotor speed (rad/s)", [sent[:, 2]], [sent[:, 2]]),
        ("servo position (deg)", [np.degrees(joints[0])], [np.degrees(sent[:, 10])]),
        ("servo position (m)", [joints[1]], [sent[:, 11]]),
    ):
        axes = panel(figure, label)
        np.testing.assert_allclose(solid(axes), actual)
        np.testing.assert_allclose(dashed(axes), commanded)
    assert len(figure.axes) == 4
    assert legend_texts(figure.axes[0]) == ["actual", "sent"]
    assert [axes.get_ylabel() for axes in figures.actuators(sliding).axes] == ["throttle (%)"]
    supply = np.tile([16.0, 5.0], (len(state), 1))
    charge, _, _, power = figures.battery(replace(flight, battery=supply)).axes
    np.testing.assert_allclose(solid(charge), [100 * state[:, 1]])
    np.testing.assert_allclose(solid(power), [[80.0] * len(state)])
    full = replace(flight, battery=supply, actuators=1.0 - 1e-4 * np.cumsum(state, axis=0))
    low, high = figures.battery(full).axes[0].get_ylim()
    assert 90.0 < low < 100.0 <= high < 100.5


@pytest.mark.slow
def test_panels_by_kind_of_joint(drawn: Drawn) -> None:
    def labels(kind: str) -> dict[str, str]:
        axes = drawn(figures.coordinates, kind).axes
        letters = {each.get_title(loc="left"): each.get_ylabel() for each in axes}
        return {letter: label for letter, label in letters.items() if letter}

    attitude = {"A": "attitude (deg)"}
    assert labels("paper") == {**attitude, "B": "joints (deg)", "C": "position of $O_1$ (m)"}
    assert labels("stopped") == {**attitude, "B": "position of $O_1$ (m)"}
    assert labels("sliding") == {
        **attitude,
        "B": "joints (deg)",
        "C": "joints (m)",
        "D": "position of $O_2$ (m)",
    }


@pytest.mark.slow
def test_constrained_angles_are_shown_where_they_drift(paper: Flight) -> None:
    drifting = replace(paper, base_arm_angles=paper.base_arm_angles + 1e-4)
    for flight, expected in ((paper, ["A", "B", "C"]), (drifting, ["A", "B", "C", "D"])):
        axes = figures.coordinates(flight).axes
        letters = [letter for each in axes if (letter := each.get_title(loc="left"))]
        assert letters == expected
        labels = [each.get_ylabel() for each in axes]
        assert ("base arms (deg)" in labels) == (flight is drifting)


@pytest.mark.slow
def test_flat_coordinates_have_axes_of_their_own(paper: Flight) -> None:
    """Roll and pitch beside a yaw of two turns; not what does not vary, nor what is not finite."""

    def parts(attitude: list[float], joints: list[float]) -> list[list[str]]:
        q = paper.q.copy()
        q[:, :6] = np.sin(paper.time)[:, np.newaxis] * (attitude + joints)
        q[-1, 2] = np.nan
        axes = figures.coordinates(replace(paper, q=q)).axes
        found = [names(each) for each in axes]
        return [[re.sub(r"[^-\d]", "", name) for name in each] for each in found[:-1]]

    assert parts([4.0, 0.3, 1.6], [1e-6, 0.0, 4.0]) == [["-1", "1"], ["0"], ["7", "8", "9"]]
    assert parts([1.0, 1.1, 4.0], [0.0, 0.1, 4.0]) == [["-1", "0", "1"], ["7", "8"], ["9"]]


@pytest.mark.slow
def test_parts_of_a_panel(drawn: Drawn) -> None:
    """Colours as if it were one, and times below the lowest only."""
    above, below, joints, *_ = drawn(figures.coordinates, "paper").axes
    assert [*colours(above), *colours(below)] == colours(joints)[:3]
    assert above.get_position().x1 == pytest.approx(joints.get_position().x1 - 0.5, abs=0.02)
    axes = drawn(figures.coordinates, "sliding").axes
    timed = [each.get_ylabel() for each in axes if each.get_xlabel()]
    assert timed[-1] == "position of $O_2$ (m)"


def test_desired_is_drawn_over_actual(drawn: Drawn) -> None:
    for axes in drawn(figures.coordinates, "paper").axes:
        below = [line for line in axes.get_lines() if line.get_linestyle() == "-"]
        above = [line for line in axes.get_lines() if line.get_linestyle() == "--"]
        assert min(line.zorder for line in above) > max(line.zorder for line in below)
        assert max(line.get_linewidth() for line in above) < below[0].get_linewidth()


def test_names_are_the_papers(drawn: Drawn) -> None:
    figure = drawn(figures.coordinates, "paper")
    assert names(figure.axes[0]) == [r"$\theta_{-1}$", r"$\theta_{0}$"]
    assert names(figure.axes[1]) == [r"$\theta_{1}$"]
    assert names(figure.axes[-1]) == ["$x$", "$y$", "$z$"]
    assert names(panel(drawn(figures.coordinates, "sliding"), "joints (m)")) == ["$d_{12}$"]
    assert names(drawn(figures.constraint_torques, "paper").axes[0])[0] == r"$\tau\prime_{2}$"


@pytest.mark.parametrize("draw", [figures.coordinates])
def test_names_do_not_meet(drawn: Drawn, draw: Callable[[Flight], Figure]) -> None:
    figure = drawn(draw, "sliding" if draw is figures.coordinates else "level")
    for axes in figure.axes:
        assert len(names(axes)) == len(solid(axes))
        heights = sorted(
            text.get_transform().transform(text.get_position())[1] * 72.0 / figure.dpi
            for text in axes.texts
        )
        assert np.all(np.diff(heights) > 9.0)


def test_long_names_keep_the_beginnings_of_their_words() -> None:
    assert symbol("F_rear") == "rear"
    assert symbol("tau_left_upper_arm") == "left_upper_arm"
    assert symbol("tau_right_upper_arm") == "righ_uppe_arm"
    assert symbol("F_a_b_c_d_e_f_g_h_i") == "a_b_c_d_e_f_g…"


@pytest.mark.slow
def test_figures_are_as_wide_as_wanted(paper: Flight) -> None:
    for draw in (figures.inputs, figures.constraint_torques, figures.tracking_error):
        assert draw(paper, width=6.5).get_figwidth() == 6.5


@pytest.mark.slow
def test_too_many_names_are_thinned(paper: Flight) -> None:
    shape = (len(paper.time), 16)
    torques = tuple(f"tau_prime_{k}" for k in range(2, 18))
    many = replace(paper, constraint_names=torques, constraint_torques=np.ones(shape))
    axes = figures.constraint_torques(many).axes[0]
    assert 4 < len(names(axes)) < 20
    assert len(solid(axes)) == 16


@pytest.mark.slow
def test_inputs_and_what_was_commanded(sliding: Flight, drawn: Drawn) -> None:
    """Rotors 1, 3 … of the paper lift, 2, 4 … push sideways."""
    figure = drawn(figures.inputs, "sliding")
    lift, sideways, torque, force = figure.axes
    labels = ["vertical thrust (N)", "sideways thrust (N)", "joint torque (N m)", "joint force (N)"]
    assert [axes.get_ylabel() for axes in figure.axes] == labels
    shown = {lift: range(0, 10, 2), sideways: range(1, 10, 2), torque: [10], force: [11]}
    for axes, places in shown.items():
        curves = [values for values in solid(axes) if len(values) == len(sliding.time)]
        assert np.array_equal(curves, sliding.applied[:, places].T)
    asked = np.array([values for values in dashed(lift) if len(values) == len(sliding.time)])
    cut = (sliding.applied != sliding.commanded)[:, :10:2].T
    assert cut.any()
    assert np.array_equal(np.isfinite(asked), cut)
    assert np.array_equal(asked[cut], sliding.commanded[:, :10:2].T[cut])
    assert legend_texts(lift) == ["applied", "commanded", "weight / 5"]
    obeyed = figures.inputs(replace(sliding, commanded=sliding.applied, weight=np.nan))
    assert obeyed.axes[0].get_legend() is None


@pytest.mark.slow
def test_inputs_of_tilted_rotors_are_in_one_panel(paper: Flight) -> None:
    tilted = np.tile([0.0, 0.6, 0.8], (6, 1))
    axes = figures.inputs(replace(paper, thrust_directions=tilted)).axes[0]
    assert axes.get_ylabel() == "thrust (N)"
    (share,) = [line for line in axes.get_lines() if len(line.get_ydata()) == 2]
    assert np.allclose(share.get_ydata(), paper.weight / (6 * 0.8))


@pytest.mark.slow
def test_bands_between_samples_and_limits(paper: Flight) -> None:
    limits = paper.input_limits.copy()
    limits[:, :6] = [[-3.0], [40.0]]
    peak = paper.applied_greatest.copy()
    peak[7, 2] = 33.0
    figure = figures.inputs(replace(paper, applied_greatest=peak, input_limits=limits))
    lift = figure.axes[0]
    assert len(lift.collections) == 3
    heights = [each.get_paths()[0].vertices[:, 1] for each in lift.collections]
    assert max(found.max() for found in heights) == 33.0
    assert min(found.min() for found in heights) == paper.applied_least[:, :6:2].min()
    drawn = {float(line.get_ydata()[0]) for line in lift.get_lines() if len(line.get_ydata()) == 2}
    assert {-3.0, 40.0} < drawn
    assert "limit" in legend_texts(lift)
    assert "limit" not in [line.get_label() for line in figure.axes[2].get_lines()]


def test_limits_of_some_inputs_have_their_colours(paper: Flight) -> None:
    limits = paper.input_limits.copy()
    limits[:, 6:] = [[-8.0, -8.0, -5.0], [8.0, 8.0, 5.0]]
    figure = figures.inputs(replace(paper, input_limits=limits))
    axes = figure.axes[-1]
    curves = [line for line in axes.get_lines() if len(line.get_ydata()) > 2]
    flown = [line.get_color() for line in curves if line.get_linestyle() == "-"]
    for limit, inputs in ((8.0, [0, 1]), (-8.0, [0, 1]), (5.0, [2])):
        drawn = [line for line in axes.get_lines() if list(line.get_ydata()) == [limit] * 2]
        assert [line.get_color() for line in drawn] == [flown[place] for place in inputs]
    assert "limit by colour" in legend_texts(figure.axes[0])
    assert "limit" not in legend_texts(figure.axes[0])


@pytest.mark.slow
def test_background_tells_when_frames_are_pushed(paper: Flight) -> None:
    """A push from sample 10 to 30; torques of spinning rotors, all the time, tell nothing."""
    wrenches = np.zeros((len(paper.time), 2, 6))
    wrenches[10:30, 0, 2] = 5.0
    wrenches[:, 1, 3] = 1.0
    pushed = replace(paper, frames=("base", "tip"), frame_wrenches=wrenches)
    axes = figures.inputs(pushed).axes[0]
    (span,) = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    assert span.get_x() == paper.time[10]
    assert np.isclose(span.get_x() + span.get_width(), paper.time[30])
    assert "external force" in legend_texts(axes)
    force, torque = figures.outside(pushed).axes
    assert np.array_equal(solid(force), [wrenches[:, 0, 2]])
    assert np.array_equal(solid(torque), [wrenches[:, 1, 3]])
    wrenches[:, 0] = [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]  # A steady wind.
    (span,) = figures.inputs(replace(pushed, frame_wrenches=wrenches)).axes[0].patches
    assert span.get_width() == pytest.approx(np.ptp(paper.time))


def test_figures_tell_when_constraints_hold(paper: Flight) -> None:
    forces = np.zeros((len(paper.time), 3))
    forces[20:40, 1] = 2.0
    axes = figures.inputs(replace(paper, hold_forces=forces)).axes[0]
    (span,) = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    assert span.get_x() == paper.time[20]
    assert "held" in legend_texts(axes)


@pytest.mark.slow
def test_gusts_are_told_in_a_wind_that_never_ceases(paper: Flight) -> None:
    wrenches = np.ones((len(paper.time), 1, 6))
    gust = paper.time[[10, 30]]
    blown = replace(paper, frames=("base",), frame_wrenches=wrenches, gusts=gust[np.newaxis])
    axes = figures.inputs(blown).axes[0]
    (span,) = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    assert span.get_x() == gust[0]


@pytest.mark.filterwarnings("error")
def test_long_names_and_every_key_leave_room_for_the_axes(paper: Flight) -> None:
    rotors = [f"F_{end}_{side}" for end in ("front", "rear") for side in ("left", "right")]
    names = (*rotors, "F_upper_left", "F_upper_right", *paper.input_names[6:])
    wrenches = np.zeros((len(paper.time), 1, 6))
    wrenches[10:30] = 5.0
    limits = paper.input_limits.copy()
    limits[:, :6] = [[-3.0], [40.0]]
    crowded = replace(
        paper, input_names=names, frames=("tip",), frame_wrenches=wrenches, input_limits=limits
    )
    figure = figures.inputs(crowded)
    axes = figure.axes[0]
    assert len(legend_texts(axes)) == 5
    box = axes.get_legend().get_window_extent()
    assert box.x0 >= 0.0
    assert max(box.x1, axes.get_window_extent().x1) <= figure.bbox.x1
    assert box.y1 <= figure.bbox.y1
    assert all(each.get_position().width >= 0.6 for each in figure.axes)


@pytest.mark.parametrize("draw", [figures.tracking_error, figures.inputs, figures.energy])
def test_texts_stay_in_the_figure_and_panels_below_its_heading(
    paper: Flight, draw: Callable[[Flight], Figure]
) -> None:
    away = (1.0 + np.linspace(0.0, 1.0, len(paper.time)))[:, np.newaxis]
    reason = "at t = 1 s the rotors cannot produce what is wanted of them. " * 9
    # Errors within a power of ten, numbers of four digits at the ends, and many lines above.
    flight = replace(paper, time=1e3 * paper.time, q_desired=paper.q + 2e-2 * away, stopped=reason)
    figure = draw(flight)
    figure.draw_without_rendering()
    assert figure._suptitle is not None
    lowest = figure._suptitle.get_window_extent().y0
    for axes in figure.axes:
        assert axes.bbox.height > 60.0
        assert axes.bbox.y1 < lowest
        name = axes.yaxis.label.get_window_extent()
        for axis in (axes.xaxis, axes.yaxis):
            for label in axis.get_ticklabels(which="both"):
                place = label.get_position()[axis is axes.yaxis]
                low, high = sorted(axis.get_view_interval())
                box = label.get_window_extent()
                if label.get_text() and low <= place <= high and label.get_visible():
                    assert box.x0 >= 0.0
                    assert box.x1 <= figure.bbox.x1
                    assert axis is axes.xaxis or box.x0 >= name.x1 - 1.0


def test_angles_that_hardly_vary_look_constant(paper: Flight) -> None:
    q = paper.q.copy()
    q[:, 3:6] = 1e-5 * np.sin(paper.time)[:, np.newaxis]
    still = replace(paper, q=q, q_desired=0.0 * q)
    low, high = panel(figures.coordinates(still), "joints (deg)").get_ylim()
    assert high - low == pytest.approx(0.1)


def test_constraint_torques_are_the_flight(paper: Flight, drawn: Drawn) -> None:
    (axes,) = drawn(figures.constraint_torques, "paper").axes
    assert np.array_equal(solid(axes), paper.constraint_torques.T)


@pytest.mark.slow
def test_tracking_error_by_unit(sliding: Flight, drawn: Drawn) -> None:
    linear, above, _, below = drawn(figures.tracking_error, "sliding").axes
    assert [line.get_yscale() for line in (linear, above)] == ["linear", "log"]
    assert np.array_equal(solid(linear), solid(above))
    error = np.abs(sliding.q - sliding.q_desired)
    assert np.array_equal(solid(above), [sliding.centre_error, sliding.tip_error, error[:, 4]])
    assert np.array_equal(solid(below)[0], error[:, :4].max(axis=1))
    assert np.array_equal(solid(below)[1], np.maximum(sliding.heading_error, LOG_FLOOR))
    free = figures.tracking_error(replace(sliding, tangent_arm=0)).axes[3]
    assert len(solid(free)) == 1


@pytest.mark.slow
def test_zeros_on_logarithmic_axes(drawn: Drawn) -> None:
    axes = [
        *drawn(figures.tracking_error, "no error").axes[1::2],
        drawn(figures.energy, "no error").axes[1],
    ]
    for each in axes:
        assert each.get_yscale() == "log"
        assert np.all(np.array(solid(each)) == LOG_FLOOR)
        low, high = each.get_ylim()
        assert 0.1 * LOG_FLOOR < low < LOG_FLOOR
        assert high >= 1e3 * LOG_FLOOR


def test_energy_and_its_balance(paper: Flight, drawn: Drawn) -> None:
    above, below = drawn(figures.energy, "paper").axes
    kinetic, potential, total = solid(above)
    assert np.array_equal(kinetic, paper.kinetic_energy - paper.kinetic_energy[0])
    assert np.array_equal(potential, paper.potential_energy - paper.potential_energy[0])
    assert np.array_equal(total, kinetic + potential)
    assert np.array_equal(dashed(above), [paper.work])
    assert np.array_equal(solid(below)[0], np.maximum(np.abs(paper.energy_error), LOG_FLOOR))


@pytest.mark.slow
def test_heading_says_why_it_stopped(drawn: Drawn) -> None:
    assert drawn(figures.energy, "paper").get_suptitle() == "hexarotor_3link, synthetic"
    for draw in PLOTS:
        heading = drawn(draw, "stopped").get_suptitle()
        assert "stopped at t = 0 s: $5 of θ₀ is too_much" in heading


_BEGINNINGS = {".pdf": b"%PDF", ".png": b"\x89PNG", ".svg": b"<?xml"}


@pytest.mark.slow
def test_files_in_order_and_twice_the_same(
    paper: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "FIGURES", (figures.constraint_torques,))
    written = figures.write_figures(paper, tmp_path / "new" / "once", FORMATS)
    names = [f"constraint_torques.{suffix}" for suffix in FORMATS]
    assert [path.name for path in written] == names
    again = figures.write_figures(paper, tmp_path / "twice", FORMATS[::-1])
    for path, other in zip(written, again[::-1], strict=True):
        content = path.read_bytes()
        assert content.startswith(_BEGINNINGS[path.suffix])
        assert b"CreationDate" not in content
        assert content == other.read_bytes()


def test_folder_that_is_a_file(paper: Flight, tmp_path: Path) -> None:
    (tmp_path / "taken").touch()
    with pytest.raises(OutputError, match="taken: cannot hold the figures: "):
        figures.write_figures(paper, tmp_path / "taken")


@pytest.mark.slow
def test_users_style_is_left_alone_and_not_used(paper: Flight) -> None:
    with mpl.rc_context({"font.size": 30, "axes.grid": False}):
        figure = figures.energy(paper)
        assert mpl.rcParams["font.size"] == 30
    assert figure.axes[0].yaxis.label.get_fontsize() == 9


GROUND = """
name = "on_the_ground"
[base]
motion = {}
mass = 1
inertia = [0.1, 0.1, 0.1, 0, 0, 0]
[[link]]
name = "pole"
xyz = [0, 0, 0]
axis = "y"
length = 0.5
mass = 1
com = [0.5, 0, 0]
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motion", "panels", "led"),
    [
        ('"fixed"', ["joints (deg)"], ["tip"]),
        ('["x"]', ["joints (deg)", "travel of the base (m)"], ["base centre", "tip"]),
        ('["yaw"]', ["attitude (deg)", "joints (deg)"], ["base centre", "tip"]),
    ],
)
def test_what_does_not_move_is_not_drawn(motion: str, panels: list[str], led: list[str]) -> None:
    module = emitted_module(parse_robot(GROUND.format(motion)))
    falling = {"name": "falling", "duration": 0.3, "control": {"law": "off"}}
    flight = simulate(module, read_scenario(falling))
    assert [axes.get_ylabel() for axes in figures.coordinates(flight).axes] == panels
    (key,) = figures.snapshots(flight).legends
    assert [text.get_text() for text in key.texts] == [*led, "desired", "arm"]
    film = Film(flight)
    film.show(len(flight.time) - 1)
    (key,) = film.figure.legends
    assert "thrust" not in [text.get_text() for text in key.texts]
    shown = figures.tracking_error(flight).axes
    assert shown[0].get_legend().texts[0].get_text() == led[0]
    # The scene is as large as the pole and its way.
    low, high = bounds(flight)
    assert np.all(high - low <= 1.2)
    page = flight_page(flight).text
    assert ("path of the base centre" in page) == ("base centre" in led)
