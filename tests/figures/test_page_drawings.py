"""The drawings of pages: every name can be read, and the stored files are what is drawn."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from drawings import DRAWINGS, STATIC, write_drawings
from matplotlib.figure import Figure
from support.names import assert_names_are_apart


@pytest.mark.parametrize(
    "draw",
    [*DRAWINGS.values()][1:2],
)
def test_no_name_hides_another_or_is_cut_off(draw: Callable[[], Figure]) -> None:
    assert_names_are_apart(draw(), smallest=10.0)


@pytest.mark.parametrize("draw", DRAWINGS.values())
def test_a_drawing_is_as_wide_as_a_phone(draw: Callable[[], Figure]) -> None:
    width = draw().get_size_inches()[0]
    assert width * 96.0 <= 390.0


@pytest.mark.slow
def test_the_stored_files_are_what_the_command_writes(tmp_path: Path) -> None:
    """By what is written in them: how curves are written is up to Matplotlib's version."""
    write_drawings(tmp_path)
    for name in DRAWINGS:
        stored, drawn = (
            re.findall(r"<!-- (.*?) -->", (folder / name).read_text(encoding="utf-8"))
            for folder in (STATIC, tmp_path)
        )
        assert stored == drawn, "python docs/_ext/drawings.py"
