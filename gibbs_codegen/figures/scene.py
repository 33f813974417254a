"""3-D axes of a drawing: equal units, a view, the place in a figure, and points on paper."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator, MultipleLocator, NullFormatter
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from gibbs_codegen.robot.placement import Array
from gibbs_codegen.scenario.paths import plane

# Elevation above the horizon and azimuth from which a robot looks like one, degrees.
VIEW = (22.0, -62.0)
_WALL = "#8a6d3b"
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
    corners = np.array(list(itertools.product(*(getattr(axes, f"get_{n}lim")() for n in "xyz"))))
    room = np.array([width, height])
    middle = np.array([left, bottom]) + room / 2.0
    axes.set_position((left, bottom, width, height))
    # Labels do not grow with the box, so that one step is not enough.
    for _ in range(4):
        axes.figure.draw_without_rendering()
        axis_boxes = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
        labels = [box for box in axis_boxes if box is not None]
        pixels = np.concatenate([axes.transData.transform(project(axes, corners)), *labels])
        drawn = axes.figure.transFigure.inverted().transform(pixels)
        low, high = drawn.min(axis=0), drawn.max(axis=0)
        place = axes.get_position(original=True)
        scale = float(np.min(room / (high - low)))
        origin = middle + scale * (place.p0 - (low + high) / 2.0)
        axes.set_position((*origin, *(scale * place.size)))
    # Where the scene is drawn, of a wide rectangle only a part, and where names find their places.
    axes.apply_aspect()


def draw_plane(
    axes: Any, box: tuple[Array, Array], point: Array, normal: Array, label: str
) -> None:
    """Draw as much of a plane as is in a box, behind all else.

    `box` has the lowest and highest coordinates (3); the plane's normal (3) may have any length.
    """
    corners = np.array(list(itertools.product(*np.transpose(box))))
    across = np.array(plane(normal))
    heights = (corners - point) @ normal
    # An edge joins corners that differ in one coordinate, and crosses the plane or does not.
    crossings = [
        corners[i] + heights[i] / (heights[i] - heights[j]) * (corners[j] - corners[i])
        for i, j in itertools.combinations(range(8), 2)
        if (i ^ j) in (1, 2, 4) and heights[i] * heights[j] < 0.0
    ]
    if not crossings:
        return
    flat = (np.array(crossings) - np.mean(crossings, axis=0)) @ across.T
    ring = np.array(crossings)[np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))]
    axes.add_collection3d(Poly3DCollection([ring], facecolor=_WALL, alpha=0.25, zorder=-1))
    edge = np.vstack([ring, ring[:1]]).T
    axes.plot(*edge, color=_WALL, linewidth=0.8, label=label or None, zorder=-1)


def project(axes: Any, points: Array) -> Array:
    """Positions (…, 2), in data units of the axes, of points (…, 3) of a scene on their plane."""
    matrix = axes.get_proj()
    flat: Array = (points @ matrix[:2, :3].T + matrix[:2, 3]) / matrix[3, 3]
    return flat


def extent(box: tuple[Array, Array], view: tuple[float, float]) -> Array:
    """Width and height (2) of a box as it is seen at elevation and azimuth, degrees."""
    corners = np.array(list(itertools.product(*np.transpose(box))))
    found: Array = np.ptp(corners @ seen_from(view)[:2].T, axis=0)
    return found


def seen_from(view: tuple[float, float]) -> Array:
    """Axes of a view at elevation and azimuth, degrees.

    Unit vectors (3, 3), by rows: to the right, upwards, and towards the eye.
    """
    (sin_e, sin_a), (cos_e, cos_a) = np.sin(np.radians(view)), np.cos(np.radians(view))
    return np.array(
        [
            [-sin_a, cos_a, 0.0],
            [-sin_e * cos_a, -sin_e * sin_a, cos_e],
            [cos_e * cos_a, cos_e * sin_a, sin_e],
        ]
    )
