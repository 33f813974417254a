"""The robot flying, in three dimensions and in real time, as a film."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from gibbs_codegen.errors import OutputError, UsageError, printable
from gibbs_codegen.figures.appearance import COLOURS, DARK, GOLD, VIEW
from gibbs_codegen.figures.scene import extent, fit, hide_numbers, set_scene
from gibbs_codegen.figures.style import style
from gibbs_codegen.files.staging import writing
from gibbs_codegen.flight.figures import snapshots
from gibbs_codegen.flight.figures.curves import add_legend
from gibbs_codegen.flight.record.extent import bounds, rotor_radius, samples_at
from gibbs_codegen.flight.record.flight import Array, Flight

# Height of frames, what heading and legend take of it, and how wide the whole flight may be, in.
_HEIGHT, _HEAD, _WIDTHS = 4.2, 0.5, (2.6, 5.4)
# How far the near view reaches at most, in what rotors and arrows take; and the share of the
# flight's size from which on there is none.
_REACH, _LARGE = 0.95, 0.7
# How much wider lines are in the near view.
_NEAR_SCALE = 1.8
_FRAME_DPI = 100
# Shades of every colour of a gif, from white to full.
_SHADES = 8


class Film:
    """The scenes of a flight, in a figure of its own, and what moves in them.

    On the left is the whole flight. On the right, if they would be small on the left, are the
    rotors and what is close to them; this view goes with them.
    """

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        near = [flight.points.index(name) for name in flight.rotor_points or (flight.centre,)]
        self._middles = flight.positions[:, near].mean(axis=1)
        whole = bounds(flight)
        self.near = _near_radius(flight, self._middles, whole)
        height = _HEIGHT - _HEAD
        wide, high = extent(whole, VIEW)
        left = float(np.clip(height * wide / high, *_WIDTHS))
        width = left + (height if self.near else 0.0)
        # Even in pixels, for mp4.
        self.figure = Figure(figsize=(0.02 * round(50.0 * width), _HEIGHT))
        axes: Any = self.figure.add_subplot(projection="3d")
        step = set_scene(axes, whole)
        hide_numbers(axes)
        self._moving = _artists(axes, flight)
        _, bottom, _, top = add_legend(axes, flight)
        fit(axes, 0.01, bottom, left / width - 0.02, top)
        self.figure.text(0.015, 0.025, f"grid {step:g} m")
        self._clock = self.figure.text(0.985, 0.025, "", fontsize=11, horizontalalignment="right")
        self._near_axes: Any = None
        if self.near:
            self._near_axes = self.figure.add_subplot(projection="3d")
            self._add_near_view(left / width, bottom, 0.99 - left / width, top)

    def show(self, sample: int) -> None:
        """Move everything to where it is at a sample."""
        for artists in self._moving:
            artists.show(sample)
        if self._near_axes is not None and np.all(np.isfinite(self._middles[sample])):
            low, high = self._near_box(sample)
            ends = {f"{name}lim": limits for name, *limits in zip("xyz", low, high, strict=True)}
            self._near_axes.set(**ends)
        self._clock.set_text(f"{self._flight.time[sample]:.2f} s")

    def _add_near_view(self, left: float, bottom: float, width: float, height: float) -> None:
        """Put the near view into a frame, in shares of the figure, that cuts off the rest."""
        axes = self._near_axes
        set_scene(axes, self._near_box(0))
        axes.set_axis_off()
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_visible(False)
        self._moving += _artists(axes, self._flight, _NEAR_SCALE)
        fit(axes, left, bottom, width, height)
        frame = Rectangle(
            (left, bottom),
            width,
            height,
            transform=self.figure.transFigure,
            facecolor="none",
            edgecolor="0.7",
        )
        self.figure.add_artist(frame)
        for artist in (*axes.lines, *axes.collections):
            artist.set_clip_path(frame)

    def _near_box(self, sample: int) -> tuple[Array, Array]:
        """The cube that is as large, as it is seen, as a ball of the near view, m."""
        cube = np.ones(3) * 2.0 * self.near / extent((-np.ones(3), np.ones(3)), VIEW).max()
        return self._middles[sample] - cube, self._middles[sample] + cube


def _artists(axes: Any, flight: Flight, scale: float = 1.0) -> list[Any]:
    """Drawings in 3-D axes that `show` a sample; `scale` multiplies the widths of lines."""
    paths = snapshots.PathDrawing(axes, flight, desired="0.65")
    drawn = [paths, snapshots.RobotDrawing(axes, flight, scale=scale)]
    return [*drawn, snapshots.ThrustArrows(axes, flight, scale)] if flight.rotors else drawn


def _near_radius(flight: Flight, middles: Array, whole: tuple[Array, Array]) -> float:
    """Reach, m, of the near view from the rotors' middles (s, 3).

    It is 0 if `whole`, the lowest and highest coordinates of the flight, shows them about as large.
    """
    rotors = [flight.points.index(name) for name in flight.rotor_points]
    distances = np.linalg.norm(flight.positions - middles[:, np.newaxis], axis=2)
    room = rotor_radius(flight) * (1.0 + snapshots.LONGEST)
    farthest = [np.nanmax(which, initial=0.0) for which in (distances, distances[:, rotors])]
    # An arm that is long beside the base is cut off.
    radius = float(min(farthest[0] + 0.5 * room, _REACH * (farthest[1] + room)))
    return radius if 2.0 * radius < _LARGE * np.max(whole[1] - whole[0]) else 0.0


def write_animation(
    flight: Flight,
    path: Path,
    fps: int = 20,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Write the flight in real time to a `.gif` or `.mp4` file, whole or not at all.

    GIF counts in 1/100 s: unless 100 is a multiple of `fps`, it runs a little fast. `progress` is
    called after each frame with the number of frames done and of all. Raises `UsageError` for
    another suffix and no frames, and `OutputError` if the file cannot be written, or ffmpeg, which
    `.mp4` needs, is missing or fails.
    """
    writer = _writer(path, fps)
    # Beside it, so that only what is whole takes its place; the suffix tells the format.
    temporary = path.with_name(f".{path.stem}-{os.getpid()}{path.suffix}")
    try:
        with writing(path):
            # A folder that cannot hold it is found out before the work.
            temporary.touch()
            with style():
                count = int((flight.time[-1] - flight.time[0]) * fps + 1e-9) + 1
                frames = samples_at(flight, flight.time[0] + np.arange(count) / fps)
                _film(flight, writer, temporary, frames, progress)
            os.replace(temporary, path)
    except subprocess.CalledProcessError as error:
        raise OutputError(f"{printable(path)}: ffmpeg failed: {error.stderr.strip()}") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _writer(path: Path, fps: int) -> AbstractMovieWriter:
    """The writer of the format that the suffix of `path` tells."""
    if fps < 1:
        raise UsageError(f"{fps} frames per second: give 1 or more")
    suffix = path.suffix.lower()
    if suffix == ".gif":
        return _GifWriter(fps=fps)
    if suffix != ".mp4":
        raise UsageError(f"{printable(path)}: an animation is a .gif or .mp4 file")
    if not FFMpegWriter.isAvailable():
        raise OutputError(
            f"{printable(path)}: .mp4 needs ffmpeg, which is not on the PATH; install it, or "
            "write a .gif"
        )
    return FFMpegWriter(fps=fps)


class _GifWriter(PillowWriter):
    """Writes frames of one palette and without dithering, which makes files far smaller."""

    _frames: list[Image.Image]

    def grab_frame(self, **savefig_kwargs: Any) -> None:
        """Add the figure as it is as a frame."""
        super().grab_frame(**savefig_kwargs)
        inks = np.array([to_rgb(colour) for colour in (*COLOURS, GOLD, DARK)])
        shares = np.linspace(0.0, 1.0, _SHADES)[:, np.newaxis, np.newaxis]
        shades = np.round(255.0 * (shares * inks + 1.0 - shares)).astype(np.uint8)
        palette = Image.new("P", (1, 1))
        palette.putpalette(shades.tobytes())
        picture = self._frames[-1].convert("RGB")
        self._frames[-1] = picture.quantize(palette=palette, dither=Image.Dither.NONE)


def _film(
    flight: Flight,
    writer: AbstractMovieWriter,
    path: Path,
    samples: list[int],
    progress: Callable[[int, int], None],
) -> None:
    """Draw frame after frame, one for each of some samples."""
    film = Film(flight)
    writer.setup(film.figure, str(path), _FRAME_DPI)
    try:
        for done, sample in enumerate(samples, start=1):
            film.show(sample)
            writer.grab_frame()
            progress(done, len(samples))
    except BaseException:
        # ffmpeg must end before its file can go; what it says of half a film is of no use.
        if isinstance(writer, FFMpegWriter):
            with suppress(Exception):
                writer.finish()
        raise
    writer.finish()
