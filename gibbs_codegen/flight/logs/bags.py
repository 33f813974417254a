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

from gibbs_codegen.errors import UsageError, cause_of, printable, require

_log = logging.getLogger("gibbs_codegen")
# Types that ROS itself does not define: https://github.com/rudislabs/actuator_msgs.
ACTUATORS = "actuator_msgs/msg/Actuators"
_ACTUATORS_TEXT = """std_msgs/Header header
float64[] position
float64[] velocity
float64[] normalized
"""
# With what a message begins that ROS 2 has compressed by itself.
_COMPRESSED = b"\x28\xb5\x2f\xfd"
_NO_BAG = "or is not a log of ROS (.mcap, .db3, .bag or a folder of these) or PX4 (.ulg or tables)"


class BagChannel(NamedTuple):
    """A topic, the type and encoding of its messages, and the definition that a bag has of it."""

    topic: str
    kind: str
    encoding: str
    text: str = ""


# Channels and, with the time and the bytes of a message, those of messages.
Records = Iterator[tuple[BagChannel, int, bytes | None]]


@cache
def message_types(encoding: str = "cdr") -> Any:
    """The types of messages of ROS, in all versions of ROS 2 the same, and those written here."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore({"cdr": Stores.ROS2_JAZZY, "ros1": Stores.ROS1_NOETIC}[encoding])
    store.register(get_types_from_msg(_ACTUATORS_TEXT, ACTUATORS))
    return store


def read_messages(
    path: Path, topics: Collection[str]
) -> tuple[dict[str, str], dict[str, list[tuple[int, Any]]]]:
    """Types of all topics, and of some the messages, with times, ns; what is lost is logged.

    Raises `UsageError` where a bag is damaged and has none of them.
    """
    require("rosbags", "logs of ROS", "logs")
    require("mcap", "logs of ROS", "logs")
    kinds: dict[str, str] = {}
    messages: dict[str, list[tuple[int, Any]]] = {topic: [] for topic in topics}
    damaged: Counter[str] = Counter()
    for file in _files(path):
        read, remedy = _SOURCES.get(file.suffix.lower(), (_rosbag, _NO_BAG))
        try:
            for channel, time, data in read(file, topics):
                kinds.setdefault(channel.topic, channel.kind)
                if data is not None and channel.topic in topics:
                    try:
                        messages[channel.topic].append((int(time), _decoded(channel, data)))
                    except Exception:  # Bits that were flipped, or a type that is not read.
                        damaged[channel.topic] += 1
        except Exception as error:  # Files can be broken in many ways.
            why = f"it is damaged or incomplete; {remedy}"
            if isinstance(error, OSError) and error.filename:
                why = cause_of(error)
            if not any(messages.values()):
                raise UsageError(f"{printable(file)}: cannot be read as a log: {why}") from None
            _log.warning("%s: only the undamaged part is read: %s", printable(file.name), why)
    for topic, count in damaged.items():
        _log.warning(
            "%s: %d messages of %s are left out: damaged, or not %s as ROS defines it",
            *(printable(path.name), count, printable(topic), printable(kinds[topic])),
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

    kinds: dict[int, tuple[str, str]] = {}
    channels: dict[int, BagChannel] = {}
    size = file.stat().st_size
    with file.open("rb") as stream:
        reader = stream_reader.StreamReader(stream, validate_crcs=True, record_size_limit=size)
        for record in reader.records:
            if isinstance(record, records.Schema):
                kinds[record.id] = (record.name, record.data.decode(errors="replace"))
            elif isinstance(record, records.Channel):
                kind, text = kinds.get(record.schema_id, ("", ""))
                channels[record.id] = BagChannel(record.topic, kind, record.message_encoding, text)
                yield channels[record.id], 0, None
            elif isinstance(record, records.Message):
                yield channels[record.channel_id], record.log_time, record.data


def _sqlite(file: Path, topics: Collection[str]) -> Records:
    """Records of a database of ROS 2, with what a recording that broke off left beside it."""
    mode = "mode=ro" if Path(f"{file}-wal").exists() else "immutable=1"
    with closing(sqlite3.connect(f"{file.absolute().as_uri()}?{mode}", uri=True)) as base:
        rows = base.execute("select id, name, type, serialization_format from topics")
        channels = {number: BagChannel(*row) for number, *row in rows}
        yield from ((channel, 0, None) for channel in channels.values())
        wanted = [number for number, channel in channels.items() if channel.topic in topics]
        query = "select topic_id, timestamp, data from messages where topic_id in ({}) order by id"
        for number, *row in base.execute(query.format(",".join("?" * len(wanted))), wanted):
            yield channels[number], *row


def _rosbag(file: Path, topics: Collection[str]) -> Records:
    """Records of a bag of ROS 1, or of a folder of ROS 2 with compressed files."""
    from rosbags import rosbag1, rosbag2

    encoding = "ros1" if file.suffix.lower() == ".bag" else "cdr"
    reader: Any = (rosbag1 if encoding == "ros1" else rosbag2).Reader(file)
    with reader:
        channels = {
            link.id: BagChannel(link.topic, link.msgtype, encoding, link.msgdef.data)
            for link in reader.connections
        }
        yield from ((channel, 0, None) for channel in channels.values())
        if wanted := [link for link in reader.connections if link.topic in topics]:
            messages = reader.messages(wanted)
            if encoding == "ros1":  # Sorted by time, a clock that goes back would not be seen.
                index = sorted(entry for link in wanted for entry in reader.indexes[link.id])
                pairs = zip(index, messages, strict=True)
                messages = (message for _, message in sorted(pairs, key=lambda pair: pair[0][1:]))
            yield from ((channels[link.id], time, data) for link, time, data in messages)


# By the ends of files' names what reads them, and what mends one that was cut short.
_SOURCES: dict[str, tuple[Callable[[Path, Collection[str]], Records], str]] = {
    ".mcap": (_mcap, "repair it with `mcap recover`"),
    ".db3": (_sqlite, "repair it with `sqlite3 FILE .recover` and then `ros2 bag reindex`"),
    ".bag": (_rosbag, "repair it with `rosbag reindex`"),
}


@cache
def _type_of(channel: BagChannel) -> str:
    """The name of a type. Raises `ValueError` where a bag defines it otherwise than ROS."""
    from rosbags.typesys import get_types_from_msg

    kind = channel.kind if "/msg/" in channel.kind else channel.kind.replace("/", "/msg/")
    fields_by_type, definitions = message_types(channel.encoding).fielddefs, dict[str, Any]()
    with suppress(Exception):  # Damaged, or in IDL.
        definitions = get_types_from_msg(channel.text, kind) if channel.text else {}
    if any(fields_by_type[name][1] != fields for name, (_, fields) in definitions.items()):
        raise ValueError(kind)
    return kind


def _decoded(channel: BagChannel, data: bytes) -> Any:
    """A message."""
    store, kind = message_types(channel.encoding), _type_of(channel)
    if channel.encoding == "ros1":
        return store.deserialize_ros1(data, kind)
    if data.startswith(_COMPRESSED):
        from zstandard import ZstdDecompressor

        data = ZstdDecompressor().decompressobj().decompress(data)
    return store.deserialize_cdr(data, kind)
