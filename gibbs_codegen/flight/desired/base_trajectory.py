"""Desired motion of the base: attitude and position are exact at the knots."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.flight.desired.knots import (
    BATCH,
    BOUND,
    CHECKS,
    Deviation,
    bounded_path,
    check_none,
    check_times,
    refine,
    refined,
    tolerance,
)
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Motion
from gibbs_codegen.flight.scenario.orientation import Orientation, SingularAttitudeError, Turning
from gibbs_codegen.flight.scenario.paths import Path

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
    `progress` is told the share done, 0 to 1. Raises `UsageError` where the attitude is singular or
    not defined, or not even the most knots follow the motion.
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
            return _joined(vehicle, refined(time, refinement), parts)
        refinement = needed


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
    lever = vehicle.centre_offset(q)
    spin, spin_rate = turning.velocity, turning.acceleration
    swept = np.cross(spin, lever)
    q[:, layout.q.position] = centre[:, 0] - lever
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
    every = check_times(time)
    places = bounded_path(every, centre, "path of the base")
    with np.errstate(all="ignore"):
        turning = orientation(centre, every, vehicle.arm_angles())
        spins = np.abs([turning.velocity, turning.acceleration])
        beyond = ~np.all(spins < BOUND, axis=(0, -1))
    check_none(every, beyond, "the base turns too fast")
    try:
        exact = base_motion(vehicle, every, places, turning)
    except SingularAttitudeError as error:
        message = f"at t = {every[error.place]:.6g} s {error}"
        raise SingularAttitudeError(message, error.place) from None
    motion = Motion(time, *(series[::CHECKS] for series in (exact.q, exact.v, exact.a)))
    kinematics, step = vehicle.kinematics, every[1] - every[0]
    q, v, _ = kinematics.reference(motion)(every)
    deviation, deviation_rate = kinematics.errors(exact.q, exact.v, q, v)
    # Rates too: a base that turns once between checks seems to stand still.
    off = np.maximum(np.abs(deviation), step * np.abs(deviation_rate))
    places, _ = kinematics.errors(np.tile(vehicle.neutral, (len(every), 1)), 0.0 * v, exact.q, v)
    excess = off / tolerance(np.abs(places).max(axis=0))
    instant, coordinate = np.unravel_index(np.argmax(excess), excess.shape)
    if excess[instant, coordinate] <= 1.0:
        return motion, None
    unit = vehicle.layout.v.units[int(coordinate)].removesuffix("/s")
    piece = int(instant) // CHECKS
    return motion, Deviation(piece, every[instant], off[instant, coordinate], unit)


def _joined(vehicle: Vehicle, time: Array, parts: list[Motion]) -> Motion:
    """One motion of parts that share their end knots, with attitude angles that go on beyond ±π."""
    attitude = vehicle.layout.q.attitude
    q = np.empty((len(time), vehicle.layout.q.size))
    v, a = np.empty((2, len(time), vehicle.layout.v.size))
    begin = 0
    for part in parts:
        if begin:
            # Each part begins within (−π, π], whatever the angles had grown to before.
            part.q[:, attitude] = vehicle.kinematics.continued(
                q[begin, attitude], part.q[:, attitude]
            )
        share = slice(begin, begin + len(part.time))
        q[share], v[share], a[share] = part.q, part.v, part.a
        begin += len(part.time) - 1
    return Motion(time, q, v, a)
