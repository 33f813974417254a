"""Signs and axes of what autopilots are told, and of what they command, each by itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.autopilot import PLACES, TURNING, angles
from support.emitted import module_with_derivatives

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.autopilots.machine import Machine, Outputs, Telemetry
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.machine.filters import CALLED
from gibbs_codegen.robot.file import read_robot

Load = Callable[[str], ModuleType]
ARM = "quadrotor_arm_2link"
NONE = np.zeros(0)


def machine(module: ModuleType, servos: bool = False, **changes: Any) -> Machine:
    return Machine(module, read_scenario("hover", {"duration": 5} | changes), servos)


def told(module: ModuleType, q: list[float], v: list[float]) -> Telemetry:
    """Readings of a quadrotor that falls freely; q and v as in its module."""
    found = machine(module)
    found.simulation.reset(q, v)
    return found.readings()


LEVEL = [0.0, 0.0, 0.0, 1.0]
REST = [0.0] * 6


def about(axis: int, degrees: float) -> list[float]:
    """The quaternion, real part last, of a turn about an axis."""
    found = [0.0] * 4
    found[axis], found[3] = (f(math.radians(degrees) / 2.0) for f in (math.sin, math.cos))
    return found


@pytest.mark.slow
def test_east_north_up_are_told_as_north_east_down(fast: Load) -> None:
    seen = told(fast("quadrotor"), [1.0, 2.0, 3.0, *LEVEL], [0.4, 0.5, 0.6, 0.0, 0.0, 0.0])
    assert seen.position == pytest.approx([2.0, 1.0, -3.0])
    assert seen.velocity == pytest.approx([0.5, 0.4, -0.6])
    # The base's x is the world's X, which is east.
    assert np.degrees(angles(seen.quaternion)) == pytest.approx([0.0, 0.0, 90.0], abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axis", "roll", "pitch", "yaw"),
    [(0, 20, 0, 90), (1, 0, -20, 90), (2, 0, 0, 70)],
)
def test_turns_of_the_base(axis: int, roll: float, pitch: float, yaw: float, fast: Load) -> None:
    """By the right-hand rule about forwards, left, up: right side down, nose down, to the left."""
    rate = [0.0] * 6
    rate[3 + axis] = 0.3
    seen = told(fast("quadrotor"), [0.0, 0.0, 2.0, *about(axis, 20.0)], rate)
    assert np.degrees(angles(seen.quaternion)) == pytest.approx([roll, pitch, yaw], abs=1e-9)
    wanted = [0.0, 0.0, 0.0]
    wanted[axis] = 0.3 if axis == 0 else -0.3
    assert seen.gyro == pytest.approx(wanted)


@pytest.mark.slow
def test_a_base_of_attitude_angles_is_told_as_one_with_a_quaternion(fast: Load) -> None:
    module = fast("hexarotor")
    found = machine(module, motors={"limits": [0, 20]})
    q, v = np.array([0.2, -0.3, 0.5, 1.0, 2.0, 3.0]), np.array([0.1, 0.4, -0.2, 0.5, 0.1, -0.3])
    found.simulation.reset(q, v)
    seen, base = found.readings(), module.FRAMES.index("base")
    pose, (linear, angular) = (
        module.frame_poses(q)[base],
        module.frame_velocities(q, v)[base].reshape(2, 3),
    )
    w, x, y, z = seen.quaternion
    to_ned = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    # Forwards, right and down of the body, in the world's axes here.
    body = pose[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    assert to_ned == pytest.approx(np.array([body[1], body[0], -body[2]]), abs=1e-12)
    assert seen.position == pytest.approx([pose[1, 3], pose[0, 3], -pose[2, 3]])
    assert seen.velocity == pytest.approx([linear[1], linear[0], -linear[2]])
    assert seen.gyro == pytest.approx(body.T @ angular)


@pytest.mark.parametrize(
    ("force", "wanted"),
    [
        pytest.param([3, 0, 0], [2, 0, 0], marks=pytest.mark.slow),
        ([0, 3, 0], [0, -2, 0]),
        ([0, 0, 3], [0, 0, -2]),
    ],
)
def test_what_an_accelerometer_feels(force: list[float], wanted: list[float], fast: Load) -> None:
    """Of a body of 1.5 kg that falls and is pushed at its centre of mass, the push alone."""
    push = {"frame": "base", "force": force, "torque": [0.01 * force[1], -0.01 * force[0], 0.0]}
    seen = machine(fast("quadrotor"), push=push).readings()
    assert seen.accelerometer == pytest.approx(wanted, abs=1e-9)


@pytest.mark.slow
def test_a_body_at_rest_feels_its_weight(fast: Load) -> None:
    floor = {"frame": ["base"], "point": [0, 0, 1.8], "normal": [0, 0, 1], "stiffness": 2000.0}
    wall = [{"kind": "plane", "damping": 60.0, "ball_radius": 0.2, **floor}]
    seen = machine(fast("quadrotor"), wall=wall, start={"settled": True}).readings()
    assert seen.accelerometer == pytest.approx([0.0, 0.0, -9.81], abs=1e-6)


@pytest.mark.slow
def test_sensors_of_the_scenario_are_told_as_they_err(fast: Load) -> None:
    """Of a machine that falls freely: biases of readings, in the axes of autopilots."""
    imu = {"accelerometer_bias": [0.1, 0.2, 0.3], "gyroscope_bias": [0.01, 0.02, 0.03]}
    sensors = {
        "imu": [imu],
        "barometer": [{"altitude": 500.0}],
        "magnetometer": [{"inclination_deg": 90.0, "strength": 5e-5, "bias": [0.0, 1e-6, 0.0]}],
        "gps": [{"horizontal_noise": 1.0, "delay": 0.1}],
    }
    found = machine(fast("quadrotor"), sensors=sensors)
    seen = found.readings()
    assert seen.accelerometer == pytest.approx([0.1, -0.2, -0.3], abs=1e-9)
    assert seen.gyro == pytest.approx([0.01, -0.02, -0.03], abs=1e-9)
    assert seen.altitude == pytest.approx(502.0)
    assert seen.field == pytest.approx([0.0, -1e-6, 5e-5], abs=1e-12)
    # No fix has come before 0.1 s; afterwards it is off, and as old.
    assert seen.fix[0] == pytest.approx([0.0, 0.0, -2.0])
    for _ in range(30):
        found.fly(Outputs(np.zeros(4), NONE), 0.004)
    assert found.readings().fix[0][2] == pytest.approx(-2.0)
    assert abs(found.readings().fix[0][:2]).min() > 0.01


def test_a_filter_estimates_beside_the_autopilot() -> None:
    """By the sensors that the autopilot has, under what it commands."""
    module = module_with_derivatives(read_robot("quadrotor")[0], *CALLED)
    sensors = {"imu": [{"rate": 250}], "pose": [{"rate": 250, "position_noise": 1e-3}]}
    control = {"estimate": True, "filter": {"by": "imu"}}
    found = machine(module, sensors=sensors, control=control)
    for _ in range(30):
        found.fly(Outputs(np.full(4, 0.7), NONE), 0.004)
    flight = found.simulation.flight()
    off = flight.estimate_errors / flight.estimate_deviations[:, :12]
    assert np.linalg.norm(flight.v[-1]) > 0.1
    assert np.abs(off).max() < 4.0
    assert flight.estimate_deviations[-1, 2] < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("rotor", [1, 2, 3])
def test_every_rotor_turns_the_machine_as_its_place_says(rotor: int, fast: Load) -> None:
    found = machine(fast(ARM))
    shares = np.full(4, 0.4)
    shares[rotor] = 0.6
    found.fly(Outputs(shares, np.full(2, np.nan)), 0.02)
    forwards, right = PLACES[rotor]
    # More thrust on the right rolls to the left, in front it lifts the nose; a propeller that turns
    # counter-clockwise turns the body clockwise, to the right.
    roll, pitch, yaw = found.readings().gyro
    assert (np.sign(roll), np.sign(pitch), np.sign(yaw)) == (
        -np.sign(right),
        np.sign(forwards),
        TURNING[rotor],
    )


@pytest.mark.slow
def test_shares_are_of_the_greatest_thrust(fast: Load) -> None:
    found = machine(fast(ARM), motors={"time_constant": 0.0, "limits": [2.0, 10.0]})
    found.fly(Outputs(np.array([-0.5, 0.0, 0.25, 1.5]), np.full(2, np.nan)), 0.01)
    assert found.simulation.flight().applied[-1, :4].tolist() == [2.0, 2.0, 4.0, 10.0]


@pytest.mark.slow
def test_servos_move_joints_over_their_limits(fast: Load) -> None:
    """Places from -1 to 1 are from limit to limit; those that are not told stay as they are."""
    found = machine(fast(ARM), servos=True, control={"frequency": 15.0})
    for servos, wanted in (([0.5, np.nan], [50.0, 0.0]), ([np.nan, -0.25], [50.0, -35.0])):
        for _ in range(250):
            found.fly(Outputs(np.full(4, 0.43), np.array(servos)), 0.004)
        assert np.degrees(found.simulation.q[7:]) == pytest.approx(wanted, abs=0.5)


@pytest.mark.slow
def test_joints_follow_the_scenario_while_the_base_falls_and_turns(fast: Load) -> None:
    moves = {"upper_arm": [{"to": 57.0, "duration": 1.0, "begin": 0.1}]}
    found = machine(fast(ARM), arm={"moves_deg": moves}, control={"frequency": 10.0})
    for _ in range(300):
        found.fly(Outputs(np.array([0.1, 0.1, 0.12, 0.1]), np.full(2, np.nan)), 0.004)
    assert np.degrees(found.simulation.q[7:]) == pytest.approx([57.0, 0.0], abs=1.0)


def test_what_outputs_are_shares_of_must_be_known(fast: Load) -> None:
    with pytest.raises(UsageError, match=r"theta_7.* -1 to 1 .*; give limits .* or arm\.limits"):
        machine(fast("hexarotor_3link"), servos=True, motors={"limits": [0, 20]})
    with pytest.raises(UsageError, match=r"F_1.*give limits in the robot file, or motors\.limits"):
        machine(fast("hexarotor_3link"))
