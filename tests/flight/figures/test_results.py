"""Results of a flight in a folder: whole or not at all."""

from __future__ import annotations

import multiprocessing
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from pathlib import Path
from types import ModuleType

import pytest

from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.flight.figures import results
from gibbs_codegen.flight.figures.results import check_results, drawing_beside, write_results
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.flight.sweeps.workers import Workers

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="processes are copied on Linux alone")


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


@pytest.fixture
def copies() -> Iterator[Workers]:
    before = multiprocessing.active_children()
    workers = Workers(2, "fork")
    yield workers
    workers.end()
    assert multiprocessing.active_children() == before


def named(
    flight: Flight, folder: Path, formats: Sequence[str], share: int = 0, of: int = 1
) -> None:
    """Write a file with the name of the share, instead of figures."""
    (folder / f"{share} of {of}").write_text("")


def dead(flight: Flight, folder: Path, formats: Sequence[str], share: int = 0, of: int = 1) -> None:
    """As `named`, but one copy dies, and the other is still at work."""
    if of > 1:
        time.sleep(60.0 * share)
        os._exit(1)
    named(flight, folder, formats, share, of)


def failed(flight: Flight, folder: Path, formats: Sequence[str], share: int, of: int) -> None:
    """One copy fails, and the other would make its folder again, and write, once that is gone."""
    if share == 0:
        raise OutputError(f"{folder}: full")
    while folder.exists():
        time.sleep(0.001)
    folder.mkdir(parents=True)


@LINUX
@pytest.mark.parametrize(
    ("drawn", "most", "shares"),
    [(named, 1000, ["0 of 2", "1 of 2"]), (named, 10, ["0 of 1"]), (dead, 1000, ["0 of 1"])],
    ids=["copies", "long flight", "dead copy"],
)
def test_copies_draw_shares_and_this_process_where_they_cannot(
    drawn: Callable[..., None],
    most: int,
    shares: list[str],
    flight: Flight,
    tmp_path: Path,
    copies: Workers,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(results, "_drawn", drawn)
    monkeypatch.setattr(results, "_MOST_SAMPLES", most)
    assert 10 < len(flight.time) < 1000
    paths = write_results(flight, tmp_path, workers=copies)
    assert [path.name for path in paths] == [*shares, "flight.csv", "flight.npz"]
    assert sorted(path.name for path in tmp_path.iterdir()) == [path.name for path in paths]


def test_what_copies_draw_does_not_change_while_it_is_sent(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Properties that are cached meanwhile are those of the flight alone."""
    sent: list[Flight] = []

    class Broken:
        count = 2

        def submit(self, _: object, to_draw: Flight, *others: object) -> None:
            sent.append(to_draw)
            raise BrokenExecutor

        def end(self) -> None:
            pass

    monkeypatch.setattr(results, "_drawn", named)
    write_results(flight, tmp_path, workers=Broken())  # type: ignore[arg-type]
    before = {*vars(sent[0])}
    flight.__dict__["cached"] = 1.0
    assert {*vars(sent[0])} == before


@LINUX
@pytest.mark.parametrize("place", ["a copy", "this process"])
def test_copies_write_nothing_after_a_failure(
    place: str, flight: Flight, tmp_path: Path, copies: Workers, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(results, "_drawn", failed)
    before = multiprocessing.active_children()
    folder = tmp_path / "out"

    def fail(self: Flight, path: Path) -> None:
        raise OutputError(f"{path.parent}: full")

    if place == "this process":
        monkeypatch.setattr(Flight, "write_csv", fail)
    with pytest.raises(OutputError) as raised:
        write_results(flight, folder, workers=copies)
    assert str(raised.value) == f"{folder}: full"
    assert multiprocessing.active_children() == before
    assert not folder.exists()


@pytest.mark.slow
@LINUX
def test_copies_draw_the_same_bytes(flight: Flight, tmp_path: Path, copies: Workers) -> None:
    alone = write_results(flight, tmp_path / "alone")
    beside = write_results(flight, tmp_path / "beside", workers=copies)
    assert [path.name for path in alone] == [path.name for path in beside]
    assert len(alone) > 6
    for one, other in zip(alone, beside, strict=True):
        assert one.suffix == ".npz" or one.read_bytes() == other.read_bytes()


def test_one_processor_draws_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "own_count", lambda: 1)
    with drawing_beside(["png"]) as workers:
        assert workers is None


@LINUX
def test_copies_warn_of_all_but_threads(copies: Workers, monkeypatch: pytest.MonkeyPatch) -> None:
    """Warnings are errors here, in copies too."""
    fork = os.fork

    def warning_fork() -> int:
        words = "This process (pid=7) is multi-threaded, use of fork() may lead to deadlocks"
        warnings.warn(words, DeprecationWarning, stacklevel=2)
        return fork()

    monkeypatch.setattr(os, "fork", warning_fork)
    task = copies.submit(warnings.warn, "no such font")
    with pytest.raises(UserWarning, match="no such font"):
        task.result()
