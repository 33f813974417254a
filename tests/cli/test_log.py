"""`gibbs-codegen log` as a user runs it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from support.command import run
from support.synthetic_flight import synthetic_flight

from gibbs_codegen.cli import robot_argument
from gibbs_codegen.flight.logs.log import write_log
from gibbs_codegen.flight.record.flight import read_flight

# The second joint stands at 0.25 rad.
_ONE_STANDS = np.array([1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0])
_AT = 0.25 * (1.0 - _ONE_STANDS)


def test_a_flight_becomes_a_bag(shipped: Callable[[str], ModuleType], tmp_path: Path) -> None:
    (tmp_path / "flight").mkdir()
    flight = synthetic_flight(shipped("hexarotor_3link"), samples=5, duration=0.4)
    flight.write_npz(tmp_path / "flight" / "flight.npz")
    done = run("log", "flight", "--out", "bags/one", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "bags/one: 5 samples of 0.4 s, 0.01 MB\n"
    files = sorted(path.name for path in (tmp_path / "bags" / "one").iterdir())
    assert files == ["metadata.yaml", "one.mcap"]
    for words, message in (
        (("flight", "--out", "bags/one"), "bags/one: exists already"),
        (("bags",), "bags: is not a saved flight: Is a directory; give a flight.npz"),
        (("none.npz",), "none.npz: is not a saved flight: No such file"),
    ):
        done = run("log", *words, cwd=tmp_path)
        assert (done.returncode, done.stdout) == (2, "")
        assert message in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bags", "flight"]


def test_a_log_becomes_a_flight(shipped: Callable[[str], ModuleType], tmp_path: Path) -> None:
    module = shipped("hexarotor_3link")
    shutil.copytree(Path(module.__file__ or "").parent, tmp_path / "generated" / "hexarotor_3link")
    flight = synthetic_flight(module, samples=50, duration=0.4)
    write_log(flight, tmp_path / "tables", "csv")
    (tmp_path / "tables" / "joint_states_0.csv").rename(tmp_path / "tables" / "arm_0.csv")
    words = ["replay", "hexarotor_3link", "tables", "--no-figures", "--cutoff", "20"]
    words += ["--name", "theta_7=arm.position[0]", "--name", "theta_8=0.25"]
    done = run(*words, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "tables: has no positions of the joint theta_9; give its name in the log" in done.stderr
    done = run(*words, "--name", "theta_9=arm.position[2]", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "flight: hexarotor_3link, 50 samples of 0.4 s, by tables\n"
    again = read_flight(tmp_path / "flight" / "flight.npz")
    np.testing.assert_allclose(again.q[5:-5], flight.q[5:-5] * _ONE_STANDS + _AT, atol=1e-2)
    done = run("replay", "hexarotor_3link", "tables", "--name", "theta_7", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "theta_7: must be KEY=VALUE" in done.stderr


def test_what_is_not_there_is_said_before_anything_is_derived(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_argument, "found_module", None)
    (tmp_path / "tables").mkdir()
    for words, message in (
        (["none"], "none: does not exist; give a log"),
        (["tables", "--estimate", "none.toml"], "none.toml: "),
    ):
        done = run("replay", "quadrotor", *words, cwd=tmp_path)
        assert (done.returncode, done.stdout) == (2, "")
        assert message in done.stderr
