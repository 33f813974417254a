"""The desired motion as a function of time: a quintic polynomial between each two knots.

At the knots coordinates, rates and accelerations are those of the inverse kinematics; between two
knots lies the quintic that has all six values at its ends. So rates are the derivatives of
coordinates everywhere, every motion costs the same to evaluate, and C can evaluate it too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.flight.vectors import Array

# The powers of a quintic (6) in its value and its first and second derivatives (3): the number each
# is multiplied by, and the power that is left.
_SLOPES = np.array([[1, 1, 1, 1, 1, 1], [0, 1, 2, 3, 4, 5], [0, 0, 2, 6, 12, 20]], np.float64)
_LEFT = np.maximum(np.arange(6) - np.arange(3)[:, np.newaxis], 0)


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
        # The part that the lower three powers leave to the upper three at the end of a piece.
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

    def curves(self, time: float | Array) -> Array:
        """The quintics (…, n), and their first and second derivatives after them: (…, 3 n)."""
        t = np.minimum(np.maximum(np.asarray(time) - self.begin, 0.0), self.end - self.begin)
        piece = np.minimum((t / self.step).astype(int), len(self.coefficients) - 1)
        since = (t - piece * self.step)[..., np.newaxis, np.newaxis]
        pieces: Array = (_SLOPES * since**_LEFT) @ self.coefficients[piece]
        return pieces.reshape(*pieces.shape[:-2], -1)

    def __call__(self, time: float | Array) -> tuple[Array, Array, Array]:
        """q, v and a (…, nq) at times (…); before the first and after the last knot, theirs."""
        curves, n = self.curves(time), self.coefficients.shape[-1]
        return curves[..., :n], curves[..., n : 2 * n], curves[..., 2 * n :]
