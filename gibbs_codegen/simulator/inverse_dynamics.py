"""Inverse dynamics: the thrusts and joint torques of a motion, and its constraint torques.

M a − R = B u for the free coordinates. Joint torques act on their own coordinates alone, so they
can be read off; attitude and position get a wrench on the base, which the allocation turns into
thrusts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.simulator.allocation import Allocation
from gibbs_codegen.simulator.vehicle import Vehicle

Array = NDArray[np.float64]


def required_inputs(
    vehicle: Vehicle, allocation: Allocation, q: Array, v: Array, a: Array
) -> Array:
    """Inputs u (…, nu) for a motion q, v, a (…, nq): thrusts, N, and joint torques, N m or N.

    Raises `AllocationError` where the arrangement of the rotors cannot make the motion.
    """
    force = vehicle.inverse_dynamics(q, v, a)
    thrusts = allocation.thrusts(vehicle.base_wrench(q, force))
    return np.concatenate([thrusts, force[..., vehicle.arm]], axis=-1)


def inputs_and_constraint_torques(
    vehicle: Vehicle, allocation: Allocation, q: Array, v: Array, a: Array
) -> tuple[Array, Array]:
    """Inputs u (…, nu), and the torques τ' (…, N − 1) that hold base arms 2 … N (eqs. 14–17)."""
    inputs = required_inputs(vehicle, allocation, q, v, a)
    return inputs, vehicle.constraint_torques(q, v, a, inputs)
