"""The path of the task: a level circle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.simulator.plant.vehicle import Array


@dataclass(frozen=True)
class CircularPath:
    """A level circle that begins and ends at rest at `start` (3), m."""

    start: Array
    radius: float
    duration: float

    def __call__(self, time: Array) -> Array:
        """Positions (…, 3), m."""
        angle, _ = self._turned(time)
        moved = np.stack([1 - np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
        return np.asarray(self.start + self.radius * moved)

    def velocity(self, time: Array) -> Array:
        """Velocities (…, 3), m/s."""
        angle, rate = self._turned(time)
        along = np.stack([np.sin(angle), np.cos(angle), np.zeros_like(angle)], axis=-1)
        return np.asarray(self.radius * rate[..., None] * along)

    def _turned(self, time: Array) -> tuple[Array, Array]:
        """The angle, rad, and its rate, rad/s, with the shape of the times."""
        s = np.clip(np.asarray(time, dtype=np.float64) / self.duration, 0.0, 1.0)
        angle = 2 * np.pi * s**3 * (10 + s * (6 * s - 15))
        return angle, 60 * np.pi * (s * (1 - s)) ** 2 / self.duration
