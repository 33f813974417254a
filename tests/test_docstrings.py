"""Docstrings say what every argument, result and error is, in the sections of Google's style."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "gibbs_codegen"
# The tape on which statements are written needs no words a hundred times.
SAID_ONCE = {"self", "cls", "tape"}
FOLDERS = sorted({path.parent.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py")})


def functions(module: ast.Module) -> Iterator[tuple[ast.FunctionDef, bool]]:
    """Functions and methods of a module, and whether they are public."""
    for node in module.body:
        if isinstance(node, ast.FunctionDef):
            yield node, not node.name.startswith("_")
        elif isinstance(node, ast.ClassDef):
            for method in node.body:
                if isinstance(method, ast.FunctionDef) and not method.name.startswith("__"):
                    yield method, not (node.name.startswith("_") or method.name.startswith("_"))


def missing(function: ast.FunctionDef, is_public: bool) -> list[str]:
    """What the sections of a docstring leave out, or say of arguments that there are not."""
    given = function.args
    listed = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
    names = {argument.arg for argument in listed if argument is not None} - SAID_ONCE
    if not names or (not is_public and len(names) < 3):
        return []
    text = ast.get_docstring(function) or ""
    section = re.search(r"^Args:\n(.*?)(?=^\S|\Z)", text, re.MULTILINE | re.DOTALL)
    heads = re.findall(r"^    (\*{0,2}[\w, *]+):", section[1], re.MULTILINE) if section else []
    told = {name.strip(" *") for head in heads for name in head.split(",")} - SAID_ONCE
    found = [f"argument {name}" for name in sorted(names - told)]
    found += [f"{name}, which is no argument" for name in sorted(told - names)]
    returned = ast.unparse(function.returns) if function.returns else "None"
    if returned not in ("None", "Never", "NoReturn", "Self"):
        found += [] if re.search(r"^(Returns|Yields):", text, re.MULTILINE) else ["result"]
    return found + [f"error {name}" for name in sorted(_raised(function)) if name not in text]


def _raised(function: ast.FunctionDef) -> set[str]:
    """Classes of errors that a function itself raises."""
    raised = [n.exc for n in ast.walk(function) if isinstance(n, ast.Raise) and n.exc]
    names = {ast.unparse(e.func if isinstance(e, ast.Call) else e).split(".")[-1] for e in raised}
    return {name for name in names if name[0].isupper()}


@pytest.mark.parametrize("folder", FOLDERS, ids=str)
def test_docstrings_are_whole(folder: Path) -> None:
    found = [
        f"{path.name}:{function.lineno} {function.name}: {'; '.join(lacks)}"
        for path in sorted((PACKAGE / folder).glob("*.py"))
        for function, is_public in functions(ast.parse(path.read_text(encoding="utf-8")))
        if (lacks := missing(function, is_public))
    ]
    assert not found, "\n".join(found)


SPOILT = '''
def torque(tape, angle, rate):
    """Torque of a joint.

    Args:
        tape: Where statements go.
        angle: In rad.
        speed: In rad/s.
    """
    raise ValueError
'''


def test_what_is_missing_is_found() -> None:
    (spoilt,) = ast.parse(SPOILT.replace("rate):", "rate) -> float:")).body
    assert isinstance(spoilt, ast.FunctionDef)
    assert missing(spoilt, True) == [
        "argument rate",
        "speed, which is no argument",
        "result",
        "error ValueError",
    ]
