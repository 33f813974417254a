"""Flights as bags of ROS 2 in the format MCAP, and bags as series, without an installation of ROS.

World axes have z up, those of the base x forwards and y to the left, as ROS has them; so nothing is
turned.
"""

from __future__ import annotations

import logging
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError, printable, require
from gibbs_codegen.flight.logs.bags import ACTUATORS, message_types, read_messages
from gibbs_codegen.flight.logs.cdr import encoded, stamps, times_of
from gibbs_codegen.flight.logs.motion import (
    base_motion,
    imus,
    known_rows,
    on_base,
    poses,
    shares,
    unread,
)
from gibbs_codegen.flight.logs.reading import (
    NO_TIME,
    Recorded,
    Samples,
    known_attitudes,
    of_base,
    of_shares,
)
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.vectors import Array

_log = logging.getLogger("gibbs_codegen")
WORLD, BASE = "world", "base"
# By the unit of a command, the list of Actuators that it belongs to.
_LISTS = {"rad": "position", "m": "position", "rad/s": "velocity", "m/s": "velocity"}
_JOINTS, _TRANSFORM = "sensor_msgs/msg/JointState", "geometry_msgs/msg/TransformStamped"
_POSES = ("Odometry", "PoseStamped", "PoseWithCovarianceStamped", "TransformStamped")
# By what for, topics that are read, and types.
_READ = {
    "odometry": ("/odom", _POSES),
    "joints": ("/joint_states", ("JointState",)),
    "inputs": ("/inputs", ("JointState",)),
    "imu": ("/imu", ("Imu",)),
    "actuators": ("/actuators", ("Actuators",)),
}
# Times whose differences are no more than integers hold, ns.
_LATEST = 2**62
# Samples that are encoded at a time, which bounds the memory.
_ROWS = 4096


def write_bag(flight: Flight, folder: Path) -> None:
    """Write a flight to a folder, which must not exist, with an MCAP file of its name."""
    require("rosbags", "logs of ROS", "logs")
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    store, times = message_types(), times_of(flight.time).tolist()
    with_messages, new = topics_of(flight)
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        channels = [
            writer.add_connection(topic, kind, typestore=store)
            for topic, (kind, _) in with_messages.items()
        ]
        for begin in range(0, len(times), _ROWS):
            rows = range(begin, min(begin + _ROWS, len(times)))
            blocks = [
                encoded(store.fielddefs, kind, values, rows)
                for kind, values in with_messages.values()
            ]
            for row in rows:
                for topic, channel, block in zip(with_messages, channels, blocks, strict=True):
                    if topic not in new or new[topic][row]:
                        writer.write(channel, times[row], block[row - begin].tobytes())


Topics = dict[str, tuple[str, Mapping[str, Any]]]


def topics_of(flight: Flight) -> tuple[Topics, dict[str, NDArray[np.bool_]]]:
    """By topic the type of its messages and their values, of samples (s), and which are written.

    Of topics of sensors these are the samples with a new reading, of others all.
    """
    stamp, base = stamps(flight.time), base_motion(flight)
    header = {"stamp": stamp, "frame_id": WORLD}
    place, attitude = _named("xyz", base.position), _named("xyzw", base.quaternion)
    twist = {"linear": _named("xyz", base.velocity), "angular": _named("xyz", base.spin)}
    odometry = {
        "header": header,
        "child_frame_id": BASE,
        "pose": {"pose": {"position": place, "orientation": attitude}},
        "twist": {"twist": twist},
    }
    transform = _transform(header, BASE, base.position, base.quaternion)
    efforts = {"name": flight.input_names, "effort": flight.applied}
    no_attitude = -1.0 * (np.arange(9) == 0) * np.ones((len(flight.time), 1))
    new = dict[str, NDArray[np.bool_]]()
    topics: Topics = {
        "/clock": ("rosgraph_msgs/msg/Clock", {"clock": stamp}),
        "/tf": ("tf2_msgs/msg/TFMessage", {"transforms": [transform]}),
        "/odom": ("nav_msgs/msg/Odometry", odometry),
        "/inputs": (_JOINTS, {"header": header, **efforts}),
        "/actuators": (ACTUATORS, {"header": header, **_commands(flight)}),
    }
    places, rates = flight.layout.q.joints, flight.layout.v.joints
    if joints := flight.coordinates[places]:
        state = {
            "name": joints,
            "position": flight.q[:, places],
            "velocity": flight.v[:, rates],
            "effort": flight.applied[:, flight.rotors :],
        }
        topics["/joint_states"] = (_JOINTS, {"header": header, **state})
    if (sensed := imus(flight)) or not np.isnan(flight.gravity):
        exact = np.concatenate([base.specific_force, base.spin], axis=1)
        # A negative first entry says that there is no attitude.
        turned = {"orientation_covariance": no_attitude} if sensed else {"orientation": attitude}
        for name, (frame, values) in (sensed or {"imu": (BASE, exact)}).items():
            measured = {
                "header": {"stamp": stamp, "frame_id": frame},
                "angular_velocity": _named("xyz", values[:, 3:]),
                "linear_acceleration": _named("xyz", values[:, :3]),
                **turned,
            }
            # Below /imu, so that none takes the place of another topic.
            topic = "/imu" if name == "imu" else f"/imu/{name}"
            topics[topic], new[topic] = ("sensor_msgs/msg/Imu", measured), known_rows(values)
    seen = {name: x for name, x in poses(flight).items() if np.isfinite(x[2]).any()}
    for name, (frame, position, quaternion) in seen.items():
        topic = "/pose" if name == "pose" else f"/pose/{name}"
        topics[topic] = _TRANSFORM, _transform(header, frame, position, quaternion)
        new[topic] = known_rows(quaternion)
    if rest := unread(flight, [*imus(flight), *seen]):
        _log.warning("not written to the bag: readings %s", rest)
    return topics, new


def _transform(header: Any, frame: str, position: Array, quaternion: Array) -> dict[str, Any]:
    """A TransformStamped of a frame by its poses (s, ·)."""
    moved = {"translation": _named("xyz", position), "rotation": _named("xyzw", quaternion)}
    return {"header": header, "child_frame_id": frame, "transform": moved}


def _named(names: str, values: Array) -> dict[str, Array]:
    """Columns of values (s, k) by names of one letter."""
    return dict(zip(names, values.T, strict=True))


def _commands(flight: Flight) -> dict[str, Array]:
    """Commands of motors and servos, in the lists of Actuators, in the order of inputs.

    What is neither a position nor a velocity is a share, of the greatest input where it is one.
    """
    lists: dict[str, list[Array]] = {"position": [], "velocity": [], "normalized": []}
    units = flight.command_units or flight.input_units
    commands = flight.commands if flight.command_units else flight.commanded
    for unit, command, share in zip(units, commands.T, shares(flight, commands).T, strict=True):
        values = share if unit in ("N", "N m") else command
        lists[_LISTS.get(unit, "normalized")].append(values)
    return {name: np.stack(columns, axis=1) for name, columns in lists.items() if columns}


def read_bag(path: Path, vehicle: Vehicle, names: Mapping[str, str | float]) -> Recorded:
    """Contents of a bag, or of an MCAP file, for a robot, by names other than those written."""
    topics = {role: str(names.get(role, topic)) for role, (topic, _) in _READ.items()}
    kinds, messages = read_messages(path, set(topics.values()))
    there = printable(", ".join(f"{x} ({kinds[x]})" for x in sorted(kinds)) or "none", 800)
    for role, (_, wanted) in _READ.items():
        topic, kind = topics[role], kinds.get(topics[role], "")
        # Another type at a topic that nobody has named is as none.
        if (kind or role in names) and kind.rpartition("/")[2] not in wanted:
            if role in names or role == "odometry":
                fault = f"is of the type {printable(kind)}" if kind else "is not in it"
                raise UsageError(
                    f"{printable(path)}: {printable(topic)} {fault}; "
                    f"--name {role}=TOPIC takes the types {', '.join(wanted)}; there are {there}"
                )
            messages[topic] = []
    alike = {*chain(*(types for _, types in _READ.values()))}
    others = [topic for topic in sorted(kinds) if not messages.get(topic)]
    rest = [topic for topic in others if kinds[topic].rpartition("/")[2] in alike]
    poses = messages[topics["odometry"]]
    if not poses and vehicle.layout.q.base:
        raise UsageError(
            f"{printable(path)}: has no message of {printable(topics['odometry'])} with the pose "
            f"of the base; name a topic of one of the types {', '.join(_POSES)} (--name "
            f"odometry=TOPIC); there are {there}"
        )
    states, efforts = (_by_name(messages[topics[role]]) for role in ("joints", "inputs"))
    time, placed = _times(poses), [_pose(message) for _, message in poses]
    if not poses:  # It is where it always is.
        time = next((samples.time for samples in states.values()), time)
        origin = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
        placed = [(origin, origin)] * len(time)
    attitude = known_attitudes(np.array([_entries("xyzw", pose) for _, pose in placed]))
    position = np.array([_entries("xyz", pose) for pose, _ in placed])
    if poses and hasattr(poses[0][1], "transform"):
        where, mounts = f"{printable(path)}: {printable(topics['odometry'])}", on_base(vehicle)
        frames = _frames([message.child_frame_id for _, message in poses], vehicle, where)
        if moved := sorted({*frames} - mounts.keys()):
            words = f"{where} has poses of {', '.join(moved)}, which joints move"
            raise UsageError(f"{words}; name a topic with poses of the base")
        position, attitude = of_base(position, attitude, np.array([mounts[f] for f in frames]))
    # Where a message has no attitude yet, nothing else in it is known.
    unknown = 0.0 * attitude[:, :1]
    velocity = spin = None
    if poses and hasattr(poses[0][1], "twist"):
        twists = [message.twist.twist for _, message in poses]
        moving = np.array([_entries("xyz", twist.linear) for twist in twists])
        turned = Rotation.from_quat(np.where(np.isnan(attitude), [0, 0, 0, 1], attitude))
        velocity = Samples(time, turned.apply(moving) + unknown)
        turning = np.array([_entries("xyz", twist.angular) for twist in twists])
        spin = Samples(time, turning + unknown)
    joints = [(joint, names.get(joint, joint)) for joint in vehicle.joint_names]
    offered = tuple(str(name) for series, name in states if series == "position")
    rest += [f"the joint {name}" for name in offered if name not in dict(joints).values()]
    # What drives a joint may stand beside its position.
    drives = zip(vehicle.inputs[vehicle.rotors :], joints, strict=False)
    efforts = {
        ("effort", drive): states["effort", joint]
        for drive, (_, joint) in drives
        if ("effort", joint) in states
    } | efforts
    inputs = [(drive, str(names.get(drive, drive))) for drive in vehicle.inputs]
    return Recorded(
        Samples(time, position + unknown),
        Samples(time, attitude),
        velocity,
        spin,
        {joint: states["position", name] for joint, name in joints if ("position", name) in states},
        {joint: states["velocity", name] for joint, name in joints if ("velocity", name) in states},
        {drive: efforts["effort", name] for drive, name in inputs if ("effort", name) in efforts},
        offered,
        _felt(messages[topics["imu"]], vehicle, f"{printable(path)}: {printable(topics['imu'])}"),
        {k: s for k, s in _sent(messages[topics["actuators"]], vehicle).items() if k not in names},
        printable(", ".join(rest), 800),
    )


def _frames(names: Sequence[str], vehicle: Vehicle, where: str) -> list[str]:
    """Frames of readings by their names; one that a robot does not have is its base."""
    if unknown := sorted({*names} - {*vehicle.frames, ""}):
        words = "%s: %s has no frame %s; the readings are taken as those of the base"
        _log.warning(words, where, vehicle.name, printable(", ".join(unknown), 200))
    return [name if name in vehicle.frames else BASE for name in names]


def _felt(messages: Sequence[tuple[int, Any]], vehicle: Vehicle, where: str) -> dict[str, Samples]:
    """What IMUs read, by their frames."""
    frames = _frames([message.header.frame_id for _, message in messages], vehicle, where)
    pairs = [(message.linear_acceleration, message.angular_velocity) for _, message in messages]
    rows = [_entries("xyz", force) + _entries("xyz", spin) for force, spin in pairs]
    samples, at = Samples(_times(messages), np.array(rows)), np.array(frames)
    return {frame: samples.rows(at == frame) for frame in dict.fromkeys(frames)}


def _sent(messages: Sequence[tuple[int, Any]], vehicle: Vehicle) -> dict[str, Samples]:
    """Commands of the lists of Actuators, in the order in which `_commands` writes them."""
    units = getattr(vehicle.module, "COMMAND_UNITS", vehicle.input_units)
    time, sent, shares = _times(messages), dict[str, Samples](), dict[int, Samples]()
    places: Counter[str] = Counter()
    for k, unit in enumerate(units):
        kind = _LISTS.get(unit, "normalized")
        rows = [getattr(message, kind) for _, message in messages]
        if rows and min(map(len, rows)) > places[kind]:
            samples = Samples(time, np.array([row[places[kind]] for row in rows], float))
            if kind == "normalized" and unit in ("N", "N m"):
                shares[k] = samples
            else:
                sent[vehicle.commands[k]] = samples
        places[kind] += 1
    return sent | of_shares(vehicle, shares)


def _pose(message: Any) -> tuple[Any, Any]:
    """The position and the attitude of a message that has a pose or a transform."""
    if hasattr(message, "transform"):
        return message.transform.translation, message.transform.rotation
    pose = getattr(message.pose, "pose", message.pose)
    return pose.position, pose.orientation


def _times(messages: Sequence[tuple[int, Any]]) -> NDArray[np.int64]:
    """Times, ns, of messages by their stamps, `NO_TIME` of those that alone have none.

    Where no message has a stamp they are the times at which they were logged.
    """
    stamps = [message.header.stamp for _, message in messages]
    times = [stamp.sec * 10**9 + stamp.nanosec for stamp in stamps]
    logged = [time for time, _ in messages]
    if any(times):
        logged = [a if a or not b else NO_TIME for a, b in zip(times, logged, strict=True)]
    return np.array([time if abs(time) < _LATEST else NO_TIME for time in logged], np.int64)


def _by_name(messages: Sequence[tuple[int, Any]]) -> dict[tuple[str, str | float], Samples]:
    """Positions, velocities and efforts of JointState by names; not every message has every one."""
    named: dict[tuple[str, str | float], list[tuple[int, float]]] = defaultdict(list)
    for time, (_, message) in zip(_times(messages).tolist(), messages, strict=True):
        for series in ("position", "velocity", "effort"):
            for name, value in zip(message.name, getattr(message, series), strict=False):
                named[series, name].append((time, value))
    return {key: Samples(*map(np.array, zip(*pairs, strict=True))) for key, pairs in named.items()}


def _entries(names: str, message: Any) -> list[float]:
    """Entries of a message by names of one letter."""
    return [getattr(message, name) for name in names]
