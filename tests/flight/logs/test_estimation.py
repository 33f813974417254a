"""Estimates by logs: biases that were put in are found, and what a log lacks is said."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from support.emitted import module_with_derivatives

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.logs.reading import Recorded, Samples, flight_of_log
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.machine.filters import CALLED
from gibbs_codegen.robot.file import read_robot

BIAS = np.array([0.3, -0.2, 0.1, 0.02, -0.03, 0.01])


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return Vehicle(module_with_derivatives(read_robot("quadrotor")[0], *CALLED))


@pytest.fixture(scope="module")
def recorded() -> Recorded:
    """A base on a way of sines, by its pose and an IMU with biases, and no inputs."""
    time, rng = np.arange(-0.05, 3.05, 0.001), np.random.default_rng(3)
    place = np.stack([np.sin(2 * time), 0.5 * np.cos(3 * time), 0.3 * time], axis=1)
    turned = Rotation.from_rotvec(
        np.stack([0.3 * np.sin(3 * time), 0.2 * time, 0.4 * np.cos(time)], 1)
    )
    spin = (turned[:-2].inv() * turned[2:]).as_rotvec() / 0.002
    growth = CubicSpline(time, place)(time[1:-1], 2)
    force = turned[1:-1].inv().apply(growth + np.array([0.0, 0.0, 9.81]))
    felt = np.hstack([force, spin]) + BIAS + 1e-3 * rng.standard_normal((len(spin), 6))
    stamps = np.round(1e9 * time).astype(np.int64)
    poses, shaken = slice(50, -50, 20), 1e-3 * rng.standard_normal((len(time[50:-50:20]), 3))
    attitudes = (turned[poses] * Rotation.from_rotvec(shaken)).as_quat()
    places = place[poses] + 1e-3 * rng.standard_normal(shaken.shape)
    pose = Samples(stamps[poses], places), Samples(stamps[poses], attitudes)
    imu = Samples(stamps[1:-1:4], felt[::4])
    return Recorded(*pose, None, None, {}, {}, {}, (), {"base": imu})


SCENARIO = {
    "name": "sensed",
    "duration": 1.0,
    "control": {"estimate": True, "filter": {"by": "imu", "start": 0.3}},
    "sensors": {
        "imu": [
            {
                "rate": 250,
                "accelerometer_noise": 1e-3,
                "accelerometer_bias": [0.3, 0.3, 0.3],
                "gyroscope_noise": 1e-3,
                "gyroscope_bias": [0.03, 0.03, 0.03],
            }
        ],
        "pose": [{"rate": 50, "position_noise": 1e-3, "attitude_noise": 1e-3}],
    },
}


def test_biases_of_a_log_are_found(vehicle: Vehicle, recorded: Recorded) -> None:
    flight = flight_of_log(vehicle, recorded, "log", None, None, read_scenario(SCENARIO))
    found, deviations = flight.estimates[-1, 13:], flight.estimate_deviations[-1, 12:]
    assert flight.estimate_names[3] == "imu_angular_velocity_x_bias"
    assert deviations.max() < 0.04
    assert np.abs((found - BIAS) / deviations).max() < 3.0


def test_what_a_log_lacks_is_said(vehicle: Vehicle, recorded: Recorded) -> None:
    for changes, words in (
        ({"control.filter.by": "model"}, "has no F_front_left, .*, which the model needs"),
        (
            {"sensors.barometer": [{}]},
            "no readings of barometer at base, but pose at base, imu at base",
        ),
        ({"sensors.pose": [{}, {"name": "b"}]}, "pose: b and pose read the same data of the log"),
    ):
        with pytest.raises(UsageError, match=words):
            flight_of_log(vehicle, recorded, "log", None, None, read_scenario(SCENARIO, changes))


def test_inputs_act_when_the_log_says(vehicle: Vehicle, recorded: Recorded) -> None:
    """Up and down by thrusts that swing faster than ten samples a second tell."""
    time = np.arange(0, 3.0, 0.004)
    stamps = np.round(1e9 * time).astype(np.int64)
    weight = 9.81 * vehicle.function("mass_matrix")(vehicle.neutral)[0, 0]
    thrust = Samples(stamps, 0.25 * weight * (1.0 + 0.5 * np.cos(60.0 * time)))
    height = 0.5 * 9.81 / 60.0**2 * (1.0 - np.cos(60.0 * time))
    place = np.stack([0.0 * time, 0.0 * time, height], axis=1)
    log = recorded._replace(
        position=Samples(stamps, place),
        attitude=Samples(stamps, np.tile([0.0, 0, 0, 1], (len(time), 1))),
        inputs=dict.fromkeys(vehicle.inputs, thrust),
    )
    changes = {
        "control.filter": {"start": 1e-4, "acceleration": 1e-3, "force": 0.0, "torque": 0.0},
        "sensors": {"pose": [{"rate": 250, "position_noise": 0.1, "attitude_noise": 0.1}]},
    }
    scenario = read_scenario({**SCENARIO, "sensors": {}, "control": {"estimate": True}}, changes)
    flight = flight_of_log(vehicle, log, "log", 10.0, None, scenario)
    assert flight.time[1] > 0.09
    assert np.abs(flight.estimate_errors[:, 2]).max() < 1e-3
