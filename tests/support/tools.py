"""Programs that tests run: compilers, emulators, symbol tables."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest


def tool(name: str) -> str:
    """Path of a tool; without it the test is skipped or, where tools are required, fails."""
    path = shutil.which(name)
    return path if path else missing(f"{name} is not installed")


def missing(what: str) -> Any:
    """Skip the test, or all tests of a module; where tools are required, fail."""
    if os.environ.get("GIBBS_CODEGEN_REQUIRE_TOOLS") == "1":
        pytest.fail(f"{what}, but GIBBS_CODEGEN_REQUIRE_TOOLS=1", pytrace=False)
    pytest.skip(what, allow_module_level=True)


def run(command: Sequence[str | Path], timeout: float = 300.0, **environment: str) -> str:
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
