"""The looks of a robot in any picture: colours, the view, and the discs of its rotors."""

from __future__ import annotations

import numpy as np

from gibbs_codegen.robot.rotations import Array

# Colours of curves and chains that colour-blind eyes tell apart: Okabe and Ito (2008) without
# yellow and black, then four of Tol's muted colours.
COLOURS = (
    *("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00"),
    *("#332288", "#882255", "#999933", "#777777"),
)
# Those of paths of the points that are led.
PATHS = {"base centre": COLOURS[0], "tip": COLOURS[1]}
# Black and yellow of the same palette, the yellow darker for white paper.
DARK = "0.15"
GOLD = "#f2c200"
# Elevation above the horizon and azimuth from which a robot looks like one, degrees.
VIEW = (22.0, -62.0)
_DISC_CORNERS = 24
# As a share of the distance between motors: discs in one plane would touch at half of it.
_DISC_SHARE = 0.35


def seen_from(view: tuple[float, float]) -> Array:
    """Axes of a view at elevation and azimuth, degrees.

    Unit vectors (3, 3), by rows: to the right, upwards, and towards the eye.
    """
    (sin_e, sin_a), (cos_e, cos_a) = np.sin(np.radians(view)), np.cos(np.radians(view))
    right = [-sin_a, cos_a, 0.0]
    upwards = [-sin_e * cos_a, -sin_e * sin_a, cos_e]
    return np.array([right, upwards, [cos_e * cos_a, cos_e * sin_a, sin_e]])


def disc_corners(normals: Array, radius: float) -> Array:
    """Corners (N, c, 3) of discs about the origin, normal to unit vectors (N, 3); radius in m."""
    # Any direction that is not along the normal gives the first of two that span the disc.
    axes = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, axes)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angle = np.linspace(0.0, 2.0 * np.pi, _DISC_CORNERS, endpoint=False)[:, np.newaxis]
    circle = np.cos(angle) * first[:, np.newaxis] + np.sin(angle) * second[:, np.newaxis]
    return radius * circle


def disc_radius(motors: Array, normals: Array, arms: Array) -> float:
    """Radius, m, of discs, so that no two touch unless one is above the other.

    `motors` (N, 3), m, are their centres, `normals` (N, 3) unit vectors, and `arms` the lengths of
    the spokes to them, m.
    """
    apart = motors[:, np.newaxis] - motors
    distance = np.linalg.norm(apart, axis=2)
    along = np.abs(np.einsum("ijk,ik->ij", apart, normals))
    # Each of two coaxial rotors is on the other's axis.
    beside = distance[along < 0.95 * distance]
    sizes = [*beside, *arms[arms > 0.2 * arms.max(initial=0.0)]]
    return _DISC_SHARE * float(min(sizes, default=1.0))
