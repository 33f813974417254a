"""The forces and the torques that rotors can produce around those of hovering."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from gibbs_codegen.analysis.polytope import Polytope
from gibbs_codegen.analysis.reach import ReachableWrenches
from gibbs_codegen.errors import UsageError
from gibbs_codegen.figures.scene import fit, set_scene
from gibbs_codegen.figures.style import COLOURS, DARK, FULL, style
from gibbs_codegen.robot.placement import Array

_INSIDE, _MARGIN = COLOURS[0], COLOURS[1]
# Share of the set's extent within which a vertex is on a facet; share of the longest side that a
# flat scene has across.
_ON_FACET, _DEPTH = 1e-6, 0.4


def reachable_wrenches_figure(found: ReachableWrenches) -> Figure:
    """Draw the forces that leave the torque of hovering as it is, and the torques likewise.

    A bold dot is hovering, and a line through it along each axis is how far that component reaches
    by itself. Underactuated bases have sets that are flat, or a line.

    Args:
        found: The wrenches of a robot, as `reachable_wrenches` has them.

    Returns:
        The figure.

    Raises:
        UsageError: No thrusts within the limits hover.
    """
    if found.margins is None:
        raise UsageError(f"{found.robot}: no thrusts within the limits hover")
    panels = (
        ("forces, with the torque of hovering", "$F_{0}$ (N)", found.forces, slice(0, 3)),
        ("torques, with the force of hovering", "$M_{0}$ (N m)", found.torques, slice(3, 6)),
    )
    with style():
        figure = Figure(figsize=(FULL, 3.7))
        figure.suptitle(
            f"{found.robot}, about {found.about}, in the base's axes",
            color="0.35",
            parse_math=False,
        )
        for column, (title, label, shape, part) in enumerate(panels):
            axes: Any = figure.add_subplot(1, 2, column + 1, projection="3d")
            hover, margins = found.hover[part], found.margins[part]
            labels = [label.format(axis) for axis in "xyz"]
            set_scene(axes, _bounds(shape.vertices), ticks=5, labels=labels)
            _draw(axes, shape, hover, margins)
            left = 0.5 * column
            figure.text(left + 0.25, 0.9, title, ha="center", weight="bold")
            fit(axes, left + 0.02, 0.08, 0.46, 0.8)
        handles, names = axes.get_legend_handles_labels()
        figure.legend(handles, names, loc="lower center", ncols=len(names))
        figure.draw_without_rendering()
        return figure


def _draw(axes: Any, shape: Polytope, hover: Array, margins: Array) -> None:
    """Draw a set of 3 dimensions with hovering (3) in it.

    `margins` (3, 2) are how far each component reaches down and up from that.
    """
    faces = Poly3DCollection(_faces(shape), facecolors=(_INSIDE, 0.12), edgecolors=(_INSIDE, 0.7))
    faces.set(linewidth=0.8, label="within the thrusts' limits")
    axes.add_collection3d(faces)
    for axis, (down, up) in zip(np.eye(3), margins, strict=True):
        ends = np.array([hover - down * axis, hover + up * axis])
        label = "margins at hover" if axis[2] else None
        axes.plot(*ends.T, color=_MARGIN, lw=1.6, label=label, zorder=5)
    axes.plot(*hover[:, np.newaxis], "o", color=DARK, ms=4.5, label="hover", zorder=6)


def _faces(shape: Polytope) -> list[Array]:
    """The polygons (k, 3) that bound a set; a flat one is a polygon itself."""
    if shape.basis.shape[1] < 3:
        return [_ring(shape.vertices)]
    reach = _ON_FACET * float(np.ptp(shape.vertices, axis=0).max())
    away = np.abs(shape.vertices @ shape.normals.T - shape.offsets)
    return [_ring(shape.vertices[distance <= reach]) for distance in away.T]


def _ring(corners: Array) -> Array:
    """The corners (k, 3) of a flat convex polygon in the order in which they follow each other."""
    around = corners - corners.mean(axis=0)
    plane = np.linalg.svd(around)[2][:2]
    x, y = plane @ around.T
    return corners[np.argsort(np.arctan2(y, x))]


def _bounds(vertices: Array) -> tuple[Array, Array]:
    """Lowest and highest entries with room around, never flat."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = high - low
    half = 0.54 * np.maximum(extent, _DEPTH * extent.max() or 1.0)
    return (low + high) / 2.0 - half, (low + high) / 2.0 + half
