"""Data flows one way: the contracts of pyproject.toml, and what they cannot say."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT


def test_the_contracts_of_imports_are_kept() -> None:
    """In a process of its own, since it silences the loggers of the one that it runs in."""
    lint = [
        sys.executable,
        "-c",
        "from importlinter.cli import lint_imports_command as lint; lint()",
    ]
    done = subprocess.run(
        [*lint, "--config", "pyproject.toml", "--no-cache"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_only_the_command_line_exits() -> None:
    for path in (ROOT / "gibbs_codegen").rglob("*.py"):
        if path.parent.name != "cli" and path.name != "__main__.py":
            assert "sys.exit" not in path.read_text(encoding="utf-8"), path


@pytest.mark.slow
def test_flying_imports_no_sympy(tmp_path: Path) -> None:
    run = (
        "import pathlib, sys; "
        "from gibbs_codegen import load, read_scenario, simulate, write_results; "
        "scenario = read_scenario('paper', {'duration': 0.02}); "
        "robots = [load('generated/hexarotor_3link', b) for b in ('numpy', 'c')]; "
        "flights = [simulate(robot, scenario) for robot in robots]; "
        f"write_results(flights[1], {str(tmp_path)!r}, figures=False); "
        "assert not {'matplotlib', 'scipy.interpolate'} & {*sys.modules}; "
        "from gibbs_codegen.flight.figures.flight import write_figures; "
        f"assert write_figures(flights[1], pathlib.Path({str(tmp_path)!r})); "
        "assert 'sympy' not in sys.modules and 'jinja2' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", run], check=True, cwd=ROOT)
