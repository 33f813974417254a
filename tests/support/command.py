"""The command line in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from conftest import ROOT

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "120"}


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `gibbs-codegen` in a folder."""
    command = [sys.executable, "-m", "gibbs_codegen", *arguments]
    return subprocess.run(
        command, cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True, timeout=120
    )
