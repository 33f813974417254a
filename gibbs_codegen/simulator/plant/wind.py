"""Wind: its velocity in time, and the wrenches by which it drags frames along."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gibbs_codegen.scenario.environment import Wind
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle


class WindDrag:
    """The drag of frames in the wind.

    `coefficients` (f, 6) are those of the forces, N s/m, and of the torques, N m s/rad.
    """

    def __init__(self, vehicle: Vehicle, wind: Wind) -> None:
        self.wind = wind
        self.velocity: Array = np.array(wind.velocity, dtype=np.float64)
        # Of each gust begin and duration, s, and half the amplitude, m/s.
        self.gusts: Array = np.array(
            [[gust.begin, gust.duration, *np.multiply(0.5, gust.amplitude)] for gust in wind.gusts]
        ).reshape(-1, 5)
        self.coefficients = np.zeros((len(vehicle.frames), 6))
        self._fill(vehicle, wind.drag, slice(3))
        self._fill(vehicle, wind.rotational_drag, slice(3, 6))

    def _fill(self, vehicle: Vehicle, drag: Mapping[str, float], entries: slice) -> None:
        """Take coefficients of frames, for some entries of wrenches."""
        for name, coefficient in drag.items():
            self.coefficients[vehicle.frames.index(name), entries] = coefficient

    def speed(self, time: float | Array) -> Array:
        """Velocity (…, 3) of the wind, m/s, world axes, at times (…), s."""
        share = (np.asarray(time)[..., np.newaxis] - self.gusts[:, 0]) / self.gusts[:, 1]
        rise = 1.0 - np.cos(2.0 * np.pi * np.clip(share, 0.0, 1.0))
        found: Array = self.velocity + rise @ self.gusts[:, 2:]
        return found

    def wrenches(self, time: float | Array, velocities: Array) -> Array:
        """Wrenches (…, f, 6) of the drag on the frames: force, N, and torque, N m, world axes.

        `velocities` (…, f, 6) of the frames are linear, then angular.
        """
        against = np.array(velocities)
        against[..., :3] -= self.speed(time)[..., np.newaxis, :]
        return -self.coefficients * against
