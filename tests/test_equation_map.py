"""The table at the end of notebook 03: from every equation and figure to a cell and to code."""

from __future__ import annotations

import importlib
import re
from dataclasses import dataclass

import nbformat
import pytest
from conftest import ROOT

FOLDER = ROOT / "notebooks"
CELL = re.compile(r"(\d\d) \[`([a-z0-9-]+)`\]\((\w+)\.ipynb#cell-id=([a-z0-9-]+)\)")


@dataclass(frozen=True)
class Row:
    """One line of the table: what of the paper, where it is shown, and what computes it."""

    label: str
    meaning: str
    place: str
    names: tuple[str, ...]


def table() -> list[Row]:
    """The lines of the table, which is the last thing in notebook 03."""
    *_, last = nbformat.read(FOLDER / "03_hybrid_system.ipynb", as_version=4).cells
    assert last.id == "equation-map"
    lines = [line for line in last.source.splitlines() if line.startswith("| ")]
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines[1:]]
    return [Row(a, b, c, tuple(re.findall("`([^`]+)`", d))) for a, b, c, d in rows]


ROWS = table()
BY_LABEL = pytest.mark.parametrize("row", ROWS, ids=lambda row: row.label)


def test_every_equation_and_figure_is_listed_once_and_in_order() -> None:
    equations = [f"Eq. {number}" for number in range(1, 22)]
    figures = [f"Fig. {number}" for number in range(1, 12)]
    assert [row.label for row in ROWS] == equations + figures


@BY_LABEL
def test_the_cell_exists_in_the_notebook_that_is_named(row: Row) -> None:
    match = CELL.fullmatch(row.place)
    assert match, row.place
    number, shown, notebook, anchor = match.groups()
    assert shown == anchor
    assert notebook.startswith(f"{number}_")
    stored = nbformat.read(FOLDER / f"{notebook}.ipynb", as_version=4)
    assert anchor in {cell.id for cell in stored.cells}


@BY_LABEL
def test_every_name_is_that_of_something_public_and_documented_in_the_package(row: Row) -> None:
    assert row.names
    for dotted in row.names:
        path, _, name = dotted.rpartition(".")
        assert path.split(".")[0] == "gibbs_codegen"
        assert not any(part.startswith("_") for part in dotted.split("."))
        found = getattr(importlib.import_module(path), name)
        assert callable(found), dotted
        assert found.__doc__, dotted


@BY_LABEL
def test_the_cell_speaks_of_what_it_is_named_for(row: Row) -> None:
    """Its own text or id, or that of the cell before it, has the number of the equation."""
    match = CELL.fullmatch(row.place)
    assert match
    kind, number = row.label.split(". ")
    stored = nbformat.read(FOLDER / f"{match[3]}.ipynb", as_version=4)
    place = [cell.id for cell in stored.cells].index(match[4])
    near = stored.cells[max(place - 1, 0) : place + 2]
    words = [word for cell in near for word in f"{cell.id.replace('-', ' ')} {cell.source}".split()]
    text = " ".join(words)
    assert int(number) in mentioned(kind.lower(), text), text


def mentioned(kind: str, text: str) -> set[int]:
    """Numbers of equations ("eq") or figures ("fig") that a text mentions, ranges included."""
    numbers = r"(\d+(?:(?: |, |–| to | and |, and )+\d+)*)"
    starts = {"eq": r"\b(?:eqs?|equations?)\.? ", "fig": r"\b(?:figs?|figures?)\.? "}
    found: set[int] = set()
    for listed in re.findall(starts[kind] + numbers, text, re.IGNORECASE):
        for first, last in re.findall(r"(\d+)(?:(?:–| to )(\d+))?", listed):
            found |= set(range(int(first), int(last or first) + 1))
    return found


def test_numbers_are_found_in_words() -> None:
    assert mentioned("eq", "eqs. 7–9 and 12, eq 3 by diff, equation 15") == {3, 7, 8, 9, 12, 15}
    assert mentioned("fig", "figs 7 to 9 hybrid, Figs. 4 and 5; eq. 2") == {4, 5, 7, 8, 9}
