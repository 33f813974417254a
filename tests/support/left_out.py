"""Which tests the default run and CI leave out, as `tests/mutation/selection.py` has chosen."""

from __future__ import annotations

from pathlib import Path

LEFT_OUT = Path(__file__).parents[1] / "left_out.txt"


def left_out() -> dict[str, str]:
    """Marks of cases, and of tests of which all cases have the same, by their names.

    What is `slow` CI runs besides the default run, but not what is `exhaustive`.
    """
    lines = LEFT_OUT.read_text(encoding="utf-8").splitlines()
    return {name: mark for mark, name in (line.split(" ", 1) for line in lines)}
