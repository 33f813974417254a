"""Files in TOML: their text, checked as a whole, or every fault of the file at once."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from gibbs_codegen.errors import Fault, RefusedFileError, UsageError, printable
from gibbs_codegen.files.toml_depth import TOO_DEEP, too_deep_line
from gibbs_codegen.files.toml_lines import key_lines, line_of
from gibbs_codegen.files.toml_table import Table

MAX_BYTES = 1_000_000
# Python reads no decimal integer that is longer.
_MOST_DIGITS = 4300

Built = TypeVar("Built")


def file_text(path: Path, refused: type[RefusedFileError], not_found: Callable[[], str]) -> str:
    """Text of a file.

    Raises `refused` for what is not a page of UTF-8 text, and `UsageError` where there is no file,
    with the message that `not_found` gives.
    """
    try:
        if not path.is_file():
            raise UsageError(not_found())
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            reason = f"larger than {MAX_BYTES} bytes; a {refused.kind} is a page of text"
            raise refused(str(path), [Fault("", reason)])
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        fault = Fault("", f"not UTF-8 text (byte {error.start}); save it as UTF-8")
        raise refused(str(path), [fault]) from None
    except OSError as error:
        raise UsageError(f"{printable(path)}: cannot be read: {error.strerror}") from None


def checked(
    text: str,
    source: str,
    build: Callable[[Table], Built | None],
    refused: type[RefusedFileError],
    changes: Mapping[str, Any] | None = None,
) -> Built:
    """What `build` makes of a document, once it has noted no fault in it.

    `changes` are put in place of what the text says, table by table. Raises `refused` with every
    fault found, in the order of the file.
    """
    if line := too_deep_line(text):
        raise refused(source, [Fault("", TOO_DEEP, line)])
    try:
        document = tomllib.loads(text)
    except ValueError as error:
        raise refused(source, [_syntax_fault(text, error)]) from None
    root = Table(merged(document, changes or {}), "", _nothing_to_take(document, changes or {}))
    built = build(root)
    if root.faults or built is None:
        lines = key_lines(text)
        for path in _paths(changes or {}):  # What has been replaced stands in no line.
            lines.pop(path, None)
        faults = [Fault(f.path, f.message, line_of(lines, f.path)) for f in root.faults]
        faults.sort(key=lambda fault: fault.line or 0)
        raise refused(source, faults)
    return built


def merged(document: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A document with `changes` in place of what it says, table by table.

    A table whose `kind` is changed is replaced as a whole: its other keys belong to the old kind.
    None takes an entry away.
    """
    whole = dict(document)
    for key, value in changes.items():
        if value is None:
            whole.pop(key, None)
            continue
        if isinstance(value, Mapping):
            before = _table(whole, key)
            same = value.get("kind", before.get("kind")) == before.get("kind")
            value = merged(before if same else {}, value)
        whole[key] = value
    return whole


def _nothing_to_take(
    document: Mapping[str, Any], changes: Mapping[str, Any], prefix: str = ""
) -> list[Fault]:
    """A fault for each entry that `changes` would take away and that the document lacks."""
    faults = []
    for key, value in changes.items():
        path = f"{prefix}{printable(key)}"
        if isinstance(value, Mapping):
            faults += _nothing_to_take(_table(document, key), value, f"{path}.")
        elif value is None and key not in document:
            what = (
                "an empty value (None in Python) removes an entry, but the file has no such entry"
            )
            faults.append(Fault(path, what))
    return faults


def _table(document: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """The table of a document by its key; an empty one where there is none."""
    value = document.get(key)
    return value if isinstance(value, Mapping) else {}


def _paths(changes: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Key paths of what `changes` replace."""
    for key, value in changes.items():
        if isinstance(value, Mapping) and value:
            yield from _paths(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}"


def _syntax_fault(text: str, error: ValueError) -> Fault:
    """What `tomllib` found wrong, with its line."""
    reason = str(error)
    if place := re.search(r" \(at (?:line (\d+), column \d+|end of document)\)$", reason):
        line = int(place[1] or text.count("\n") + 1)
    else:  # Of all numbers it is Python that refuses those of very many digits.
        reason = f"a number has more than {_MOST_DIGITS} digits"
        line = _line_of_longest_number(text)
    if "Cannot declare ('link',)" in reason:
        reason += "; each link of the arm is [[link]], in two brackets"
    return Fault("", f"not valid TOML: {printable(reason)}", line)


def _line_of_longest_number(text: str) -> int:
    longest = max(re.finditer(r"[0-9_]+", text), key=lambda found: len(found[0]))
    return text.count("\n", 0, longest.start()) + 1
