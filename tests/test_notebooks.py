"""Notebooks: stored clean, with stable cell ids, and every one runs and keeps its promises."""

from __future__ import annotations

import os
import time
from pathlib import Path

import nbformat
import pytest
from conftest import ROOT
from nbclient import NotebookClient

FOLDER = ROOT / "notebooks"
NAMES = (
    "01_gibbs_function",
    "02_chains",
    "03_hybrid_system",
    "05_flight",
    "06_your_own_controller",
    "07_derivatives",
    "appendix_from_symbols_to_code",
)
# What a notebook may take on an idle core is 60 s; the machine of a test run is not idle.
MOST_SECONDS = 300


def notebook(name: str) -> nbformat.NotebookNode:
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def test_these_are_the_notebooks() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.ipynb")) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_stored_clean_with_ids_that_say_what_a_cell_is(name: str) -> None:
    stored = notebook(name)
    nbformat.validate(stored)
    assert set(stored.metadata) <= {"kernelspec", "language_info"}
    ids = [cell.id for cell in stored.cells]
    assert len(set(ids)) == len(ids)
    for cell in stored.cells:
        assert set(cell.metadata) <= {"tags", "jupyter", "mystnb"}, cell.id
        # Words, and not the random digits that an editor gives a cell.
        assert all(part.isalpha() or part.isdigit() for part in cell.id.split("-")), cell.id
        if cell.cell_type == "code":
            assert cell.outputs == []
            assert cell.execution_count is None


@pytest.mark.parametrize("name", NAMES)
def test_ends_with_assertions(name: str) -> None:
    *_, last = [cell for cell in notebook(name).cells if cell.cell_type == "code"]
    assert last.source.count("assert ") >= 3


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_runs_from_top_to_bottom_without_a_warning(name: str, tmp_path: Path) -> None:
    """In a folder of its own, so that nothing is left in the checkout. Warnings go to stderr."""
    (tmp_path / "generated").symlink_to(ROOT / "generated")
    stored = notebook(name)
    start = time.perf_counter()
    NotebookClient(
        stored,
        timeout=MOST_SECONDS,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
    ).execute()
    assert time.perf_counter() - start < MOST_SECONDS
    for cell in stored.cells:
        for output in cell.get("outputs", []):
            assert output.get("name") != "stderr", (cell.id, output)
    assert {path.name for path in FOLDER.iterdir()} >= {f"{n}.ipynb" for n in NAMES}
    assert os.listdir(tmp_path)
