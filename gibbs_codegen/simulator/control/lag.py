"""Motor lag, compensated: what is commanded so that lagging thrusts are those that a law wants.

A motor with time constant T gives a thrust F that obeys T Ḟ = u − F. For thrusts F* that a law
wants, the command u = F* + T Ḟ* makes T (Ḟ − Ḟ*) = F* − F: what a thrust is off decays by itself,
within T, and tracking errors obey the same equation as without lag. Ḟ* is the derivative in time
along the motion, of the desired motion and of all that the law feeds back. The accelerations that
are part of the motion are those that the acting thrusts give the robot as the law knows it; for
this the thrusts must be measured, or known from a model of the motors.
"""

from __future__ import annotations

import numpy as np

from gibbs_codegen.simulator.control.laws import ControlLaw
from gibbs_codegen.simulator.plant.vehicle import Array

# Half the time, s, over which thrusts are differenced. Their third derivatives, which stay below
# 1e6 N/s³, then cost 2e-5 N/s, and rounding less than that.
_AHEAD = 1e-5


def wanted_rates(
    law: ControlLaw, time: float | Array, q: Array, v: Array, memory: Array, acting: Array
) -> Array:
    """Time derivatives, along the motion, of the thrusts that a law wants.

    Args:
        law: The law, of which nothing is known but what it commands.
        time: Times (…), s.
        q, v: Coordinates (…, nq) and velocities (…, nv).
        memory: What the law remembers (…, memory).
        acting: Inputs (…, nu) that act: thrusts of the motors, torques of the joints.

    Returns:
        Rates (…, N), N/s. Where limits begin or cease to bind, the mean of both sides.
    """
    vehicle, growth = law.vehicle, law.growth(time, q, v, memory)
    moving, a = vehicle.kinematics.rates(q, v), vehicle.forward_dynamics(q, v, acting)
    # Within the desired motion, which stands still before its begin and after its end.
    begin, end = law.reference.begin, law.reference.end
    first = np.clip(np.asarray(time) - _AHEAD, begin, end - 2.0 * _AHEAD)
    thrusts = []
    for instant in (first, first + 2.0 * _AHEAD):
        ahead = (instant - time)[..., np.newaxis]
        moved = vehicle.kinematics.normalised(q + ahead * moving)
        wanted = law(instant, moved, v + ahead * a, memory + ahead * growth)
        thrusts.append(wanted[..., : vehicle.rotors])
    rates: Array = (thrusts[1] - thrusts[0]) / (2.0 * _AHEAD)
    return rates
