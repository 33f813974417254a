"""What validators of tables raise, and the words in which they name what they found."""

from __future__ import annotations

import difflib
from collections.abc import Collection

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

# Keys and list places, from a table inwards.
Place = tuple[str | int, ...]

# Pydantic's types of what validators here raise: faults in words, and those in the name of an entry
# of a table rather than in its value.
FAULT, IN_NAME = "fault", "fault_in_name"
_KINDS = {str: "a string", list: "a list", dict: "a table", int: "a number", float: "a number"}


def fault(words: str, kind: str = FAULT) -> PydanticCustomError:
    """What a validator of one value raises; `kind` is `IN_NAME` if it is the name of an entry."""
    # In a message template braces would be read as fields.
    return PydanticCustomError(kind, "{words}", {"words": words})


def refusal(faults: Collection[tuple[Place, str]]) -> ValidationError:
    """What a validator raises that finds faults at several places, relative to its value."""
    details = [
        InitErrorDetails(type=fault(words), loc=place, input=None) for place, words in faults
    ]
    return ValidationError.from_exception_data("table", details)


def kind_of(value: object) -> str:
    """Kind of a TOML value in words, such as "a list"."""
    if isinstance(value, bool):
        return "a boolean"
    return _KINDS.get(type(value), "a date or time")


def shown(value: object) -> str:
    """A value of a file in at most 80 characters of ASCII, for a message."""
    if isinstance(value, list | dict):  # What is in it may be as deep or as long as it likes.
        return kind_of(value)
    if isinstance(value, int) and abs(value) > 10**20:
        return "a huge number"
    return ascii(value[:80] if isinstance(value, str) else value)[:80]


def not_one_of(value: object, choices: Collection[str]) -> str:
    """Words for a value that is none of those it may be, with the nearest one."""
    near = difflib.get_close_matches(value, choices, n=1) if isinstance(value, str) else []
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"must be one of {', '.join(map(repr, choices))}, not {shown(value)}{hint}"


def key_path(place: Place) -> str:
    """Key path of a place from the top of the file, such as `link[0].mass`.

    A key that is no identifier, or is long, stands in quotes.
    """
    parts = [f"[{key}]" if isinstance(key, int) else f".{_shown_key(key)}" for key in place]
    return "".join(parts).removeprefix(".")


def _shown_key(key: str) -> str:
    return key if key.isidentifier() and len(key) <= 64 else ascii(key[:64])
