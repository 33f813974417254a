"""Point masses that are fixed to frames: the forces by which they load the robot.

A payload of mass m does to its frame f = m (g − p̈), where p̈ = J a + c is the acceleration of the
frame. The acceleration a of the robot depends on f: a = a₀ + M⁻¹ Jᵀ f, where a₀ is that under all
other forces. So the forces of all payloads solve (1 + m J M⁻¹ Jᵀ) f = m (g − c − J a₀), which is
exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.scenario.environment import Payload
from gibbs_codegen.simulator.plant.vehicle import Array, Flags, Vehicle


class Payloads:
    """The p payloads of a flight, and the robot that carries them."""

    def __init__(self, vehicle: Vehicle, payloads: Sequence[Payload]) -> None:
        self.vehicle = vehicle
        self.masses: Array = np.array([each.mass for each in payloads], dtype=np.float64)
        self.begins: Array = np.array([each.begin for each in payloads], dtype=np.float64)
        self.ends: Array = np.array([each.end for each in payloads], dtype=np.float64)
        self.places: NDArray[np.intp] = np.array(
            [vehicle.frames.index(each.frame) for each in payloads], dtype=np.intp
        )

    @cached_property
    def gravity(self) -> Array:
        """The acceleration of gravity (…, 3), m/s², world axes; plants that differ have theirs."""
        vehicle = self.vehicle
        upwards = vehicle.layout.v.position.start + 2
        weight = vehicle.function("gravity_forces")(vehicle.neutral)[..., upwards]
        mass = vehicle.mass_matrix(vehicle.neutral)[..., upwards, upwards]
        return np.multiply.outer(weight / mass, [0.0, 0.0, 1.0])

    def carried(self, time: float | Array) -> Flags:
        """Which payloads are there (…, p) at times (…), s."""
        times = np.asarray(time)[..., np.newaxis]
        there: Flags = (times >= self.begins) & (times < self.ends)
        return there

    def add(self, wrenches: Array, q: Array, v: Array, inputs: Array, carried: ArrayLike) -> None:
        """Add the forces of the payloads to the wrenches (…, f, 6) of all else.

        `carried` (…, p) tells which are there.
        """
        vehicle = self.vehicle
        masses = np.repeat(np.where(carried, self.masses, 0.0), 3, axis=-1)
        free = vehicle.forward_dynamics_with_wrenches(q, v, inputs, wrenches)
        jacobian = vehicle.function("frame_jacobians")(q)[..., self.places, :3, :]
        jacobian = jacobian.reshape(*q.shape[:-1], masses.shape[-1], free.shape[-1])
        drift = vehicle.function("frame_bias_accelerations")(q, v)[..., self.places, :3]
        drift = (
            drift.reshape(*q.shape[:-1], masses.shape[-1]) + (jacobian @ free[..., None])[..., 0]
        )
        yielding = np.linalg.solve(vehicle.mass_matrix(q), np.swapaxes(jacobian, -1, -2))
        matrix = np.eye(masses.shape[-1]) + masses[..., None] * (jacobian @ yielding)
        falling = masses * (np.tile(self.gravity, len(self.places)) - drift)
        forces = np.linalg.solve(matrix, falling[..., None])[..., 0]
        for k, place in enumerate(self.places):
            wrenches[..., place, :3] += forces[..., 3 * k : 3 * k + 3]
