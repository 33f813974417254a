"""Flights as bags of ROS 2 in the format MCAP, without an installation of ROS.

World axes have z up, those of the base x forwards and y to the left, as ROS has them; so nothing is
turned.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.flight.logs.cdr import encoded, stamps, times_of
from gibbs_codegen.flight.logs.motion import base_motion, shares
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.vectors import Array

WORLD, BASE = "world", "base"
# What ROS itself does not define: https://github.com/rudislabs/actuator_msgs.
_ACTUATORS = "actuator_msgs/msg/Actuators"
_ACTUATORS_TEXT = """std_msgs/Header header
float64[] position
float64[] velocity
float64[] normalized
"""
# By the unit of a command, the list of Actuators that it belongs to.
_LISTS = {"rad": "position", "m": "position", "rad/s": "velocity", "m/s": "velocity"}
# Samples that are encoded at a time, which bounds the memory.
_ROWS = 4096


def write_bag(flight: Flight, folder: Path) -> None:
    """Write a flight to a folder, which must not exist, with an MCAP file of its name."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    store, times = message_types(), times_of(flight.time).tolist()
    with_messages = topics_of(flight)
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
                for channel, block in zip(channels, blocks, strict=True):
                    writer.write(channel, times[row], block[row - begin].tobytes())


def message_types() -> Any:
    """The types of messages of rosbags, with those that are written and are not among them."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(_ACTUATORS_TEXT, _ACTUATORS))
    return store


def topics_of(flight: Flight) -> dict[str, tuple[str, Mapping[str, Any]]]:
    """By topic the type of its messages and their values, a message per sample."""
    stamp, base = stamps(flight.time), base_motion(flight)
    header = {"stamp": stamp, "frame_id": WORLD}
    place, attitude = _named("xyz", base.position), _named("xyzw", base.quaternion)
    twist = {"linear": _named("xyz", base.velocity), "angular": _named("xyz", base.spin)}
    moved = {"translation": place, "rotation": attitude}
    odometry = {
        "header": header,
        "child_frame_id": BASE,
        "pose": {"pose": {"position": place, "orientation": attitude}},
        "twist": {"twist": twist},
    }
    transform = {"header": header, "child_frame_id": BASE, "transform": moved}
    efforts = {"name": flight.input_names, "effort": flight.applied}
    found: dict[str, tuple[str, Mapping[str, Any]]] = {
        "/clock": ("rosgraph_msgs/msg/Clock", {"clock": stamp}),
        "/tf": ("tf2_msgs/msg/TFMessage", {"transforms": [transform]}),
        "/odom": ("nav_msgs/msg/Odometry", odometry),
        "/inputs": ("sensor_msgs/msg/JointState", {"header": header, **efforts}),
        "/actuators": (_ACTUATORS, {"header": header, **_commands(flight)}),
    }
    places, rates = flight.layout.q.joints, flight.layout.v.joints
    if joints := flight.coordinates[places]:
        state = {
            "name": joints,
            "position": flight.q[:, places],
            "velocity": flight.v[:, rates],
            "effort": flight.applied[:, flight.rotors :],
        }
        found["/joint_states"] = ("sensor_msgs/msg/JointState", {"header": header, **state})
    if not np.isnan(flight.gravity):
        measured = {
            "header": {"stamp": stamp, "frame_id": BASE},
            "orientation": attitude,
            "angular_velocity": _named("xyz", base.spin),
            "linear_acceleration": _named("xyz", base.specific_force),
        }
        found["/imu"] = ("sensor_msgs/msg/Imu", measured)
    return found


def _named(names: str, values: Array) -> dict[str, Array]:
    """Columns of values (s, k) by names of one letter."""
    return dict(zip(names, values.T, strict=True))


def _commands(flight: Flight) -> dict[str, Array]:
    """What motors and servos are commanded, in the lists of Actuators, in the order of inputs.

    What is neither a position nor a velocity is a share, of the greatest input where it is one.
    """
    found: dict[str, list[Array]] = {"position": [], "velocity": [], "normalized": []}
    of_inputs = shares(flight).T
    units = flight.command_units or flight.input_units
    commands = flight.commands if flight.command_units else flight.commanded
    for unit, command, share in zip(units, commands.T, of_inputs, strict=True):
        values = share if unit in ("N", "N m") else command
        found[_LISTS.get(unit, "normalized")].append(values)
    return {name: np.stack(each, axis=1) for name, each in found.items() if each}
