"""The robot of a flight and its paths in three dimensions."""

from __future__ import annotations

from typing import Any

import numpy as np

from gibbs_codegen.figures.robot_artists import RobotArtists, Shapes, disc_corners, disc_radius
from gibbs_codegen.figures.style import COLOURS, DARK
from gibbs_codegen.simulator.record.flight import Array, Flight

_CENTRE_COLOUR, _TIP_COLOUR = COLOURS[:2]

_PATH_LEVELS = (3, 4)
# Of the largest extent: what a scene has at least along each axis, so that it stays a box.
_THINNEST = 0.4


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
        return Shapes(ends, gold, arms, turned + at[rotors][:, np.newaxis])


class PathDrawing:
    """Artists of the paths of base centre and tip: the desired ones whole, the actual ones so far.

    Without an arm the tip is the centre, and is left out. `scale` multiplies the widths of lines.
    """

    def __init__(self, axes: Any, flight: Flight, desired: str = DARK, scale: float = 1.0) -> None:
        below, above = _PATH_LEVELS
        self._actual = []
        paths = [(flight.centre, "base centre", _CENTRE_COLOUR, flight.centre_desired)]
        if flight.has_tip and flight.layout.q.joint_places:
            paths.append(("tip", "tip", _TIP_COLOUR, flight.tip_desired))
        for point, label, colour, path in paths:
            (line,) = axes.plot([], [], [], color=colour, lw=1.6 * scale, zorder=below, label=label)
            (dashes,) = axes.plot(
                *path.T, color=desired, lw=0.7 * scale, dashes=(4, 3), zorder=above
            )
            self._actual.append((line, flight.point(point)))
        dashes.set_label("desired")

    def show(self, sample: int) -> None:
        """Draw the actual paths from the start to a sample."""
        for line, path in self._actual:
            _move(line, path[: sample + 1])


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


def thrust_directions(flight: Flight, sample: int) -> Array:
    """Unit vectors (N, 3) of the thrusts in the base's frame."""
    directions = flight.thrust_directions
    return directions if directions.ndim == 2 else directions[sample]


def samples_at(flight: Flight, times: Array) -> list[int]:
    """Numbers (k) of the samples of a flight that are nearest to times (k), s."""
    between = (flight.time[1:] + flight.time[:-1]) / 2.0
    return [int(sample) for sample in np.searchsorted(between, times)]


def bounds(flight: Flight, samples: list[int] | None = None) -> tuple[Array, Array]:
    """Lowest and highest coordinates (3), m, of robot and paths, with room for the rotors.

    The robot counts at such samples, or at all if None.
    """
    drawn = flight.positions if samples is None else flight.positions[samples]
    paths = [flight.point(flight.centre), flight.centre_desired]
    if flight.has_tip:
        paths += [flight.point("tip"), flight.tip_desired]
    points = np.concatenate([drawn.reshape(-1, 3), *paths])
    # A flight that stopped because it diverged may end in what is not a number.
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    extent = high - low + 2.0 * rotor_radius(flight)
    half = np.maximum(extent, _THINNEST * extent.max()) / 2.0
    middle = (low + high) / 2.0
    return middle - half, middle + half


def rotor_radius(flight: Flight) -> float:
    """Radius of the discs, m, by the distance between motors."""
    rotors = [flight.points.index(name) for name in flight.rotor_points]
    motors, carriers = (flight.positions[0][k] for k in (rotors, flight.parents[rotors]))
    normals = thrust_directions(flight, 0) @ flight.base_rotation[0].T
    return disc_radius(motors, normals, np.linalg.norm(motors - carriers, axis=1))


def _move(line: Any, points: Array) -> None:
    line.set_data_3d(*points.T)
