"""Motions of machines whose bases do not move freely, by closed forms and by free robots."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipk
from support.emitted import emitted_module
from support.machines import PAIR, link, rod

from gibbs_codegen import (
    UsageError,
    generate,
    load,
    lqr,
    parse_robot,
    read_log,
    read_scenario,
    simulate,
    simulate_many,
    trim,
    write_log,
)
from gibbs_codegen.flight.logs.motion import base_motion
from gibbs_codegen.runtime.predictive import DERIVATIVES

EXACT = {"integration.relative_tolerance": 1e-12, "integration.absolute_tolerance": 1e-13}
GRAVITY = 9.81
ROD = rod("rod", "y", [0, 0, 0], 0.5, 2.0)
ARM = (
    link("turn", "z", [0, 0, 0.1], 1, [0, 0, 0], [0.01, 0.01, 0.01], length=0)
    + rod("shoulder", "y", [0, 0, 0], 0.5, 2)
    + rod("elbow", "y", [0.5, 0, 0], 0.4, 1)
)
# Four rotors that command forces along x, y and z, and a moment about z, and others.
ROTORS = "".join(
    f"[[rotor]]\nposition = {place}\ndirection = {direction}\n"
    for place, direction in (
        ([0.3, 0, 0], [0, 0.5, 1]),
        ([0, 0.3, 0], [-0.5, 0, 1]),
        ([-0.3, 0, 0], [0, 0.5, 1]),
        ([0, -0.3, 0], [-0.5, 0.2, 1]),
    )
)


def machine(name: str, motion: str, others: str, pose: str = "") -> ModuleType:
    """The NumPy module of a robot whose base has such a motion, a line of its file."""
    base = f"[base]\nmass = 1.5\ninertia = [0.02, 0.02, 0.03, 0, 0, 0]\n{motion}\n{pose}\n"
    return emitted_module(parse_robot(f'name = "{name}"\n{base}{others}'), "default")


def flown(module: ModuleType, duration: float, exact: bool = True, **tables: Any) -> Any:
    """A flight by tables of a scenario, which does not end early."""
    scenario = {"name": "motion", "duration": duration, **tables}
    flight = simulate(module, read_scenario(scenario, EXACT if exact else None))
    assert not flight.stopped
    return flight


def line(start: list[float], end: list[float]) -> dict[str, Any]:
    """The table of a path that goes from one place to another within 0.8 s."""
    return {"kind": "line", "start": start, "end": end, "duration": 0.8}


def ceiling_arm() -> ModuleType:
    return machine("ceiling_arm", 'motion = "fixed"', ARM, "xyz = [0, 0, 1]\nrpy_deg = [180, 0, 0]")


def test_a_pendulum_on_a_wall_falls_as_by_elliptic_functions() -> None:
    module = machine("wall_pendulum", 'motion = "fixed"', ROD, "xyz = [0, 0, 1]")
    # The rod hangs where its angle about y is 90°.
    begin = np.radians(70.0)
    flight = flown(module, 3.0, control={"law": "off"}, arm={"posture_deg": {"rod": 20}})
    frequency = np.sqrt(1.5 * GRAVITY / 0.5)
    modulus = np.sin(0.5 * begin)
    sine = ellipj(ellipk(modulus**2) - frequency * flight.time, modulus**2)[0]
    swung = 2.0 * np.arcsin(modulus * sine)
    np.testing.assert_allclose(flight.q[:, 0], 0.5 * np.pi - swung, atol=2e-9)
    assert flight.q.shape[1] == flight.commanded.shape[1] == 1
    held = trim(module, posture_deg={"rod": 20})
    np.testing.assert_allclose(held.u, -GRAVITY * 0.25 * np.cos(np.radians(20)), rtol=1e-12)


@pytest.mark.slow  # 1 to 3 s each
@pytest.mark.parametrize(
    "motion", ['"planar"', '"upright"', '["z", "x", "pitch"]', '["yaw", "roll"]']
)
def test_energy_stays_where_nothing_acts(motion: str) -> None:
    module = machine("falling", f"motion = {motion}", ARM, "rpy_deg = [0, 20, 0]")
    tables = {"control": {"law": "off"}, "arm": {"posture_deg": {"shoulder": 40, "elbow": 70}}}
    flight = flown(module, 5.0, **tables)
    energy = flight.kinetic_energy + flight.potential_energy
    assert np.ptp(energy) < 1e-8 * (1.0 + np.abs(energy).max())
    assert np.abs(flight.energy_error).max() < 1e-7 * (1.0 + np.abs(energy).max())


@pytest.mark.parametrize(
    ("motion", "end", "turn"),
    [
        ('"upright"', [0.4, 0.2, 0.7], {"heading_deg": 20, "rate_deg": 40}),
        ('"planar"', [0.4, 0.2, 0.2], {"heading_deg": -20, "rate_deg": 60}),
        ('["x"]', [0.4, 0, 0.2], {}),
    ],
)
def test_errors_decay_as_gains_say(motion: str, end: list[float], turn: dict[str, float]) -> None:
    module = machine("driven", f"motion = {motion}", ROTORS + ROD, "xyz = [0.1, 0, 0.2]")
    off = np.array([0.05, 0.02, 0.01])[: {"u": 3, "p": 2, "x": 1}[motion.strip('["')[0]]]
    flight = flown(
        module,
        1.0,
        base={"path": line([0.1, 0, 0.2], end), "attitude": turn},
        arm={"moves_deg": {"rod": [{"to": 50, "duration": 0.8}]}},
        start={"offset": [*off, *[0.0] * (3 - len(off))]},
        control={"frequency": 5.0, "damping_ratio": 1.0},
    )
    assert flight.law == "computed_torque"
    decay = (1.0 + 5.0 * flight.time) * np.exp(-5.0 * flight.time)
    error = flight.centre_desired - flight.positions[:, flight.points.index(flight.centre)]
    np.testing.assert_allclose(error[:, : len(off)], -np.outer(decay, off), atol=1e-8)
    np.testing.assert_allclose(flight.q[:, -1], flight.q_desired[:, -1], atol=1e-8)


def test_a_base_with_two_angles_starts_turned_by_both() -> None:
    module = machine("falling", 'motion = ["yaw", "roll"]', ARM, "rpy_deg = [0, 20, 0]")
    flight = flown(module, 0.01, control={"law": "off"}, start={"turn_deg": [10, 0, 20]})
    np.testing.assert_allclose(np.degrees(flight.q[0, :2]), [20.0, 10.0], rtol=1e-12)
    with pytest.raises(UsageError, match=r"start\.turn_deg: .* rad about y from where"):
        flown(module, 0.01, control={"law": "off"}, start={"turn_deg": [10, 5, 20]})


def test_logs_tell_the_frame_of_a_base_in_its_pose(tmp_path: Path) -> None:
    pose = "xyz = [0.5, 0, 1]\nrpy_deg = [0, 30, 20]"
    module = machine("leaning", 'motion = "upright"', ROTORS + ROD, pose)
    path = {"path": line([0.5, 0, 1], [0.9, 0.2, 1.3]), "attitude": {"rate_deg": 40}}
    flight = flown(module, 0.4, base=path, arm={"moves_deg": {"rod": [{"to": 9, "duration": 1}]}})
    base, poses = base_motion(flight), module.frame_poses(flight.q)[:, 0]
    np.testing.assert_allclose(base.position, poses[:, :3, 3], atol=1e-14)
    axes = Rotation.from_quat(base.quaternion).as_matrix()
    np.testing.assert_allclose(axes, poses[:, :3, :3], atol=1e-14)
    linear, spin = np.split(module.frame_velocities(flight.q, flight.v)[:, 0], 2, axis=-1)
    for told, world in ((base.velocity, linear), (base.spin, spin)):
        np.testing.assert_allclose((axes @ told[..., None])[..., 0], world, atol=1e-13)
    thrust = np.array([0.0, 0.5, 1.0]) / np.hypot(0.5, 1.0)
    np.testing.assert_allclose(flight.thrust_directions[0], thrust, atol=1e-13)
    write_log(flight, tmp_path / "log", "csv")
    again = read_log(module, tmp_path / "log")
    np.testing.assert_allclose(again.q, flight.q, atol=1e-9)
    np.testing.assert_allclose(again.v, flight.v, atol=1e-9)


@pytest.mark.slow  # 2 s
def test_a_planar_machine_moves_as_a_free_one_in_the_plane() -> None:
    tables = {
        "control": {"law": "off"},
        "arm": {"posture_deg": {"rod": 30}},
        "push": {"frame": "tip", "force": [1.0, 0.0, 4.0], "torque": [0.0, 0.2, 0.0]},
        "payload": [{"frame": "tip", "mass": 0.2, "begin": 0.3}],
    }
    planar = flown(machine("in_plane", 'motion = ["x", "z", "pitch"]', PAIR + ROD), 1.0, **tables)
    free = flown(machine("free_in_plane", 'attitude = "yxz"', PAIR + ROD), 1.0, **tables)
    places = [free.coordinates.index(name) for name in ("x", "z", "theta_m1", "rod")]
    np.testing.assert_allclose(planar.q, free.q[:, places], atol=1e-9)
    assert np.abs(np.delete(free.q, places, axis=1)).max() < 1e-12
    np.testing.assert_allclose(planar.potential_energy, free.potential_energy, atol=1e-9)


@pytest.mark.slow  # 20 s
def test_a_planar_quadrotor_leans_to_its_path() -> None:
    module = machine("planar_quadrotor", 'motion = ["x", "z", "pitch"]', PAIR + ROD)
    flight = flown(
        module,
        4.0,
        exact=False,
        integration={"method": "rk4", "step": 0.01},
        base={"path": {"kind": "line", "start": [0, 0, 1], "end": [1, 0, 1.5], "duration": 2.0}},
        arm={"posture_deg": {"rod": 60}},
        start={"offset": [0.1, 0, 0.05], "turn_deg": [0, 5, 0]},
    )
    assert flight.law == "geometric"
    assert flight.centre_error[-1] < 1e-4
    # Thrusts at the end are those of hover: the moment that the arm makes is theirs alone.
    hover = trim(module, posture_deg={"rod": 60})
    np.testing.assert_allclose(flight.applied[-1], hover.u, atol=0.05)


@pytest.mark.slow  # 8 s
def test_an_arm_on_the_ceiling_follows_its_path_and_pushes_as_hard_as_asked() -> None:
    module = ceiling_arm()
    circle = {"kind": "circle", "centre": [0.5, 0, 0.6], "radius": 0.1, "period": 2.0}
    flight = flown(module, 1.0, arm={"tip": circle})
    assert flight.tip_error.max() < 1e-8
    wall = {"kind": "plane", "point": [0.601, 0, 0], "normal": [-1, 0, 0], "frame": "tip"}
    pressed = flown(
        module,
        3.0,
        exact=False,
        arm={"tip": {"kind": "fixed", "position": [0.6, 0, 0.5]}},
        control={
            "law": "force",
            "force": {"direction": [1, 0, 0], "value": 10, "begin": 0.3, "rise": 0.2},
        },
        wall=[{**wall, "stiffness": 2e4, "damping": 50}],
    )
    assert abs(pressed.wall_forces[-1, 0] - 10.0) < 0.01
    # Pushed by 3 N, the tip yields to where springs of 200 N/m hold it.
    yielded = flown(
        module,
        3.0,
        exact=False,
        arm={"tip": {"kind": "fixed", "position": [0.6, 0, 0.5]}},
        control={"law": "impedance", "impedance": {"stiffness": [200, 200, 200]}},
        push={"frame": "tip", "force": [0, 3, 0]},
    )
    np.testing.assert_allclose(yielded.tip_error[-1], 0.015, rtol=1e-4)


def test_an_arm_in_a_plane_yields_there_as_a_body_on_springs() -> None:
    module = machine("plane_arm", 'motion = "fixed"', "[[link]]" + ARM.split("[[link]]", 2)[2])
    pull, rate = np.array([3.0, 7.0, -2.0]), 10.0
    impedance = {"inertia": [1] * 3, "stiffness": [rate**2] * 3, "damping": [2 * rate] * 3}
    flight = flown(
        module,
        0.5,
        arm={"posture_deg": {"shoulder": 20, "elbow": 60}},
        control={"law": "impedance", "impedance": impedance},
        push={"frame": "tip", "force": pull.tolist()},
    )
    grown = 1.0 - (1.0 + rate * flight.time) * np.exp(-rate * flight.time)
    tip = module.frame_poses(flight.q)[:, module.FRAMES.index("tip"), :3, 3]
    moved = np.outer(grown, pull * [1, 0, 1]) / rate**2
    np.testing.assert_allclose(tip - tip[0], moved, atol=1e-9)


@pytest.mark.slow  # 30 s, most of it derivatives and C
def test_a_cart_balances_its_pole_by_feedback_and_by_prediction(tmp_path: Path) -> None:
    wanted = {"derivatives": [*DERIVATIVES], "verify": False}
    module = load(generate("cart_pole", tmp_path, **wanted), "c")
    # Nothing drives the pole.
    gain = lqr(module, trim(module), Q=[10.0, 10.0, 1.0, 1.0], R=[[0.1, 0.05], [0.05, 1.0]]).gain
    assert not gain[1].any()
    tables = {"arm": {"posture_deg": {"pole": 4}}, "control": {"rate": 500}}

    def feedback(now: Any) -> Any:
        return [-gain[0] @ np.concatenate([now.q, now.v]), 0.0]

    scenario = {"name": "balance", "duration": 6.0, **tables}
    flight = simulate(module, scenario, feedback)
    assert not flight.stopped
    assert np.abs(flight.q[-1]).max() < 5e-3
    moves = {"posture_deg": {"pole": 0}, "moves": {"cart": [{"to": 0.3, "duration": 2.0}]}}
    planned = {"name": "plan", "duration": 6.0, "arm": moves, "control": {"law": "predictive"}}
    flight = simulate(module, planned)
    assert not flight.stopped
    np.testing.assert_allclose(flight.q[-1], [0.3, 0.0], atol=5e-3)


@pytest.mark.slow  # 15 s, most of it C
@pytest.mark.parametrize("robot", ["planar_quadrotor_arm", "ur5e"])
def test_compiled_and_many_flights_are_those_of_numpy(robot: str, tmp_path: Path) -> None:
    folder = generate(robot, tmp_path, verify=False)
    rk4 = {"method": "rk4", "step": 0.005, "rate": 50}
    scenario = {"name": "moves", "duration": 0.5, "integration": rk4}
    joint = {"planar_quadrotor_arm": "upper_arm", "ur5e": "elbow_joint"}[robot]
    scenario["arm"] = {"moves_deg": {joint: [{"to": 30, "duration": 0.5}]}}
    slow, fast = (simulate(load(folder, backend), scenario) for backend in ("numpy", "c"))
    np.testing.assert_allclose(fast.q, slow.q, atol=1e-10)
    np.testing.assert_allclose(fast.applied, slow.applied, atol=1e-7)
    for flight in simulate_many(load(folder, "c"), [scenario, scenario]):
        np.testing.assert_allclose(flight.q, slow.q, atol=1e-10)
    write_log(fast, tmp_path / "log", "csv")
    np.testing.assert_allclose(read_log(folder, tmp_path / "log").q[-1], fast.q[-1], atol=1e-6)


def test_what_a_base_cannot_do_is_refused_in_words() -> None:
    cart = machine("cart", 'motion = ["x"]', ROTORS + ROD, "xyz = [0, 0, 0.2]")
    for tables, words in (
        (
            {"base": {"path": line([0, 0, 0.2], [1, 0.5, 0.2])}},
            r"base\.path: at t = 0\.8 s .* 0\.5 m along y .* moves along x only; "
            "leave it out of the scenario 'beyond', or fly the scenario hold",
        ),
        (
            {"base": {"attitude": {"heading_deg": 10}}},
            r"base\.attitude: .* about z .* does not turn",
        ),
        ({"start": {"offset": [0, 0, 0.1]}}, r"start\.offset: .* 0\.1 m along z .* only$"),
        ({"base": {"path": line([0, 0, 0.1], [1, 0, 0.1])}}, r"-0\.1 m along z"),
        ({"control": {"law": "impedance"}}, r"t = 0 s the robot cannot move tip along \[0, 0, 1\]"),
        (
            {
                "arm": {"posture_deg": {"rod": 20}},
                "control": {"law": "force", "force": {"direction": [0, 3, 4], "value": 1}},
            },
            r"control\.force\.direction: cart can never move tip along \[0, 1, 0\]; give a",
        ),
    ):
        with pytest.raises(UsageError, match=words):
            simulate(cart, {"name": "beyond", "duration": 1.0, **tables})
    bare = machine("bare_cart", 'motion = ["x"]', ROD)
    with pytest.raises(UsageError, match=r"bare_cart: .*force along x"):
        simulate(bare, {"name": "beyond", "duration": 1.0})
    weightless = emitted_module(
        parse_robot(f'name = "weightless"\ngravity = 0\n[base]\nmotion = "fixed"\nmass = 1\n{ARM}')
    )
    with pytest.raises(UsageError, match=r"control\.impedance\.inertia: .* mass of weightless"):
        simulate(weightless, {"name": "x", "duration": 1.0, "control": {"law": "impedance"}})
