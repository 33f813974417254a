"""Inverse dynamics: the thrusts and joint torques of a motion, and its constraint torques.

M a − R = B u for the free coordinates. The entries of attitude and position are a wrench on the
base, which the allocation turns into thrusts. Each joint torque acts on its own coordinate alone,
so it is that entry of the left side, less what thrusts of rotors on links contribute to it.
"""

from __future__ import annotations

import numpy as np

from gibbs_codegen.simulator.plant.allocation import Allocation
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle


def required_inputs(
    vehicle: Vehicle, allocation: Allocation, q: Array, v: Array, a: Array
) -> Array:
    """Inputs u (…, nu) that a motion needs: thrusts, N, then joint torques, N m or N.

    Raises `AllocationError` if no thrusts at all produce the wrench.
    """
    return inputs_of(vehicle, allocation, q, vehicle.inverse_dynamics(q, v, a))


def inputs_of(vehicle: Vehicle, allocation: Allocation, q: Array, force: Array) -> Array:
    """Inputs u (…, nu) that produce a generalised force M a − R (…, nv).

    Raises `AllocationError` if no thrusts at all produce the wrench.
    """
    thrusts = allocation.thrusts_at(q, vehicle.base_wrench(q, force))
    efforts = force[..., vehicle.arm_rates]
    if vehicle.rotors_move:
        loads = vehicle.input_matrix(q)[..., vehicle.arm_rates, : vehicle.rotors]
        efforts = efforts - (loads @ thrusts[..., np.newaxis])[..., 0]
    return np.concatenate([thrusts, efforts], axis=-1)


def inputs_and_constraint_torques(
    vehicle: Vehicle, allocation: Allocation, q: Array, v: Array, a: Array
) -> tuple[Array, Array]:
    """`required_inputs`, and the torques τ' (…, N − 1) of base arms 2 … N (eqs.

    14–17), N m. These hold the base arms.
    """
    inputs = required_inputs(vehicle, allocation, q, v, a)
    return inputs, vehicle.constraint_torques(q, v, a, inputs)
