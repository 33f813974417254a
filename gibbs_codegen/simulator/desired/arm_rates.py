"""Rates and accelerations of the arm at one instant, from those that its tip is to have.

ẋ = J v and ẍ = J a + J̇ v, with the base's part of J on the other side. Redundant arms take the
minimum-norm rates v = J⁺ẋ, whose derivative also has a part in the null space of J.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.simulator.desired.inverse_kinematics import REACHED, Limits
from gibbs_codegen.simulator.plant.vehicle import Array, Flags, Vehicle

# Singular values of the Jacobian below this share of the largest carry no motion.
_RANK = 1e-7
# Speed and acceleration that a singular arm may fail to give, m/s and m/s².
_TOLERANCE = 1e-6
# Step of the difference that gives the rate of the Jacobian, in s at rates of 1.
_DIFFERENCE = 1e-5


@dataclass(frozen=True)
class ArmRates:
    """Rates and accelerations (n) of the joints, and how the arm can move.

    `at_limit` (n) tells the joints that are held at a limit, `redundant` whether the others can
    move without the tip. `missing` tells what the arm cannot give the tip, "" if nothing.
    """

    rates: Array
    accelerations: Array
    at_limit: Flags
    redundant: bool
    missing: str


def arm_rates(
    vehicle: Vehicle, state: tuple[Array, Array, Array], target: Array, limits: Limits
) -> ArmRates:
    """Rates and accelerations of the arm that move the tip as desired.

    Args:
        vehicle: The robot.
        state: Coordinates (nq), velocities and accelerations (nv) of base and arm; velocities and
            accelerations of the arm are not looked at.
        target: Desired position, velocity, acceleration (≥ 3, 3) of the tip, world axes, m and s.
        limits: Joint limits; a joint at its limit does not go beyond it.

    Returns:
        Those of least norm, or where the arm cannot give what is desired, the nearest to it.
    """
    arm = vehicle.arm_rates
    q, v, a = state[0], state[1].copy(), state[2].copy()
    v[arm] = a[arm] = 0.0
    jacobian = vehicle.tip_jacobian(q)[:3]
    v[arm], free = _rates_within_limits(
        q[vehicle.arm], jacobian[:, arm], target[1] - jacobian @ v, limits
    )
    own = np.where(free, jacobian[:, arm], 0.0)
    inverse = np.linalg.pinv(own, rcond=_RANK)
    bias = vehicle.tip_bias_acceleration(q, v)[:3]
    a[arm] = inverse @ (target[2] - jacobian @ a - bias)
    missing = _missing(jacobian @ v - target[1], "speed, m/s") or _missing(
        jacobian @ a + bias - target[2], "acceleration, m/s²"
    )
    rank = np.linalg.matrix_rank(own, _RANK * np.linalg.norm(own))
    redundant = not missing and bool(rank < np.sum(free))
    if redundant:
        # The derivative of J⁺ẋ in the null space of J: (1 − J⁺J) J̇ᵀ J⁺ᵀ v.
        ahead, behind = (
            vehicle.tip_jacobian(vehicle.integrate(q, sign * _DIFFERENCE * v))[:3, arm]
            for sign in (1.0, -1.0)
        )
        jacobian_rate = np.where(free, ahead - behind, 0.0) / (2.0 * _DIFFERENCE)
        growth = jacobian_rate.T @ (inverse.T @ v[arm])
        a[arm] += growth - inverse @ (own @ growth)
    return ArmRates(v[arm], a[arm], ~free, redundant, missing)


def _rates_within_limits(
    joints: Array, jacobian: Array, speed: Array, limits: Limits
) -> tuple[Array, Flags]:
    """Rates of least norm that move the tip, with joints held that would leave their limits.

    Args:
        joints: Joint coordinates (n), rad or m.
        jacobian: J (3, n) of the tip's position with respect to the joints.
        speed: What the joints have to add to the tip's velocity (3), m/s.
        limits: Joint limits.

    Returns:
        Rates (n), rad/s or m/s, and the joints that are free to move (n).
    """
    free = np.ones(len(joints), dtype=bool)
    rates = np.zeros(len(joints))
    # At most all joints are at their limits, one found after the other.
    for _ in range(len(joints) + 1):
        rates = np.linalg.pinv(np.where(free, jacobian, 0.0), rcond=_RANK) @ speed
        leaving = free & (
            ((joints <= limits[0] + REACHED) & (rates < 0.0))
            | ((joints >= limits[1] - REACHED) & (rates > 0.0))
        )
        if not np.any(leaving):
            break
        free &= ~leaving
    return rates, free


def _missing(shortfall: Array, unit: str) -> str:
    size = float(np.linalg.norm(shortfall))
    return f"{size:.3g} of the {unit}, is missing" if size > _TOLERANCE else ""
