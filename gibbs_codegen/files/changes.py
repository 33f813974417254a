"""Changes of a file's entries: what replaces them, given in Python or as KEY=VALUE in TOML.

Changes have the form of the file: `{"start": {"offset": [0.2, 0, 0]}}`. None removes an entry.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.files.toml_text import MAX_DEPTH


def changes_of(entries: Sequence[str]) -> dict[str, Any]:
    """Changes out of entries such as `start.offset=[0.2,0,0]`, in TOML; later ones prevail.

    A value that is not TOML is taken as a string, so that quotes may be left out; none at all
    removes the entry. Raises `UsageError` for an entry that is not of this form.
    """
    changes: dict[str, Any] = {}
    for entry in entries:
        key, equals, value = entry.partition("=")
        if not equals:
            raise UsageError(f"{printable(entry, 40)}: must be KEY=VALUE, such as duration=5")
        one = _one_entry(key, value) or _one_entry(key, _quoted(value))
        if one and not value.strip():
            one = _with_value(one, None)
        if not one:  # What begins with # is a comment of TOML, and no entry.
            raise UsageError(
                f"{printable(entry, 40)}: not a key, such as start.offset, before the ="
            )
        _add(changes, one)
    return changes


def nested(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Changes with tables in place of keys with dots such as `start.offset`; later ones prevail."""
    whole: dict[str, Any] = {}
    for key, value in changes.items():
        _add(whole, _with_value(_one_entry(str(key), "0") or {key: 0}, value))
    return whole


def merged(document: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A document with changes in place of what it says, table by table.

    A table whose `kind` is changed is replaced as a whole: its other keys belong to the old kind.
    Tuples and NumPy's arrays are made lists.
    """
    whole = dict(document)
    for key, value in changes.items():
        if value is None:
            whole.pop(key, None)
        elif isinstance(value, Mapping):
            before = _table(whole, key)
            same = value.get("kind", before.get("kind")) == before.get("kind")
            whole[key] = merged(before if same else {}, value)
        else:
            whole[key] = _plain(value)
    return whole


def nothing_to_remove(
    document: Mapping[str, Any], changes: Mapping[str, Any], outer: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], str]]:
    """Keys and words of faults of changes that would remove what is not there.

    `outer` are keys of the tables that both are taken from.
    """
    for key, value in changes.items():
        if isinstance(value, Mapping):
            yield from nothing_to_remove(_table(document, key), value, (*outer, key))
        elif value is None and key not in document:
            yield (
                (*outer, key),
                "an empty value (None in Python) removes an entry, but the file has no such entry",
            )


def changed_paths(changes: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Key paths of what changes replace, such as `start.offset`, after a prefix."""
    for key, value in changes.items():
        if isinstance(value, Mapping) and value:
            yield from changed_paths(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}"


def _one_entry(key: str, value: str) -> dict[str, Any] | None:
    if key.count(".") >= MAX_DEPTH or "\n" in key:
        return None
    try:
        return tomllib.loads(f"{key} = {value}")
    except (ValueError, RecursionError):
        return None


def _quoted(text: str) -> str:
    """Text as a string of TOML, whatever it holds."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _with_value(entry: dict[str, Any], value: Any) -> dict[str, Any]:
    """One entry, below its keys, with another value."""
    return {
        key: _with_value(inner, value) if isinstance(inner, dict) else value
        for key, inner in entry.items()
    }


def _add(changes: dict[str, Any], more: Mapping[str, Any]) -> None:
    for key, value in more.items():
        if isinstance(value, Mapping):
            before = changes.get(key)
            changes[key] = before if isinstance(before, dict) else {}
            _add(changes[key], value)
        else:
            changes[key] = value


def _plain(value: Any) -> Any:
    """Values as TOML has them."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [_plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def _table(document: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """The table of a document by its key; an empty one where there is none."""
    value = document.get(key)
    return value if isinstance(value, Mapping) else {}
