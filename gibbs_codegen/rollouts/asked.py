"""Rollouts under a controller of the caller's, which is asked for inputs from sample to sample."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from gibbs_codegen.rollouts.problem import REALS, RUNNING, Array, Problem, Rollout

Controller = Callable[[float, Any, Any], Any]
Roll = Callable[[Problem], Rollout]


def asked_rollout(
    problem: Problem,
    controller: Controller,
    read: Callable[[Any], Array],
    roll: Roll,
    progress: Callable[[float], None],
) -> Rollout:
    """Roll states out under a controller of time, s, and states (n, nq), (n, nv).

    `problem` has the inputs (1 or n, 1, nu) that it gave first; `read` makes such of what it gives,
    and `roll` rolls states out whose inputs are known. A state that has ended is shown to the
    controller as it ended.
    """
    count, every = len(problem.q), problem.every
    taken, ended = np.zeros(count, dtype=np.int64), np.full(count, RUNNING, dtype=np.int8)
    inputs, samples = problem.inputs, [_begin(problem)]
    for first in range(0, problem.steps, every):
        state = samples[-1]
        if first:
            inputs = read(controller(first * problem.dt, state[0].copy(), state[1].copy()))
        found = roll(_piece(problem, first, inputs, state))
        after = [each[:, -1] for each in (found.q, found.v, found.thrusts) if each is not None]
        runs = ended == RUNNING
        samples.append([np.where(runs[:, None], a, b) for a, b in zip(after, state, strict=True)])
        taken += np.where(runs, found.steps, 0)
        ended = np.where(runs, found.ended, ended)
        progress((first + every) / problem.steps)
    q, v, *thrusts = (np.stack(each, axis=1) for each in zip(*samples, strict=True))
    time = np.arange(len(samples), dtype=np.float64) * (problem.dt * every)
    return Rollout(time, q, v, thrusts[0] if thrusts else None, taken, ended)


def _begin(problem: Problem) -> list[Array]:
    """Coordinates, velocities and, where motors lag, thrusts at the start."""
    real, motors = REALS[problem.precision], problem.motors
    state = [problem.q.astype(real), problem.v.astype(real)]
    if motors is not None and np.any(motors.time_constants):
        shape = len(problem.q), motors.thrusts.shape[1]
        state.append(np.broadcast_to(motors.thrusts, shape).astype(real))
    return state


def _piece(problem: Problem, first: int, inputs: Array, state: list[Array]) -> Problem:
    """The problem from one sample to the next, with inputs (1 or n, 1, nu) that are commanded.

    `first` is the number of its first step; `state` is coordinates, velocities and, where motors
    lag, thrusts at its begin.
    """
    q, v, *thrusts = state
    wrenches, motors = problem.wrenches, problem.motors
    if wrenches is not None and wrenches.shape[1] > 1:
        wrenches = wrenches[:, first : first + problem.every]
    if motors is not None and thrusts:
        motors = replace(motors, thrusts=thrusts[0])
    steps = problem.every
    return replace(problem, q=q, v=v, inputs=inputs, steps=steps, wrenches=wrenches, motors=motors)
