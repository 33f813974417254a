"""Desired attitude of the base: along the tangent of its path, level, or turned from level.

Attitude angles are the three of an intrinsic sequence: R = R_a(θ₋₁)·R_b(θ₀)·R_c(θ₁) turns vectors
of arm 1's frame into the world's. The angular velocity in world axes is ω = E(θ)·θ̇, where the
columns of E are the axes that the three angles turn about. All functions take any leading axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.table import Bounds, Kinds, Table, Whole, entry, key, table
from gibbs_codegen.flight.attitude import (
    Derivatives,
    Turning,
    product_derivatives,
    turning_of,
    unit_derivatives,
)
from gibbs_codegen.flight.scenario.numbers import Angle, Direction, NotNegative, Positive
from gibbs_codegen.flight.scenario.paths import Path, minimum_jerk
from gibbs_codegen.flight.vectors import Array, rotation_about
from gibbs_codegen.robot.parts.rotor import MAX_ROTORS

_VERTICAL = np.array([0.0, 0.0, 1.0])
# Speed under which a path has no direction of its own, m/s: it has that of where it moves next.
_STANDSTILL = 1e-6
# Times from a rest at which that is looked for, s, and parts between two that halve the way to it.
_AWAY = 1e-3 * 1.25 ** np.arange(80)
_HALVES = 40
# Between times whose difference gives a jerk, s.
_NEAR = 1e-3
# How far tangents before and after a rest may be from one another, and rate, 1/s, at a stay.
_CORNER, _BEND = 1e-3, 1e-2
# Sine of the angle to the vertical under which the base normal has no side to lean to.
_UPRIGHT = 1e-3


class Orientation(Protocol):
    """Anything that gives the attitude of the base at times (s), for a base on a path.

    `arm_angles` (N) are the angles of the base arms about z of the base, from its x axis, rad.
    """

    def __call__(self, path: Path, time: Array, arm_angles: Array, /) -> Turning:
        """Rotation, angular velocity and angular acceleration at `time`."""
        ...


@table
class Level(Table):
    """The base level, with a heading of its x axis that turns at a constant rate."""

    kind: ClassVar[str] = "level"
    heading: Annotated[Angle, key("heading at the start, degrees", "heading_deg")] = 0.0
    rate: Annotated[Angle, key("rate of the heading, degrees per second", "rate_deg")] = 0.0

    def __call__(self, path: Path, time: Array, arm_angles: Array) -> Turning:
        """Rotation, angular velocity and angular acceleration at times (s)."""
        heading = self.heading + self.rate * np.asarray(time, dtype=np.float64)
        velocity = np.zeros((*heading.shape, 3))
        velocity[..., 2] = self.rate
        return Turning(rotation_about(_VERTICAL, heading), velocity, np.zeros_like(velocity))


@table
class Turn(Table):
    """The base level at first, then turned about an axis, from rest to rest with minimum jerk."""

    kind: ClassVar[str] = "turn"
    axis: Annotated[Direction, key("the axis that the base is turned about, in world axes")]
    angle: Annotated[
        Angle, key("how far it is turned, degrees; more than 360 is allowed", "angle_deg")
    ]
    duration: Annotated[Positive, key("how long the turn takes, s")]
    begin: NotNegative = entry("when the turn begins, s", 0.0)
    heading: Annotated[Angle, key("heading before the turn, degrees", "heading_deg")] = 0.0

    def __call__(self, path: Path, time: Array, arm_angles: Array) -> Turning:
        """Rotation, angular velocity and angular acceleration at times (s)."""
        axis = np.array(self.axis) / math.hypot(*self.axis)
        share = self.angle * minimum_jerk(time, self.duration, self.begin)
        rate, growth = (share[..., order, np.newaxis] * axis for order in (1, 2))
        start = rotation_about(_VERTICAL, np.array(self.heading))
        return Turning(rotation_about(axis, share[..., 0]) @ start, rate, growth)


@table
class Tangent(Table):
    """A base arm along the path, the base normal nearest to Z: the paper's attitude (section 4).

    A base without arms has its x axis along the path.
    """

    kind: ClassVar[str] = "tangent"
    arm: Annotated[Whole, Bounds(1, MAX_ROTORS)] = entry(
        "number of the base arm that is tangent to the path", 2
    )

    def __call__(self, path: Path, time: Array, arm_angles: Array) -> Turning:
        """Rotation, angular velocity and angular acceleration at times (s).

        Raises `UsageError` where there is no such arm, and where the path has no tangent or goes
        straight up or down.
        """
        if len(arm_angles) and not 1 <= self.arm <= len(arm_angles):
            arms = f"there are arms 1 to {len(arm_angles)}"
            raise UsageError(f"base.attitude.arm: {self.arm}: {arms}")
        angle = arm_angles[self.arm - 1] if len(arm_angles) else 0.0
        time = np.asarray(time, dtype=np.float64)
        along = _tangents(path, time)
        upright = np.linalg.norm(along[0][..., :2], axis=-1) < _UPRIGHT
        if np.any(upright):
            raise UsageError(
                f"the path of the base is vertical at t = {time[upright][0]:.6g} s, so the "
                "attitude along it is not unique; bend it, or choose a level attitude"
            )
        # The part of the vertical at right angles to the tangent.
        heights = along[0][..., 2:], along[1][..., 2:], along[2][..., 2:]
        leaning, rate, growth = product_derivatives(np.multiply, heights, along)
        up = unit_derivatives(_VERTICAL - leaning, -rate, -growth)
        side = product_derivatives(np.cross, up, along)
        # Columns: the tangent, what lies left of it, the normal; then the base's x in their place.
        cosine, sine = np.cos(angle), np.sin(angle)
        frames = [
            np.stack([cosine * t - sine * s, sine * t + cosine * s, u], axis=-1)
            for t, s, u in zip(along, side, up, strict=True)
        ]
        return turning_of(*frames)


def _tangents(path: Path, time: Array) -> Derivatives:
    """Unit tangents (…, 3) of a path at times (…), s, and their first two derivatives.

    Where it rests for a moment they go on as they are beside it; where it stays, they stay. Raises
    `UsageError` where it never moves, goes on in another direction, or bends beside a stay.
    """
    shape, time = (*time.shape, 3), time.ravel()
    derivatives = path(time)
    along = unit_derivatives(*(derivatives[:, order] for order in (1, 2, 3)))
    rests = np.flatnonzero(np.linalg.norm(derivatives[:, 1], axis=-1) < _STANDSTILL)
    for rest in np.split(rests, np.flatnonzero(np.diff(rests) > 1) + 1) if len(rests) else ():
        still = rest[~np.any(derivatives[rest, 1:], axis=(1, 2))]
        stays = len(still) > 1
        ends = time[still[[0, -1]] if stays else rest[[0, -1]]]
        sides = list[tuple[float, Derivatives]]()
        for t, way in zip(ends, (-1.0, 1.0), strict=True):
            # After the last of the times it may go anywhere.
            is_last = bool(sides) and rest[-1] + 1 == time.size
            if not is_last and (side := _beside(path, t, way)):
                sides.append(side)
        fault = f"the path of the base stands still at t = {ends[0]:.6g} s, where it "
        if not sides:
            raise UsageError(f"{fault}has no tangent; let it move, or choose a level attitude")
        near = [_later(direction, 0.0 if stays else ends[0] - begin) for begin, direction in sides]
        if np.abs(near[0][0] - near[-1][0]).max() > _CORNER:
            raise UsageError(
                f"{fault}changes its direction; give it a bend there, or choose a level attitude"
            )
        for begin, (_, rate, second) in sides if stays else ():
            # At the stay itself it may be less.
            until = np.abs(ends - begin).min()
            if np.abs(rate).max() > _BEND + until * np.abs(second).max():
                raise UsageError(
                    f"the path of the base bends at t = {begin:.3g} s, next to a stop; make it "
                    "straight there, or choose a level attitude"
                )
        for k in rest:
            stay = stays and still[0] <= k <= still[-1]
            begin, direction = min(sides, key=lambda side: abs(side[0] - time[k]))
            since = (ends[int(begin > ends[1])] if stay else time[k]) - begin
            limits = unit_derivatives(*_later(direction, since))
            for series, limit in zip(along, limits, strict=True):
                series[k] = 0.0 if stay and series is not along[0] else limit
    first, second, third = (series.reshape(shape) for series in along)
    return first, second, third


def _later(derivatives: Derivatives, since: float) -> Derivatives:
    """A vector and two derivatives some time later, s, were the second constant."""
    unit, rate, second = derivatives
    return unit + since * (rate + 0.5 * since * second), rate + since * second, second


def _beside(path: Path, time: float, way: float) -> tuple[float, Derivatives] | None:
    """When a path moves next, after a time or, for −1, before, s, and its tangents then.

    None if it does not; no path is there before 0 s.
    """
    times = time + way * _AWAY
    moves = (np.linalg.norm(path(times)[:, 1], axis=-1) >= _STANDSTILL) & (times >= 0.0)
    if not np.any(moves):
        return None
    k = int(np.argmax(moves))
    still, moving = (float(times[k - 1]) if k else time), float(times[k])
    for _ in range(_HALVES):
        middle = 0.5 * (still + moving)
        if np.linalg.norm(path(middle)[1]) < _STANDSTILL:
            still = middle
        else:
            moving = middle
    return moving, unit_derivatives(*path(moving)[1:])


@dataclass(frozen=True)
class Carried:
    """A path from the base centre in axes that turn with the base, which is on a path itself.

    Base arms, which an attitude may go by, are left out.
    """

    base: Path
    attitude: Orientation
    path: Path

    def __call__(self, time: ArrayLike) -> Array:
        """Position and derivatives (…, 4, 3) at times (…)."""
        time = np.asarray(time, dtype=np.float64)
        before, now, after = (self._moved(time + step) for step in (-_NEAR, 0.0, _NEAR))
        # Orientations have no third derivative; no motion has this one, only clocks do.
        jerk = (after[..., 2:, :] - before[..., 2:, :]) / (2.0 * _NEAR)
        return np.concatenate([now, jerk], axis=-2)

    def _moved(self, time: Array) -> Array:
        """Position, velocity and acceleration (…, 3, 3)."""
        turning = self.attitude(self.base, time, np.zeros(0))
        beside = self.path(time)[..., :3, :] @ np.swapaxes(turning.rotation, -1, -2)
        spin, (place, rate, acceleration) = turning.velocity, np.moveaxis(beside, -2, 0)
        carried = np.cross(spin, place)
        acceleration = acceleration + np.cross(turning.acceleration, place)
        acceleration = acceleration + np.cross(spin, 2.0 * rate + carried)
        moved = np.stack([place, rate + carried, acceleration], axis=-2)
        return np.asarray(self.base(time)[..., :3, :] + moved)


def heading_error(path: Path, time: ArrayLike, direction: Array) -> Array:
    """Angles (s), rad, between unit vectors (s, 3), world axes, and the tangent of a path."""
    tangent = _tangents(path, np.asarray(time, dtype=np.float64))[0]
    # By the chord: the cosine cannot tell angles below 1e-8.
    half = np.linalg.norm(direction - tangent, axis=-1) / 2.0
    return 2.0 * np.arcsin(np.minimum(half, 1.0))


# An attitude of a file is one of the kinds.
AnyAttitude = Annotated[
    Level | Turn | Tangent, Kinds((Level, Turn, Tangent), "the kind of attitude", "level")
]
