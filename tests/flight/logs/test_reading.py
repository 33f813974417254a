"""Logs read back as flights: what was recorded, on one time base, with derivatives."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

import gibbs_codegen
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.figures.curves import inputs
from gibbs_codegen.flight.figures.flight import write_figures
from gibbs_codegen.flight.logs.log import recorded_of
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight, read_flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate

Modules = Callable[[str], ModuleType]
Array = np.ndarray[Any, np.dtype[np.float64]]
# Columns: north, east and down in X east, Y north, Z up; forwards, right and down in a base's axes.
NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD = np.diag([1.0, -1.0, -1.0])
FLIGHTS = {"hexarotor_3link": "paper", "quadrotor_arm_2link": "hover"}


@pytest.fixture(scope="module", params=FLIGHTS)
def flight(fast: Modules, request: pytest.FixtureRequest) -> Flight:
    changes = {"duration": 0.6, "start.offset": [0.01, -0.02, 0.01], "integration.rate": 500}
    return simulate(fast(request.param), read_scenario(FLIGHTS[request.param], changes))


def off(flight: Flight, again: Flight) -> dict[str, float]:
    """How far series are off, accelerations as shares of the greatest; quaternions have no sign."""
    q = again.q.copy()
    if flight.attitude == "quaternion":
        q[:, 3:7] *= np.sign(np.sum(q[:, 3:7] * flight.q[:, 3:7], axis=1, keepdims=True))
    growth = np.abs(again.a - flight.a) / np.abs(flight.a).max()
    pairs = {"time": (again.time, flight.time), "q": (q, flight.q), "v": (again.v, flight.v)}
    found = {name: float(np.abs(a - b).max()) for name, (a, b) in pairs.items()}
    return {**found, "a": float(growth.max())}


def test_a_bag_gives_the_flight_again(flight: Flight, fast: Modules, tmp_path: Path) -> None:
    gibbs_codegen.write_log(flight, tmp_path / "bag")
    module = fast(flight.robot)
    for log in (tmp_path / "bag", tmp_path / "bag" / "bag.mcap"):
        again = gibbs_codegen.read_log(module, log)
        errors = off(flight, again)
        assert max(errors[name] for name in ("time", "q", "v")) < 2e-14
        assert errors["a"] < 2e-5
        np.testing.assert_allclose(again.applied, flight.applied, rtol=1e-13)
        assert again.scenario == log.name
    for name in ("positions", "base_rotation", "thrust_directions", "base_arm_angles", "parents"):
        np.testing.assert_allclose(getattr(again, name), getattr(flight, name), atol=1e-13)
    for name in ("kinetic_energy", "potential_energy", "weight", "gravity", "input_limits"):
        np.testing.assert_allclose(getattr(again, name), getattr(flight, name), rtol=1e-12)
    again.write_npz(tmp_path / "again.npz")
    again.write_csv(tmp_path / "again.csv")
    assert np.array_equal(read_flight(tmp_path / "again.npz").a, again.a)


@pytest.mark.slow
@pytest.mark.parametrize("flight", ["quadrotor_arm_2link"], indirect=True)
def test_what_is_not_known_is_left_out_of_figures(
    flight: Flight, fast: Modules, tmp_path: Path
) -> None:
    gibbs_codegen.write_log(flight, tmp_path / "bag")
    again = gibbs_codegen.read_log(
        fast(flight.robot), tmp_path / "bag", {"inputs": "/joint_states"}
    )
    figures = {path.stem for path in write_figures(again, tmp_path, ("png",))}
    assert {"coordinates", "snapshots", "energy"} <= figures
    assert "tracking_error" not in figures
    # Efforts of joints are told without the topic of inputs.
    panels = [axes.get_ylabel() for axes in inputs(again).axes]
    assert panels == ["joint torque (N m)"]
    assert gibbs_codegen.view_html(again).size > 100_000


def test_tables_give_the_flight_again(flight: Flight, fast: Modules, tmp_path: Path) -> None:
    gibbs_codegen.write_log(flight, tmp_path / "tables", "csv")
    for path in (tmp_path / "tables").iterdir():  # As `ulog2csv` names them.
        path.rename(path.with_name(f"log_7_{path.name}"))
    again = gibbs_codegen.read_log(fast(flight.robot), tmp_path / "tables")
    errors = off(flight, again)
    assert max(errors[name] for name in ("time", "q", "v")) < 2e-14
    assert errors["a"] < 2e-5
    efforts = slice(flight.rotors, None)
    np.testing.assert_allclose(again.applied[:, efforts], flight.applied[:, efforts], rtol=1e-13)
    assert np.isnan(again.applied[:, : flight.rotors]).all()


def test_a_ulog_of_topics_at_other_times(fast: Modules, tmp_path: Path) -> None:
    """Positions come at a fifth of the rate, in single precision; rates of turning do not."""
    changes = {"duration": 1.0, "start.offset": [0.02, -0.01, 0.03], "integration.rate": 500}
    module = fast("quadrotor_arm_2link")
    flight = simulate(module, read_scenario("hover", changes))
    time = 20_000_000 + np.round(flight.time * 1e6).astype(int)
    pose = module.frame_poses(flight.q)[:, 0]
    turn = NED.T @ pose[:, :3, :3] @ FRD
    attitude = np.roll(Rotation.from_matrix(turn).as_quat(), 1, axis=1)
    attitude[::7] *= -1.0  # The same attitudes.
    place = pose[:, :3, 3] @ NED
    place[50] = np.nan
    servo = flight.q[:, [8, 7]]
    log = tmp_path / "flown.ulg"
    log.write_bytes(
        ulog(
            {
                "vehicle_local_position": ("float x;float y;float z;", time[3::5], place[3::5]),
                "vehicle_attitude": ("float[4] q;", time, attitude),
                "servo": ("double[2] angle;", time, servo),
            }
        )
    )
    names = {"upper_arm": "servo.angle[1]", "forearm": "servo.angle[0]"}
    again = gibbs_codegen.read_log(module, log, names)
    inside = slice(3, 3 + len(again.time))
    assert len(again.time) == len(range(3, len(time) - 2))  # To the last of the positions.
    here = {"time": again.time + flight.time[3]}
    for name, least in (("q", 1e-6), ("v", 1e-3)):
        here[name] = getattr(again, name)
        assert np.abs(here[name][20:-20] - getattr(flight, name)[inside][20:-20]).max() < least
    np.testing.assert_allclose(here["time"], flight.time[inside], atol=1e-12)
    assert np.isnan(again.applied).all()
    # All of the base in one topic, in double precision.
    spin = np.einsum(
        "sji,sj->si", turn, module.frame_velocities(flight.q, flight.v)[:, 0, 3:] @ NED
    )
    rows = np.column_stack([pose[:, :3, 3] @ NED, attitude, spin])
    fields = "double[3] position;double[4] q;double[3] angular_velocity;"
    both = tmp_path / "both.ulg"
    both.write_bytes(
        ulog({"vehicle_odometry": (fields, time, rows), "servo": ("double[2] angle;", time, servo)})
    )
    roles = dict.fromkeys(("position", "attitude", "spin"), "vehicle_odometry")
    errors = off(flight, gibbs_codegen.read_log(module, both, names | roles))
    assert errors["q"] < 2e-14
    assert errors["v"] < 1e-4  # Of the position it is a derivative.
    # What stands is told by a number; all at a hundred samples a second.
    standing = gibbs_codegen.read_log(module, log, {"upper_arm": 0.2, "forearm": -0.1}, rate=100)
    assert np.array_equal(standing.q[:, 7:], np.tile([0.2, -0.1], (len(standing.time), 1)))
    np.testing.assert_allclose(standing.time, 0.01 * np.arange(len(standing.time)), atol=1e-12)


@pytest.mark.parametrize(
    ("pulses", "still"), [(900.0, ", which never change: nothing flew"), (0, "")]
)
def test_pulses_of_outputs_are_no_commands(
    pulses: float, still: str, shipped: Modules, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    times = 10_000 * np.arange(40)
    outputs = np.full((40, 4), pulses) + (0 if still else np.arange(40)[:, np.newaxis])
    topics = {
        "vehicle_local_position": ("float x;float y;float z;", times, np.zeros((40, 3))),
        "vehicle_attitude": ("float[4] q;", times, np.tile([1.0, 0.0, 0.0, 0.0], (40, 1))),
        "actuator_outputs": ("float[4] output;", times, outputs),
    }
    (tmp_path / "old.ulg").write_bytes(ulog(topics))
    log = recorded_of(Vehicle(shipped("quadrotor")), tmp_path / "old.ulg", {})
    assert not log.commands
    words = "old.ulg: has no actuator_motors (PX4 logs them since 1.13), but pulses of the outputs"
    assert caplog.messages == [words + still]


@pytest.mark.slow
def test_a_cutoff_takes_what_is_fast_and_delays_nothing(shipped: Modules, tmp_path: Path) -> None:
    time = np.arange(4000) / 1000.0
    slow, fast = (np.sin(2.0 * np.pi * f * time) for f in (1.0, 100.0))
    tables = {
        "vehicle_local_position": {"x": slow + 0.01 * fast, "y": 0.0 * slow, "z": 0.0 * slow},
        "vehicle_attitude": {f"q[{k}]": 0.0 * slow + (k == 0) for k in range(4)},
    }
    for topic, fields in tables.items():
        sampled = np.round(time * 1e6)
        rows = np.column_stack([sampled + 3000.0 * ("x" in fields), sampled, *fields.values()])
        np.savetxt(
            tmp_path / f"{topic}_0.csv",
            rows,
            delimiter=",",
            header=",".join(["timestamp", "timestamp_sample", *fields]),
            comments="",
        )
    module = shipped("quadrotor_arm_2link")
    names = {"upper_arm": 0.0, "forearm": 0.0}
    raw = gibbs_codegen.read_log(module, tmp_path, names)
    smooth = gibbs_codegen.read_log(module, tmp_path, names, cutoff=15.0)
    inside, north = slice(500, -500), 2.0 * np.pi * np.cos(2.0 * np.pi * time)
    # A base that is not turned in NED looks north, where its x is Y of the world.
    for flight, least, steps in ((raw, 0.009, 5.0), (smooth, 0.0, 0.02)):
        difference = np.abs(flight.q[inside, 1] - slow[inside]).max()
        assert least <= difference <= least + 2e-3
        assert np.abs(flight.v[inside, 0] - north[inside]).max() < 2.0 * np.pi * steps
    growth = -((2.0 * np.pi) ** 2) * slow
    assert np.abs(smooth.a[inside, 0] - growth[inside]).max() < 0.05
    for key, value, message in (
        ("cutoff", 500.0, "cutoff: must be between 0 and 500 Hz"),
        ("rate", 2.0, "rate: 8 samples are left; a flight needs 16"),
        ("rate", 0.0, "rate: must be positive, not 0"),
        ("rate", np.nan, "rate: must be a number of Hz; some are NaN"),
        ("rate", 1e15, "give a lower rate"),
        ("cutoff", "20", "cutoff: must be a number of Hz, not"),
    ):
        with pytest.raises(UsageError, match=message):
            gibbs_codegen.read_log(module, tmp_path, names, **{key: value})


def test_topics_of_other_names_and_kinds(shipped: Modules, tmp_path: Path) -> None:
    """A pose without a twist, logged late, and joints in messages of their own, without a stamp."""
    store = get_typestore(Stores.ROS2_JAZZY)
    kinds = store.types
    message, state = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/JointState"
    epoch, time = 1_700_000_000, np.arange(400) / 200.0
    with Writer(tmp_path / "mocap", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        poses = writer.add_connection("/mocap/pose", message, typestore=store)
        joints = writer.add_connection("/arm", state, typestore=store)
        for k, t in enumerate(time):
            stamp = kinds["builtin_interfaces/msg/Time"](epoch + int(t), round(t % 1 * 1e9))
            if k == 0:  # Before its clock has begun.
                stamp = kinds["builtin_interfaces/msg/Time"](0, 0)
            header = kinds["std_msgs/msg/Header"](stamp, "map")
            point = kinds["geometry_msgs/msg/Point"](np.sin(t), 2.0, 3.0)
            turned = Rotation.from_euler("z", 0.5 * t).as_quat()
            turned = kinds["geometry_msgs/msg/Quaternion"](*turned)
            pose = kinds[message](header, kinds["geometry_msgs/msg/Pose"](point, turned))
            none = np.zeros(0)
            name, place = (("elbow",), np.cos(t)) if k % 2 else (("shoulder",), 0.1 * t)
            unstamped = kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](0, 0), "")
            arm = kinds[state](unstamped, list(name), np.array([place]), none, none)
            at = epoch * 10**9 + round(t * 1e9)
            writer.write(poses, at + 5_000_000, store.serialize_cdr(pose, message))
            writer.write(joints, at, store.serialize_cdr(arm, state))
    names = {"odometry": "/mocap/pose", "joints": "/arm", "upper_arm": "shoulder"}
    names["forearm"] = "elbow"
    module = shipped("quadrotor_arm_2link")
    flight = gibbs_codegen.read_log(module, tmp_path / "mocap", names)
    t = flight.time + time[1]  # All is known from the first message of the elbow.
    assert len(t) == len(time) - 2
    nothing = 0.0 * t
    turn = np.stack([np.cos(0.5 * t), -np.sin(0.5 * t)], axis=1) * np.cos(t)[:, np.newaxis]
    expected = [turn[:, 0], turn[:, 1], nothing, nothing, nothing, nothing + 0.5]
    expected += [nothing + 0.1, -np.sin(t)]
    np.testing.assert_allclose(flight.v, np.stack(expected, axis=1), atol=1e-6)
    np.testing.assert_allclose(flight.q[:, 8], np.cos(t), atol=1e-7)
    for wrong, message in (
        (
            {"forearm": "wrist"},
            "no positions of the joint forearm; .* The log has: shoulder, elbow",
        ),
        (
            {"odometry": "/odom"},
            "/odom is not in it; --name odometry=TOPIC.* there are /arm .*, /mocap/pose ",
        ),
        ({"imu": "/felt"}, "/felt is not in it; --name imu=TOPIC takes the types Imu; there are /"),
        ({"wrist": "elbow"}, "names: wrist: is none of F_front_left"),
        ({"spin": "/arm"}, "names: spin: is none of F_front_left"),
        ({"F_front_left": "left"}, "mocap: has no left, named for F_front_left"),
        ({"joints": 3.0}, "names: joints: must be its name in the log, not 3.0"),
        ({"forearm": [1, 2]}, "names: forearm: must be .* or a number, where it stands, not an"),
        ({"forearm": None}, "names: forearm: must be .* or a number, where it stands"),
    ):
        with pytest.raises(UsageError, match=message):
            gibbs_codegen.read_log(module, tmp_path / "mocap", names | wrong)


@pytest.mark.parametrize("name", ["a.ulg", "a.mcap", "a.txt", "a"])
@pytest.mark.parametrize("text", [b"", b"ULog\x01\x12\x35\x01", b"\x89MCAP0\r\n"])
def test_what_is_no_log_is_refused(
    name: str, text: bytes, shipped: Modules, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(text)
    with pytest.raises(UsageError, match=f"{name}: (cannot be read as a log|has no )"):
        gibbs_codegen.read_log(shipped("quadrotor_arm_2link"), tmp_path / name)
    with pytest.raises(UsageError, match="none: does not exist; give a log"):
        gibbs_codegen.read_log(shipped("quadrotor_arm_2link"), tmp_path / "none")
    (tmp_path / "flight.npz").touch()
    with pytest.raises(UsageError, match="is a flight already"):
        gibbs_codegen.read_log(shipped("quadrotor_arm_2link"), tmp_path)


def test_a_gap_is_told_and_tables_without_rows_are_none(
    flight: Flight, fast: Modules, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    gibbs_codegen.write_log(flight, tmp_path / "tables", "csv")
    module, table = fast(flight.robot), tmp_path / "tables" / "vehicle_local_position_0.csv"
    lines = table.read_text(encoding="utf-8").splitlines(keepends=True)
    table.write_text("".join(lines[:60] + lines[160:]), encoding="utf-8")
    gibbs_codegen.read_log(module, tmp_path / "tables", rate=200.0)
    assert "position is not known for 0.202 s after 0.116 s; a spline fills the gap" in caplog.text
    table.write_text(lines[0] + "1,2\n", encoding="utf-8")
    with pytest.raises(
        UsageError, match="no vehicle_local_position that gives the position of the base"
    ):
        gibbs_codegen.read_log(module, tmp_path / "tables")
    table.write_text(lines[0], encoding="utf-8")
    with pytest.raises(UsageError, match="has no vehicle_local_position that gives"):
        gibbs_codegen.read_log(module, tmp_path / "tables")


def ulog(topics: dict[str, tuple[str, Array, Array]]) -> bytes:
    """A ULog, written from the definition of its format, of topics with fields, times and rows."""
    definitions, data = [message("B", bytes(40))], []
    for number, (topic, (fields, times, rows)) in enumerate(topics.items()):
        definitions.append(message("F", f"{topic}:uint64_t timestamp;{fields}".encode()))
        data.append((-1, message("A", struct.pack("<BH", 0, number) + topic.encode())))
        number_of = "d" if "double" in fields else "f"
        for time, row in zip(times.tolist(), rows.tolist(), strict=True):
            values = struct.pack(f"<HQ{len(row)}{number_of}", number, time, *row)
            data.append((time, message("D", values)))
    ordered = [text for _, text in sorted(data, key=lambda each: each[0])]
    return b"".join([b"ULog\x01\x12\x35\x01", struct.pack("<Q", 0), *definitions, *ordered])


def message(kind: str, text: bytes) -> bytes:
    """A message of a ULog."""
    return struct.pack("<HB", len(text), ord(kind)) + text
