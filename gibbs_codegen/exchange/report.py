"""What importing did, in the words of a robot file's opening comment."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from gibbs_codegen.errors import printable
from gibbs_codegen.exchange.source import Kind, Told

# In the order of a report, with what they mean.
KINDS: dict[Kind, str] = {
    "base": "the flying base",
    "welded": "part of what carries it",
    "locked": "a joint held fast",
    "snapped": "made exact",
    "rotor": "taken for a rotor",
    "left out": "not imported",
    "note": "worth a look",
}
_WIDTH = 99


def in_order(told: Sequence[Told]) -> list[Told]:
    """Lines of a report, by what was done."""
    order = list(KINDS)
    return sorted(told, key=lambda line: order.index(line.kind))


def opening_comment(source: str, told: Sequence[Told]) -> str:
    """The comment with which an imported robot file begins, with an empty line after it."""
    lines = [f"Imported from {printable(source, 80)} by gibbs-codegen import."]
    for kind in KINDS:
        found = [line for line in told if line.kind == kind]
        if kind in ("welded", "locked", "snapped") and found:
            names = ", ".join(dict.fromkeys(printable(line.subject, 60) for line in found))
            lines.append(f"{kind.capitalize()}: {names}.")
        elif kind != "rotor" and found:
            each = [f"{printable(line.subject, 60)} ({printable(line.detail)})" for line in found]
            lines.append(f"{kind.capitalize()}: {', '.join(each)}.")
    wrapped = [
        part for line in lines for part in textwrap.wrap(line, _WIDTH - 2, subsequent_indent="  ")
    ]
    return "".join(f"# {line}\n" for line in wrapped) + "\n"
