"""Every guarantee names tests that exist, and says rightly which of them are slow."""

from __future__ import annotations

import ast
import re

import pytest
from conftest import ROOT

PAGE = (ROOT / "docs" / "guarantees.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("\n\n## ")[0]
ROWS = [row for row in SECTION.splitlines() if row.startswith("| ") and "---" not in row][1:]
NAMED = re.compile(r"`([\w/]+\.py)::(\w+)`(\*?)")


def test_there_are_guarantees() -> None:
    assert len(ROWS) > 12


@pytest.mark.parametrize("row", ROWS)
def test_a_guarantee_is_backed_by_tests_that_exist(row: str) -> None:
    tests = NAMED.findall(row)
    assert tests, "names no test"
    for file, name, slow in tests:
        tree = ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8"))
        (function,) = (
            node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name
        )
        marks = [ast.unparse(mark) for mark in function.decorator_list]
        whole = "pytestmark" in {
            ast.unparse(target)
            for node in tree.body
            if isinstance(node, ast.Assign)
            for target in node.targets
        }
        assert bool(slow) == (whole or "pytest.mark.slow" in marks), (file, name)
