"""Tables in the topics and axes of PX4."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gibbs_codegen
from gibbs_codegen.flight.logs.log import recorded_of
from gibbs_codegen.flight.logs.motion import base_motion
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate

Modules = Callable[[str], ModuleType]
# Columns: north, east and down in X east, Y north, Z up; forwards, right and down in a base's axes.
NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module", params=["hexarotor_3link", "quadrotor_arm_2link"])
def flight(fast: Modules, request: pytest.FixtureRequest) -> Flight:
    scenario = "paper" if request.param == "hexarotor_3link" else "hover"
    changes = {"duration": 0.3, "start": {"offset": [0.1, 0.0, 0.0]}}
    return simulate(fast(request.param), read_scenario(scenario, changes))


def test_tables_have_the_axes_and_names_of_px4(
    flight: Flight, fast: Modules, tmp_path: Path
) -> None:
    gibbs_codegen.write_log(flight, tmp_path / "log", "csv")
    tables = {path.name: _read(path) for path in (tmp_path / "log").iterdir()}
    names = "actuator_motors joint_states sensor_combined vehicle_angular_velocity vehicle_attitude"
    assert sorted(tables) == [
        f"{name}_0.csv" for name in (*names.split(), "vehicle_local_position")
    ]
    for header, rows in tables.values():
        assert header[0] == "timestamp"
        assert [row[0] for row in rows] == [str(round(t * 1e6)) for t in flight.time]
    module, q, v = fast(flight.robot), flight.q, flight.v
    pose, twist = module.frame_poses(q)[:, 0], module.frame_velocities(q, v)[:, 0]
    growth = np.einsum("sij,sj->si", module.frame_jacobians(q)[:, 0], flight.a)
    growth = (growth + module.frame_bias_accelerations(q, v)[:, 0])[:, :3]
    turn = NED.T @ pose[:, :3, :3] @ FRD

    def column(topic: str, *fields: str) -> np.ndarray:
        header, rows = tables[f"{topic}_0.csv"]
        return np.array([[float(row[header.index(field)]) for field in fields] for row in rows])

    def listed(topic: str, name: str, count: int = 3) -> np.ndarray:
        return column(topic, *(f"{name}[{k}]" for k in range(count)))

    def same(found: np.ndarray, expected: np.ndarray) -> None:
        np.testing.assert_allclose(found, expected, atol=1e-11)

    local = "vehicle_local_position"
    same(column(local, "x", "y", "z"), pose[:, :3, 3] @ NED)
    same(column(local, "vx", "vy", "vz"), twist[:, :3] @ NED)
    same(column(local, "ax", "ay", "az"), growth @ NED)
    same(column(local, "heading")[:, 0], np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))
    attitude = listed("vehicle_attitude", "q", 4)
    same(Rotation.from_quat(np.roll(attitude, -1, axis=1)).as_matrix(), turn)
    assert np.abs(np.diff(attitude, axis=0)).max() < 0.1
    spin = np.einsum("sji,sj->si", turn, twist[:, 3:] @ NED)
    same(listed("vehicle_angular_velocity", "xyz"), spin)
    same(listed("sensor_combined", "gyro_rad"), spin)
    felt = np.einsum("sji,sj->si", turn, (growth - [(0.0, 0.0, -9.81)]) @ NED)
    same(listed("sensor_combined", "accelerometer_m_s2"), felt)
    joints = slice(7, None) if flight.attitude == "quaternion" else slice(3, -3)
    n = len(flight.coordinates[joints])
    assert np.array_equal(listed("joint_states", "position", n), q[:, joints])
    assert np.array_equal(listed("joint_states", "effort", n), flight.applied[:, flight.rotors :])
    most = flight.input_limits[1, : flight.rotors]
    shares = np.full((len(q), 12), np.nan)
    shares[:, : flight.rotors] = flight.commanded[:, : flight.rotors] / most
    shares[:, np.flatnonzero(np.isinf(most))] = np.nan
    np.testing.assert_array_equal(listed("actuator_motors", "control", 12), shares)


def _read(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return header, rows


def test_readings_and_commands_of_tables_are_those_of_the_flight(
    flight: Flight, fast: Modules, tmp_path: Path
) -> None:
    gibbs_codegen.write_log(flight, tmp_path / "log", "csv")
    log = recorded_of(Vehicle(fast(flight.robot)), tmp_path / "log", {})
    # Shares of what has no limit are unknown.
    limited = np.isfinite(flight.input_limits[1])
    rotors = zip(flight.input_names[: flight.rotors], limited, strict=False)
    assert [*log.commands] == [name for name, has in rotors if has]
    for name, samples in log.commands.items():
        sent = flight.commanded[:, flight.input_names.index(name)]
        np.testing.assert_allclose(samples.values, sent, atol=1e-9)
    base = base_motion(flight)
    felt = np.concatenate([base.specific_force, base.spin], axis=1)
    np.testing.assert_allclose(log.imus["base"].values, felt, atol=1e-9)
