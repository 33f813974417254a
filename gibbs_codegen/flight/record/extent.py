"""The size of a flight and its robot in a picture, and the part that a picture shows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gibbs_codegen.figures.appearance import disc_radius
from gibbs_codegen.flight.record.flight import Array, Flight

# The least extent of a scene along an axis, as a share of the largest, so that it stays a box.
_THINNEST = 0.4
# The room around a machine without rotors, as a share of the largest extent.
_ROOM = 0.05
# The share of thrusts or efforts that is shown whole: peaks would make the others dots.
_USUAL = 0.95


def thrust_directions(flight: Flight, sample: int) -> Array:
    """Unit vectors (N, 3) of the thrusts in the base's frame."""
    directions = flight.thrust_directions
    return directions if directions.ndim == 2 else directions[sample]


def usual_size(values: Array) -> float:
    """The size that most of the absolute values do not exceed."""
    finite = np.abs(values[np.isfinite(values)])
    return float(np.quantile(finite, _USUAL)) if len(finite) else 0.0


def samples_at(flight: Flight, times: Array) -> list[int]:
    """Numbers (k) of the samples of a flight that are nearest to times (k), s."""
    between = (flight.time[1:] + flight.time[:-1]) / 2.0
    return [int(sample) for sample in np.searchsorted(between, times)]


class LedPoint(NamedTuple):
    """The path (s, 3) of a point of the robot, and the desired one, m."""

    path: Array
    desired: Array

    @property
    def error(self) -> Array:
        """Distance (s) from where it should be, m."""
        return np.linalg.norm(self.path - self.desired, axis=1)


def led_points(flight: Flight) -> dict[str, LedPoint]:
    """Points that are led: the base centre, if it moves or nothing else does, and an arm's tip."""
    led = {}
    moves_tip = flight.has_tip and bool(flight.layout.q.joint_places)
    if flight.layout.v.base or not moves_tip:
        led["base centre"] = LedPoint(flight.point(flight.centre), flight.centre_desired)
    if moves_tip:
        led["tip"] = LedPoint(flight.point("tip"), flight.tip_desired)
    return led


def bounds(flight: Flight, samples: list[int] | None = None) -> tuple[Array, Array]:
    """Lowest and highest coordinates (3), m, of robot and paths, with room around it.

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
    extent = high - low
    extent += 2.0 * (rotor_radius(flight) or _ROOM * extent.max())
    half = np.maximum(extent, _THINNEST * extent.max() or 1.0) / 2.0
    middle = (low + high) / 2.0
    return middle - half, middle + half


def rotor_radius(flight: Flight) -> float:
    """Radius of the discs, m, by the distance between motors; 0 without any."""
    if not flight.rotors:
        return 0.0
    rotors = [flight.points.index(name) for name in flight.rotor_points]
    motors, carriers = (flight.positions[0][k] for k in (rotors, flight.parents[rotors]))
    normals = thrust_directions(flight, 0) @ flight.base_rotation[0].T
    return disc_radius(motors, normals, np.linalg.norm(motors - carriers, axis=1))
