"""The robot of a flight and its paths in three dimensions."""

from __future__ import annotations

from typing import Any

import numpy as np

from gibbs_codegen.figures.robot_artists import RobotArtists, Shapes, disc_corners, disc_radius
from gibbs_codegen.figures.style import COLOURS, DARK
from gibbs_codegen.simulator.flight import Array, Flight

_CENTRE_COLOUR, _TIP_COLOUR = COLOURS[:2]

_PATH_LEVELS = (3, 4)
# Of the largest extent: what a scene has at least along each axis, so that it stays a box.
_THINNEST = 0.4


class RobotDrawing:
    """Artists of the robot of a flight in 3-D axes, one base arm in gold.

    The gold arm is `tangent_arm`, or arm 2 if no arm is tangent to the path. Every rotor is a disc
    normal to its thrust. A robot of higher `rank` covers those of lower rank; `colour` is the
    manipulator's; `scale` multiplies the widths of lines.
    """

    def __init__(
        self, axes: Any, flight: Flight, rank: int = 0, colour: Any = "0.4", scale: float = 1.0
    ) -> None:
        self._flight = flight
        self._gold = flight.tangent_arm or 2
        self._arm = arm_points(flight)
        self._discs_at_origin = disc_corners(flight.thrust_directions, rotor_radius(flight))
        self._artists = RobotArtists(axes, self._shapes(0), rank, colour, scale)

    def show(self, sample: int) -> None:
        """Put the artists where the robot is.

        Args:
            sample: Number of the sample of the flight.
        """
        self._artists.show(self._shapes(sample))

    def outline(self, sample: int) -> Array:
        """Points that are spread over all that is drawn of the robot.

        Args:
            sample: Number of the sample of the flight.

        Returns:
            Positions (p, 3) in the world, m.
        """
        return self._shapes(sample).outline()

    def _shapes(self, sample: int) -> Shapes:
        flight = self._flight
        at = dict(zip(flight.points, flight.positions[sample], strict=True))
        motors = np.array([at[f"motor{k}"] for k in range(1, flight.rotors + 1)])
        ends = [np.array([motor, at["O2"]]) for motor in motors]
        gold = ends.pop(self._gold - 1)[::-1]
        arm = np.array([at[name] for name in self._arm])
        turned: Array = self._discs_at_origin @ flight.base_rotation[sample].T
        return Shapes(ends, gold, [arm], turned + motors[:, np.newaxis])


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


def arm_points(flight: Flight) -> list[str]:
    """Name the points along the arm.

    Args:
        flight: The flight.

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
    extent = high - low + 2.0 * rotor_radius(flight)
    half = np.maximum(extent, _THINNEST * extent.max()) / 2.0
    middle = (low + high) / 2.0
    return middle - half, middle + half


def rotor_radius(flight: Flight) -> float:
    """Choose the radius of the discs by the distance between motors.

    Args:
        flight: The flight.

    Returns:
        The radius, m.
    """
    at = dict(zip(flight.points, flight.positions[0], strict=True))
    motors = np.array([at[f"motor{k}"] for k in range(1, flight.rotors + 1)])
    normals = flight.thrust_directions @ flight.base_rotation[0].T
    return disc_radius(motors, normals, np.linalg.norm(motors - at["O2"], axis=1))


def _move(line: Any, points: Array) -> None:
    line.set_data_3d(*points.T)
