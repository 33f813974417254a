"""Control laws: what inputs are asked for at a time and in a state.

Computed torque is the inverse dynamics of the desired acceleration, corrected by the error: with
those inputs each coordinate's error e obeys ë + d ė + k e = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.scenario.scenario import Law
from gibbs_codegen.simulator.allocation import Allocation
from gibbs_codegen.simulator.inverse_dynamics import required_inputs
from gibbs_codegen.simulator.reference import Reference
from gibbs_codegen.simulator.vehicle import Vehicle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gains:
    """Stiffness k (1/s²) and damping d (1/s) of the errors of the coordinates, each (nq)."""

    stiffness: Array
    damping: Array

    @classmethod
    def of(cls, frequency: float | Array, damping_ratio: float | Array, coordinates: int) -> Gains:
        """Gains of natural frequencies (rad/s) and damping ratios, one or one per coordinate."""
        frequencies = np.broadcast_to(np.asarray(frequency, dtype=np.float64), coordinates)
        return cls(frequencies**2, 2.0 * damping_ratio * frequencies)


@dataclass(frozen=True)
class Controller:
    """Inputs for a state, so that the machine follows a reference.

    "computed_torque" corrects by the gains; "open_loop" asks for the inputs of the desired motion,
    whatever the state; "off" asks for none.
    """

    vehicle: Vehicle
    reference: Reference
    allocation: Allocation
    gains: Gains
    law: Law = "computed_torque"

    def __call__(self, time: float | Array, q: Array, v: Array) -> Array:
        """Inputs u (…, nu) at times (…) and states q, v (…, nq). Raises `AllocationError`."""
        if self.law == "off":
            return np.zeros((*np.shape(time), len(self.vehicle.inputs)))
        wanted_q, wanted_v, a = self.reference(time)
        if self.law == "open_loop":
            q, v = wanted_q, wanted_v
        else:
            a = a + self.gains.damping * (wanted_v - v) + self.gains.stiffness * (wanted_q - q)
        return required_inputs(self.vehicle, self.allocation, q, v, a)
