"""Many ROS messages of the same length at once, in the encoding CDR of ROS 2.

All messages of a topic of a flight have the same texts and as many numbers, so that these stand in
the same places: a field is columns of bytes. To encode messages one by one takes many times as
long.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.flight.vectors import Array

Bytes = NDArray[np.uint8]
# Representation identifier and options: plain CDR, little-endian.
_HEADER = bytes((0, 1, 0, 0))


def times_of(time: Array) -> NDArray[np.int64]:
    """Times (s), s, as whole nanoseconds."""
    return np.round(time * 1e9).astype(np.int64)


def stamps(time: Array) -> dict[str, NDArray[np.int64]]:
    """Times (s), s, as builtin_interfaces/Time has them."""
    seconds, nanoseconds = np.divmod(times_of(time), 10**9)
    return {"sec": seconds, "nanosec": nanoseconds}


def encoded(definitions: Mapping[str, Any], kind: str, values: Any, rows: range) -> Bytes:
    """Messages (rows, bytes) of a type by its name, whose `definitions` are those of rosbags.

    `values` have a mapping for a message, a list for a sequence of them, a text or a number for all
    messages, or an array with a row for each, of which some `rows` are taken. Numbers of fields
    that they lack are 0.
    """
    message = _Messages(definitions, rows)
    message.put_message(kind, values)
    return np.concatenate(message.columns, axis=1)


class _Messages:
    """Messages that grow by a field at a time; places count from the end of the header."""

    def __init__(self, definitions: Mapping[str, Any], rows: range) -> None:
        self.definitions, self.rows = definitions, slice(rows.start, rows.stop)
        self.count, self.place = len(rows), -len(_HEADER)
        self.columns: list[Bytes] = []
        self._bytes(_HEADER)

    def put_message(self, kind: str, values: Mapping[str, Any]) -> None:
        """Put a message, field by field."""
        for name, (node, detail) in self.definitions[kind][1]:
            self._put(node.name, detail, values.get(name))

    def _put(self, node: str, detail: Any, value: Any) -> None:
        """Put a field, whose kind is said by a node and a detail of rosbags; None for zeros."""
        if node == "NAME":
            self.put_message(detail, value or {})
        elif node == "BASE" and detail[0] == "string":
            text = value.encode() + b"\0"
            self._numbers("uint32", len(text))
            self._bytes(text)
        elif node == "BASE":
            self._numbers(detail[0], value or 0 if np.ndim(value) == 0 else value)
        else:
            (inner, kind), size = detail
            if node == "ARRAY" and value is None:
                value = np.zeros((self.rows.stop, size))
            if node == "SEQUENCE":
                self._numbers("uint32", np.shape(value)[-1] if value is not None else 0)
            if isinstance(value, np.ndarray):
                self._numbers(kind[0], value)
            else:
                for entry in value or ():
                    self._put(inner.name, kind, entry)

    def _numbers(self, kind: str, values: Any) -> None:
        """Put numbers (s, k), (s) or one for all messages, aligned to their size."""
        numbers = np.asarray(values, np.dtype(kind).newbyteorder("<"))
        if not numbers.size:
            return
        self._bytes(bytes(-self.place % numbers.itemsize))
        rows = numbers[self.rows].reshape(self.count, -1) if numbers.ndim else numbers[np.newaxis]
        self._add(np.ascontiguousarray(rows).view(np.uint8))

    def _bytes(self, text: bytes) -> None:
        """Put bytes that are the same in all messages."""
        self._add(np.frombuffer(text, np.uint8))

    def _add(self, column: Bytes) -> None:
        self.columns.append(np.broadcast_to(column, (self.count, column.shape[-1])))
        self.place += column.shape[-1]
