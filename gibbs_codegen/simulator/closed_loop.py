"""The closed loop of vehicle, motors and controller: what integrators integrate.

The state is q, v, the work done since the start, and the thrusts where the motors lag. Work is part
of the state so that the energy balance is as exact as the integration. The length of a quaternion
drifts with errors of integration, and means nothing: who takes a state apart gets it of length 1.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from gibbs_codegen.scenario.scenario import TipForce
from gibbs_codegen.simulator.control import Controller
from gibbs_codegen.simulator.state_history import SmoothInterval
from gibbs_codegen.simulator.vehicle import Array, Flags, Vehicle


@dataclass(frozen=True)
class ClosedLoop:
    """Vehicle, controller, motors and the force on the tip.

    `limits`: least and greatest thrust, N; `lag`: time constant of the motors, s, or 0 for none;
    `tip_force`: None where no force acts on the tip.
    """

    vehicle: Vehicle
    controller: Controller
    limits: tuple[float, float] | None = None
    lag: float = 0.0
    tip_force: TipForce | None = None

    @property
    def size(self) -> int:
        """Length of the state."""
        return self.work_place + 1 + (self.vehicle.rotors if self.lag else 0)

    @property
    def work_place(self) -> int:
        """Place of the work in the state, after coordinates and velocities."""
        return self.vehicle.layout.q.size + self.vehicle.layout.v.size

    def start(self, q: Array, v: Array) -> Array:
        """The state at time 0, with motors that have settled at the first commanded thrusts.

        Args:
            q, v: Coordinates (nq) and velocities (nv).

        Returns:
            The state (size).
        """
        thrusts = self._thrust_setpoints(self.controller(0.0, q, v)) if self.lag else np.zeros(0)
        return np.concatenate([q, v, [0.0], thrusts])

    def parts(self, states: Array) -> tuple[Array, Array, Array, Array]:
        """What states consist of.

        Args:
            states: States (…, size).

        Returns:
            Coordinates (…, nq), velocities (…, nv), work (…), J, and thrusts (…, N), N; (…, 0)
            without lag.
        """
        n, work = self.vehicle.layout.q.size, self.work_place
        return (
            self.vehicle.kinematics.normalised(states[..., :n]),
            states[..., n:work],
            states[..., work],
            states[..., work + 1 :],
        )

    def applied(self, commanded: Array, thrusts: Array) -> Array:
        """Inputs that act: those commanded, with thrusts as the motors give them.

        Args:
            commanded: Inputs (…, nu) that the controller commands.
            thrusts: Thrusts (…, N) of the state, N; not looked at if the motors do not lag.

        Returns:
            Inputs u (…, nu).
        """
        inputs = commanded.copy()
        acting = thrusts if self.lag else self._thrust_setpoints(commanded)
        inputs[..., : self.vehicle.rotors] = acting
        return inputs

    def _thrust_setpoints(self, commanded: Array) -> Array:
        """Thrusts (…, N) that the motors aim for: those of inputs (…, nu), within limits."""
        thrusts = commanded[..., : self.vehicle.rotors]
        return np.clip(thrusts, *self.limits) if self.limits else thrusts

    def saturated(self, time: float, state: Array) -> list[int]:
        """Rotors of which the greatest or the least thrust is commanded.

        Args:
            time: Time, s.
            state: State (size).

        Returns:
            Their numbers, from 0.
        """
        if not self.limits:
            return []
        q, v, _, _ = self.parts(state)
        thrusts = self.controller(time, q, v)[: self.vehicle.rotors]
        least, most = self.limits
        # Allocation within limits comes to them but for roundoff.
        margin = 1e-9 * (most - least)
        found: list[int] = np.flatnonzero(
            (thrusts <= least + margin) | (thrusts >= most - margin)
        ).tolist()
        return found

    def acceleration(self, q: Array, v: Array, inputs: Array, tip_force: bool | Flags) -> Array:
        """Accelerations of states and inputs, by the forward dynamics.

        Args:
            q, v: Coordinates (…, nq) and velocities (…, nv).
            inputs: Inputs u (…, nu) that act.
            tip_force: Whether the force on the tip acts (…).

        Returns:
            Accelerations (…, nv).
        """
        acceleration = self.vehicle.forward_dynamics(q, v, inputs)
        if self.tip_force is None or not np.any(tip_force):
            return acceleration
        force = self._generalised_tip_force(q)
        extra = np.linalg.solve(self.vehicle.mass_matrix(q), force[..., np.newaxis])[..., 0]
        return acceleration + np.where(np.asarray(tip_force)[..., np.newaxis], extra, 0.0)

    def tip_force_acts(self, time: float | Array) -> Flags:
        """Whether the force on the tip acts.

        Args:
            time: Times (…), s.

        Returns:
            Whether it acts at those times (…).
        """
        force = self.tip_force
        if force is None:
            return np.zeros(np.shape(time), dtype=bool)
        return (np.asarray(time) >= force.begin) & (np.asarray(time) < force.end)

    def derivative(self, time: float, state: Array, tip_force: bool) -> Array:
        """Time derivative of a state.

        Args:
            time: Time, s.
            state: State (size).
            tip_force: Whether the force on the tip acts. This is given, since an integrator may
                ask for the end of an interval without force, which is when the force begins.

        Returns:
            The derivative (size), NaN for a state that is not finite.
        """
        if not np.all(np.isfinite(state)):
            return np.full_like(state, np.nan)
        q, v, _, thrusts = self.parts(state)
        commanded = self.controller(time, q, v)
        inputs = self.applied(commanded, thrusts)
        power = inputs @ (v @ self.vehicle.input_matrix(q)) - self.vehicle.damping @ v**2
        if tip_force:
            power += self._generalised_tip_force(q) @ v
        moving = self.vehicle.kinematics.rates(state[: len(q)], v)
        rates: list[Any] = [moving, self.acceleration(q, v, inputs, tip_force), [power]]
        if self.lag:
            rates.append((self._thrust_setpoints(commanded) - thrusts) / self.lag)
        return np.concatenate(rates)

    def smooth_intervals(self, duration: float) -> list[SmoothInterval]:
        """The intervals of a flight between which the force on the tip jumps.

        Args:
            duration: Duration of the flight, s.

        Returns:
            Intervals from 0 to `duration`, each beginning where the one before ends.
        """
        force = self.tip_force
        jumps = [force.begin, force.end] if force else []
        times = sorted({0.0, duration, *(t for t in jumps if 0.0 < t < duration)})
        return [
            SmoothInterval(begin, end, bool(self.tip_force_acts(begin)))
            for begin, end in itertools.pairwise(times)
        ]

    def _generalised_tip_force(self, q: Array) -> Array:
        """Generalised force Jᵀf (…, nv) of the force on the tip, at coordinates (…, nq)."""
        if self.tip_force is None:
            return np.zeros(self.vehicle.layout.v.size)
        jacobian = self.vehicle.tip_jacobian(q)[..., :3, :]
        generalised: Array = np.asarray(self.tip_force.force) @ jacobian
        return generalised
