"""The desired motion as a function of time: pieces of fifth degree between knots.

At the knots coordinates, rates and accelerations are those of the inverse kinematics; between them
the quintic that takes on all six at its ends. So rates are the derivatives of coordinates
everywhere, a motion costs the same to evaluate whatever made it, and C can evaluate it too.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from gibbs_codegen.errors import UsageError
from gibbs_codegen.simulator.attitude import SingularAttitudeError
from gibbs_codegen.simulator.inverse_kinematics import Limits, Motion, arm_motion, base_motion
from gibbs_codegen.simulator.orientation import Orientation
from gibbs_codegen.simulator.paths import Path
from gibbs_codegen.simulator.vehicle import Vehicle

Array = NDArray[np.float64]

KNOT_SPACING = 0.005


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


def desired_base(vehicle: Vehicle, time: Array, centre: Path, orientation: Orientation) -> Motion:
    """Motion of the base at knots, its centre on a path, the arm's coordinates at rest at 0.

    Raises `UsageError` with the time where the attitude is singular or not defined.
    """
    turning = orientation(centre, time, vehicle.arm_angles())
    try:
        return base_motion(vehicle, time, centre(time), turning)
    except SingularAttitudeError as error:
        singular = _first_singular(vehicle, time, centre, orientation)
        raise SingularAttitudeError(f"at t = {singular:.6g} s {error}") from None


def _first_singular(vehicle: Vehicle, time: Array, centre: Path, orientation: Orientation) -> float:
    for instant in time:
        at = np.array([instant])
        try:
            base_motion(vehicle, at, centre(at), orientation(centre, at, vehicle.arm_angles()))
        except SingularAttitudeError:
            return float(instant)
    return float(time[0])


def desired_with_tip(
    vehicle: Vehicle,
    base: Motion,
    tip: Path,
    limits: Limits,
    guess: Array | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Motion:
    """Motion of base and arm at knots, with the tip on a path. Raises `UnreachableError`."""
    if vehicle.joints == 0:
        raise UsageError(f"{vehicle.name}: has no arm, so its tip cannot follow a path of its own")
    return arm_motion(vehicle, base, tip, limits, guess, progress)


def desired_with_posture(vehicle: Vehicle, base: Motion, posture: Array) -> Motion:
    """Motion of the base at knots, with the arm's coordinates held at `posture` (n)."""
    q = base.q.copy()
    q[:, vehicle.arm] = posture
    return Motion(base.time, q, base.v, base.a)


def hanging_posture(vehicle: Vehicle, limits: Limits) -> Array:
    """Arm coordinates (n) of least potential energy under a level base; prismatic joints at 0."""
    q = np.zeros(len(vehicle.coordinates))
    turning = np.array([name.startswith("theta_") for name in vehicle.joint_names], dtype=bool)
    places = np.arange(len(q))[vehicle.arm][turning]
    low, high = limits[0][turning], limits[1][turning]
    q[vehicle.arm] = np.clip(0.0, *limits)
    if not np.any(turning):
        return q[vehicle.arm]

    def energy(angles: Array) -> tuple[float, Array]:
        there = q.copy()
        there[places] = angles
        # The forces that hold the arm still are the gradient of its potential energy.
        holding = vehicle.inverse_dynamics(there, still, still)
        return float(vehicle.potential_energy(there)), holding[places]

    still = np.zeros_like(q)
    # Away from 0 and from symmetry, where the energy may be at rest without being least.
    start = np.clip(-0.3 - 0.1 * np.arange(len(places)), low, high)
    bounds = np.stack([low, high], axis=-1)
    options = {"ftol": 0.0, "gtol": 1e-12}
    q[places] = minimize(
        energy, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options
    ).x
    # A joint that makes no difference, such as one about the vertical, is at 0.
    for place, lowest, highest in zip(places, low, high, strict=True):
        tried = q.copy()
        tried[place] = np.clip(0.0, lowest, highest)
        if vehicle.potential_energy(tried) <= vehicle.potential_energy(q) + 1e-9:
            q = tried
    return q[vehicle.arm]
