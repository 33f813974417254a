"""What is said while C compiles, which takes a minute where a module has all derivatives."""

from __future__ import annotations

import itertools
import logging
import os
import re
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from support.tools import missing

from gibbs_codegen.cli import terminal
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.runtime import c_library
from gibbs_codegen.runtime.c_library import (
    Compiler,
    CompilerError,
    ModuleLibrary,
    announced,
    compiled_library,
    seconds_waited,
)

NAME = "quadrotor_2link"
HOLD = {"path": {"kind": "fixed", "position": [0, 0, 2]}}


class Slow(Compiler):
    """A compiler that takes a while, and writes no library."""

    def library(self, sources: Sequence[Path], output: Path, extra: Sequence[str] = ()) -> None:
        """Make what is no library."""
        time.sleep(0.2)
        output.write_bytes(b"")


@pytest.mark.parametrize("patience", [0.01, 60.0])
def test_what_takes_long_to_compile_is_told_in_one_line(
    patience: float,
    shipped: Callable[[str], ModuleType],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "cache"))
    folder = Path(shipped(NAME).__file__ or "").parent
    monkeypatch.setattr(c_library, "_PATIENCE", patience)
    monkeypatch.setattr(c_library, "_LOGGED", set())
    caplog.clear()  # The module may have been derived just now.
    begin = time.perf_counter()
    with caplog.at_level(logging.INFO, "gibbs_codegen"):
        for _ in range(2):
            compiled_library(folder, NAME, Slow(("cc",), "slow"))
        waited = seconds_waited(begin)
        with ThreadPoolExecutor() as pool:  # What is compiled beside this thread keeps nobody.
            pool.submit(compiled_library, folder, NAME, Slow(("cc",), "beside")).result()
    told = f"{NAME}: compiling all its functions in C; the cache keeps the result (about … s)"
    # Python shows warnings by default, in scripts and pipes too.
    # How long it takes goes by how much is emitted.
    texts = [re.sub(r"about \d+ s", "about … s", text) for text in caplog.messages]
    said = [(record.levelno, text) for record, text in zip(caplog.records, texts, strict=True)]
    assert said == ([(logging.WARNING, told)] if patience < 1.0 else [])
    assert 0.2 <= waited <= time.perf_counter() - begin - 0.2
    assert seconds_waited(begin) == waited


@pytest.mark.parametrize(
    "flies", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["calls", "flight"]
)
def test_what_flights_need_is_compiled_side_by_side(
    flies: bool, fast: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is compiled, or looked for, when functions are called that were built."""
    module = fast("quadrotor_arm_2link")
    if module.backend != "c" or not hasattr(module, "compiled"):
        missing("nothing compiles")
    with module.compiled.built():
        pass
    monkeypatch.setattr(c_library, "compiled_files", None)
    if flies:  # What flies is compiled elsewhere.
        simulate(module, {"name": "still", "duration": 0.1, "base": HOLD})
    q, v = np.zeros((2, len(module.COORDINATES))), np.zeros((2, len(module.VELOCITIES)))
    for name, states in {"mass_matrix": [q[0]], "positions": [q], "kinetic_energy": [q, v]}.items():
        expected = getattr(module.in_numpy, name)(*states)
        assert getattr(module, name)(*states) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_time_to_plan_beside_a_compiler_is_not_waited(
    shipped: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(c_library, "compiled_files", lambda *_, **__: time.sleep(0.2))
    monkeypatch.setattr(c_library, "opened", lambda _: None)
    planned = threading.Event()

    def ahead() -> None:
        with announced("a flight"):
            planned.wait()
            time.sleep(0.2)

    module = shipped(NAME)
    library = ModuleLibrary(Path(module.__path__[0]), module, Compiler(("cc",), ""))
    begin = time.perf_counter()
    with library.built(lambda: ahead):
        time.sleep(0.2)
        planned.set()
    assert 0.4 <= seconds_waited(begin) <= time.perf_counter() - begin - 0.2


def test_ctrl_c_ends_compilers_that_start_after_it(
    shipped: Callable[[str], ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    codes, calls = list[int | None](), itertools.count()

    def compile_late(*_: object, **__: object) -> Path:
        time.sleep(0.2)
        if next(calls) == 0:
            os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.2)
        codes.append(c_library._run(["sleep", "600"], 600.0, tmp_path)[0])
        raise CompilerError("ended")

    monkeypatch.setattr(c_library, "compiled_files", compile_late)
    module = shipped(NAME)
    library = ModuleLibrary(Path(module.__path__[0]), module, Compiler(("cc",), ""))
    # Shells start what runs in the background with SIGINT ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), library.built():
            pass
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(codes) > 1
    assert set(codes) == {-signal.SIGKILL}


def test_a_compiler_that_is_ended_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, program = tmp_path / "temporary", tmp_path / "cc"
    folder.mkdir()
    program.write_text("#!/bin/sh\necho half > $TMPDIR/cc7.s\nexec sleep 60\n", encoding="utf-8")
    program.chmod(0o700)
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.setattr(c_library, "_TIMEOUT_SECONDS", 0.3)
    with pytest.raises(CompilerError, match="did not finish"):
        Compiler((str(program),), "").portable([], tmp_path / "library.so")
    assert not list(folder.iterdir())


def test_what_takes_long_in_a_pipe_is_told_in_one_line(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(c_library, "_PATIENCE", 0.01)
    monkeypatch.setattr(c_library, "_LOGGED", set())
    with terminal.progress() as progress:
        progress("a step")
        time.sleep(0.2)
    assert caplog.messages == ["deriving the equations of the robot"]
