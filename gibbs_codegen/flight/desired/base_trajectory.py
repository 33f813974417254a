"""Desired motion of the base: attitude and position are exact at the knots.

Motions of base and tip are checked at instants between knots. Where the quintic of a piece is too
far from the motion, the spacing of all knots is halved, until it fits or becomes too small.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.attitude import SingularAttitudeError, Turning
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Motion
from gibbs_codegen.flight.scenario.orientation import Orientation
from gibbs_codegen.flight.scenario.paths import Path
from gibbs_codegen.flight.vectors import times

_TOO_FAST = (
    "the base moves too fast or its attitude jumps",
    "choose a gentler motion, or a shorter one",
)


def desired_base(
    vehicle: Vehicle,
    time: Array,
    centre: Path,
    orientation: Orientation,
    progress: Callable[[float], None] = lambda share: None,
) -> Motion:
    """Motion of the base with its centre on a path, and the arm's coordinates at 0.

    Where pieces between the evenly spaced knots leave the motion, 2, 4 … times as many are taken.
    `progress` is called with the share done, 0 to 1. Raises `UsageError` where the attitude is
    singular or not defined, or not even the most knots follow the motion.
    """
    pieces, refinement = len(time) - 1, 1
    while True:
        needed = refinement
        parts: list[Motion] = []
        for begin in range(0, pieces, BATCH):
            span = time[begin : begin + BATCH + 1]
            part, deviation = _part(vehicle, refined(span, needed), centre, orientation)
            while deviation is not None:
                needed = refine(needed, time, deviation, *_TOO_FAST)
                part, deviation = _part(vehicle, refined(span, needed), centre, orientation)
            parts.append(part)
            progress(min(1.0, (begin + BATCH) / pieces))
        if needed == refinement:
            break
        refinement = needed
    attitude = vehicle.layout.q.attitude
    for before, part in itertools.pairwise(parts):
        # Each part begins within (−π, π], whatever the angles had grown to before.
        part.q[:, attitude] = vehicle.kinematics.continued(
            before.q[-1, attitude], part.q[:, attitude]
        )
    # Parts share their end knots.
    series = ((part.q[:-1], part.v[:-1], part.a[:-1]) for part in parts)
    ends = parts[-1].q[-1:], parts[-1].v[-1:], parts[-1].a[-1:]
    return Motion(refined(time, refinement), *map(np.concatenate, zip(*series, ends, strict=True)))


def base_motion(vehicle: Vehicle, time: Array, centre: Array, turning: Turning) -> Motion:
    """Motion of attitude and base centre (s, ≥ 3, 3), world axes, with the arm at rest at 0.

    Raises `SingularAttitudeError` near the singularity of the attitude sequence.
    """
    layout = vehicle.layout
    q = np.zeros((len(time), layout.q.size))
    v, a = np.zeros((2, len(time), layout.v.size))
    entries = q[:, layout.q.attitude], v[:, layout.v.attitude], a[:, layout.v.attitude]
    for entry, value in zip(entries, vehicle.kinematics.turned(turning), strict=True):
        entry[...] = value
    q[:, layout.q.position] = (centre[:, 0] - vehicle.centre_offset(q))[:, layout.own_axes[0]]
    lever = times(turning.rotation, vehicle.lever)
    spin, spin_rate = turning.velocity, turning.acceleration
    swept = np.cross(spin, lever)
    v[:, layout.v.position], a[:, layout.v.position] = vehicle.kinematics.moved(
        turning,
        centre[:, 1] - swept,
        centre[:, 2] - np.cross(spin_rate, lever) - np.cross(spin, swept),
    )
    return Motion(time, q, v, a)


def _part(
    vehicle: Vehicle, time: Array, centre: Path, orientation: Orientation
) -> tuple[Motion, Deviation | None]:
    """Motion at some knots, and where pieces between leave it most; None within the tolerance."""
    times = check_times(time)
    places = bounded_path(times, centre, "path of the base")
    with np.errstate(all="ignore"):
        turning = orientation(centre, times, vehicle.arm_angles())
        spins = np.abs([turning.velocity, turning.acceleration])
        beyond = ~np.all(spins < BOUND, axis=(0, -1))
    check_none(times, beyond, "the base turns too fast")
    try:
        exact = base_motion(vehicle, times, places, turning)
    except SingularAttitudeError as error:
        message = f"at t = {times[error.place]:.6g} s {error}"
        raise SingularAttitudeError(message, error.place) from None
    motion = Motion(time, *(series[::CHECKS] for series in (exact.q, exact.v, exact.a)))
    kinematics, step = vehicle.kinematics, times[1] - times[0]
    q, v, _ = kinematics.reference(motion)(times)
    deviation, deviation_rate = kinematics.errors(exact.q, exact.v, q, v)
    # Rates too: a base that turns once between checks seems to stand still.
    off = np.maximum(np.abs(deviation), step * np.abs(deviation_rate))
    places, _ = kinematics.errors(np.tile(vehicle.neutral, (len(times), 1)), 0.0 * v, exact.q, v)
    excess = off / tolerance(np.abs(places).max(axis=0))
    instant, coordinate = np.unravel_index(np.argmax(excess), excess.shape)
    if excess[instant, coordinate] <= 1.0:
        return motion, None
    unit = vehicle.layout.v.units[int(coordinate)].removesuffix("/s")
    piece = int(instant) // CHECKS
    return motion, Deviation(piece, times[instant], off[instant, coordinate], unit)


KNOT_SPACING = 0.005
# Parts that each piece is checked at the ends of.
CHECKS = 4
# Pieces that are worked on at once: bounds the memory.
BATCH = 1024
# How far pieces may be from the motion between knots, rad or m, and what rounding adds per 1.
_TOLERANCE = 1e-7
_ROUNDING = 1e-14
# Greatest refinement, and the greatest number of pieces that refinement may lead to.
_FINEST = 32
_MOST_PIECES = 1_000_000
# Lengths, speeds and so on, in m and s, that no vehicle comes to.
BOUND = 1e12


@dataclass(frozen=True)
class Deviation:
    """A deviation of pieces from the motion: its piece, time (s), and size in a unit."""

    piece: int
    time: float
    distance: float
    unit: str


def knots(duration: float, spacing: float = KNOT_SPACING) -> Array:
    """Times (s), s, from 0 to `duration`, equally spaced by at most `spacing`."""
    return np.linspace(0.0, duration, max(int(np.ceil(duration / spacing)), 1) + 1)


def refined(time: Array, refinement: int) -> Array:
    """Times (refinement · (s − 1) + 1), s, over the same span with so many times as many steps."""
    if refinement == 1:
        return time
    return np.linspace(time[0], time[-1], refinement * (len(time) - 1) + 1)


def check_times(time: Array) -> Array:
    """Knots, and between them the instants at which pieces are checked.

    They are (CHECKS · (s − 1) + 1); every CHECKS-th is exactly a knot.
    """
    times = refined(time, CHECKS)
    times[::CHECKS] = time
    return times


def tolerance(size: float | Array) -> float | Array:
    """The tolerance of pieces for a largest coordinate or position of a motion, rad or m."""
    return _TOLERANCE + _ROUNDING * size


def refine(refinement: int, time: Array, deviation: Deviation, cause: str, remedy: str) -> int:
    """Twice the refinement of knots, because pieces between them leave the motion.

    Raises `UsageError`, with the clause `cause` and the `remedy`, if knots so near are not allowed.
    `time` (s) are the knots before any refinement.
    """
    pieces = len(time) - 1
    if 2 * refinement <= _FINEST and 2 * refinement * pieces <= _MOST_PIECES:
        return 2 * refinement
    spacing = (time[-1] - time[0]) / pieces / refinement
    raise UsageError(
        f"at t = {deviation.time:.6g} s {cause}: with knots {spacing:.3g} s apart (the closest "
        f"for a flight of this length) the trajectory is off by {deviation.distance:.3g} "
        f"{deviation.unit}; {remedy}"
    )


def bounded_path(time: Array, path: Path, name: str) -> Array:
    """Position to jerk (s, 4, 3) of a path, world axes.

    Raises `UsageError`, with the first time, where they are not finite or too great to be flown.
    """
    with np.errstate(all="ignore"):
        values = path(time)
        beyond = ~np.all(np.abs(values) < BOUND, axis=(-1, -2))
    check_none(time, beyond, f"the {name} or one of its derivatives exceeds {BOUND:g}")
    return values


def check_none(time: Array, wrong: NDArray[np.bool_], fault: str) -> None:
    """Raise `UsageError`, with the clause `fault` and the first time (s), if any is wrong (s)."""
    if np.any(wrong):
        raise UsageError(f"at t = {time[wrong][0]:.6g} s {fault}; choose a gentler motion")
