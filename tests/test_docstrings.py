"""Docstrings have sections where users read them, and are as short as a thought elsewhere.

Users read what `gibbs_codegen` exports, the class that a guide imports from where it is, and the
functions of generated modules, whose Python is in `gibbs_codegen/emitted`. There, docstrings say
what every argument, result and error is, in sections of Google's style. All other docstrings are
for those who read the code beside them, and have none.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import gibbs_codegen

PACKAGE = Path(__file__).parents[1] / "gibbs_codegen"
FOLDERS = sorted({path.parent.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py")})
SECTION = re.compile(r"^(Args|Returns|Yields|Raises|Attributes):$", re.MULTILINE)
Definition = ast.FunctionDef | ast.ClassDef
# One needs Gymnasium, so that `gibbs_codegen` does not export it; array programs are for those who
# write laws of their own.
BY_PATH = {
    (PACKAGE / "flight" / "rollouts" / "torch_env.py", "TorchEnv"),
    (PACKAGE / "flight" / "rollouts" / "vector_env.py", "VectorEnv"),
    (PACKAGE / "machine" / "policies.py", "network"),
    (PACKAGE / "machine" / "policies.py", "policy_program"),
    (PACKAGE / "flight" / "autopilots" / "betaflight.py", "Betaflight"),
    (PACKAGE / "flight" / "autopilots" / "machine.py", "Machine"),
    (PACKAGE / "flight" / "autopilots" / "session.py", "fly"),
    (PACKAGE / "arrays" / "backward.py", "gradient"),
    (PACKAGE / "arrays" / "c_file.py", "write_c"),
    (PACKAGE / "arrays" / "evaluation.py", "evaluate"),
    (PACKAGE / "arrays" / "evaluation.py", "evaluate_casadi"),
    (PACKAGE / "arrays" / "forward.py", "jacobian"),
    (PACKAGE / "arrays" / "functions.py", "Functions"),
    (PACKAGE / "arrays" / "matlab_text.py", "write_matlab"),
    (PACKAGE / "arrays" / "nodes.py", "Program"),
    (PACKAGE / "arrays" / "nodes.py", "variable"),
}


def exported() -> set[tuple[Path, str]]:
    """Files and names of what `gibbs_codegen` exports, and of the bases of its classes."""
    things = [getattr(gibbs_codegen, name) for name in gibbs_codegen.__all__]
    things += [base for what in things if isinstance(what, type) for base in what.__mro__[1:]]
    return {
        (PACKAGE.parent / f"{what.__module__.replace('.', '/')}.py", what.__name__)
        for what in things
        if getattr(what, "__module__", "").startswith("gibbs_codegen.")
    }


def definitions(body: list[ast.stmt], prefix: str = "") -> Iterator[tuple[str, Definition]]:
    """Functions and classes of a module with their qualified names, nested ones too.

    Those in a function, which users do not see, have a private part in their names.
    """
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield prefix + node.name, node
            inside = "_locals." if isinstance(node, ast.FunctionDef) else ""
            yield from definitions(node.body, f"{prefix}{node.name}.{inside}")


def missing(function: ast.FunctionDef, text: str | None = None) -> list[str]:
    """What the sections of a docstring leave out, or say of arguments that there are not."""
    taken = function.args
    listed = [*taken.posonlyargs, *taken.args, *taken.kwonlyargs, taken.vararg, taken.kwarg]
    names = {argument.arg for argument in listed if argument is not None} - {"self", "cls"}
    text = text or ast.get_docstring(function) or ""
    section = re.search(r"^Args:\n(.*?)(?=^\S|\Z)", text, re.MULTILINE | re.DOTALL)
    heads = re.findall(r"^    (\*{0,2}[\w, *]+):", section[1], re.MULTILINE) if section else []
    told = {name.strip(" *") for head in heads for name in head.split(",")}
    found = [f"argument {name}" for name in sorted(names - told)]
    found += [f"{name}, which is no argument" for name in sorted(told - names)]
    returned = ast.unparse(function.returns) if function.returns else "None"
    if names and returned not in ("None", "Never", "NoReturn", "Self"):
        found += [] if re.search(r"^(Returns|Yields):", text, re.MULTILINE) else ["result"]
    return found + [f"error {name}" for name in sorted(_raised(function)) if name not in text]


def _raised(function: ast.FunctionDef) -> set[str]:
    """Classes of errors that a function itself raises."""
    raised = [n.exc for n in ast.walk(function) if isinstance(n, ast.Raise) and n.exc]
    names = {ast.unparse(e.func if isinstance(e, ast.Call) else e).split(".")[-1] for e in raised}
    return {name for name in names if name[0].isupper()}


def faults(path: Path, users_read: set[tuple[Path, str]]) -> Iterator[str]:
    """What is wrong with the docstrings of a file."""
    emitted = path.parent.name == "emitted"
    for name, node in definitions(ast.parse(path.read_text(encoding="utf-8")).body):
        is_public = not any(part.startswith("_") for part in name.split("."))
        where = f"{path.relative_to(PACKAGE)}:{node.lineno} {name}: "
        if is_public and (emitted or (path, name.split(".")[0]) in users_read):
            if isinstance(node, ast.FunctionDef) and (lacks := missing(node)):
                yield where + "; ".join(lacks)
            made = next((x for x in node.body if getattr(x, "name", "") == "__init__"), None)
            text = ast.get_docstring(node) or ""
            if isinstance(made, ast.FunctionDef) and "\nArgs:\n" in text:
                for lack in (x for x in missing(made, text) if "argument" in x):
                    yield where + lack
        elif not emitted and (heads := SECTION.findall(ast.get_docstring(node) or "")):
            yield where + f"{', '.join(heads)} where no user reads it"


@pytest.mark.parametrize("folder", FOLDERS, ids=str)
def test_docstrings_have_sections_where_users_read_them(folder: Path) -> None:
    users_read = exported() | BY_PATH
    files = sorted((PACKAGE / folder).glob("*.py"))
    found = [fault for path in files for fault in faults(path, users_read)]
    assert not found, "\n".join(found)


def test_what_is_exported_is_found() -> None:
    names = {name for _, name in exported()}
    assert {*gibbs_codegen.__all__} - names <= {"__version__"}
    assert all(path.is_file() for path, _ in exported())


SPOILT = '''
def torque(tape, angle, rate) -> float:
    """Torque of a joint.

    Args:
        tape: Where statements go.
        angle: In rad.
        speed: In rad/s.
    """
    raise ValueError
'''


def test_what_is_missing_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{__name__}.PACKAGE", tmp_path)
    spoilt = tmp_path / "spoilt.py"
    spoilt.write_text(SPOILT, encoding="utf-8")
    assert [*faults(spoilt, {(spoilt, "torque")})] == [
        "spoilt.py:2 torque: argument rate; speed, which is no argument; result; error ValueError"
    ]
    assert [*faults(spoilt, set())] == ["spoilt.py:2 torque: Args where no user reads it"]
