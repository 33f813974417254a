"""The C compiler of the machine: finding it, naming it, and making shared libraries with it."""

from __future__ import annotations

import functools
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_TIMEOUT_SECONDS = 600.0
_FLAGS = ("-O3", "-ffp-contract=fast", "-fPIC", "-shared")


class CompilerError(Exception):
    """No library can be made; the message says why in a line."""


@dataclass(frozen=True)
class Compiler:
    """A compiler's command, and what it calls itself."""

    command: tuple[str, ...]
    version: str

    @property
    def identity(self) -> str:
        """Text that differs where the compiler, its flags or the processor differ."""
        return "\n".join(
            [*self.command, self.version, *_flags(), platform.platform(), _processor()]
        )

    def library(self, sources: Sequence[Path], output: Path, extra: Sequence[str] = ()) -> None:
        """Make a shared library. Raises `CompilerError` where the compiler fails or hangs."""
        command = [*self.command, *_flags(), *extra, *map(str, sources), "-o", str(output), "-lm"]
        try:
            done = subprocess.run(  # noqa: S603 - a compiler that the user has chosen
                command,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=_TIMEOUT_SECONDS,
                stdin=subprocess.DEVNULL,
                cwd=output.parent,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise CompilerError(
                f"{self.command[0]} did not finish in {_TIMEOUT_SECONDS:.0f} s"
            ) from None
        except OSError as error:
            raise CompilerError(f"{self.command[0]}: {error.strerror}") from None
        if done.returncode != 0 or not output.is_file():
            said = next(
                (line for line in done.stderr.splitlines() if "error" in line.lower()),
                f"exit code {done.returncode}",
            )
            raise CompilerError(f"{self.command[0]} failed: {said.strip()[:300]}")


@functools.cache
def find_compiler(chosen: str | None) -> Compiler:
    """The compiler `chosen` (the value of CC), or else cc, gcc or clang of the search path.

    Raises `CompilerError` where there is none.
    """
    if os.name == "nt":
        raise CompilerError("compiling on Windows is not supported yet")
    commands = [shlex.split(chosen)] if chosen else [["cc"], ["gcc"], ["clang"]]
    for command in commands:
        path = shutil.which(command[0]) if command else None
        if path:
            return Compiler((path, *command[1:]), _version(path))
    raise CompilerError(f"CC={chosen}: no such compiler" if chosen else "no C compiler found")


def _version(path: str) -> str:
    try:
        done = subprocess.run(  # noqa: S603 - a compiler that the user has chosen
            [path, "--version"],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=20,
            stdin=subprocess.DEVNULL,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        raise CompilerError(f"{path} does not answer --version") from None
    return done.stdout


def _flags() -> tuple[str, ...]:
    # Without knowing the processor a library in the cache might meet another one.
    return (*_FLAGS, "-march=native") if _processor() else _FLAGS


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
