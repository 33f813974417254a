"""Rates and accelerations of the arm at one instant, from those that its tip is to have.

ẋ = J v and ẍ = J a + J̇ v, with the base's part of J on the other side. Redundant arms take the
minimum-norm rates v = J⁺ẋ, whose derivative also has a part in the null space of J.

A joint brakes before its limit, and the others take over its part of the motion. Rates of least
norm are v = Jᵀλ. A joint that should move by g = (Jᵀλ)ᵢ towards a limit that is the way d off does
so up to κ d, and beyond that moves by κ d + (g − κ d) d / (d + r). That is v = c + s² Jᵀλ, with
s² = d / (d + r) and c = κ r s², so that rates do not jump, nor where d comes to 0. An arm without
motion to choose moves as its path wants until it meets a limit.
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
# Rate towards a limit at which joints begin to brake, for each rad or m of the way, 1/s: κ.
_BRAKING = 4.0
# The way to a limit, rad or m, on which a joint that brakes moves half as far as it should: r.
_HALF = 3.0
# Changes of the set of joints that brake, for each joint.
_CHANGES = 4
# Step of the difference that gives the rate of the Jacobian, in s at rates of 1.
_DIFFERENCE = 1e-5


@dataclass(frozen=True)
class ArmRates:
    """Rates and accelerations (n) of the joints, and how the arm can move.

    - `at_limit` (n): the joints that have come to a limit
    - `redundant`: whether the others can move without the tip
    - `missing`: what the arm cannot give the tip, "" if nothing
    """

    rates: Array
    accelerations: Array
    at_limit: Flags
    redundant: bool
    missing: str


def arm_rates(
    vehicle: Vehicle, state: tuple[Array, Array, Array], target: Array, limits: Limits
) -> ArmRates:
    """Joint rates and accelerations of least norm that move the tip as desired, or nearest to it.

    `state` (nq, nv, nv) is of base and arm, whose own velocities and accelerations are not looked
    at. `target` (≥ 3, 3): position, velocity, acceleration of the tip, world axes.
    """
    arm = vehicle.arm_rates
    q, v, a = state[0], state[1].copy(), state[2].copy()
    v[arm] = a[arm] = 0.0
    jacobian = vehicle.tip_jacobian(q)[:3]
    own = jacobian[:, arm]
    found = _braking(q[vehicle.arm], own, target[1] - jacobian @ v, limits)
    v[arm], free = found.rates, found.share > 0.0
    bias = vehicle.tip_bias_acceleration(q, v)[:3]
    a[arm] = found.growth
    a[arm] += found.share * (found.inverse @ (target[2] - jacobian @ a - bias))
    missing = _missing(jacobian @ v - target[1], "speed, m/s") or _missing(
        jacobian @ a + bias - target[2], "acceleration, m/s²"
    )
    rank = np.linalg.matrix_rank(own * free, _RANK * np.linalg.norm(own))
    redundant = not missing and bool(rank < np.sum(free))
    if redundant:
        # The derivative of J⁺ẋ in the null space of J: (1 − J⁺J) J̇ᵀ J⁺ᵀ v.
        ahead, behind = (
            vehicle.tip_jacobian(vehicle.integrate(q, sign * _DIFFERENCE * v))[:3, arm]
            for sign in (1.0, -1.0)
        )
        jacobian_rate = found.share * (ahead - behind) / (2.0 * _DIFFERENCE)
        jacobian_rate += own * found.share_rate
        growth = jacobian_rate.T @ found.multipliers
        a[arm] += found.share * (growth - found.inverse @ (own @ (found.share * growth)))
    return ArmRates(v[arm], a[arm], ~free, redundant, missing)


@dataclass(frozen=True)
class _Braking:
    """Rates (n) c + s² Jᵀλ of joints, of which some brake.

    `share` (n) is s, 1 of those that do not brake and 0 of those that have come to a limit, and
    `share_rate` its derivative. `inverse` (n, 3) is the pseudoinverse of J s, `multipliers` (3) are
    λ. `growth` (n) is what the accelerations have besides s times the derivative of s Jᵀλ.
    """

    rates: Array
    share: Array
    share_rate: Array
    inverse: Array
    multipliers: Array
    growth: Array


def _braking(joints: Array, jacobian: Array, speed: Array, limits: Limits) -> _Braking:
    """Joint rates of least norm that add `speed` (3), m/s, to the tip's velocity, or nearly so.

    Joints brake before their limits. `jacobian` (3, n) is of the tip's position.
    """
    ways = [np.where(way > REACHED, way, 0.0) for way in (joints - limits[0], limits[1] - joints)]
    # −1 or 1 of joints that brake before the lower or upper limit, and the way to it.
    towards, way = np.zeros(len(joints)), np.ones(len(joints))
    for _ in range(_CHANGES * len(joints) + 1):
        brakes = towards != 0.0
        share = np.where(brakes, np.sqrt(way / (way + _HALF)), 1.0)
        centre = np.where(brakes, _BRAKING * _HALF * towards * share**2, 0.0)
        inverse = np.linalg.pinv(jacobian * share, rcond=_RANK)
        scaled = inverse @ (speed - jacobian @ centre)
        multipliers = inverse.T @ scaled
        wanted = jacobian.T @ multipliers
        beyond = np.maximum(-wanted - _BRAKING * ways[0], wanted - _BRAKING * ways[1])
        # Where they cannot move the tip as wanted, this is no reason to let go.
        rates = centre + share * scaled
        stuck = np.linalg.norm(jacobian @ rates - speed) > _TOLERANCE
        wrong = (beyond > 0.0) & ~brakes | (beyond <= 0.0) & brakes & ~stuck
        if not np.any(wrong):
            break
        worst = int(np.argmax(np.where(wrong, np.abs(beyond), -1.0)))
        towards[worst] = 0.0 if brakes[worst] else np.sign(wanted[worst])
        way[worst] = ways[int(towards[worst] > 0.0)][worst]
    # Derivatives of s² = d / (d + r) and of c = κ r s² with respect to time.
    square_rate = np.where(brakes, -towards * rates * _HALF / (way + _HALF) ** 2, 0.0)
    share_rate = np.divide(square_rate, 2.0 * share, out=np.zeros(len(joints)), where=share > 0.0)
    growth = _BRAKING * _HALF * towards * square_rate + share_rate * scaled
    return _Braking(rates, share, share_rate, np.asarray(inverse, np.float64), multipliers, growth)


def _missing(shortfall: Array, unit: str) -> str:
    size = float(np.linalg.norm(shortfall))
    return f"{size:.3g} of the {unit}, is missing" if size > _TOLERANCE else ""
