"""`gibbs-codegen simulate` as a user runs it: exit codes, streams, files left behind."""

from __future__ import annotations

import os
import pty
import re
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
from support.tools import HANGING

from gibbs_codegen import pipeline
from gibbs_codegen.cli.terminal import ended_by_signals
from gibbs_codegen.flight.record.flight import read_flight


@pytest.fixture(scope="module")
def workplace(
    shipped: Callable[[str], ModuleType], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A folder whose generated/ holds a machine with an arm, one without and a quadrotor."""
    folder = tmp_path_factory.mktemp("workplace")
    for name in ("hexarotor_3link", "hexarotor", "quadrotor_2link"):
        shutil.copytree(Path(shipped(name).__file__ or "").parent, folder / "generated" / name)
    return folder


@pytest.mark.parametrize("command", ["simulate", "sweep", "sitl --ardupilot"])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("arm.posture_deg.elbow=3", r"arm\.posture_deg\.elbow: quadrotor_2link has no joint elbow"),
        ('push={frame="hand",force=[1,0,0]}', r"push\.frame: quadrotor_2link has no frame hand"),
        ("start.charge=0.5", "quadrotor_2link has no battery"),
    ],
)
def test_faults_of_a_scenario_come_before_anything_is_derived(
    command: str, change: str, words: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def derive(*_: object, **__: object) -> None:
        raise AssertionError("a module is made")

    monkeypatch.setattr(pipeline, "generate_robot", derive)
    name, *options = command.split()
    given = ["quadrotor_2link", *options, "--scenario", "hover", "--set", change, "--out", "out"]
    done = run(name, *given, cwd=tmp_path)
    assert done.returncode == 2
    assert re.search(words, done.stderr)


def test_a_law_that_does_not_fit_is_refused_before_anything_is_derived(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(pipeline, "generate_robot", None)
    law = ["--set", "control.law=computed_torque"]
    done = run("simulate", "quadrotor", "--scenario", "hover", *law, cwd=tmp_path)
    assert done.returncode == 2
    assert "the base must be fully actuated" in done.stderr


@pytest.mark.slow
def test_the_force_of_every_wall_is_told(workplace: Path) -> None:
    wall = "{frame='tip', point=[%s, 0, 3], normal=[-1, 0, 0], stiffness=400, damping=9}"
    walls = f"wall=[{wall % 5}, {wall % 9}]"
    options = ["--scenario", "inspection", "--set", walls, "--set", "duration=8", "--no-figures"]
    done = run("simulate", "hexarotor_3link", *options, "--out", "leant", cwd=workplace)
    assert done.returncode == 0, done.stderr
    flight = read_flight(workplace / "leant" / "flight.npz")
    forces = -flight.frame_wrench("tip")[:, 0]
    assert flight.wall_forces[:, 0] == pytest.approx(forces)
    assert not flight.wall_forces[:, 1].any()
    begin = f"wall 1, on tip: at most {forces.max():.3g} N, at t = "
    assert f"{begin}{flight.time[forces.argmax()]:.4g} s; {forces[-1]:.3g} N at the end\n" in (
        done.stdout
    )
    assert "wall 2, on tip: not touched\n" in done.stdout
    assert forces[-1] > 5.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("felt", "told"), [pytest.param(0.6, True, marks=pytest.mark.slow), (2.0, False)]
)
def test_a_force_that_is_not_reached_is_told(felt: float, told: bool, workplace: Path) -> None:
    law = "control={law='force', force={value=2, direction=[1, 0, 0], rise=0.1}}"
    push = f"push={{frame='tip', force=[-{felt}, 0, 0], end=9}}"
    options = ["--scenario", "hover", "--set", law, "--set", push, "--set", "duration=0.2"]
    options += ["--out", "pushing"]
    done = run("simulate", "hexarotor_3link", *options, "--no-figures", cwd=workplace)
    assert done.returncode == 0, done.stderr
    note = "note: tip should push with 2 N but reaches at most 0.6 N; move its path nearer"
    assert (note in done.stdout) is told


@pytest.mark.slow
def test_options_reach_the_flight(workplace: Path) -> None:
    scenario = workplace / "mine.toml"
    scenario.write_text(
        'name = "mine"\nduration = 0.3\n[base]\npath = { kind = "fixed", position = [1, 2, 3] }\n'
    )
    options = ["--scenario", "mine.toml", "--backend", "numpy", "--no-figures", "--out", "b/c"]
    change = ["--set", "start.offset=[0, 0, 0.25]", "--set", "integration.method=rk4"]
    done = run("simulate", "generated/hexarotor", *options, *change, cwd=workplace)
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in (workplace / "b" / "c").iterdir()) == ["flight.csv", "flight.npz"]
    flight = read_flight(workplace / "b" / "c" / "flight.npz")
    assert flight.scenario == "mine"
    assert flight.point("O2")[0] == pytest.approx([1, 2, 3.25], abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing"], "nothing: no such robot file, and no robot of that name ships"),
        (["nothing"], "nor is there a module of that name in generated/"),
        (["hexarotor_3link", "--set", "durations=5"], "unknown key; did you mean duration?"),
        (["hexarotor"], "has no arm"),
        (["hexarotor"], "such as --scenario hold"),
    ],
)
def test_wrong_use_is_told_and_leaves_nothing(
    arguments: list[str], message: str, workplace: Path
) -> None:
    done = run("simulate", *arguments, cwd=workplace)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    assert not (workplace / "flight").exists()


def test_a_broken_scenario_is_refused_with_its_lines(workplace: Path) -> None:
    (workplace / "broken.toml").write_text(
        'name = "b"\nduration = "long"\n[base]\nattitude = { kind = "tangential" }\n'
    )
    done = run("simulate", "hexarotor", "--scenario", "broken.toml", cwd=workplace)
    assert done.returncode == 2
    assert "scenario rejected, 2 faults" in done.stderr
    assert "broken.toml:2: duration: must be a number, not a string" in done.stderr
    assert (
        "broken.toml:4: base.attitude.kind: must be one of 'level', 'turn', 'tangent'"
        in done.stderr
    )


@pytest.mark.slow
def test_a_flight_that_ends_early_fails_with_its_reason_and_its_results(workplace: Path) -> None:
    changes = ["--set", "motors.time_constant=0.05", "--set", "motors.compensation=false"]
    options = ["--no-figures", "--out", "lost"]
    done = run("simulate", "hexarotor_3link", *changes, *options, cwd=workplace)
    assert done.returncode == 1
    assert "the flight ended early: at t = " in done.stderr
    assert "Traceback" not in done.stderr
    assert read_flight(workplace / "lost" / "flight.npz").stopped


def test_signals_to_end_unwind_the_work() -> None:
    """One that is ignored, as by nohup, stays ignored."""
    before = [(number, signal.getsignal(number)) for number in (signal.SIGTERM, signal.SIGHUP)]
    try:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        with ended_by_signals():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
            assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
            with pytest.raises(SystemExit) as ended:
                signal.raise_signal(signal.SIGTERM)
        assert ended.value.code == 128 + signal.SIGTERM
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    finally:
        for number, handler in before:
            signal.signal(number, handler)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGHUP])
def test_a_signal_ends_a_flight_and_leaves_nothing(number: int, workplace: Path) -> None:
    slow = ["--backend", "numpy", "--set", "integration.method=rk4", "--out", "cut"]
    process = subprocess.Popen(
        [sys.executable, "-m", "gibbs_codegen", "simulate", "hexarotor_3link", *slow],
        cwd=workplace,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: (
            signal.signal(number, signal.SIG_DFL)
            if number != signal.SIGINT
            else signal.signal(number, signal.default_int_handler)
        ),
    )
    time.sleep(2.0)
    process.send_signal(number)
    out, err = process.communicate(timeout=HANGING)
    # On a slow machine it comes before the program has begun to listen.
    assert process.returncode in (128 + number, -number)
    assert "Traceback" not in err
    assert out == ""
    assert not (workplace / "cut").exists() or not any((workplace / "cut").iterdir())


@pytest.mark.slow
def test_a_terminal_sees_progress(workplace: Path) -> None:
    ours, theirs = pty.openpty()
    changes = ["--set", "duration=1", "--no-figures", "--out", "seen"]
    process = subprocess.Popen(
        [sys.executable, "-m", "gibbs_codegen", "simulate", "hexarotor_3link", *changes],
        cwd=workplace,
        env={**ENVIRONMENT, "TERM": "xterm"},
        stdout=subprocess.DEVNULL,
        stderr=theirs,
    )
    os.close(theirs)
    seen = b""
    try:
        while part := os.read(ours, 4096):
            seen += part
    except OSError:  # The other end has closed.
        pass
    assert process.wait(timeout=HANGING) == 0
    os.close(ours)
    assert b"inverse kinematics" in seen
    assert b"flying" in seen


def test_help_lists_what_there_is(tmp_path: Path) -> None:
    done = run("simulate", "--help", cwd=tmp_path)
    assert done.returncode == 0
    for word in ("--scenario", "--out", "--backend", "--set", "--animate", "--no-figures"):
        assert word in done.stdout
