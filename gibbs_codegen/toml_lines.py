"""On which line of a TOML text each key stands.

`tomllib` tells positions only for syntax errors. This scanner reads the layout (tables, arrays of
tables, keys at the start of a line) well enough to point a person to the right line; a key that it
cannot place, such as one inside an inline table, is given the line of its nearest parent.
"""

from __future__ import annotations

import re

_TABLE = re.compile(r"\[(?P<name>[^\[\]]+)\]")
_ARRAY = re.compile(r"\[\[(?P<name>[^\[\]]+)\]\]")
_KEY = re.compile(r"[A-Za-z0-9_\-\"'.]+")


def key_lines(text: str) -> dict[str, int]:
    """Map key paths, written like `link[0].mass`, to line numbers counted from 1."""
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    prefix = ""
    for number, raw in enumerate(text.split("\n"), start=1):
        line = raw.strip()
        if array := _ARRAY.match(line):
            name = array["name"].strip()
            prefix = f"{name}[{counts.get(name, 0)}]"
            counts[name] = counts.get(name, 0) + 1
            lines.setdefault(prefix, number)
            lines.setdefault(name, number)
        elif table := _TABLE.match(line):
            prefix = table["name"].strip()
            lines.setdefault(prefix, number)
        elif "=" in line and _KEY.fullmatch(key := line.partition("=")[0].strip()):
            name = key.replace('"', "").replace("'", "")
            lines.setdefault(f"{prefix}.{name}" if prefix else name, number)
    return lines


def line_of(lines: dict[str, int], path: str) -> int | None:
    """Line of `path`, or of the nearest parent that has one."""
    while path:
        if path in lines:
            return lines[path]
        cut = max(path.rfind("."), path.rfind("["))
        path = path[:cut] if cut > 0 else ""
    return None
