"""Animations: frames in real time, whole files or none, and messages that help."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from matplotlib.figure import Figure
from PIL import Image
from support.synthetic_flight import synthetic_flight

from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.figures.scene import project
from gibbs_codegen.flight.figures.animation import Film, _GifWriter, write_animation
from gibbs_codegen.flight.figures.snapshots import ThrustArrows
from gibbs_codegen.flight.record.flight import Flight


@pytest.fixture(scope="module")
def flight(shipped: Callable[[str], ModuleType]) -> Flight:
    return synthetic_flight(shipped("hexarotor_3link"), samples=41, duration=0.4)


@pytest.mark.slow
def test_gif_runs_in_real_time(flight: Flight, tmp_path: Path) -> None:
    told = []
    path = tmp_path / "flight.gif"
    write_animation(flight, path, fps=10, progress=lambda *counts: told.append(counts))
    with Image.open(path) as film:
        # 0, 0.1 … 0.4 s.
        assert getattr(film, "n_frames", 1) == 5
        assert film.info["duration"] == 100
        # As wide as the scene, and even for mp4.
        assert film.size[1] == 420
        assert 500 <= film.size[0] <= 920
        assert film.size[0] % 2 == 0
        first = np.asarray(film.convert("RGB"))
        film.seek(4)
        assert np.any(np.asarray(film.convert("RGB")) != first)
    assert told == [(done, 5) for done in range(1, 6)]
    assert list(tmp_path.iterdir()) == [path]


def near_view(film: Film) -> Any:
    _, near = film.figure.axes
    return near


def test_the_near_view_goes_with_the_rotors(flight: Flight) -> None:
    shift = np.linspace(0.0, 40.0, len(flight.time))[:, np.newaxis] * [1.0, 0.0, 0.0]
    far = replace(
        flight,
        positions=flight.positions + shift[:, np.newaxis],
        centre_desired=flight.centre_desired + shift,
        tip_desired=flight.tip_desired + shift,
    )
    film = Film(far)
    film.figure.draw_without_rendering()
    near = near_view(film)
    (window,) = film.figure.artists
    frame = window.get_window_extent()
    rotors = [far.points.index(name) for name in far.rotor_points]
    for sample in (0, len(far.time) - 1):
        film.show(sample)
        film.figure.draw_without_rendering()
        pixels = near.transData.transform(project(near, far.positions[sample][rotors]))
        assert np.all((frame.min < pixels) & (pixels < frame.max))
        # They take a good part of it.
        assert np.ptp(pixels[:, 0]) > 0.3 * frame.width
        for low, high in (near.get_xlim(), near.get_ylim(), near.get_zlim()):
            assert low < high
    assert all(artist.get_clip_box() is not None for artist in near.lines)


@pytest.mark.slow
def test_no_near_view_where_all_is_near(flight: Flight) -> None:
    """Of the synthetic machine in one place, without its arm."""
    kept = [
        place
        for place, name in enumerate(flight.points)
        if name == "O2" or name in flight.rotor_points
    ]
    still = np.zeros(len(flight.time), dtype=int)
    bare = replace(
        flight,
        points=tuple(flight.points[place] for place in kept),
        positions=flight.positions[still][:, kept],
        parents=np.array([-1] + [0] * (len(kept) - 1)),
        centre_desired=flight.centre_desired[still],
    )
    assert not Film(bare).near
    assert len(Film(bare).figure.axes) == 1


def test_arrows_are_as_long_as_thrusts(flight: Flight) -> None:
    axes = Figure().add_subplot(projection="3d")
    arrows = ThrustArrows(axes, flight)
    for sample in (0, 30):
        arrows.show(sample)
        points = np.transpose(axes.get_lines()[0].get_data_3d()).reshape(6, 6, 3)
        starts, tips = points[:, 0], points[:, 1]
        at = [flight.points.index(name) for name in flight.rotor_points]
        assert np.allclose(starts, flight.positions[sample][at])
        along = flight.thrust_directions @ flight.base_rotation[sample].T
        thrusts = flight.applied[sample, :6]
        usual = np.quantile(np.abs(flight.applied[:, :6]), 0.95)
        lengths = arrows.reach * np.clip(thrusts / usual, -1.0, 1.0)
        assert np.allclose(tips - starts, lengths[:, np.newaxis] * along)


def test_an_arrow_of_no_thrust_has_no_head(flight: Flight) -> None:
    axes = Figure().add_subplot(projection="3d")
    applied = flight.applied.copy()
    applied[:, 1] = 0.0
    ThrustArrows(axes, replace(flight, applied=applied)).show(0)
    points = np.transpose(axes.get_lines()[0].get_data_3d()).reshape(6, 6, 3)
    sizes = np.linalg.norm(points[:, [2, 4]] - points[:, [3]], axis=2).max(axis=1)
    assert sizes[1] == 0.0
    assert np.all(np.delete(sizes, 1) > 0.0)


def test_single_sample(flight: Flight, tmp_path: Path) -> None:
    series = {
        name: getattr(flight, name)[:1]
        for name in (
            *("time", "positions", "base_rotation", "centre_desired", "tip_desired"),
            *("applied", "commanded"),
        )
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
    with pytest.raises(OutputError, match=r"ffmpeg.*write a \.gif"):
        write_animation(flight, tmp_path / "flight.mp4")
    assert not list(tmp_path.iterdir())


def test_folder_that_is_not_there(flight: Flight, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written: No such file or directory"):
        write_animation(flight, tmp_path / "missing" / "flight.gif")


def test_nothing_is_left_of_a_broken_film(flight: Flight, tmp_path: Path) -> None:
    error = KeyboardInterrupt
    path = tmp_path / "flight.gif"
    path.write_bytes(b"the one before")

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise error

    with pytest.raises(error):
        write_animation(flight, path, progress=stop)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_bytes() == b"the one before"


@pytest.mark.slow
def test_full_disk(flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: _GifWriter) -> None:
        Path(self.outfile).write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(_GifWriter, "finish", full)
    with pytest.raises(OutputError, match="No space left on device"):
        write_animation(flight, tmp_path / "flight.gif", fps=3)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not FFMpegWriter.isAvailable(), reason="needs ffmpeg")
def test_mp4(flight: Flight, tmp_path: Path) -> None:
    path = tmp_path / "flight.mp4"
    write_animation(flight, path, fps=10)
    assert path.read_bytes()[4:8] == b"ftyp"
    assert list(tmp_path.iterdir()) == [path]
