"""`gibbs-codegen log` as a user runs it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from support.command import run
from support.synthetic_flight import synthetic_flight


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
        (("flight", "--out", "bags/one"), "bags/one: is there already"),
        (("bags",), "bags: has no flight; give a folder with a flight.npz"),
        (("none.npz",), "none.npz: is not a flight that was saved: No such file"),
    ):
        done = run("log", *words, cwd=tmp_path)
        assert (done.returncode, done.stdout) == (2, "")
        assert message in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bags", "flight"]
