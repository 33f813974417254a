"""Long lines of source: broken at spaces, but not within an index."""

from __future__ import annotations

import re
import textwrap

# The width of lines in every language, and the indent of continued ones.
WIDTH, INDENT = 100, 4
_NO_BREAK = "\N{NO-BREAK SPACE}"


def broken(
    text: str, width: int = WIDTH, whole: str = r"\[[^\]]*\]", hanging: str = " " * INDENT
) -> list[str]:
    """A statement on as many lines as it needs; what the pattern `whole` matches stays whole.

    Lines after the first begin as it does, and with `hanging`.
    """
    if len(text) <= width:
        return [text]
    margin = " " * (len(text) - len(text.lstrip()))
    lines = textwrap.wrap(
        re.sub(whole, lambda match: match[0].replace(" ", _NO_BREAK), text.strip()),
        width,
        initial_indent=margin,
        subsequent_indent=margin + hanging,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_NO_BREAK, " ") for line in lines]
