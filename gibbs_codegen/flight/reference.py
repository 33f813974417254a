"""The desired motion as a function of time: a quintic polynomial between each two knots.

At the knots coordinates, rates and accelerations are those of the inverse kinematics; between two
knots lies the quintic that has all six values at its ends. So rates are the derivatives of
coordinates everywhere, every motion costs the same to evaluate, and C can evaluate it too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.flight.vectors import Array


@dataclass(frozen=True)
class Motion:
    """Coordinates, rates and accelerations (s, nq) at times (s)."""

    time: Array
    q: Array
    v: Array
    a: Array


class Reference:
    """Desired coordinates, rates and accelerations, from knots at equal steps of time.

    `coefficients` (pieces, 6, nq): powers of the time since the knot before, constant term first.
    """

    def __init__(self, motion: Motion) -> None:
        time = motion.time
        self.begin, self.end = float(time[0]), float(time[-1])
        self.step = (self.end - self.begin) / (len(time) - 1)
        h = self.step
        q0, q1, v0, v1 = motion.q[:-1], motion.q[1:], motion.v[:-1] * h, motion.v[1:] * h
        a0, a1 = motion.a[:-1] * h**2, motion.a[1:] * h**2
        # What the lower three powers leave to the upper three at the end of a piece.
        dq, dv, da = q1 - q0 - v0 - a0 / 2, v1 - v0 - a0, a1 - a0
        powers = [
            q0,
            v0,
            a0 / 2,
            10 * dq - 4 * dv + da / 2,
            -15 * dq + 7 * dv - da,
            6 * dq - 3 * dv + da / 2,
        ]
        self.coefficients: Array = np.stack([p / h**k for k, p in enumerate(powers)], axis=1)

    @property
    def knots(self) -> Array:
        """Times of the knots (pieces + 1), s."""
        return np.linspace(self.begin, self.end, len(self.coefficients) + 1)

    def __call__(self, time: float | Array) -> tuple[Array, Array, Array]:
        """q, v and a (…, nq) at times (…); before the first and after the last knot, theirs."""
        t = np.clip(np.asarray(time, dtype=np.float64) - self.begin, 0.0, self.end - self.begin)
        piece = np.minimum((t / self.step).astype(int), len(self.coefficients) - 1)
        s = (t - piece * self.step)[..., np.newaxis]
        c0, c1, c2, c3, c4, c5 = np.moveaxis(self.coefficients[piece], -2, 0)
        q = c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
        v = c1 + s * (2 * c2 + s * (3 * c3 + s * (4 * c4 + s * (5 * c5))))
        a = 2 * c2 + s * (6 * c3 + s * (12 * c4 + s * (20 * c5)))
        return q, v, a
