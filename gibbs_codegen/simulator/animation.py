"""The machine in 3-D along its flight: at twelve instants, as the paper has it, and moving."""

from __future__ import annotations

import itertools
import os
import subprocess
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from gibbs_codegen.errors import OutputError, UsageError
from gibbs_codegen.simulator.flight import Array, Flight
from gibbs_codegen.simulator.machine_drawing import (
    FULL,
    MachineDrawing,
    PathDrawing,
    add_heading,
    chain,
    fit,
    project,
    set_scene,
    style,
)

INSTANTS = 12
# Elevation and azimuth, degrees.
_VIEW = (22.0, -62.0)
# Not along an axis, which would hide what it measures.
_AZIMUTHS = [quarter + turn for quarter in (-90, 0, -180, 90) for turn in range(20, 75, 5)]
_VIEWS: list[tuple[float, float]] = [_VIEW, *itertools.product((15.0, 20.0, 25.0, 30.0), _AZIMUTHS)]
# Above every machine.
_LABEL_LEVEL = 1000
# Instants that differ by less, in m, are one in the picture.
_SAME_PLACE = 0.02
# Half the size of a label with its margins, and how far from a machine it may be, points.
_LABEL_SIZE = np.array([13.0, 7.0])
_LABEL_DISTANCES = (24.0, 32.0, 42.0, 54.0)

_FRAME_SIZE, _FRAME_DPI = (6.4, 4.8), 100


def snapshots(flight: Flight) -> Figure:
    """The paper's Fig. 11: the machine at twelve instants along the paths of centre and tip, in m.

    Base arm `tangent_arm` (2 where none follows the path) is gold, rotors are discs normal to their
    thrusts, manipulators go from dark to light with time. Labels are times in s.
    """
    samples = _instants(flight)
    centres = flight.point("O2")[samples]
    view = _clearest_view(centres)
    with style():
        figure = Figure(figsize=(FULL, 6.0))
        axes: Any = figure.add_subplot(projection="3d")
        set_scene(axes, flight, view)
        PathDrawing(axes, flight).show(samples[-1])
        colours = _colours(samples)
        for rank, place in enumerate(np.argsort(centres @ _seen_from(view)[2])):
            machine = MachineDrawing(axes, flight, rank, colours[place], scale=0.9)
            machine.show(samples[place])
        fit(axes, *_under_heading(figure, flight))
        figure.legend(loc="upper left", borderaxespad=1.0)
        _label_instants(axes, flight, samples, colours)
        return figure


def snapshots_panels(flight: Flight) -> Figure:
    """The twelve instants of Fig. 11 one by one, in m, where one picture would be too crowded."""
    samples = _instants(flight)
    with style():
        figure = Figure(figsize=(FULL, 5.8))
        left, bottom, width, height = _under_heading(figure, flight)
        width, height = width / 4, height / 3
        first: Any = None
        for place, (sample, colour) in enumerate(zip(samples, _colours(samples), strict=True)):
            axes: Any = figure.add_subplot(projection="3d")
            set_scene(axes, flight, _VIEW, ticks=4)
            PathDrawing(axes, flight, scale=0.6).show(sample)
            MachineDrawing(axes, flight, colour=colour, scale=0.6).show(sample)
            axes.tick_params(labelsize=6, pad=-3)
            for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
                axis.labelpad = -9
                axis.label.set_fontsize(6.5)
            row, column = divmod(place, 4)
            x, y = column * width, (2 - row) * height
            # Scene and view are the same in all, so that what fits one fits all.
            if first is None:
                fit(axes, left + x, bottom + y, width, 0.92 * height)
                first = axes.get_position(original=True).translated(-x, -y)
            axes.set_position(first.translated(x, y))
            top = bottom + y + 0.92 * height
            figure.text(left + x + 0.02, top, f"{flight.time[sample]:.1f} s")
        # Makes the ticks while the style is ours.
        figure.draw_without_rendering()
        return figure


def write_animation(
    flight: Flight,
    path: Path,
    fps: int = 20,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Write the flight in real time, `fps` frames per second, to a `.gif` or `.mp4` file.

    `progress` is told how many frames of how many are done. GIF counts in 1/100 s: where 100 is no
    multiple of `fps`, it runs a little fast. Raises `UsageError` for another suffix or no frames,
    `OutputError` where the file cannot be written or `.mp4` lacks ffmpeg; then nothing is written.
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
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    except subprocess.CalledProcessError as error:
        raise OutputError(f"{path}: ffmpeg failed: {error.stderr.strip()}") from None
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
        raise UsageError(f"{path}: an animation is a .gif or .mp4 file")
    if not FFMpegWriter.isAvailable():
        raise OutputError(
            f"{path}: .mp4 needs ffmpeg, which is not on the path; .gif needs nothing more"
        )
    return FFMpegWriter(fps=fps)


def _film(
    flight: Flight,
    writer: AbstractMovieWriter,
    path: Path,
    samples: list[int],
    progress: Callable[[int, int], None],
) -> None:
    figure = Figure(figsize=_FRAME_SIZE)
    axes: Any = figure.add_subplot(projection="3d")
    set_scene(axes, flight, _VIEW)
    paths = PathDrawing(axes, flight, desired="0.65")
    machine = MachineDrawing(axes, flight)
    fit(axes, *_under_heading(figure, flight))
    figure.legend(loc="upper left", borderaxespad=1.0)
    clock = figure.text(0.98, 0.02, "", fontsize=11, horizontalalignment="right")
    writer.setup(figure, str(path), _FRAME_DPI)
    try:
        for done, sample in enumerate(samples, start=1):
            paths.show(sample)
            machine.show(sample)
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


def _under_heading(figure: Figure, flight: Flight) -> tuple[float, float, float, float]:
    """Head a figure; the rectangle of it that is left, with a margin."""
    heading = add_heading(figure, flight)
    figure.draw_without_rendering()
    top = heading.get_window_extent().transformed(figure.transFigure.inverted()).y0
    return 0.01, 0.01, 0.98, top - 0.02


def _frames(flight: Flight, fps: int) -> list[int]:
    count = int((flight.time[-1] - flight.time[0]) * fps + 1e-9) + 1
    return _nearest(flight, flight.time[0] + np.arange(count) / fps)


def _nearest(flight: Flight, times: Array) -> list[int]:
    """Samples of a flight that are nearest to times, s."""
    between = (flight.time[1:] + flight.time[:-1]) / 2.0
    return [int(sample) for sample in np.searchsorted(between, times)]


def _instants(flight: Flight) -> list[int]:
    """Twelve samples evenly spread over a flight, or all of them if it has fewer."""
    times = np.linspace(flight.time[0], flight.time[-1], INSTANTS)
    return sorted(set(_nearest(flight, times)))


def _colours(samples: list[int]) -> Array:
    """Colours (s, 4) from dark to as light as still reads on white."""
    colours: Array = colormaps["viridis"](np.linspace(0.0, 0.75, len(samples)))
    return colours


def _clearest_view(centres: Array) -> tuple[float, float]:
    """The view in which machines at `centres` (s, 3) stand best apart, as charges would."""

    def crowd(view: tuple[float, float]) -> float:
        flat = centres @ _seen_from(view)[:2].T
        square = np.sum((flat[:, np.newaxis] - flat) ** 2, axis=2)
        return float(np.sum(1.0 / (square + 1e-2)))

    return min(_VIEWS, key=crowd)


def _seen_from(view: tuple[float, float]) -> Array:
    """Unit vectors (3, 3), by rows: to the right, upwards, and towards the eye of a view."""
    (sin_e, sin_a), (cos_e, cos_a) = np.sin(np.radians(view)), np.cos(np.radians(view))
    return np.array(
        [
            [-sin_a, cos_a, 0.0],
            [-sin_e * cos_a, -sin_e * sin_a, cos_e],
            [cos_e * cos_a, cos_e * sin_a, sin_e],
        ]
    )


def _label_instants(axes: Any, flight: Flight, samples: list[int], colours: Array) -> None:
    """Write the time beside each machine, where it covers least of all of them."""

    def on_paper(points: Array) -> Array:
        """Where points (…, 3) of the world are on the figure (p, 2), in points."""
        flat = project(axes, points).reshape(-1, 2)
        places: Array = axes.transData.transform(flat) * 72.0 / axes.figure.dpi
        return places

    at = {name: flight.point(name)[samples] for name in flight.points}
    arms = [("O2", f"motor{k}", 1.4) for k in range(1, flight.rotors + 1)]
    links = [(start, end, 1.0) for start, end in itertools.pairwise(chain(flight))]
    taken = np.concatenate(
        [
            on_paper(at[start] + share * reach * (at[end] - at[start]))
            for start, end, reach in arms + links
            for share in np.linspace(0.0, 1.0, 12)
        ]
    )
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    offsets = np.concatenate([distance * circle for distance in _LABEL_DISTANCES])
    written = np.empty((0, 2))
    low, high = (20.0, 10.0), axes.figure.get_size_inches() * 72.0 - (20.0, 30.0)
    for first, label in _times(flight, samples):
        centre, colour = at["O2"][first], colours[first]
        places = on_paper(centre) + offsets
        crowd = _cover(places, taken, _LABEL_SIZE) + 9.0 * _cover(places, written, 2 * _LABEL_SIZE)
        crowd[np.any((places < low) | (places > high), axis=1)] += 1e3
        best = int((crowd + 0.01 * np.hypot(*offsets.T)).argmin())
        written = np.concatenate([written, places[best : best + 1]])
        axes.annotate(
            label,
            xy=project(axes, centre),
            xytext=offsets[best],
            textcoords="offset points",
            color=colour,
            horizontalalignment="center",
            verticalalignment="center",
            arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.5, "shrinkA": 0, "shrinkB": 2},
            path_effects=[withStroke(linewidth=1.5, foreground="white")],
            zorder=_LABEL_LEVEL,
        )


def _times(flight: Flight, samples: list[int]) -> list[tuple[int, str]]:
    """Labels of the instants, one for those in the same place, with the number of the first."""
    together: dict[int, list[str]] = {}
    for sample in samples:
        apart = np.abs(flight.positions[samples] - flight.positions[sample]).max(axis=(1, 2))
        first = int(np.argmax(apart < _SAME_PLACE))
        together.setdefault(first, []).append(f"{flight.time[sample]:.1f}")
    return [
        (first, (", ".join(times) if len(times) < 3 else f"{times[0]} … {times[-1]}") + " s")
        for first, times in together.items()
    ]


def _cover(places: Array, points: Array, reach: Array) -> Array:
    """How much labels at `places` (k, 2) would cover points (p, 2) within `reach` (2) of them."""
    near = (np.abs(places[:, np.newaxis] - points) / reach).max(axis=2)
    cover: Array = np.maximum(0.0, 1.0 - near).sum(axis=1)
    return cover
