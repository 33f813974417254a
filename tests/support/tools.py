"""Programs that tests run: compilers, emulators, symbol tables."""

from __future__ import annotations

import functools
import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

# A process that takes longer than this hangs, however busy the machine is, s.
HANGING = 1800.0


def tool(name: str) -> str:
    """Path of a tool; without it the test is skipped or, where tools are required, fails."""
    path = shutil.which(name)
    return path if path else missing(f"{name} is not installed")


def missing(what: str) -> Any:
    """Skip the test, or all tests of a module; where tools are required, fail."""
    if os.environ.get("GIBBS_CODEGEN_REQUIRE_TOOLS") == "1":
        pytest.fail(f"{what}, but GIBBS_CODEGEN_REQUIRE_TOOLS=1", pytrace=False)
    pytest.skip(what, allow_module_level=True)


def compiler_to_run() -> str:
    """A value of CC by which C takes twice as long to compile, and runs several times as fast."""
    return f"{os.environ.get('CC', 'cc')} -O1"


def run(command: Sequence[str | Path], timeout: float = HANGING, **environment: str) -> str:
    """What a command prints; a test that runs one that fails or hangs says so in its words."""
    try:
        done = subprocess.run(
            [str(word) for word in command],
            capture_output=True,
            text=True,
            timeout=timeout,
            stdin=subprocess.DEVNULL,
            env=os.environ | environment,
            check=False,
        )
    except subprocess.TimeoutExpired:
        pytest.fail(f"{Path(command[0]).name} did not end within {timeout:.0f} s", pytrace=False)
    if done.returncode != 0:
        said = f"{done.stderr[:4000]}\n{done.stdout[-300:]}"
        pytest.fail(f"{Path(command[0]).name} exits {done.returncode}: {said}", pytrace=False)
    return done.stdout


def compiled(command: Sequence[str | Path], output: Path) -> Path:
    """A file that a compiler makes, every warning being an error where the command says so.

    What an earlier run has had compiled of the same text by the same command is taken from the
    folder that `conftest.py` names.
    """
    whole = [*map(str, command), "-o", str(output)]
    key = _digest([str(word) for word in command])
    if key is None or "-fsyntax-only" in command:
        run(whole)
        return output
    kept = Path(os.environ[KEPT_OBJECTS]) / key
    if kept.exists():
        kept.touch()
        shutil.copy(kept, output)
        return output
    run(whole)
    with tempfile.TemporaryDirectory(dir=kept.parent) as folder:
        # Another process may be at the same.
        os.replace(shutil.copy(output, folder), kept)
    return output


KEPT_OBJECTS = "TESTS_KEEP_OBJECTS_IN"


def _digest(command: Sequence[str]) -> str | None:
    """Of the compiler, its options, and all text and object files that go into what it makes.

    Text is taken as it is written: the preprocessor warns of what it leaves out, too. None where
    that is not all: a compiler may write other files beside it.
    """
    if KEPT_OBJECTS not in os.environ or "-fstack-usage" in command:
        return None
    objects = [word for word in command if word.endswith((".o", ".so", ".a"))]
    text = [w for w in command[1:] if w not in (*objects, "-c", "-shared") and w[:2] != "-l"]
    done = subprocess.run(
        [command[0], *text, "-M"],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    if done.returncode != 0:
        return None
    # Each source has a line of make: a target, and all files that it includes.
    lines = done.stdout.replace("\\\n", " ").splitlines()
    words = [word for line in lines for word in re.findall(r"(?:\\.|\S)+", line)[1:]]
    included = [Path(re.sub(r"\\(.)", r"\1", word)) for word in words]
    if not all(path.is_file() for path in included):
        return None
    named = [word for word in command[1:] if word[:2] != "-I" and not Path(word).is_file()]
    digest = hashlib.sha256("\0".join([_version(command[0]), *named]).encode())
    for path in (*included, *map(Path, objects)):
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


@functools.cache
def _version(compiler: str) -> str:
    return compiler + run([compiler, "--version"])
