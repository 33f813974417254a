"""Signatures of Python functions as somebody would write them."""

from __future__ import annotations

import re

from sphinx.application import Sphinx

# What Python says of a type, and what it is called.
PLAINER = {
    r"TypeAliasForwardRef\('(\w+)'\)": r"\1",
    r"(~?\b[a-z_]\w*\.)+(?=[A-Za-z_])": "",
    r"ndarray\[tuple\[Any, \.\.\.\], dtype\[\w+\]\]": "Array",
}
# Of a class that is longer, the arguments are fields of a result, and nobody writes them down.
LONGEST = 250


def plain(
    app: Sphinx, what: str, name: str, obj: object, options: object, taken: str, given: str
) -> tuple[str, str] | None:
    """Make arguments and results readable; a handler of `autodoc-process-signature`."""
    if taken is None:  # A property, or an exception that takes anything.
        return None
    given = given or ""
    for wordy, word in PLAINER.items():
        taken, given = (re.sub(wordy, word, text) for text in (taken, given))
    return ("" if what == "class" and len(taken) > LONGEST else taken), given


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("autodoc-process-signature", plain)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
