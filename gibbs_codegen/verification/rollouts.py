"""Rollouts in C, compared with those in NumPy by functions of the NumPy module.

Their C source calls functions of the module, which are compared by themselves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import ModuleType

import numpy as np

from gibbs_codegen.interface import LANES
from gibbs_codegen.robot.model import Robot
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
from gibbs_codegen.verification.invariants import conditions
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array

ROLLOUTS = "rollouts"
# Blocks that are full in either precision, and one that is not.
_STATES, _STEPS = 2 * LANES + 4, 6
# Out of so many times as many.
_DRAWN = 10
# A step, as a share of that which is short beside the time in which velocities change.
_LONG = 5.0
_METHODS: tuple[Method, ...] = ("rk4", "euler")
_ROUNDINGS = 100.0


def compare_rollouts(
    numpy: ModuleType, robot: Robot, seed: int, precision: Precision, flags: tuple[str, ...] = ()
) -> list[Comparison]:
    """Compare short rollouts in C with the same in NumPy: of all kinds, by both methods.

    `flags` are the compiler's, after its own. Fails where nothing comes out.
    """
    against = f"NumPy, in {precision} precision"
    try:
        rows = [*_compared(against, numpy, Tree(robot), seed, precision, flags)]
    except Exception as error:  # Whatever was done to the module.
        return [failed(ROLLOUTS, against, error)]
    return [replace(row, states=_STATES) for row in merged(rows)]


def _compared(
    against: str,
    numpy: ModuleType,
    tree: Tree,
    seed: int,
    precision: Precision,
    flags: tuple[str, ...],
) -> Iterator[Comparison]:
    """A comparison of each array that comes out of each rollout."""
    states, dt = _natural(numpy, tree, States.random(tree, _DRAWN * _STATES, (seed, 7)))
    # Accelerations lose the digits of the mass matrix's condition number, and a few more.
    condition = float(conditions(numpy.mass_matrix(states.q)).max())
    limit = _ROUNDINGS * float(np.finfo(REALS[precision]).eps) * condition
    for problem in _problems(numpy, tree, states, dt):
        ours = compiled_rollout(replace(problem, precision=precision), flags=flags)
        theirs = plain_rollout(problem)
        for name in ("q", "v", "thrusts", "steps", "ended"):
            expected = getattr(theirs, name)
            if expected is None:
                continue
            size = np.abs(expected).max(axis=tuple(range(min(expected.ndim, 2))))
            yield compared(ROLLOUTS, against, getattr(ours, name), expected, size, limit)


def _problems(numpy: ModuleType, tree: Tree, states: States, dt: float) -> Iterator[Problem]:
    """All that a rollout may have by each method, some of it, and nothing but inputs."""
    rng = np.random.default_rng(0)
    shape = _STATES, _STEPS
    varied = {n: x * rng.uniform(0.99, 1.01, _STATES) for n, x in numpy.PARAMETERS.items()}
    inputs = states.u[:, None] * rng.uniform(0.5, 1.5, (*shape, 1))
    wrenches = states.W[:, None] * rng.uniform(0.5, 1.5, (*shape, 1, 1))
    plain = Problem(numpy, None, states.q, states.v, inputs, _STEPS, dt)
    # Efforts of about those of the inputs for errors of about the states' size.
    most = np.abs(states.u).max(axis=0)
    sizes = np.concatenate([tree.scales[tree.free], np.abs(states.v).max(axis=0)])
    gain = rng.uniform(-0.5, 0.5, (len(most), len(sizes))) * most[:, None] / sizes
    desired_q = np.repeat(states.q[::-1, None], _STEPS, axis=1)
    desired_v = states.v[::-1, None] * rng.uniform(0.5, 1.5, (*shape, 1))
    rotors = len(tree.motors)
    lags = np.arange(rotors) % 2 * dt * rng.uniform(0.5, 5.0, (_STATES, rotors))
    motors = Motors(-0.4 * most, 0.6 * most, lags, states.u[::-1, :rotors])
    whole = replace(
        plain,
        constants=numpy.prepare(varied),
        every=2,
        feedback=Feedback(gain, desired_q, desired_v),
        motors=motors,
        wrenches=wrenches,
    )
    whole = replace(whole, bounds=_bounds(whole))
    some = replace(
        plain,
        feedback=Feedback(gain, desired_q[:, :1], desired_v[:1]),
        motors=replace(motors, time_constants=0.0 * lags),
        wrenches=wrenches[:, :1],
    )
    lost = inputs.copy()
    lost[1, 2] = np.inf
    for method in _METHODS:
        yield replace(whole, method=method)
        yield replace(some, method=method, inputs=inputs[:, :1])
        yield replace(plain, method=method, inputs=lost)


def _natural(numpy: ModuleType, tree: Tree, states: States) -> tuple[States, float]:
    """The best conditioned of states, with forces that suit them, and a step's length.

    However light a link is, its accelerations are natural: it gets the efforts of random ones, and
    small wrenches.
    """
    fittest = np.argsort(conditions(numpy.mass_matrix(states.q)))[:_STATES]
    states = States(*(x[fittest] for x in vars(states).values()))
    q, v, u, rotors = states.q, states.v, states.u.copy(), len(tree.motors)
    u[:, rotors:] = 0.0
    falling = replace(states, a=numpy.forward_dynamics(q, v, u))
    u[:, rotors:] = numpy.inverse_dynamics(q, v, states.a)[:, tree.layout.v.joints]
    moved = numpy.forward_dynamics(q, v, u)
    pushed = numpy.forward_dynamics_with_wrenches(q, v, u, states.W) - moved
    with np.errstate(all="ignore"):
        share = np.abs(pushed).max(axis=0) / np.abs(moved).max(axis=0)
    states = replace(states, u=u, W=states.W / np.nanmax(share, initial=1.0))
    return states, _LONG * float(falling.h.min())


def _bounds(problem: Problem) -> Array:
    """Bounds (2, nq + nv) beyond which some states go in each entry."""
    free = plain_rollout(replace(problem, every=1))
    entries = np.concatenate([free.q, free.v], axis=-1)
    return np.array([-_exceeded(-entries.min(axis=1)), _exceeded(entries.max(axis=1))])


def _exceeded(values: Array) -> Array:
    """What few of the values (n, …) exceed, and none by rounding alone, (…)."""
    largest = np.sort(values, axis=0)[-6:]
    widest = np.diff(largest, axis=0).argmax(axis=0)
    between: Array = np.choose(widest, 0.5 * (largest[1:] + largest[:-1]))
    return between
