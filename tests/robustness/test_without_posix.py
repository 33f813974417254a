"""The path of pure NumPy needs nothing that only POSIX systems have."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT
from support.command import ENVIRONMENT

# The quadrotor commands too few directions for a law.
OPEN_LOOP = 'control.law="open_loop"'
FLY = ("simulate", "--scenario", "hover", "--set", "duration=0.1", "--set", OPEN_LOOP)
# What imports modules of the standard library that are not the same everywhere.
DIFFERS = re.compile(
    r"^\s*(?:import|from) (?:asyncio|ctypes|errno|fcntl|mmap|msvcrt|multiprocessing|os|pty|pwd|"
    r"resource|select|selectors|shutil|signal|socket|stat|subprocess|sys|tempfile|termios|"
    r"threading|time|tty)\b",
    re.MULTILINE,
)
HIDDEN = ROOT / "tests" / "support" / "without_posix.py"


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `gibbs-codegen` where Python has nothing of POSIX."""
    command = [sys.executable, "-X", "warn_default_encoding", str(HIDDEN), *arguments]
    return subprocess.run(command, cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True)


def succeeds(*arguments: str, cwd: Path) -> str:
    """What a command that ends well says on the side."""
    done = run(*arguments, cwd=cwd)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stderr


@pytest.mark.slow
def test_generate_and_simulate_with_numpy_alone(tmp_path: Path) -> None:
    generate = ("generate", "quadrotor", "--target", "numpy", "--no-verify")
    fly = (*FLY, "quadrotor", "--backend", "numpy")
    # Twice, so that the second replaces what the first has left.
    for command in (generate, generate, fly):
        succeeds(*command, cwd=tmp_path)
    for name in ("flight.csv", "snapshots.png"):
        assert (tmp_path / "flight" / name).stat().st_size


@pytest.mark.slow
def test_numpy_serves_where_nothing_compiles(small: Path, tmp_path: Path) -> None:
    said = succeeds(*FLY, str(small), "--no-figures", cwd=tmp_path)
    assert "runs in NumPy instead of C" in said


@pytest.mark.slow
def test_types_know_nothing_that_windows_lacks(kept: Path) -> None:
    """What typeshed says a platform does not have is refused, unless a test of it comes first.

    What else may be wrong in files that are each looked at alone is no matter here.
    """
    cache = f"--cache-dir={kept.parents[1] / 'mypy'}"
    alone = ["--config-file=", "--follow-imports=skip", "--ignore-missing-imports", cache]
    sources = sorted((ROOT / "gibbs_codegen").rglob("*.py"))
    files = [str(path) for path in sources if DIFFERS.search(path.read_text(encoding="utf-8"))]
    command = [sys.executable, "-m", "mypy", "--platform=win32", *alone, *files]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert "checked" in done.stdout, done.stdout + done.stderr
    assert "Module has no attribute" not in done.stdout, done.stdout
