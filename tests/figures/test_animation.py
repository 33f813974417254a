"""Animations: frames in real time, whole files or none, and messages that help."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter, PillowWriter
from PIL import Image
from support.synthetic_flight import synthetic_flight

from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.figures.animation import write_animation
from gibbs_codegen.simulator.record.flight import Flight


@pytest.fixture(scope="module")
def flight(shipped: Callable[[str], ModuleType]) -> Flight:
    return synthetic_flight(shipped("hexarotor_3link"), samples=41, duration=0.4)


def test_gif_runs_in_real_time(flight: Flight, tmp_path: Path) -> None:
    told = []
    path = tmp_path / "flight.gif"
    write_animation(flight, path, fps=10, progress=lambda *counts: told.append(counts))
    with Image.open(path) as film:
        # 0, 0.1 … 0.4 s.
        assert getattr(film, "n_frames", 1) == 5
        assert film.info["duration"] == 100
        assert film.size == (640, 480)
        first = np.asarray(film.convert("RGB"))
        film.seek(4)
        assert np.any(np.asarray(film.convert("RGB")) != first)
    assert told == [(done, 5) for done in range(1, 6)]
    assert list(tmp_path.iterdir()) == [path]


def test_single_sample(flight: Flight, tmp_path: Path) -> None:
    series = {
        name: getattr(flight, name)[:1]
        for name in ("time", "positions", "base_rotation", "centre_desired", "tip_desired")
    }
    write_animation(replace(flight, **series), tmp_path / "one.gif")
    with Image.open(tmp_path / "one.gif") as film:
        assert getattr(film, "n_frames", 1) == 1


@pytest.mark.parametrize("name", ["flight.avi", "flight", "gif"])
def test_other_suffixes(flight: Flight, tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match=r"an animation is a \.gif or \.mp4 file"):
        write_animation(flight, tmp_path / name)


def test_no_frames(flight: Flight, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="0 frames per second"):
        write_animation(flight, tmp_path / "flight.gif", fps=0)


def test_mp4_without_ffmpeg(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OutputError, match=r"ffmpeg.*\.gif needs nothing more"):
        write_animation(flight, tmp_path / "flight.mp4")
    assert not list(tmp_path.iterdir())


def test_folder_that_is_not_there(flight: Flight, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written: No such file or directory"):
        write_animation(flight, tmp_path / "missing" / "flight.gif")


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_nothing_is_left_of_a_broken_film(
    flight: Flight, tmp_path: Path, error: type[BaseException]
) -> None:
    path = tmp_path / "flight.gif"
    path.write_bytes(b"the one before")

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise error

    with pytest.raises(error):
        write_animation(flight, path, progress=stop)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"the one before"


def test_full_disk(flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: PillowWriter) -> None:
        Path(self.outfile).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(PillowWriter, "finish", full)
    with pytest.raises(OutputError, match="No space left on device"):
        write_animation(flight, tmp_path / "flight.gif", fps=3)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not FFMpegWriter.isAvailable(), reason="needs ffmpeg")
def test_mp4(flight: Flight, tmp_path: Path) -> None:
    path = tmp_path / "flight.mp4"
    write_animation(flight, path, fps=10)
    assert path.read_bytes()[4:8] == b"ftyp"
    assert list(tmp_path.iterdir()) == [path]
