"""The C compiler of the machine: finding it, naming it, and making shared libraries with it."""

from __future__ import annotations

import functools
import hashlib
import itertools
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from gibbs_codegen.errors import cause_of

# Sixty-four links take minutes.
_TIMEOUT_SECONDS = 300.0
_FLAGS = ("-O3", "-ffp-contract=fast", "-fPIC", "-shared")
# A program that has a function of the same name must not get the calls within a library.
_LINKER_FLAGS = ("-Wl,-Bsymbolic",) if sys.platform.startswith("linux") else ()
_NATIVE = "-march=native"


class CompilerError(Exception):
    """No library can be made; the message says why in a line."""


@dataclass(frozen=True)
class Compiler:
    """A compiler's command, of which the user's own flags come last, and what it calls itself."""

    command: tuple[str, ...]
    version: str

    @property
    def identity(self) -> str:
        """Text that differs where compiler, flags, processor or C library differ."""
        system = (platform.system(), platform.machine(), *platform.libc_ver(), _processor())
        return "\n".join([*self.command, self.version, *_FLAGS, *_LINKER_FLAGS, *system])

    def library(self, sources: Sequence[Path], output: Path, extra: Sequence[str] = ()) -> None:
        """Make a shared library of C files; `extra` flags come after the compiler's.

        Raises `CompilerError` if it fails or hangs.
        """
        # Without knowing the processor a library in the cache might meet another one.
        if _processor():
            with suppress(CompilerError):
                self._make(sources, output, [*_FLAGS, _NATIVE, *extra])
                return
        self._make(sources, output, [*_FLAGS, *extra])

    def _make(self, sources: Sequence[Path], output: Path, flags: Sequence[str]) -> None:
        """Make a shared library; `flags` are all but the user's own. Raises `CompilerError`."""
        # Words before the first flag may be a launcher and its compiler, such as `ccache gcc`.
        programs = list(itertools.takewhile(lambda word: not word.startswith("-"), self.command))
        own = self.command[len(programs) :]
        files = [*map(str, sources), "-o", str(output), *_LINKER_FLAGS, "-lm"]
        code, said = _run([*programs, *flags, *own, *files], _TIMEOUT_SECONDS, output.parent)
        name = " ".join(programs)
        if code is None:
            raise CompilerError(f"{name} did not finish in {_TIMEOUT_SECONDS:.0f} s")
        if code != 0 or not output.is_file():
            lines = [line.strip() for line in said.splitlines() if line.strip()]
            telling = [x for x in lines if "error" in x.lower() and not x.startswith("collect2")]
            reason = [*telling, *lines, f"exit code {code}"][0]
            raise CompilerError(f"{name} failed: {reason[:300]}")


@functools.cache
def find_compiler(chosen: str | None) -> Compiler:
    """The compiler that the user has chosen, or else cc, gcc or clang of the search path.

    `chosen` is the value of CC: maybe a launcher, a compiler, and flags after it, as `ccache gcc
    -O2`. Raises `CompilerError` if there is none.
    """
    if sys.platform == "win32":
        raise CompilerError("nothing is compiled on Windows, whose compilers take other flags")
    try:
        commands = [shlex.split(chosen)] if chosen else [["cc"], ["gcc"], ["clang"]]
    except ValueError as error:
        raise CompilerError(f"CC={chosen}: {error}") from None
    for command in commands:
        path = shutil.which(command[0]) if command else None
        if path:
            whole = (os.path.abspath(path), *command[1:])
            return Compiler(whole, _version(whole))
    raise CompilerError(f"CC={chosen}: no such compiler" if chosen else "no C compiler found")


def _version(command: Sequence[str]) -> str:
    code, said = _run([*command, "--version"], 20.0, Path.cwd())
    if code is None:
        raise CompilerError(f"{command[0]} does not answer --version")
    return said


def _run(command: Sequence[str], seconds: float, folder: Path) -> tuple[int | None, str]:
    """Exit code and output of a command, run to its end, or ended after so many seconds.

    The code is None if it hung. Raises `CompilerError` if it cannot be started.
    """
    try:
        process = subprocess.Popen(  # noqa: S603 - a compiler that the user has chosen
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            cwd=folder,
            env={**os.environ, "LC_ALL": "C"},
            text=True,
            errors="replace",
            start_new_session=True,
        )
    except OSError as error:
        raise CompilerError(f"{command[0]}: {cause_of(error)}") from None
    try:
        said, _ = process.communicate(timeout=seconds)
    except BaseException as error:
        if sys.platform != "win32":  # There `find_compiler` finds none.
            with suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        if isinstance(error, subprocess.TimeoutExpired):
            return None, ""
        raise
    return process.returncode, said


@functools.cache
def _processor() -> str:
    """What tells this processor's instructions from another's; empty where that is not known."""
    if not sys.platform.startswith("linux") or platform.machine() not in ("x86_64", "aarch64"):
        return ""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    keys = ("flags", "Features", "model", "cpu family", "CPU part", "CPU implementer")
    lines = {line for line in text.splitlines() if line.split(":")[0].strip() in keys}
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()
