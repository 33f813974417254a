"""The paper's Fig. 11: the machine at twelve instants of its flight."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from gibbs_codegen.figures.machine_drawing import (
    VIEW,
    MachineDrawing,
    PathDrawing,
    bounds,
    chain,
    fit,
    project,
    samples_at,
    set_scene,
)
from gibbs_codegen.figures.style import FULL, add_legend, style
from gibbs_codegen.simulator.flight import Array, Flight

INSTANTS = 12
# Width and height of the largest box that is drawn, and what labels around it take, in.
_LARGEST, _AROUND = np.array([FULL - 0.7, 5.0]), np.array([0.7, 1.0])
# Not along an axis, which would hide what it measures.
_AZIMUTHS = [quarter + turn for quarter in (-90, 0, -180, 90) for turn in range(20, 75, 5)]
_VIEWS: list[tuple[float, float]] = [VIEW, *itertools.product((15.0, 20.0, 25.0, 30.0), _AZIMUTHS)]
# Above every machine.
_LABEL_LEVEL = 1000
# Instants that differ by less, in m, are one in the picture.
_SAME_PLACE = 0.02
# Half the size of a label with its margins, and how far from a machine it may be, points.
_LABEL_SIZE = np.array([13.0, 7.0])
_LABEL_DISTANCES = (24.0, 32.0, 42.0, 54.0)


def snapshots(flight: Flight) -> Figure:
    """The paper's Fig. 11: the machine at twelve instants along the paths of centre and tip, in m.

    Base arm `tangent_arm` (2 where none follows the path) is gold, rotors are discs normal to their
    thrusts, manipulators go from dark to light with time. Labels are times in s.
    """
    samples = _instants(flight)
    centres = flight.point("O2")[samples]
    box = bounds(flight, samples)
    view = _clearest_view(centres, box)
    with style():
        figure = Figure(figsize=_scale(box, view) * _extent(box, view) + _AROUND)
        axes: Any = figure.add_subplot(projection="3d")
        set_scene(axes, box, view)
        PathDrawing(axes, flight).show(samples[-1])
        colours = _colours(samples)
        for rank, place in enumerate(np.argsort(centres @ _seen_from(view)[2])):
            machine = MachineDrawing(axes, flight, rank, colours[place], scale=0.9)
            machine.show(samples[place])
        fit(axes, *add_legend(axes, flight))
        _label_instants(axes, flight, samples, colours)
        return figure


def snapshots_panels(flight: Flight) -> Figure:
    """The twelve instants of Fig. 11 one by one, in m, where one picture would be too crowded."""
    samples = _instants(flight)
    box = bounds(flight, samples)
    with style():
        figure = Figure(figsize=(FULL, 5.8))
        colours = _colours(samples)
        first = _panel(figure, flight, box, samples[0], colours[0])
        left, bottom, width, height = add_legend(first, flight)
        width, height = width / 4, height / 3
        # Scene and view are the same in all, so that what fits one fits all.
        fit(first, left, bottom, width, 0.92 * height)
        fitting = first.get_position(original=True)
        others = [
            _panel(figure, flight, box, sample, colour)
            for sample, colour in zip(samples[1:], colours[1:], strict=True)
        ]
        for place, (axes, sample) in enumerate(zip([first, *others], samples, strict=True)):
            row, column = divmod(place, 4)
            x, y = column * width, (2 - row) * height
            axes.set_position(fitting.translated(x, y))
            top = bottom + y + 0.92 * height
            figure.text(left + x + 0.02, top, f"{flight.time[sample]:.1f} s")
        # Makes the ticks while the style is ours.
        figure.draw_without_rendering()
        return figure


def _panel(
    figure: Figure, flight: Flight, box: tuple[Array, Array], sample: int, colour: Array
) -> Any:
    """Small axes with the machine at a sample, and its paths so far."""
    axes: Any = figure.add_subplot(projection="3d")
    set_scene(axes, box, ticks=4)
    PathDrawing(axes, flight, scale=0.6).show(sample)
    MachineDrawing(axes, flight, colour=colour, scale=0.6).show(sample)
    axes.tick_params(labelsize=6, pad=-3)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.labelpad = -9
        axis.label.set_fontsize(6.5)
    return axes


def _instants(flight: Flight) -> list[int]:
    """Twelve samples evenly spread over a flight, or all of them if it has fewer."""
    times = np.linspace(flight.time[0], flight.time[-1], INSTANTS)
    return sorted(set(samples_at(flight, times)))


def _colours(samples: list[int]) -> Array:
    """Colours (s, 4) from dark to as light as still reads on white."""
    colours: Array = colormaps["viridis"](np.linspace(0.0, 0.75, len(samples)))
    return colours


def _clearest_view(centres: Array, box: tuple[Array, Array]) -> tuple[float, float]:
    """The view of a box in which machines at `centres` (s, 3) stand best apart, as charges would.

    Apart on paper: a view that lets the box be drawn larger is better.
    """

    def crowd(view: tuple[float, float]) -> float:
        flat = _scale(box, view) * centres @ _seen_from(view)[:2].T
        square = np.sum((flat[:, np.newaxis] - flat) ** 2, axis=2)
        return float(np.sum(1.0 / (square + 1e-2)))

    return min(_VIEWS, key=crowd)


def _scale(box: tuple[Array, Array], view: tuple[float, float]) -> float:
    """How large a box can be drawn, in/m."""
    return float(np.min(_LARGEST / _extent(box, view)))


def _extent(box: tuple[Array, Array], view: tuple[float, float]) -> Array:
    """Width and height (2) of a box, given by lowest and highest coordinates, in a view, m."""
    corners = np.array(list(itertools.product(*np.transpose(box))))
    extent: Array = np.ptp(corners @ _seen_from(view)[:2].T, axis=0)
    return extent


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
