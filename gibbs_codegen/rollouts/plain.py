"""Rollouts in NumPy: all states at once, step by step, by the functions of the module.

This says once more, as short as it can be said, what the compiled rollout computes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from gibbs_codegen.rollouts.problem import (
    DIVERGED,
    OUT_OF_BOUNDS,
    RUNNING,
    Array,
    Motors,
    Problem,
    Rollout,
)

Accelerations = Callable[[float, Array, Array], Array]


def plain_rollout(
    problem: Problem, progress: Callable[[float], None] = lambda share: None
) -> Rollout:
    """Roll states out in NumPy, always in double precision.

    Args:
        problem: What is computed, of a module with the back end "numpy" or "c".
        progress: Is told after every step the share of all that is done, 0 to 1.

    Returns:
        What comes out.
    """
    count = len(problem.q)
    state = [problem.q, problem.v]
    if problem.motors is not None:
        state.append(np.repeat(problem.motors.thrusts, count // len(problem.motors.thrusts), 0))
    samples = [state]
    taken, ended = np.zeros(count, dtype=np.int64), np.full(count, RUNNING, dtype=np.int8)
    for number in range(problem.steps):
        with np.errstate(all="ignore"):
            after = _after_step(problem, number, *state)
        finite = np.isfinite(np.concatenate(after, axis=1)).all(axis=1)
        ended[(ended == RUNNING) & ~finite] = DIVERGED
        going = ended == RUNNING
        state = [np.where(going[:, None], a, b) for a, b in zip(after, state, strict=True)]
        taken += going
        ended[going & _beyond(problem, *state[:2])] = OUT_OF_BOUNDS
        if (number + 1) % problem.every == 0:
            samples.append(state)
        progress((number + 1) / problem.steps)
    q, v, *thrusts = (np.stack(each, axis=1) for each in zip(*samples, strict=True))
    time = np.arange(len(samples)) * (problem.dt * problem.every)
    lags = problem.motors is not None and np.any(problem.motors.time_constants)
    return Rollout(time, q, v, thrusts[0] if lags else None, taken, ended)


def _beyond(problem: Problem, q: Array, v: Array) -> Any:
    """Which states are out of bounds.

    Args:
        problem: What is computed.
        q, v: Coordinates (n, nq) and velocities (n, nv).

    Returns:
        Whether each is (n).
    """
    if problem.bounds is None:
        return np.zeros(len(q), dtype=bool)
    least, most = problem.bounds
    state = np.concatenate([q, v], axis=1)
    return ((state < least) | (state > most)).any(axis=1)


def _after_step(
    problem: Problem, number: int, q: Array, v: Array, thrusts: Array | None = None
) -> list[Array]:
    """States after a step, whether finite or not.

    Args:
        problem: What is computed.
        number: Of the step, from 0.
        q, v: Coordinates (n, nq) and velocities (n, nv) at its begin.
        thrusts: Thrusts (n, rotors) there, N, where there are motors.

    Returns:
        Coordinates, velocities, and thrusts where they are given.
    """
    module, constants, dt = problem.module, problem.constants, problem.dt
    commanded = _commanded(problem, number, q, v)
    wrenches = None if problem.wrenches is None else _of_step(problem.wrenches, number)

    def accelerations(time: float, q: Array, v: Array) -> Array:
        u = commanded
        if problem.motors is not None and thrusts is not None:
            u = _acting(problem.motors, commanded, thrusts, time)
        found: Array
        if wrenches is None:
            found = module.forward_dynamics(q, v, u, constants)
        else:
            found = module.forward_dynamics_with_wrenches(q, v, u, wrenches, constants)
        return found

    def moved(q: Array, displacement: Array) -> Array:
        found: Array = module.integrate(q, displacement, constants)
        return found

    method = _euler if problem.method == "euler" else _rk4
    after = [*method(accelerations, moved, q, v, dt)]
    if problem.motors is not None and thrusts is not None:
        rotors = thrusts.shape[1]
        after.append(_acting(problem.motors, commanded, thrusts, dt)[:, :rotors])
    return after


def _of_step(values: Array, number: int) -> Array:
    """Values (1 or n, …) that hold in a step, of those (1 or n, 1 or steps, …) of all steps."""
    return values[:, number if values.shape[1] > 1 else 0]


def _commanded(problem: Problem, number: int, q: Array, v: Array) -> Array:
    """Inputs (n, nu) that are commanded in a step, within their limits.

    Args:
        problem: What is computed.
        number: Of the step, from 0.
        q, v: Coordinates (n, nq) and velocities (n, nv) at its begin.

    Returns:
        The inputs.
    """
    u = np.broadcast_to(_of_step(problem.inputs, number), (len(q), problem.inputs.shape[-1]))
    if (feedback := problem.feedback) is not None:
        away = problem.module.difference(q, _of_step(feedback.q, number), problem.constants)
        slower = _of_step(feedback.v, number) - v
        u = u + np.concatenate([away, slower], axis=1) @ feedback.gain.T
    return u if problem.motors is None else np.clip(u, problem.motors.least, problem.motors.most)


def _acting(motors: Motors, commanded: Array, thrusts: Array, time: float) -> Array:
    """Inputs (n, nu) that act some time after the begin of a step.

    Args:
        motors: What becomes of the inputs.
        commanded: Inputs (n, nu) that are commanded through the step, within their limits.
        thrusts: Thrusts (n, rotors) at the begin of the step, N.
        time: Since then, s.

    Returns:
        The inputs.
    """
    lag = motors.time_constants
    decay = np.exp(np.divide(-time, lag, out=np.full_like(lag, -np.inf), where=lag > 0.0))
    settled, efforts = np.split(commanded, [thrusts.shape[1]], axis=1)
    return np.concatenate([settled + (thrusts - settled) * decay, efforts], axis=1)


def _euler(
    accelerations: Accelerations,
    moved: Callable[[Array, Array], Array],
    q: Array,
    v: Array,
    dt: float,
) -> tuple[Array, Array]:
    """Coordinates and velocities after a semi-implicit Euler step.

    Args:
        accelerations: Of a time since the begin of the step, coordinates and velocities.
        moved: Coordinates after a displacement.
        q, v: Coordinates (n, nq) and velocities (n, nv) at the begin of the step.
        dt: How long it is, s.

    Returns:
        Coordinates and velocities.
    """
    v_next = v + dt * accelerations(0.0, q, v)
    return moved(q, dt * v_next), v_next


def _rk4(
    accelerations: Accelerations,
    moved: Callable[[Array, Array], Array],
    q: Array,
    v: Array,
    dt: float,
) -> tuple[Array, Array]:
    """Coordinates and velocities after a step as the module's step_rk4 takes it.

    Args:
        accelerations, moved, q, v, dt: As of `_euler`.

    Returns:
        Coordinates and velocities.
    """
    a1 = accelerations(0.0, q, v)
    half = moved(q, dt / 2.0 * v)
    rate = v + dt / 2.0 * a1
    a2 = accelerations(dt / 2.0, half, rate)
    place = moved(q, dt / 2.0 * rate)
    rate = v + dt / 2.0 * a2
    a3 = accelerations(dt / 2.0, place, rate)
    place = moved(half, dt * (rate - v / 2.0))
    a4 = accelerations(dt, place, v + dt * a3)
    place = moved(q, dt / 2.0 * (v + dt / 6.0 * (a1 + a2 - a3)))
    q_next = moved(place, dt / 2.0 * (v + dt / 6.0 * (a1 + a2 + 3.0 * a3)))
    return q_next, v + dt / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
