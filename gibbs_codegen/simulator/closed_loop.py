"""The closed loop of machine, motors and controller: what integrators integrate.

The state is q, v, the work done since the start, and the thrusts where the motors lag. Work is part
of the state so that the energy balance is as exact as the integration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.scenario.scenario import TipForce
from gibbs_codegen.simulator.control import Controller
from gibbs_codegen.simulator.vehicle import Vehicle

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ClosedLoop:
    """Machine, controller, motors and what pushes from outside.

    `limits`: least and greatest thrust, N; `lag`: time constant of the motors, s, or 0 for none;
    `tip_force`: None where nothing pushes.
    """

    vehicle: Vehicle
    controller: Controller
    limits: tuple[float, float] | None = None
    lag: float = 0.0
    tip_force: TipForce | None = None

    @property
    def size(self) -> int:
        """Length of the state."""
        return 2 * len(self.vehicle.coordinates) + 1 + (self.vehicle.rotors if self.lag else 0)

    def start(self, q: Array, v: Array) -> Array:
        """The state at time 0, with motors that have settled at what is first asked of them."""
        thrusts = self._wanted_thrusts(self.commanded(0.0, q, v)) if self.lag else np.zeros(0)
        return np.concatenate([q, v, [0.0], thrusts])

    def parts(self, states: Array) -> tuple[Array, Array, Array, Array]:
        """q, v (…, nq), work (…) and thrusts (…, N or 0) of states (…, size)."""
        n = len(self.vehicle.coordinates)
        return (
            states[..., :n],
            states[..., n : 2 * n],
            states[..., 2 * n],
            states[..., 2 * n + 1 :],
        )

    def commanded(self, time: float | Array, q: Array, v: Array) -> Array:
        """Inputs u (…, nu) that the controller asks for."""
        return self.controller(time, q, v)

    def applied(self, commanded: Array, thrusts: Array) -> Array:
        """Inputs u (…, nu) that act: thrusts within limits, or those that the motors have."""
        inputs = commanded.copy()
        acting = thrusts if self.lag else self._wanted_thrusts(commanded)
        inputs[..., : self.vehicle.rotors] = acting
        return inputs

    def _wanted_thrusts(self, commanded: Array) -> Array:
        """Thrusts (…, N) that the motors aim for: those of inputs (…, nu), within limits."""
        thrusts = commanded[..., : self.vehicle.rotors]
        return np.clip(thrusts, *self.limits) if self.limits else thrusts

    def saturated(self, time: float, state: Array) -> list[int]:
        """Rotors, from 0, of which a limit is asked for at a time and in a state (size)."""
        if not self.limits:
            return []
        q, v, _, _ = self.parts(state)
        asked = self.commanded(time, q, v)[: self.vehicle.rotors]
        least, most = self.limits
        # Allocation within limits comes to them but for roundoff.
        margin = 1e-9 * (most - least)
        found: list[int] = np.flatnonzero(
            (asked <= least + margin) | (asked >= most - margin)
        ).tolist()
        return found

    def acceleration(
        self, q: Array, v: Array, inputs: Array, pushed: bool | NDArray[np.bool_]
    ) -> Array:
        """Accelerations (…, nq) of states and inputs, with the force on the tip where `pushed`."""
        acceleration = self.vehicle.forward_dynamics(q, v, inputs)
        if self.tip_force is None or not np.any(pushed):
            return acceleration
        push = self._generalised_push(q)
        extra = np.linalg.solve(self.vehicle.mass_matrix(q), push[..., np.newaxis])[..., 0]
        return acceleration + np.where(np.asarray(pushed)[..., np.newaxis], extra, 0.0)

    def pushed(self, time: float | Array) -> NDArray[np.bool_]:
        """Whether the force on the tip acts at times (…)."""
        force = self.tip_force
        if force is None:
            return np.zeros(np.shape(time), dtype=bool)
        return (np.asarray(time) >= force.begin) & (np.asarray(time) < force.end)

    def derivative(self, time: float, state: Array, pushed: bool) -> Array:
        """Time derivative of a state (size).

        `pushed` is given, since an integrator may ask for the end of a stretch without force, which
        is the moment when the force begins.
        """
        if not np.all(np.isfinite(state)):
            return np.full_like(state, np.nan)
        q, v, _, thrusts = self.parts(state)
        commanded = self.commanded(time, q, v)
        inputs = self.applied(commanded, thrusts)
        power = inputs @ (v @ self.vehicle.input_matrix(q))
        if pushed:
            power += self._generalised_push(q) @ v
        rates: list[Any] = [v, self.acceleration(q, v, inputs, pushed), [power]]
        if self.lag:
            rates.append((self._wanted_thrusts(commanded) - thrusts) / self.lag)
        return np.concatenate(rates)

    def breaks(self, duration: float) -> list[float]:
        """Times from 0 to `duration` between which nothing jumps."""
        force = self.tip_force
        inner = [force.begin, force.end] if force else []
        return sorted({0.0, duration, *(t for t in inner if 0.0 < t < duration)})

    def _generalised_push(self, q: Array) -> Array:
        if self.tip_force is None:
            return np.zeros_like(q)
        jacobian = self.vehicle.tip_jacobian(q)[..., :3, :]
        push: Array = np.asarray(self.tip_force.force) @ jacobian
        return push
