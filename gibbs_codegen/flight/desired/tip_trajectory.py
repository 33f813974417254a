"""Desired motion of base and arm with the tip on a path, also between knots."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.desired.inverse_kinematics import OTHER_SCENARIO, Limits, arm_motion
from gibbs_codegen.flight.desired.knots import (
    BATCH,
    CHECKS,
    Deviation,
    bounded_path,
    check_times,
    refine,
    refined,
    tolerance,
)
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Motion
from gibbs_codegen.flight.scenario.paths import Path

_TOO_FAST = (
    "the arm, or the path of its tip, moves too fast",
    "slow it down, or lead the tip farther past the axes of joints and the edge of its reach",
)


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

    Where the tip leaves it between the evenly spaced knots, 2, 4 … times as many are taken.
    `base_at` gives the base's motion for knots, as `desired_base` does; `guess` (n) are joints to
    begin with, None tries many postures. Raises `UnreachableError` for points out of reach,
    `SingularArmError` where the arm cannot move as the path wants, `UsageError` without an arm, and
    where not even the most knots keep the tip on its path.
    """
    if not vehicle.has_tip:
        raise UsageError(
            f"{vehicle.name}: has no tip, which a robot has where it has one arm without branches, "
            f"or a frame of that name; {OTHER_SCENARIO}"
        )
    if vehicle.joints == 0:
        raise UsageError(
            f"{vehicle.name}: has no arm, so its tip cannot follow a path of its own; "
            f"{OTHER_SCENARIO}"
        )
    base = base_at(time)
    while True:
        bounded_path(base.time, tip, "path of the tip")
        motion = arm_motion(vehicle, base, tip, limits, guess, progress)
        deviation = _deviation(vehicle, motion, tip)
        if deviation is None:
            return motion
        # How many knots it takes is found on the worst piece alone, and then holds for all.
        piece = deviation.piece
        span, start = base.time[piece : piece + 2], motion.q[piece, vehicle.arm]
        already = refinement = (len(base.time) - 1) // (len(time) - 1)
        while deviation is not None:
            refinement = refine(refinement, time, deviation, *_TOO_FAST)
            near = base_at(refined(span, refinement // already))
            deviation = _deviation(vehicle, arm_motion(vehicle, near, tip, limits, start), tip)
        base = base_at(refined(time, refinement))


def _deviation(vehicle: Vehicle, motion: Motion, tip: Path) -> Deviation | None:
    """Where the tip is farthest from its path between knots, m; None within the tolerance."""
    reference = vehicle.kinematics.reference(motion)
    worst, found = 1.0, None
    for begin in range(0, len(motion.time) - 1, BATCH):
        every = check_times(motion.time[begin : begin + BATCH + 1])
        places = bounded_path(every, tip, "path of the tip")[:, 0]
        reached = vehicle.tip_pose(reference(every)[0])[:, :3, 3]
        off = np.linalg.norm(reached - places, axis=-1)
        excess = off / tolerance(np.abs(places).max())
        instant = int(np.argmax(excess))
        if not excess[instant] <= worst:
            worst = excess[instant]
            found = Deviation(begin + instant // CHECKS, every[instant], off[instant], "m")
    return found
