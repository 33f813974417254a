"""Bags of ROS 2 that rosbags and mcap read, with values that the modules' own functions give."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

import gibbs_codegen
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.logs import ros
from gibbs_codegen.flight.logs.log import recorded_of
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate

Modules = Callable[[str], ModuleType]
# A base with angles whose x, y, z are those of a motor, and one with a quaternion.
FLIGHTS = {"hexarotor_3link": "paper", "quadrotor_arm_2link": "hover"}


@pytest.fixture(scope="module", params=FLIGHTS)
def flight(fast: Modules, request: pytest.FixtureRequest) -> Flight:
    changes = {"duration": 0.3, "start": {"offset": [0.1, 0.0, 0.0]}}
    return simulate(fast(request.param), read_scenario(FLIGHTS[request.param], changes))


def test_every_message_is_read_back_with_its_values(
    flight: Flight, fast: Modules, tmp_path: Path
) -> None:
    gibbs_codegen.write_log(flight, tmp_path / "bag")
    messages, raw = _read(tmp_path / "bag")
    topics = {"/clock", "/tf", "/odom", "/imu", "/joint_states", "/inputs", "/actuators"}
    assert set(messages) == topics
    samples = len(flight.time)
    nanoseconds = [round(t * 1e9) for t in flight.time]
    # The other library has the same bytes at the same times.
    with (tmp_path / "bag" / "bag.mcap").open("rb") as file:
        seen: dict[str, list[Any]] = defaultdict(list)
        for _, channel, message in make_reader(file).iter_messages():
            seen[channel.topic].append((message.log_time, message.data))
    assert seen == raw
    for topic, found in messages.items():
        assert len(found) == samples
        assert [time for time, _ in raw[topic]] == nanoseconds
    stamped = [m.header.stamp for m in messages["/odom"]]
    assert [s.sec * 10**9 + s.nanosec for s in stamped] == nanoseconds
    assert [m.clock for m in messages["/clock"]] == stamped

    module = fast(flight.robot)
    q, v, a = flight.q, flight.v, flight.a
    pose, twist = module.frame_poses(q)[:, 0], module.frame_velocities(q, v)[:, 0]
    turn = np.swapaxes(pose[:, :3, :3], 1, 2)
    for found in (
        [(m.pose.pose.position, m.pose.pose.orientation) for m in messages["/odom"]],
        [(t.transform.translation, t.transform.rotation) for t in _transforms(messages)],
    ):
        places, attitudes = (_numbers(each) for each in zip(*found, strict=True))
        np.testing.assert_allclose(places, pose[:, :3, 3], atol=1e-14)
        rotations = Rotation.from_quat(attitudes).as_matrix()
        np.testing.assert_allclose(rotations, pose[:, :3, :3], atol=1e-14)
    moving = [m.twist.twist for m in messages["/odom"]]
    for values, world in (
        (_numbers(m.linear for m in moving), twist[:, :3]),
        (_numbers(m.angular for m in moving), twist[:, 3:]),
        (_numbers(m.angular_velocity for m in messages["/imu"]), twist[:, 3:]),
    ):
        np.testing.assert_allclose(values, np.einsum("sij,sj->si", turn, world), atol=1e-13)
    felt = np.einsum("sij,sj->si", module.frame_jacobians(q)[:, 0], a)
    felt = (felt + module.frame_bias_accelerations(q, v)[:, 0])[:, :3] + [0.0, 0.0, 9.81]
    measured = _numbers(m.linear_acceleration for m in messages["/imu"])
    np.testing.assert_allclose(measured, np.einsum("sij,sj->si", turn, felt), atol=1e-11)

    for k, (state, inputs) in enumerate(
        zip(messages["/joint_states"], messages["/inputs"], strict=True)
    ):
        joints = slice(7, None) if flight.attitude == "quaternion" else slice(3, -3)
        rates = slice(6, None) if flight.attitude == "quaternion" else slice(3, -3)
        assert tuple(state.name) == flight.coordinates[joints]
        assert np.array_equal(state.position, q[k, joints])
        assert np.array_equal(state.velocity, v[k, rates])
        assert np.array_equal(state.effort, flight.applied[k, flight.rotors :])
        assert tuple(inputs.name) == flight.input_names
        assert np.array_equal(inputs.effort, flight.applied[k])


def test_actuators_have_the_lists_of_their_commands(fast: Modules, tmp_path: Path) -> None:
    flight = simulate(fast("quadrotor_arm_2link"), read_scenario("hover", {"duration": 0.03}))
    n = len(flight.time)
    limits = np.array([[0.0] * 6, [14.0, 7.0, 7.0, np.inf, 5.0, 5.0]])
    plain = dataclasses.replace(flight, input_limits=limits)
    gibbs_codegen.write_log(plain, tmp_path / "plain")
    shares = plain.commanded / [14.0, 7.0, 7.0, np.nan, 5.0, 5.0]
    for message, values in zip(_read(tmp_path / "plain")[0]["/actuators"], shares, strict=True):
        assert len(message.position) == len(message.velocity) == 0
        np.testing.assert_array_equal(message.normalized, values)
    commands = np.arange(6.0 * n).reshape(n, 6)
    driven = dataclasses.replace(
        plain,
        command_names=tuple("abcdef"),
        command_units=("rad/s", "1", "N", "rad/s", "rad", "N m"),
        commands=commands,
    )
    gibbs_codegen.write_log(driven, tmp_path / "driven")
    for k, message in enumerate(_read(tmp_path / "driven")[0]["/actuators"]):
        np.testing.assert_array_equal(message.velocity, commands[k, [0, 3]])
        np.testing.assert_array_equal(message.position, commands[k, [4]])
        expected = [commands[k, 1], commands[k, 2] / 7.0, commands[k, 5] / 5.0]
        np.testing.assert_array_equal(message.normalized, expected)


def test_imus_of_the_robot_take_the_place_of_the_exact_one(
    fast: Modules, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    imu = {"rate": 500, "accelerometer_noise": 0.1, "gyroscope_noise": 0.01}
    sensors = {"imu": [{"name": "hand", "frame": "tip"}, imu], "encoders": [{}]}
    sensors["pose"] = [{"name": "wrist", "frame": "tip"}]
    scenario = read_scenario("hover", {"duration": 0.2, "sensors": sensors})
    flight = simulate(fast("quadrotor_arm_2link"), scenario)
    gibbs_codegen.write_log(flight, tmp_path / "bag")
    messages = _read(tmp_path / "bag")[0]
    for topic, frame, first in (("/imu/hand", "tip", 0), ("/imu", "base", 6)):
        name = topic.split("/")[-1]
        assert flight.sensor_names[first] == f"{name}_acceleration_x"
        for message, values in zip(messages[topic], flight.sensors, strict=True):
            assert message.header.frame_id == frame
            assert message.orientation_covariance[0] == -1.0
            force, spin = message.linear_acceleration, message.angular_velocity
            assert np.array_equal(_numbers([force, spin]).ravel(), values[first : first + 6])
    unread = "/imu/hand, /pose/wrist"
    for name, joints in (
        ("quadrotor_arm_2link", ""),
        ("quadrotor", ", the joint upper_arm, the joint forearm"),
    ):
        log = recorded_of(Vehicle(fast(name)), tmp_path / "bag", {})
        assert log.unread == f"{unread}{joints}"
    gibbs_codegen.write_log(flight, tmp_path / "tables", "csv")
    table = np.genfromtxt(tmp_path / "tables" / "sensor_combined_0.csv", delimiter=",", names=True)
    expected = flight.sensors[:, 6:12] * [1.0, -1.0, -1.0, 1.0, -1.0, -1.0]
    names = [f"{name}{k}" for name in ("accelerometer_m_s2", "gyro_rad") for k in range(3)]
    np.testing.assert_array_equal(np.stack([table[name] for name in names], axis=1), expected)
    with pytest.raises(UsageError, match=r"has no felt that gives the imu .* there are actuator_m"):
        gibbs_codegen.read_log(fast("quadrotor_arm_2link"), tmp_path / "tables", {"imu": "felt"})
    for log, name in (("bag", "left"), ("tables", "actuator_motors.left")):
        # Though /actuators and actuator_motors have what is commanded.
        module, names = fast("quadrotor_arm_2link"), {"F_front_left": name}
        with pytest.raises(UsageError, match=f"has no {name}, named for F_front_left"):
            gibbs_codegen.read_log(module, tmp_path / log, names)
    with pytest.raises(UsageError, match="/pose/wrist has poses of tip, which joints move"):
        gibbs_codegen.read_log(module, tmp_path / "bag", {"odometry": "/pose/wrist"})
    gibbs_codegen.read_log(fast("quadrotor"), tmp_path / "bag", {"imu": "/imu/hand"})
    assert (
        "/imu/hand: quadrotor has no frame tip; the readings are taken as those of the base"
        in caplog.text
    )


def test_poses_of_several_frames_in_a_topic_are_each_those_of_its_frame(
    fast: Modules, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of a tracker of several bodies: of the base, and of a camera that is pitched on it."""
    sensors = {"pose": [{"rate": 100}, {"name": "eye", "frame": "camera", "rate": 100}]}
    changes = {"duration": 0.3, "start": {"offset": [0.1, 0.0, 0.0]}, "sensors": sensors}
    flight = simulate(fast("quadrotor"), read_scenario("hover", changes))
    gibbs_codegen.write_log(flight, tmp_path / "bag")
    read = ros.read_messages

    def together(path: Path, topics: set[str]) -> Any:
        kinds, messages = read(path, {*topics, "/pose/eye"})
        both = [*messages["/pose"], *messages.pop("/pose/eye")]
        return kinds, messages | {"/pose": sorted(both, key=lambda message: message[0])}

    monkeypatch.setattr(ros, "read_messages", together)
    vehicle = Vehicle(fast("quadrotor"))
    log = recorded_of(vehicle, tmp_path / "bag", {"odometry": "/pose"})
    assert log.position is not None
    assert log.attitude is not None
    rows = np.searchsorted(np.round(1e9 * flight.time), log.position.time)
    assert len(rows) > 50
    pose = vehicle.module.frame_poses(flight.q[rows])[:, 0]
    np.testing.assert_allclose(log.position.values, pose[:, :3, 3], atol=1e-9)
    turned = Rotation.from_quat(log.attitude.values).as_matrix()
    np.testing.assert_allclose(turned, pose[:, :3, :3], atol=1e-9)


def test_what_is_in_the_way_is_left_alone(flight: Flight, tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(UsageError, match="there: exists already; choose another name"):
        gibbs_codegen.write_log(flight, tmp_path / "there")
    with pytest.raises(UsageError, match="'bag': unknown; known: mcap, csv"):
        gibbs_codegen.write_log(flight, tmp_path / "new", "bag")
    assert [path.name for path in tmp_path.iterdir()] == ["there"]
    old = dataclasses.replace(flight, gravity=np.nan)
    gibbs_codegen.write_log(old, tmp_path / "old")
    assert "/imu" not in _read(tmp_path / "old")[0]


def _read(folder: Path) -> tuple[dict[str, list[Any]], dict[str, list[tuple[int, bytes]]]]:
    """Messages of each topic, and their times and bytes, which are those that rosbags writes."""
    messages: dict[str, list[Any]] = defaultdict(list)
    raw: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    with AnyReader([folder]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            assert reader.typestore.serialize_cdr(message, connection.msgtype) == data
            messages[connection.topic].append(message)
            raw[connection.topic].append((time, data))
    return messages, raw


def _transforms(messages: dict[str, list[Any]]) -> list[Any]:
    found = [transform for m in messages["/tf"] for transform in m.transforms]
    assert {(t.header.frame_id, t.child_frame_id) for t in found} == {("world", "base")}
    return found


def _numbers(messages: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Vectors and quaternions as rows."""
    return np.array([[getattr(m, name) for name in "xyzw" if hasattr(m, name)] for m in messages])
