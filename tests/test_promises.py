"""Every guarantee names tests that exist, and says rightly which of them run when."""

from __future__ import annotations

import ast
import re

import pytest
from conftest import CASES, ROOT

PAGE = (ROOT / "docs" / "guarantees.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("\n\n## ")[0]
ROWS = [row for row in SECTION.splitlines() if row.startswith("| ") and "---" not in row][1:]
NAMED = re.compile(r"`([\w/]+\.py)::(\w+)`(\**)")


def test_there_are_guarantees() -> None:
    assert len(ROWS) > 12


def _function(file: str, name: str) -> tuple[ast.Module, ast.FunctionDef]:
    """A test, and the file that it stands in."""
    tree = ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8"))
    (function,) = (
        node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name
    )
    return tree, function


def _stars(file: str, name: str) -> str:
    """One for a test that only CI runs, two for one that `-m exhaustive` runs alone."""
    tree, function = _function(file, name)
    marks = " ".join(
        ast.unparse(node)
        for node in (*function.decorator_list, *(n for n in tree.body if isinstance(n, ast.Assign)))
        if "pytest.mark" in ast.unparse(node)
    )
    counts = CASES.get(file, {}).get(name)
    is_slow = re.search(r"mark\.slow\b(?!\))", marks) is not None or (counts or (1,))[0] == 0
    is_exhaustive = "mark.exhaustive" in marks or counts == (0, 0)
    return "**" if is_exhaustive else "*" if is_slow else ""


@pytest.mark.parametrize("row", ROWS)
def test_a_guarantee_is_backed_by_tests_that_exist(row: str) -> None:
    tests = NAMED.findall(row)
    assert tests, "names no test"
    for file, name, stars in tests:
        assert stars == _stars(file, name), (file, name)


def test_tests_whose_cases_are_counted_exist() -> None:
    for file, counts in CASES.items():
        for name in counts:
            assert _function(file, name)
