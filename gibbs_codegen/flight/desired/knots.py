"""Knots of a desired motion: their spacing, and its refinement where pieces leave the motion.

Motions of base and tip are checked at instants between knots. Where the quintic of a piece is too
far from the motion, the spacing of all knots is halved, until it fits or becomes too small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.scenario.paths import Path

Array = NDArray[np.float64]

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
    """Where pieces leave the motion: in which piece, at what time (s), and how far, in a unit."""

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
    every = refined(time, CHECKS)
    every[::CHECKS] = time
    return every


def tolerance(size: float | Array) -> float | Array:
    """How far pieces may be from a motion of such a largest coordinate or position, rad or m."""
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
        f"at t = {deviation.time:.6g} s {cause}: with knots {spacing:.3g} s apart, the closest "
        f"allowed for a flight of this length, the trajectory between them is off by "
        f"{deviation.distance:.3g} {deviation.unit}; {remedy}"
    )


def bounded_path(time: Array, path: Path, name: str) -> Array:
    """Position to jerk (s, 4, 3) of a path, world axes.

    Raises `UsageError`, with the first time, where they are not finite or too great to be flown.
    """
    with np.errstate(all="ignore"):
        values = path(time)
        beyond = ~np.all(np.abs(values) < BOUND, axis=(-1, -2))
    check_none(time, beyond, f"the {name} or one of its derivatives grows beyond all bounds")
    return values


def check_none(time: Array, wrong: NDArray[np.bool_], fault: str) -> None:
    """Raise `UsageError`, with the clause `fault` and the first time (s), if any is wrong (s)."""
    if np.any(wrong):
        raise UsageError(f"at t = {time[wrong][0]:.6g} s {fault}; choose a gentler motion")
