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

# Time, s, over which thrusts are differenced. A second derivative of 100 N/s² then costs 5e-6 N/s,
# and rounding of 10 N about as much.
_AHEAD = 1e-7


def wanted_rates(
    law: ControlLaw,
    time: float | Array,
    parts: tuple[Array, Array, Array],
    wanted: Array,
    acting: Array,
) -> Array:
    """Time derivatives (…, N), N/s, along the motion, of the thrusts that a law wants.

    Of the law nothing is known but what it commands: `wanted`, while `acting` act, both (…, nu).
    `parts` are coordinates, velocities, and memory. Where limits begin or cease to bind, the mean
    of both sides.
    """
    q, v, memory = parts
    vehicle, growth = law.vehicle, law.growth(time, q, v, memory)
    moving, a = vehicle.kinematics.rates(q, v), vehicle.forward_dynamics(q, v, acting)
    # Back at the end of the desired motion, after which it stands still.
    ahead = np.where(np.asarray(time) > law.reference.end - _AHEAD, -_AHEAD, _AHEAD)
    share = ahead[..., np.newaxis]
    moved = vehicle.kinematics.normalised(q + share * moving)
    later = law(time + ahead, moved, v + share * a, memory + share * growth)
    rates: Array = ((later - wanted) / share)[..., : vehicle.rotors]
    return rates
