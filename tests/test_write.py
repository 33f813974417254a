"""Writing: a whole module or nothing, whatever happens meanwhile."""

from __future__ import annotations

import fcntl
import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import ROOT

from gibbs_codegen import write
from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.version import HEADER_START
from gibbs_codegen.write import differing_files, write_module

HEADER = f"# {HEADER_START}\n"
FILES = {"__init__.py": HEADER, "numpy_module.py": HEADER + "x = 1\n" * 1000}
NEWER = {**FILES, "numpy_module.py": f"{HEADER}x = 2\n"}


def visible(folder: Path) -> dict[str, list[str]]:
    """Every folder below, with its files."""
    return {
        str(p.relative_to(folder)): sorted(os.listdir(p)) for p in folder.rglob("*") if p.is_dir()
    }


def test_writes_and_replaces(tmp_path: Path) -> None:
    target = tmp_path / "a" / "b" / "robot"
    write_module(target, FILES)
    write_module(target, NEWER)
    assert differing_files(target, NEWER) == []
    assert differing_files(target, FILES) == ["numpy_module.py"]
    assert os.listdir(target.parent) == ["robot"]


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
    real = os.replace

    def refuse_new(source: Path, destination: Path) -> None:
        if Path(source).name == "_new":
            raise OSError(5, "Input/output error")
        real(source, destination)

    monkeypatch.setattr(os, "replace", refuse_new)
    with pytest.raises(OutputError):
        write_module(target, NEWER)
    assert differing_files(target, FILES) == []
    assert os.listdir(tmp_path) == ["robot"]


def test_what_an_outright_kill_left_is_removed_and_what_it_took_is_put_back(tmp_path: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    stale = tmp_path / f".gibbs_codegen_{gone.pid}_abc"
    (stale / "_new").mkdir(parents=True)
    (stale / "taken").mkdir()
    (stale / "taken" / "__init__.py").write_text("")
    young = tmp_path / f".gibbs_codegen_{gone.pid}_def"
    mine = tmp_path / f".gibbs_codegen_{os.getpid()}_abc"
    for folder in (young, mine):
        folder.mkdir()
    for folder in (stale, mine):
        os.utime(folder, (0, 0))
    write_module(tmp_path / "robot", FILES)
    assert sorted(os.listdir(tmp_path)) == sorted([young.name, mine.name, "robot", "taken"])


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


def test_files_of_the_user_are_not_lost(tmp_path: Path) -> None:
    target = tmp_path / "robot"
    write_module(target, FILES)
    (target / "__pycache__").mkdir()
    write_module(target, NEWER)
    (target / "thesis.txt").write_text("precious")
    with pytest.raises(UsageError, match=r"not generated: thesis\.txt"):
        write_module(target, FILES)
    assert (target / "thesis.txt").read_text() == "precious"
    assert differing_files(target, NEWER) == ["thesis.txt"]


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
        "import os, signal, sys; from pathlib import Path; from gibbs_codegen import write\n"
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


def test_an_edited_robot_file_is_not_lost(tmp_path: Path) -> None:
    digest = hashlib.sha256(b"gravity = 9.81").hexdigest()
    files = {"__init__.py": f"{HEADER}# {digest}\n", "robot.toml": "gravity = 9.81"}
    target = tmp_path / "robot"
    write_module(target, files)
    write_module(target, {**files, "robot.toml": "gravity = 3.7"})
    (target / "robot.toml").write_text("gravity = 1.6")
    with pytest.raises(UsageError, match="generate from it, or move it"):
        write_module(target, files)
    write_module(target, {**files, "robot.toml": "gravity = 1.6"})


def test_a_name_too_long_for_the_disk_is_wrong_use(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="File name too long"):
        write_module(tmp_path / ("a" * 300), FILES)


def test_odd_entries_do_not_get_in_the_way(tmp_path: Path) -> None:
    odd = [".gibbs_codegen_99999999999999999999_x", ".gibbs_codegen_²_x"]
    for name in odd:
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (0, 0))
    (tmp_path / ".gibbs_codegen_999999_x").write_text("a file")
    os.utime(tmp_path / ".gibbs_codegen_999999_x", (0, 0))
    write_module(tmp_path / "robot", FILES)
    assert sorted(os.listdir(tmp_path)) == sorted([*odd, ".gibbs_codegen_999999_x", "robot"])


def test_a_disk_that_fills_up_leaves_nothing_behind(tmp_path: Path) -> None:
    """A limit on the size of files stands in for a full disk."""
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))"
    code = (
        f"{limit}\nimport sys\nfrom gibbs_codegen.cli import main\n"
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


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("delay", [0.05, 0.3, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])
def test_nothing_is_left_behind_when_ended(
    number: signal.Signals, delay: float, tmp_path: Path
) -> None:
    """A signal at any moment leaves a whole module or nothing."""
    process = subprocess.Popen(
        [sys.executable, "-m", "gibbs_codegen", "generate", "quadrotor_2link"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    time.sleep(delay)
    process.send_signal(number)
    process.wait(timeout=30)
    left = visible(tmp_path)
    sources = ["quadrotor_2link.c", "quadrotor_2link.h", "quadrotor_2link_casadi.c"]
    module = ["__init__.py", "numpy_module.py", *sources, "robot.toml"]
    whole = {"generated": ["quadrotor_2link"], "generated/quadrotor_2link": module}
    assert left in ({}, whole)


def test_a_write_in_progress_is_cleaned_up_when_ended(tmp_path: Path) -> None:
    """The signal comes while the files are half written."""
    code = (
        "import sys, time; from pathlib import Path; from gibbs_codegen import write\n"
        "def slow(path, text):\n"
        "    path.write_text('half'); print('writing', flush=True); time.sleep(1)\n"
        "write._write_flushed = slow\n"
        "write.write_module(Path('out') / 'robot', {'__init__.py': ''})"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGTERM)
    process.wait(timeout=30)
    process.stdout.close()
    assert visible(tmp_path) == {}


WRITE_MANY = """
import multiprocessing, sys
from pathlib import Path
from gibbs_codegen.write import check_replaceable, differing_files, write_module

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


def test_many_processes_write_at_once(tmp_path: Path) -> None:
    """Each finds, checks and replaces a whole module, never one that another is replacing."""
    code = WRITE_MANY.replace("{FILES!r}", repr(FILES))
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert os.listdir(tmp_path / "out") == ["robot"]
    assert differing_files(tmp_path / "out" / "robot", FILES) == []


def test_a_lock_that_is_never_let_go_is_passed_by(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(write, "_STALE_SECONDS", 0.05)
    held = os.open(tmp_path, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX)
        write_module(tmp_path / "robot", FILES)
    finally:
        os.close(held)
    assert differing_files(tmp_path / "robot", FILES) == []


def test_waiting_for_another_process_can_be_ended(tmp_path: Path) -> None:
    """And then nothing is written."""
    code = (
        "from pathlib import Path; from gibbs_codegen import write\n"
        "write.check_replaceable = lambda *_: print('ready', flush=True)\n"
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
        assert process.wait(timeout=30) == -signal.SIGTERM
        process.stdout.close()
    finally:
        os.close(held)
    assert os.listdir(tmp_path) == []
