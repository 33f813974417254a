"""Files in TOML: their text, checked as a whole, or every fault of the file at once.

Changes replace entries of a file, and have its form: `{"start": {"offset": [0.2, 0, 0]}}`. None
removes an entry.

`tomllib` takes time that grows with the square of a dotted key's parts, and it and whatever walks
through its tables afterwards would go too deep. So nesting that no file needs is found before. It
tells positions only for syntax errors. So the document is cut into its headers and keys, each of
which it reads by itself; what is inside an inline table is given the line of that.
"""

from __future__ import annotations

import itertools
import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from gibbs_codegen.errors import Fault, RefusedFileError, UsageError, printable

if TYPE_CHECKING:
    from gibbs_codegen.files.table import Table

    Checked = TypeVar("Checked", bound=Table)

# Python reads no decimal integer that is longer.
_MOST_DIGITS = 4300


def checked(
    text: str,
    source: str,
    table: type[Checked],
    refused: type[RefusedFileError],
    changes: Mapping[str, Any] | None = None,
    tables: Mapping[str, Any] | None = None,
) -> Checked:
    """The top table of a document, once it is checked against what its tables may hold.

    Raises `refused` with every fault, in the order of the file, which messages call `source`.
    `changes` come in place of what the text says, or the `tables` of Python that are given instead,
    table by table.
    """
    from gibbs_codegen.files.table import key_path, read_table  # Late, as it imports pydantic.

    if line := too_deep_line(text):
        raise refused(source, [Fault("", TOO_DEEP, line)])
    try:
        document = tomllib.loads(text) if tables is None else merged({}, nested(tables))
    except ValueError as error:
        raise refused(source, [_syntax_fault(text, error)]) from None
    other, keys = table.mistaken
    if theirs := [key for key in document if key in keys]:
        words = f"a key of {other}; give a {refused.kind} here"
        raise refused(source, [Fault(theirs[0], words, line_of(key_lines(text), (theirs[0],)))])
    changes = nested(changes or {})
    checked_table, refusals = read_table(table, merged(document, changes))
    absent = list(nothing_to_remove(document, changes))
    if checked_table is not None and not absent:
        return checked_table
    lines = key_lines(text)
    changed = set(changed_paths(changes))
    for path in changed:  # What has been replaced stands in no line.
        lines.pop(path, None)
    faults = [Fault(key_path(place), words) for place, words in absent]
    faults += [
        Fault(
            key_path(place),
            f"{words} (given by a change)" if key_path(place) in changed else words,
            line_of(lines, place),
        )
        for place, words in refusals
    ]
    raise refused(source, sorted(faults, key=lambda fault: fault.line or 0))


def _syntax_fault(text: str, error: ValueError) -> Fault:
    """The fault that `tomllib` found, with its line."""
    if text.lstrip().startswith("<"):
        xml = "not valid TOML: it is XML; if it is URDF, xacro, MJCF or SDF, make a robot file of"
        return Fault("", f"{xml} it first with gibbs-codegen import FILE", 1)
    reason = str(error)
    if place := re.search(r" \(at (?:line (\d+), column \d+|end of document)\)$", reason):
        line = int(place[1] or text.count("\n") + 1)
    else:  # Python itself refuses only numbers of very many digits.
        reason = f"a number has more than {_MOST_DIGITS} digits"
        longest = max(re.finditer(r"[0-9_]+", text), key=lambda digits: len(digits[0]))
        line = text.count("\n", 0, longest.start()) + 1
    if array := re.search(r"Cannot declare \('(rotor|link|frame)',\)", reason):
        reason += f"; write each {array[1]} as [[{array[1]}]], in double brackets"
    elif reason.startswith("Cannot overwrite a value"):
        reason += "; the key or table appears twice: remove one"
    return Fault("", f"not valid TOML: {printable(reason)}", line)


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


def key_lines(text: str) -> dict[str, int]:
    """Lines, counted from 1, of the keys of a document, by key path like `link[0].mass`."""
    # Places at which headers of tables, and keys that have values, begin.
    depth = 0
    starts: list[int] = []
    for token in _TOKEN.finditer(text):
        begin = token.start()
        if (
            depth == 0
            and token[0][0] != "#"
            and not text[text.rfind("\n", 0, begin) + 1 : begin].strip()
        ):
            starts.append(begin)
        if bracket := token["bracket"]:
            depth += 1 if bracket in "[{" else -1
    lines: dict[str, int] = {}
    counts: dict[str, int] = {}
    prefix, number, before = "", 1, 0
    for start, end in itertools.pairwise([*starts, len(text)]):
        number, before = number + text.count("\n", before, start), start
        # By itself each is a document: of one key, or a table without any.
        parsed: Any = tomllib.loads(text[start:end])
        place = "" if text.startswith("[", start) else prefix
        while isinstance(parsed, dict) and len(parsed) == 1:
            ((key, parsed),) = parsed.items()
            place = f"{place}.{key}" if place else key
            if not text.startswith("[", start):
                lines.setdefault(place, number)
        if text.startswith("[[", start):
            prefix = f"{place}[{counts.get(place, 0)}]"
            counts[place] = counts.get(place, 0) + 1
            lines.setdefault(prefix, number)
        elif text.startswith("[", start):
            prefix = place
        lines.setdefault(place, number)
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
        # A string of TOML, whatever the text holds.
        quoted = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        one = _one_entry(key, value) or _one_entry(key, quoted)
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
    Entries of lists have their numbers, from 1, for keys.
    Tuples and NumPy's arrays are made lists.
    """
    whole = dict(document)
    for key, value in changes.items():
        if value is None:
            whole.pop(key, None)
        elif isinstance(value, Mapping):
            before = _table(whole, key)
            same = value.get("kind", before.get("kind")) == before.get("kind")
            inner = merged(before if same else {}, value)
            in_list = isinstance(whole.get(key), list) and value.keys() <= before.keys()
            whole[key] = [*inner.values()] if in_list else inner
        else:
            whole[key] = plain_value(value)
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
                "there is no such entry to remove; an empty value (None in Python) removes an "
                "entry",
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


def plain_value(value: Any) -> Any:
    """Values as TOML has them."""
    if isinstance(value, Mapping):
        return {key: plain_value(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [plain_value(entry) for entry in value] if isinstance(value, list | tuple) else value


def _table(document: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """The table of a document by its key, or a list by numbers; none where it is not there."""
    value = document.get(key)
    if isinstance(value, list):
        return {str(k): entry for k, entry in enumerate(value, start=1)}
    return value if isinstance(value, Mapping) else {}
