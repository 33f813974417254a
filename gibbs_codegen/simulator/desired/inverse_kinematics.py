"""Inverse kinematics of the arm at one instant: joint coordinates that bring the tip to a point.

Damped least squares (the method of Levenberg and Marquardt) on the Jacobian of the tip, within
joint limits. It serves arms of any number of joints, redundant or not.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import lsq_linear
from scipy.stats import qmc

from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle

# Lower and upper limits of the joints (n), rad or m; infinite where there are none.
Limits = tuple[Array, Array]

# Distance from its target at which the tip counts as there, m.
REACHED = 1e-9
_ITERATIONS = 200
# Steps that no longer change anything, rad or m.
_SETTLED = 1e-13
# Postures that the search for the first one begins with.
_GUESSES = 32
# Share of the largest singular value below which the least counts as nearly singular.
_NEARLY_SINGULAR = 1e-4


def reach(vehicle: Vehicle, q: Array, target: Array, limits: Limits) -> tuple[Array, float]:
    """Coordinates (nq) that bring the tip nearest to `target` (3), world axes, and how near, m.

    Only joints move; attitude and position are kept.
    """
    q = q.copy()
    arm = vehicle.arm
    q[arm] = np.clip(q[arm], *limits)
    fixed = limits[0] >= limits[1]
    arm_rates = vehicle.arm_rates
    error = target - vehicle.tip_pose(q)[:3, 3]
    damping = 1e-6
    for _ in range(_ITERATIONS):
        jacobian = np.where(fixed, 0.0, vehicle.tip_jacobian(q)[:3, arm_rates])
        step = _damped_step(jacobian, error, damping, (limits[0] - q[arm], limits[1] - q[arm]))
        if np.max(np.abs(step), initial=0.0) < _SETTLED:
            break
        trial = q.copy()
        trial[arm] += step
        trial_error = target - vehicle.tip_pose(trial)[:3, 3]
        if trial_error @ trial_error < error @ error:
            q, error, damping = trial, trial_error, max(damping / 10.0, 1e-12)
        elif damping > 1e12:
            break
        else:
            damping *= 10.0
    return q, float(np.linalg.norm(error))


def _damped_step(jacobian: Array, error: Array, damping: float, room: Limits) -> Array:
    """The step δ (n) of least |J δ − e|² + λ|δ|² within `room`, its distances from joint limits.

    J (3, n) is of the tip's position, e (3), m, leads from the tip to its target, and `damping` is
    λ as a share of the mean square of J's singular values.
    """
    square = jacobian @ jacobian.T
    weight = damping * (np.trace(square) / 3.0 + 1e-12)
    step: Array = jacobian.T @ np.linalg.solve(square + weight * np.eye(3), error)
    if np.all((step >= room[0]) & (step <= room[1])):
        return step
    # `lsq_linear` wants bounds that differ.
    slack = 1e-15
    bounds = (np.minimum(room[0], 0.0) - slack, np.maximum(room[1], 0.0) + slack)
    stacked = np.vstack([jacobian, np.sqrt(weight) * np.eye(len(step))])
    desired = np.concatenate([error, np.zeros(len(step))])
    found: Array = lsq_linear(stacked, desired, bounds=bounds, method="bvls").x
    return np.clip(found, *room)


def first_posture(
    vehicle: Vehicle, q: Array, target: Array, limits: Limits, guess: Array | None
) -> tuple[Array, float]:
    """Coordinates (nq) that bring the tip to a point, without any to go on from, and how near, m.

    Of the postures found the one whose Jacobian is farthest from singular is taken, and of equals
    the one with the joints nearest to 0. `guess` (n) are joints to begin with; None tries many.
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
        found, distance = reach(vehicle, start, target, limits)
        found[vehicle.arm] = _without_turns(vehicle, found[vehicle.arm], limits)
        postures.append((found, distance))
    found, distance = min(postures, key=lambda posture: posture[1])
    if distance > REACHED:
        return found, distance
    reached = [posture for posture in postures if posture[1] <= REACHED]
    measures = [_least_singular_value(vehicle, found) for found, _ in reached]
    # Elbow up or down, say, are as good as each other: then the joints nearest to 0.
    best = [p for p, m in zip(reached, measures, strict=True) if m >= 0.999 * max(measures)]
    return min(best, key=lambda posture: _distance_from_zero(posture[0][vehicle.arm]))


def _distance_from_zero(joints: Array) -> tuple[float, ...]:
    """How far joints are from 0; of mirror images the one with positive joints comes first.

    Rounded, so that rounding errors do not choose between equals.
    """
    return (round(float(np.linalg.norm(joints)), 6), *np.round(-joints, 6).tolist())


def _without_turns(vehicle: Vehicle, joints: Array, limits: Limits) -> Array:
    """Joints (n) with the angles of those that turn without limits within [−π, π)."""
    turning = np.isinf(limits[0]) & np.isinf(limits[1])
    turning &= vehicle.is_angle[vehicle.arm]
    return np.where(turning, (joints + np.pi) % (2.0 * np.pi) - np.pi, joints)


def arm_length(vehicle: Vehicle, q: Array) -> float:
    """The largest singular value of the tip's Jacobian, m per rad: about the arm's length."""
    jacobian = vehicle.tip_jacobian(q)[:3, vehicle.arm_rates]
    return float(np.linalg.norm(jacobian, 2))


def is_singular(vehicle: Vehicle, q: Array) -> bool:
    """Whether there is a direction in which the joints all but cannot move the tip."""
    return _least_singular_value(vehicle, q) < _NEARLY_SINGULAR * arm_length(vehicle, q)


def _least_singular_value(vehicle: Vehicle, q: Array) -> float:
    """The least singular value of the Jacobian of the tip with respect to the joints."""
    jacobian = vehicle.tip_jacobian(q)[:3, vehicle.arm_rates]
    return float(np.linalg.svd(jacobian, compute_uv=False)[-1])
