"""Hostile text wherever text may be given: nothing is executed, nothing comes out unescaped."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT
from support.hostile_text import FAMILIAR, INJECTIONS, NAMES, TERMINAL
from support.tools import run, tool

from gibbs_codegen.cli.app import main
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.errors import Fault, RobotFileError, ScenarioFileError, UsageError, printable
from gibbs_codegen.files.toml import changes_of
from gibbs_codegen.flight.scenario.file import parse_scenario
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.names import coordinate_of, link_label, name_fault, name_from
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.targets.registry import TARGETS, find_targets, render_module

ROBOT = """name = NAME
[base]
rotors = 3
arm = { length = 1, mass_per_length = 1 }
"""
SCENARIO = """name = NAME
duration = 0.05
[base]
path = { kind = "fixed", position = [0, 0, 1] }
"""
# As arguments of a process, which cannot hold zero bytes.
TEXTS = [text for text in (*INJECTIONS, *TERMINAL) if text]


@pytest.fixture(autouse=True)
def _no_canary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Work in an empty folder, in which nothing that a text asks for may be done."""
    monkeypatch.chdir(tmp_path)
    yield
    assert not list(tmp_path.rglob("canary"))


def assert_plain(message: str) -> None:
    """No line of a message holds what a terminal would obey or hide."""
    assert all(line.isprintable() for line in message.split("\n")), ascii(message)


def test_there_are_hundreds() -> None:
    assert len(NAMES) > 300


@pytest.mark.slow
def test_hostile_robot_names_are_refused() -> None:
    for name in NAMES:
        with pytest.raises(RobotFileError) as refusal:
            parse_robot(ROBOT.replace("NAME", quoted(name)), "r.toml")
        (line,) = str(refusal.value).split("\n")
        assert re.match("r.toml:1: name: ['\"]", line)
        assert line.isascii()
        assert line.isprintable()
        assert len(line) < 400


def test_words_of_c_and_modules_of_python_are_welcome() -> None:
    """On every Python alike, whichever modules it has."""
    assert {"double", "math", "time", "string", "match", "json"} <= set(FAMILIAR)
    for name in FAMILIAR:
        assert parse_robot(ROBOT.replace("NAME", quoted(name))).name == name


def quoted(text: str) -> str:
    """A string of TOML, which has no pairs of surrogates as JSON has."""
    return "".join(
        ['"', *(c if c.isalnum() and c.isascii() else f"\\U{ord(c):08x}" for c in text), '"']
    )


def test_names_made_of_hostile_text_are_accepted() -> None:
    """`new` names a robot after its file, whatever that is called."""
    for text in NAMES:
        assert name_fault(name_from(text)) is None, text


@pytest.mark.parametrize("text", ["\x1b[31m", "a\nb", "\u202e", "\udcff", "\x9b"])
def test_a_message_holds_no_control_characters(text: str) -> None:
    assert printable(f"<{text}>") == f"<{text.encode('unicode_escape').decode()}>"
    assert str(RobotFileError(text, [Fault("", "no")])).isprintable()


def test_a_message_is_short_and_keeps_both_ends() -> None:
    assert printable("é" * 160) == "é" * 160
    shown = printable("/home/" + "x" * 500 + "/robot.toml")
    assert len(shown) == 160
    assert shown.startswith("/home/x")
    assert shown.endswith("x/robot.toml")
    assert "..." in shown


COMMANDS = [
    ["info", "TEXT"],
    ["schema", "./TEXT"],
    ["generate", "./TEXT"],
    ["generate", "hexarotor", "TEXT"],
    ["generate", "hexarotor", "--target", "./TEXT"],
    ["generate", "--rotors", "TEXT,", "--links", "1"],
    ["show", "hexarotor", "--chain", "1", "--format", "./TEXT"],
    ["simulate", "./TEXT", "--scenario", "hover"],
    ["simulate", "hexarotor", "--scenario", "./TEXT"],
    ["simulate", "hexarotor", "--scenario", "hover", "--set", "TEXT"],
    ["simulate", "hexarotor", "--scenario", "hover", "--set", "TEXT=TEXT"],
    ["simulate", "hexarotor", "--scenario", "hover", "--set", "control.law=TEXT"],
    ["simulate", "hexarotor", "--scenario", "hover", "--set", "parameters={TEXT=1}"],
]


@pytest.mark.slow
def test_hostile_arguments_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["simulate", "hexarotor", "--scenario", "hover", "--set", "TEXT"]
    for text in TEXTS:
        words = [word.replace("TEXT", text) for word in command]
        try:
            code = main(words)
        except SystemExit as end:  # As argparse ends what it does not understand.
            code = int(end.code or 0)
        out, err = capsys.readouterr()
        if text in ("--help", "-h") and code == 0:
            continue
        assert code == 2, (words, err)
        assert err
        assert out == ""
        assert_plain(err)
        assert "Traceback" not in err
        assert max(map(len, err.split("\n"))) < 700
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("place", ["name", "base.attitude", "base.thrust", "link"])
def test_hostile_values_and_keys_of_a_robot_file_are_refused(place: str) -> None:
    """As values they are no direction and no sequence, as keys they are unknown."""
    base = ROBOT.replace("NAME", '"plain"').splitlines()
    for text in (*INJECTIONS, *TERMINAL):
        value = quoted(text)
        for entry in (f"{place} = {value}", f"{value}.{place} = 1"):
            with pytest.raises(RobotFileError) as refusal:
                parse_robot("\n".join([entry, *base]), "r.toml")
            assert_plain(str(refusal.value))


@pytest.mark.slow
def test_hostile_names_of_links_stay_what_they_are() -> None:
    """Any text names links, rotors, frames and coordinates, and the file's own text repeats it."""
    for text in (*INJECTIONS, *TERMINAL):
        word = quoted(text)
        lines = ["name = 'plain'", "[base]", "mass = 1", "[[rotor]]", f"on = {word}", "[[frame]]"]
        lines += [
            f"name = {word}",
            "[[link]]",
            "mass = 1",
            f"name = {word}",
            "[[link]]",
            "mass = 1",
        ]
        lines += [f"coordinate = {quoted(text + 'é')}", f"parent = {word}"]
        try:
            robot = parse_robot("\n".join(lines), "r.toml")
        except RobotFileError as refusal:
            assert_plain(str(refusal))
            assert not 0 < len(text) < 128, text
            continue
        assert (robot.links[0].name, robot.frames[0].name) == (text, text)
        assert parse_robot(robot_text(robot)) == robot
        assert coordinate_of(robot, 1).isidentifier()
        assert_plain(link_label(robot, 1))


def test_hostile_text_in_a_scenario_is_refused_or_kept_as_it_is() -> None:
    for text in (*INJECTIONS, *TERMINAL):
        value = quoted(text)
        try:
            scenario = parse_scenario(SCENARIO.replace("NAME", value), "s.toml")
        except ScenarioFileError as error:
            refusal = str(error)
        else:
            refusal = ""
            assert scenario.name == text
            assert text.isprintable()
        assert_plain(refusal)
        keyed = SCENARIO.replace("NAME", '"plain"') + f"[parameters]\n{value} = true\n"
        with pytest.raises(ScenarioFileError) as refused:
            parse_scenario(keyed, "s.toml")
        assert_plain(str(refused.value))


def test_hostile_changes_are_strings_and_nothing_else() -> None:
    for text in TEXTS:
        try:
            changes = changes_of([f"name={text}"])
        except UsageError as error:
            assert_plain(str(error))
        else:
            assert isinstance(changes["name"], str | float | int | list | dict | None)


PRINTABLE = "$\\frac{$ {{7*7}} %s {0} [red]a[/] */ __import__('os') \\input{x} <b> é 漢 ﬁ"


@pytest.fixture(scope="module")
def small() -> Model:
    """A derived model, to be emitted under many names."""
    return derive(parse_robot(ROBOT.replace("NAME", '"plain"')))


@pytest.mark.slow
def test_what_else_a_robot_file_says_stays_in_it(small: Model) -> None:
    """Comments hold any text. Of all that is emitted, only the copy of the file repeats them."""
    text = "".join(f"# canary {text!a} {text.splitlines()[:1]}\n" for text in INJECTIONS)
    files = render_module(small, text, TARGETS)
    assert files.pop("robot.toml") == text
    assert not any("canary" in emitted or "7*7" in emitted for emitted in files.values())


# Letters and words that emitted code, C's libraries or compilers use themselves.
ODD_NAMES = ["linux", "math", "double"]
MORE_ODD_NAMES = [
    *("hybrid", "a" * 64),
    *(
        "a",
        "b",
        "i",
        "q",
        "r",
        "u",
        "v",
        "x",
        "real",
        "bits",
        "constants",
        "init",
        "unix",
    ),
    *("i386", "sin", "std", "main", "memcpy", "size", "lanes", "batch", "restrict_", "n_", "x__y"),
    *("e1", "sine_cosine", "prepare", "fma", "near", "far", "small", "interface", "windows", "arm"),
    *("string", "stdint", "float", "time", "imp", "operator", "numpy_module", "rows", "casadi"),
]


def renamed(model: Model, name: str) -> Model:
    """The same of a robot of another name."""
    robot = dataclasses.replace(model.robot, name=name)
    description = dataclasses.replace(model.description, robot=robot)
    return dataclasses.replace(model, description=description)


@pytest.mark.slow
def test_what_is_accepted_compiles_and_imports(small: Model, tmp_path: Path) -> None:
    sources = []
    for name in ODD_NAMES:
        assert name_fault(name) is None
        model = renamed(small, name)
        folder = tmp_path / "modules" / name
        folder.mkdir(parents=True)
        targets = find_targets(["numpy", "c"])
        for file, text in render_module(model, "", targets).items():
            (folder / file).write_text(text)
        sources += [folder / f"{name}{ending}.c" for ending in ("", "_batch")]
    warnings = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only"]
    for source in sources:
        run([tool("gcc"), "-std=gnu99", *warnings, source])
        run([tool("g++"), "-x", "c++", "-std=gnu++17", *warnings, source])
    # Behind everything else on the path, as the README has it; others stand there before.
    others = [name for name in ODD_NAMES if name in {"casadi", *sys.stdlib_module_names}]
    code = (
        f"import importlib, sys; sys.path.append('modules')\n"
        "from gibbs_codegen import load\n"
        f"for name in {ODD_NAMES}:\n"
        f"    modules = [] if name in {others} else [importlib.import_module(name)]\n"
        "    for module in (load(f'modules/{name}'), *modules):\n"
        "        assert module.NAME == name, module\n"
        "        assert module.mass_matrix([0.1] * 6).shape == (6, 6)"
    )
    run([sys.executable, "-c", code], PYTHONPATH=str(ROOT))


@pytest.mark.slow
def test_a_robot_may_be_named_like_a_header_that_emitted_code_reads(
    small: Model, tmp_path: Path
) -> None:
    """Its own header is found by its place, and the system's where the folder above is searched."""
    (tmp_path / "plain").mkdir()
    for file, text in render_module(small, "", find_targets()).items():
        (tmp_path / "plain" / file).write_text(text)
    plain = tmp_path / "plain" / "plain.c"
    listed = run([tool("gcc"), "-M", "-fopenmp", plain]).replace("\\\n", " ").split()
    headers = {Path(p).stem for p in listed if p.endswith(".h")} - {"plain"}
    headers = {name for name in headers if name_fault(name) is None}
    assert {"math", "string", "stddef", "stdint", "float", "features"} <= headers
    for name in sorted(headers):
        model = renamed(small, name)
        (tmp_path / name).mkdir()
        for file, text in render_module(model, "", {"c": TARGETS["c"]}).items():
            (tmp_path / name / file).write_text(text)
    programs = []
    for name in sorted(headers):
        programs.append(tmp_path / f"program_{name}.c")
        programs[-1].write_text(
            f'#include "{name}/{name}.h"\n#include <math.h>\n#include <string.h>\n'
            f"int main(void) {{ return sizeof({name}_constants) == 0 || cos(0.0) < 0.5; }}\n"
        )
    sources = [tmp_path / name / f"{name}.c" for name in sorted(headers)]
    run([tool("gcc"), "-fopenmp", "-fsyntax-only", f"-I{tmp_path}", *sources, *programs])


@pytest.mark.slow
def test_hostile_names_of_files_do_not_reach_the_terminal(tmp_path: Path) -> None:
    """In a process of its own, with what Python does to its streams."""
    name = "\x1b[31m\udcff[red]\n\u202e.toml"
    (tmp_path / name).write_text("name = 3")
    done = subprocess.run(
        [sys.executable, "-m", "gibbs_codegen", "info", name], cwd=tmp_path, capture_output=True
    )
    assert done.returncode == 2
    assert done.stderr.decode().isascii()
    assert_plain(done.stderr.decode())
    assert b"\\x1b[31m\\udcff[red]\\n\\u202e.toml:1: name: must be a string" in done.stderr
