"""Where keys are, and what is nested too deeply, told from what only looks so."""

from __future__ import annotations

import tomllib

import pytest

from gibbs_codegen.files.toml import MAX_DEPTH, key_lines, too_deep_line

DOTS = ".".join("abcdefghijklmnopqrstuvwxyz")


def test_every_table_and_key_has_a_line() -> None:
    """By hand: also tables of which all keys may be missing, and those that dots make."""
    text = "x.y = 1\n[a.b]\nc = 2\n[[link]]\n\n[[link]]\nd = 3\n[link.e]\n"
    lines = {"x": 1, "x.y": 1, "a.b": 2, "a.b.c": 3, "link": 4, "link[0]": 4}
    assert key_lines(text) == lines | {"link[1]": 6, "link[1].d": 7, "link.e": 8}


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
