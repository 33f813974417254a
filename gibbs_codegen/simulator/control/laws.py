"""Control laws: the inputs that are commanded at a time and in a state.

Computed torque is the inverse dynamics of the desired acceleration, corrected by the tracking
error: with those inputs each coordinate's error e obeys ë + d ė + k e = 0. With a quaternion that
holds for position and joints, and for the rotation vector of the attitude while its axis stays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.scenario.scenario import Law
from gibbs_codegen.simulator.control.inverse_dynamics import required_inputs
from gibbs_codegen.simulator.plant.allocation import Allocation
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.reference import Reference


@dataclass(frozen=True)
class Gains:
    """Stiffness k (1/s²) and damping d (1/s) of the tracking errors, each (nv)."""

    stiffness: Array
    damping: Array

    @classmethod
    def of(cls, frequency: float | Array, damping_ratio: float | Array, coordinates: int) -> Gains:
        """Gains of the errors' natural frequencies and damping ratios.

        Args:
            frequency: Natural frequency, rad/s, one for all or one per velocity (nv).
            damping_ratio: Damping ratio, one for all or one per velocity (nv).
            coordinates: Number of velocities nv.

        Returns:
            The gains.
        """
        frequencies = np.broadcast_to(np.asarray(frequency, dtype=np.float64), coordinates)
        return cls(frequencies**2, 2.0 * damping_ratio * frequencies)


@dataclass(frozen=True)
class Controller:
    """Inputs for a state, so that the vehicle follows a reference.

    "computed_torque" corrects by the gains; "open_loop" commands the inputs of the desired motion,
    whatever the state; "off" commands zeros.
    """

    vehicle: Vehicle
    reference: Reference
    allocation: Allocation
    gains: Gains
    law: Law = "computed_torque"

    def __call__(self, time: float | Array, q: Array, v: Array) -> Array:
        """Inputs u (…, nu) at times (…), s, and states q (…, nq), v (…, nv).

        Raises:
            AllocationError: If the rotors cannot produce the wrench, whatever their thrusts.
        """
        if self.law == "off":
            return np.zeros((*np.shape(time), len(self.vehicle.inputs)))
        desired = self.reference(time)
        if self.law == "open_loop":
            q, v, a = desired
        else:
            gains = self.gains.stiffness, self.gains.damping
            a = self.vehicle.kinematics.corrected(q, v, desired, gains)
        return required_inputs(self.vehicle, self.allocation, q, v, a)
