"""Smooth paths in space, with their first three derivatives in closed form.

A path is called with times (…) and returns (…, 4, 3): position, velocity, acceleration and jerk in
world axes, in m and s. The jerk is there because the attitude that follows a path needs it for its
angular acceleration. What grows beyond the largest float is infinite or NaN, without a warning:
`desired_base` and `desired_with_tip` refuse it with the time.

A path of waypoints rests or has a velocity that was given at some of them. There its acceleration,
jerk and snap are zero, and polynomials of degree 9, whose values at both ends these are, join such
points. At free points in between, velocity to snap are those of the quintic spline through them,
which has the least integral of squared jerk. So the path has four continuous derivatives
everywhere.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import comb, perm
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BPoly, make_interp_spline

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.scenario.numbers import require

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

ORDERS = 4  # position and three derivatives
Flags = NDArray[np.bool_]
Velocity = Sequence[float] | Array | Literal["rest", "free"]
WORDS = ("rest", "free")  # in place of a velocity
_DEGREE = 9
_GIVEN = 5  # values at each end of a piece: position and four derivatives
# Bernstein coefficients 0 … 4 of a piece of duration 1, from position and derivatives at its
# beginning: entry (k, j) is the share of derivative j in coefficient k.
_COEFFICIENTS = np.array(
    [[comb(k, j) / perm(_DEGREE, j) for j in range(_GIVEN)] for k in range(_GIVEN)]
)


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


class Waypoints:
    """A path through points at given times; four derivatives are continuous.

    `velocities` has an entry per point: a velocity (3) in m/s, "rest", or "free" for what makes the
    path smooth. Without it the first and last point are at rest and the others free. Equal
    successive points are at rest, and so is the path between them. Before and after its points
    the path rests, or goes straight on with the velocity of the first and last point. On a piece
    from rest to rest, or between rest and a free point, no coordinate passes its value at rest.

    Raises `UsageError` for times that do not increase, or that lie so unevenly that no curve can
    be found, and for velocities that the points do not allow.
    """

    def __init__(
        self,
        times: Sequence[float],
        points: Sequence[Sequence[float]],
        velocities: Sequence[Velocity] | None = None,
    ) -> None:
        since, places = _numbers(times, points)
        if velocities is None:
            free: Velocity = "free"
            velocities = ["rest", *[free] * (len(places) - 2), "rest"]
        for place, words in velocity_faults(places, velocities):
            raise UsageError(f"waypoints: velocities[{place}]: {words}")
        self._begin, self._end = float(since[0]), float(since[-1])
        self._duration = self._end - self._begin
        try:
            with np.errstate(all="raise", under="ignore"):
                # In a time from 0 to 1, so that the unit does not matter to the numbers.
                since = (since - self._begin) / self._duration
                if not np.all(np.diff(since) > 0.0):
                    raise ValueError("the times must increase")
                nodes = _derivatives(since, places, velocities, self._duration)
                curve = _curve(since, nodes)
                derivatives = [curve.derivative(order) for order in range(1, ORDERS)]
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            raise UsageError(f"waypoints: no smooth curve through them: {error}") from None
        self._derivatives = [curve, *derivatives]
        self._ends = nodes[[0, -1], 1]

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        t = np.asarray(time, dtype=np.float64)
        s = (t - self._begin) / self._duration
        inside = np.clip(s, 0.0, 1.0)
        out: Array = np.stack([derivative(inside) for derivative in self._derivatives], axis=-2)
        beyond = (s - inside)[..., np.newaxis]
        out[..., 0, :] += beyond * np.where(beyond < 0.0, *self._ends)
        with np.errstate(all="ignore"):
            out /= (np.float64(self._duration) ** np.arange(ORDERS))[:, np.newaxis]
        return out


def velocity_faults(
    points: Sequence[Sequence[float]] | Array, velocities: Sequence[Velocity]
) -> Iterator[tuple[int, str]]:
    """Number, from 0, and words of each fault of the velocities at points.

    They are (3), m/s, "rest" or "free".
    """
    if len(velocities) != len(points):
        last = max(min(len(velocities), len(points)) - 1, 0)
        yield last, f"{len(velocities)} velocities of {len(points)} points; give as many of both"
        return
    repeated = _repeated(np.asarray(points, dtype=np.float64))
    for place, velocity in enumerate(velocities):
        if not _is_velocity(velocity):
            yield place, 'must be a velocity [x, y, z] in m/s, "rest" or "free"'
        elif not isinstance(velocity, str):
            if repeated[place] and np.any(velocity):
                yield place, 'this point is repeated, so that the path rests here: give "rest"'
        elif velocity == "free" and place in (0, len(points) - 1):
            yield place, 'the path ends here: give a velocity, or "rest"'


def _is_velocity(value: object) -> bool:
    """Whether a value is a word, or three finite numbers."""
    if isinstance(value, str):
        return value in WORDS
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    return numbers.shape == (3,) and bool(np.all(np.isfinite(numbers)))


def _numbers(times: Sequence[float], points: Sequence[Sequence[float]]) -> tuple[Array, Array]:
    """Times (s) and points (s, 3) as arrays of finite numbers. Raises `UsageError`."""
    try:
        since, places = np.asarray(times, np.float64), np.asarray(points, np.float64)
    except (TypeError, ValueError):
        since = places = np.zeros(0)
    is_right = since.ndim == 1 and len(since) > 1 and places.shape == (len(since), 3)
    require(
        is_right and bool(np.all(np.isfinite(since)) and np.all(np.isfinite(places))),
        "waypoints: give a list of times, s, and a point [x, y, z], m, for each, two or more",
    )
    return since, places


def _repeated(places: Array) -> Flags:
    """Whether points (s, 3) are equal to the one before or the one after: (s)."""
    same = np.all(places[1:] == places[:-1], axis=1)
    repeated: Flags = np.append(same, False) | np.insert(same, 0, False)
    return repeated


def _derivatives(
    since: Array, places: Array, velocities: Sequence[Velocity], duration: float
) -> Array:
    """Position and four derivatives (s, 5, 3), m, at the points, in the time from 0 to 1.

    `since` (s) is such a time; `velocities` are in m/s, "rest" or "free", `duration` in s.
    """
    nodes = np.zeros((len(places), _GIVEN, 3))
    nodes[:, 0] = places
    words = [velocity if isinstance(velocity, str) else "" for velocity in velocities]
    free = np.array([word == "free" for word in words]) & ~_repeated(places)
    for place, velocity in enumerate(velocities):
        if not isinstance(velocity, str):
            nodes[place, 1] = np.multiply(velocity, duration)
    for first, last in itertools.pairwise(np.flatnonzero(~free)):
        if last == first + 1:
            continue
        run, inner = slice(first, last + 1), slice(first + 1, last)
        ends = tuple([(1, nodes[k, 1]), (2, np.zeros(3))] for k in (first, last))
        spline = make_interp_spline(since[run], places[run], k=5, bc_type=ends)
        for order in range(1, _GIVEN):
            nodes[inner, order] = spline.derivative(order)(since[inner])
    _calm(since, nodes, free)
    return nodes


def _calm(since: Array, nodes: Array, free: Flags) -> None:
    """Lessen derivatives at free points where a piece would take a coordinate past a rest.

    The Bernstein coefficients of a piece bound it. Those of the end at rest are all the coordinate
    there; derivatives at the other end are scaled so that its coefficients lie on its side too.
    `nodes` (s, 5, 3), position and derivatives, are changed.
    """
    resting = ~np.any(nodes[:, 1:], axis=(1, 2))
    share = np.ones((len(since), 3))
    for step in (-1, 1):
        places = np.flatnonzero(free)
        places = places[resting[places + step]]
        rests = places + step
        away = nodes[places, 0] - nodes[rests, 0]
        powers = (since[rests] - since[places])[:, np.newaxis] ** np.arange(1, _GIVEN)
        change = _COEFFICIENTS[:, 1:] @ (powers[..., np.newaxis] * nodes[places, 1:])
        back = np.max(-np.sign(away)[:, np.newaxis] * change, axis=1)
        allowed = np.divide(np.abs(away), back, out=np.ones_like(away), where=back > 0.0)
        allowed[away == 0.0] = 0.0
        share[places] = np.minimum(share[places], allowed)
    nodes[:, 1:] *= share[:, np.newaxis]


def _curve(since: Array, nodes: Array) -> BPoly:
    """The pieces of degree 9 between points, of the time `since` (s) from 0 to 1.

    `nodes` (s, 5, 3) are position and derivatives there.
    """
    steps = np.diff(since)[:, np.newaxis] ** np.arange(_GIVEN)
    ahead = _COEFFICIENTS @ (steps[..., np.newaxis] * nodes[:-1])
    signs = (-1.0) ** np.arange(_GIVEN)
    behind = _COEFFICIENTS @ ((signs * steps)[..., np.newaxis] * nodes[1:])
    coefficients = np.concatenate([ahead, behind[:, ::-1]], axis=1)
    return BPoly(np.moveaxis(coefficients, 1, 0), since)
