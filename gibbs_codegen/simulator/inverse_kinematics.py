"""Inverse kinematics: coordinates, rates and accelerations of a wanted motion.

The base is exact. The arm is found by damped least squares on the Jacobian of the tip, which serves
any arm; rates and accelerations come from the same Jacobian. Of an arm with joints to spare the
slowest motion is taken, the one of least Σ θ̇².
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.stats import qmc

from gibbs_codegen.errors import UsageError
from gibbs_codegen.scenario.attitude import Turning, attitude_angles
from gibbs_codegen.scenario.paths import Path
from gibbs_codegen.simulator.vehicle import Vehicle

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Limits = tuple[Array, Array]

# Distance from its place at which the tip counts as there, m.
REACHED = 1e-9
_ITERATIONS = 200
# Steps of the damped iteration stop mattering here, rad or m.
_SETTLED = 1e-13
# Singular values of the Jacobian below this share of the largest carry no motion.
_RANK = 1e-7
# Speed and acceleration that a singular arm may fail to give, m/s and m/s².
_MISSED = 1e-6
# Step of the difference that gives the rate of the Jacobian, in s at rates of 1.
_DIFFERENCE = 1e-5
_GUESSES = 32
# Share of the largest singular value below which the least counts as nearly singular.
_NEARLY = 1e-4
# Shares of the arm's lever: what a singular arm may stay away, and a way worth the name.
_STUCK = 1e-6
_GONE = 1e-3
# What to do where a scenario asks too much of the arm.
OTHER_SCENARIO = "choose a scenario without a path of the tip, such as --scenario hover"


class SingularArmError(UsageError):
    """An arm whose joints cannot give the tip the speed or acceleration of its path."""


class UnreachableError(UsageError):
    """Points of a path that the tip cannot reach: when, and how far it stays from them.

    `times` (s) and `distances` (m) of all such points that were tried.
    """

    def __init__(self, message: str, times: Array, distances: Array) -> None:
        self.times = times
        self.distances = distances
        super().__init__(message)


@dataclass(frozen=True)
class Motion:
    """Coordinates, rates and accelerations (s, nq) at times (s)."""

    time: Array
    q: Array
    v: Array
    a: Array


def base_motion(vehicle: Vehicle, time: Array, centre: Array, turning: Turning) -> Motion:
    """Motion of attitude and position (exact), with the arm's coordinates at rest at 0.

    `centre` (s, ≥ 3, 3): position, velocity and acceleration of the base centre; `turning`: the
    rotation of arm 1. Raises `SingularAttitudeError` near the singularity of the sequence.
    """
    q, v, a = (np.zeros((len(time), len(vehicle.coordinates))) for _ in range(3))
    attitude, position = vehicle.layout.attitude, vehicle.layout.position
    angles, v[:, attitude], a[:, attitude] = attitude_angles(vehicle.attitude, turning)
    q[:, attitude] = np.unwrap(angles, axis=0)
    lever = vehicle.centre_offset(q)
    spin, spin_rate = turning.velocity, turning.acceleration
    swept = np.cross(spin, lever)
    q[:, position] = centre[:, 0] - lever
    v[:, position] = centre[:, 1] - swept
    a[:, position] = centre[:, 2] - np.cross(spin_rate, lever) - np.cross(spin, swept)
    return Motion(time, q, v, a)


def reach(vehicle: Vehicle, q: Array, target: Array, limits: Limits) -> tuple[Array, float]:
    """Turn the joints of `q` (nq) until the tip is at `target` (3), or as near as it comes.

    Damped least squares (Levenberg and Marquardt) on the Jacobian of the tip, within joint limits.
    Returns the coordinates and the distance that is left, m.
    """
    q = q.copy()
    arm = vehicle.arm
    q[arm] = np.clip(q[arm], *limits)
    fixed = limits[0] >= limits[1]
    error = target - vehicle.tip_pose(q)[:3, 3]
    damping = 1e-6
    for _ in range(_ITERATIONS):
        jacobian = np.where(fixed, 0.0, vehicle.tip_jacobian(q)[:3, arm])
        step = _damped_step(jacobian, error, damping, (limits[0] - q[arm], limits[1] - q[arm]))
        if np.max(np.abs(step), initial=0.0) < _SETTLED:
            break
        tried = q.copy()
        tried[arm] += step
        left = target - vehicle.tip_pose(tried)[:3, 3]
        if left @ left < error @ error:
            q, error, damping = tried, left, max(damping / 10.0, 1e-12)
        elif damping > 1e12:
            break
        else:
            damping *= 10.0
    return q, float(np.linalg.norm(error))


def first_posture(
    vehicle: Vehicle, q: Array, target: Array, limits: Limits, guess: Array | None
) -> tuple[Array, float]:
    """Coordinates that put the tip at `target`, from `guess` or from many postures.

    Of the postures found the one whose Jacobian is farthest from singular is taken, and of equals
    the one with the joints nearest to 0. Returns the coordinates and the distance left, as `reach`
    does.
    """
    if guess is not None:
        q = q.copy()
        q[vehicle.arm] = guess
        return reach(vehicle, q, target, limits)
    low = np.where(np.isfinite(limits[0]), limits[0], -np.pi)
    high = np.where(np.isfinite(limits[1]), limits[1], np.pi)
    postures = []
    for share in qmc.Halton(vehicle.joints, scramble=False).random(_GUESSES):
        start = q.copy()
        start[vehicle.arm] = low + share * (high - low)
        found, left = reach(vehicle, start, target, limits)
        found[vehicle.arm] = _unwound(vehicle, found[vehicle.arm], limits)
        postures.append((found, left))
    found, left = min(postures, key=lambda posture: posture[1])
    if left > REACHED:
        return found, left
    reached = [posture for posture in postures if posture[1] <= REACHED]
    measures = [_distance_to_singularity(vehicle, found) for found, _ in reached]
    # Elbow up or down, say, are as good as each other: then the joints nearest to 0.
    best = [p for p, m in zip(reached, measures, strict=True) if m >= 0.999 * max(measures)]
    return min(best, key=lambda posture: _remoteness(posture[0][vehicle.arm]))


def _remoteness(joints: Array) -> tuple[float, ...]:
    """How far joints are from 0; of mirror images the one with positive joints comes first.

    Rounded, so that rounding errors do not choose between equals.
    """
    return (round(float(np.linalg.norm(joints)), 6), *np.round(-joints, 6).tolist())


def _posture_for_what_follows(
    vehicle: Vehicle, base: Motion, places: Array, limits: Limits, q: Array
) -> Array:
    """Coordinates at the first knot that suit the way the path goes on, where `q` is singular.

    A tip on the axis of a joint leaves that joint's angle open, but the path does not. So the
    search begins where the tip has gone some way, and the arm is led back from there. Gives back
    `q` where that comes to nothing.
    """
    offset = places - base.q[:, vehicle.layout.position]
    away = np.linalg.norm(offset - offset[0], axis=-1) > _GONE * _lever(vehicle, q)
    if not np.any(away):
        return q
    there = int(np.argmax(away))
    found, left = first_posture(vehicle, base.q[there], places[there], limits, None)
    for k in reversed(range(there)):
        joints = found[vehicle.arm]
        found = base.q[k].copy()
        found[vehicle.arm] = joints
        found, left = reach(vehicle, found, places[k], limits)
    return found if left <= REACHED else q


def _lever(vehicle: Vehicle, q: Array) -> float:
    """Largest singular value of the Jacobian of the tip: m per rad, about the arm's length."""
    jacobian = vehicle.tip_jacobian(q)[:3, vehicle.arm]
    return float(np.linalg.norm(jacobian, 2))


def _is_singular(vehicle: Vehicle, q: Array) -> bool:
    """Whether the joints all but cannot move the tip some way that its path may want."""
    return _distance_to_singularity(vehicle, q) < _NEARLY * _lever(vehicle, q)


def _distance_to_singularity(vehicle: Vehicle, q: Array) -> float:
    """The least singular value of the Jacobian of the tip with respect to the joints."""
    jacobian = vehicle.tip_jacobian(q)[:3, vehicle.arm]
    return float(np.linalg.svd(jacobian, compute_uv=False)[-1])


def _unwound(vehicle: Vehicle, joints: Array, limits: Limits) -> Array:
    """Joints without whole turns, which say nothing of where an unlimited joint is."""
    turning = np.isinf(limits[0]) & np.isinf(limits[1])
    turning &= vehicle.is_angle[vehicle.arm]
    return np.where(turning, (joints + np.pi) % (2.0 * np.pi) - np.pi, joints)


def arm_motion(
    vehicle: Vehicle,
    base: Motion,
    tip: Path,
    limits: Limits,
    guess: Array | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Motion:
    """Motion of base and arm, with the tip on its path.

    Once all points have been tried, raises `UnreachableError` for those that the tip does not
    reach, or else `SingularArmError` where the arm cannot move as the path wants.
    """
    q, v, a = base.q.copy(), base.v.copy(), base.a.copy()
    targets = tip(base.time)
    left = np.zeros(len(q))
    arm = vehicle.arm
    stopped = np.zeros(vehicle.joints, dtype=bool)
    singular: SingularArmError | None = None
    for k in range(len(q)):
        if k == 0:
            q[k], left[k] = first_posture(vehicle, q[k], targets[k, 0], limits, guess)
            if guess is None and left[k] <= REACHED and _is_singular(vehicle, q[k]):
                q[k] = _posture_for_what_follows(vehicle, base, targets[:, 0], limits, q[k])
        else:
            step = base.time[k] - base.time[k - 1]
            q[k, arm] = q[k - 1, arm] + step * (v[k - 1, arm] + 0.5 * step * a[k - 1, arm])
            stopped = stopped | _beyond(q[k, arm], limits)
            q[k], left[k] = _reach_holding(vehicle, q[k], targets[k, 0], limits, stopped)
        if left[k] <= REACHED:
            try:
                spare, stays = _set_rates(
                    vehicle, q[k], v[k], a[k], targets[k], limits, base.time[k]
                )
                if spare and k and left[k - 1] <= REACHED:
                    stays, left[k] = _settle_spare_joints(
                        vehicle, (q, v, a), k, targets[k], limits, stopped, base.time
                    )
                stopped = stays
            except SingularArmError as error:
                singular = singular or error
        progress(k + 1, len(q))
    _refuse_unreached(vehicle, base.time, q, left)
    if singular is not None:
        raise singular
    return Motion(base.time, q, v, a)


def _beyond(joints: Array, limits: Limits) -> Flags:
    beyond: Flags = (joints < limits[0]) | (joints > limits[1])
    return beyond


def _reach_holding(
    vehicle: Vehicle, q: Array, target: Array, limits: Limits, held: Flags
) -> tuple[Array, float]:
    """`reach`, with the joints that are `held` left where they are if it can be done without them.

    Joints that come to a limit would else be moved off it by each step towards the target, only to
    be driven into it again.
    """
    if np.any(held):
        joints = np.clip(q[vehicle.arm], *limits)
        narrow = np.where(held, joints, limits[0]), np.where(held, joints, limits[1])
        found, left = reach(vehicle, q, target, narrow)
        if left <= REACHED:
            return found, left
    return reach(vehicle, q, target, limits)


def _settle_spare_joints(
    vehicle: Vehicle,
    series: tuple[Array, Array, Array],
    k: int,
    target: Array,
    limits: Limits,
    stopped: Flags,
    time: Array,
) -> tuple[Flags, float]:
    """Make the coordinates of an arm with joints to spare the integral of their rates.

    The tip says nothing of motions that leave it in its place. They follow from the rates at both
    ends of the step, by the corrector of fourth order with two derivatives (Obreshkov's). Returns
    which joints stay at their limits, and the distance that the tip is left from its place, m.
    """
    q, v, a = series
    arm, step = vehicle.arm, time[k] - time[k - 1]
    stays, left = stopped, 0.0
    for _ in range(3):
        integral = (
            q[k - 1, arm]
            + step / 2.0 * (v[k - 1, arm] + v[k, arm])
            + step**2 / 12.0 * (a[k - 1, arm] - a[k, arm])
        )
        q[k, arm] = np.where(stopped, q[k, arm], integral)
        stopped = stopped | _beyond(integral, limits)
        q[k], left = _reach_holding(vehicle, q[k], target[0], limits, stopped)
        _, stays = _set_rates(vehicle, q[k], v[k], a[k], target, limits, time[k])
    return stays, left


def _set_rates(
    vehicle: Vehicle, q: Array, v: Array, a: Array, target: Array, limits: Limits, time: float
) -> tuple[bool, Flags]:
    """Write into `v` and `a` the rates and accelerations of the arm that move the tip as wanted.

    ẋ = J v and ẍ = J a + J̇ v, with the base's part of J on the other side; a joint at its limit
    does not go beyond it. Returns whether there are joints to spare, and which stay at a limit.
    """
    arm = vehicle.arm
    v[arm] = a[arm] = 0.0
    jacobian = vehicle.tip_jacobian(q)[:3]
    free = np.ones(vehicle.joints, dtype=bool)
    # At most all joints are at their limits, one found after the other.
    for _ in range(vehicle.joints + 1):
        own = np.where(free, jacobian[:, arm], 0.0)
        inverse = np.linalg.pinv(own, rcond=_RANK)
        rates = inverse @ (target[1] - jacobian @ v)
        pushed = free & (
            ((q[arm] <= limits[0] + REACHED) & (rates < 0.0))
            | ((q[arm] >= limits[1] - REACHED) & (rates > 0.0))
        )
        if not np.any(pushed):
            break
        free &= ~pushed
    v[arm] = rates
    bias = vehicle.tip_bias_acceleration(q, v)[:3]
    a[arm] = inverse @ (target[2] - jacobian @ a - bias)
    _refuse_singular(vehicle, jacobian @ v - target[1], "speed, m/s", time)
    _refuse_singular(vehicle, jacobian @ a + bias - target[2], "acceleration, m/s²", time)
    has_spare = bool(np.linalg.matrix_rank(own, _RANK * np.linalg.norm(own)) < np.sum(free))
    if has_spare:
        # Of J⁺: what changes of the share that spare joints take.
        ahead, behind = (
            vehicle.tip_jacobian(q + sign * _DIFFERENCE * v)[:3, arm] for sign in (1.0, -1.0)
        )
        jacobian_rate = np.where(free, ahead - behind, 0.0) / (2.0 * _DIFFERENCE)
        spare = jacobian_rate.T @ (inverse.T @ rates)
        a[arm] += spare - inverse @ (own @ spare)
    return has_spare, ~free


def _damped_step(jacobian: Array, error: Array, damping: float, room: Limits) -> Array:
    """The step of least |J δ − e|² + λ|δ|² within the room that the joint limits leave."""
    square = jacobian @ jacobian.T
    weight = damping * (np.trace(square) / 3.0 + 1e-12)
    step: Array = jacobian.T @ np.linalg.solve(square + weight * np.eye(3), error)
    if np.all((step >= room[0]) & (step <= room[1])):
        return step
    # `lsq_linear` wants bounds that differ.
    slack = 1e-15
    bounds = (np.minimum(room[0], 0.0) - slack, np.maximum(room[1], 0.0) + slack)
    stacked = np.vstack([jacobian, np.sqrt(weight) * np.eye(len(step))])
    wanted = np.concatenate([error, np.zeros(len(step))])
    found: Array = lsq_linear(stacked, wanted, bounds=bounds, method="bvls").x
    return np.clip(found, *room)


def _refuse_singular(vehicle: Vehicle, missed: Array, what: str, time: float) -> None:
    missing = float(np.linalg.norm(missed))
    if missing > _MISSED:
        raise SingularArmError(
            f"the arm is singular or at its limits at t = {time:.6g} s: its joints "
            f"({', '.join(vehicle.joint_names)}) cannot move the tip as its path wants; "
            f"{missing:.3g} of the {what}, is missing"
        )


def _refuse_unreached(vehicle: Vehicle, time: Array, q: Array, left: Array) -> None:
    far = left > REACHED
    if not np.any(far):
        return
    worst = int(np.argmax(left))
    times, distances = time[far], left[far]
    where = (
        f"at {len(times)} of {len(time)} instants, from t = {times[0]:.6g} s to "
        f"{times[-1]:.6g} s; at t = {time[worst]:.6g} s it stays {left[worst]:.3g} m away"
    )
    # So near is not out of reach: the joints do not find the way there.
    if left[worst] < _STUCK * _lever(vehicle, q[worst]) and _is_singular(vehicle, q[worst]):
        raise SingularArmError(
            f"the arm is singular: its joints ({', '.join(vehicle.joint_names)}) do not bring the "
            f"tip onto its path {where}; lead the path past the axes of joints and the edge of "
            "the arm's reach, or give a guess of the joints"
        )
    raise UnreachableError(
        f"the tip cannot reach its path {where}; lead the path within the arm's reach, or "
        f"{OTHER_SCENARIO}",
        times,
        distances,
    )
