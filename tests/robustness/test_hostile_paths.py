"""Odd and hostile paths: output goes where it was asked to go, or nowhere, and displaces nothing.

Every test works in a folder `work`, beside a folder `outside` that nothing may touch.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from support.folders import Tree, tree

from gibbs_codegen import pipeline
from gibbs_codegen.cli.app import main
from gibbs_codegen.figures import FORMATS
from gibbs_codegen.flight import simulation
from gibbs_codegen.flight.figures.flight import FIGURES
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.targets.registry import DEFAULT_TARGETS


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one of everything that a path can lead to."""
    folder = tmp_path / "work"
    for name in ("work/folder/deep", "outside/folder"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "outside" / "file").write_text("precious")
    (folder / "file").write_text("precious")
    os.mkfifo(folder / "pipe")
    for name, target in {
        "to_folder": "folder",
        "to_file": "file",
        "to_nothing": "nowhere",
        "to_itself": "to_itself",
        "there": "back",
        "back": "there",
        "to_outside": "../outside/folder",
        "to_outside_file": "../outside/file",
        "to_device": "/dev/full",
    }.items():
        (folder / name).symlink_to(target)
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture(scope="module")
def module_files() -> Any:
    """What is emitted of the smallest robot that ships, derived once for all tests."""
    robot, text = read_robot("hexarotor")
    return pipeline.module_files(robot, text, DEFAULT_TARGETS, False, lambda _: None)


@pytest.fixture(scope="module")
def flight(shipped: Callable[[str], ModuleType]) -> Flight:
    """A flight of that robot, flown once."""
    return simulation.simulate(shipped("hexarotor"), read_scenario("hover", {"duration": 0.01}))


@pytest.fixture
def quick(
    module_files: Any,
    flight: Flight,
    shipped: Callable[[str], ModuleType],
    monkeypatch: pytest.MonkeyPatch,
) -> str:
    """Spare the derivation and the flight, which no path changes; the folder of a module."""
    monkeypatch.setattr(pipeline, "module_files", lambda *_: module_files)
    monkeypatch.setattr(simulation, "simulate", lambda *_, **__: flight)
    return str(Path(shipped("hexarotor").__file__ or "").parent)


def outcome(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Exit code and streams of a command, neither of which holds what a terminal would obey."""
    try:
        code = main(words)
    except SystemExit as end:
        code = int(end.code or 0)
    out, err = capsys.readouterr()
    assert all(line.isprintable() for line in (out + err).split("\n"))
    assert "Traceback" not in err
    assert (code == 0) == (err == "")
    assert max(map(len, (out + err).split("\n"))) < 600
    return code, out, err


def assert_only_added(before: Tree, after: Tree, below: str) -> None:
    """All that was there is as it was; all that is new stands below a path, or leads there."""
    assert {path: after.get(path) for path in before} == before
    new = after.keys() - before.keys()
    assert new
    for path in new:
        assert f"{path}/".startswith(f"{below}/") or f"{below}/".startswith(f"{path}/"), path


# What verification finds is no matter here.
UNVERIFIED = ("generate", "hexarotor", "--no-verify")

# Where output may go, and where that is from the folder that holds `work`.
PLACES = {
    "new": "work/new",
    "a/b/c": "work/a/b/c",
    "./new/": "work/new",
    "a//b": "work/a/b",
    "folder": "work/folder",
    "folder/../up": "work/up",
    "to_folder": "work/folder",
    "to_folder/new": "work/folder/new",
    "to_folder/../up": "work/up",
    "../outside/new": "outside/new",
    "to_outside": "outside/folder",
    "to_outside/..": "outside",
    "../work/new": "work/new",
    "with blank": "work/with blank",
    " ": "work/ ",
    "-x": "work/-x",
    "./--": "work/--",
    "CON": "work/CON",
    "nul.txt": "work/nul.txt",
    "~": "work/~",
    "$HOME": "work/$HOME",
    "*": "work/*",
    "...": "work/...",
    "[red]": "work/[red]",
    "{{7*7}}%s{0}": "work/{{7*7}}%s{0}",
    "a\nb": "work/a\nb",
    "\x1b[31m": "work/\x1b[31m",
    "é漢\u202e": "work/é漢\u202e",
    "\udcff": "work/\udcff",
    "x" * 200: "work/" + "x" * 200,
}
# Where it may not: what is there, or the name, forbids it.
NO_PLACES = [
    *("", "file", "file/new", "to_file", "to_file/new", "to_outside_file", "pipe", "pipe/new"),
    *("to_nothing", "to_nothing/new", "to_itself", "to_itself/new", "there", "there/new"),
    *("/dev/null", "/dev/null/new", "/dev/full", "/dev/stdout/new", "to_device", "folder/../file"),
    *("x" * 300, "x" * 5000, "new/" + "x" * 300, "x/" * 3000),
]


@pytest.mark.slow
def test_output_goes_where_it_is_asked_to(
    quick: str, work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = tree(work.parent)
    for out, place in PLACES.items():
        code, said, _ = outcome(capsys, *UNVERIFIED, f"--out={out}")
        assert code == 0, out
        assert said
        after = tree(work.parent)
        assert_only_added(before, after, f"{place}/hexarotor")
        for path in sorted(after.keys() - before.keys(), reverse=True):
            if after[path] == "d":
                (work.parent / path).rmdir()
            else:
                (work.parent / path).unlink()


@pytest.mark.parametrize("command", ["generate", "simulate"])
def test_output_goes_nowhere_else(
    command: str, quick: str, work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*UNVERIFIED] if command == "generate" else ["simulate", quick]
    before = tree(work.parent)
    for out in NO_PLACES:
        code, said, err = outcome(capsys, *words, f"--out={out}")
        assert (code, said) == (2, ""), (out, err)
    code, said, err = outcome(capsys, *words, "--out=--")
    assert (code, said) == (2, "")
    assert "write ./-- for a path of that name" in err
    code, said, err = outcome(capsys, *words, "--out=/proc/nowhere")
    assert (code, said) == (1, "")
    assert "cannot be written" in err
    assert tree(work.parent) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="permission bits do not bind root")
@pytest.mark.parametrize("command", ["generate", "simulate"])
def test_a_folder_that_may_not_be_written_is_left_alone(
    command: str, quick: str, work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [*UNVERIFIED] if command == "generate" else ["simulate", quick]
    before = tree(work.parent)
    (work / "folder").chmod(0o500)
    try:
        for out in ("folder", "folder/new", "to_folder"):
            code, said, err = outcome(capsys, *words, f"--out={out}")
            assert (code, said) == (1, "")
            assert "Permission denied" in err
        assert outcome(capsys, "new", "folder/robot.toml")[0] == 1
    finally:
        (work / "folder").chmod(0o700)
    assert tree(work.parent) == before


def entries(kind: str, path: Path) -> None:
    """Put something in the way at a path."""
    if kind == "file":
        path.write_text("precious")
    elif kind == "folder":
        path.mkdir()
    elif kind == "full folder":
        path.mkdir()
        (path / "thesis.txt").write_text("precious")
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(
            {
                "link": "../file",
                "link out": "../../outside/file",
                "loop": path.name,
                "link to nothing": "nowhere",
                "link to folder": "../../outside/folder",
                "device": "/dev/full",
            }[kind]
        )


LINKS = ["link", "link out", "loop", "link to nothing", "link to folder", "device"]


@pytest.mark.parametrize("kind", ["file", "full folder", "pipe", *LINKS])
def test_what_stands_where_the_module_is_to_be(
    kind: str, quick: str, work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    entries(kind, work / "folder" / "hexarotor")
    before = tree(work.parent)
    code, _, err = outcome(capsys, "generate", "hexarotor", "--out", "folder")
    assert code == 2
    assert "folder/hexarotor: " in err
    assert tree(work.parent) == before


@pytest.mark.parametrize("kind", ["file", "folder", "full folder", "pipe", *LINKS])
@pytest.mark.parametrize("name", ["thesis.txt", "hexarotor.h"])
def test_what_stands_in_a_module_and_is_not_of_it(
    kind: str, name: str, quick: str, work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert outcome(capsys, *UNVERIFIED, "--out", "folder")[0] == 0
    path = work / "folder" / "hexarotor" / name
    path.unlink(missing_ok=True)
    entries(kind, path)
    before = tree(work.parent)
    code, _, err = outcome(capsys, "generate", "hexarotor", "--out", "folder")
    assert code == 2
    assert f"holds files that were not generated, or were changed since: {name}; " in err
    assert tree(work.parent) == before


@pytest.mark.parametrize("kind", ["file", "folder", "pipe", *LINKS])
@pytest.mark.parametrize("name", ["flight.csv", "flight.npz"])
@pytest.mark.parametrize("earlier", [False, True], ids=["first flight", "second flight"])
def test_what_stands_where_results_are_to_be(
    kind: str, name: str, earlier: bool, quick: str, work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of files of the names of results only those beside an earlier flight's give way."""
    words = [
        "simulate",
        quick,
        "--scenario",
        "hover",
        "--no-figures",
        "--backend",
        "numpy",
        "--out",
        "folder",
    ]
    if earlier:
        assert outcome(capsys, *words)[0] == 0
        (work / "folder" / name).unlink(missing_ok=True)
    entries(kind, work / "folder" / name)
    before = tree(work.parent)
    code, _, err = outcome(capsys, *words)
    if earlier and kind == "file" and name != "flight.npz":
        assert code == 0
        return
    assert code == 2
    assert "folder: holds files that no simulation wrote: " in err
    assert name in err
    assert tree(work.parent) == before


def test_all_names_of_results_are_guarded(
    quick: str, work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [f"{draw.__name__}.{suffix}" for draw in FIGURES for suffix in FORMATS]
    for name in (*names, "flight.mp4"):
        path = work / "folder" / name
        path.write_text("precious")
        words = [
            "simulate",
            quick,
            "--scenario",
            "hover",
            "--no-figures",
            "--backend",
            "numpy",
            "--out",
            "folder",
        ]
        assert outcome(capsys, *words)[0] == 2
        assert path.read_text() == "precious"
        path.unlink()


@pytest.mark.slow
def test_robot_files_at_odd_places(
    quick: str, work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = read_robot("hexarotor")[1]
    for name in ("with blank", "-x.toml", "a\nb", "\x1b[31m", "CON", "é漢", "\udcff", "x" * 200):
        (work / name).write_text(text)
        assert outcome(capsys, "generate", "--no-verify", "--", name)[0] == 0
    (work / "to_robot").symlink_to("with blank")
    for name in ("to_robot", "./with blank", "folder/../with blank", str(work / "CON")):
        assert outcome(capsys, "generate", "--no-verify", name)[0] == 0
    before = tree(work)
    for name in (*NO_PLACES, ".", "..", "folder", "to_folder", "nowhere", "/", "/proc/self/mem"):
        code, said, _ = outcome(capsys, "generate", "--", name)
        assert (code, said) == (2, ""), name
    assert tree(work) == before


def test_modules_at_odd_places(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (work / "broken").mkdir()
    (work / "broken" / "numpy_module.py").write_text("x = (")
    (work / "zeros").mkdir()
    (work / "zeros" / "numpy_module.py").write_bytes(b"\0" * 100)
    for name in ("broken", "zeros"):
        (work / name / "__init__.py").write_text("from .numpy_module import *\n")
    for name in (*NO_PLACES, ".", "folder", "to_folder", "nowhere", "/", "broken", "zeros"):
        code, said, _ = outcome(capsys, "simulate", "--scenario", "hover", "--", name)
        assert (code, said) == (2, ""), name
    assert not (work / "flight").exists()


def test_new_files_at_odd_places(
    quick: str, work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("with blank", "-x", "CON.toml", "$HOME;&", "é漢.toml", "x" * 200, "folder/../up"):
        before = tree(work.parent)
        code, said, _ = outcome(capsys, "new", "--", name)
        assert code == 0
        (added,) = tree(work.parent).keys() - before.keys()
        assert Path(added) == Path(os.path.normpath(Path("work") / name))
        # The command that it says comes next is one that works, if copied.
        if len(name) < 100:
            words = shlex.split(said.partition("then run: ")[2])
            assert words[:2] == ["gibbs-codegen", "generate"]
            # What `quick` gives for every robot is not the functions of this one.
            code, _, _ = outcome(capsys, "generate", "--no-verify", *words[2:])
            assert code == 0
    for name in ("a\nb", "\x1b[31m", "\udcff"):
        assert outcome(capsys, "new", name)[0] == 0
        assert (work / name).is_file()
    before = tree(work.parent)
    kept = ["", ".", "file", "folder", "to_folder", "to_file", "to_outside_file", "pipe"]
    for name in (*kept, "to_nothing", "to_itself", "there", "/dev/null", "/dev/full", "to_device"):
        code, said, err = outcome(capsys, "new", "--", name)
        assert (code, said) == (2, "")
        assert "exists already" in err
    for name in ("file/x", "nowhere/x", "to_itself/x", "x" * 300, "x" * 5000, "/proc/nowhere"):
        code, said, err = outcome(capsys, "new", "--", name)
        assert (code, said) == (1, "")
        assert "cannot be written" in err
    assert tree(work.parent) == before
