"""`gibbs-codegen verify`, and the check that `generate` makes, as a user runs them."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import ROOT

from gibbs_codegen.cli.app import main
from gibbs_codegen.cli.verify import summary
from gibbs_codegen.targets.printers import InfixPrinter
from gibbs_codegen.verification.c_program import PARTIAL, SINGLE_PRECISION
from gibbs_codegen.verification.comparison import Comparison, failure_text
from gibbs_codegen.verification.derivatives import OTHER_FUNCTIONS, ZEROS
from gibbs_codegen.verification.invariants import ONE_BY_ONE, OTHER_BACK_END
from gibbs_codegen.verification.verify import ONE_STATE, Verification

pytestmark = pytest.mark.usefixtures("derived_once")

COMMAND = [sys.executable, "-m", "gibbs_codegen"]


@pytest.mark.slow
def test_verify_prints_a_line_for_each_formulation_or_for_each_comparison(
    small: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["verify", str(small), "--states", "2", "--backend", "numpy"]
    assert main(command) == 0
    out, err = capsys.readouterr()
    assert err == ""
    for words in ("Newton–Euler, any angles ", "Lagrange ", "Pinocchio ", "others "):
        assert words in out
    count = re.search(r": all (\d+) comparisons within their limits, \d+ s\n", out)
    assert count is not None
    lines = out.splitlines()
    assert max(map(len, lines[:-1])) <= 80
    assert len(lines) < 20
    results = [int(line[slice(*re.search("results", lines[0]).span())]) for line in lines[1:-2]]
    assert sum(results) == int(count[1])
    assert main([*command, "--rows"]) == 0
    rows = [x for x in capsys.readouterr().out.splitlines() if x.startswith("numpy: ")]
    assert len(rows) == int(count[1])
    assert "numpy: forward_dynamics against Lagrange: error " in "\n".join(rows)


def test_of_each_formulation_what_is_nearest_to_its_limit_is_shown() -> None:
    """Not what is largest; and what failed, with the digits that decide."""
    rows = [Comparison(what, "single precision", 4, 3.0e-6, 3.8147e-6) for what in "abcdefgh"]
    rows[2] = replace(rows[2], error=2.0e-3, limit=1.0)
    rows += [Comparison("a", "itself", 4, 0.0, 0.0), Comparison("b", "itself", 5, 0.0, 0.0)]
    found = Verification("robot", 0, {"c": rows})
    assert [line.split() for line in summary(found)[1:-1]] == [
        ["single", "precision", "8", "4", "3.0e-06", "3.8e-06"],
        ["others", "2", "5", "0.0e+00", "equal"],
    ]
    rows[4] = replace(rows[4], error=3.8247e-6)
    assert summary(found)[1].split()[4:] == ["3.82e-06", "3.81e-06", "FAILS"]
    assert failure_text(rows[4]).endswith("error 3.82e-06, limit 3.81e-06")


def test_lines_fit_a_terminal_where_everything_fails() -> None:
    """With all that functions and derivatives are compared with by names that the code has."""
    found = [ONE_BY_ONE, OTHER_BACK_END, OTHER_FUNCTIONS, ZEROS]
    against = [ONE_STATE, PARTIAL, SINGLE_PRECISION, *(f"{x}, other parameters" for x in found)]
    rows = [Comparison("a", x, 100_000, 3.8247e-6, 3.8147e-6) for x in against for _ in range(9)]
    lines = summary(Verification("robot", 0, {"c": rows}))
    assert sum(line.endswith("  FAILS") for line in lines) == len(against)
    assert max(map(len, lines)) <= 80


def test_verify_as_json(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = small
    arguments = ["verify", str(folder), "--states", "2", "--backend", "numpy", "--json"]
    assert main(arguments) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["passed"] is True
    assert data["failures"] == 0
    rows = data["backends"]["numpy"]
    assert len(rows) == data["comparisons"]
    row = next(r for r in rows if (r["what"], r["against"]) == ("residual", "Newton–Euler"))
    assert row["states"] == 2
    assert 0 <= row["error"] <= row["limit"] == 1e-10


@pytest.mark.slow
def test_an_altered_module_fails_with_what_is_wrong(
    small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "quadrotor_2link"
    shutil.copytree(small, folder)
    path = folder / "numpy_module.py"
    text = path.read_text(encoding="utf-8")
    altered, count = re.subn(r"= gravity \* k\d+\n", "= gravity * gravity\n", text, count=1)
    assert count == 1
    path.write_text(altered, encoding="utf-8")
    assert main(["verify", str(folder), "--states", "2", "--backend", "numpy"]) == 1
    out, err = capsys.readouterr()
    assert "FAILS" in out
    assert "comparisons failed:" in err
    assert "numpy: gravity_forces against Newton–Euler: error " in err
    assert main(["verify", str(folder), "--states", "2", "--backend", "numpy", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["passed"] is False


@pytest.mark.slow
def test_a_robot_file_is_verified_without_leaving_anything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "mine.toml"]) == 0
    assert main(["verify", "mine.toml", "--states", "2", "--backend", "numpy"]) == 0
    assert "(the module was generated for this check and is not kept)" in capsys.readouterr().out
    assert os.listdir(tmp_path) == ["mine.toml"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing_here"], "no such robot file"),
        pytest.param(
            ["quadrotor_2link", "--states", "0"],
            "states: from 1 to 10000, not 0",
            marks=pytest.mark.slow,
        ),
        (["quadrotor_2link", "--seed", "-1"], "seed: "),
        (["."], "no generated module there"),
        (["."], "make one with: gibbs-codegen generate ROBOT.toml"),
        (["nothing_here"], "nor is there a module of that name in generated/"),
    ],
)
def test_wrong_use(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["verify", *arguments]) == 2
    assert message in capsys.readouterr().err


def test_a_back_end_that_was_asked_for_and_is_not_there_is_a_failure(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CC", str(tmp_path / "none"))
    folder = str(small)
    assert main(["verify", folder, "--states", "1", "--backend", "c"]) == 1
    assert "back end c was asked for: " in capsys.readouterr().err
    assert main(["verify", folder, "--states", "1"]) == 0
    assert "back end c: not compared: " in capsys.readouterr().out


def test_what_is_left_of_a_module_is_not_taken_for_a_robot(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A broken module of a name that ships too is not replaced by one made for the occasion."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(small, "generated/quadrotor_2link")
    Path("generated/quadrotor_2link/numpy_module.py").unlink()
    assert main(["verify", "quadrotor_2link"]) == 2
    lacks = "lacks numpy_module.py, which loading needs; make it with: gibbs-codegen generate "
    assert lacks + "generated/quadrotor_2link --out generated" in capsys.readouterr().err
    os.rename("generated", "my modules")
    assert main(["verify", "my modules/quadrotor_2link"]) == 2
    proposed = "generate 'my modules/quadrotor_2link' --out 'my modules'"
    assert proposed in capsys.readouterr().err


@pytest.mark.slow
def test_verifying_a_module_imports_no_sympy() -> None:
    run = (
        "import sys; from gibbs_codegen.cli.app import main; "
        "code = main(['verify', 'hexarotor_3link', '--states', '1', '--backend', 'numpy']); "
        "assert 'sympy' not in sys.modules; sys.exit(code)"
    )
    subprocess.run([sys.executable, "-c", run], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)


@pytest.fixture
def wrong_printer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A printer that takes every two for a three."""
    right = InfixPrinter.number

    def wrong(self: InfixPrinter, value: float) -> str:
        return right(self, 3.0 if value == 2.0 else value)

    monkeypatch.setattr(InfixPrinter, "number", wrong)


@pytest.mark.parametrize("target", [[], ["--target", "numpy"], ["--target", "c"]])
def test_generate_refuses_to_write_what_is_wrong(
    target: list[str], wrong_printer: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["generate", "quadrotor_2link", "--out", str(tmp_path / "out"), *target]
    assert main(arguments) == 1
    err = capsys.readouterr().err
    assert "nothing was written" in err
    assert "against Newton–Euler: error" in err
    assert os.listdir(tmp_path) == []
    assert main([*arguments, "--no-verify"]) == 0
    assert os.listdir(tmp_path / "out") == ["quadrotor_2link"]
