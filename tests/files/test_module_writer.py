"""Writing: a whole module or nothing, whatever happens meanwhile."""

from __future__ import annotations

import fcntl
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from support.folders import tree
from support.tools import HANGING, tool

from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.files import module_writer as write
from gibbs_codegen.files import staging as folder_lock
from gibbs_codegen.files.module_writer import (
    MANIFEST,
    check_replaceable,
    differing_files,
    write_module,
)
from gibbs_codegen.version import HEADER_START

HEADER = f"# {HEADER_START}\n"
FILES = {"__init__.py": HEADER, "numpy_module.py": HEADER + "x = 1\n" * 1000}
NEWER = {**FILES, "numpy_module.py": f"{HEADER}x = 2\n"}


def visible(folder: Path) -> dict[str, list[str]]:
    """Every folder below, with its files."""
    return {
        str(p.relative_to(folder)): sorted(os.listdir(p)) for p in folder.rglob("*") if p.is_dir()
    }


def refuse_to_replace_with_new(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a swap fail half-way."""
    real = os.replace

    def refuse_new(source: Path, destination: Path) -> None:
        if Path(source).name == "_new":
            raise OSError(5, "Input/output error")
        real(source, destination)

    monkeypatch.setattr(os, "replace", refuse_new)


def test_writes_and_replaces(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b" / "robot"
    write_module(target, FILES)
    write_module(target, NEWER)
    assert differing_files(target, NEWER) == []
    assert differing_files(target, FILES) == ["numpy_module.py", MANIFEST]
    assert os.listdir(target.parent) == ["robot"]


@pytest.mark.parametrize(("first", "second"), [("x", "x_batch"), ("x_each", "x")])
def test_robots_whose_sources_have_one_name_are_not_put_side_by_side(
    first: str, second: str, tmp_path: Path
) -> None:
    def files(name: str) -> dict[str, str]:
        return {**FILES, **{f"{name}{end}.c": HEADER for end in ("", "_batch", "_each")}}

    write_module(tmp_path / first, files(first))
    before = tree(tmp_path)
    with pytest.raises(UsageError, match=r"x_\w+\.c would have the names of files in .*rename"):
        write_module(tmp_path / second, files(second))
    assert tree(tmp_path) == before
    write_module(tmp_path / first, {**files(first), "numpy_module.py": HEADER})
    for name in (f"{first}2", "robot", "r"):  # All have a robot.toml.
        write_module(tmp_path / name, {**files(name), "robot.toml": HEADER})


def test_a_failure_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "robot"
    write_module(target, FILES)

    def full(path: Path, text: str) -> None:
        path.write_text(text[:10])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(write, "_write_flushed", full)
    with pytest.raises(OutputError, match="No space left on device; nothing was changed"):
        write_module(target, NEWER)
    assert differing_files(target, FILES) == []
    assert os.listdir(tmp_path) == ["robot"]
    with pytest.raises(OutputError):
        write_module(tmp_path / "new" / "deep" / "robot", FILES)
    assert os.listdir(tmp_path) == ["robot"]


def test_a_swap_that_fails_is_undone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "robot"
    write_module(target, FILES)
    refuse_to_replace_with_new(monkeypatch)
    with pytest.raises(OutputError):
        write_module(target, NEWER)
    assert differing_files(target, FILES) == []
    assert os.listdir(tmp_path) == ["robot"]


def test_what_an_outright_kill_left_is_removed_and_what_it_took_is_put_back(tmp_path: Path) -> None:
    stale, young = (tmp_path / f".gibbs_codegen_new_{name}" for name in ("abc", "def"))
    for folder in (stale / "_new", stale / "taken", stale / "there", tmp_path / "there", young):
        folder.mkdir(parents=True)
    (stale / "taken" / "__init__.py").write_text("")
    (tmp_path / "there" / "__init__.py").write_text("")
    os.utime(stale, (0, 0))
    write_module(tmp_path / "robot", FILES)
    assert sorted(os.listdir(tmp_path)) == [young.name, "robot", "taken", "there"]
    assert os.listdir(tmp_path / "there") == ["__init__.py"]


def test_foreign_files_are_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "robot").write_text("a file")
    with pytest.raises(UsageError, match="is not a generated module"):
        write_module(tmp_path / "robot", FILES)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UsageError, match="is not a generated module"):
        write_module(tmp_path / "link", FILES)


def test_a_file_where_a_folder_should_be_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UsageError, match="file: is a file; --out must be a folder"):
        write_module(tmp_path / "file" / "robot", FILES)


def mine(target: Path, kind: str) -> Path:
    """Put something of a user's into a module, as new users have done; where it is."""
    if kind == "edited":
        path = target / "numpy_module.py"
    elif kind == "beside Python's cache":
        path = target / "__pycache__" / "mine.txt"
        path.parent.mkdir()
    elif kind == "named like Python's cache":
        path = target / "__pycache__" / "mine.cpython-311.pyc"
        path.parent.mkdir()
    else:
        path = target / kind
    path.write_text(f"{HEADER}precious")
    return path


KINDS = ["edited", "beside Python's cache", "named like Python's cache", "copy.c", "robot.toml"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("manifest", [True, False], ids=["manifest", "no manifest"])
def test_files_of_the_user_are_refused_by_name_and_with_force_kept(
    kind: str, manifest: bool, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    target = tmp_path / "robot"
    write_module(target, FILES)
    if not manifest:
        (target / MANIFEST).unlink()
    path = mine(target, kind)
    before = tree(tmp_path)
    name = path.relative_to(target).as_posix()
    for refused in (write_module, check_replaceable) if manifest else (write_module,):
        with pytest.raises(
            UsageError, match=rf"robot: holds files that .*{re.escape(name)}.*--force"
        ):
            refused(target, NEWER if refused is write_module else "")
    assert tree(tmp_path) == before
    assert name in differing_files(target, FILES)

    check_replaceable(target, "", force=True)
    write_module(target, NEWER, force=True)
    assert differing_files(target, NEWER) == []
    assert tree(tmp_path / "robot.old1") == {
        path.removeprefix("robot/"): what for path, what in before.items() if path != "robot"
    }
    assert name in caplog.text
    assert f"; the folder is kept as {target}.old1" in caplog.text

    (target / "more.txt").write_text("precious, too")
    write_module(target, {"__init__.py": HEADER}, force=True)
    assert "no longer has" not in caplog.text  # They are in robot.old2.
    assert (tmp_path / "robot.old2" / "more.txt").read_text() == "precious, too"
    assert sorted(os.listdir(tmp_path)) == ["robot", "robot.old1", "robot.old2"]


def test_force_replaces_a_module_that_is_as_generated(tmp_path: Path) -> None:
    write_module(tmp_path / "robot", FILES)
    write_module(tmp_path / "robot", NEWER, force=True)
    assert os.listdir(tmp_path) == ["robot"]


def test_a_forced_swap_that_fails_is_undone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_module(tmp_path / "robot", FILES)
    mine(tmp_path / "robot", "thesis.txt")
    before = tree(tmp_path)
    refuse_to_replace_with_new(monkeypatch)
    with pytest.raises(OutputError):
        write_module(tmp_path / "robot", NEWER, force=True)
    assert tree(tmp_path) == before


def test_what_python_keeps_of_the_module_is_in_nobodys_way(tmp_path: Path) -> None:
    target = tmp_path / "robot"
    write_module(target, FILES)
    command = [sys.executable, "-c", "import robot.numpy_module"]
    for level in ("", "1"):
        changed = {
            "PYTHONOPTIMIZE": level,
            "PYTHONDONTWRITEBYTECODE": "",
            "PYTHONPYCACHEPREFIX": "",
        }
        subprocess.run(command, cwd=tmp_path, env={**os.environ, **changed}, check=True)
    assert len(os.listdir(target / "__pycache__")) == 4
    assert differing_files(target, FILES) == []
    write_module(target, NEWER)
    assert sorted(os.listdir(target)) == [MANIFEST, *sorted(FILES)]


def test_without_a_manifest_a_module_is_replaced_by_its_equal_only(tmp_path: Path) -> None:
    target = tmp_path / "robot"
    write_module(target, FILES)
    (target / MANIFEST).unlink()
    assert differing_files(target, FILES) == [MANIFEST]
    check_replaceable(target, "")
    with pytest.raises(UsageError, match=r"not in MANIFEST: numpy_module\.py;"):
        write_module(target, NEWER)
    write_module(target, FILES)
    assert differing_files(target, FILES) == []


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: text.replace("# Generated", "# generated"),
        lambda text: text + "a note of mine\n",
        lambda text: "<<<<<<< ours\n" + text,
        lambda text: "",
    ],
)
def test_a_manifest_that_was_changed_is_none(spoil: Callable[[str], str], tmp_path: Path) -> None:
    target = tmp_path / "robot"
    write_module(target, FILES)
    (target / MANIFEST).write_text(spoil((target / MANIFEST).read_text()))
    with pytest.raises(UsageError, match=r"not in MANIFEST: MANIFEST, numpy_mod"):
        write_module(target, NEWER)


def test_a_manifest_is_read_by_sha256sum(tmp_path: Path) -> None:
    write_module(tmp_path / "robot", FILES)
    command = [tool("sha256sum"), "--check", "--strict", MANIFEST]
    subprocess.run(command, cwd=tmp_path / "robot", check=True)


def test_a_path_through_the_module_itself_leads_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "robot"
    write_module(target, FILES)
    monkeypatch.chdir(target)
    write_module(Path("..") / "robot", NEWER)
    assert differing_files(target, NEWER) == []
    monkeypatch.chdir(tmp_path)
    write_module(Path("robot") / ".." / "robot", FILES)
    assert differing_files(target, FILES) == []
    assert os.listdir(tmp_path) == ["robot"]


@pytest.mark.parametrize("calls", [{1}, {2}, {1, 2}], ids=str)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_signals_during_the_swap_leave_a_whole_module(
    calls: set[int], number: signal.Signals, tmp_path: Path
) -> None:
    """Also when a second signal comes while the first is being dealt with."""
    write_module(tmp_path / "robot", FILES)
    code = (
        "import os, signal, sys; from pathlib import Path\n"
        "from gibbs_codegen.files import module_writer as write\n"
        # Tests that run in the background begin with signals ignored, and a child inherits that.
        f"signal.signal({int(number)}, signal.SIG_DFL)\n"
        "real, seen = os.replace, []\n"
        "def interrupted(source, destination):\n"
        "    real(source, destination); seen.append(source)\n"
        f"    if len(seen) in {calls}: os.kill(os.getpid(), {int(number)})\n"
        "os.replace = interrupted\n"
        f"write.write_module(Path('robot'), {NEWER!r})\n"
        "print('survived')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode != 0
    assert "survived" not in done.stdout
    assert os.listdir(tmp_path) == ["robot"]
    assert differing_files(tmp_path / "robot", NEWER) == []


def test_a_signal_that_is_ignored_stays_ignored(tmp_path: Path) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        write_module(tmp_path / "robot", FILES)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_an_edited_robot_file_can_be_generated_from(tmp_path: Path) -> None:
    files = {**FILES, "robot.toml": "gravity = 9.81"}
    edited = {**FILES, "robot.toml": "gravity = 1.6"}
    target = tmp_path / "robot"
    write_module(target, files)
    (target / "robot.toml").write_text("gravity = 1.6")
    with pytest.raises(UsageError, match=r"changed since: robot\.toml;"):
        write_module(target, files)
    check_replaceable(target, "gravity = 1.6")
    write_module(target, edited)
    assert differing_files(target, edited) == []


def test_a_name_too_long_for_the_disk_is_wrong_use(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="File name too long"):
        write_module(tmp_path / ("a" * 300), FILES)


def test_a_file_named_like_what_a_kill_leaves_is_left_alone(tmp_path: Path) -> None:
    odd = tmp_path / ".gibbs_codegen_new_x"
    odd.write_text("a file")
    os.utime(odd, (0, 0))
    write_module(tmp_path / "robot", FILES)
    assert sorted(os.listdir(tmp_path)) == [odd.name, "robot"]


@pytest.mark.slow
def test_a_disk_that_fills_up_leaves_nothing_behind(tmp_path: Path) -> None:
    """A limit on the size of files stands in for a full disk."""
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))"
    code = (
        f"{limit}\nimport sys\nfrom gibbs_codegen.cli.app import main\n"
        "sys.exit(main(['generate', 'hexarotor']))"
    )
    done = subprocess.run(
        [sys.executable, "-B", "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert "cannot be written: File too large; nothing was changed" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_under_standard_output_is_no_traceback(tmp_path: Path) -> None:
    command = f"{sys.executable} -m gibbs_codegen info hexarotor > /dev/full"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "No space left" in done.stderr


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)]
)
def test_nothing_is_left_behind_when_ended(number: signal.Signals, tmp_path: Path) -> None:
    """A signal at any moment leaves a whole module or nothing."""
    process = subprocess.Popen(
        [sys.executable, "-m", "gibbs_codegen", "generate", "quadrotor_2link"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    time.sleep(0.5)
    process.send_signal(number)
    process.wait(timeout=HANGING)
    left = visible(tmp_path)
    endings = (".c", ".h", "_batch.c", "_each.c")
    sources = [f"quadrotor_2link{ending}" for ending in endings]
    module = [MANIFEST, "__init__.py", "gibbs_runtime.h", "numpy_module.py", *sources, "robot.toml"]
    whole = {"generated": ["quadrotor_2link"], "generated/quadrotor_2link": module}
    assert left in ({}, whole)


def test_a_write_in_progress_is_cleaned_up_when_ended(tmp_path: Path) -> None:
    """The signal comes while the files are half written."""
    code = (
        "from pathlib import Path\n"
        "from gibbs_codegen.files import module_writer as write\n"
        "def slow(path, text):\n"
        "    path.write_text('half'); print('writing', flush=True); input()\n"
        "write._write_flushed = slow\n"
        "write.write_module(Path('out') / 'robot', {'__init__.py': ''})"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGTERM)
    process.communicate(b"\n", timeout=HANGING)
    assert visible(tmp_path) == {}


WRITE_MANY = """
import multiprocessing, sys
from pathlib import Path
from gibbs_codegen.files.module_writer import check_replaceable, differing_files, write_module

FILES = {FILES!r}

def write(number):
    for _ in range(10):
        check_replaceable(Path("out/robot"), "")
        write_module(Path("out/robot"), FILES)
        assert differing_files(Path("out/robot"), FILES) == []
    return number

with multiprocessing.get_context("fork").Pool(16) as pool:
    assert pool.map(write, range(16), chunksize=1) == list(range(16))
"""


def test_a_file_is_closed_before_it_replaces_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, opened, replace, real = tmp_path / "robot.toml", [], os.replace, Path.open

    def noting(self: Path, *args: Any, **options: Any) -> Any:
        opened.append(real(self, *args, **options))
        return opened[-1]

    def checking(old: Path, new: Path) -> None:
        assert opened[-1].closed  # Else Windows would refuse.
        replace(old, new)

    path.write_text("old")
    monkeypatch.setattr(Path, "open", noting)
    monkeypatch.setattr(os, "replace", checking)
    write.write_new_file(path, "new", force=True)
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["robot.toml"]


@pytest.mark.slow
def test_many_processes_write_at_once(tmp_path: Path) -> None:
    """Each finds, checks and replaces a whole module, never one that another is replacing."""
    code = WRITE_MANY.replace("{FILES!r}", repr(FILES))
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=HANGING,
    )
    assert done.returncode == 0, done.stderr
    assert os.listdir(tmp_path / "out") == ["robot"]
    assert differing_files(tmp_path / "out" / "robot", FILES) == []


@contextmanager
def locked(folder: Path) -> Iterator[int]:
    """Another process that holds the lock of a folder; its number."""
    code = "import fcntl, os, sys; fcntl.flock(os.open('.', 0), fcntl.LOCK_EX); print(flush=True)"
    process = subprocess.Popen(
        [sys.executable, "-c", f"{code}; sys.stdin.read()"],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with process:
        assert process.stdout is not None
        process.stdout.readline()
        yield process.pid
        process.communicate()


def test_a_lock_that_is_never_let_go_is_named_and_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(folder_lock, "_NOTICE_SECONDS", 0.02)
    monkeypatch.setattr(folder_lock, "_PATIENCE_SECONDS", 0.2)
    target = tmp_path / "robot"
    write_module(target, FILES)
    with locked(tmp_path) as number:
        for work in (
            lambda: check_replaceable(target, ""),
            lambda: write_module(target, NEWER),
            lambda: differing_files(target, FILES),
        ):
            caplog.clear()
            with pytest.raises(
                OutputError, match=rf"process {number} has been writing .*another --out"
            ):
                work()
            assert [record.getMessage() for record in caplog.records] == [
                f"{tmp_path}: waiting for process {number} to finish"
            ]
    assert differing_files(target, FILES) == []


@pytest.mark.slow
def test_a_wait_of_seconds_is_said_where_the_command_runs(tmp_path: Path) -> None:
    (tmp_path / "generated").mkdir()
    with locked(tmp_path / "generated") as number:
        process = subprocess.Popen(
            [sys.executable, "-m", "gibbs_codegen", "generate", "hexarotor", "--check"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stderr is not None
        # A slow machine also says that it derives the equations.
        assert f"generated: waiting for process {number} to finish\n" in iter(
            process.stderr.readline, ""
        )
    assert "is not there yet" in process.communicate(timeout=HANGING)[1]
    assert process.returncode == 1


def test_waiting_for_another_process_can_be_ended(tmp_path: Path) -> None:
    """And then nothing is written."""
    code = (
        "from pathlib import Path\n"
        "from gibbs_codegen.files import module_writer as write\n"
        "write.staging.check_output_folder = lambda _: print('ready', flush=True)\n"
        f"write.write_module(Path('robot'), {FILES!r})"
    )
    held = os.open(tmp_path, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX)
        process = subprocess.Popen(
            [sys.executable, "-c", code],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
        )
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(0.2)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=HANGING) == -signal.SIGTERM
        process.stdout.close()
    finally:
        os.close(held)
    assert os.listdir(tmp_path) == []
