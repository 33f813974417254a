"""The robot and its paths in three dimensions.

Matplotlib orders 3-D artists by one depth for each, which puts long ones wrong; here `zorder`
decides, from what lies behind to what lies in front.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from matplotlib.patheffects import withStroke
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from gibbs_codegen.figures.style import COLOURS, DARK, GOLD
from gibbs_codegen.simulator.flight import Array, Flight

_CENTRE_COLOUR, _TIP_COLOUR, *_, _DISC_COLOUR = COLOURS[:5]

_PATH_LEVELS, _ROBOT_LEVEL = (3, 4), 10
_DISC_CORNERS = 24
# Of the distance between motors: discs in one plane would touch at half of it.
_DISC_SHARE = 0.45
# Of the largest extent: what a scene has at least along each axis, so that it stays a box.
_THINNEST = 0.4


class Drawable(Protocol):
    """What a drawing of a robot needs of its flight; all of it as `Flight` has it."""

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the k points."""

    @property
    def positions(self) -> Array:
        """Positions (s, k, 3) of the points, m."""

    @property
    def base_rotation(self) -> Array:
        """Rotations (s, 3, 3) from arm 1 to the world."""

    @property
    def thrust_directions(self) -> Array:
        """Unit vectors (N, 3) of the thrusts in the frame of arm 1."""

    @property
    def rotors(self) -> int:
        """Number N of rotors."""

    @property
    def tangent_arm(self) -> int:
        """Arm that is tangent to the path, or 0."""


class RobotDrawing:
    """Artists of the robot in 3-D axes: rotors, base arms and manipulator, one arm in gold.

    The gold arm is `tangent_arm`, or arm 2 if no arm is tangent to the path. Every rotor is a disc
    normal to its thrust. A robot of higher `rank` covers those of lower rank; `colour` is the
    manipulator's; `scale` multiplies the widths of lines.
    """

    def __init__(
        self, axes: Any, flight: Drawable, rank: int = 0, colour: Any = "0.4", scale: float = 1.0
    ) -> None:
        self._flight = flight
        self._gold = flight.tangent_arm or 2
        self._arm = arm_points(flight)
        level = _ROBOT_LEVEL + 4 * rank

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
        self._spokes = line(1, color=DARK, linewidth=1.1 * scale)
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
        """Put the artists where the robot is.

        Args:
            sample: Number of the sample of the flight.
        """
        spokes, arm, discs = self._shapes(sample)
        centre, motor = arm[0], spokes[2 * self._gold - 2].copy()
        spokes[2 * self._gold - 2] = centre
        _move(self._spokes, spokes)
        _move(self._gold_arm, np.array([centre, motor]))
        _move(self._manipulator, arm)
        self._discs.set_verts(discs)

    def outline(self, sample: int) -> Array:
        """Points that are spread over all that is drawn of the robot.

        Args:
            sample: Number of the sample of the flight.

        Returns:
            Positions (p, 3) in the world, m.
        """
        spokes, arm, discs = self._shapes(sample)
        shares = np.linspace(0.0, 1.0, 12)[:, np.newaxis, np.newaxis]
        lines = [line[:-1] + shares * np.diff(line, axis=0) for line in (spokes, arm)]
        return np.concatenate([points.reshape(-1, 3) for points in (*lines, discs)])

    def _shapes(self, sample: int) -> tuple[Array, Array, Array]:
        """Base arms (2 N, 3), each from its motor to O₂, manipulator (j, 3), discs (N, c, 3)."""
        flight = self._flight
        at = dict(zip(flight.points, flight.positions[sample], strict=True))
        motors = np.array([at[f"motor{k}"] for k in range(1, flight.rotors + 1)])
        spokes = np.repeat(at["O2"][np.newaxis], 2 * flight.rotors, axis=0)
        spokes[::2] = motors
        arm = np.array([at[name] for name in self._arm])
        turned: Array = self._discs_at_origin @ flight.base_rotation[sample].T
        return spokes, arm, turned + motors[:, np.newaxis]


class PathDrawing:
    """Artists of the paths of base centre and tip: the desired ones whole, the actual ones so far.

    Without an arm the tip is the centre, and is left out. `scale` multiplies the widths of lines.
    """

    def __init__(self, axes: Any, flight: Flight, desired: str = DARK, scale: float = 1.0) -> None:
        below, above = _PATH_LEVELS
        self._actual = []
        paths = [("O2", "base centre", _CENTRE_COLOUR, flight.centre_desired)]
        if len(arm_points(flight)) > 2:
            paths.append(("tip", "tip", _TIP_COLOUR, flight.tip_desired))
        for point, label, colour, path in paths:
            (line,) = axes.plot([], [], [], color=colour, lw=1.6 * scale, zorder=below, label=label)
            (dashes,) = axes.plot(
                *path.T, color=desired, lw=0.7 * scale, dashes=(4, 3), zorder=above
            )
            self._actual.append((line, flight.point(point)))
        dashes.set_label("desired")

    def show(self, sample: int) -> None:
        """Draw the actual paths from the start to a sample.

        Args:
            sample: Number of the sample of the flight.
        """
        for line, path in self._actual:
            _move(line, path[: sample + 1])


def arm_points(flight: Drawable) -> list[str]:
    """Name the points along the arm.

    Args:
        flight: A flight, or a robot that stands.

    Returns:
        Names of base centre, joints and tip.
    """
    return ["O2", *(name for name in flight.points if name.startswith("joint")), "tip"]


def samples_at(flight: Flight, times: Array) -> list[int]:
    """Find the samples of a flight that are nearest to given times.

    Args:
        flight: The flight.
        times: Times (k), s.

    Returns:
        Numbers (k) of the samples.
    """
    between = (flight.time[1:] + flight.time[:-1]) / 2.0
    return [int(sample) for sample in np.searchsorted(between, times)]


def bounds(flight: Flight, samples: list[int] | None = None) -> tuple[Array, Array]:
    """Bound robot and paths, with room for the rotors.

    Args:
        flight: The flight.
        samples: The samples at which the robot is drawn; None for all of them.

    Returns:
        Lowest and highest coordinates (3) each in the world, m.
    """
    drawn = flight.positions if samples is None else flight.positions[samples]
    paths = [flight.point("O2"), flight.point("tip"), flight.centre_desired, flight.tip_desired]
    points = np.concatenate([drawn.reshape(-1, 3), *paths])
    # A flight that stopped because it diverged may end in what is not a number.
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    extent = high - low + 2.0 * disc_radius(flight)
    half = np.maximum(extent, _THINNEST * extent.max()) / 2.0
    middle = (low + high) / 2.0
    return middle - half, middle + half


def disc_radius(flight: Drawable) -> float:
    """Choose the radius of the discs by the distance between neighbouring motors.

    Args:
        flight: A flight, or a robot that stands.

    Returns:
        The radius, m.
    """
    at = dict(zip(flight.points, flight.positions[0], strict=True))
    motors = np.array([at[f"motor{k}"] for k in range(1, flight.rotors + 1)])
    nearest = np.linalg.norm(motors - np.roll(motors, 1, axis=0), axis=1).min()
    shortest = np.linalg.norm(motors - at["O2"], axis=1).min()
    return _DISC_SHARE * float(min(nearest, shortest))


def _discs(flight: Drawable) -> Array:
    """Corners (N, c, 3) of the rotors about their motors, in the frame of arm 1."""
    normals = flight.thrust_directions
    # Any direction that is not along the normal gives the first of two that span the disc.
    axes = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, axes)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angle = np.linspace(0.0, 2.0 * np.pi, _DISC_CORNERS, endpoint=False)[:, np.newaxis]
    circle = np.cos(angle) * first[:, np.newaxis] + np.sin(angle) * second[:, np.newaxis]
    corners: Array = disc_radius(flight) * circle
    return corners


def _move(line: Any, points: Array) -> None:
    line.set_data_3d(*points.T)
