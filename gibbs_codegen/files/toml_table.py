"""Typed access to the tables of a TOML document that notes every fault and goes on."""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, TypeVar

from gibbs_codegen.errors import Fault

Choice = TypeVar("Choice", bound=str)

# To look for what a key may have been meant to be takes time, and a flood of keys is no slip.
_MOST_SUGGESTIONS = 50
_LONGEST_KEY = 64


class Table:
    """One table of a document: its values, its key path, and the list of faults it adds to.

    Every reader returns a usable value even where it notes a fault, so that one reading finds all
    the faults of a file.
    """

    def __init__(self, values: dict[str, Any], path: str, faults: list[Fault]) -> None:
        self.values = values
        self.path = path
        self.faults = faults

    def fault(self, key: str, message: str) -> None:
        """Note what is wrong with `key` of this table."""
        self.faults.append(Fault(f"{self.path}.{key}" if self.path else key, message))

    def refuse_unknown(self, known: Sequence[str]) -> None:
        """Note every key that is not in `known`, with the nearest one that is."""
        for key in self.values:
            if key in known:
                continue
            near = []
            if len(self.faults) < _MOST_SUGGESTIONS and len(key) <= _LONGEST_KEY:
                near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known keys: {', '.join(known)}"
            name = key if key.isidentifier() and len(key) <= _LONGEST_KEY else ascii(key[:64])
            self.fault(name, f"unknown key; {hint}")

    def text(self, key: str) -> str | None:
        """Required string."""
        value = self.values.get(key)
        if value is None:
            self.fault(key, "missing")
        elif not isinstance(value, str):
            self.fault(key, f"must be a string, not {_kind(value)}")
        else:
            return value
        return None

    def choice(self, key: str, choices: Sequence[Choice], default: Choice) -> Choice:
        """Optional string out of `choices`."""
        value = self.values.get(key, default)
        for choice in choices:
            if value == choice:
                return choice
        near = difflib.get_close_matches(value, choices, n=1) if isinstance(value, str) else []
        hint = f"; did you mean {near[0]!r}?" if near else ""
        listed = ", ".join(repr(choice) for choice in choices)
        self.fault(key, f"must be one of {listed}, not {shown(value)}{hint}")
        return default

    def integer(self, key: str, least: int, most: int) -> int | None:
        """Required whole number from `least` to `most`."""
        value = self.values.get(key)
        if value is None:
            self.fault(key, "missing")
        elif isinstance(value, bool) or not isinstance(value, int):
            what = shown(value) if isinstance(value, float) else _kind(value)
            self.fault(key, f"must be a whole number, not {what}")
        elif not least <= value <= most:
            self.fault(key, f"must be from {least} to {most}, not {shown(value)}")
        else:
            return value
        return None

    def number(self, key: str, default: float, least: float = -math.inf) -> float:
        """Optional finite number, at least `least`."""
        return self._checked(key, self.values.get(key, default), default, least)

    def angle(self, key: str) -> Fraction:
        """Optional angle in degrees, at most one turn, as the shortest decimal of its double.

        0 where missing. In radians huge angles lose the part of a turn that they end in.
        """
        degrees = self.number(key, 0.0)
        if abs(degrees) > 360.0:
            what = f"must be from -360 to 360 degrees, not {degrees:g}"
            self.fault(key, f"{what}; leave out whole turns")
            return Fraction(0)
        return Fraction(repr(degrees))

    def numbers(self, key: str, length: int, default: tuple[float, ...]) -> tuple[float, ...]:
        """Optional list of `length` finite numbers."""
        if key not in self.values:
            return default
        return self.check_numbers(key, self.values[key], length, default)

    def check_numbers(
        self, key: str, value: object, length: int, default: tuple[float, ...]
    ) -> tuple[float, ...]:
        """Check that `value` is a list of `length` finite numbers."""
        if not isinstance(value, list):
            self.fault(key, f"must be a list of {length} numbers, not {_kind(value)}")
            return default
        if len(value) != length:
            self.fault(key, f"must have {length} numbers, not {len(value)}")
            return default
        return tuple(
            self._checked(f"{key}[{i}]", entry, default[i], -math.inf)
            for i, entry in enumerate(value)
        )

    def table(self, key: str) -> Table | None:
        """Required table."""
        value = self.values.get(key)
        if value is None:
            self.fault(key, "missing")
        elif not isinstance(value, dict):
            self.fault(key, f"must be a table, not {_kind(value)}")
        else:
            return self._child(key, value)
        return None

    def tables(self, key: str, most: int, what: str) -> list[Table]:
        """Optional array of at most `most` tables, which are `what`; empty where it is missing."""
        value = self.values.get(key, [])
        if not isinstance(value, list):
            self.fault(key, f"must be an array of tables, [[{key}]], not {_kind(value)}")
            return []
        if len(value) > most:
            self.fault(key, f"{len(value)} {what}; give at most {most}")
            return []
        for i, entry in enumerate(value):
            if not isinstance(entry, dict):
                self.fault(f"{key}[{i}]", f"must be a table, not {_kind(entry)}")
        return [self._child(f"{key}[{i}]", e) for i, e in enumerate(value) if isinstance(e, dict)]

    def _child(self, key: str, values: dict[str, Any]) -> Table:
        return Table(values, f"{self.path}.{key}" if self.path else key, self.faults)

    def _checked(self, key: str, value: object, default: float, least: float) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fault(key, f"must be a number, not {_kind(value)}")
            return default
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            self.fault(key, f"must be a finite number, not {shown(value)}")
            return default
        if number < least:
            self.fault(key, f"must be at least {least:g}, not {shown(value)}")
            return default
        return number


def _kind(value: object) -> str:
    kinds = {bool: "a boolean", str: "a string", list: "a list", dict: "a table", int: "a number"}
    return kinds.get(type(value), "a number" if isinstance(value, float) else "a date or time")


def shown(value: object) -> str:
    """A value of a file, short and in ASCII, for a message."""
    if isinstance(value, list | dict):  # What is in it may be as deep or as long as it likes.
        return _kind(value)
    if isinstance(value, int) and abs(value) > 10**20:
        return "a huge number"
    return ascii(value[:80] if isinstance(value, str) else value)[:80]
