"""Flights of machines whose numbers are not those of their robot file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command import run

from gibbs_codegen import (
    UsageError,
    generate,
    identify,
    load,
    read_scenario,
    simulate,
    write_log,
)
from gibbs_codegen.cli.app import main
from gibbs_codegen.files.shipped import text_of
from gibbs_codegen.flight.logs.log import recorded_of
from gibbs_codegen.flight.logs.reading import Samples
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.identification.recorded import Recording, flight_recordings, recordings_of
from gibbs_codegen.identification.robot_file import with_numbers
from gibbs_codegen.robot.file import parse_robot

pytestmark = pytest.mark.usefixtures("compiled_to_run")

ROBOT = "quadrotor_arm_2link"
REAL = {"base_mass": 2.3, "forearm_mass": 0.2, "base_inertia_yy": 0.025, "forearm_com_z": -0.09}
DRAG, BIAS, DELAY = 0.3, (0.05, -0.03, 0.1), 0.0312
FREE = ["base_mass", "base_inertia_??", "base_com_*", "forearm_mass", "forearm_com_z"]


def waves(*terms: tuple[float, float]) -> list[dict[str, float]]:
    return [{"amplitude": amplitude, "frequency": frequency} for amplitude, frequency in terms]


BATTERY_DRONE = """
name = "drone"
[base]
attitude = "quaternion"
mass     = 1.9
inertia  = [0.022, 0.024, 0.042, 0, 0, 0]
[battery]
voltage    = [13.2, 14.8, 15.2, 16.8]
resistance = 0.02
capacity   = 5
""" + "".join(
    f"""
[[rotor]]
name          = "m{k}"
position      = [{x}, {y}, 0]
drag          = {0.016 * x * y / 0.04}
command       = "throttle"
full_speed    = 900
max_thrust    = 12
time_constant = 0.035
"""
    for k, (x, y) in enumerate([(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)])
)


@pytest.fixture(scope="module")
def module(tmp_path_factory):
    return load(generate(ROBOT, tmp_path_factory.mktemp("modules"), verify=False), backend="c")


@pytest.fixture(scope="module")
def flight(module) -> Flight:
    """Five seconds of a lively flight in wind, with sensors that err."""
    arm = {"upper_arm": (40, -30, 50, -10, 0), "forearm": (-60, 50, -30, 70, 0)}
    moves = {
        joint: [{"to": to, "begin": k, "duration": 1} for k, to in enumerate(angles)]
        for joint, angles in arm.items()
    }
    changes = {
        "name": "lively",
        "duration": 5,
        "plant": REAL,
        "base.path": {
            "kind": "harmonic",
            "x": waves((0.6, 1.3), (0.1, 3.7)),
            "y": waves((0.6, 1.7), (0.1, 4.1)),
            "z": waves((0.3, 2.3), (0.06, 5.3)),
        },
        "base.attitude": {"kind": "level", "rate_deg": 40},
        "arm.moves_deg": moves,
        "control": {"rate": 200, "frequency": 2, "attitude_frequency": 8},
        "integration": {"method": "rk4", "step": 0.0025, "rate": 200},
        "wind": {"velocity": [0.4, 0.2, 0], "drag": {"base": DRAG}},
        "sensors.imu": [
            {
                "rate": 200,
                "accelerometer_noise": 0.007,
                "gyroscope_noise": 0.0007,
                "accelerometer_bias": [*BIAS],
            }
        ],
        "sensors.encoders": [{"rate": 100, "resolution": 1.5e-3}],
    }
    return simulate(module, read_scenario("circle", changes))


@pytest.fixture(scope="module")
def identified(module, flight):
    return identify(module, flight, FREE, hold_out=0.25)


@pytest.mark.slow  # 6 s, for the first of these tests; inline: the numbers of test_numbers.py.
def test_numbers_of_a_flight_are_found_within_their_deviations(module, identified) -> None:
    exact = np.array([(module.PARAMETERS | REAL)[name] for name in identified.names])
    score = (identified.values - exact) / identified.deviations
    assert np.abs(score).max() < 4.0, dict(zip(identified.names, score, strict=True))
    found = dict(zip(identified.names, identified.values, strict=True))
    for name in ("base_mass", "base_inertia_xx", "base_inertia_yy", "forearm_mass"):
        assert found[name] == pytest.approx((module.PARAMETERS | REAL)[name], rel=0.03), name
    drag, deviation = identified.others["drag of the base, N s/m"]
    assert drag == pytest.approx(DRAG, abs=4 * deviation)
    for axis, bias in zip("xyz", BIAS, strict=True):
        value, deviation = identified.others[f"bias of the IMU at base, acceleration {axis}"]
        assert value == pytest.approx(bias, abs=4 * deviation)


@pytest.mark.slow  # With the one above.
def test_what_was_held_out_is_predicted_better(identified) -> None:
    assert len(identified.prediction) == 3
    for before, after in identified.prediction.values():
        assert after < before


@pytest.mark.slow  # With the one above.
def test_the_robot_file_has_the_numbers(identified, tmp_path: Path) -> None:
    identified.write(tmp_path / "new")
    text = (tmp_path / "new" / f"{ROBOT}.toml").read_text("utf-8")
    found = dict(zip(identified.names, identified.values, strict=True))
    assert parse_robot(text).links[1].body.mass == pytest.approx(found["forearm_mass"], rel=1e-5)
    assert "identified from lively" in text
    page = (tmp_path / "new" / "report.html").read_text("utf-8")
    assert "forearm_com_z" in page
    assert "http" not in page
    with pytest.raises(UsageError, match="exists already"):
        identified.write(tmp_path / "new")


@pytest.mark.slow  # 4 s.
def test_what_a_log_cannot_tell_is_told(module, flight) -> None:
    """Of masses and inertias of base and arm 13 of 16 combinations are in the equations."""
    words = identify(module, flight, between=(0.0, 3.0)).unseen
    assert len(words) >= 3
    assert any("determines only a combination of them" in clause for clause in words)


@pytest.mark.slow  # 4 s.
def test_outliers_and_gaps_change_little(module, flight, identified) -> None:
    whole = flight_recordings(flight, module, "spoilt")[0]
    q, felt = whole.q.copy(), whole.imus["base"].copy()
    rng = np.random.default_rng(0)
    felt[rng.choice(len(felt), 20, replace=False)] += 30.0
    q[rng.choice(len(q), 20, replace=False), 0] += 5.0
    q[400:460] = q[2::4] = np.nan  # Of every state, the first sample.
    spoilt = Recording(whole.time, whole.commands, q, {"base": felt}, "spoilt")
    again = identify(module, spoilt, FREE, hold_out=0.25)
    moved = np.abs(again.values - identified.values) / again.deviations
    assert moved.max() < 2.0, dict(zip(again.names, moved, strict=True))
    assert again.prediction.keys() == identified.prediction.keys()


@pytest.mark.slow  # 6 s.
def test_a_robot_file_may_be_far_off(module, flight, identified, tmp_path: Path) -> None:
    """Of which masses are three times as great: a fit from its numbers does not settle."""
    text, _ = text_of(ROBOT, "robots", UsageError)
    far = ("base_mass", "forearm_mass", *(f"base_inertia_{axes}" for axes in ("xx", "yy", "zz")))
    text = with_numbers(text, {name: 3 * module.PARAMETERS[name] for name in far}, {})
    (tmp_path / "far.toml").write_text(text, "utf-8")
    other = load(generate(tmp_path / "far.toml", tmp_path, verify=False), backend="c")
    again = identify(other, flight, FREE, hold_out=0.25)
    assert again.settled
    assert len(again.contradictions) >= 2
    np.testing.assert_allclose(again.values, identified.values, rtol=0.03, atol=1e-4)
    assert all(10 * after < before < 1.0 for before, after in again.prediction.values())


@pytest.mark.slow  # 11 s, most of it in the fit; inline: the mass matrix in test_numbers.py.
def test_a_load_is_weighed_by_an_ordinary_flight(tmp_path: Path, caplog) -> None:
    """Six seconds of the scenario `circle`, with 150 g at the tip, 180 mm below the joint."""
    module = load(generate(ROBOT, tmp_path, keep_zeros=True, verify=False), backend="c")
    changes = {
        "duration": 6,
        "payload": [{"frame": "tip", "mass": 0.15}],
        "control": {"rate": 200},
        "integration": {"method": "rk4", "step": 0.0025, "rate": 200},
        "sensors.imu": [{"rate": 200, "accelerometer_noise": 0.007, "gyroscope_noise": 0.0007}],
        "sensors.encoders": [{"rate": 100, "resolution": 1.5e-3}],
    }
    flight = simulate(module, read_scenario("circle", changes))
    assert "instead of C" not in caplog.text
    found = identify(module, flight, ["payload.forearm"])
    assert found.values[0] == pytest.approx(0.15, rel=0.01)
    tip = module.PARAMETERS["frame_tip_z"]
    np.testing.assert_allclose(found.values[1:], [0.0, 0.0, tip], atol=2e-3)
    assert "payload.forearm_mass 0.15" in found.robot_file


def later(samples: Samples) -> Samples:
    return samples._replace(time=samples.time + round(DELAY * 1e9))


@pytest.mark.slow  # 2 s; inline: test_numbers.py.
def test_a_bag_tells_what_the_flight_does_though_its_pose_is_late(module, flight, tmp_path) -> None:
    pytest.importorskip("rosbags")
    write_log(flight, tmp_path / "bag")
    vehicle = Vehicle(module)
    log = recorded_of(vehicle, tmp_path / "bag", {})
    log = log._replace(position=later(log.position), attitude=later(log.attitude))
    (part,) = recordings_of(vehicle, log, "bag")
    direct = flight_recordings(flight, module, "flight")[0]
    rows = slice(0, len(part.time))
    assert len(part.time) > 900
    # Half a millisecond of the delay is left at most: 1 mm at 2 m/s, and a tenth of a step.
    steps = np.abs(np.diff(direct.commands, axis=0, append=direct.commands[-1:]))[rows]
    assert np.all(np.abs(part.commands - direct.commands[rows]) <= 0.1 * steps + 1e-9)
    np.testing.assert_allclose(part.q[:, :3], flight.q[rows, :3], atol=1e-3)
    felt = direct.imus["base"][rows]
    seen = np.isfinite(felt)
    np.testing.assert_allclose(part.imus["base"][seen], felt[seen], atol=1e-9)


def test_what_is_not_taken_is_refused(module, flight, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="grip held the robot, with forces that no log contains"):
        identify(module, replace(flight, held=("grip",)), free=["base_mass"])
    (tmp_path / "log.ulg").write_bytes(b"")
    refused = run("identify", "quadrotor", "log.ulg", cwd=tmp_path)
    assert refused.returncode == 2
    assert "cannot be read as a log" in refused.stderr
    (tmp_path / "identified").mkdir()
    refused = run("identify", "quadrotor", "log.ulg", cwd=tmp_path)
    assert (refused.returncode, "exists already" in refused.stderr) == (2, True)


def test_names_are_looked_for_before_a_robot_is_derived(monkeypatch, capsys, tmp_path) -> None:
    monkeypatch.setattr("gibbs_codegen.pipeline.generate_robot", None)
    monkeypatch.chdir(tmp_path)
    given = ["identify", ROBOT, "--design", "new.toml"]
    for wrong, words in {
        ("--free", "forearm_mas"): "did you mean forearm_mass?",
        ("--free", "payload.forarm"): "did you mean payload.forearm?",
    }.items():
        assert main([*given, *wrong]) == 2
        assert words in capsys.readouterr().err


HEXAROTOR = """
name = "hexa"
[base]
attitude = "quaternion"
mass = 1.9
inertia = [0.022, 0.024, 0.042, 0, 0, 0]
"""
MOTOR = """
[[rotor]]
name = "m{k}"
radius = 0.26
azimuth_deg = {azimuth}
drag = {drag}
command = "throttle"
max_thrust = 8
thrust_model_factor = 0.7
time_constant = 0.035
"""


@pytest.mark.slow  # 12 s. Six motors make four components of a wrench: two are seen by lags alone.
def test_more_motors_than_a_wrench_has_components_and_one_wrong_reading(tmp_path, caplog) -> None:
    motors = [MOTOR.format(k=k, azimuth=30 + 60 * k, drag=0.015 * (-1) ** k) for k in range(6)]
    (tmp_path / "hexa.toml").write_text("".join([HEXAROTOR, *motors]), "utf-8")
    module = load(generate(tmp_path / "hexa.toml", tmp_path, verify=False), backend="c")
    real = {f"m{k}_time_constant": 0.045 for k in range(6)} | {"base_inertia_xx": 0.026}
    changes = {
        "name": "shakes",
        "duration": 6,
        "plant": real,
        "base.path": {
            "kind": "harmonic",
            "x": waves((0.8, 1.3), (0.25, 3.1)),
            "y": waves((0.8, 1.1), (0.25, 2.7)),
            "z": waves((0.3, 1.9)),
        },
        "control": {"rate": 200, "frequency": 2.5, "attitude_frequency": 9},
        "integration": {"method": "rk4", "step": 0.001, "rate": 200},
        "wind": {"velocity": [1.5, 0.8, 0], "drag": {"base": 0.25}},
        "sensors.imu": [{"rate": 200, "accelerometer_noise": 0.005, "gyroscope_noise": 5e-4}],
        "sensors.pose": [{"rate": 100, "position_noise": 0.002, "attitude_noise": 0.001}],
    }
    recording = flight_recordings(
        simulate(module, read_scenario("circle", changes)), module, "shakes"
    )[0]
    free = ["rotors.time_constant", "rotors.drag", "rotors.thrust_?", "base_inertia_??"]
    result = identify(module, recording, free)
    exact = [(module.PARAMETERS | real)[name.replace("rotors.", "m0_")] for name in result.names]
    score = (result.values - np.array(exact)) / result.deviations
    assert np.abs(score).max() < 4.0, dict(zip(result.names, score, strict=True))
    lag = result.names.index("rotors.time_constant")
    assert result.deviations[lag] < 5e-4
    felt = recording.imus["base"].copy()
    felt[300, 2] += 6.0
    spoilt = identify(module, replace(recording, imus={"base": felt}), free)
    words = "left out entries of IMUs that are unlike those before and after: 1"
    assert caplog.text.count(words) == 1
    assert (np.abs(spoilt.values - result.values) < 0.1 * result.deviations).all()


@pytest.mark.slow  # 2 s.
def test_a_sway_of_millimetres_in_calm_air_shows_no_drag() -> None:
    """A great drag would explain why the wind, which there is none of, moves the base so little."""
    changes = {
        "duration": 6,
        "base.path": {"kind": "harmonic", "x": waves((0.004, 2.0))},
        "base.attitude": {"kind": "level"},
        "control": {"rate": 200, "frequency": 2, "attitude_frequency": 8},
        "integration": {"method": "rk4", "step": 0.0025, "rate": 200},
        "sensors.imu": [{"rate": 200, "accelerometer_noise": 0.1, "gyroscope_noise": 0.01}],
        "sensors.pose": [{"rate": 100, "position_noise": 2e-3, "attitude_noise": 3e-3}],
    }
    quadrotor = load("quadrotor", backend="c")
    found = identify(
        quadrotor, simulate(quadrotor, read_scenario("circle", changes)), ["base_mass"]
    )
    drag, deviation = found.others["drag of the base, N s/m"]
    assert abs(drag) < 3.0 * deviation
    assert abs(found.values[0] - quadrotor.PARAMETERS["base_mass"]) < 3.0 * found.deviations[0]


@pytest.fixture(scope="module")
def battery_drone(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drone")
    (folder / "drone.toml").write_text(BATTERY_DRONE, "utf-8")
    return load(generate(folder / "drone.toml", folder, verify=False), backend="c")


def discharging(module, charge: float, seconds: float, posed: bool) -> Recording:
    """A lively flight from some charge on, with or without a pose."""
    changes = {
        "duration": seconds,
        "start.charge": charge,
        "base.path": {
            "kind": "harmonic",
            "x": waves((0.5, 2.3)),
            "y": waves((0.5, 2.9)),
            "z": waves((0.3, 3.1)),
        },
        "base.attitude": {"kind": "level", "rate_deg": 40},
        "control": {"rate": 200, "frequency": 2, "attitude_frequency": 8},
        "integration": {"method": "rk4", "step": 0.0025, "rate": 200},
        "sensors.imu": [{"rate": 200, "accelerometer_noise": 0.01, "gyroscope_noise": 1e-3}],
        "sensors.pose": [{"rate": 100, "position_noise": 2e-3, "attitude_noise": 1e-3}],
    }
    flight = simulate(module, read_scenario("circle", changes))
    recording = flight_recordings(flight, module, "drone")[0]
    return recording if posed else replace(recording, q=np.full_like(recording.q, np.nan))


# Throttles of a share of its voltage, which falls: at 40 % thrusts are a tenth less.
@pytest.mark.slow  # 9 s each.
@pytest.mark.parametrize(("charge", "posed"), [(1.0, True), (0.1, True), (0.4, False)])
def test_a_battery_need_not_be_full_where_a_log_begins(battery_drone, charge, posed) -> None:
    recording = discharging(battery_drone, charge, 8.0, posed)
    free = ["rotors.thrust_?", "rotors.time_constant"]
    found = identify(battery_drone, recording, free, hold_out=0.25)
    assert found.settled
    assert not any("acceleration along" in name for name in found.residuals)
    exact = [battery_drone.PARAMETERS[n.replace("rotors.", "m0_")] for n in found.names]
    assert np.all(np.abs(found.values - exact) < 4.0 * found.deviations)
    # Thrusts are as sure as the charge: of their squares voltages from 13.2 to 16.8 V make 60 %.
    thrust = found.names.index("rotors.thrust_2")
    assert 0.02 < found.deviations[thrust] / exact[thrust] < 0.1


def test_accelerations_do_not_take_a_battery_as_full(battery_drone, monkeypatch, caplog) -> None:
    monkeypatch.setattr("gibbs_codegen.identification.smoothing._MOST", 1)
    recording = discharging(battery_drone, 0.4, 4.0, False)
    found = identify(battery_drone, recording, ["rotors.thrust_?"], hold_out=0.3)
    assert (found.settled, found.prediction) == (False, {})
    assert "accelerations do not tell a battery's charge" in caplog.text


def test_planar_bases_have_no_wind_and_a_fit_that_does_not_settle_says_so(monkeypatch) -> None:
    monkeypatch.setattr("gibbs_codegen.identification.smoothing._MOST", 1)
    planar = load("planar_quadrotor_arm", backend="c")
    q, u = np.zeros((300, len(planar.COORDINATES))), np.zeros((300, len(planar.INPUTS)))
    found = identify(planar, Recording(5e-3 * np.arange(300), u, q), ["base_mass"])
    assert any("neither wind nor drag" in words for words in found.advice)
