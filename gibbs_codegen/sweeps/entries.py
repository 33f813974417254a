"""Entries of a scenario by their keys, such as `motors.time_constant` and `start.offset[2]`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

from gibbs_codegen.errors import UsageError, printable

Step = str | int

_KEY = re.compile(r"[^.\[\]\s]+(\.[^.\[\]\s]+|\[\d+\])*")


def steps_of(key: str) -> tuple[Step, ...]:
    """The way to an entry: names of tables, and places in lists, from 0.

    `start.offset[2]` is ("start", "offset", 2). Raises `UsageError` for what is no key.
    """
    if not _KEY.fullmatch(key):
        raise UsageError(f"{printable(key)}: not a key, such as motors.time_constant")
    found = re.findall(r"\[(\d+)\]|([^.\[\]]+)", key)
    return tuple(int(place) if place else name for place, name in found)


def entry(whole: Any, key: str) -> Any:
    """What stands at a key of tables, lists and numbers, or None.

    They may be plain, of pydantic or dataclasses.
    """
    found = whole
    for step in steps_of(key):
        if isinstance(step, int):
            is_list = isinstance(found, Sequence) and not isinstance(found, str)
            found = found[step] if is_list and step < len(found) else None
        elif isinstance(found, Mapping):
            found = found.get(step)
        else:
            found = getattr(found, step, None)
    return found


def with_places_filled(says: Callable[[str], Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by keys as `simulate --set` takes them: of a list, all of it, with the values in it.

    `says` tells what the scenario has at a key. Raises `UsageError` if a list has no such place.
    """
    found: dict[str, Any] = {}
    for key, value in values.items():
        name, bracket, _ = key.partition("[")
        if not bracket:
            found[key] = value
            continue
        if name not in found:
            found[name] = _plain(says(name))
        place, *outer = reversed(steps_of(key)[len(steps_of(name)) :])
        inner: Any = found[name]
        try:
            for step in reversed(outer):
                inner = inner[step]
            inner[place] = value
        except (IndexError, KeyError, TypeError):
            raise UsageError(
                f"{printable(key)}: the scenario has no such entry; give it there first"
            ) from None
    return found


def _plain(value: Any) -> Any:
    """Tables and lists that can be changed."""
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    return [_plain(inner) for inner in value] if isinstance(value, list | tuple) else value


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by keys, without places in lists, as in a scenario file: a table in a table."""
    whole: dict[str, Any] = {}
    for key, value in values.items():
        *outer, last = steps_of(key)
        table = whole
        for name in outer:
            table = table.setdefault(str(name), {})
        table[str(last)] = value
    return whole


def replaced(value: Any, changes: Mapping[str, Any], key: str = "") -> Any:
    """A dataclass, or a mapping, with other values, in tables, of some of its fields.

    `key` is where it stands, for messages. Raises `UsageError` if there is no such field.
    """
    if isinstance(value, Mapping):
        return {**value, **changes}
    known = {each.name for each in fields(value)} if is_dataclass(value) else set()
    new: dict[str, Any] = {}
    for name, change in changes.items():
        place = f"{key}{name}"
        if name not in known:
            raise UsageError(
                f"{printable(place)}: a Scenario has no such field; give the scenario as a file, "
                "or by its name, to vary entries of the file"
            )
        before = getattr(value, name)
        if isinstance(change, Mapping):
            new[name] = replaced(before, change, f"{place}.")
        else:
            new[name] = tuple(change) if isinstance(before, tuple) else change
    return replace(value, **new)
