"""The command line: in this process, where that is all the same, or in a process of its own."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import subprocess
import sys
from pathlib import Path
from unittest import mock

from conftest import ROOT

from gibbs_codegen.cli.app import main
from gibbs_codegen.runtime import c_library
from support.tools import HANGING

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "120"}


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """What `gibbs-codegen` does in a folder, told as if it had run in a process of its own.

    It runs in this one, which has SymPy and all else imported already.
    """
    out, err = io.StringIO(), io.StringIO()
    # What Python does with warnings that no one takes, which pytest does.
    shown, log = logging.StreamHandler(err), logging.getLogger("gibbs_codegen")
    shown.setLevel(logging.WARNING)
    log.addHandler(shown)
    with (
        contextlib.chdir(cwd),
        mock.patch.dict(os.environ, COLUMNS=ENVIRONMENT["COLUMNS"]),
        mock.patch.object(c_library, "_PATIENCE", 600.0),  # However busy the machine is.
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            code = main(arguments)
        except SystemExit as ended:
            code = int(ended.code or 0)
        finally:
            log.removeHandler(shown)
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def run_alone(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run `gibbs-codegen` in a folder, in a process of its own."""
    command = [sys.executable, "-m", "gibbs_codegen", *arguments]
    return subprocess.run(
        command, cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True, timeout=HANGING
    )
