"""Accelerations alone: no pose, readings that are late, and a robot file that is far off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gibbs_codegen import generate, identify, load, read_scenario, simulate
from gibbs_codegen.identification.recorded import Recording, recording_of

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
    """Ten seconds of a lively flight, of which the IMU is read, late, and the commands."""
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
        "sensors.imu": [{"rate": 250, "accelerometer_noise": 0.05, "gyroscope_noise": 0.005}],
    }
    whole = recording_of(simulate(module, read_scenario("circle", changes)), module, "imu")
    felt = {
        frame: np.stack([np.interp(whole.time - DELAY, whole.time, c) for c in values.T], axis=1)
        for frame, values in whole.imus.items()
    }
    return replace(whole, q=np.full_like(whole.q, np.nan), imus=felt)


def test_inertias_are_found_without_a_pose_though_readings_are_late(module, recording) -> None:
    found = identify(module, recording, ["base_inertia_??"], hold_out=0.25)
    assert found.settled
    exact = np.array([3.0 * FILE[name] for name in found.names])
    np.testing.assert_allclose(found.values[:2], exact[:2], rtol=0.03)
    # It hardly turns about z: its gyroscope tells noise for the most part.
    np.testing.assert_allclose(found.values[2], exact[2], rtol=0.1)
    assert np.abs((found.values - exact) / found.deviations).max() < 4.0
    ((delay, deviation),) = found.others.values()
    assert delay == pytest.approx(DELAY, abs=max(4 * deviation, 3e-4))
    for before, after in (found.prediction[f"acceleration along w{axis}"] for axis in "xy"):
        assert after < 0.3 * before
