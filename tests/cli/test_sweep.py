"""`gibbs-codegen sweep` as a user runs it."""

from __future__ import annotations

import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from support.command import ENVIRONMENT, run
from support.synthetic_study import LAG, MASS, synthetic_study
from support.tools import HANGING

from gibbs_codegen.cli.sweep import print_study, varied
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.distributions import log_uniform, normal, scaled, together, uniform
from gibbs_codegen.flight.record.flight import read_flight
from gibbs_codegen.flight.sweeps.chunks import FILE
from gibbs_codegen.flight.sweeps.study import read_study

SHORT = ["--set", "duration=0.05", "--set", "integration.method=rk4"]


@pytest.fixture(scope="module")
def workplace(
    shipped: Callable[[str], ModuleType], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A folder whose generated/ holds the paper's machine."""
    folder = tmp_path_factory.mktemp("workplace")
    module = Path(shipped("hexarotor_3link").__file__ or "").parent
    shutil.copytree(module, folder / "generated" / "hexarotor_3link")
    return folder


@pytest.fixture(autouse=True)
def _compiled(fast: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch) -> None:
    """Before processes want it; and nothing says how far it is, which depends on the machine."""
    fast("hexarotor_3link")
    monkeypatch.setattr("gibbs_codegen.flight.sweeps.sweep._LOG_SECONDS", 3600.0)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0,0.01", [0, 0.01]),
        ("5", [5]),
        ("[0.2, 0, 0],[0, 0, 0.1]", [[0.2, 0, 0], [0, 0, 0.1]]),
        ("true,false", [True, False]),
        ("tracking, open_loop", ["tracking", "open_loop"]),
        ('"a,b",c', ["a,b", "c"]),
        ("'a,b' ,,[0, x],c", ["a,b", "", "[0, x]", "c"]),
        (".9,1.", [0.9, 1.0]),
        ("scaled(.9,1.1)", scaled(0.9, 1.1)),
        ("uniform(0.8, 1.2)", uniform(0.8, 1.2)),
        ("normal(1,1e-2)", normal(1, 0.01)),
        (" log_uniform( 1 , 10 ) ", log_uniform(1, 10)),
        ("scaled(0.8,1.2)", scaled(0.8, 1.2)),
        ("scaled([0.8, 1, 1.2])", scaled([0.8, 1, 1.2])),
        ("together(scaled(normal(1, 0.1)))", together(scaled(normal(1, 0.1)))),
    ],
)
def test_words_mean_what_python_writes(text: str, values: object) -> None:
    assert varied(text, "key") == values


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("unifrom(1,2)", "--vary key=unifrom.1,2.: unifrom is not one of uniform, normal"),
        ("uniform(1)", "uniform takes two numbers"),
        ("uniform(1,2,3)", "uniform takes two numbers"),
        ("normal(a,0)", "two finite numbers are needed"),
        ("uniform(2,1)", "must be below the second"),
        ("scaled(1,b)", "scaled takes two numbers"),
        ("scaled(" * 5000 + ")" * 5000, "too many nested brackets"),
        ("__import__(os)", "__import__ is not one of"),
    ],
)
def test_words_that_mean_nothing_are_told(text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        varied(text, "key")


@pytest.mark.slow
def test_the_worst_flight_flown_again_gives_the_same(workplace: Path) -> None:
    varying = ["--vary", "plant.*mass_per_length=scaled(0.8,1.2)", "--vary"]
    varying += ["motors.time_constant=0,0.01", "--set", "start.offset=[0.1,0,0]"]
    measures = ["--measure", "tip=tip_error.max", "--measure", "late [m]=centre_error.last"]
    words = ["sweep", "hexarotor_3link", "--scenario", "hover", *varying, *SHORT, *measures]
    done = run(*words, "--samples", "3", "--workers", "1", "--out", "s", cwd=workplace)
    assert (done.returncode, done.stderr) == (0, "")
    assert "6 flights to the end, 0 ended early, 0 failed" in done.stdout
    names = {path.name for path in (workplace / "s").iterdir()}
    assert {"table.csv", "table.npy", "distributions.png", "worst_cases.png"} <= names
    study = read_study(workplace / "s")
    for measure, of_flight in (("tip", "tip_error"), ("late [m]", "centre_error")):
        worst = study.worst(measure, 1)[0]
        assert f"{measure}: case {worst.case} ({worst.value:.4g})" in done.stdout
        assert worst.command in done.stdout
        program, *again = shlex.split(worst.command)
        assert program == "gibbs-codegen"
        again_run = run(*again, "--out", "f", "--no-figures", cwd=workplace)
        assert again_run.returncode == 0, again_run.stderr
        series = getattr(read_flight(workplace / "f" / "flight.npz"), of_flight)
        value = series.max() if measure == "tip" else series[-1]
        assert value == pytest.approx(worst.value, rel=1e-9)
        shutil.rmtree(workplace / "f")


@pytest.mark.slow
def test_flights_that_end_early_and_fail_are_told(workplace: Path) -> None:
    options = ["--scenario", "hover", *SHORT, "--vary"]
    options += ["plant.link3_mass_per_length=1,-1000", "--vary"]
    options += ["start.offset=[0,0,0],[0,0,30]", "--no-figures", "--workers", "1", "--out", "t"]
    done = run("sweep", "hexarotor_3link", *options, cwd=workplace)
    assert done.returncode == 0, done.stderr
    assert "1 flights to the end, 1 ended early, 2 failed" in done.stdout
    assert "ended early, 1, as case 1: at t = " in done.stdout
    assert "failed, 2, as case 2: " in done.stdout
    assert "plant.link3_mass_per_length=-1000" in done.stdout


def test_reasons_are_told_by_kind_the_most_frequent_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = synthetic_study(tmp_path, broken=False)
    for place, letters in enumerate(["a", "bb", "ccc", "dddd", "eeeee", "ffffff", "ggggggg"]):
        rows = range(10 * place, 10 * place + len(letters))
        study.table["stopped"][rows] = [f"at t = {row}.5 s: {letters}" for row in rows]
    print_study(study, 1.5)
    told = capsys.readouterr().out
    assert "600 cases in 1.5 s: 572 flights to the end, 28 ended early, 0 failed" in told
    kinds = [line for line in told.splitlines() if line.startswith("  ended early")]
    assert kinds[0] == "  ended early, 7, as case 60: at t = 60.5 s: ggggggg"
    assert kinds[4] == "  ended early, 3, as case 20: at t = 20.5 s: ccc"
    assert kinds[5:] == ["  ended early, 3 for other reasons; see table.csv"]
    assert f"  {MASS}  " in told
    assert LAG not in told


def test_a_measure_that_fails_takes_nothing_from_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = synthetic_study(tmp_path)
    study.table["unmeasured"][study.table["failed"] == ""] = "measure bad: ZeroDivisionError"
    print_study(study, 1.5)
    told = capsys.readouterr().out
    counts = "600 cases in 1.5 s: 570 flights to the end, 20 ended early, 10 failed"
    assert f"{counts}; 590 flights have no value of some measure" in told
    assert "not measured, 590, as case 0: measure bad: ZeroDivisionError" in told
    assert "median" in told


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing"], "nothing: no such robot file, and no robot of that name ships"),
        (["hexarotor_3link", "--scenario", "papr"], "no such scenario"),
        (["hexarotor_3link", "--vary", "duration"], "--vary duration: must be such as motors."),
        (["hexarotor_3link", "--vary", "duration="], "must be such as motors."),
        (["hexarotor_3link", "--vary", "durations=5"], "did you mean duration?"),
        (["hexarotor_3link", "--set", "duration"], "--set duration: must be such as duration=5"),
        (["hexarotor_3link", *SHORT, "--vary", "duration=1,2"], "--vary has this key too"),
        (["hexarotor_3link", "--samples", "2"], "no value is random"),
        (["hexarotor_3link", "--samples", "0"], "samples: must be a whole number"),
        (["hexarotor_3link", "--measure", "x=tip_eror.max"], "did you mean tip_error"),
        (["hexarotor_3link", "--measure", "tip_error.max"], "must be such as worst=tip_error.max"),
        (["hexarotor_3link", "--out", "generated/hexarotor_3link/robot.toml"], "is a file"),
    ],
)
def test_wrong_use_is_told(workplace: Path, arguments: list[str], message: str) -> None:
    done = run("sweep", "--out", "wrong", *arguments, cwd=workplace)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_ctrl_c_leaves_what_is_done(workplace: Path) -> None:
    options = [
        "--scenario",
        "hover",
        "--vary",
        "start.offset[0]=uniform(0,0.1)",
        "--samples",
        "300",
    ]
    options += ["--vary", "duration=0.2", "--no-figures", "--workers", "1", "--out", "c"]
    command = [sys.executable, "-m", "gibbs_codegen", "sweep", "hexarotor_3link", *options]
    process = subprocess.Popen(
        command,
        cwd=workplace,
        env=ENVIRONMENT,
        stderr=subprocess.PIPE,
        text=True,
        # What runs in the background of a shell ignores Ctrl-C, and so do its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    end = time.monotonic() + HANGING
    kept = workplace / "c" / FILE
    while not kept.exists() and time.monotonic() < end and process.poll() is None:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=HANGING)
    assert process.returncode == 130
    assert "interrupted with " in told
    assert "keeps them; repeat the command to continue" in told
    assert "Traceback" not in told
    assert not (workplace / "c" / "table.npy").exists()
    assert kept.read_bytes()
