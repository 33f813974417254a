"""Smooth paths in space, with their first three derivatives in closed form.

A path is called with times (…) and returns (…, 4, 3): position, velocity, acceleration and jerk in
world axes, in m and s. The jerk is there because the attitude that follows a path needs it for its
angular acceleration. What grows beyond the largest float is infinite or NaN, without a warning:
`desired_base` and `desired_with_tip` refuse it with the time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.errors import UsageError

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

ORDERS = 4  # position and three derivatives


class Path(Protocol):
    """Anything that gives position, velocity, acceleration and jerk (…, 4, 3) at times (…)."""

    def __call__(self, time: ArrayLike, /) -> Array:
        """Position and derivatives at `time`."""
        ...


@dataclass(frozen=True)
class Fixed:
    """A point that stays where it is."""

    position: Vector

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        out = np.zeros((*np.shape(time), ORDERS, 3))
        out[..., 0, :] = self.position
        return out


@dataclass(frozen=True)
class Term:
    """amplitude · e^(growth·t) · cos(frequency·t + phase); m, 1/s, rad/s, rad."""

    amplitude: float
    growth: float = 0.0
    frequency: float = 0.0
    phase: float = 0.0


@dataclass(frozen=True)
class Harmonic:
    """A sum of growing or decaying oscillations on each axis.

    Both paths of the paper (eqs. 20 and 21) are of this kind. Each term is the real part of
    A e^(iφ) e^(st) with s = growth + i·frequency, and a derivative is a factor s.
    """

    x: tuple[Term, ...] = ()
    y: tuple[Term, ...] = ()
    z: tuple[Term, ...] = ()

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        t = np.asarray(time, dtype=np.float64)
        out = np.zeros((*t.shape, ORDERS, 3))
        with np.errstate(over="ignore", invalid="ignore"):
            for axis, terms in enumerate((self.x, self.y, self.z)):
                for term in terms:
                    s = np.complex128(complex(term.growth, term.frequency))
                    wave = term.amplitude * np.exp(1j * term.phase) * np.exp(s * t)
                    for order in range(ORDERS):
                        out[..., order, axis] += wave.real
                        wave = wave * s
        return out


@dataclass(frozen=True)
class Line:
    """A straight line with minimum jerk, at rest before and after.

    Between `begin` and `begin` + `duration` the way done is 10s³ − 15s⁴ + 6s⁵ of the whole, s from
    0 to 1 (Flash and Hogan, 1985).
    """

    start: Vector
    end: Vector
    duration: float
    begin: float = 0.0

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        t = np.asarray(time, dtype=np.float64)
        s = np.clip((t - self.begin) / self.duration, 0.0, 1.0)
        moving = (t >= self.begin) & (t < self.begin + self.duration)
        share = np.stack(
            [
                s**3 * (10.0 + s * (-15.0 + 6.0 * s)),
                30.0 * s**2 * (1.0 - s) ** 2,
                60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
                np.where(moving, 60.0 * (1.0 + s * (-6.0 + 6.0 * s)), 0.0),
            ],
            axis=-1,
        )
        with np.errstate(all="ignore"):
            share /= np.float64(self.duration) ** np.arange(ORDERS)
            out: Array = share[..., np.newaxis] * np.subtract(self.end, self.start)
            out[..., 0, :] += self.start
        return out


@dataclass(frozen=True)
class Circle:
    """A circle at constant speed, anticlockwise about `normal`.

    It begins where the projection of the world's X on its plane points (of Y where `normal` is
    within 26° of X), turned by `phase`. `period` is negative for the other way round.
    """

    centre: Vector
    radius: float
    period: float
    normal: Vector = (0.0, 0.0, 1.0)
    phase: float = 0.0

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        t = np.asarray(time, dtype=np.float64)
        first, second = plane(self.normal)
        rate = np.float64(2.0 * np.pi) / self.period
        out = np.empty((*t.shape, ORDERS, 3))
        with np.errstate(over="ignore", invalid="ignore"):
            angle = (rate * t + self.phase)[..., np.newaxis]
            outwards = self.radius * (np.cos(angle) * first + np.sin(angle) * second)
            ahead = self.radius * (np.cos(angle) * second - np.sin(angle) * first)
            for order, turned in enumerate((outwards, ahead, -outwards, -ahead)):
                out[..., order, :] = rate**order * turned
            out[..., 0, :] += self.centre
        return out


@dataclass(frozen=True)
class Sum:
    """The sum of paths: a tip that moves as wanted beside the base, say."""

    paths: tuple[Path, ...]

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        out: Array = np.sum([path(time) for path in self.paths], axis=0)
        return out


def check_path(path: Path, duration: float, what: str) -> None:
    """Raise `UsageError` if a path does not give what it is to, at some times of the flight.

    That is another shape, or rates that are not the derivatives of positions; differences tell
    rough mistakes only.
    """
    time = np.linspace(0.0, duration, 9)[1:-1] * 0.993
    step = 1e-5 * duration
    try:
        here, ahead, behind = (np.asarray(path(time + by), float) for by in (0.0, step, -step))
    except (TypeError, ValueError, IndexError, AttributeError) as error:
        raise UsageError(f"{what}: cannot be evaluated at an array of times: {error}") from None
    if here.shape != (len(time), ORDERS, 3):
        raise UsageError(
            f"{what}: must give (…, {ORDERS}, 3) at times (…): position, velocity, acceleration "
            f"and jerk; it gives {here.shape} at {len(time)} times"
        )
    slope = (ahead - behind)[:, :-1] / (2.0 * step)
    off = np.abs(slope - here[:, 1:]).max(axis=(0, 2))
    scale = np.abs(here).max(axis=(0, 2))
    names = ("velocity", "acceleration", "jerk")
    for order, name in enumerate(names):
        # At a jump of the jerk a difference straddles it: then most other times still agree.
        typical = np.median(np.abs(slope - here[:, 1:])[:, order].max(axis=-1))
        allowed = 1e-3 * (scale[order + 1] + scale[order] / duration) + 1e-6
        if off[order] > allowed and typical > allowed:
            raise UsageError(f"{what}: its {name} is not the derivative of what comes before it")


def plane(normal: Vector | Array) -> tuple[Array, Array]:
    """Two unit vectors (3) that with the direction of a vector (3) make a right-handed frame."""
    n = np.asarray(normal, dtype=np.float64) / np.max(np.abs(normal))
    n /= np.linalg.norm(n)
    axis = np.array([1.0, 0.0, 0.0]) if abs(n[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    first = axis - (axis @ n) * n
    first /= np.linalg.norm(first)
    return first, np.cross(n, first)
