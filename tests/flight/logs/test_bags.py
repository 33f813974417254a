"""Logs of other programs, by hand: a circle of 1 m, flown at 1 rad/s, 20 messages a second."""

from __future__ import annotations

import random
import shutil
import sqlite3
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

import gibbs_codegen
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.logs.bags import message_types

Modules = Callable[[str], ModuleType]
TIMES = 10.0 + 0.05 * np.arange(41)
ODOMETRY, TRANSFORM = "nav_msgs/msg/Odometry", "geometry_msgs/msg/TransformStamped"
POSE, COVARIANCE = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped"
IMU = "sensor_msgs/msg/Imu"
MCAP, SQLITE, FIRST = ".mcap", ".db3", ".bag"


@cache
def types_of(store: str) -> Any:
    """The types of messages of ROS1_NOETIC or ROS2_JAZZY."""
    return get_typestore(Stores[store])


def message(store: str, kind: str, stamp: float, shift: float = 0.0, turn: Any = None) -> Any:
    """A message of a time, s, with all that it has of the circle, `shift` m further on."""
    make = types_of(store).types

    def made(kind: str) -> Any:
        values = {}
        fields: Any = types_of(store).fielddefs[kind][1]
        for name, (node, detail) in fields:
            if node == Nodetype.NAME:
                values[name] = made(detail)
            elif node == Nodetype.BASE:
                values[name] = "" if detail[0] == "string" else 0
            else:
                values[name] = np.zeros(detail[1])
        if kind == "builtin_interfaces/msg/Time":
            values["sec"], values["nanosec"] = divmod(round(stamp * 1e9), 10**9)
        if name == "z":  # Of the position; a twist is not looked at.
            values |= {"x": shift + np.sin(stamp), "y": np.cos(stamp), "z": 1.0}
        if name == "w":
            attitude = (0.0, 0.0, np.sin(0.15 * stamp), np.cos(0.15 * stamp))
            values = dict(zip("xyzw", attitude if turn is None else turn, strict=True))
        return make[kind](**values)

    return made(kind)


def written(
    folder: Path, suffix: str, rows: Iterable[tuple[float, Any]], kind: str = ODOMETRY
) -> Path:
    """A bag of messages, by arguments of these after when each was logged, s."""
    store = "ROS1_NOETIC" if suffix == FIRST else "ROS2_JAZZY"
    types = types_of(store)
    folder.mkdir(exist_ok=True)
    path = folder / f"log{suffix if suffix == FIRST else ''}"
    options: dict[str, Any] = {"version": 8, "storage_plugin": StoragePlugin.MCAP}
    if suffix == SQLITE:
        options["storage_plugin"] = StoragePlugin.SQLITE3
    writer: Any = rosbag1.Writer(path) if suffix == FIRST else rosbag2.Writer(path, **options)
    with writer:
        channel = writer.add_connection("/odom", kind, typestore=types)
        pack = types.serialize_ros1 if suffix == FIRST else types.serialize_cdr
        for logged, arguments in rows:
            text = pack(message(store, kind, *arguments), kind)
            writer.write(channel, round(logged * 1e9), text)
    return path


def off_circle(flight: Any) -> float:
    """By how much positions are off the circle, m, by the time since its first message."""
    places = flight.q[:, [flight.coordinates.index(name) for name in "xyz"]]
    begin = np.arctan2(places[0, 0], places[0, 1]) + flight.time
    circle = np.stack([np.sin(begin), np.cos(begin), np.ones_like(begin)], axis=1)
    return float(np.abs(places - circle).max())


@pytest.fixture(scope="module")
def quadrotor(shipped: Modules) -> ModuleType:
    return shipped("quadrotor")


PLAIN = [(t, (t,)) for t in TIMES]
ZERO = [(t, (t, 0.0, [0.0] * 4 if k < 5 or k == 20 else None)) for k, t in enumerate(TIMES)]


@pytest.mark.parametrize(
    ("suffix", "kind", "rows", "samples"),
    [
        *((suffix, kind, PLAIN, 41) for suffix in (MCAP, FIRST) for kind in (POSE, TRANSFORM)),
        (SQLITE, COVARIANCE, PLAIN, 41),
        (FIRST, ODOMETRY, ZERO, 35),
        (SQLITE, TRANSFORM, ZERO, 35),
    ],
)
def test_messages_with_a_pose_are_read_once_there_is_one(
    suffix: str, kind: str, rows: Any, samples: int, quadrotor: ModuleType, tmp_path: Path
) -> None:
    path = written(tmp_path, suffix, rows, kind)
    flight = gibbs_codegen.read_log(quadrotor, path)
    assert len(flight.time) == samples
    assert off_circle(flight) < 1e-9
    if suffix == SQLITE:  # Before ROS 2 Iron, and one whose recorder did not end.
        with sqlite3.connect(path / "log.db3") as base:
            base.execute("drop table message_definitions")
        (path / "metadata.yaml").unlink()
        assert np.array_equal(gibbs_codegen.read_log(quadrotor, path).q, flight.q)


def test_types_are_the_same_in_all_distributions() -> None:
    known = message_types().fielddefs
    kinds = [ODOMETRY, POSE, COVARIANCE, TRANSFORM, "sensor_msgs/msg/JointState"]
    for kind in kinds:  # With those that they are made of.
        kinds += [d for _, (node, d) in known[kind][1] if node == Nodetype.NAME and d not in kinds]
    for each in Stores:
        store = get_typestore(each).fielddefs if each is not Stores.EMPTY else known
        other = {kind for kind in kinds if store[kind][1] != known[kind][1]}
        assert other == ({"std_msgs/msg/Header"} if each is Stores.ROS1_NOETIC else set())


# A clock that is set back, or a simulation that begins again, and bags' clock with it or not.
AGAIN = [(t - 0.9875, (t - 0.9875, 5.0)) for t in TIMES[:30]]
LATER = [(12.5 + t, (t + 0.025, 5.0)) for t in TIMES]


@pytest.mark.parametrize("suffix", [MCAP, SQLITE, FIRST])
@pytest.mark.parametrize("again", [AGAIN, LATER])
def test_of_a_clock_that_goes_back_one_run_is_read(
    suffix: str, again: Any, quadrotor: ModuleType, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    late = list(PLAIN)
    late[8:10] = [PLAIN[9], PLAIN[8]]  # One message that is late is left out.
    path = written(tmp_path, suffix, [*late, *again])
    flight = gibbs_codegen.read_log(quadrotor, path)
    assert len(flight.time) == 40
    assert off_circle(flight) < 1e-9
    assert "jumps back, or ahead by more than an hour; of the 2 parts between" in caplog.text


def tables(folder: Path, times: Iterable[Any] = range(0, 2_050_000, 50_000)) -> Path:
    """Tables as ulog2csv makes them, and two that nobody asks for."""
    folder.mkdir()
    place, attitude = "timestamp,callsign,x,y,z\n", "timestamp,q[0],q[1],q[2],q[3]\n"
    for k, t in enumerate(times):
        angle = 10.0 + 0.05 * k
        place += f"{t},,{np.cos(angle)!r},{np.sin(angle)!r},-1.0\n".replace("np.float64", "")
        attitude += f"{t},1.0,0.0,0.0,0.0\n"
    place = place.replace("(", "").replace(")", "")
    (folder / "log_vehicle_local_position_0.csv").write_text(place, encoding="utf-8")
    (folder / "log_vehicle_attitude_0.csv").write_text(attitude, encoding="utf-8")
    (folder / "transponder_0.csv").write_bytes(b"timestamp,text\n0,\n1,\xff\x00\n2\n")
    (folder / "none_0.csv").touch()
    return folder


def test_tables_with_text_and_other_delimiters(
    quadrotor: ModuleType, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    for k, delimiter in enumerate(",;\t|"):
        folder = tables(tmp_path / str(k))
        for path in folder.glob("log*"):
            path.write_text(path.read_text(encoding="utf-8").replace(",", delimiter), "utf-8-sig")
        flight = gibbs_codegen.read_log(quadrotor, folder)
        assert (len(flight.time), off_circle(flight) < 1e-9) == (41, True)
    assert not caplog.text
    table = folder / "log_vehicle_local_position_0.csv"
    lines = table.read_text(encoding="utf-8-sig").splitlines(keepends=True)
    for k, x in ((3, "n/a"), (5, ""), (7, "1e308"), (9, "-3e290"), (11, "inf")):
        lines[k] = "|".join([f"{50000 * (k - 1)}", "", x, *lines[k].split("|")[3:]])
    lines[13] = lines[13].replace("600000", "1e300")
    lines[0] = lines[0].replace("callsign", "xy_valid")
    lines[15] = lines[15].replace("||", "|0|")  # PX4 does not know where it is.
    lines[17] = lines[17].replace("||", "||5|")  # As by a decimal comma.
    table.write_text("".join([*lines[:-1], lines[-1][:20], "\n\n"]), encoding="utf-8")
    flight = gibbs_codegen.read_log(quadrotor, folder)
    assert off_circle(flight) < 1e-4  # Where the attitude alone is known a spline goes across.
    assert (
        "8 of 41 samples of position, which are not numbers or attitudes, or are impossibly large"
        in caplog.text
    )
    gone = tables(
        tmp_path / "back", [*range(0, 2_000_000, 50_000), *range(1025000, 2000000, 50000)]
    )
    assert len(gibbs_codegen.read_log(quadrotor, gone).time) == 40
    assert "only the longest is read, number 1, with 40 samples of position" in caplog.text
    attitude = gone / "log_vehicle_attitude_0.csv"
    attitude.write_text("".join(attitude.read_text().splitlines(keepends=True)[:41]))
    with pytest.raises(
        UsageError, match=r"clock jumps back, .* cuts position into 2 parts but attitude into 1;"
    ):
        gibbs_codegen.read_log(quadrotor, gone)


def test_mcap_as_other_writers_make_it(
    quadrotor: ModuleType, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bag = written(tmp_path, MCAP, PLAIN)
    with (bag / "log.mcap").open("rb") as file:
        records = list(make_reader(file).iter_messages())
    schema: Any = records[0][0]
    channel = records[0][1]

    def other(profile: str, encoding: str, text: bytes, **options: Any) -> Path:
        path = tmp_path / "other.mcap"
        with path.open("wb") as out:
            writer: Any = McapWriter(out, chunk_size=4096, **options)
            writer.start(profile)
            kind = writer.register_schema(schema.name, schema.encoding, text)
            number = writer.register_channel(channel.topic, encoding, kind)
            for _, _, each in records:
                writer.add_message(number, each.log_time, each.data, each.publish_time)
            writer.finish()
        return path

    for profile, options in (
        ("", {}),
        ("ros2", {"repeat_channels": False}),
        ("ros2", {"use_chunking": False, "repeat_schemas": False}),
        ("x", {"compression": CompressionType.LZ4}),
    ):
        path = other(profile, "cdr", schema.data, **options)
        flight = gibbs_codegen.read_log(quadrotor, path)
        assert (len(flight.time), off_circle(flight) < 1e-9) == (41, True)
    assert not caplog.text
    whole = path.read_bytes()
    path.write_bytes(whole[: int(0.7 * len(whole))])
    assert off_circle(gibbs_codegen.read_log(quadrotor, path)) < 1e-9
    assert "only the undamaged part is read: " in caplog.text
    assert "repair it with `mcap recover`" in caplog.text
    for encoding, text in (("json", b""), ("cdr", b"float64 x")):
        path = other("", encoding, text)
        with pytest.raises(UsageError, match=r"no message of /odom with the pose.*Odometry, Pos"):
            gibbs_codegen.read_log(quadrotor, path)
        assert "41 messages of /odom are left out: damaged, or not nav_msgs/msg/Odo" in caplog.text


@pytest.mark.parametrize(
    ("suffix", "remedy"),
    [(MCAP, "`mcap recover`"), (SQLITE, "`ros2 bag reindex`"), (FIRST, "`rosbag reindex`")],
)
def test_bags_that_were_cut_short_and_of_other_types(
    suffix: str, remedy: str, quadrotor: ModuleType, tmp_path: Path
) -> None:
    path = written(tmp_path, suffix, PLAIN, IMU)
    with pytest.raises(UsageError, match=r"/Imu; --name odometry=TOPIC takes .* Transform"):
        gibbs_codegen.read_log(quadrotor, path)
    file = path if path.is_file() else path / f"log{suffix}"
    file.write_bytes(file.read_bytes()[:3000])
    with pytest.raises(UsageError, match=f"damaged or incomplete; repair it .*{remedy}"):
        gibbs_codegen.read_log(quadrotor, path)


def test_flipped_bits_are_refused_or_left_out(quadrotor: ModuleType, tmp_path: Path) -> None:
    """Warnings are errors, so that no number is beyond what floats hold, either."""
    draw = random.Random(20261129)  # noqa: S311 - not a secret
    places = {
        suffix: written(tmp_path / suffix[1:], suffix, PLAIN) for suffix in (MCAP, SQLITE, FIRST)
    }
    places[".csv"] = tables(tmp_path / "tables")
    flown = 0
    for k in range(24):
        suffix, whole = list(places.items())[k % 4]
        path = tmp_path / f"flipped{suffix}"
        if suffix == ".csv":
            path = shutil.copytree(whole, tmp_path / str(k))
        file = next(path.glob("log*")) if path.is_dir() else path
        text = bytearray((whole if whole.is_file() else next(whole.glob("log*"))).read_bytes())
        for _ in range(draw.choice([1, 3, 30])):
            text[draw.randrange(len(text))] ^= 1 << draw.randrange(8)
        file.write_bytes(text)
        try:
            flight = gibbs_codegen.read_log(quadrotor, path)
        except UsageError:
            continue
        flown += 1
        assert max(np.abs(flight.q).max(), np.abs(flight.a).max()) <= 1e8
    assert flown
