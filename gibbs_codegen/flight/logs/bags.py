"""Messages of bags of ROS 1 and ROS 2, in the order in which they were recorded."""

from __future__ import annotations

import logging
import sqlite3
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import closing, suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from gibbs_codegen.errors import UsageError, cause_of, printable
from gibbs_codegen.runtime.load import require

_log = logging.getLogger("gibbs_codegen")
# What ROS itself does not define: https://github.com/rudislabs/actuator_msgs.
ACTUATORS = "actuator_msgs/msg/Actuators"
_ACTUATORS_TEXT = """std_msgs/Header header
float64[] position
float64[] velocity
float64[] normalized
"""
# With what a message that ROS compressed by itself begins.
_COMPRESSED = b"\x28\xb5\x2f\xfd"
# By the ends of files' names, what mends one that was cut short.
_MENDED = {
    ".mcap": "`mcap recover` mends it",
    ".db3": "`sqlite3 FILE .recover` and then `ros2 bag reindex` mend it",
    ".bag": "`rosbag reindex` mends it",
}


class Message(NamedTuple):
    """A message, its number in the bag, and when it was logged, ns."""

    place: int
    logged: int
    content: Any


class Channel(NamedTuple):
    """A topic, the type and encoding of its messages, and a definition of it, "" for none."""

    topic: str
    kind: str
    encoding: str
    text: str = ""


# A channel and, with the time and the bytes of a message, one of those.
Records = Iterator[tuple[Channel, int, bytes | None]]


def message_types(distribution: str = "ROS2_JAZZY") -> Any:
    """The types of messages of ROS, the same in all distributions, and those that are written."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores[distribution])
    store.register(get_types_from_msg(_ACTUATORS_TEXT, ACTUATORS))
    return store


def read_messages(
    path: Path, topics: Collection[str]
) -> tuple[dict[str, str], dict[str, list[Message]]]:
    """By topic the types of its messages, and of some `topics` these; what cannot be is logged.

    Raises `UsageError` where a bag has none of them, since it is damaged.
    """
    require("rosbags", "logs of ROS", "logs")
    require("mcap", "logs of ROS", "logs")
    kinds: dict[str, str] = {}
    messages: dict[str, list[Message]] = {topic: [] for topic in topics}
    damaged: Counter[str] = Counter()
    for file in _files(path):
        place = 0
        try:
            for channel, time, data in _SOURCES.get(file.suffix.lower(), _rosbag)(file, topics):
                kinds.setdefault(channel.topic, channel.kind)
                if data is None or channel.topic not in messages:
                    continue
                place += 1
                try:
                    found = Message(place, int(time), _decoder(channel)(data))
                    messages[channel.topic].append(found)
                except Exception:  # A bit that was flipped, or a type that nobody has defined.
                    damaged[channel.topic] += 1
        except Exception as error:  # Files can be broken in many ways.
            why = "it is damaged, or was cut short while it was recorded"
            if isinstance(error, OSError) and error.errno:
                why = cause_of(error)
            elif file.is_file() and not file.stat().st_size:
                why = "it is empty"
            elif remedy := _MENDED.get(file.suffix.lower()):
                why += f"; {remedy}"
            elif not (file / "metadata.yaml").exists():
                why = "it is no bag of ROS (.mcap, .db3, .bag, or a folder of these), nor of PX4"
            if not any(messages.values()):
                raise UsageError(
                    f"{printable(file)}: is not a log that can be read: {why}"
                ) from None
            _log.warning("%s: is read as far as it goes: %s", printable(file.name), why)
    for topic, count in damaged.items():
        _log.warning(
            "%s: %d of %d messages of %s cannot be decoded as %s, and are left out",
            *(printable(path.name), count, count + len(messages[topic])),
            *(printable(topic), printable(kinds[topic])),
        )
    return kinds, messages


def _files(path: Path) -> list[Path]:
    """The files of a bag, in the order in which they were recorded."""
    for suffix in _SOURCES if path.is_dir() else ():
        if files := list(path.glob(f"*{suffix}")):
            return sorted(files, key=lambda file: (len(file.name), file.name))
    return [path]


def _mcap(file: Path, topics: Collection[str]) -> Records:
    """Records of an MCAP file from its begin on: no index is needed, nor an end."""
    from mcap import records, stream_reader

    kinds: dict[int, Any] = {}
    channels: dict[int, Channel] = {}
    size = file.stat().st_size
    with file.open("rb") as stream:
        reader = stream_reader.StreamReader(stream, validate_crcs=True, record_size_limit=size)
        for each in reader.records:
            if isinstance(each, records.Schema):
                kinds[each.id] = each
            elif isinstance(each, records.Channel):
                kind = kinds.get(each.schema_id)
                name, text = (kind.name, kind.data.decode(errors="replace")) if kind else ("", "")
                channels[each.id] = Channel(each.topic, name, each.message_encoding, text)
                yield channels[each.id], 0, None
            elif isinstance(each, records.Message):
                yield channels[each.channel_id], each.log_time, each.data


def _sqlite(file: Path, topics: Collection[str]) -> Records:
    """Records of a database of ROS 2, with what a recording that broke off left beside it."""
    mode = "mode=ro" if Path(f"{file}-wal").exists() else "immutable=1"
    with closing(sqlite3.connect(f"{file.absolute().as_uri()}?{mode}", uri=True)) as base:
        texts: dict[str, str] = {}
        with suppress(sqlite3.Error):  # Before ROS 2 Iron there were none.
            rows = "select topic_type, encoded_message_definition from message_definitions"
            texts = dict(base.execute(rows))
        rows = "select id, name, type, serialization_format from topics"
        channels = {
            number: Channel(topic, kind, encoding, texts.get(kind, ""))
            for number, topic, kind, encoding in base.execute(rows)
        }
        yield from ((channel, 0, None) for channel in channels.values())
        wanted = [number for number, channel in channels.items() if channel.topic in topics]
        marks = ", ".join("?" * len(wanted))
        rows = "select topic_id, timestamp, data from messages where topic_id in ({}) order by id"
        for number, time, data in base.execute(rows.format(marks), wanted):
            yield channels[number], time, data


def _rosbag(file: Path, topics: Collection[str]) -> Records:
    """Records of a bag of ROS 1, or of a folder of ROS 2 with compressed files."""
    from rosbags import rosbag1, rosbag2

    is_first = file.suffix.lower() == ".bag"
    encoding = "ros1" if is_first else "cdr"
    reader: Any = (rosbag1 if is_first else rosbag2).Reader(file)
    with reader:
        channels = {
            each.id: Channel(each.topic, each.msgtype, encoding, each.msgdef.data)
            for each in reader.connections
        }
        yield from ((channel, 0, None) for channel in channels.values())
        wanted = [each for each in reader.connections if each.topic in topics]
        messages = ((channels[each.id], time, data) for each, time, data in reader.messages(wanted))
        if is_first and wanted:  # It sorts by time, in which a clock that goes back is not seen.
            index = sorted(entry for each in wanted for entry in reader.indexes[each.id])
            pairs = zip(index, messages, strict=True)
            yield from (message for _, message in sorted(pairs, key=lambda pair: pair[0][1:]))
        elif wanted:
            yield from messages


_SOURCES: dict[str, Callable[[Path, Collection[str]], Records]] = {
    ".mcap": _mcap,
    ".db3": _sqlite,
    ".bag": _rosbag,
}


@cache
def _decoder(channel: Channel) -> Callable[[bytes], Any]:
    """What makes messages of bytes, by the definition of the bag, or else ROS's own."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    from zstandard import ZstdDecompressor

    is_first = {"ros1": True, "cdr": False}[channel.encoding]
    store = message_types("ROS1_NOETIC" if is_first else "ROS2_JAZZY")
    kind = channel.kind if "/msg/" in channel.kind else channel.kind.replace("/", "/msg/")
    with suppress(Exception):  # What is no definition does not keep ROS's own from being used.
        if channel.text:
            types = get_types_from_msg(channel.text, kind)
            store = get_typestore(Stores.EMPTY)
            store.register(types)

    def decoded(data: bytes) -> Any:
        if is_first:
            return store.deserialize_ros1(data, kind)
        if data.startswith(_COMPRESSED):
            data = ZstdDecompressor().decompressobj().decompress(data)
        return store.deserialize_cdr(data, kind)

    return decoded
