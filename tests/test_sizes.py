"""Modules and functions are short enough to read at a sitting. Docstrings do not count."""

from __future__ import annotations

import ast
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "gibbs_codegen"
MODULE, FUNCTION = 250, 40


def lines_of_docstrings(tree: ast.AST) -> int:
    """Lines of all docstrings in a tree of syntax."""
    count = 0
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            docstring = node.body[0]
            count += (docstring.end_lineno or 0) - docstring.lineno + 1
    return count


def test_modules_and_functions_are_short() -> None:
    long = []
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        if (lines := len(text.splitlines()) - lines_of_docstrings(tree)) > MODULE:
            long.append(f"{path}: {lines} lines")
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                lines = (node.end_lineno or 0) - node.lineno + 1 - lines_of_docstrings(node)
                if lines > FUNCTION:
                    long.append(f"{path}:{node.lineno} {node.name}: {lines} lines")
    assert not long, "\n".join(long)
