"""Results of a flight in a folder: whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.flight.figures.results import check_results, write_results
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate


@pytest.fixture(scope="module")
def flight(shipped: Callable[[str], ModuleType]) -> Flight:
    return simulate(shipped("hexarotor"), read_scenario("circle", {"duration": 0.2}))


def test_what_an_earlier_flight_left_gives_way(flight: Flight, tmp_path: Path) -> None:
    write_results(flight, tmp_path, figures=False)
    (tmp_path / "inputs.png").write_text("old")
    (tmp_path / "flight.gif").write_text("old")
    write_results(flight, tmp_path, figures=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flight.csv", "flight.npz"]


def test_no_ffmpeg_is_told_before_the_work(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OutputError, match="needs ffmpeg"):
        check_results(tmp_path / "out", "mp4")
    with pytest.raises(UsageError, match="not an empty name"):
        check_results("")
    assert not (tmp_path / "out").exists()


def test_other_files_are_left_alone_and_old_results_replaced(
    flight: Flight, tmp_path: Path
) -> None:
    write_results(flight, tmp_path, figures=False)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "flight.csv").write_text("old")
    write_results(flight, tmp_path, figures=False)
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert (tmp_path / "flight.csv").read_text().startswith("time [s],")
    assert len(list(tmp_path.iterdir())) == 3


def test_a_failure_changes_nothing(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_results(flight, tmp_path, figures=False)
    (tmp_path / "flight.csv").write_text("old")

    def fail(self: Flight, path: Path) -> None:
        path.write_text("half")
        raise OutputError("disk full")

    monkeypatch.setattr(Flight, "write_csv", fail)
    with pytest.raises(OutputError, match="disk full"):
        write_results(flight, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flight.csv", "flight.npz"]
    assert (tmp_path / "flight.csv").read_text() == "old"


def test_what_cannot_be_a_folder_is_refused(flight: Flight, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(UsageError, match="is a file; --out must be a folder"):
            write_results(flight, folder)
    with pytest.raises(UsageError, match="animation 'avi': unknown"):
        write_results(flight, tmp_path, animation="avi")


def test_what_a_killed_simulation_left_is_removed(flight: Flight, tmp_path: Path) -> None:
    left = tmp_path / ".gibbs_codegen_new_x"
    (left / "_new").mkdir(parents=True)
    (left / "_new" / "flight.npz").write_text("half")
    os.utime(left, (0, 0))
    write_results(flight, tmp_path, figures=False)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flight.csv", "flight.npz"]
