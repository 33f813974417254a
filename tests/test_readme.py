"""What the README shows is what happens."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import pytest
from conftest import ROOT
from support.tools import run, tool

from gibbs_codegen.cli.app import argument_parser
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.scenario.file import TABLES, parse_scenario

README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    """Fenced blocks of a language."""
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


def test_python_session(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "generated").symlink_to(ROOT / "generated")
    monkeypatch.chdir(tmp_path)
    tool("cc")
    session, *snippets = blocks("python")
    names: dict[str, object] = {}
    test = doctest.DocTestParser().get_doctest(session, names, "README", "README.md", 0)
    runner = doctest.DocTestRunner()
    runner.run(test, clear_globs=False)
    assert runner.summarize(verbose=False).failed == 0
    for snippet in snippets:
        exec(snippet, {**test.globs, "v": test.globs["q"]})  # noqa: S102


def test_c_program(tmp_path: Path) -> None:
    """The C lines compile as the body of a program, and it computes something."""
    one, other, batch = blocks("c")
    *include, body = re.split(r"(?<=\*/)\n\n", one)
    lines = [*include, "#include <string.h>", "int main(void)", "{", body, other, "{", batch]
    lines += [
        "mass_matrix[0] = M[999 * 81];",
        "}",
        "return !(mass_matrix[80] > 0.0 && mass_matrix[0] > 0.0);",
        "}",
    ]
    (tmp_path / "program.c").write_text("\n".join(lines), encoding="utf-8")
    folder = ROOT / "generated" / "hexarotor_3link"
    sources = [tmp_path / "program.c", folder / "hexarotor_3link.c"]
    program = tmp_path / "program"
    run([tool("cc"), "-O1", f"-I{folder}", *sources, "-o", program, "-lm"])
    run([program])


def test_robot_file_is_one() -> None:
    text, _ = blocks("toml")
    robot = parse_robot(text)
    assert (robot.rotors, len(robot.links)) == (6, 1)


def test_scenario_is_one() -> None:
    _, text = blocks("toml")
    scenario = parse_scenario(text)
    assert scenario.arm.tip is not None
    # Every table of a scenario is shown.
    for table in TABLES:
        assert f"[{table}]" in text or f"[{table}." in text, table


def test_commands_are_ones() -> None:
    for line in "".join(blocks("sh")).splitlines():
        for command in re.findall(r"gibbs-codegen ([^#&]*)", line):
            argument_parser().parse_args(command.split())


def test_every_emitted_function_is_listed() -> None:
    for name in FUNCTIONS:
        assert f"`{name}" in README or f"{name}(" in README
