"""The table of the page on the paper: from every equation and figure to a cell and to code.

The site runs the cells, which assert what they claim. Here every row leads to a cell and to
functions.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import nbformat
import pytest
from conftest import ROOT

FOLDER = ROOT / "notebooks"
PLACE = re.compile(r"(\d\d) \[[^]]+\]\(\.\./notebooks/(\w+)\.ipynb#([\w-]+)\), `([a-z0-9-]+)`")


@dataclass(frozen=True)
class Row:
    """One line of the table: what of the paper, where it is shown, and what computes it."""

    label: str
    notebook: str
    anchor: str
    cell: str
    names: tuple[str, ...]

    @classmethod
    def of(cls, line: str) -> Row:
        """The row that a line of Markdown holds."""
        label, _, names, place = (entry.strip() for entry in line.strip("|").split(" | "))
        match = PLACE.fullmatch(place)
        assert match, place
        number, notebook, anchor, cell = match.groups()
        assert notebook.startswith(f"{number}_")
        return cls(
            # Labels have a space at which lines do not break.
            label.replace("\N{NO-BREAK SPACE}", " "),
            notebook,
            anchor,
            cell,
            tuple(
                ".".join(filter(None, ("gibbs_codegen", module, name)))
                for name, module in re.findall(r"`(\w+)`(?: in `([\w.]+)`)?", names)
            ),
        )

    @property
    def functions(self) -> list[Callable[..., Any]]:
        """What the row names in the package."""
        parts = (dotted.rpartition(".") for dotted in self.names)
        return [getattr(importlib.import_module(path), name) for path, _, name in parts]


def table() -> list[Row]:
    """The lines of the table."""
    lines = (ROOT / "templates" / "paper.md.jinja").read_text(encoding="utf-8").splitlines()
    return [Row.of(line) for line in lines if re.match(r"\| (Eq|Fig)\.", line)]


def cells_of(notebook: str) -> list[Any]:
    """The cells of a notebook."""
    cells: list[Any] = nbformat.read(FOLDER / f"{notebook}.ipynb", as_version=4).cells
    return cells


ROWS = table()
BY_LABEL = pytest.mark.parametrize("row", ROWS, ids=lambda row: row.label)


def test_every_equation_and_figure_is_listed_once_and_in_order() -> None:
    equations = [f"Eq. {number}" for number in range(1, 22)]
    figures = [f"Fig. {number}" for number in range(1, 12)]
    assert [row.label for row in ROWS] == equations + figures


@BY_LABEL
def test_the_cell_stands_below_the_heading_that_is_linked(row: Row) -> None:
    heading = ""
    for cell in cells_of(row.notebook):
        if cell.cell_type == "markdown":
            *_, heading = [heading, *re.findall(r"^#+ (.+)$", cell.source, re.MULTILINE)]
        if cell.id == row.cell:
            assert cell.cell_type == "code"
            assert row.anchor == anchor_of(heading)
            return
    pytest.fail(f"{row.notebook} has no cell {row.cell}")


def anchor_of(heading: str) -> str:
    """The anchor that MyST gives a heading: formulas are left out."""
    text = re.sub(r"\$[^$]*\$", "", heading).strip().lower()
    return re.sub(r"[^\w\- ]", "", text.replace(" ", "-"))


@BY_LABEL
def test_every_name_is_that_of_something_public_and_documented_in_the_package(row: Row) -> None:
    assert row.names
    assert not any(part.startswith("_") for dotted in row.names for part in dotted.split("."))
    for function in row.functions:
        assert callable(function)
        assert function.__doc__
