"""Logs of a Crazyflie's memory card, written here as its firmware does."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from gibbs_codegen import UsageError, load, read_log
from gibbs_codegen.flight.logs.log import recorded_of
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.identification.recorded import recordings_of

FIELDS = [*(f"{kind}.{axis}(f)" for kind in ("acc", "gyro") for axis in "xyz")]
FIELDS += [f"motor.m{k}(I)" for k in range(1, 5)]
STEP = 1e-3


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Four seconds less a gap of 0.25 s: 1 g, 180°/s about x, motors at a half."""
    head = struct.pack("<BHHH", 0xBC, 2, 1, 0xFFFF) + b"fixedFrequency\0"
    head += struct.pack("<H", len(FIELDS)) + b"".join(f"{name}".encode() + b"\0" for name in FIELDS)
    times = [round(1e6 * (5 + STEP * k)) for k in range(4000) if not 2000 <= k < 2250]
    values = 0.0, 0.0, 1.0, 180.0, 0.0, 0.0, *[32768] * 4
    rows = (struct.pack("<HQ6f4I", 0xFFFF, time, *values) for time in times)
    (tmp_path / "log00").write_bytes(head + b"".join(rows))
    return tmp_path / "log00"


def test_readings_and_commands_are_in_si_units_and_a_gap_cuts_them(log: Path, caplog) -> None:
    vehicle = Vehicle(load("quadrotor"))
    recorded = recorded_of(vehicle, log, {})
    np.testing.assert_allclose(recorded.imus["base"].values[0], [0, 0, 9.80665, np.pi, 0, 0])
    most = [vehicle.module.INPUT_LIMITS[name][1] for name in vehicle.inputs]
    sent = [recorded.commands[name].values[0] for name in vehicle.inputs]
    np.testing.assert_allclose(sent, np.array(most) * 32768 / 65535)
    first, second = recordings_of(vehicle, recorded, "log00")
    assert "F_front_right are not known for 0.251 s after 1.999 s" in caplog.text
    assert abs(first.time[-1] - 2.0) < 0.01
    assert abs(second.time[0] - 2.25) < 0.01
    assert np.isnan(first.q).all()
    np.testing.assert_allclose(second.commands, np.tile(sent, (len(second.time), 1)))


def test_a_flight_needs_a_pose(log: Path) -> None:
    with pytest.raises(UsageError, match="does not contain the pose of the base"):
        read_log("quadrotor", log)
    with pytest.raises(UsageError, match="names: imu: logs of a Crazyflie"):
        read_log("quadrotor", log, {"imu": "/imu"})
    log.write_bytes(log.read_bytes()[:30])
    with pytest.raises(UsageError, match="cannot be read as a log"):
        read_log("quadrotor", log)
