"""What the viewer computes of a robot at rest, and the pattern as a picture."""

from __future__ import annotations

import re
from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.emitted import emitted_module

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.viewer import robot_view
from gibbs_codegen.flight.viewer.machine import (
    LOADED,
    RELAXED,
    DrawnMachine,
    changed,
    mixed,
    rgb,
)
from gibbs_codegen.flight.viewer.page import empty_server
from gibbs_codegen.flight.viewer.robot_view import (
    RobotScene,
    Sliders,
    _digits,
    numbers,
    pattern_svg,
    swings,
    symbol,
)
from gibbs_codegen.robot.file import parse_robot

Shipped = Callable[[str], ModuleType]


@pytest.mark.parametrize("name", ["hexarotor_3link", "quadrotor"])
def test_the_inputs_that_hold_a_robot_hold_it(name: str, shipped: Shipped) -> None:
    machine = DrawnMachine(shipped(name))
    q = machine.coordinates(machine.start())
    state = machine.state(q, machine.hover(q))
    assert state.is_still
    lifted = q.copy()
    lifted[machine.vehicle.layout.q.position.start + 2] += 1.0
    energy = machine.vehicle.potential_energy
    thrusts = state.u[: len(state.directions)]
    assert state.directions.T @ thrusts == pytest.approx([0, 0, energy(lifted) - energy(q)])
    assert not machine.state(q, 1.1 * state.u).is_still


def test_controls_of_a_quaternion_are_roll_pitch_and_yaw(shipped: Shipped) -> None:
    machine = DrawnMachine(shipped("quadrotor"))
    labels, ends = machine.controls(2.0)
    assert labels == ["roll, rad", "pitch, rad", "yaw, rad", "x, m", "y, m", "z, m"]
    assert ends[:, 3:] == pytest.approx(np.outer([-1, 1], [2, 2, 2]))
    q = machine.coordinates(np.array([0.3, -0.5, 1.1, 1.0, 2.0, 3.0]))
    wanted = Rotation.from_rotvec([0, 0, 1.1]) * Rotation.from_rotvec([0, -0.5, 0])
    wanted *= Rotation.from_rotvec([0.3, 0, 0])
    assert machine.vehicle.base_rotation(q) == pytest.approx(wanted.as_matrix())
    assert machine.state(q, machine.hover(q)).points[0] == pytest.approx([1, 2, 3])


def test_efforts_colour_the_links_that_they_move_not_those_that_gears_do() -> None:
    text = 'name = "bent"\n[base]\nmotion = "fixed"\n'
    for name, rest in (("a", ""), ("b", 'gear = { of = "a", ratio = -1 }\n'), ("c", "")):
        rod = "length = 0.5\nmass_per_length = 1.0\n"
        text += f'[[link]]\nname = "{name}"\n{rod}{rest}'
    machine = DrawnMachine(emitted_module(parse_robot(text)))
    with empty_server() as server:
        scene = RobotScene(server, machine, machine.coordinates(machine.start()), live=False)
        scene.machine.efforts["N m"], efforts, none = 1.0, np.array([0.0, 1.0]), np.zeros((0, 3))
        points, wheels = machine.vehicle.positions(np.zeros(2)), np.zeros((0, 2, 3))
        scene.machine.show(points, none, none[:, 0], efforts, none, none, wheels)
        colours = scene.machine.rods.node.batched_colors
    assert (colours == rgb(LOADED)).all(axis=1).tolist() == [False, False, False, True]


CRAFT = """
name = "craft"
[base]
motion = {}
mass = 1
inertia = [0.01, 0.01, 0.01, 0, 0, 0]
[[link]]
xyz = [0, 0, 0.1]
axis = "y"
mass = 0.2
com = [0, 0, 0.3]
"""
ROTORS = "[[rotor]]\nposition = [{}, 0, 0]\n"


@pytest.mark.parametrize(
    ("motion", "labels", "rotors"),
    [
        ('"fixed"', ["theta_1, rad"], []),
        ('["x", "z", "pitch"]', ["pitch, rad", "theta_3, rad", "x, m", "z, m"], [0.2, -0.2]),
        ('"planar"', ["yaw, rad", "theta_1, rad", "x, m", "y, m"], []),
    ],
)
def test_sliders_are_of_what_moves(motion: str, labels: list[str], rotors: list[float]) -> None:
    text = CRAFT.format(motion) + "".join(map(ROTORS.format, rotors))
    machine = DrawnMachine(emitted_module(parse_robot(text)))
    assert machine.controls(1.0)[0] == labels
    controls = 0.1 + 0.2 * np.arange(len(labels))
    q = machine.coordinates(controls)
    named = dict(zip(machine.vehicle.coordinates, q, strict=True))
    assert [named[label.split(",")[0]] for label in labels] == controls.tolist()
    state = machine.state(q, machine.hover(q))
    assert state.is_still == (not rotors)  # Two rotors hold no machine that leans.
    pitch = named.get("pitch", 0.0)
    assert state.directions == pytest.approx(
        np.tile([np.sin(pitch), 0, np.cos(pitch)], (len(rotors), 1))
    )
    assert len(swings(machine, machine.start(), 0.1, 2)) == 2 * len(labels)


def test_no_posture_fills_an_entry_that_the_pattern_leaves_blank(shipped: Shipped) -> None:
    machine = DrawnMachine(shipped("hexarotor_3link"))
    filled, generator = machine.pattern(), np.random.default_rng(7)
    for _ in range(5):
        system = machine.hybrid_system(machine.coordinates(generator.uniform(-2.0, 2.0, 9)))
        assert not np.any(changed(system, np.zeros((1, 1))) & ~filled)
    # Fig. 7: the rows of τ′ hold one unknown each, and gravity does not act along x and y.
    assert np.array_equal(filled[-5:].sum(axis=1), np.ones(5))
    assert filled[11:14, 19].tolist() == [False, False, True]


def test_a_singular_attitude_has_no_finite_condition(shipped: Shipped) -> None:
    machine = DrawnMachine(shipped("hexarotor_3link"))
    controls = machine.start()
    controls[1] = np.pi / 2
    q = machine.coordinates(controls)
    assert min(machine.state(q, machine.hover(q)).conditions) > 1e12


def test_what_has_no_digits_is_told_apart() -> None:
    told = [_digits(value) for value in (np.nan, np.inf, -np.inf, -1e13, 1e-12, 2.0 / 3.0)]
    assert told == ["undetermined", "∞", "-∞", "-∞", "0", "0.6667"]


@pytest.mark.parametrize(
    ("name", "label"), [("hexarotor_3link", "acceleration of x"), ("quadrotor", "rate of vx")]
)
def test_entries_of_a_are_called_what_they_are(name: str, label: str, shipped: Shipped) -> None:
    machine = DrawnMachine(shipped(name))
    q = machine.coordinates(machine.start())
    state = machine.state(q, machine.hover(q))
    assert f"<td>{label}</td>" in numbers(machine, state, is_held=True, remarks=[])


def test_sliders_keep_the_limits_of_the_file_though_they_are_equal_or_exceeded() -> None:
    with empty_server() as server:
        limits = np.array([[0.3, 0.0], [0.3, 20.0]])
        sliders = Sliders(server.gui, ["fixed", "thrust"], limits, np.array([0.3, 25.0]))
        assert [(each.min, each.max) for each in sliders._sliders] == [(0.3, 0.3), (0.0, 20.0)]
        assert [each.disabled for each in sliders._sliders] == [True, False]
        assert sliders.values.tolist() == [0.3, 25.0]
        assert not sliders.moved


def test_inputs_beyond_their_limits_are_named(shipped: Shipped) -> None:
    machine = DrawnMachine(shipped("quadrotor"))
    name, high = machine.vehicle.inputs[1], machine.input_limits[1]
    assert np.isfinite(high).all()
    assert machine.beyond(high) == []
    (told,) = machine.beyond(high + np.array([0.0, 1.0, 0.0, 0.0]))
    assert told.startswith(f"{name} = ")


def test_rejected_parameters_leave_those_before(shipped: Shipped) -> None:
    machine = DrawnMachine(shipped("hexarotor_3link"))
    machine.set_parameters({"gravity": 5.0})
    q = machine.coordinates(machine.start())
    before = machine.hover(q)
    with pytest.raises(UsageError, match="link2_length"):
        machine.set_parameters({"link2_length": float("nan")})
    assert np.array_equal(machine.hover(q), before)
    machine.set_parameters({})
    assert machine.hover(q) == pytest.approx(9.81 / 5.0 * before)


def test_the_pattern_has_a_cell_for_each_entry_and_lights_those_that_it_is_told() -> None:
    filled = np.array([[True, False, True, True], [False, True, False, False]])
    lit = np.array([[False, False, True, False], [False, False, False, False]])
    drawn = pattern_svg(["theta_m1", "tau_prime_2"], filled, lit)
    plain, bright = re.findall(r'<path[^>]*?d="([^"]*)"', drawn)
    assert (plain.count("M"), bright.count("M")) == (3, 1)
    assert "θ₋₁" in drawn
    assert "τ′₂" in drawn
    assert symbol("a_long_name") == "a_long_name"
    assert "&lt;a_very_…" in pattern_svg(["x", "<a_very_long_name>"], filled, lit)


def test_the_floor_is_below_robots_that_fly_by_a_share_of_their_size(
    shipped: Shipped, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, floors = DrawnMachine(shipped("quadrotor")), []
    monkeypatch.setattr(robot_view, "set_stage", lambda *stage: floors.append(stage[2]))
    q = machine.coordinates(machine.start())
    with empty_server() as server:
        scene = RobotScene(server, machine, q, live=False)
    lowest = machine.vehicle.positions(q)[:, 2].min()
    assert floors == pytest.approx([lowest - 0.2 * scene.machine.size])


def test_rods_redden_with_the_effort() -> None:
    colours = mixed(np.array([0.0, 1.0, 7.0]))
    assert [bytes(colour).hex() for colour in colours] == [RELAXED[1:], LOADED[1:], LOADED[1:]]
