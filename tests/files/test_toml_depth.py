"""What is nested too deeply is told from what only looks so."""

from __future__ import annotations

import tomllib

import pytest

from gibbs_codegen.files.toml import MAX_DEPTH, too_deep_line

DOTS = ".".join("abcdefghijklmnopqrstuvwxyz")


@pytest.mark.parametrize(
    "text",
    [
        "x" + ".x" * (MAX_DEPTH - 1) + " = 1",
        "x = " + "[" * MAX_DEPTH + "]" * MAX_DEPTH,
        "x = " + "{ x = " * MAX_DEPTH + "1" + " }" * MAX_DEPTH,
        "[[link]]\n" * 100,
        "[a]\n" + "".join(f"x{i} = [{{ y = [1.5, 2.5] }}]\n" for i in range(100)),
        f"# {DOTS} {'[' * 100}",
        f'x = "{DOTS} {"[" * 100}"',
        f"x = '{DOTS} {'[' * 100}'",
        f'x = """\n{DOTS}\n"{"[" * 100}\\""""',
        f"x = '''\n{DOTS}\n'{'[' * 100}'''",
        f'"{DOTS}" = 1',
        f'x = "#"\ny = "{DOTS}" # "',
    ],
)
def test_what_is_not_too_deep(text: str) -> None:
    tomllib.loads(text)
    assert too_deep_line(text) is None


@pytest.mark.parametrize(
    ("deep", "line"),
    [
        ("x" + ".x" * MAX_DEPTH + " = 1", 3),
        ("[" + "x." * MAX_DEPTH + "x]", 3),
        ("[[" + "x . " * MAX_DEPTH + "x]]", 3),
        ("x = { " + "'x'.\"x\"." * MAX_DEPTH + "x = 1 }", 3),
        ("x = " + "[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1), 3),
        ("x = [\n" + "[\n" * MAX_DEPTH + "]" * (MAX_DEPTH + 1), 3 + MAX_DEPTH),
        ("x = " + "[{ x = " * MAX_DEPTH + "1" + " }]" * MAX_DEPTH, 3),
    ],
)
def test_what_is_too_deep(deep: str, line: int) -> None:
    text = f'y = """\n# [[["""\n{deep}'
    tomllib.loads(text)
    assert too_deep_line(text) == line
