"""Accelerations alone: no pose, readings that are late, and a robot file that is far off."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gibbs_codegen import generate, identify, load, read_scenario, simulate, write_log
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.logs.log import recorded_of
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.identification.recorded import (
    Readings,
    Recording,
    flight_recordings,
    part_of,
    recordings_of,
)

pytestmark = pytest.mark.usefixtures("compiled_to_run")

# The robot file's, a third of what flies; how much later readings are than commands, s.
FILE = {"base_inertia_xx": 0.0145, "base_inertia_yy": 0.0145, "base_inertia_zz": 0.0262}
DELAY = 0.009


def waves(*terms: tuple[float, float]) -> list[dict[str, float]]:
    return [{"amplitude": amplitude, "frequency": frequency} for amplitude, frequency in terms]


@pytest.fixture(scope="module")
def module(tmp_path_factory):
    folder = tmp_path_factory.mktemp("modules")
    return load(generate("quadrotor", folder, verify=False), backend="c")


@pytest.fixture(scope="module")
def recording(module) -> Recording:
    """Ten seconds of a lively flight, of which IMUs are read, late and without noise."""
    changes = {
        "duration": 10,
        "plant": {name: 3.0 * value for name, value in FILE.items()},
        "base.path": {
            "kind": "harmonic",
            "x": waves((0.5, 2.3), (0.1, 7.7)),
            "y": waves((0.5, 2.9), (0.1, 8.3)),
            "z": waves((0.3, 3.1), (0.05, 9.1)),
        },
        "base.attitude": {"kind": "level", "rate_deg": 40},
        "control": {"rate": 250, "frequency": 2, "attitude_frequency": 8},
        "integration": {"method": "rk4", "step": 0.002, "rate": 250},
        "sensors.imu": [
            {"name": frame, "frame": frame, "rate": 250} for frame in ("base", "camera")
        ],
    }
    whole = flight_recordings(simulate(module, read_scenario("circle", changes)), module, "imu")[0]
    felt = {
        frame: np.stack([np.interp(whole.time - DELAY, whole.time, c) for c in values.T], axis=1)
        for frame, values in whole.imus.items()
    }
    return replace(whole, q=np.full_like(whole.q, np.nan), imus=felt)


def read(recording: Recording, frame: str, seed: int, gyroscope: float) -> Recording:
    """It by one IMU, with noise, m/s² 0.05 of its accelerometer."""
    noise = np.random.default_rng(seed).standard_normal((len(recording.time), 6))
    felt = recording.imus[frame] + noise * np.repeat([0.05, gyroscope], 3)
    return replace(recording, imus={frame: felt})


# The camera lies on the base, ahead of it, and is pitched by 30 degrees.
@pytest.mark.parametrize(
    ("frame", "seed", "gyroscope"),
    [("base", 0, 5e-3), ("camera", 3, 1e-3)],
)
def test_inertias_are_found_without_a_pose_though_readings_are_late(
    module, recording, frame, seed, gyroscope
) -> None:
    found = identify(
        module, read(recording, frame, seed, gyroscope), ["base_inertia_??"], hold_out=0.25
    )
    assert found.settled
    exact = np.array([3.0 * FILE[name] for name in found.names])
    # Readings were made late by straight lines between samples.
    off = np.abs(found.values - exact) - 5e-4 * exact
    assert np.all(off < 3.0 * found.deviations)
    assert np.all(found.deviations < 2e-3 * exact)
    delay, deviation = found.others["delay of readings behind commands, s"]
    assert delay == pytest.approx(DELAY, abs=5e-5 + 3 * deviation)
    for before, after in (found.prediction[f"acceleration along w{axis}"] for axis in "xy"):
        assert after < 0.3 * before


def test_two_imus_are_told_apart(module, recording) -> None:
    found = identify(module, part_of(recording, slice(1000)), ["base_inertia_??"])
    assert {f"IMU at {frame}, acceleration x" for frame in ("base", "camera")} <= {*found.residuals}


# A camera's pose, made late by 4 samples; satellites, whose places and speeds alone are read; and a
# bag of motion capture.
@pytest.mark.parametrize(
    ("sensor", "keys", "words"),
    [
        ("pose", {"frame": "camera", "delay": 0.016}, "the pose lags"),
        (
            "gps",
            {"frame": "camera", "horizontal_noise": 0.01, "vertical_noise": 0.01},
            "gps_velocity",
        ),
        ("pose", {"frame": "camera"}, "not written to the bag: readings barometer_altitude"),
    ],
)
def test_a_log_tells_the_pose_that_a_sensor_reads_and_what_flew(
    module, tmp_path, caplog, sensor, keys, words
) -> None:
    path = {"x": waves((0.5, 2.3)), "y": waves((0.5, 2.9)), "z": waves((0.3, 3.1))}
    noise = {"position_noise": 0.01, "attitude_noise": 1e-3} if sensor == "pose" else {}
    real = {"base_mass": 1.9} | {name: 1.3 * value for name, value in FILE.items()}
    changes = {
        "duration": 3,
        "plant": real,
        "base.path": {"kind": "harmonic", **path},
        "base.attitude": {"kind": "level", "rate_deg": 40},
        "control": {"rate": 250, "frequency": 2, "attitude_frequency": 8},
        "integration": {"method": "rk4", "step": 0.002, "rate": 250},
        "sensors.imu": [{"rate": 125, "accelerometer_noise": 0.005, "gyroscope_noise": 0.0005}],
        f"sensors.{sensor}": [{"rate": 50, **keys, **noise}],
        "sensors.barometer": [{}],
    }
    flight = simulate(module, read_scenario("circle", changes))
    if "bag" in words:
        vehicle = Vehicle(module)
        write_log(flight, tmp_path / "bag")
        log = recorded_of(vehicle, tmp_path / "bag", {"odometry": "/pose"})
        (told,) = recordings_of(vehicle, log, "bag")
    else:
        told = flight_recordings(flight, module, "seen")[0]
        write_log(flight, tmp_path / "tables", "csv")
        assert not (tmp_path / "tables" / "vehicle_visual_odometry_0.csv").exists()
        rest = f"not written to the tables: readings barometer_altitude, {sensor}_pos"
        assert rest in caplog.text
    assert words in caplog.text
    lags = [float(lag) for lag in re.findall(r"lags the IMU at base by (\S+) ±", caplog.text)]
    assert lags == pytest.approx([keys["delay"]] if "delay" in keys else [], abs=5e-4)
    assert ("no sensor reads the attitude; taken without" in caplog.text) == (sensor == "gps")
    rows = np.isfinite(told.q[:, 0])
    assert 0.15 < rows.mean() < 0.45
    away = (told.q - flight.q[:: round(told.step / 0.004)][: len(rows)])[rows]
    assert 0.007 < np.std(away[:, :3]) < 0.013
    assert np.abs(away[:, 3:7]).max() < 0.01
    found = identify(module, told, [*real])
    assert found.settled
    exact = np.array([real[name] for name in found.names])
    assert np.all(found.deviations < 0.02 * exact)
    assert np.abs((found.values - exact) / found.deviations).max() < 4.0
    assert max(found.residuals.values()) < 1.3


def quiet(recording: Recording) -> Recording:
    """It with an IMU of which one reading is lacking."""
    felt = recording.imus["base"].copy()
    felt[:, 0] = np.nan
    return replace(recording, imus={"base": felt})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda r: replace(r, time=50 * r.time),
            "has no pose and 5 samples a second; such logs need 10",
        ),
        (lambda r: part_of(r, slice(200)), "held-out part is too short"),
        (quiet, "in a part an IMU has no readings; cut that part out"),
    ],
)
def test_logs_without_a_pose_that_tell_too_little_are_refused(
    module, recording, change, words
) -> None:
    with pytest.raises(UsageError, match=words):
        identify(module, change(recording), ["base_inertia_??"])


FLYING_ARM = """
name = "flying_arm"
[base]
mass = 1.0
inertia = [0.01, 0.01, 0.01, 0, 0, 0]
attitude = "{attitude}"
[[link]]
name = "arm"
axis = "y"
xyz = [0, 0, 0]
mass = 0.3
inertia = [0.001, 0.001, 0.001, 0, 0, 0]
[[frame]]
name = "tip"
on = "arm"
xyz = [0, 0, 0.1]
"""


@pytest.mark.parametrize("attitude", ["zyx", "quaternion"])
def test_imus_tell_how_a_base_leans(tmp_path, attitude) -> None:
    """One that stays pitched by 0.3 rad; an IMU on its arm alone does not tell it."""
    (tmp_path / "robot.toml").write_text(FLYING_ARM.format(attitude=attitude), "utf-8")
    arm = load(generate(tmp_path / "robot.toml", tmp_path, verify=False))
    turned = Rotation.from_rotvec([0.0, 0.3, 0.0])
    places = [name in ("th_arm", "arm", "theta_arm") for name in arm.COORDINATES]
    q = np.where(places, np.sin(np.arange(300))[:, np.newaxis], np.nan)
    felt = np.tile([*turned.inv().apply([0.0, 0.0, 9.81]), 0.0, 0.0, 0.0], (300, 1))
    felt = felt + 1e-6 * np.random.default_rng(0).standard_normal((300, 6))
    inputs = np.zeros((300, len(arm.INPUTS)))
    log = Recording(4e-3 * np.arange(300), inputs, q, {"base": felt, "tip": felt})
    poses = arm.frame_poses(Readings(log, arm, ("tip", "base")).q)[:, arm.FRAMES.index("base")]
    np.testing.assert_allclose(
        poses[:, :3, :3], np.tile(turned.as_matrix(), (300, 1, 1)), atol=1e-4
    )
    with pytest.raises(UsageError, match="tip are on links"):
        Readings(log, arm, ("tip",))
