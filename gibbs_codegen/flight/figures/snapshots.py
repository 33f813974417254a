"""The paper's Fig. 11: the robot at some instants of its flight."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from gibbs_codegen.figures.appearance import COLOURS, DARK, PATHS, VIEW, disc_corners, seen_from
from gibbs_codegen.figures.robot_artists import RobotArtists, Shapes
from gibbs_codegen.figures.scene import extent, fit, hide_numbers, place_labels, project, set_scene
from gibbs_codegen.figures.style import FULL, lay_out, new_figure, style
from gibbs_codegen.flight.figures.curves import add_legend
from gibbs_codegen.flight.record.extent import (
    bounds,
    led_points,
    rotor_radius,
    samples_at,
    thrust_directions,
    usual_size,
)
from gibbs_codegen.flight.record.flight import Array, Flight
from gibbs_codegen.flight.record.series import wheel_marks
from gibbs_codegen.flight.scenario.walls import patches

_PATH_LEVELS = (3, 4)
# In one picture; and in panels, of which more would be too small to show the robot.
INSTANTS, _PANELS = 12, 6
# Width and height of the largest box that is drawn, and what labels around it take, in.
_LARGEST, _AROUND = np.array([FULL - 0.7, 5.0]), np.array([0.7, 1.0])
# Panels: possible columns; height of all; heading and legend, a time, a gap; and what numbers at
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
# Instants that differ by less, as a share of the picture, are one in it.
_SAME_PLACE = 0.005
# The room that labels keep clear around them, and their largest distance from a robot; points.
_MARGIN = 2.0
# The cost of a point of distance, in points of the drawing that are covered.
_DISTANCE = 0.03
# Points of the base's path, which labels had better not cover.
_PATH_POINTS = 200
_LABEL_DISTANCES = (24.0, 32.0, 42.0, 54.0, 68.0, 84.0, 102.0, 122.0)
# Above robots.
_LEVEL = 50
# The longest arrow, in radii of a rotor; length and half the width of a head, in its length.
LONGEST, _ARROW_HEAD = 4.0, np.array([0.15, 0.06])
_WALL = "#8a6d3b"


class RobotDrawing:
    """Artists of the robot of a flight in 3-D axes, one base arm in gold.

    The gold arm is `tangent_arm`, or arm 2 if no arm is tangent to the path; a base without arms
    has none. Every rotor is a disc normal to its thrust. A robot of higher `rank` covers those of
    lower rank; `colour` is the manipulator's; `scale` multiplies the widths of lines.
    """

    def __init__(
        self, axes: Any, flight: Flight, rank: int = 0, colour: Any = "0.4", scale: float = 1.0
    ) -> None:
        self._flight = flight
        self._gold = (flight.tangent_arm or 2) if len(flight.base_arm_angles_desired) else 0
        self._rotors = [flight.points.index(name) for name in flight.rotor_points]
        self._arms = arm_lines(flight)
        self._radius = rotor_radius(flight)
        self._artists = RobotArtists(axes, self._shapes(0), rank, colour, scale)
        if rank == 0:
            gold = f"base arm {self._gold}" if self._gold else ""
            self._artists.name(gold, ("arm" if len(self._arms) == 1 else "arms") * bool(self._arms))

    def show(self, sample: int) -> None:
        """Put the artists where the robot is at a sample."""
        self._artists.show(self._shapes(sample))

    def outline(self, sample: int) -> Array:
        """Positions (p, 3) in the world, m, that are spread over all that is drawn of the robot."""
        return self._shapes(sample).outline()

    def _shapes(self, sample: int) -> Shapes:
        flight = self._flight
        at, rotors = flight.positions[sample], self._rotors
        ends = [at[[rotor, flight.parents[rotor]]] for rotor in rotors]
        gold = ends.pop(self._gold - 1)[::-1] if self._gold else np.zeros((0, 3))
        discs = disc_corners(thrust_directions(flight, sample), self._radius)
        turned: Array = discs @ flight.base_rotation[sample].T
        arms = [at[line] for line in self._arms]
        hubs = at[[flight.points.index(name) for name in flight.wheel_points]]
        marks = wheel_marks(flight, flight.q[sample])
        radii = np.linalg.norm(marks[:, [1]], axis=-1, keepdims=True)
        rims = radii * disc_corners(marks[:, 0], 1.0)
        ends += [np.stack([hub + x, hub - x]) for hub, x in zip(hubs, marks[:, 1], strict=True)]
        discs = np.concatenate([turned + at[rotors][:, np.newaxis], rims + hubs[:, np.newaxis]])
        return Shapes(ends, gold, arms, discs)


class PathDrawing:
    """Artists of the paths of base centre and tip: the desired ones whole, the actual ones so far.

    What is not led is left out. `scale` multiplies the widths of lines.
    """

    def __init__(self, axes: Any, flight: Flight, desired: str = DARK, scale: float = 1.0) -> None:
        below, above = _PATH_LEVELS
        self._actual = []
        for label, led in led_points(flight).items():
            look = {"color": PATHS[label], "lw": 1.6 * scale, "label": label}
            (line,) = axes.plot([], [], [], zorder=below, **look)
            (dashes,) = axes.plot(
                *led.desired.T, color=desired, lw=0.7 * scale, dashes=(4, 3), zorder=above
            )
            self._actual.append((line, led.path))
        dashes.set_label("desired")

    def show(self, sample: int) -> None:
        """Draw the actual paths from the start to a sample."""
        for line, path in self._actual:
            line.set_data_3d(*path[: sample + 1].T)


def arm_lines(flight: Flight) -> list[list[int]]:
    """Numbers of the points of each line along the arms.

    They lead from the base centre, or where one arm leaves another, along joints to a frame on the
    last link.
    """
    first = flight.points.index(flight.rotor_points[-1]) + 1 if flight.rotors else 1
    lines: list[list[int]] = []
    for point, parent in enumerate(flight.parents.tolist()):
        if point < first or parent < 0:
            continue
        before = next((line for line in lines if line[-1] == parent), None)
        if before is None:
            lines.append([parent, point])
        else:
            before.append(point)
    return lines


def snapshots(flight: Flight) -> Figure:
    """Draw the paper's Fig. 11: the robot at twelve instants along the paths of centre and tip, m.

    Base arm `tangent_arm` (2 if no arm is tangent to the path) is gold, rotors are discs normal to
    their thrusts, arms go from dark to light with time. Labels are times in s.
    """
    instants = _instants(flight, INSTANTS)
    box = bounds(flight, instants)
    labels = _labels(flight, instants, _SAME_PLACE * float(np.max(box[1] - box[0])))
    samples = list(labels)
    path = _first_path(flight)
    centres = path[samples]
    view = _clearest_view(centres, box)
    with style():
        figure = new_figure(*_scale(box, view) * extent(box, view) + _AROUND)
        axes: Any = figure.add_subplot(projection="3d")
        set_scene(axes, box, view)
        _draw_walls(axes, flight, box)
        PathDrawing(axes, flight).show(instants[-1])
        # From dark to as light as still reads on white.
        colours = _SHADES(np.linspace(0.0, 0.75, len(samples)))
        outlines = []
        for rank, place in enumerate(np.argsort(centres @ seen_from(view)[2])):
            robot = RobotDrawing(axes, flight, rank, colours[place], scale=0.9)
            robot.show(samples[place])
            outlines.append(robot.outline(samples[place]))
        outlines.append(path[:: len(flight.time) // _PATH_POINTS + 1])
        fit(axes, *add_legend(axes, flight))
        _write_times(axes, centres, list(labels.values()), colours, np.concatenate(outlines))
        return figure


def snapshots_panels(flight: Flight) -> Figure:
    """Draw six instants of Fig. 11 one by one, m, as one picture may be too crowded.

    The panels have the same axes, whose numbers stand at one of them.
    """
    samples = _instants(flight, _PANELS)
    box = bounds(flight, samples)
    view = _clearest_view(_first_path(flight)[samples], box)
    scene = extent(box, view)
    rooms = {}  # Sizes of panels, in, of each division, by the scale of its scene, in/m.
    for columns in _COLUMNS:
        room = np.array([(FULL - _NUMBERS[0]) / columns, _TALLEST / -(-len(samples) // columns)])
        scale = float(np.min((room - (_GAP, _TIME)) / scene))
        rooms[scale] = columns, np.array([room[0], scale * scene[1] + _TIME])
    columns, cell = rooms[max(rooms)]
    rows = -(-len(samples) // columns)
    with style():
        figure = new_figure(FULL, _HEAD + rows * cell[1] + _NUMBERS[1])
        size = figure.get_size_inches()
        panels: list[Any] = []
        for sample in samples:
            axes: Any = figure.add_subplot(projection="3d")
            set_scene(axes, box, view, ticks=4)
            _draw_walls(axes, flight, box)
            PathDrawing(axes, flight, scale=0.6).show(sample)
            RobotDrawing(axes, flight, colour=_SHADES(0.0), scale=0.7).show(sample)
            axes.tick_params(pad=-2)
            for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
                axis.labelpad = -5.0 if axis is axes.zaxis else -1.5
            panels.append(axes)
        add_legend(panels[0], flight)
        # Whether the numbers of the z axis are on the left of a scene.
        place_labels(panels[0])
        heights, lengths = (x.get_tightbbox() for x in (panels[0].zaxis, panels[0].xaxis))
        on_left = bool(heights.x1 < lengths.x1)
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
        lay_out(figure)
        return figure


def _draw_walls(axes: Any, flight: Flight, box: tuple[Array, Array]) -> None:
    """Draw the walls within a box, m, behind all else."""
    low, high = box
    reach = float(np.linalg.norm(high - low))
    walls = patches(flight.wall_kinds, flight.walls, 0.5 * (low + high), reach)
    for rank, patch in enumerate(walls):
        corners = patch[:-1, :-1], patch[1:, :-1], patch[1:, 1:], patch[:-1, 1:]
        faces = np.stack(corners, axis=2).reshape(-1, 4, 3)
        rings = [ring for face in faces if len(ring := _clipped(face, low, high))]
        if not rings:
            continue
        axes.add_collection3d(Poly3DCollection(rings, facecolor=_WALL, alpha=0.25, zorder=-1))
        edges = [np.vstack([ring, ring[:1], np.full((1, 3), np.nan)]) for ring in rings]
        label = None if rank else "wall"
        axes.plot(*np.vstack(edges)[:-1].T, color=_WALL, linewidth=0.8, label=label, zorder=-1)


def _first_path(flight: Flight) -> Array:
    """The path (s, 3), m, of the first led frame, which distinguishes instants."""
    return next(iter(led_points(flight).values())).path


def _instants(flight: Flight, count: int) -> list[int]:
    """Samples evenly spread over a flight, so many or all of them if it has fewer."""
    times = np.linspace(flight.time[0], flight.time[-1], count)
    return sorted(set(samples_at(flight, times)))


def _labels(flight: Flight, samples: list[int], near: float) -> dict[int, str]:
    """Labels of the samples that are drawn: one for those nearer than `near`, m, at the first."""
    times_at: dict[int, list[str]] = {}
    for sample in samples:
        away = np.abs(flight.positions[[*times_at]] - flight.positions[sample]).max(axis=(1, 2))
        first = next(itertools.compress(times_at, away < near), sample)
        times_at.setdefault(first, []).append(f"{flight.time[sample]:.1f}")
    return {
        first: (", ".join(times) if len(times) < 3 else f"{times[0]} … {times[-1]}") + " s"
        for first, times in times_at.items()
    }


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
    """The scale of a box on the page, in/m."""
    return float(np.min(_LARGEST / extent(box, view)))


def _write_times(
    axes: Any, centres: Array, labels: list[str], colours: Array, outline: Array
) -> None:
    """Write the time beside each robot, where it covers least of all of them.

    `centres` (s, 3), m, are where it is led, and labels had better not cover `outline` (p, 3),
    m, points of robots and their path.
    """

    def on_paper(points: Array) -> Array:
        """Places (…, 2) on the figure, in points, of points (…, 3) of the world."""
        return axes.transData.transform(project(axes, points)) * 72.0 / axes.figure.dpi

    # Places the axes where they will be drawn.
    axes.apply_aspect()
    covered = on_paper(outline)
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
        crowd = _cover(places, covered, half) + _DISTANCE * np.hypot(*offsets.T)
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
    away = [np.abs(np.subtract.outer(places[:, k], points[:, k])) / reach[..., k] for k in (0, 1)]
    covered: Array = np.maximum(0.0, 1.0 - np.maximum(*away)).sum(axis=1)
    return covered


class ThrustArrows:
    """Arrows in 3-D axes of the usual view along the thrusts, as long as these are large.

    Peaks do not count; `scale` multiplies the widths of lines.
    """

    def __init__(self, axes: Any, flight: Flight, scale: float = 1.0) -> None:
        self._flight = flight
        thrusts = flight.applied[:, : flight.rotors]
        self.reach = LONGEST * rotor_radius(flight)
        self._lengths = self.reach * np.clip(thrusts / (usual_size(thrusts) or 1.0), -1.0, 1.0)
        self._rotors = [flight.points.index(name) for name in flight.rotor_points]
        (self._line,) = axes.plot(
            [], [], [], color=COLOURS[3], linewidth=1.3 * scale, zorder=_LEVEL, label="thrust"
        )

    def show(self, sample: int) -> None:
        """Put the arrows where the rotors are at a sample."""
        flight = self._flight
        along = thrust_directions(flight, sample) @ flight.base_rotation[sample].T
        arrows = self._lengths[sample][:, np.newaxis] * along
        starts = flight.positions[sample][self._rotors]
        tips = starts + arrows
        # The barbs lie as they are seen best, across the line of sight.
        across = np.cross(along, seen_from(VIEW)[2])
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        # A thrust of zero has no head either.
        sizes = np.clip(
            self._lengths[sample], -_ARROW_HEAD[0] * self.reach, _ARROW_HEAD[0] * self.reach
        )
        back = tips - sizes[:, np.newaxis] * along
        aside = _ARROW_HEAD[1] / _ARROW_HEAD[0] * sizes[:, np.newaxis] * across
        gap = np.full_like(tips, np.nan)
        points: Array = np.stack([starts, tips, back + aside, tips, back - aside, gap], axis=1)
        self._line.set_data_3d(*points.reshape(-1, 3).T)


def _clipped(polygon: Array, low: Array, high: Array) -> Array:
    """The part of a convex polygon (k, 3) in a box from lowest to highest coordinates (3)."""
    for axis, side in itertools.product(range(3), (1.0, -1.0)):
        heights = side * (polygon[:, axis] - (low if side > 0.0 else high)[axis])
        kept = []
        for k, (end, height) in enumerate(zip(polygon, heights, strict=True)):
            start, before = polygon[k - 1], heights[k - 1]
            if height * before < 0.0:
                kept.append(start + before / (before - height) * (end - start))
            if height >= 0.0:
                kept.append(end)
        polygon = np.reshape(kept, (-1, 3))
    return polygon
