"""Flights of a robot with motors, servos and a battery, against the functions of its module."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from support.actuated import TEXT, air, by_rates

import gibbs_codegen
from gibbs_codegen import Simulation, generate, load, rollout, simulate, simulate_many
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.control.observation import Observation
from gibbs_codegen.flight.record.flight import read_flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import Settings
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import flight_start
from gibbs_codegen.robot.text import robot_text

Array = NDArray[np.float64]
ROBOTS = Path(gibbs_codegen.__file__).parent / "robots"
# Where dry friction is smooth about rest, the wrist is stiff.
RK4 = {"method": "rk4", "step": 2e-4}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the robot's module."""
    base = tmp_path_factory.mktemp("actuated")
    (base / "actuated.toml").write_text(TEXT, encoding="utf-8")
    return generate(base / "actuated.toml", base / "generated", verify=False)


@pytest.fixture(scope="module")
def module(folder: Path) -> ModuleType:
    return load(folder, "c")


def hover(**changes: Any) -> Scenario:
    near = {"base": {"path": {"kind": "fixed", "position": [0, 0, 0.1]}}, "duration": 0.25}
    return read_scenario("hover", near | changes)


def flown(module: ModuleType, q: Array, v: Array, command: Array, time: float) -> Array:
    """The state after a time with commands that stay, by SciPy."""
    n, m = len(q), len(v)

    def rate(_: float, y: Array) -> Array:
        q, v, x = y[:n].copy(), y[n : n + m], y[n + m :]
        q[3:7] /= np.linalg.norm(q[3:7])
        u = module.inputs_of(q, v, x, command)
        wrenches = air(module, q, v, module.rotor_speeds(x, command)[0], u[0])
        a = module.forward_dynamics_with_wrenches(q, v, u, wrenches)
        rates = module.coordinate_rates(q, v), a, module.actuator_rates(x, command)
        return np.concatenate(rates)

    start = np.concatenate([q, v, module.actuator_state_of(command)])
    found = solve_ivp(rate, (0.0, time), start, method="DOP853", rtol=1e-11, atol=1e-12)
    end: Array = found.y[: n + m, -1]
    end[3:7] /= np.linalg.norm(end[3:7])
    return end


@pytest.mark.slow
def test_commands_of_ones_own_fly_what_the_functions_of_the_module_say(
    module: ModuleType,
) -> None:
    """Throttle, speeds and thrust with lag, servos with play and friction, near the ground."""
    simulation = Simulation(module, hover())
    command = np.array([0.62, 600.0, 640.0, 4.0, 0.2, -0.01, 0.02])
    seen = simulation.reset()
    # Up to where the servo's torque, rate and play have all bound it.
    simulation.step(command, 0.2)
    expected = flown(module, seen.q, seen.v, command, 0.2)
    assert simulation.stopped == ""
    found = np.concatenate([simulation.q, simulation.v])
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-6)


@pytest.mark.slow
def test_a_law_flies_by_commands_and_the_flight_has_them(
    module: ModuleType, folder: Path, tmp_path: Path
) -> None:
    flight = simulate(module, hover(duration=1.0))
    assert flight.stopped == ""
    assert np.abs(flight.energy_error).max() < 1e-9
    # The law knows nothing of the ground's effect, nor of friction, which holds the wrist.
    assert np.abs(flight.errors[-1]).max() < 2e-2
    q, v, x, sent = flight.q[-1], flight.v[-1], flight.actuators[-1], flight.commands[-1]
    np.testing.assert_allclose(module.inputs_of(q, v, x, sent), flight.applied[-1], atol=1e-12)
    assert flight.command_names == module.COMMANDS
    assert 0.99 < x[module.ACTUATOR_STATES.index("charge")] < 1.0
    names = [name for name, _, _ in flight.columns()]
    assert {"throttle_front_left_sent", "upper_reference_state"} <= {*names}
    flight.write_npz(tmp_path / "flight.npz")
    np.testing.assert_array_equal(read_flight(tmp_path / "flight.npz").commands, flight.commands)
    # The array program in NumPy is the oracle of the one in C. Where lag is made up for, adaptive
    # steps are to 1e-6, and differ by rounding.
    short = hover(duration=0.02, start={"offset": [0.02, 0.0, 0.01]})
    found, expected = (simulate(load(folder, x), short) for x in ("c", "numpy"))
    np.testing.assert_allclose(found.actuators, expected.actuators, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.q, expected.q, rtol=0.0, atol=1e-8)


@pytest.mark.slow
def test_a_sampled_law_sends_the_commands_of_its_samples(module: ModuleType) -> None:
    flight = simulate(module, hover(control={"rate": 200}, duration=1.0, integration=RK4))
    assert flight.stopped == ""
    assert np.abs(flight.errors[-1]).max() < 5e-3
    period = flight.commands[(flight.time >= 0.5) & (flight.time < 0.505 - 1e-9)]
    np.testing.assert_array_equal(period, np.broadcast_to(period[0], period.shape))


@pytest.mark.slow
def test_joints_have_gains_of_their_own_but_where_servos_hold_them(module: ModuleType) -> None:
    own = hover(control={"joints": {"wrist": {"frequency": 20.0, "damping_ratio": 0.5}}})
    gains = flight_start(module, own, lambda *_: None, custom_law=False).loop.controller.gains
    places = [module.VELOCITIES.index(name) for name in ("upper", "slider", "wrist")]
    np.testing.assert_array_equal(gains.stiffness[places], [0.0, 0.0, 400.0])
    np.testing.assert_array_equal(gains.damping[places], [0.0, 0.0, 20.0])
    with pytest.raises(UsageError, match=r"control\.joints\.upper: a servo drives the joint"):
        simulate(module, hover(control={"joints": {"upper": {"frequency": 20.0}}}))
    with pytest.raises(UsageError, match="elbow: actuated has no joint elbow"):
        simulate(module, hover(control={"joints": {"elbow": {"frequency": 20.0}}}))
    with pytest.raises(UsageError, match=r"motors\.time_constant: the robot file of actuated has"):
        simulate(module, hover(motors={"time_constant": 0.05}))
    with pytest.raises(UsageError, match=r"arm\.effort\.slider: a servo drives the joint"):
        simulate(module, hover(arm={"effort": {"slider": 1.0}}))


def test_what_is_off_pushes_nothing_whatever_its_least_command(module: ModuleType) -> None:
    """A rotor has a least speed of 100 rad/s, which would be sent as a thrust of 100 N."""
    flight = simulate(module, hover(control={"law": "off"}, duration=0.1))
    np.testing.assert_array_equal(flight.applied, 0.0)
    np.testing.assert_allclose(flight.v[:, 2], -9.81 * flight.time, rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_rollouts_of_a_scenario_have_the_states_of_actuators(module: ModuleType) -> None:
    steps, step = 250, RK4["step"]
    found = rollout(module, None, None, hover(), steps, step, every=50)
    flight = simulate(module, hover(duration=steps * step, integration=RK4 | {"rate": 100.0}))
    assert found.x is not None
    assert found.thrusts is None
    np.testing.assert_allclose(found.x[0], flight.actuators, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_what_overflows_is_told_by_the_names_of_states_and_commands(
    folder: Path, backend: str
) -> None:
    module = load(folder, backend)
    command = np.array([0.62, 600.0, 640.0, 4.0, 0.2, -0.01, 0.02])
    x = module.actuator_state_of(command)
    x[0] = 1e200
    with pytest.warns(RuntimeWarning, match="largest there: x of throttle_front_left, 1e"):
        module.actuator_rates(x, command)


@pytest.mark.slow
def test_air_resists_a_rotor_that_turns_either_way(tmp_path: Path) -> None:
    text = 'name = "both"\nbase = { mass = 1, inertia = [1, 1, 1, 0, 0, 0] }\n'
    text += '[[rotor]]\ncommand = "speed"\nthrust_constant = 1e-9\nhub_drag = 1e-3\n'
    (tmp_path / "both.toml").write_text(text, encoding="utf-8")
    robot = load(generate(tmp_path / "both.toml", tmp_path, verify=False), "numpy")
    along = np.eye(6)[robot.VELOCITIES.index("x")]
    for speed in (-500.0, 500.0):
        found = rollout(robot, np.zeros(6), along, [speed], 10, 1e-3).v[0, -1]
        assert found @ along == pytest.approx(np.exp(-500.0 * 1e-3 * 0.01), rel=1e-9)


@pytest.mark.slow
def test_laws_fly_servos_that_are_commanded_rates(tmp_path: Path) -> None:
    """They correct what is off themselves, with gains of their own, as for torques."""
    (tmp_path / "by_rates.toml").write_text(robot_text(by_rates()), encoding="utf-8")
    robot = load(generate(tmp_path / "by_rates.toml", tmp_path, verify=False), "c")
    moves = {"moves_deg": {"upper": [{"to": 23.0, "duration": 1.0}]}}
    own = {"joints": {"upper": {"frequency": 30.0}}}  # Against dry friction.
    flight = simulate(robot, hover(duration=1.5, arm=moves, control=own, integration=RK4))
    assert flight.stopped == ""
    upper = robot.VELOCITIES.index("upper")
    assert np.abs(flight.errors[:, upper]).max() < 0.02
    sent = flight.commands[:, robot.COMMANDS.index("upper_rate")]
    assert 0.7 < sent.max() < 2.0
    # A second of a rate that is held turns the joint by it, but for what gravity takes of it.
    simulation = Simulation(robot, hover(integration=RK4))
    start = simulation.reset().q
    command = flight.commands[-1].copy()
    command[robot.COMMANDS.index("upper_rate")] += 0.5
    simulation.step(command, 0.1)
    at = robot.COORDINATES.index("upper")
    assert simulation.q[at] - start[at] == pytest.approx(0.05, abs=0.02)


RUBBING = """
name = "rubbing"
[base]
attitude = "quaternion"
mass = 1e6
inertia = [1e6, 1e6, 1e6, 0, 0, 0]
[[rotor]]
limits = [0, 2e7]
[[link]]
name = "lid"
xyz = [0, 0, 0]
mass = 0.1
inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
friction = { coulomb = 0.01, static = 0.02, velocity = 0.1 }
"""


def test_steps_too_long_for_dry_friction_are_told(tmp_path: Path) -> None:
    """About rest a joint decays at 10 static/(velocity inertia), of which rk4 bears 2.785."""
    (tmp_path / "rubbing.toml").write_text(RUBBING, encoding="utf-8")
    robot = load(generate(tmp_path / "rubbing.toml", tmp_path, verify=False), "numpy")
    rate = 10.0 * 0.02 / (0.1 * 1e-4)
    longest = 2.785 / rate
    command = np.array([1e6 * 9.81, 0.0])
    for method, most in (("rk4", longest), ("euler", 2.0 / rate)):
        own = {"steps": 1, "method": method}
        rollout(robot, robot_neutral(robot), np.zeros(7), command, dt=0.999 * most, **own)
        with pytest.warns(RuntimeWarning, match=f"rubbing: dt: in steps of .* {method} .*of lid"):
            rollout(robot, robot_neutral(robot), np.zeros(7), command, dt=1.001 * most, **own)
    for step, refused in ((0.999 * longest, False), (1.001 * longest, True)):
        near = {"integration": {"method": "rk4", "step": step, "rate": 1.0 / step}}
        simulation = Simulation(robot, read_scenario("hover", near))
        simulation.reset()
        words = r"integration\.step: .* because of the dry friction about rest of lid; use steps of"
        with pytest.raises(UsageError, match=words) if refused else nullcontext():
            simulation.step(command, step)


LAGGING = RUBBING.partition("[[link]]")[0]


@pytest.mark.parametrize("times", ["3e-4, 3e-4", "0.05, 3e-4", "3e-4, 0.05"])
def test_steps_too_long_for_a_lag_are_refused(times: str, tmp_path: Path) -> None:
    """It decays in steps of rk4 of up to 2.785 time constants, the shorter of both."""
    own = f"command = 'throttle'\nmax_thrust = 2e7\ntime_constants = [{times}]"
    text = LAGGING.replace("limits = [0, 2e7]", own)
    (tmp_path / "rubbing.toml").write_text(text, encoding="utf-8")
    robot = load(generate(tmp_path / "rubbing.toml", tmp_path, verify=False), "numpy")
    for step, refused in ((8.3e-4, False), (8.4e-4, True)):
        near = {"integration": {"method": "rk4", "step": step, "rate": 1.0 / step}}
        simulation = Simulation(robot, read_scenario("hover", near))
        words = r"integration\.step: .* because of the lag of .*; use steps of at most 0.0006 s"
        with pytest.raises(UsageError, match=words) if refused else nullcontext():
            simulation.step(np.full(len(robot.COMMANDS), 1e6 * 9.81), step)


def test_modules_of_few_functions_are_rolled_out(tmp_path: Path) -> None:
    """Without what tells whether steps are too long."""
    (tmp_path / "rubbing.toml").write_text(RUBBING, encoding="utf-8")
    own = ["forward_dynamics", "inputs_of", "integrate"]
    options: Any = {"functions": own, "verify": False}
    robot = load(generate(tmp_path / "rubbing.toml", tmp_path, **options), "numpy")
    found = rollout(robot, robot_neutral(robot), np.zeros(7), [1e6 * 9.81, 0.0], 1, 1e-3)
    np.testing.assert_allclose(found.v[0, -1], 0.0, atol=1e-5)


def robot_neutral(robot: ModuleType) -> Array:
    """Coordinates of zero."""
    q = np.zeros(len(robot.COORDINATES))
    q[robot.COORDINATES.index("qw")] = 1.0
    return q


@pytest.mark.slow
def test_a_flight_begins_with_the_charge_that_is_given(module: ModuleType) -> None:
    """And goes on, with a note, when it is empty."""
    half = hover(start={"charge": 0.5, "offset": [0.01, 0.0, 0.0]}, duration=0.05)
    place = module.ACTUATOR_STATES.index("charge")
    flight = simulate(module, half)
    full = simulate(module, hover(start={"offset": [0.01, 0.0, 0.0]}, duration=0.05))
    assert flight.actuators[0, place] == 0.5
    np.testing.assert_array_equal(flight.q[0], full.q[0])
    # At 15 V in place of 16.8 V more current flows.
    assert 0.0 < flight.actuators[-1, place] < full.actuators[-1, place] - 0.5
    assert flight.notes == ()
    several = simulate_many(module, [half, replace(half, name="other")])
    np.testing.assert_array_equal(several[1].actuators[0], flight.actuators[0])
    near = replace(half, integration=Settings(**RK4))
    found = rollout(module, None, None, near, 10, RK4["step"])
    assert found.x is not None
    np.testing.assert_array_equal(found.x[0, 0], flight.actuators[0])
    simulation = Simulation(module, hover())
    assert simulation.reset(charge=0.2).actuators[place] == 0.2
    command = np.array([0.62, 600.0, 640.0, 4.0, 0.2, -0.01, 0.02])
    told: list[float] = []

    def own(seen: Observation) -> Array:
        told.append(float(seen.actuators[place]))
        return command

    simulate(module, replace(half, duration=0.01), own)
    assert told[0] == 0.5
    simulation.reset(charge=1e-6)
    simulation.step(command, 0.05)
    empty = simulation.flight()
    (note,) = empty.notes
    charge = empty.actuators[:, place]
    at = empty.time[np.argmax(charge <= 0.0)]
    assert charge[0] > 0.0
    assert not charge[empty.time >= at].any()
    assert note.startswith(f"The battery is empty at t = {at:.4g} s")
    assert empty.battery[-1, 1] > 1.0
    for charge in (1.5, np.nan):
        with pytest.raises(UsageError, match="charge: must be"):
            simulation.reset(charge=charge)


@pytest.mark.slow
def test_servos_without_a_state_are_flown_too(tmp_path: Path) -> None:
    """Of the base of rods, under the law in NumPy and C, and by commands that are held."""
    text = (ROBOTS / "hexarotor_3link.toml").read_text(encoding="utf-8")
    served = text.replace(
        "[[link]]", "[[link]]\nservo = { stiffness = 900, damping = 60 }\narmature = 1"
    )
    (tmp_path / "served.toml").write_text(served, encoding="utf-8")
    folder = generate(tmp_path / "served.toml", tmp_path, verify=False)
    compiled, scenario = load(folder, "c"), read_scenario("hover", {"duration": 0.05})
    assert compiled.ACTUATOR_STATES == ()
    found, expected = (simulate(x, scenario) for x in (compiled, load(folder, "numpy")))
    assert found.stopped == ""
    np.testing.assert_allclose(found.q, expected.q, rtol=0.0, atol=1e-9)
    with pytest.raises(UsageError, match="charge: hexarotor_3link has no battery; leave it out"):
        simulate(compiled, read_scenario("hover", {"start": {"charge": 0.5}}))
    simulation = Simulation(compiled, scenario)
    simulation.reset()
    simulation.step(found.commands[0], 0.05)
    np.testing.assert_allclose(simulation.q, found.q[-1], rtol=0.0, atol=1e-3)


@pytest.mark.slow  # 2 s
@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_a_late_servo_holds_an_arm_without_rotors(backend: str, tmp_path: Path) -> None:
    (tmp_path / "late.toml").write_text(
        'name = "late"\n[base]\nmotion = "fixed"\n[[link]]\nname = "a"\naxis = "y"\n'
        "xyz = [0, 0, 0]\nmass = 1\ncom = [0.2, 0, 0]\ninertia = [1e-3, 0.01, 0.01, 0, 0, 0]\n"
        "servo = { stiffness = 200, damping = 10, delay = 0.02 }\n"
    )
    folder = generate(tmp_path / "late.toml", tmp_path, verify=False)
    # Level, where gravity turns it most.
    level = {"duration": 0.2, "arm.posture_deg": {"a": 0.0}, "integration": RK4}
    flight = simulate(load(folder, backend), read_scenario("hold", level))
    assert flight.stopped == ""
    assert abs(flight.q).max() < 1e-6
    np.testing.assert_allclose(flight.applied, -9.81 * 0.2, rtol=1e-6)
