"""What is said while C compiles, which takes a minute where a module has all derivatives."""

from __future__ import annotations

import io
import logging
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType

import pytest
from rich.console import Console
from rich.file_proxy import FileProxy

from gibbs_codegen.runtime import c_library
from gibbs_codegen.runtime.c_library import Compiler, CompilerError, compiled_library

NAME = "quadrotor_2link"


class Stream(io.StringIO):
    """Standard error, which is a terminal or not."""

    def __init__(self, terminal: bool) -> None:
        super().__init__()
        self.terminal = terminal

    def isatty(self) -> bool:
        """Whether it is one."""
        return self.terminal


class Slow(Compiler):
    """A compiler that takes a while, and writes no library."""

    def library(self, sources: Sequence[Path], output: Path, extra: Sequence[str] = ()) -> None:
        """Make what is no library."""
        time.sleep(0.2)
        output.write_bytes(b"")


@pytest.mark.parametrize("proxied", [False, True])
@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("patience", [0.01, 60.0])
def test_what_takes_long_to_compile_is_told_in_one_line(
    proxied: bool,
    terminal: bool,
    patience: float,
    shipped: Callable[[str], ModuleType],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(c_library, "_PATIENCE", patience)
    stream: object = Stream(terminal)
    if proxied:  # As commands have it while they draw a bar.
        stream = FileProxy(Console(), stream)
    monkeypatch.setattr(sys, "stderr", stream)
    folder = Path(shipped(NAME).__file__ or "").parent
    with caplog.at_level(logging.INFO, "gibbs_codegen"):
        for _ in range(2):
            compiled_library(folder, NAME, Slow(("cc",), "slow"))
    told = f"{NAME}: compiling {NAME}.c, _rows.c; the library is kept for the "
    level = logging.WARNING if terminal else logging.INFO  # Python shows warnings by default.
    said = [(record.levelno, record.getMessage()) for record in caplog.records]
    assert said == ([(level, f"{told}next time")] if patience < 1.0 else [])


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
