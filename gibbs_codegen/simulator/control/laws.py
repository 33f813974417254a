"""Control laws: the inputs that are commanded at a time and in a state.

Computed torque is the inverse dynamics of the desired acceleration, corrected by the tracking
error: with those inputs each coordinate's error e obeys ë + d ė + k e = 0. With a quaternion that
holds for position and joints, and for the rotation vector of the attitude while its axis stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gibbs_codegen.scenario.control import Law
from gibbs_codegen.simulator.control.integral import learned
from gibbs_codegen.simulator.control.inverse_dynamics import required_inputs
from gibbs_codegen.simulator.plant.allocation import Allocation
from gibbs_codegen.simulator.plant.vehicle import Array, Vehicle
from gibbs_codegen.simulator.reference import Reference

# Laws that correct errors by gains.
CORRECTING: tuple[Law, ...] = ("computed_torque", "geometric")


@dataclass(frozen=True)
class Gains:
    """Stiffness k (1/s²) and damping d (1/s) of the tracking errors, each (nv).

    `integral` (1/s) is the rate of integral action, 0 for none.
    """

    stiffness: Array
    damping: Array
    integral: float = 0.0

    @classmethod
    def of(cls, frequency: float | Array, damping_ratio: float | Array, coordinates: int) -> Gains:
        """Gains of natural frequencies, rad/s, and damping ratios of errors, each one or (nv)."""
        frequencies = np.broadcast_to(np.asarray(frequency, dtype=np.float64), coordinates)
        return cls(frequencies**2, 2.0 * damping_ratio * frequencies)


class ControlLaw(Protocol):
    """What commands motors and joints: inputs of a time, a state and what the law remembers.

    `vehicle` is the model that the law knows, which need not be the plant. `memory` is how many
    numbers it remembers, which are integrated with the state: 0 for none.
    """

    @property
    def vehicle(self) -> Vehicle:
        """The robot as the law knows it."""

    @property
    def reference(self) -> Reference:
        """The desired motion."""

    @property
    def allocation(self) -> Allocation:
        """Control allocation of the rotors, as the law knows them."""

    @property
    def gains(self) -> Gains:
        """Gains of the tracking errors."""

    @property
    def law(self) -> str:
        """Its name."""

    @property
    def memory(self) -> int:
        """How many numbers the law remembers."""

    def __call__(self, time: float | Array, q: Array, v: Array, memory: Array) -> Array:
        """Inputs u (…, nu) at times (…), s, states q (…, nq), v (…, nv), and memory (…, memory)."""

    def growth(self, time: float | Array, q: Array, v: Array, memory: Array) -> Array:
        """Time derivative (…, memory) of what the law remembers (…, memory)."""


@dataclass(frozen=True)
class Controller:
    """Inputs for a state, so that the vehicle follows a reference.

    "computed_torque" corrects by the gains; "open_loop" commands the inputs of the desired motion,
    whatever the state; "off" commands zeros. With integral action `memory` is nv.
    """

    vehicle: Vehicle
    reference: Reference
    allocation: Allocation
    gains: Gains
    law: Law = "computed_torque"
    memory: int = 0

    def __call__(
        self, time: float | Array, q: Array, v: Array, memory: Array | None = None
    ) -> Array:
        """Inputs u (…, nu) for states q (…, nq), v (…, nv), and memory (…, m).

        Raises `AllocationError` if no thrusts at all produce the wrench.
        """
        if self.law == "off":
            return np.zeros((*np.shape(time), len(self.vehicle.inputs)))
        desired = self.reference(time)
        if self.law == "open_loop":
            q, v, a = desired
        else:
            gains = self.gains.stiffness, self.gains.damping
            a = self.vehicle.kinematics.corrected(q, v, desired, gains)
            if memory is not None and self.memory:
                pull = self.gains.stiffness * self.gains.integral * memory
                a = a + learned(self.vehicle, pull, q)
        return required_inputs(self.vehicle, self.allocation, q, v, a)

    def growth(self, time: float | Array, q: Array, v: Array, memory: Array) -> Array:
        """Time derivative (…, m) of the errors' integrals, with nv entries or none: the errors."""
        if not self.memory:
            return memory
        desired = self.reference(time)
        return self.vehicle.kinematics.errors(q, v, *desired[:2])[0]
