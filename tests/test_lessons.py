"""The first lessons do what they say: each runs in an empty folder, as a reader would type it."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest
from support.pages import PAGES, write_files
from support.tools import compiler_to_run, run, tool

LESSONS = sorted({p for p in PAGES if p.startswith("docs/lessons/")} - {"docs/lessons/index.md"})


@pytest.mark.slow
@pytest.mark.parametrize("page", LESSONS)
def test_a_lesson_prints_what_it_shows(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks of commands in order; a text block is what those above it print, but for a "…"."""
    if "firmware" in page:
        tool("arm-none-eabi-gcc")
    if "learning" in page:
        pytest.importorskip("gymnasium")
        monkeypatch.setenv("CC", compiler_to_run())
    write_files(page, tmp_path)
    folder = Path(sys.executable).parent
    path = f"{folder}{os.pathsep}{os.environ['PATH']}"
    printed = ""
    for language, block in re.findall(r"^```(sh|text)\n(.*?)^```", PAGES[page], re.M | re.S):
        if language == "sh":
            printed = run([tool("bash"), "-euc", f"cd '{tmp_path}'\n{block}"], PATH=path)
            continue
        lines = (
            re.escape(x.removesuffix("…")) + ".*" * x.endswith("…") for x in block.splitlines()
        )
        shown = "".join(r"(?:.*\n)*?" if line == ".*" else line + r"\n" for line in lines)
        assert re.fullmatch(shown, printed), printed
