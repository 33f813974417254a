"""What the text of a TOML file tells that `tomllib` does not: its depth, and the line of each key.

`tomllib` takes time that grows with the square of a dotted key's parts, and it and whatever walks
through its tables afterwards would go too deep. So nesting that no file needs is found before.

`tomllib` tells positions only for syntax errors. The scanner reads the layout (tables, arrays of
tables, keys at the start of a line) well enough to point a person to the right line; a key that it
cannot place, such as one inside an inline table, is given the line of its nearest parent.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

MAX_DEPTH = 16
TOO_DEEP = f"nested too deeply: at most {MAX_DEPTH} tables and lists in one another"

# Nothing here is ever tried twice at one place, so that time grows with the text and no faster.
_PART = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_NESTING_TOKEN = re.compile(
    rf"""
    \#[^\n]*+
    | \"{{3}} (?: (?!\"{{3}}) (?: [^\\] | \\. ) )*+ (?: \"{{3}} )?
    | '{{3}} (?: (?!'{{3}}) . )*+ (?: '{{3}} )?
    | (?P<key> {_PART} (?: [ \t]*+ \. [ \t]*+ {_PART} ){{{MAX_DEPTH}}} )
    | {_PART}
    | (?P<bracket> [\[\]{{}}] )
    """,
    re.VERBOSE | re.DOTALL,
)


def too_deep_line(text: str) -> int | None:
    """First line, from 1, with a bracket, or a key of more than `MAX_DEPTH` parts, too deep."""
    depth = 0
    for token in _NESTING_TOKEN.finditer(text):
        if bracket := token["bracket"]:
            depth += 1 if bracket in "[{" else -1
        if token["key"] or depth > MAX_DEPTH:
            return text.count("\n", 0, token.start()) + 1
    return None


_NAME = r"""[A-Za-z0-9_\-."']+"""
_TABLE = re.compile(rf"\[(?P<name>{_NAME})\](?:\s*#.*)?")
_ARRAY = re.compile(rf"\[\[(?P<name>{_NAME})\]\](?:\s*#.*)?")
_KEY = re.compile(_NAME)
# A string without an end takes the rest of the line, lest each quote in it be tried as a beginning.
_KEY_TOKEN = re.compile(r"""\"{3}|'{3}|"(?:[^"\\]|\\.)*+"?|'[^']*+'?|[\[\]{}#]""")


def key_lines(text: str) -> dict[str, int]:
    """Lines, counted from 1, of the keys of a document, by key path like `link[0].mass`."""
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    prefix, unfinished = "", _Unfinished()
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.strip()
        if unfinished:
            unfinished.read(line)
        elif array := _ARRAY.fullmatch(line):
            name = _plain(array["name"])
            prefix = f"{name}[{counts.get(name, 0)}]"
            counts[name] = counts.get(name, 0) + 1
            lines.setdefault(prefix, number)
            lines.setdefault(name, number)
        elif table := _TABLE.fullmatch(line):
            prefix = _plain(table["name"])
            lines.setdefault(prefix, number)
        elif "=" in line and _KEY.fullmatch((parts := line.partition("="))[0].strip()):
            place = prefix
            for part in _plain(parts[0].strip()).split("."):
                place = f"{place}.{part}" if place else part
                lines.setdefault(place, number)
            unfinished.read(parts[2])
    return lines


def line_of(lines: Mapping[str, int], place: Sequence[str | int]) -> int | None:
    """Line, from 1, of an entry, or of the nearest table or list around it that has one.

    `place` leads from the top of the file inwards.
    """
    parts = [f"[{key}]" if isinstance(key, int) else f".{key}" for key in place]
    for count in range(len(parts), 0, -1):
        if line := lines.get("".join(parts[:count]).removeprefix(".")):
            return line
    return None


class _Unfinished:
    """Whether a value goes on: inside brackets or a string of several lines."""

    def __init__(self) -> None:
        self._depth = 0
        self._quote = ""

    def __bool__(self) -> bool:
        return self._depth > 0 or bool(self._quote)

    def read(self, text: str) -> None:
        """Take in the next line of the value."""
        place = 0
        while place < len(text):
            if self._quote:
                end = text.find(self._quote, place)
                if end < 0:
                    return
                place, self._quote = end + 3, ""
                continue
            token = _KEY_TOKEN.search(text, place)
            if token is None or token[0] == "#":
                return
            place = token.end()
            if token[0] in ('"""', "'''"):
                self._quote = token[0]
            elif token[0] in "[{":
                self._depth += 1
            elif token[0] in "]}":
                self._depth -= 1


def _plain(name: str) -> str:
    return name.replace('"', "").replace("'", "")
