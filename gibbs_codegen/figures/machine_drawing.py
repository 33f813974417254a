"""The machine and its paths in three dimensions.

Matplotlib orders 3-D artists by one depth for each, which puts long ones wrong; here `zorder`
decides, from what lies behind to what lies in front.
"""

from __future__ import annotations

import itertools
from typing import Any, Protocol

import numpy as np
from matplotlib.patheffects import withStroke
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from gibbs_codegen.figures.style import DARK, GOLD
from gibbs_codegen.simulator.flight import Array, Flight

# Of the palette that DARK and GOLD are of.
_DISC_COLOUR = "#56b4e9"
_CENTRE_COLOUR = "#0072b2"
_TIP_COLOUR = "#d55e00"

# Elevation above the horizon and azimuth from which a machine looks like one, degrees.
VIEW = (22.0, -62.0)

_PATH_LEVELS, _MACHINE_LEVEL = (3, 4), 10
_DISC_CORNERS = 24
# Of the distance between motors: discs in one plane would touch at half of it.
_DISC_SHARE = 0.45
# Of the largest extent: what a scene has at least along each axis, so that it stays a box.
_THINNEST = 0.4


class Drawable(Protocol):
    """What a drawing of a machine needs of its flight; all of it as `Flight` has it."""

    @property
    def points(self) -> tuple[str, ...]:
        """Names of points."""

    @property
    def positions(self) -> Array:
        """Positions of the points."""

    @property
    def base_rotation(self) -> Array:
        """From arm 1 to the world."""

    @property
    def thrust_directions(self) -> Array:
        """Thrusts in the frame of arm 1."""

    @property
    def rotors(self) -> int:
        """Number of rotors."""

    @property
    def tangent_arm(self) -> int:
        """Arm that follows the path, or 0."""

    def point(self, name: str) -> Array:
        """Positions of a point."""


class MachineDrawing:
    """Artists of the machine in 3-D axes: rotors, base arms and manipulator, one arm in gold.

    The gold arm is `tangent_arm`, or arm 2 where none follows the path. Every rotor is a disc
    normal to its thrust. Machines of a higher `rank` cover those of a lower one; `colour` is the
    manipulator's; `scale` multiplies the widths of lines.
    """

    def __init__(
        self, axes: Any, flight: Drawable, rank: int = 0, colour: Any = "0.4", scale: float = 1.0
    ) -> None:
        self._flight = flight
        self._gold = flight.tangent_arm or 2
        self._chain = chain(flight)
        level = _MACHINE_LEVEL + 4 * rank

        def line(above: int, **style: Any) -> Any:
            return axes.plot([], [], [], zorder=level + above, solid_capstyle="round", **style)[0]

        self._discs_at_origin = _discs(flight)
        self._discs = Poly3DCollection(
            self._discs_at_origin,
            facecolor=_DISC_COLOUR,
            edgecolor=DARK,
            linewidth=0.4 * scale,
            alpha=0.6,
            zorder=level,
        )
        axes.add_collection3d(self._discs, autolim=False)
        self._arms = line(1, color=DARK, linewidth=1.1 * scale)
        edge = withStroke(linewidth=2.0 * scale + 1.0, foreground=DARK)
        self._gold_arm = line(2, color=GOLD, linewidth=2.0 * scale, path_effects=[edge])
        self._manipulator = line(
            3,
            color=colour,
            linewidth=1.5 * scale,
            marker="o",
            markersize=2.6 * scale,
            markerfacecolor="white",
            markeredgecolor=DARK,
            markeredgewidth=0.5 * scale,
        )

    def show(self, sample: int) -> None:
        """Put the artists where the machine is at a sample of the flight."""
        flight = self._flight
        at = dict(zip(flight.points, flight.positions[sample], strict=True))
        motors = np.array([at[f"motor{k}"] for k in range(1, flight.rotors + 1)])
        # Out and back from the centre, so that one line draws all arms.
        spokes = np.repeat(at["O2"][np.newaxis], 2 * flight.rotors, axis=0)
        spokes[::2] = motors
        spokes[2 * self._gold - 2] = at["O2"]
        _move(self._arms, spokes)
        _move(self._gold_arm, np.array([at["O2"], motors[self._gold - 1]]))
        _move(self._manipulator, np.array([at[name] for name in self._chain]))
        turned = self._discs_at_origin @ flight.base_rotation[sample].T
        self._discs.set_verts(turned + motors[:, np.newaxis])


class PathDrawing:
    """Artists of the paths of base centre and tip: the desired ones whole, the actual ones so far.

    Without an arm the tip is the centre, and is left out. `scale` multiplies the widths of lines.
    """

    def __init__(self, axes: Any, flight: Flight, desired: str = DARK, scale: float = 1.0) -> None:
        below, above = _PATH_LEVELS
        self._actual = []
        paths = [("O2", "base centre", _CENTRE_COLOUR, flight.centre_desired)]
        if len(chain(flight)) > 2:
            paths.append(("tip", "tip", _TIP_COLOUR, flight.tip_desired))
        for point, label, colour, path in paths:
            (line,) = axes.plot([], [], [], color=colour, lw=1.6 * scale, zorder=below, label=label)
            (dashes,) = axes.plot(
                *path.T, color=desired, lw=0.7 * scale, dashes=(4, 3), zorder=above
            )
            self._actual.append((line, flight.point(point)))
        dashes.set_label("desired")

    def show(self, sample: int) -> None:
        """Draw the actual paths from the start to a sample of the flight."""
        for line, path in self._actual:
            _move(line, path[: sample + 1])


def chain(flight: Drawable) -> list[str]:
    """Names of the points along the arm: base centre, joints and tip."""
    return ["O2", *(name for name in flight.points if name.startswith("joint")), "tip"]


def samples_at(flight: Flight, times: Array) -> list[int]:
    """Samples of a flight that are nearest to times, s."""
    between = (flight.time[1:] + flight.time[:-1]) / 2.0
    return [int(sample) for sample in np.searchsorted(between, times)]


def bounds(flight: Flight, samples: list[int] | None = None) -> tuple[Array, Array]:
    """Lowest and highest coordinates of machine and paths, with room for rotors.

    The machine is where it is at `samples`, or at all of them.
    """
    machines = flight.positions if samples is None else flight.positions[samples]
    paths = [flight.point("O2"), flight.point("tip"), flight.centre_desired, flight.tip_desired]
    points = np.concatenate([machines.reshape(-1, 3), *paths])
    # A flight that stopped because it diverged may end in what is not a number.
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    extent = high - low + 2.0 * _disc_radius(flight)
    half = np.maximum(extent, _THINNEST * extent.max()) / 2.0
    middle = (low + high) / 2.0
    return middle - half, middle + half


def set_scene(
    axes: Any,
    bounds: tuple[Array, Array],
    view: tuple[float, float] = VIEW,
    ticks: int = 8,
) -> None:
    """Give 3-D axes equal units in m, limits at `bounds`, and a `view`.

    A view is its elevation above the horizon and its azimuth, in degrees. The longest axis has at
    most about so many `ticks`.
    """
    low, high = bounds
    extent = high - low
    axes.computed_zorder = False
    # Neighbours would be hidden behind it.
    axes.patch.set_visible(False)
    for name, begin, end in zip("xyz", low, high, strict=True):
        axes.set(**{f"{name}lim": (begin, end), f"{name}label": f"${name}$ (m)"})
        bins = max(2, round(ticks * (end - begin) / extent.max()))
        axes.locator_params(name, nbins=bins, steps=[1, 2, 5, 10])
        getattr(axes, f"{name}axis").labelpad = 0.0 if name == "z" else -3.0
    axes.tick_params(pad=0.5)
    axes.set_proj_type("ortho")
    axes.set_box_aspect(extent)
    axes.view_init(*view)


def fit(axes: Any, left: float, bottom: float, width: float, height: float) -> None:
    """Make a scene, with its labels, as large as a rectangle of the figure takes (0 to 1)."""
    corners = np.array(list(itertools.product(*(getattr(axes, f"get_{n}lim")() for n in "xyz"))))
    room = np.array([width, height])
    middle = np.array([left, bottom]) + room / 2.0
    axes.set_position((left, bottom, width, height))
    # Labels do not grow with the box, so that one step is not enough.
    for _ in range(4):
        axes.figure.draw_without_rendering()
        labels = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
        pixels = np.concatenate([axes.transData.transform(project(axes, corners)), *labels])
        drawn = axes.figure.transFigure.inverted().transform(pixels)
        low, high = drawn.min(axis=0), drawn.max(axis=0)
        (x, y), size = axes.get_position(original=True).p0, axes.get_position(original=True).size
        scale = float(np.min(room / (high - low)))
        origin = middle + scale * (np.array([x, y]) - (low + high) / 2.0)
        axes.set_position((*origin, *(scale * size)))


def project(axes: Any, points: Array) -> Array:
    """Where points (…, 3) of a scene are in the plane of its axes (…, 2)."""
    matrix = axes.get_proj()
    flat: Array = (points @ matrix[:2, :3].T + matrix[:2, 3]) / matrix[3, 3]
    return flat


def _disc_radius(flight: Drawable) -> float:
    """Radius of the rotors, by the distance between motors that are neighbours, m."""
    motors = np.array([flight.point(f"motor{k}")[0] for k in range(1, flight.rotors + 1)])
    nearest = np.linalg.norm(motors - np.roll(motors, 1, axis=0), axis=1).min()
    shortest = np.linalg.norm(motors - flight.point("O2")[0], axis=1).min()
    return _DISC_SHARE * float(min(nearest, shortest))


def _discs(flight: Drawable) -> Array:
    """Corners (N, c, 3) of the rotors about their own seats, in the frame of arm 1."""
    normals = flight.thrust_directions
    # Any direction that is not along the normal gives the first of two that span the disc.
    axes = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, axes)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angle = np.linspace(0.0, 2.0 * np.pi, _DISC_CORNERS, endpoint=False)[:, np.newaxis]
    circle = np.cos(angle) * first[:, np.newaxis] + np.sin(angle) * second[:, np.newaxis]
    corners: NDArray[np.float64] = _disc_radius(flight) * circle
    return corners


def _move(line: Any, points: Array) -> None:
    line.set_data_3d(*points.T)
