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
from scipy.stats import qmc

from gibbs_codegen.errors import UsageError
from gibbs_codegen.simulator.attitude import SingularAttitudeError
from gibbs_codegen.simulator.inverse_kinematics import Limits, Motion, arm_motion, base_motion
from gibbs_codegen.simulator.orientation import Orientation
from gibbs_codegen.simulator.paths import Path
from gibbs_codegen.simulator.vehicle import Vehicle

Array = NDArray[np.float64]

KNOT_SPACING = 0.005
# Lengths, speeds and so on, in m and s, that no machine comes to.
_BOUND = 1e12
# How far pieces may be from the motion halfway between knots: base (rad, m) and tip (m).
_BASE_OFF = 1e-4
_TIP_OFF = 1e-2
# Postures that the search for the one that hangs starts from, and energies that count as equal, J.
_HANGING_STARTS = 7
_SAME_ENERGY = 1e-10


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

    Raises `UsageError` with the time where the attitude is singular or not defined, and where the
    motion is so fast, or turns so sharply, that pieces between the knots do not follow it.
    """
    # Knots, and between them the instants that the pieces are checked at.
    every = np.linspace(time[0], time[-1], 2 * len(time) - 1)
    every[::2] = time
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
    motion = Motion(time, whole.q[::2], whole.v[::2], whole.a[::2])
    q, v, _ = Reference(motion)(every)
    step = every[1] - every[0]
    off = np.maximum(np.abs(q - whole.q), step * np.abs(v - whole.v)).max(axis=-1)
    _refuse(every, off > _BASE_OFF, "the base moves too fast or its attitude jumps")
    return motion


def desired_with_tip(
    vehicle: Vehicle,
    base: Motion,
    tip: Path,
    limits: Limits,
    guess: Array | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Motion:
    """Motion of base and arm at knots, with the tip on a path.

    Raises `UnreachableError` for points out of reach, `SingularArmError` where the arm cannot move
    as the path wants, and `UsageError` where it would have to move too fast.
    """
    if vehicle.joints == 0:
        raise UsageError(f"{vehicle.name}: has no arm, so its tip cannot follow a path of its own")
    _bounded(base.time, tip, "path of the tip")
    motion = arm_motion(vehicle, base, tip, limits, guess, progress)
    between = (base.time[:-1] + base.time[1:]) / 2.0
    q, _, _ = Reference(motion)(between)
    off = np.linalg.norm(vehicle.tip_pose(q)[:, :3, 3] - tip(between)[:, 0], axis=-1)
    _refuse(between, off > _TIP_OFF, "the arm, or the path of its tip, moves too fast")
    return motion


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


def hanging_posture(vehicle: Vehicle, limits: Limits) -> Array:
    """Arm coordinates (n) of least potential energy under a level base.

    Prismatic joints are at 0, and so are revolute ones that make no difference, such as one about
    the vertical; or where limits leave out 0, as near to it as they allow.
    """
    turning = np.array([name.startswith("theta_") for name in vehicle.joint_names], dtype=bool)
    low, high = limits[0][turning], limits[1][turning]
    places = 3 + np.flatnonzero(turning)
    rest = np.zeros(len(vehicle.coordinates))
    rest[vehicle.arm] = np.clip(0.0, *limits)
    if not np.any(turning):
        return rest[vehicle.arm]

    def posture(angles: Array) -> Array:
        q = np.broadcast_to(rest, (*angles.shape[:-1], len(rest))).copy()
        q[..., places] = angles
        return q

    def energy(angles: Array) -> float:
        return float(vehicle.potential_energy(posture(angles)))

    def torques(angles: Array) -> Array:
        # The forces that hold the arm still are the gradient of its potential energy.
        q = posture(angles)
        return vehicle.inverse_dynamics(q, np.zeros_like(q), np.zeros_like(q))[..., places]

    best = rest[places]
    least = np.inf
    # First away from 0 and from symmetry, where the energy may be at rest without being least.
    shares = qmc.Halton(len(places), scramble=False).random(_HANGING_STARTS)
    ends = np.clip(-np.pi, low, high), np.clip(np.pi, low, high)
    starts = [-0.3 - 0.1 * np.arange(len(places)), *(ends[0] + shares * (ends[1] - ends[0]))]
    options = {"ftol": 1e-12, "gtol": 1e-7}
    for start in starts:
        found = minimize(
            energy,
            np.clip(start, low, high),
            jac=torques,
            method="L-BFGS-B",
            bounds=np.stack([low, high], axis=-1),
            options=options,
        )
        angles = _still(torques, found.x, low, high)
        if energy(angles) < least - _SAME_ENERGY:
            best, least = angles, energy(angles)
    for place, nearest in enumerate(rest[places]):
        tried = best.copy()
        tried[place] = nearest
        if energy(tried) <= least + _SAME_ENERGY:
            best = tried
    return posture(_still(torques, best, low, high))[vehicle.arm]


def _still(torques: Callable[[Array], Array], angles: Array, low: Array, high: Array) -> Array:
    """Angles near `angles` where gravity turns no joint but against its limit, by Newton's way."""
    for _ in range(10):
        torque = torques(angles)
        free = ~((angles <= low) & (torque > 0.0)) & ~((angles >= high) & (torque < 0.0))
        steps = 1e-5 * np.eye(len(angles))
        stiffness = (torques(angles + steps) - torques(angles - steps)).T / 2e-5
        # Motions that gravity does not resist, but for rounding, are left alone.
        stiffness = np.where(np.outer(free, free), stiffness, 0.0)
        step = np.linalg.pinv(stiffness, rcond=1e-7) @ np.where(free, torque, 0.0)
        tried = np.clip(angles - step, low, high)
        if not np.linalg.norm(torques(tried)[free]) < np.linalg.norm(torque[free]):
            break
        angles = tried
    return angles
