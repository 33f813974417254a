"""The target that CONTRIBUTING.md adds to a checkout emits functions that are right."""

from __future__ import annotations

import sys
from pathlib import Path
from shutil import copytree, ignore_patterns

import pytest
from conftest import ROOT
from support.pages import blocks, write_files
from support.tools import run

PAGE = "CONTRIBUTING.md"
TABLE = "TARGETS: dict[str, Target] = {\n"


@pytest.mark.slow
def test_a_target_added_as_the_page_says_gives_numpys_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("gibbs_codegen", "templates"):
        copytree(ROOT / folder, tmp_path / folder, ignore=ignore_patterns("__pycache__", "*.so"))
    module, template, program = write_files(PAGE, tmp_path)
    assert (module, template) == (
        "gibbs_codegen/targets/micropython.py",
        "templates/micropython_module.py.jinja",
    )
    _, imported, row, _ = blocks(PAGE, "py")
    registry = tmp_path / "gibbs_codegen" / "targets" / "registry.py"
    before, table, after = registry.read_text(encoding="utf-8").partition(TABLE)
    registry.write_text(before + imported + table + row + after, encoding="utf-8")
    *_, command = blocks(PAGE, "sh")
    for words in (command.split()[1:], [program]):
        said = run([sys.executable, *words], PYTHONPATH=str(tmp_path))
    assert said.strip() == "all functions agree"
