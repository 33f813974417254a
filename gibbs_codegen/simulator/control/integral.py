"""Integral action: what laws of control learn of disturbances that last.

A law remembers the integral z of each error e, and corrects as if the error were e + i z, with
a rate i that is given. So ë + d ė + k (e + i z) = 0 where the model is exact, and under a constant
disturbance e⃛ + d ë + k ė + i k e = 0, which comes to rest at no error. By Routh that is stable
where i is less than d; of the geometric law, `error_polynomials` tells. While an input is at a
limit, what is remembered may shrink but not grow.
"""

from __future__ import annotations

import numpy as np

from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle


def learned(vehicle: Vehicle, pull: Array, q: Array) -> Array:
    """Accelerations (…, nv) that correct motions, from `pull` (…, nv), those of the errors.

    Those of a base with a quaternion are in its frame.
    """
    found = np.array(pull)
    if vehicle.layout.is_quaternion:
        place = vehicle.layout.v.position
        found[..., place] = (pull[..., np.newaxis, place] @ vehicle.base_rotation(q))[..., 0, :]
    return found


def kept_from_winding(growth: Array, memory: Array, saturated: bool | np.bool_) -> Array:
    """Growth of what is remembered, none of it away from 0 while an input is at a limit."""
    return np.where(saturated & (growth * memory >= 0.0), 0.0, growth)
