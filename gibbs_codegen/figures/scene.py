"""3-D axes of a drawing: equal units, a view, a place in a figure, and points and names there."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.text import Annotation, Text
from matplotlib.ticker import MaxNLocator, MultipleLocator, NullFormatter

from gibbs_codegen.figures.appearance import DARK, VIEW, seen_from
from gibbs_codegen.figures.marks import ABOVE_ALL, QUIET, draw_name
from gibbs_codegen.robot.rotations import Array

_METRES = ("$x$ (m)", "$y$ (m)", "$z$ (m)")


def set_scene(
    axes: Any,
    bounds: tuple[Array, Array],
    view: tuple[float, float] = VIEW,
    ticks: int = 8,
    labels: Sequence[str] = _METRES,
) -> float:
    """Give 3-D axes equal units, limits, a view and a grid of equal steps; return the step.

    `bounds` are the lowest and highest coordinates (3) each; `view` elevation above the horizon and
    azimuth, degrees; the longest axis has about `ticks` ticks at most.
    """
    low, high = bounds
    extent = high - low
    axes.computed_zorder = False
    # Neighbours would be hidden behind it.
    axes.patch.set_visible(False)
    steps = MaxNLocator(ticks, steps=[1, 2, 5, 10]).tick_values(0.0, extent.max())
    step = float(steps[1] - steps[0])
    for name, begin, end, label in zip("xyz", low, high, labels, strict=True):
        axes.set(**{f"{name}lim": (begin, end), f"{name}label": label})
        axis = getattr(axes, f"{name}axis")
        axis.set_major_locator(MultipleLocator(step))
        axis.labelpad = 0.0 if name == "z" else 3.0
    axes.tick_params(pad=0.5)
    axes.set_proj_type("ortho")
    axes.set_box_aspect(extent)
    axes.view_init(*view)
    return step


def hide_numbers(axes: Any) -> None:
    """Leave of the axes of a scene only its grid."""
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_formatter(NullFormatter())
        axis.set_label_text("")


def fit(axes: Any, left: float, bottom: float, width: float, height: float) -> None:
    """Make a scene, with its labels, as large as a rectangle, in shares of its figure, allows."""
    room = np.array([width, height])
    middle = np.array([left, bottom]) + room / 2.0
    # Labels do not grow with the box: edges are linear in its size, so that two sizes tell.
    first = _edges(axes, (left, bottom), room)
    size = np.min(room / (first[1] - first[0]))
    second = _edges(axes, middle - size * room / 2.0, size * room)
    slopes = (second - first) / (size - 1.0) if size != 1.0 else second
    more = np.min((room - second[1] + second[0]) / (slopes[1] - slopes[0]))
    origin = middle - (second + more * slopes).mean(axis=0)
    axes.set_position((*origin, *((size + more) * room)))
    # Where the scene is drawn, of a wide rectangle only a part, and where names find their places.
    axes.apply_aspect()


def _edges(axes: Any, origin: Sequence[float] | Array, size: Array) -> Array:
    """Lowest and highest places (2, 2), from the origin, of a scene in such a box with its labels.

    All are in shares of the figure.
    """
    axes.set_position((*origin, *size))
    place_labels(axes)
    corners = np.array(list(itertools.product(*(getattr(axes, f"get_{n}lim")() for n in "xyz"))))
    labels = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    pixels = np.concatenate(
        [axes.transData.transform(project(axes, corners)), *filter(None, labels)]
    )
    drawn = axes.figure.transFigure.inverted().transform(pixels)
    return np.array([drawn.min(axis=0), drawn.max(axis=0)]) - origin


def place_labels(axes: Any) -> None:
    """Put the labels of a scene where they will be drawn, without drawing anything else."""
    figure, axis_lines = axes.figure, (axes.xaxis, axes.yaxis, axes.zaxis)
    children = [*figure.get_children(), *axes.get_children()]
    hidden = [x for x in children if x.get_visible() and x not in (axes, figure.patch, *axis_lines)]
    for artist in hidden:
        artist.set_visible(False)
    figure.draw_without_rendering()
    for artist in hidden:
        artist.set_visible(True)


def project(axes: Any, points: Array) -> Array:
    """Positions (…, 2), in data units of the axes, of points (…, 3) of a scene on their plane."""
    matrix = axes.get_proj()
    return (points @ matrix[:2, :3].T + matrix[:2, 3]) / matrix[3, 3]


def extent(box: tuple[Array, Array], view: tuple[float, float]) -> Array:
    """Width and height (2) of a box as it is seen at elevation and azimuth, degrees."""
    corners = np.array(list(itertools.product(*np.transpose(box))))
    return np.ptp(corners @ seen_from(view)[:2].T, axis=0)


# How far a name may be from its place beyond touching it, points, and at which angles from the
# direction that is wanted, degrees.
_DISTANCES = (3.0, 8.0, 15.0, 24.0, 36.0)
_ANGLES = (0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180)
# Costs of lying on another name or on a fortieth of a line, and of being turned and far away.
_ON_NAME, _ON_LINE, _PER_DEGREE, _PER_POINT = 1000.0, 5.0, 0.1, 1.0
_POINTS_OF_A_LINE = 40
_ROOM = 1.5


@dataclass
class PlacedNames:
    """Names that are waiting for a place in 3-D axes whose place in the figure is settled."""

    axes: Any
    _wanted: list[tuple[Annotation, Array, Array]] = field(default_factory=list)
    _points: list[Array] = field(default_factory=list)
    _boxes: list[Array] = field(default_factory=list)

    def add(self, text: str, place: Array, away: Array, colour: str = DARK) -> None:
        """Ask for a name at a point (3) of the scene, off in the direction `away` (3)."""
        mark = draw_name(self.axes, text, project(self.axes, place), colour)
        at, there = self._on_page(np.array([place, place + away]))
        self._wanted.append((mark, at, there - at))

    def line(self, start: Array, end: Array) -> None:
        """Say that a line is drawn between points (3), which names should not lie on."""
        shares = np.linspace(0.0, 1.0, _POINTS_OF_A_LINE)[:, np.newaxis]
        self._points.append(self._on_page(start + shares * (end - start)))

    def mark(self, place: Array, size: float) -> None:
        """Say that a mark of a size in points is drawn, which names must not lie on."""
        (at,) = self._on_page(place[np.newaxis])
        self._boxes.append(np.array([at - size / 2.0, at + size / 2.0]))

    def settle(self) -> None:
        """Put every name where it hides least, those that were asked for first at first."""
        points = np.concatenate([*self._points, np.empty((0, 2))])
        for mark, at, away in self._wanted:
            extent = np.array(Text.get_window_extent(mark).size) * 72.0 / self.axes.figure.dpi
            length = float(np.hypot(*away))
            first = np.arctan2(away[1], away[0]) if length > 1e-6 else np.pi / 2.0
            options = [
                (self._cost(at, step, extent, points) + aside, distance, step)
                for distance in _DISTANCES
                for angle in _ANGLES
                for turn in [first + np.deg2rad(angle)]
                for direction in [np.array([np.cos(turn), np.sin(turn)])]
                # The middle of the name, whose box is at the distance.
                for step in [direction * (distance + np.abs(direction) @ extent / 2.0)]
                for aside in [_PER_DEGREE * abs(angle) + _PER_POINT * distance]
            ]
            _, distance, best = min(options, key=lambda option: option[0])
            mark.set_position((float(best[0]), float(best[1])))
            if distance > _DISTANCES[1]:  # A thin line leads from the place to the name.
                line = {"arrowstyle": "-", "color": QUIET, "lw": 0.6, "shrinkA": 0, "shrinkB": 0}
                self.axes.annotate(
                    *("", mark.xy, (float(best[0]), float(best[1]))),
                    textcoords="offset points",
                    arrowprops=line,
                    zorder=ABOVE_ALL - 1,
                )
            self._boxes.append(np.array([at + best - extent / 2.0, at + best + extent / 2.0]))

    def _cost(self, at: Array, step: Array, extent: Array, points: Array) -> float:
        """Cost of what a name would hide, in points of distance that are worth as much.

        All is in points: the place on the page that it names, the step (2) to its middle, its width
        and height, and points (k, 2) of lines.
        """
        low, high = at + step - extent / 2.0 - _ROOM, at + step + extent / 2.0 + _ROOM
        names = sum(np.all((low < box[1]) & (box[0] < high)) for box in self._boxes)
        on_lines = np.count_nonzero(np.all((points > low) & (points < high), axis=1))
        size = self.axes.figure.get_size_inches() * 72.0
        outside = np.any(low < 0.0) or np.any(high > size)
        return float(_ON_NAME * (names + outside) + _ON_LINE * on_lines)

    def _on_page(self, places: Array) -> Array:
        """Places (k, 2) on the page, in points, of points (k, 3) of the scene."""
        pixels = self.axes.transData.transform(project(self.axes, places))
        return pixels * 72.0 / self.axes.figure.dpi
