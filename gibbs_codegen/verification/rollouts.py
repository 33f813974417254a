"""Rollouts in C, compared with those in NumPy by functions of the NumPy module.

Their C source calls functions of the module, which are compared by themselves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import ModuleType
from typing import get_args

import numpy as np

from gibbs_codegen.interface import LANES
from gibbs_codegen.runtime.rollouts import (
    REALS,
    Feedback,
    Method,
    Motors,
    Precision,
    Problem,
    compiled_rollout,
    plain_rollout,
)
from gibbs_codegen.verification.comparison import Comparison, compared, failed, merged
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array

ROLLOUTS = "rollouts"
# Blocks that are full in either precision, and one that is not. For each state so many are drawn,
# of which the best conditioned are taken.
_STATES, _DRAWN = 2 * LANES + 4, 10
# Steps are longer by so much than those that are short beside the time in which velocities change.
_STEPS, _LONG = 6, 5.0
_ROUNDINGS = 20.0
# The largest limit: a greater one would let faults pass.
_LARGEST = 1e-2


def compare_rollouts(
    numpy: ModuleType, tree: Tree, seed: int, precision: Precision, flags: tuple[str, ...]
) -> tuple[list[Comparison], dict[str, str]]:
    """Compare short rollouts in C with the same in NumPy: the worst of all, or a failure.

    The other result says what is not compared, and why.

    `flags` are the compiler's, after its own.
    """
    against = f"NumPy, in {precision} precision"
    rows = []
    try:
        states = States.random(tree, _DRAWN * _STATES, (seed, 7))
        sizes = Sizes(tree, states)
        conditions = np.linalg.cond(numpy.mass_matrix(states.q) / sizes.free_matrix)
        fittest = np.argsort(conditions)[:_STATES]
        # What accelerations lose of their digits, by the mass matrix or beside a large robot.
        lost = max(float(conditions[fittest[-1]]), sizes.disparity)
        limit = _ROUNDINGS * float(np.finfo(REALS[precision]).eps) * lost
        if limit > _LARGEST:
            return [], {f"{ROLLOUTS} in {precision} precision": "rounding leaves too few digits"}
        states, dt = _suited(numpy, States(*(x[fittest] for x in vars(states).values())))
        for problem in _problems(numpy, tree, states, dt):
            ours = compiled_rollout(replace(problem, precision=precision), flags=flags)
            for name, theirs in vars(plain_rollout(problem)).items():
                if theirs is not None:
                    size = np.abs(theirs).max(axis=tuple(range(theirs.ndim))[:2])
                    found = getattr(ours, name)
                    rows.append(compared(ROLLOUTS, against, found, theirs, size, limit))
    except Exception as error:  # Whatever was done to the module.
        rows = [failed(ROLLOUTS, against, error)]
    return [replace(row, states=_STATES) for row in merged(rows)], {}


def _suited(numpy: ModuleType, states: States) -> tuple[States, float]:
    """States whose inputs and wrenches are each too small for more than natural accelerations.

    And the length of a step.
    """
    q, v, natural = states.q, states.v, np.abs(states.a).max(axis=0)
    efforts = states.u.copy(), states.W.copy()
    falling = numpy.forward_dynamics(q, v, 0.0 * states.u)
    for kind, of_kind in enumerate(efforts):
        for k in range(of_kind.shape[1]):
            alone = [np.zeros_like(x) for x in efforts]
            alone[kind][:, k] = of_kind[:, k]
            driven = numpy.forward_dynamics_with_wrenches(q, v, *alone) - falling
            of_kind[:, k] /= (np.abs(driven).max(axis=0) / natural).max(initial=1.0)
    states = replace(states, a=falling, u=efforts[0], W=efforts[1])
    return states, _LONG * float(states.h.min())


def _problems(numpy: ModuleType, tree: Tree, states: States, dt: float) -> Iterator[Problem]:
    """By each method nothing but inputs, some of what a rollout may have, and all of it."""
    rng, rotors = np.random.default_rng(0), len(tree.motors)
    by_step = rng.uniform(0.5, 1.5, (_STATES, _STEPS, 1))
    inputs, wrenches = states.u[:, None] * by_step, states.W[:, None] * by_step[..., None]
    plain = Problem(numpy, None, states.q, states.v, inputs.copy(), _STEPS, dt)
    plain.inputs[1, 2] = np.inf  # A state is lost, unless the robot has no inputs.
    # Efforts of about those of the inputs for errors of about the states' size.
    most = np.abs(states.u).max(axis=0)
    sizes = np.concatenate([tree.scales[tree.free], np.abs(states.v).max(axis=0)])
    gain = rng.uniform(-0.5, 0.5, (len(most), len(sizes))) * most[:, None] / sizes
    q, v = states.q[::-1, None], states.v[::-1, None]
    lags = (np.arange(rotors) + 1) % 2 * dt * rng.uniform(0.5, 5.0, (_STATES, rotors))
    motors = Motors(-0.4 * most, 0.6 * most, 0.0 * lags, states.u[::-1, :rotors])
    some = replace(plain, inputs=inputs[:, :1], motors=motors, wrenches=wrenches[:, :1])
    some = replace(some, feedback=Feedback(gain, q, v[:1]))
    varied = {n: x * rng.uniform(0.99, 1.01, _STATES) for n, x in numpy.PARAMETERS.items()}
    lagging = replace(motors, time_constants=lags)
    whole = replace(some, inputs=inputs, wrenches=wrenches, motors=lagging, every=2)
    desired = Feedback(gain, np.repeat(q, _STEPS, axis=1), v * by_step)
    whole = replace(whole, constants=numpy.prepare(varied), feedback=desired)
    for method in get_args(Method):
        for problem in plain, some, replace(whole, bounds=_bounds(whole)):
            yield replace(problem, method=method)


def _bounds(problem: Problem) -> Array:
    """Bounds (2, nq + nv) that one or two states exceed in some entries, none by rounding alone."""
    free = plain_rollout(replace(problem, every=1))
    entries = np.concatenate([free.q, free.v], axis=-1)
    largest = np.sort([-entries.min(axis=1), entries.max(axis=1)], axis=1)[:, -3:]
    widest = np.diff(largest, axis=1).argmax(axis=1)[:, None]
    between = np.take_along_axis(0.5 * (largest[:, 1:] + largest[:, :-1]), widest, axis=1)
    bounds = np.where(np.arange(between.shape[2]) % 4 == [[0], [2]], between[:, 0], np.inf)
    return np.array([-bounds[0], bounds[1]])
