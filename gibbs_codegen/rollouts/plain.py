"""Rollouts in NumPy: a loop over steps of all states at once, by the functions of the module."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gibbs_codegen.rollouts.problem import (
    DIVERGED,
    OUT_OF_BOUNDS,
    REALS,
    RUNNING,
    Problem,
    Rollout,
)
from gibbs_codegen.rollouts.steps import Steps


def plain_rollout(
    problem: Problem, progress: Callable[[float], None] = lambda share: None
) -> Rollout:
    """Roll states out in NumPy, always in double precision.

    The module's back end is "numpy" or "c"; `progress` is told after every step the share done.
    """
    steps, count = Steps(problem, np), len(problem.q)
    state = steps.begin()
    samples = [state]
    taken, ended = np.zeros(count, dtype=np.int64), np.full(count, RUNNING, dtype=np.int8)
    for number in range(problem.steps):
        with np.errstate(all="ignore"):
            after = steps.after(number, *state)
        finite = np.isfinite(np.concatenate(after, axis=1)).all(axis=1)
        ended[(ended == RUNNING) & ~finite] = DIVERGED
        going = ended == RUNNING
        state = tuple(np.where(going[:, None], a, b) for a, b in zip(after, state, strict=True))
        taken += going
        ended[going & steps.beyond(*state[:2])] = OUT_OF_BOUNDS
        if (number + 1) % problem.every == 0:
            samples.append(state)
        progress((number + 1) / problem.steps)
    real = REALS[problem.precision]
    q, v, *thrusts = (
        np.stack(each, axis=1).astype(real, copy=False) for each in zip(*samples, strict=True)
    )
    time = np.arange(len(samples), dtype=np.float64) * (problem.dt * problem.every)
    lags = problem.motors is not None and np.any(problem.motors.time_constants)
    return Rollout(time, q, v, thrusts[0] if lags else None, taken, ended)
