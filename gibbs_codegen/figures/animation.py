"""The robot flying, in three dimensions and in real time, as a film."""

from __future__ import annotations

import io
import os
import subprocess
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from gibbs_codegen.errors import OutputError, UsageError, cause_of, printable
from gibbs_codegen.figures.film import Film
from gibbs_codegen.figures.robot_drawing import samples_at
from gibbs_codegen.figures.style import COLOURS, DARK, GOLD, style
from gibbs_codegen.simulator.record.flight import Flight

_FRAME_DPI = 100
# Of every colour of a gif, from white to full.
_SHADES = 8


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
        # A folder that cannot hold it is found out before the work.
        temporary.touch()
        with style():
            _film(flight, writer, temporary, _frames(flight, fps), progress)
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"{printable(path)}: cannot be written: {cause_of(error)}") from None
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
        return _GifWriter(fps=fps)
    if suffix != ".mp4":
        raise UsageError(f"{printable(path)}: an animation is a .gif or .mp4 file")
    if not FFMpegWriter.isAvailable():
        raise OutputError(
            f"{printable(path)}: .mp4 needs ffmpeg, which is not on the path; "
            ".gif needs nothing more"
        )
    return FFMpegWriter(fps=fps)


class _GifWriter(AbstractMovieWriter):
    """Writes frames of one palette and without dithering, which makes files far smaller."""

    def setup(self, fig: Figure, outfile: Any, dpi: float | None = None) -> None:
        """Begin a film."""
        super().setup(fig, outfile, dpi)
        self._pictures: list[Image.Image] = []
        inks = np.array([to_rgb(colour) for colour in (*COLOURS, GOLD, DARK)])
        shares = np.linspace(0.0, 1.0, _SHADES)[:, np.newaxis, np.newaxis]
        shades = np.round(255.0 * (shares * inks + 1.0 - shares)).astype(np.uint8)
        self._palette = Image.new("P", (1, 1))
        self._palette.putpalette(shades.tobytes())

    def grab_frame(self, **savefig_kwargs: Any) -> None:
        """Add the figure as it is as a frame."""
        drawn = io.BytesIO()
        self.fig.savefig(drawn, **{**savefig_kwargs, "format": "rgba", "dpi": self.dpi})
        picture = Image.frombytes("RGBA", self.frame_size, drawn.getvalue()).convert("RGB")
        picture = picture.quantize(palette=self._palette, dither=Image.Dither.NONE)
        self._pictures.append(picture)

    def finish(self) -> None:
        """Write the file."""
        first, *others = self._pictures
        duration = int(1000 / self.fps)
        first.save(self.outfile, save_all=True, append_images=others, duration=duration, loop=0)


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


def _frames(flight: Flight, fps: int) -> list[int]:
    count = int((flight.time[-1] - flight.time[0]) * fps + 1e-9) + 1
    return samples_at(flight, flight.time[0] + np.arange(count) / fps)
