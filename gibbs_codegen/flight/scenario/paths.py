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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb, perm
from typing import Annotated, Any, ClassVar, Literal, Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike
from pydantic import AfterValidator, BeforeValidator, PlainValidator, TypeAdapter, WithJsonSchema

from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.table import (
    Kinds,
    Place,
    Table,
    Tables,
    at_most,
    entry,
    fault,
    key,
    needed,
    not_one_of,
    refusal,
    table,
    to_python,
)
from gibbs_codegen.flight.scenario.numbers import (
    LEAST,
    Angle,
    Direction,
    NotNegative,
    Number,
    Positive,
    Vector,
)
from gibbs_codegen.flight.vectors import Array as Array
from gibbs_codegen.flight.vectors import Flags

ORDERS = 4  # position and three derivatives
WORDS = ("rest", "free")  # in place of a velocity
# A path that rests at both ends needs no more.
_FEWEST_POINTS, _MOST_POINTS, _MOST_TERMS = 2, 10_000, 100
_DEGREE = 9
_END_VALUES = 5  # at each end of a piece: position and four derivatives
# Bernstein coefficients 0 … 4 of a piece of duration 1, from position and derivatives at its
# beginning: entry (k, j) is the share of derivative j in coefficient k.
_COEFFICIENTS = np.array(
    [[comb(k, j) / perm(_DEGREE, j) for j in range(_END_VALUES)] for k in range(_END_VALUES)]
)


class Path(Protocol):
    """Anything that gives position, velocity, acceleration and jerk (…, 4, 3) at times (…)."""

    def __call__(self, time: ArrayLike, /) -> Array:
        """Position and derivatives at `time`."""
        ...


@table
class Fixed(Table):
    """A point that stays where it is."""

    kind: ClassVar[str] = "fixed"
    position: Annotated[Vector, key("the point, [x, y, z] in m")]

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        out = np.zeros((*np.shape(time), ORDERS, 3))
        out[..., 0, :] = self.position
        return out


@table
class Term(Table):
    """A term amplitude · e^(growth·t) · cos(frequency·t + phase)."""

    amplitude: Annotated[Number, key("the amplitude, in m")]
    growth: Number = entry("rate of growth, 1/s; negative: a decay", 0.0)
    frequency: Number = entry("angular frequency, rad/s", 0.0)
    phase: Annotated[Angle, key("phase, degrees", "phase_deg")] = 0.0


@table
class Harmonic(Table):
    """On each axis a sum of growing or decaying oscillations.

    Both paths of the paper (eqs. 20 and 21) are of this kind. Each term is the real part of
    A e^(iφ) e^(st) with s = growth + i·frequency, and a derivative is a factor s.
    """

    kind: ClassVar[str] = "harmonic"
    x: Annotated[tuple[Term, ...], Tables("x", _MOST_TERMS, "terms")] = entry(
        "terms of the first coordinate", ()
    )
    y: Annotated[tuple[Term, ...], Tables("y", _MOST_TERMS, "terms")] = entry(
        "terms of the second coordinate", ()
    )
    z: Annotated[tuple[Term, ...], Tables("z", _MOST_TERMS, "terms")] = entry(
        "terms of the third coordinate", ()
    )

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


def minimum_jerk(time: ArrayLike, duration: float, begin: float) -> Array:
    """Share of a way that is done at times (…), s, from rest to rest, and derivatives (…, 4).

    It is 10s³ − 15s⁴ + 6s⁵, s from 0 to 1 in the duration (Flash and Hogan, 1985).
    """
    t = np.asarray(time, dtype=np.float64)
    s = np.clip((t - begin) / duration, 0.0, 1.0)
    moving = (t >= begin) & (t < begin + duration)
    share = np.stack(
        [
            s**3 * (10.0 + s * (-15.0 + 6.0 * s)),
            30.0 * s**2 * (1.0 - s) ** 2,
            60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
            np.where(moving, 60.0 * (1.0 + s * (-6.0 + 6.0 * s)), 0.0),
        ],
        axis=-1,
    )
    return share / duration ** np.arange(ORDERS)


@table
class Line(Table):
    """A straight line with minimum jerk, at rest before and after."""

    kind: ClassVar[str] = "line"
    start: Annotated[Vector, key("where it begins, [x, y, z] in m")]
    end: Annotated[Vector, key("where it ends, [x, y, z] in m")]
    duration: Annotated[Positive, key("the time from start to end, in s")]
    begin: Number = entry("when it begins, s", 0.0)

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        share = minimum_jerk(time, self.duration, self.begin)
        out: Array = share[..., np.newaxis] * np.subtract(self.end, self.start)
        out[..., 0, :] += self.start
        return out


@table
class Circle(Table):
    """A circle at constant speed, anticlockwise about its normal.

    It begins where the projection of the world's X on its plane points (of Y where the normal is
    within 26° of X), turned by the phase.
    """

    kind: ClassVar[str] = "circle"
    centre: Annotated[Vector, key("the centre, [x, y, z] in m")]
    radius: Annotated[NotNegative, key("the radius, in m")]
    period: Annotated[
        Number,
        needed(lambda period: abs(period) >= LEAST, "must not be 0"),
        key("the time of a turn, in s; negative: the other way round"),
    ]
    normal: Direction = entry("direction of the axis, [x, y, z]", (0.0, 0.0, 1.0))
    phase: Annotated[Angle, key("angle at which it begins, degrees", "phase_deg")] = 0.0

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        t = np.asarray(time, dtype=np.float64)
        first, second = plane(self.normal)
        rate = 2.0 * np.pi / self.period
        angle = (rate * t + self.phase)[..., np.newaxis]
        outwards = self.radius * (np.cos(angle) * first + np.sin(angle) * second)
        ahead = self.radius * (np.cos(angle) * second - np.sin(angle) * first)
        turned = (outwards, rate * ahead, -(rate**2) * outwards, -(rate**3) * ahead)
        out = np.stack(turned, axis=-2)
        out[..., 0, :] += self.centre
        return out


@dataclass(frozen=True)
class Sum:
    """The sum of paths: a tip that moves as wanted beside the base, say."""

    paths: tuple[Path, ...]

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        return np.sum([path(time) for path in self.paths], axis=0)


def check_path(path: Path, duration: float, subject: str) -> None:
    """Raise `UsageError` if a path does not give what it is to, at some times of the flight.

    That is another shape, or rates that are not the derivatives of positions; differences tell
    rough mistakes only.
    """
    time = np.linspace(0.0, duration, 9)[1:-1] * 0.993
    step = 1e-5 * duration
    try:
        here, ahead, behind = (np.asarray(path(time + by), float) for by in (0.0, step, -step))
    except (TypeError, ValueError, IndexError, AttributeError) as error:
        raise UsageError(f"{subject}: cannot be evaluated at an array of times: {error}") from None
    if here.shape != (len(time), ORDERS, 3):
        raise UsageError(
            f"{subject}: must give (…, {ORDERS}, 3) at times (…): position, velocity, acceleration "
            f"and jerk; it gives {here.shape} at {len(time)} times"
        )
    slope = (ahead - behind)[:, :-1] / (2.0 * step)
    off = np.abs(slope - here[:, 1:]).max(axis=(0, 2))
    scale = np.abs(here).max(axis=(0, 2))
    for order, name in enumerate(("velocity", "acceleration", "jerk")):
        # At a jump of the jerk a difference straddles it: then most other times still agree.
        typical = np.median(np.abs(slope - here[:, 1:])[:, order].max(axis=-1))
        allowed = 1e-3 * (scale[order + 1] + scale[order] / duration) + 1e-6
        if off[order] > allowed and typical > allowed:
            raise UsageError(f"{subject}: its {name} is not the derivative of the order before")


def plane(normal: Vector | Array) -> tuple[Array, Array]:
    """Two unit vectors (…, 3) that make right-handed frames with the directions of vectors."""
    n = np.asarray(normal, dtype=np.float64)
    n = n / np.max(np.abs(n), axis=-1, keepdims=True)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    axis = np.eye(3)[np.where(np.abs(n[..., 0]) < 0.9, 0, 1)]
    first = axis - np.sum(axis * n, axis=-1, keepdims=True) * n
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return first, np.cross(n, first)


def _not_endless(values: object) -> object:
    values = to_python(values)
    return at_most(values, _MOST_POINTS, "entries") if isinstance(values, list) else values


def _increasing(times: tuple[float, ...]) -> tuple[float, ...]:
    for place, (sooner, later) in enumerate(itertools.pairwise(times), start=1):
        if later <= sooner:
            raise refusal([((place,), f"must be after {sooner:g}, not {later:g}")])
    return times


_VECTOR = TypeAdapter(Vector)


def _velocity(value: object) -> object:
    if not isinstance(value, str):
        return _VECTOR.validate_python(value)
    if value not in WORDS:
        raise fault(f"{not_one_of(value, WORDS)}; or a velocity [x, y, z] in m/s")
    return value


# A vector, or one of the words: each has its own faults told, which a union would mix.
Velocity = Annotated[
    Vector | Literal["rest", "free"],
    PlainValidator(_velocity),
    WithJsonSchema(
        {
            "anyOf": [
                {"enum": list(WORDS)},
                {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
            ]
        }
    ),
]


@table
class Waypoints(Table):
    """A smooth path through via points at given times, at rest or at a velocity where wanted.

    Four derivatives are continuous. Equal successive points are at rest, and so is the path between
    them. Before and after its points the path rests, or goes straight on with the velocity of the
    first and last point. On a piece from rest to rest, or between rest and a free point, no
    coordinate passes its value at rest.
    """

    kind: ClassVar[str] = "waypoints"
    times: Annotated[
        tuple[Number, ...],
        BeforeValidator(_not_endless),
        AfterValidator(_increasing),
        key("a list of increasing times, s"),
    ]
    points: Annotated[
        tuple[Vector, ...],
        BeforeValidator(_not_endless),
        key("a list of points, [x, y, z] in m, one for each time"),
    ]
    velocities: Annotated[tuple[Velocity, ...], BeforeValidator(_not_endless)] | None = entry(
        'for each point a velocity [x, y, z] in m/s, "rest" or "free"; default: at rest at '
        "both ends, and free between"
    )

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """The fault of times and points of which there are not as many."""
        times, points = (to_python(values.get(key)) for key in ("times", "points"))
        if isinstance(times, list) and isinstance(points, list):
            count = len(times)
            if len(points) != count or count < _FEWEST_POINTS:
                words = f"{len(points)} points at {count} times; give as many of both"
                yield "points", f"{words}, {_FEWEST_POINTS} to {_MOST_POINTS}"

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """Faults of velocities that the points do not allow, and of times without a curve."""
        faults = list(self._velocity_faults())
        yield from faults
        if not faults:
            try:
                _ = self._curves
            except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
                yield ("times",), f"no smooth curve through them: {error}"

    def _velocity_faults(self) -> Iterator[tuple[Place, str]]:
        velocities, count = self.velocities or (), len(self.points)
        if self.velocities is not None and len(velocities) != count:
            last = max(min(len(velocities), count) - 1, 0)
            words = f"{len(velocities)} velocities of {count} points; give as many of both"
            yield ("velocities", last), words
            return
        repeated = _repeated(np.asarray(self.points))
        for number, velocity in enumerate(velocities):
            place = ("velocities", number)
            if not isinstance(velocity, str):
                if repeated[number] and any(velocity):
                    yield place, 'this point is repeated, so the path rests here; give "rest"'
            elif velocity == "free" and number in (0, count - 1):
                yield place, 'the path ends here; give a velocity, or "rest"'

    @cached_property
    def _curves(self) -> list[scipy.interpolate.BPoly]:
        """Position and three derivatives, m, by the time from 0 at the first point to 1."""
        places = np.asarray(self.points)
        free: list[Velocity] = ["free"] * (len(places) - 2)
        velocities = self.velocities or ("rest", *free, "rest")
        with np.errstate(all="raise", under="ignore"):
            # In a time from 0 to 1, so that the unit does not matter to the numbers.
            since = (np.asarray(self.times) - self.times[0]) / self._duration
            if not np.all(np.diff(since) > 0.0):
                raise ValueError("the times must increase")
            curve = _curve(since, _derivatives(since, places, velocities, self._duration))
            return [curve, *(curve.derivative(order) for order in range(1, ORDERS))]

    @property
    def _duration(self) -> float:
        return float(self.times[-1] - self.times[0])

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        t = np.asarray(time, dtype=np.float64)
        s = (t - self.times[0]) / self._duration
        inside = np.clip(s, 0.0, 1.0)
        out: Array = np.stack([curve(inside) for curve in self._curves], axis=-2)
        beyond = (s - inside)[..., np.newaxis]
        out[..., 0, :] += beyond * np.where(beyond < 0.0, *map(self._curves[1], (0.0, 1.0)))
        with np.errstate(all="ignore"):
            out /= (np.float64(self._duration) ** np.arange(ORDERS))[:, np.newaxis]
        return out


def _repeated(places: Array) -> Flags:
    """True (s) for points (s, 3) that are equal to the one before or the one after."""
    same = np.all(places[1:] == places[:-1], axis=1)
    return np.append(same, False) | np.insert(same, 0, False)


def _derivatives(
    since: Array, places: Array, velocities: Sequence[Velocity], duration: float
) -> Array:
    """Position and four derivatives (s, 5, 3), m, at the points, in the time from 0 to 1.

    `since` (s) is such a time; `velocities` are in m/s, "rest" or "free", `duration` in s.
    """
    nodes = np.zeros((len(places), _END_VALUES, 3))
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
        spline = scipy.interpolate.make_interp_spline(since[run], places[run], k=5, bc_type=ends)
        for order in range(1, _END_VALUES):
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
        powers = (since[rests] - since[places])[:, np.newaxis] ** np.arange(1, _END_VALUES)
        change = _COEFFICIENTS[:, 1:] @ (powers[..., np.newaxis] * nodes[places, 1:])
        back = np.max(-np.sign(away)[:, np.newaxis] * change, axis=1)
        allowed = np.divide(np.abs(away), back, out=np.ones_like(away), where=back > 0.0)
        allowed[away == 0.0] = 0.0
        share[places] = np.minimum(share[places], allowed)
    nodes[:, 1:] *= share[:, np.newaxis]


def _curve(since: Array, nodes: Array) -> scipy.interpolate.BPoly:
    """The pieces of degree 9 between points, of the time `since` (s) from 0 to 1.

    `nodes` (s, 5, 3) are position and derivatives there.
    """
    steps = np.diff(since)[:, np.newaxis] ** np.arange(_END_VALUES)
    ahead = _COEFFICIENTS @ (steps[..., np.newaxis] * nodes[:-1])
    signs = (-1.0) ** np.arange(_END_VALUES)
    behind = _COEFFICIENTS @ ((signs * steps)[..., np.newaxis] * nodes[1:])
    coefficients = np.concatenate([ahead, behind[:, ::-1]], axis=1)
    return scipy.interpolate.BPoly(np.moveaxis(coefficients, 1, 0), since)


PathKinds = Kinds((Fixed, Harmonic, Line, Circle, Waypoints), "the kind of path")
# A path of a file is one of the kinds; in Python it may be any.
AnyPath = Annotated[Path, PathKinds]
