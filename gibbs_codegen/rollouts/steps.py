"""Steps of a rollout, on arrays of NumPy or of JAX: all states at once.

This says once more, as short as it can be said, what the compiled rollout computes.
"""

from __future__ import annotations

from typing import Any

from gibbs_codegen.rollouts.problem import Array, Problem

State = tuple[Array, ...]


class Steps:
    """The steps of one problem, on states of coordinates, velocities and, with motors, thrusts."""

    def __init__(self, problem: Problem, xp: Any) -> None:
        """Take a problem, and the library of its arrays: NumPy, or JAX's."""
        self._problem, self._xp = problem, xp

    def begin(self) -> State:
        """Coordinates (n, nq), velocities (n, nv) and thrusts (n, rotors), N, at the start."""
        problem, motors = self._problem, self._problem.motors
        if motors is None:
            return problem.q, problem.v
        shape = len(problem.q), motors.thrusts.shape[-1]
        return problem.q, problem.v, self._xp.broadcast_to(motors.thrusts, shape)

    def beyond(self, q: Array, v: Array) -> Any:
        """Which states (n, nq), (n, nv) are out of bounds (n)."""
        if self._problem.bounds is None:
            return self._xp.zeros(len(q), dtype=bool)
        least, most = self._problem.bounds
        state = self._xp.concatenate([q, v], axis=1)
        outside: Any = ((state < least) | (state > most)).any(axis=1)
        return outside

    def commanded(self, number: Any, q: Array, v: Array) -> Array:
        """Inputs (n, nu) that are commanded in a step, within their limits."""
        problem, xp = self._problem, self._xp
        u = xp.broadcast_to(_of_step(problem.inputs, number), (len(q), problem.inputs.shape[-1]))
        if (feedback := problem.feedback) is not None:
            away = problem.module.difference(q, _of_step(feedback.q, number), problem.constants)
            slower = _of_step(feedback.v, number) - v
            u = u + xp.concatenate([away, slower], axis=1) @ feedback.gain.T
        motors = problem.motors
        limited: Array = u if motors is None else xp.clip(u, motors.least, motors.most)
        return limited

    def after(self, number: Any, q: Array, v: Array, *thrusts: Array) -> State:
        """Coordinates, velocities, and thrusts if motors lag (n, rotors), N, after a step.

        They may not be finite.
        """
        dt, commanded = self._problem.dt, self.commanded(number, q, v)
        method = self._euler if self._problem.method == "euler" else self._rk4
        moved = method(number, q, v, lambda time: self._acting(commanded, time, *thrusts))
        acting = self._acting(commanded, dt, *thrusts)
        return *moved, *(acting[:, : each.shape[1]] for each in thrusts)

    def _acting(self, commanded: Array, time: Any, *thrusts: Array) -> Array:
        """Inputs (n, nu) that act some time after the start of a step, at which thrusts are given.

        `commanded` (n, nu) is within limits.
        """
        if self._problem.motors is None:
            return commanded
        xp, lag, (before,) = self._xp, self._problem.motors.time_constants, thrusts
        decay = xp.where(lag > 0.0, xp.exp(-time / xp.where(lag > 0.0, lag, 1.0)), 0.0)
        settled, efforts = xp.split(commanded, [before.shape[1]], axis=1)
        acting: Array = xp.concatenate([settled + (before - settled) * decay, efforts], axis=1)
        return acting

    def _acceleration(self, number: Any, q: Array, v: Array, u: Array) -> Array:
        """Accelerations (n, nv) in a step, of inputs `u` (n, nu) that act."""
        module, constants = self._problem.module, self._problem.constants
        found: Array
        if self._problem.wrenches is None:
            found = module.forward_dynamics(q, v, u, constants)
        else:
            wrenches = _of_step(self._problem.wrenches, number)
            found = module.forward_dynamics_with_wrenches(q, v, u, wrenches, constants)
        return found

    def _moved(self, q: Array, displacement: Array) -> Array:
        """Coordinates (n, nq) after a displacement (n, nv)."""
        found: Array = self._problem.module.integrate(q, displacement, self._problem.constants)
        return found

    def _euler(self, number: Any, q: Array, v: Array, acting: Any) -> tuple[Array, Array]:
        """Coordinates and velocities after a semi-implicit Euler step.

        `acting` gives inputs (n, nu) by the time since its begin.
        """
        dt = self._problem.dt
        v_next = v + dt * self._acceleration(number, q, v, acting(0.0))
        return self._moved(q, dt * v_next), v_next

    def _rk4(self, number: Any, q: Array, v: Array, acting: Any) -> tuple[Array, Array]:
        """Coordinates and velocities after a step as the module's step_rk4 takes it."""
        dt, middle = self._problem.dt, acting(self._problem.dt / 2.0)
        a1 = self._acceleration(number, q, v, acting(0.0))
        half = self._moved(q, dt / 2.0 * v)
        rate = v + dt / 2.0 * a1
        a2 = self._acceleration(number, half, rate, middle)
        place = self._moved(q, dt / 2.0 * rate)
        rate = v + dt / 2.0 * a2
        a3 = self._acceleration(number, place, rate, middle)
        place = self._moved(half, dt * (rate - v / 2.0))
        a4 = self._acceleration(number, place, v + dt * a3, acting(dt))
        place = self._moved(q, dt / 2.0 * (v + dt / 6.0 * (a1 + a2 - a3)))
        q_next = self._moved(place, dt / 2.0 * (v + dt / 6.0 * (a1 + a2 + 3.0 * a3)))
        return q_next, v + dt / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


def _of_step(values: Array, number: Any) -> Array:
    """Values (1 or n, …) that hold in a step, of those (1 or n, 1 or steps, …) of all steps."""
    return values[:, number if values.shape[1] > 1 else 0]
