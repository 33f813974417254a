"""The desired motion as a function of time: pieces of fifth degree between knots.

At the knots coordinates, rates and accelerations are those of the inverse kinematics; between them
the quintic that takes on all six at its ends. So rates are the derivatives of coordinates
everywhere, a motion costs the same to evaluate whatever made it, and C can evaluate it too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.scenario.attitude import SingularAttitudeError
from gibbs_codegen.scenario.orientation import Orientation
from gibbs_codegen.scenario.paths import Path
from gibbs_codegen.simulator.inverse_kinematics import (
    OTHER_SCENARIO,
    Limits,
    Motion,
    arm_motion,
    base_motion,
)
from gibbs_codegen.simulator.vehicle import Vehicle

Array = NDArray[np.float64]

KNOT_SPACING = 0.005
# How far pieces may be from the motion between knots, rad or m, and what rounding adds per 1.
_OFF = 1e-7
_ROUNDING = 1e-14
# Parts that each piece is checked at the ends of.
_CHECKS = 4
# How many times as many knots there may be, and how many pieces they may make, where it takes more.
_FINEST = 32
_MOST_PIECES = 1_000_000
# Pieces that are worked on at once: bounds the memory.
_AT_A_TIME = 1024
# Lengths, speeds and so on, in m and s, that no machine comes to.
_BOUND = 1e12
_BASE_TOO_FAST = (
    "the base moves too fast or its attitude jumps",
    "choose a gentler motion, or a shorter one",
)
_TIP_TOO_FAST = (
    "the arm, or the path of its tip, moves too fast",
    "slow it down, or lead the tip farther past the axes of joints and the edge of its reach",
)


@dataclass(frozen=True)
class _Miss:
    """Where a motion is not followed: in which piece, when (s), and how far off, in a unit."""

    piece: int
    time: float
    distance: float
    unit: str


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
        # What is left for the upper three powers at the end of a piece: way, rate, acceleration.
        way, rate, bend = q1 - q0 - v0 - a0 / 2, v1 - v0 - a0, a1 - a0
        powers = [
            q0,
            v0,
            a0 / 2,
            10 * way - 4 * rate + bend / 2,
            -15 * way + 7 * rate - bend,
            6 * way - 3 * rate + bend / 2,
        ]
        self.coefficients: Array = np.stack([p / h**k for k, p in enumerate(powers)], axis=1)

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


def knots(duration: float, spacing: float = KNOT_SPACING) -> Array:
    """Times from 0 to `duration`, equally spaced, at most `spacing` apart."""
    return np.linspace(0.0, duration, max(int(np.ceil(duration / spacing)), 1) + 1)


def refined(time: Array, times: int) -> Array:
    """Even times (s) with `times` as many steps over the same span."""
    return np.linspace(time[0], time[-1], times * (len(time) - 1) + 1) if times > 1 else time


def desired_base(
    vehicle: Vehicle,
    time: Array,
    centre: Path,
    orientation: Orientation,
    progress: Callable[[float], None] = lambda share: None,
) -> Motion:
    """Motion of the base, its centre on a path, the arm's coordinates at rest at 0.

    The knots are those of `time` (s, evenly spaced), or where pieces between them do not follow the
    motion, 2, 4 … times as many. `progress` is told the share that is done. Raises `UsageError`
    with the time where the attitude is singular or not defined, and where the motion is so fast, or
    turns so sharply, that not even the most knots follow it.
    """
    pieces, fineness = len(time) - 1, 1
    while True:
        needed = fineness
        parts: list[Motion] = []
        for begin in range(0, pieces, _AT_A_TIME):
            span = time[begin : begin + _AT_A_TIME + 1]
            part, miss = _base_part(vehicle, refined(span, needed), centre, orientation)
            while miss is not None:
                needed = _finer(needed, time, miss, *_BASE_TOO_FAST)
                part, miss = _base_part(vehicle, refined(span, needed), centre, orientation)
            parts.append(part)
            progress(min(1.0, (begin + _AT_A_TIME) / pieces))
        if needed == fineness:
            return _joined(refined(time, fineness), parts, vehicle.layout.attitude)
        fineness = needed


def _base_part(
    vehicle: Vehicle, time: Array, centre: Path, orientation: Orientation
) -> tuple[Motion, _Miss | None]:
    """Motion of the base at knots, and where pieces between them miss it most, if they do."""
    every = _checked(time)
    places = _bounded(every, centre, "path of the base")
    with np.errstate(all="ignore"):
        turning = orientation(centre, every, vehicle.arm_angles())
        spins = np.abs([turning.velocity, turning.acceleration])
        beyond = ~np.all(spins < _BOUND, axis=(0, -1))
    _refuse(every, beyond, "the base turns too fast")
    try:
        whole = base_motion(vehicle, every, places, turning)
    except SingularAttitudeError as error:
        message = f"at t = {every[error.place]:.6g} s {error}"
        raise SingularAttitudeError(message, error.place) from None
    motion = Motion(time, *(series[::_CHECKS] for series in (whole.q, whole.v, whole.a)))
    q, v, _ = Reference(motion)(every)
    step = every[1] - every[0]
    # Rates too: a base that turns once between checks seems to stand still.
    off = np.maximum(np.abs(q - whole.q), step * np.abs(v - whole.v))
    excess = off / (_OFF + _ROUNDING * np.abs(whole.q).max(axis=0))
    instant, coordinate = np.unravel_index(np.argmax(excess), excess.shape)
    if excess[instant, coordinate] <= 1.0:
        return motion, None
    unit = vehicle.layout.units[int(coordinate)]
    return motion, _Miss(int(instant) // _CHECKS, every[instant], off[instant, coordinate], unit)


def _joined(time: Array, parts: list[Motion], attitude: slice) -> Motion:
    """One motion of parts, each of which begins where the one before ends."""
    q, v, a = (np.empty((len(time), parts[0].q.shape[1])) for _ in range(3))
    begin = 0
    for part in parts:
        if begin:
            # The angles of each part begin within (−π, π], whatever they had grown to before.
            jump = q[begin, attitude] - part.q[0, attitude]
            part.q[:, attitude] += 2.0 * np.pi * np.round(jump / (2.0 * np.pi))
        share = slice(begin, begin + len(part.time))
        q[share], v[share], a[share] = part.q, part.v, part.a
        begin += len(part.time) - 1
    return Motion(time, q, v, a)


def desired_with_tip(
    vehicle: Vehicle,
    time: Array,
    base_at: Callable[[Array], Motion],
    tip: Path,
    limits: Limits,
    guess: Array | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Motion:
    """Motion of base and arm, with the tip on a path.

    `base_at` gives the motion of the base for knots as `desired_base` does. The knots are those of
    `time` (s, evenly spaced), or where the tip leaves its path between them, 2, 4 … times as many.
    Raises `UnreachableError` for points out of reach, `SingularArmError` where the arm cannot move
    as the path wants, and `UsageError` where not even the most knots keep the tip on its path.
    """
    if vehicle.joints == 0:
        raise UsageError(
            f"{vehicle.name}: has no arm, so its tip cannot follow a path of its own; "
            f"{OTHER_SCENARIO}"
        )
    base = base_at(time)
    while True:
        _bounded(base.time, tip, "path of the tip")
        motion = arm_motion(vehicle, base, tip, limits, guess, progress)
        miss = _tip_miss(vehicle, motion, tip)
        if miss is None:
            return motion
        # How many knots it takes is found on the worst piece alone, and then holds for all.
        span, start = base.time[miss.piece : miss.piece + 2], motion.q[miss.piece, vehicle.arm]
        already = fineness = (len(base.time) - 1) // (len(time) - 1)
        while miss is not None:
            fineness = _finer(fineness, time, miss, *_TIP_TOO_FAST)
            near = base_at(refined(span, fineness // already))
            miss = _tip_miss(vehicle, arm_motion(vehicle, near, tip, limits, start), tip)
        base = base_at(refined(time, fineness))


def _tip_miss(vehicle: Vehicle, motion: Motion, tip: Path) -> _Miss | None:
    """Where the tip is farthest from its path between knots, if it leaves it."""
    reference = Reference(motion)
    worst, found = 1.0, None
    for begin in range(0, len(motion.time) - 1, _AT_A_TIME):
        every = _checked(motion.time[begin : begin + _AT_A_TIME + 1])
        places = _bounded(every, tip, "path of the tip")[:, 0]
        reached = vehicle.tip_pose(reference(every)[0])[:, :3, 3]
        off = np.linalg.norm(reached - places, axis=-1)
        excess = off / (_OFF + _ROUNDING * np.abs(places).max())
        instant = int(np.argmax(excess))
        if not excess[instant] <= worst:
            worst = excess[instant]
            found = _Miss(begin + instant // _CHECKS, every[instant], off[instant], "m")
    return found


def _checked(time: Array) -> Array:
    """Knots, and between them the instants that pieces are checked at."""
    every = refined(time, _CHECKS)
    every[::_CHECKS] = time
    return every


def _finer(fineness: int, time: Array, miss: _Miss, what: str, remedy: str) -> int:
    """Twice the fineness of knots; `UsageError` with the miss where there are enough already."""
    pieces = len(time) - 1
    if 2 * fineness <= _FINEST and 2 * fineness * pieces <= _MOST_PIECES:
        return 2 * fineness
    spacing = (time[-1] - time[0]) / pieces / fineness
    raise UsageError(
        f"at t = {miss.time:.6g} s {what}: between knots {spacing:.3g} s apart, the nearest that "
        f"a flight of this length may have, it is missed by {miss.distance:.3g} {miss.unit}; "
        f"{remedy}"
    )


def _bounded(time: Array, path: Path, what: str) -> Array:
    """What a path gives at times (s), if it is no larger than numbers can be that matter here."""
    with np.errstate(all="ignore"):
        places = path(time)
        beyond = ~np.all(np.abs(places) < _BOUND, axis=(-1, -2))
    _refuse(time, beyond, f"the {what} or one of its derivatives grows beyond all bounds")
    return places


def _refuse(time: Array, wrong: NDArray[np.bool_], what: str) -> None:
    if np.any(wrong):
        raise UsageError(f"at t = {time[wrong][0]:.6g} s {what}; choose a gentler motion")


def desired_with_posture(vehicle: Vehicle, base: Motion, posture: Array) -> Motion:
    """Motion of the base at knots, with the arm's coordinates held at `posture` (n)."""
    q = base.q.copy()
    q[:, vehicle.arm] = posture
    return Motion(base.time, q, base.v, base.a)
