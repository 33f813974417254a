"""Desired motion of the base: attitude and position are exact at the knots."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.scenario.attitude import SingularAttitudeError, Turning
from gibbs_codegen.scenario.orientation import Orientation
from gibbs_codegen.scenario.paths import Path
from gibbs_codegen.simulator.desired.knots import (
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
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.reference import Motion

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

    Args:
        vehicle: The robot.
        time: Knots (s), evenly spaced, s. Where pieces between them do not follow the motion, 2,
            4 … times as many are taken.
        centre: Path of the base centre.
        orientation: Attitude of the base.
        progress: Is told the share that is done, 0 to 1.

    Returns:
        The motion at the knots.

    Raises:
        UsageError: With the time where the attitude is singular or not defined, and where the
            motion is so fast, or turns so sharply, that not even the most knots follow it.
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
    """Motion of attitude and position, with the arm's coordinates at rest at 0.

    Args:
        vehicle: The robot.
        time: Times (s), s.
        centre: Position, velocity and acceleration of the base centre (s, ≥ 3, 3), world axes, m
            and s.
        turning: Rotation of the base in time, with s instants.

    Returns:
        The motion at the times.

    Raises:
        SingularAttitudeError: Near the singularity of the attitude sequence.
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
    """Motion of the base at some knots, and where pieces between them leave it.

    Args:
        vehicle: The robot.
        time: Knots (s), evenly spaced, s.
        centre: Path of the base centre.
        orientation: Attitude of the base.

    Returns:
        The motion at the knots, and its greatest deviation; None if that is within the tolerance.

    Raises:
        SingularAttitudeError: With the time where the attitude is singular.
    """
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
    """One motion of parts, each of which begins where the one before ends.

    Args:
        vehicle: The robot.
        time: All knots (s), s.
        parts: Motions at successive knots; the last knot of each is the first of the next.

    Returns:
        The motion at all knots, with attitude angles that go on beyond ±π.
    """
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
