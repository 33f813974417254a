"""Rollouts in JAX: one compiled program that scans over steps, on the CPU or a GPU."""

from __future__ import annotations

import functools
from dataclasses import replace
from types import ModuleType
from typing import Any

import jax
import jax.numpy

from gibbs_codegen.flight.rollouts.arguments import Controller, Given, numpy_array
from gibbs_codegen.runtime.rollouts import (
    DIVERGED,
    OUT_OF_BOUNDS,
    RUNNING,
    Feedback,
    Motors,
    Problem,
    Rollout,
    State,
    Steps,
)

jnp: Any = jax.numpy

# States, how many steps each has taken, and why each has ended.
_Carried = tuple[State, Any, Any]
# What arrays are in; all else is fixed when XLA compiles.
_ARRAYS = {
    Feedback: ["gain", "q", "v", "u"],
    Motors: ["least", "most", "time_constants", "thrusts"],
    Problem: [
        *("constants", "q", "v", "inputs", "dt", "feedback", "motors", "wrenches", "bounds"),
    ],
    Rollout: ["time", "q", "v", "thrusts", "steps", "ended"],
}
_FIXED = ["module", "steps", "method", "every", "precision"]
for _kind, _names in _ARRAYS.items():
    jax.tree_util.register_dataclass(_kind, _names, _FIXED if _kind is Problem else [])


def given_to_jax(module: ModuleType, steps: int) -> Given:
    """What reads arguments of a rollout as arrays of JAX, in the precision that it is set to."""
    return Given(module, steps, jnp, _array)


def _array(name: str, value: Any) -> Any:
    """Real numbers, or what JAX traces, as an array of JAX.

    Raises `UsageError`, which says `name`.
    """
    array = value if isinstance(value, jax.Array) else numpy_array(name, value)
    return jnp.asarray(array, jnp.result_type(float))


def traced_rollout(problem: Problem, controller: Controller | None) -> Rollout:
    """Roll states out in JAX's arrays, and so that JAX can differentiate what comes out.

    The module's back end is "jax"; `controller` is as of `asked_rollout`, of what JAX traces, None
    where inputs are known.
    """
    rolled: Rollout = _rolled(problem, controller)
    return rolled if _lags(problem.motors) else replace(rolled, thrusts=None)


def _lags(motors: Motors | None) -> bool:
    """Whether motors lag, or may do so, since their time constants are traced."""
    if motors is None or isinstance(motors.time_constants, jax.core.Tracer):
        return motors is not None
    return bool(jnp.any(motors.time_constants))


@functools.partial(jax.jit, static_argnums=1)
def _rolled(problem: Problem, controller: Controller | None) -> Rollout:
    """What comes out, with thrusts where there are motors."""
    count, every = len(problem.q), problem.every

    def sample(carried: _Carried, first: Any) -> tuple[_Carried, State]:
        held = problem
        if controller is not None:
            inputs = jnp.asarray(controller(first * problem.dt, *carried[0][:2]))
            wide = jnp.broadcast_to(inputs, (count, inputs.shape[-1]))
            held = replace(problem, inputs=wide[:, None])
        step = functools.partial(_step, Steps(held, jnp))
        carried, _ = jax.lax.scan(step, carried, first + jnp.arange(every))
        return carried, carried[0]

    begin, none = Steps(problem, jnp).begin(), jnp.zeros(count, int)
    start = begin, none, jnp.full(count, RUNNING, jnp.int8)
    firsts = jnp.arange(0, problem.steps, every)
    (_, taken, ended), after = jax.lax.scan(sample, start, firsts)
    q, v, *thrusts = (
        jnp.concatenate([first[:, None], jnp.moveaxis(rest, 0, 1)], axis=1)
        for first, rest in zip(begin, after, strict=True)
    )
    time = problem.dt * every * jnp.arange(len(firsts) + 1)
    return Rollout(time, q, v, thrusts[0] if thrusts else None, taken, ended)


def _step(steps: Steps, carried: _Carried, number: Any) -> tuple[_Carried, None]:
    """One step of states, numbers of steps taken, and why states ended, as `lax.scan` wants it."""
    state, taken, ended = carried
    after = steps.after(number, *state)
    finite = jnp.isfinite(jnp.concatenate(after, axis=1)).all(axis=1)
    ended = jnp.where((ended == RUNNING) & ~finite, jnp.int8(DIVERGED), ended)
    going = ended == RUNNING
    state = tuple(jnp.where(going[:, None], a, b) for a, b in zip(after, state, strict=True))
    ended = jnp.where(going & steps.beyond(*state[:2]), jnp.int8(OUT_OF_BOUNDS), ended)
    return (state, taken + going, ended), None
