"""A small disk of a test's own, which fills up as a real one does."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from conftest import ROOT

from support.tools import HANGING

_MOUNT = 'mount -t tmpfs -o size="$1"k none disk && shift && '


@dataclass(frozen=True)
class Done:
    """What a script left: its exit code, its words, and the paths on the disk."""

    code: int
    out: str
    error: str
    left: list[str]


def on_small_disk(folder: Path, kibibytes: int, script: str, **environment: str) -> Done:
    """Run a script of bash in `folder`, whose folder `disk` is a disk of that size.

    `$PYTHON` runs Python. The disk is in a mount namespace of the script's own, so that nobody else
    sees it and it goes when the script ends; where the system allows none the test is skipped.
    """
    if shutil.which("unshare") is None:
        pytest.skip("needs unshare")
    (folder / "disk").mkdir()
    enter = ["unshare", "--map-root-user", "--mount", "bash", "-c"]
    if subprocess.run([*enter, f"{_MOUNT}true", "-", "4"], cwd=folder, check=False).returncode:
        pytest.skip("the system allows no mounts of one's own")
    listed = f"{{ {script}\n}}; code=$?; (cd disk; find . -mindepth 1 | sort) > left; exit $code"
    done = subprocess.run(
        [*enter, _MOUNT + listed, "-", str(kibibytes)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHON": sys.executable, **environment},
        capture_output=True,
        text=True,
        timeout=HANGING,
        check=False,
    )
    left = (folder / "left").read_text().splitlines()
    return Done(done.returncode, done.stdout, done.stderr, left)
