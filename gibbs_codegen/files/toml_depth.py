"""What in a TOML text is nested more deeply than any file needs, found before `tomllib` reads it.

It takes time that grows with the square of a dotted key's parts, and it and whatever walks through
its tables afterwards would go too deep.
"""

from __future__ import annotations

import re

MAX_DEPTH = 16
TOO_DEEP = f"nested too deeply: at most {MAX_DEPTH} tables and lists in one another"

# Nothing here is ever tried twice at one place, so that time grows with the text and no faster.
_PART = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_TOKEN = re.compile(
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
    for token in _TOKEN.finditer(text):
        if bracket := token["bracket"]:
            depth += 1 if bracket in "[{" else -1
        if token["key"] or depth > MAX_DEPTH:
            return text.count("\n", 0, token.start()) + 1
    return None
