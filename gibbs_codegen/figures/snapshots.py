"""The paper's Fig. 11: the robot at some instants of its flight."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.text import Text

from gibbs_codegen.figures.robot_drawing import PathDrawing, RobotDrawing, bounds, samples_at
from gibbs_codegen.figures.scene import (
    VIEW,
    draw_plane,
    extent,
    fit,
    hide_numbers,
    project,
    seen_from,
    set_scene,
)
from gibbs_codegen.figures.style import FULL, add_legend, style
from gibbs_codegen.simulator.record.flight import Array, Flight

# In one picture; and in panels, of which more would be too small to show the robot.
INSTANTS, _PANELS = 12, 6
# Width and height of the largest box that is drawn, and what labels around it take, in.
_LARGEST, _AROUND = np.array([FULL - 0.7, 5.0]), np.array([0.7, 1.0])
# Of panels: possible columns; height of all; heading and legend, a time, a gap; and what numbers at
# one of them take on one side and below, in.
_COLUMNS, _TALLEST = (2, 3, 6), 6.0
_HEAD, _TIME, _GAP, _NUMBERS = 0.6, 0.25, 0.08, np.array([0.4, 0.45])
# Not along an axis, which would hide what it measures.
_AZIMUTHS = [quarter + turn for quarter in (-90, 0, -180, 90) for turn in range(20, 75, 5)]
_VIEWS: list[tuple[float, float]] = [VIEW, *itertools.product((15.0, 20.0, 25.0, 30.0), _AZIMUTHS)]
# Colours of arms.
_SHADES = colormaps["viridis"]
# Above every robot.
_LABEL_LEVEL = 1000
# Instants that differ by less, in m, are one in the picture.
_SAME_PLACE = 0.02
# What labels keep clear around them, and how far from a robot they may be; points.
_MARGIN = 2.0
# What a point of distance counts, against a point of the drawing that is covered.
_DISTANCE = 0.03
# Of the base's path, which labels had better not cover.
_PATH_POINTS = 200
_LABEL_DISTANCES = (24.0, 32.0, 42.0, 54.0, 68.0, 84.0, 102.0, 122.0)


def snapshots(flight: Flight) -> Figure:
    """Draw the paper's Fig. 11: the robot at twelve instants along the paths of centre and tip, m.

    Base arm `tangent_arm` (2 if no arm is tangent to the path) is gold, rotors are discs normal to
    their thrusts, arms go from dark to light with time. Labels are times in s.
    """
    instants = _instants(flight, INSTANTS)
    labels = _labels(flight, instants)
    samples = list(labels)
    centres = flight.point(flight.centre)[samples]
    box = bounds(flight, samples)
    view = _clearest_view(centres, box)
    with style():
        figure = Figure(figsize=_scale(box, view) * extent(box, view) + _AROUND)
        axes: Any = figure.add_subplot(projection="3d")
        set_scene(axes, box, view)
        _draw_walls(axes, flight, box)
        PathDrawing(axes, flight).show(instants[-1])
        colours = _colours(samples)
        outlines = []
        for rank, place in enumerate(np.argsort(centres @ seen_from(view)[2])):
            robot = RobotDrawing(axes, flight, rank, colours[place], scale=0.9)
            robot.show(samples[place])
            outlines.append(robot.outline(samples[place]))
        outlines.append(flight.point(flight.centre)[:: len(flight.time) // _PATH_POINTS + 1])
        fit(axes, *add_legend(axes, flight))
        _write_times(axes, centres, list(labels.values()), colours, np.concatenate(outlines))
        return figure


def snapshots_panels(flight: Flight) -> Figure:
    """Draw six instants of Fig. 11 one by one, m, as one picture may be too crowded.

    The panels have the same axes, whose numbers stand at one of them.
    """
    samples = _instants(flight, _PANELS)
    box = bounds(flight, samples)
    view = _clearest_view(flight.point(flight.centre)[samples], box)
    columns, cell = _division(len(samples), extent(box, view))
    rows = -(-len(samples) // columns)
    with style():
        figure = Figure(figsize=(FULL, _HEAD + rows * cell[1] + _NUMBERS[1]))
        size = figure.get_size_inches()
        panels = [_panel(figure, flight, (box, view), sample) for sample in samples]
        add_legend(panels[0], flight)
        on_left = _has_height_on_left(panels[0])
        numbered = panels[columns * (rows - 1) if on_left else -1]
        others = [axes for axes in panels if axes is not numbered]
        for axes in others:
            hide_numbers(axes)
        corner = np.array([_NUMBERS[0] * on_left, _NUMBERS[1]])
        # Scene and view are the same in all, so that what fits one fits all.
        fit(*(others or panels)[:1], *(corner / size), *((cell - (_GAP, _TIME)) / size))
        fitting = (others or panels)[0].get_position(original=True)
        for place, (axes, sample) in enumerate(zip(panels, samples, strict=True)):
            row, column = divmod(place, columns)
            shift = np.array([column, rows - 1 - row]) * cell
            axes.set_position(fitting.translated(*(shift / size)))
            x, y = (corner + shift + (_GAP, cell[1] - 0.5 * _TIME)) / size
            figure.text(x, y, f"{flight.time[sample]:.1f} s", verticalalignment="center")
        # Makes the ticks while the style is ours.
        figure.draw_without_rendering()
        return figure


def _division(panels: int, scene: Array) -> tuple[int, Array]:
    """Columns for so many panels on a page, with the scene largest, and a panel's size (2), in.

    `scene` is width and height (2) of the scene, m; a panel has its time, too.
    """
    rooms = {}
    for columns in _COLUMNS:
        room = np.array([(FULL - _NUMBERS[0]) / columns, _TALLEST / -(-panels // columns)])
        scale = float(np.min((room - (_GAP, _TIME)) / scene))
        rooms[scale] = columns, np.array([room[0], scale * scene[1] + _TIME])
    return rooms[max(rooms)]


def _has_height_on_left(axes: Any) -> bool:
    """Whether the numbers of the z axis are on the left of a scene."""
    axes.figure.draw_without_rendering()
    heights, lengths = axes.zaxis.get_tightbbox(), axes.xaxis.get_tightbbox()
    return bool(heights.x1 < lengths.x1)


def _panel(
    figure: Figure,
    flight: Flight,
    scene: tuple[tuple[Array, Array], tuple[float, float]],
    sample: int,
) -> Any:
    """Draw the robot at a sample, and its paths so far, in small 3-D axes.

    `scene` has the lowest and highest coordinates (3) each, m, and the view.
    """
    axes: Any = figure.add_subplot(projection="3d")
    set_scene(axes, *scene, ticks=4)
    _draw_walls(axes, flight, scene[0])
    PathDrawing(axes, flight, scale=0.6).show(sample)
    RobotDrawing(axes, flight, colour=_SHADES(0.0), scale=0.7).show(sample)
    axes.tick_params(pad=-2)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.labelpad = -5.0 if axis is axes.zaxis else -1.5
    return axes


def _draw_walls(axes: Any, flight: Flight, box: tuple[Array, Array]) -> None:
    """Draw the walls within a box, m."""
    for rank, wall in enumerate(flight.walls):
        draw_plane(axes, box, wall[:3], wall[3:], "" if rank else "wall")


def _instants(flight: Flight, count: int) -> list[int]:
    """Samples evenly spread over a flight, so many or all of them if it has fewer."""
    times = np.linspace(flight.time[0], flight.time[-1], count)
    return sorted(set(samples_at(flight, times)))


def _labels(flight: Flight, samples: list[int]) -> dict[int, str]:
    """Labels of the samples that are drawn: one for those in the same place, at the first."""
    together: dict[int, list[str]] = {}
    for sample in samples:
        apart = np.abs(flight.positions[samples] - flight.positions[sample]).max(axis=(1, 2))
        first = samples[int(np.argmax(apart < _SAME_PLACE))]
        together.setdefault(first, []).append(f"{flight.time[sample]:.1f}")
    return {
        first: (", ".join(times) if len(times) < 3 else f"{times[0]} … {times[-1]}") + " s"
        for first, times in together.items()
    }


def _colours(samples: list[int]) -> Array:
    """Colours (s, 4) from dark to as light as still reads on white."""
    colours: Array = _SHADES(np.linspace(0.0, 0.75, len(samples)))
    return colours


def _clearest_view(centres: Array, box: tuple[Array, Array]) -> tuple[float, float]:
    """The view of a box in which robots at `centres` (s, 3) stand best apart, as charges would.

    Apart on paper: a view that lets the box be drawn larger is better.
    """

    def crowd(view: tuple[float, float]) -> float:
        flat = _scale(box, view) * centres @ seen_from(view)[:2].T
        square = np.sum((flat[:, np.newaxis] - flat) ** 2, axis=2)
        return float(np.sum(1.0 / (square + 1e-2)))

    return min(_VIEWS, key=crowd)


def _scale(box: tuple[Array, Array], view: tuple[float, float]) -> float:
    """How large a box can be drawn, in/m."""
    return float(np.min(_LARGEST / extent(box, view)))


def _write_times(
    axes: Any, centres: Array, labels: list[str], colours: Array, outline: Array
) -> None:
    """Write the time beside each robot, where it covers least of all of them.

    `centres` (s, 3), m, are those of the bases, and labels had better not cover `outline` (p, 3),
    m, points of robots and their path.
    """

    def on_paper(points: Array) -> Array:
        """Where points (…, 3) of the world are on the figure (…, 2), in points."""
        places: Array = axes.transData.transform(project(axes, points)) * 72.0 / axes.figure.dpi
        return places

    # Places the axes where they will be drawn.
    axes.apply_aspect()
    taken = on_paper(outline)
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    offsets = np.concatenate([distance * circle for distance in _LABEL_DISTANCES])
    written, halves = np.empty((0, 2)), np.empty((0, 2))
    low, high = (20.0, 10.0), axes.figure.get_size_inches() * 72.0 - (20.0, 30.0)
    for centre, label, colour in zip(centres, labels, colours, strict=True):
        name = axes.annotate(
            label,
            xy=project(axes, centre),
            xytext=(0.0, 0.0),
            textcoords="offset points",
            color=colour,
            horizontalalignment="center",
            verticalalignment="center",
            arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.5, "shrinkA": 0, "shrinkB": 2},
            path_effects=[withStroke(linewidth=1.5, foreground="white")],
            zorder=_LABEL_LEVEL,
        )
        # Without the line from it to the robot.
        size = np.array(Text.get_window_extent(name).size) * 72.0 / axes.figure.dpi
        half = size / 2.0 + _MARGIN
        places = on_paper(centre) + offsets
        crowd = _cover(places, taken, half) + _DISTANCE * np.hypot(*offsets.T)
        # Off the paper, or over another label.
        crowd[np.any((places - half < low) | (places + half > high), axis=1)] += 1e3
        crowd[_cover(places, written, half + halves) > 0.0] += 1e3
        best = int(crowd.argmin())
        name.set_position(tuple(offsets[best]))
        written, halves = np.vstack([written, places[best]]), np.vstack([halves, half])


def _cover(places: Array, points: Array, reach: Array) -> Array:
    """Measure (k) of how much labels at places (k, 2) would cover, 0 for none.

    `points` (p, 2) might be covered by a label within `reach`, (2) or (p, 2).
    """
    near = (np.abs(places[:, np.newaxis] - points) / reach).max(axis=2)
    cover: Array = np.maximum(0.0, 1.0 - near).sum(axis=1)
    return cover
