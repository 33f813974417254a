"""Every promise names tests that exist, and says rightly which of them are slow."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
from conftest import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
SECURITY = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
SECTION = README.partition("## What is promised")[2].partition("\n\n*Do the tests")[0]
ROWS = [row for row in SECTION.splitlines() if row.startswith("| ") and "---" not in row][1:]
NAMED = re.compile(r"`([\w/]+\.py)::(\w+)`(\*?)")


def test_there_are_promises() -> None:
    assert len(ROWS) > 12


@pytest.mark.parametrize("row", ROWS)
def test_a_promise_is_backed_by_tests_that_exist(row: str) -> None:
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


@pytest.mark.parametrize("path", sorted(set(re.findall(r"`((?:tests|\.ci)/[\w/]+\.py)", SECURITY))))
def test_what_security_refers_to_exists(path: str) -> None:
    assert Path(ROOT / path).is_file()
