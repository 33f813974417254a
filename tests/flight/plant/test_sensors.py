"""What sensors read: of motions that are known by hand or by Pinocchio, and how they err."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from gibbs_codegen import (
    SensorSuite,
    Simulation,
    read_flight,
    read_robot,
    read_scenario,
    simulate,
)
from gibbs_codegen.errors import GibbsCodegenError
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.scenario.scenario import Scenario

Load = Callable[[str], ModuleType]
ARM = "quadrotor_arm_2link"
G = 9.81
UP = np.array([0.0, 0.0, G])


def suite(module: ModuleType, **sensors: Any) -> SensorSuite:
    return SensorSuite(module, read_scenario("hover", {"sensors": sensors}).sensors)


def at(module: ModuleType, **entries: float) -> Array:
    """Coordinates, level where nothing else is said."""
    q = np.zeros(len(module.COORDINATES))
    q[module.COORDINATES.index("qw")] = 1.0
    for name, value in entries.items():
        q[module.COORDINATES.index(name)] = value
    return q


def flown(module: ModuleType, u: Array, **changes: Any) -> Simulation:
    simulation = Simulation(module, changed(**changes))
    simulation.reset(at(module, z=2.0))
    simulation.step(u, 0.1)
    return simulation


def test_the_robot_that_flies_is_read_and_as_late_as_it_is_observed(fast: Load) -> None:
    """A fall on the moon, of which the controller does not know, observed 30 ms late."""
    sensors = {"imu": [{"rate": 100, "delay": 0.01}], "delay": 0.03}
    simulation = flown(fast("quadrotor"), np.zeros(4), plant={"gravity": 1.62}, sensors=sensors)
    reading = simulation.step(np.zeros(4), 0.1).sensors["imu"]
    assert reading.time == pytest.approx(0.2 - 0.03 - 0.01, abs=1e-12)
    assert reading.values == pytest.approx(np.zeros(6), abs=1e-12)
    assert simulation.sensors["imu"].values is reading.values
    with pytest.raises(ValueError, match="read-only"):
        reading.values[0] = 1.0


@pytest.mark.parametrize("name", [ARM, "hexarotor_3link"])
def test_on_a_moving_link_it_measures_what_pinocchio_says(name: str, fast: Load) -> None:
    pin = pytest.importorskip("pinocchio")
    from support.pinocchio_oracle import Oracle

    module, oracle = fast(name), Oracle(read_robot(name)[0], rigid_base=True)
    draw, sizes = np.random.default_rng(5), [len(module.COORDINATES), *[len(module.VELOCITIES)] * 2]
    q, v, a = (draw.uniform(-1.0, 1.0, n) for n in sizes)
    if "qw" in module.COORDINATES:
        q[3:7] /= np.linalg.norm(q[3:7])
    own = oracle.configuration(q), oracle.spread(v), oracle.spread(a)
    pin.forwardKinematics(oracle.model, oracle.data, *own)
    joint, placement = oracle.frames["tip"]
    place = oracle.data.oMi[joint] * placement
    velocity = placement.actInv(oracle.data.v[joint])
    growth = placement.actInv(oracle.data.a[joint])
    felt = growth.linear + np.cross(velocity.angular, velocity.linear)
    felt = felt + place.rotation.T @ UP
    sensors = suite(module, imu=[{"frame": "tip"}], gps=[{"frame": "tip"}], encoders=[{}])
    found = sensors.measurements(q, v, a)
    wanted = [felt, velocity.angular, place.translation, place.rotation @ velocity.linear]
    assert found[:12] == pytest.approx(np.concatenate(wanted), abs=1e-11)
    joints = [each.removeprefix("encoders_") for each in sensors.names[12:]]
    assert len(joints) == (2 if name == ARM else 3)
    assert np.array_equal(found[12:], q[[module.COORDINATES.index(each) for each in joints]])


def test_a_magnetometer_feels_the_field_of_a_place(fast: Load) -> None:
    """By hand: a field that points 30° down and 90° east of north, on a robot that faces north."""
    module = fast("quadrotor")
    field = {"declination_deg": 90.0, "inclination_deg": 30.0, "strength": 4e-5}
    sensors = suite(module, magnetometer=[{**field, "bias": [1e-6, 0, 0]}])
    half = np.sqrt(0.5)
    north, none = at(module, qz=half, qw=half), np.zeros(6)  # A quarter turn from the east.
    assert sensors.measurements(at(module), none, none) == pytest.approx(
        [4e-5 * np.sqrt(0.75), 0.0, -2e-5], abs=1e-18
    )
    measured = sensors.measurements(north, none, none)
    assert measured == pytest.approx([0.0, -4e-5 * np.sqrt(0.75), -2e-5], abs=1e-18)
    read = sensors.readings([0.0], *(x[np.newaxis] for x in (north, none, none)))[0]
    assert read == pytest.approx(measured + np.array([1e-6, 0.0, 0.0]), abs=1e-18)
    rolled = at(module, qx=half, qw=half)  # What was down is along −y now.
    assert sensors.measurements(rolled, none, none) == pytest.approx(
        [4e-5 * np.sqrt(0.75), -2e-5, 0.0], abs=1e-18
    )


def resting(module: ModuleType, count: int, rate: float) -> tuple[Array, ...]:
    """Times, q, v and a of a robot that hovers."""
    times = np.arange(count) / rate
    return times, np.tile(at(module, z=2.0), (count, 1)), *np.zeros((2, count, 6))


def test_noise_and_walk_have_the_variances_of_their_formulas(fast: Load) -> None:
    """The mean over T of noise of density n has the variance n²/T, a walk of w after T that w² T.

    Of 600 motions: the standard deviation of a variance is 0.058 of it.
    """
    module, rate, n, w = fast("quadrotor"), 50.0, 0.02, 0.3
    white = {"accelerometer_noise": n, "gyroscope_walk": w, "gyroscope_bias": [0.1, 0.2, 0.3]}
    heights = [{"noise": 0.4}, {"name": "other", "noise": 0.4, "altitude": 300.0}]
    heights = [each | {"rate": rate} for each in (*heights, {"name": "drifting", "drift": w})]
    sensors = suite(module, imu=[white | {"rate": rate}], barometer=heights)
    times, *motion = resting(module, 101, rate)
    found = sensors.readings(times, *(np.broadcast_to(x, (200, *x.shape)) for x in motion), seed=3)
    assert found.shape == (200, 101, 9)
    force, spin, height, drifting = np.split(found, [3, 6, 8], axis=-1)
    assert np.var(force[:, :100].mean(axis=1) - UP) == pytest.approx(n**2 / 2.0, rel=0.15)
    assert np.var(force - UP) == pytest.approx(n**2 * rate, rel=0.02)
    grown = spin - [0.1, 0.2, 0.3]
    assert np.var(grown[:, 24]) == pytest.approx(w**2 * 25 / rate, rel=0.15)
    assert np.var(grown[:, 100] - grown[:, 0]) == pytest.approx(w**2 * 2.0, rel=0.15)
    assert np.mean(grown[:, 1:] - grown[:, :-1]) == pytest.approx(0.0, abs=4e-4)
    assert np.std(height - [2.0, 302.0]) == pytest.approx(0.4, rel=0.02)
    # Of 200 motions: the standard deviation of a variance is 0.1 of it.
    assert np.var(drifting[:, 100] - drifting[:, 0]) == pytest.approx(w**2 * 2.0, rel=0.3)
    errors = np.concatenate([force, height], axis=-1).reshape(-1, 5)
    assert np.abs(np.corrcoef(errors.T) - np.eye(5)).max() < 0.03


def test_range_resolution_rate_and_delay_are_exact(fast: Load) -> None:
    module = fast(ARM)
    sensors = suite(
        module,
        imu=[{"accelerometer_range": 5.0, "gyroscope_range": 0.5, "rate": 1000}],
        encoders=[{"resolution": 0.01, "noise": 0.001, "rate": 1000}],
        gps=[{"rate": 10, "delay": 0.23}],
    )
    times = np.arange(1001) / 1000.0
    q, v, a = np.tile(at(module, z=2.0), (1001, 1)), np.zeros((1001, 8)), np.zeros((1001, 8))
    q[:, 0], q[:, -1], v[:, 0], v[:, 3] = times, 0.123 * times, 1.0, -2.0 * times
    found = dict(zip(sensors.names, sensors.readings(times, q, v, a).T, strict=True))
    assert np.all(found["imu_acceleration_z"] == 5.0)
    assert found["imu_angular_velocity_x"] == pytest.approx(np.maximum(-2.0 * times, -0.5))
    steps = np.round(found["encoders_forearm"] / 0.01)
    assert np.array_equal(found["encoders_forearm"], steps * 0.01)
    assert np.ptp(steps) == pytest.approx(12.0, abs=1.0)
    assert np.abs(found["encoders_forearm"] - q[:, -1]).max() < 0.01
    late = np.floor(np.round((times - 0.23) * 10.0, 6)) / 10.0
    assert np.array_equal(np.isnan(found["gps_position_x"]), times < 0.23 - 1e-9)
    known = late >= 0.0
    assert found["gps_position_x"][known] == pytest.approx(late[known], abs=1e-12)


SENSORS: dict[str, Any] = {
    "seed": 4,
    "imu": [{"accelerometer_noise": 0.02, "gyroscope_walk": 0.01, "rate": 200}],
    "gps": [{"rate": 20, "delay": 0.06, "horizontal_noise": 0.5}],
    "magnetometer": [{"rate": 70, "noise": 1e-7}],
}
FLOWN: dict[str, Any] = {
    "duration": 0.3,
    "start": {"offset": [0.1, -0.05, 0.1], "turn_deg": [3, 5, 0]},
    "control": {"rate": 50},
    "integration": {"method": "rk4", "step": 0.001, "rate": 200},
    "sensors": SENSORS,
}


def changed(**changes: Any) -> Scenario:
    return read_scenario("hover", FLOWN | changes)


@pytest.mark.slow
def test_the_same_seed_reads_the_same_and_the_record_has_what_was_told(
    fast: Load, tmp_path: Path
) -> None:
    module, told = fast("quadrotor"), []

    def controller(seen: Any) -> Array:
        told.append(seen)
        found: Array = np.array([0.9, 1.0, 1.0, 1.1]) * (G * 0.2 + 0.1 * np.sin(9.0 * seen.time))
        return found

    flight, again = (simulate(module, changed(), controller) for _ in range(2))
    assert flight.sensors.tobytes() == again.sensors.tobytes()
    other = simulate(module, changed(sensors=SENSORS | {"seed": 5}), controller)
    assert np.array_equal(other.q, flight.q)
    assert not np.any(other.sensors[:, :3] == flight.sensors[:, :3])
    assert flight.sensors.shape == (61, 15)
    for seen in told[:15]:
        row = flight.sensors[round(seen.time * 200)]
        names = ("imu", "magnetometer", "gps")
        values = np.concatenate([seen.sensors[each].values for each in names])
        assert np.array_equal(values, row, equal_nan=True)
        assert seen.sensors["imu"].time == pytest.approx(seen.time, abs=1e-12)
    # Stepped, the same is read; by way of the samples of the flight, but where inputs jump.
    simulation = Simulation(module, changed())
    for seed, wanted in ((None, flight), (5, other)):
        seen = simulation.reset(seed=seed)
        for _ in range(15):
            seen = simulation.step(controller(seen))
        stepped = simulation.flight().sensors
        assert stepped[1:] == pytest.approx(wanted.sensors[1:], abs=1e-9, nan_ok=True)
    sensors = SensorSuite(module, changed().sensors)
    after = sensors.readings(flight.time, flight.q, flight.v, flight.a)
    own = np.arange(61) % 4 != 0
    assert after[own, :6] == pytest.approx(flight.sensors[own, :6], abs=1e-12)
    assert after[:, 9:] == pytest.approx(flight.sensors[:, 9:], abs=1e-12, nan_ok=True)
    flight.write_npz(tmp_path / "flight.npz")
    stored = read_flight(tmp_path / "flight.npz")
    assert stored.sensor_names == flight.sensor_names
    assert stored.sensors.tobytes() == flight.sensors.tobytes()
    assert ("gps_velocity_z", "m/s") in [column[:2] for column in flight.columns()]


@pytest.mark.slow
def test_sensors_alone_change_no_flight(fast: Load) -> None:
    """A law that acts at all times goes on to, and its flight is read from its samples."""
    module, smooth = fast("quadrotor"), {name: x for name, x in FLOWN.items() if name != "control"}
    bare = {name: x for name, x in smooth.items() if name != "sensors"}
    flight, alone = (simulate(module, read_scenario("hover", each)) for each in (smooth, bare))
    assert flight.control_rate == 0.0
    assert np.array_equal(flight.q, alone.q)
    assert alone.sensors.shape == (61, 0)
    sensors = SensorSuite(module, changed().sensors)
    read = sensors.readings(flight.time, flight.q, flight.v, flight.a)
    assert read.tobytes() == flight.sensors.tobytes()
    noisy = simulate(module, changed(sensors=SENSORS | {"position": 1e-3}))
    assert noisy.control_rate == 50.0
    assert not np.array_equal(noisy.q, flight.q)


@pytest.mark.parametrize(
    ("robot", "sensors", "words"),
    [
        (ARM, {"imu": [{}, {}]}, "there is a sensor imu already; give each a unique name"),
        (ARM, {"gps": [{"name": "2nd"}]}, "and begin with a letter"),
        (
            ARM,
            {"imu": [{"accelerometer_range": 0}]},
            "imu 1: accelerometer_range: must be at least",
        ),
        (
            ARM,
            {"imu": [{"frame": "tipp"}]},
            "imu: quadrotor_arm_2link has no frame tipp; did you",
        ),
        ("quadrotor", {"encoders": [{}]}, "sensors.encoders: encoders: quadrotor has no joints"),
        (ARM, {}, "sensors: missing; declare"),
        (ARM, {"gps": [{}], "imu": [{"rate": 1e9}]}, "imu 1: rate: must be from 0.1 to 100000"),
        (ARM, {"gps": [{"rate": 1e4}]}, "gps 1: rate: more than 5000000 readings in 3000 s"),
    ],
)
def test_what_is_refused(robot: str, sensors: dict[str, Any], words: str, fast: Load) -> None:
    none = np.zeros(8)
    long = {"duration": 3000, "integration": {"rate": 1}, "sensors": sensors}
    with pytest.raises(GibbsCodegenError, match=re.escape(words)):
        SensorSuite(fast(robot), read_scenario("hover", long).sensors).measurements(
            at(fast(robot)), none, none
        )
