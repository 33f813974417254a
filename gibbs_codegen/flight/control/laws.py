"""Control laws: the inputs that are commanded at a time and in a state.

Computed torque is the inverse dynamics of the desired acceleration, corrected by the tracking
error: with those inputs each coordinate's error e obeys ë + d ė + k e = 0. With a quaternion that
holds for position and joints, and for the rotation vector of the attitude while its axis stays.

Inverse dynamics: M a − R = B u for the free coordinates. The entries of attitude and position are a
wrench on the base, which the allocation turns into thrusts. Each joint torque acts on its own
coordinate alone, so it is that entry of the left side, less what thrusts of rotors on links
contribute to it.

Integral action: a law remembers the integral z of each error e, and corrects as if the error were
e + i z, with a rate i that is given. So ë + d ė + k (e + i z) = 0 where the model is exact, and
under a constant disturbance e⃛ + d ë + k ė + i k e = 0, which comes to rest at no error. By Routh
that is stable where i is less than d; of the geometric law, `error_polynomials` tells. While an
input is at a limit, what is remembered may shrink but not grow.

Lag compensation: a motor with time constant T gives a thrust F that obeys T Ḟ = u − F. For thrusts
F* that a law wants, the command u = F* + T Ḟ* makes T (Ḟ − Ḟ*) = F* − F: what a thrust is off
decays by itself, within T, and tracking errors obey the same equation as without lag. Ḟ* is the
derivative in time along the motion, of the desired motion and of all that the law feeds back. The
accelerations that are part of the motion are those that the acting thrusts give the robot as the
law knows it; for this the thrusts must be measured, or known from a model of the motors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gibbs_codegen.flight.plant.allocation import Allocation
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Reference
from gibbs_codegen.flight.scenario.parts import Law

# Laws that correct errors by gains.
CORRECTING: tuple[Law, ...] = ("computed_torque", "geometric")
# Time, s, over which thrusts are differenced. A second derivative of 100 N/s² then costs 5e-6 N/s,
# and rounding of 10 N about as much.
_AHEAD = 1e-7


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


def error_correction(vehicle: Vehicle, pull: Array, q: Array) -> Array:
    """Accelerations (…, nv) that correct motions, from `pull` (…, nv), those of the errors.

    Those of a base with a quaternion are in its frame.
    """
    found = np.array(pull)
    if vehicle.layout.is_quaternion:
        place = vehicle.layout.v.position
        found[..., place] = (pull[..., np.newaxis, place] @ vehicle.base_rotation(q))[..., 0, :]
    return found


def anti_windup(growth: Array, memory: Array, saturated: bool | np.bool_) -> Array:
    """Growth of what is remembered, none of it away from 0 while an input is at a limit."""
    return np.where(saturated & (growth * memory >= 0.0), 0.0, growth)


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
                a = a + error_correction(self.vehicle, pull, q)
        return required_inputs(self.vehicle, self.allocation, q, v, a)

    def growth(self, time: float | Array, q: Array, v: Array, memory: Array) -> Array:
        """Time derivative (…, m) of the errors' integrals, with nv entries or none: the errors."""
        if not self.memory:
            return memory
        desired = self.reference(time)
        return self.vehicle.kinematics.errors(q, v, *desired[:2])[0]


def setpoint_rates(
    law: ControlLaw,
    time: float | Array,
    parts: tuple[Array, Array, Array],
    wanted: Array,
    applied: Array,
) -> Array:
    """Time derivatives (…, N), N/s, along the motion, of the thrusts that a law wants.

    Of the law nothing is known but what it commands: `wanted`, while `applied` act, both (…, nu).
    `parts` are coordinates, velocities, and memory. Where limits begin or cease to bind, the mean
    of both sides.
    """
    q, v, memory = parts
    vehicle, growth = law.vehicle, law.growth(time, q, v, memory)
    moving, a = vehicle.kinematics.rates(q, v), vehicle.forward_dynamics(q, v, applied)
    # Back at the end of the desired motion, after which it stands still.
    ahead = np.where(np.asarray(time) > law.reference.end - _AHEAD, -_AHEAD, _AHEAD)
    share = ahead[..., np.newaxis]
    moved = vehicle.kinematics.normalised(q + share * moving)
    later = law(time + ahead, moved, v + share * a, memory + share * growth)
    return ((later - wanted) / share)[..., : vehicle.rotors]
