"""Files in TOML: their text, checked as a whole, or every fault of the file at once."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from gibbs_codegen.errors import Fault, RefusedFileError, printable
from gibbs_codegen.files.changes import changed_paths, merged, nothing_to_remove
from gibbs_codegen.files.toml_text import TOO_DEEP, key_lines, line_of, too_deep_line

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
) -> Checked:
    """The top table of a document, once it is checked against what its tables may hold.

    Raises `refused` with every fault, in the order of the file, which messages call `source`.
    `changes` come in place of what the text says, table by table.
    """
    from gibbs_codegen.files.table import key_path  # Late, as it imports pydantic.

    if line := too_deep_line(text):
        raise refused(source, [Fault("", TOO_DEEP, line)])
    try:
        document = tomllib.loads(text)
    except ValueError as error:
        raise refused(source, [_syntax_fault(text, error)]) from None
    other, keys = table.mistaken()
    if theirs := [key for key in document if key in keys]:
        words = f"a key of {other}, and not of a {refused.kind}, which must be given here"
        raise refused(source, [Fault(theirs[0], words, line_of(key_lines(text), (theirs[0],)))])
    changes = changes or {}
    found, refusals = table.read(merged(document, changes))
    absent = list(nothing_to_remove(document, changes))
    if found is not None and not absent:
        return found
    lines = key_lines(text)
    changed = set(changed_paths(changes))
    for path in changed:  # What has been replaced stands in no line.
        lines.pop(path, None)
    faults = [Fault(key_path(place), words) for place, words in absent]
    faults += [
        Fault(
            key_path(place),
            f"{words} (changed: not as in the file)" if key_path(place) in changed else words,
            line_of(lines, place),
        )
        for place, words in refusals
    ]
    raise refused(source, sorted(faults, key=lambda fault: fault.line or 0))


def _syntax_fault(text: str, error: ValueError) -> Fault:
    """What `tomllib` found wrong, with its line."""
    if text.lstrip().startswith("<"):
        xml = "not valid TOML: it is XML; if it is a URDF, xacro or MJCF file, make a robot file of"
        return Fault("", f"{xml} it first, with gibbs-codegen import FILE", 1)
    reason = str(error)
    if place := re.search(r" \(at (?:line (\d+), column \d+|end of document)\)$", reason):
        line = int(place[1] or text.count("\n") + 1)
    else:  # Of all numbers it is Python that refuses those of very many digits.
        reason = f"a number has more than {_MOST_DIGITS} digits"
        line = _line_of_longest_number(text)
    if array := re.search(r"Cannot declare \('(rotor|link|frame)',\)", reason):
        reason += f"; each {array[1]} is [[{array[1]}]], in two brackets"
    elif reason.startswith("Cannot overwrite a value"):
        reason += "; the key or table stands further up already: give it once"
    return Fault("", f"not valid TOML: {printable(reason)}", line)


def _line_of_longest_number(text: str) -> int:
    longest = max(re.finditer(r"[0-9_]+", text), key=lambda found: len(found[0]))
    return text.count("\n", 0, longest.start()) + 1
