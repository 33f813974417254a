"""Notebooks: stored clean, with stable cell ids. The site runs them: `tests/site/test_site.py`."""

from __future__ import annotations

import nbformat
import pytest
from conftest import ROOT

FOLDER = ROOT / "notebooks"
NAMES = (
    "01_gibbs_function",
    "02_chains",
    "03_hybrid_system",
    "04_quasi_velocities",
    "05_flight",
    "06_your_own_controller",
    "07_derivatives",
    "08_other_bases",
    "09_from_a_log_to_a_robot_file",
    "appendix_from_symbols_to_code",
)


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
