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
from matplotlib.figure import Figure

from gibbs_codegen.errors import OutputError, UsageError, printable
from gibbs_codegen.figures.robot_drawing import (
    PathDrawing,
    RobotDrawing,
    bounds,
    rotor_radius,
    samples_at,
)
from gibbs_codegen.figures.scene import VIEW, extent, fit, set_scene
from gibbs_codegen.figures.style import add_legend, style
from gibbs_codegen.figures.thrust_arrows import ThrustArrows
from gibbs_codegen.simulator.record.flight import Array, Flight

# Height of frames, their narrowest and widest width, and what labels take of both, in.
_HEIGHT, _WIDTHS, _AROUND, _FRAME_DPI = 4.8, (3.6, 6.4), np.array([0.9, 1.3]), 100
# Radii of rotors that there is room for around a robot; and the share of the whole flight's size
# below which a robot is followed.
_ROOM, _SMALL = 2.5, 0.7


def write_animation(
    flight: Flight,
    path: Path,
    fps: int = 20,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Write the flight in real time to a `.gif` or `.mp4` file, whole or not at all.

    GIF counts in 1/100 s: unless 100 is a multiple of `fps`, it runs a little fast.

    Args:
        flight: The flight.
        path: The file; its suffix chooses the format.
        fps: Frames per second, at least 1.
        progress: Is called after each frame with the number of frames done and of all frames.

    Raises:
        UsageError: The suffix is another one, or there are no frames.
        OutputError: The file cannot be written, or ffmpeg, which `.mp4` needs, is missing or fails.
    """
    writer = _writer(path, fps)
    # Beside it, so that only what is whole takes its place; the suffix tells the format.
    temporary = path.with_name(f".{path.stem}-{os.getpid()}{path.suffix}")
    try:
        # A folder that cannot hold it is found out before the work.
        temporary.touch()
        with style():
            _film(flight, writer, temporary, _frames(flight, fps), progress)
        os.replace(temporary, path)
    except OSError as error:
        reason = error.strerror or error
        raise OutputError(f"{printable(path)}: cannot be written: {reason}") from None
    except subprocess.CalledProcessError as error:
        raise OutputError(f"{printable(path)}: ffmpeg failed: {error.stderr.strip()}") from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _writer(path: Path, fps: int) -> AbstractMovieWriter:
    """What writes the format that the suffix of `path` tells."""
    if fps < 1:
        raise UsageError(f"{fps} frames per second: give 1 or more")
    suffix = path.suffix.lower()
    if suffix == ".gif":
        return PillowWriter(fps=fps)
    if suffix != ".mp4":
        raise UsageError(f"{printable(path)}: an animation is a .gif or .mp4 file")
    if not FFMpegWriter.isAvailable():
        raise OutputError(
            f"{printable(path)}: .mp4 needs ffmpeg, which is not on the path; "
            ".gif needs nothing more"
        )
    return FFMpegWriter(fps=fps)


class _Camera:
    """Shows the whole flight, or goes with the robot if that would be small in it."""

    def __init__(self, flight: Flight) -> None:
        whole = bounds(flight)
        self._places = flight.point(flight.centre)
        around = flight.positions - self._places[:, np.newaxis]
        around = around[np.isfinite(around).all(axis=(1, 2))].reshape(-1, 3)
        room = _ROOM * rotor_radius(flight)
        near = around.min(axis=0) - room, around.max(axis=0) + room
        self.follows = float(np.max(near[1] - near[0])) < _SMALL * np.max(whole[1] - whole[0])
        self._box = near if self.follows else whole

    @property
    def frame_size(self) -> tuple[float, float]:
        """Width and height of frames, in, which the scene fills; even in pixels, for mp4."""
        wide, high = extent(self._box, VIEW)
        width = (_HEIGHT - _AROUND[1]) * wide / high + _AROUND[0]
        return 0.02 * round(50.0 * float(np.clip(width, *_WIDTHS))), _HEIGHT

    def box(self, sample: int) -> tuple[Array, Array]:
        """Lowest and highest coordinates (3) each that are shown at a sample, m."""
        low, high = self._box
        place = self._places[sample] if self.follows else np.zeros(3)
        return low + place, high + place

    def point(self, axes: Any, sample: int) -> None:
        """Show what is to be seen at a sample, unless the robot is nowhere."""
        box = self.box(sample)
        if self.follows and np.all(np.isfinite(box)):
            axes.set(**{f"{name}lim": ends for name, *ends in zip("xyz", *box, strict=True)})


def _film(
    flight: Flight,
    writer: AbstractMovieWriter,
    path: Path,
    samples: list[int],
    progress: Callable[[int, int], None],
) -> None:
    """Draw frame after frame.

    Args:
        flight: The flight.
        writer: What takes the frames.
        path: The file that it writes.
        samples: Numbers of the samples to draw, a frame each.
        progress: As for `write_animation`.
    """
    camera = _Camera(flight)
    figure = Figure(figsize=camera.frame_size)
    axes: Any = figure.add_subplot(projection="3d")
    set_scene(axes, camera.box(0))
    paths = PathDrawing(axes, flight, desired="0.65")
    robot = RobotDrawing(axes, flight)
    arrows = ThrustArrows(axes, flight)
    fit(axes, *add_legend(axes, flight))
    clock = figure.text(0.98, 0.02, "", fontsize=11, horizontalalignment="right")
    writer.setup(figure, str(path), _FRAME_DPI)
    try:
        for done, sample in enumerate(samples, start=1):
            paths.show(sample)
            robot.show(sample)
            arrows.show(sample)
            camera.point(axes, sample)
            clock.set_text(f"{flight.time[sample]:.2f} s")
            writer.grab_frame()
            progress(done, len(samples))
    except BaseException:
        # ffmpeg must end before its file can go; what it says of half a film is of no use.
        if isinstance(writer, FFMpegWriter):
            with suppress(Exception):
                writer.finish()
        raise
    writer.finish()


def _frames(flight: Flight, fps: int) -> list[int]:
    count = int((flight.time[-1] - flight.time[0]) * fps + 1e-9) + 1
    return samples_at(flight, flight.time[0] + np.arange(count) / fps)
