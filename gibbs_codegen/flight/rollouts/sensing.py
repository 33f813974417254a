"""What environments observe of their machines: the state of some time ago, with noise."""

from __future__ import annotations

from itertools import compress

import numpy as np

from gibbs_codegen.flight.plant.vehicle import Flags, Vehicle
from gibbs_codegen.flight.rollouts.episodes import Generators
from gibbs_codegen.runtime.rollouts import Array

# Noise of position, attitude and joints: of coordinates, then of velocities. And the delay.
_NOISE = ("position", "attitude", "joints"), ("velocity", "angular_velocity", "joint_rates")
SENSED = (*_NOISE[0], *_NOISE[1], "delay")


class Sensors:
    """Sensors of n machines: `values` (n) by names of `SENSED`, which episodes draw anew.

    They are standard deviations, m, rad, m/s and rad/s, and a delay, s, which is rounded up to
    whole decisions of so many seconds.
    """

    def __init__(self, vehicle: Vehicle, values: dict[str, Array], n: int, decision: float) -> None:
        self._vehicle, self._values, self._decision = vehicle, values, decision
        self._noise = np.zeros((n, vehicle.layout.displaced.size + vehicle.layout.v.size))
        # States of the last decisions, the latest first.
        start = np.concatenate([vehicle.neutral, np.zeros(vehicle.layout.v.size)])
        self._past = [np.tile(start, (n, 1))]
        self._ages = np.zeros(n, dtype=np.int64)

    def begin(self, q: Array, v: Array, rows: Flags, generators: Generators) -> None:
        """Begin with coordinates (n, nq) and velocities (n, nv) in some environments (n)."""
        delays = self._values.get("delay", np.zeros(len(q)))
        self._ages = np.ceil(delays / self._decision - 1e-9).astype(np.int64)
        self._past += [self._past[-1].copy() for _ in range(len(self._past), 1 + self._ages.max())]
        for state in self._past:
            state[rows] = np.concatenate([q, v], axis=1)[rows]
        self._draw(rows, generators)

    def after(self, q: Array, v: Array, rows: Flags, generators: Generators) -> None:
        """Take over the states after a decision, with noise of their own of some (n)."""
        self._past = [np.concatenate([q, v], axis=1), *self._past[:-1]]
        self._draw(rows, generators)

    def _draw(self, rows: Flags, generators: Generators) -> None:
        layout, sizes = self._vehicle.layout, np.zeros(self._noise.shape)
        parts = np.split(sizes, [layout.displaced.size], axis=1)
        for part, kinds, places in zip(parts, _NOISE, (layout.displaced, layout.v), strict=True):
            of_kinds = places.position, places.attitude, places.joints
            for kind, place in zip(kinds, of_kinds, strict=True):
                part[:, place] = np.reshape(self._values.get(kind, 0.0), (-1, 1))
        drawn = [
            generator.standard_normal(sizes.shape[1]) for generator in compress(generators, rows)
        ]
        self._noise[rows] = sizes[rows] * np.reshape(drawn, (-1, sizes.shape[1]))

    def read(self) -> tuple[Array, Array]:
        """Coordinates (n, nq) and velocities (n, nv) as they are observed."""
        states = np.stack(self._past)[self._ages, np.arange(len(self._ages))]
        q, v = np.split(states, [self._vehicle.layout.q.size], axis=1)
        of_q, of_v = np.split(self._noise, [self._vehicle.layout.displaced.size], axis=1)
        return self._vehicle.displaced(q, of_q), v + of_v
