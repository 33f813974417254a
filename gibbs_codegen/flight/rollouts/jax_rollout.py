"""Rollouts in JAX: one compiled program that scans over steps, on the CPU or a GPU."""

from __future__ import annotations

import functools
from dataclasses import replace
from types import ModuleType
from typing import Any

import jax
import jax.numpy

from gibbs_codegen.flight.rollouts.arguments import Controller, RolloutArguments, numpy_array
from gibbs_codegen.runtime import rollouts

jnp: Any = jax.numpy

# States, how many steps each has taken, and why each has ended.
_Carried = tuple[rollouts.State, Any, Any]
# What arrays are in; all else is fixed when XLA compiles.
_ARRAYS = {
    rollouts.Feedback: ["gain", "q", "v", "u"],
    rollouts.Motors: ["least", "most", "time_constants", "thrusts"],
    rollouts.Problem: [
        *("constants", "q", "v", "inputs", "dt", "feedback", "motors", "wrenches", "bounds"),
    ],
    rollouts.Rollout: ["time", "q", "v", "thrusts", "steps", "ended"],
}
_FIXED = ["module", "steps", "method", "every", "precision"]
for _kind, _names in _ARRAYS.items():
    jax.tree_util.register_dataclass(_kind, _names, _FIXED if _kind is rollouts.Problem else [])


def jax_arguments(module: ModuleType, steps: int) -> RolloutArguments:
    """What reads arguments of a rollout as arrays of JAX, in the precision that it is set to."""
    return RolloutArguments(module, steps, jnp, _array)


def _array(name: str, value: Any) -> Any:
    """Real numbers, or what JAX traces, as an array of JAX.

    Raises `UsageError`, which says `name`.
    """
    array = value if isinstance(value, jax.Array) else numpy_array(name, value)
    return jnp.asarray(array, jnp.result_type(float))


def jax_rollout(problem: rollouts.Problem, controller: Controller | None) -> rollouts.Rollout:
    """Roll states out in JAX's arrays, and so that JAX can differentiate what comes out.

    The module's back end is "jax"; `controller` is as of `callback_rollout`, of what JAX traces,
    None where inputs are known.
    """
    found: rollouts.Rollout = _rollout(problem, controller)
    motors = problem.motors
    # Motors whose time constants are traced may lag.
    lags = motors is not None and (
        isinstance(motors.time_constants, jax.core.Tracer) or bool(jnp.any(motors.time_constants))
    )
    return found if lags else replace(found, thrusts=None)


@functools.partial(jax.jit, static_argnums=1)
def _rollout(problem: rollouts.Problem, controller: Controller | None) -> rollouts.Rollout:
    """What comes out, with thrusts where there are motors."""
    count, every = len(problem.q), problem.every

    def sample(carried: _Carried, first: Any) -> tuple[_Carried, rollouts.State]:
        piece = problem
        if controller is not None:
            inputs = jnp.asarray(controller(first * problem.dt, *carried[0][:2]))
            wide = jnp.broadcast_to(inputs, (count, inputs.shape[-1]))
            piece = replace(problem, inputs=wide[:, None])
        step = functools.partial(_step, rollouts.Steps(piece, jnp))
        carried, _ = jax.lax.scan(step, carried, first + jnp.arange(every))
        return carried, carried[0]

    begin, none = rollouts.Steps(problem, jnp).begin(), jnp.zeros(count, int)
    start = begin, none, jnp.full(count, rollouts.RUNNING, jnp.int8)
    firsts = jnp.arange(0, problem.steps, every)
    (_, taken, ended), after = jax.lax.scan(sample, start, firsts)
    q, v, *thrusts = (
        jnp.concatenate([first[:, None], jnp.moveaxis(rest, 0, 1)], axis=1)
        for first, rest in zip(begin, after, strict=True)
    )
    time = problem.dt * every * jnp.arange(len(firsts) + 1)
    return rollouts.Rollout(time, q, v, thrusts[0] if thrusts else None, taken, ended)


def _step(steps: rollouts.Steps, carried: _Carried, number: Any) -> tuple[_Carried, None]:
    """One step of states, numbers of steps taken, and why states ended, as `lax.scan` wants it."""
    state, taken, ended = carried
    after = steps.after(number, *state)
    finite = jnp.isfinite(jnp.concatenate(after, axis=1)).all(axis=1)
    ended = jnp.where((ended == rollouts.RUNNING) & ~finite, jnp.int8(rollouts.DIVERGED), ended)
    going = ended == rollouts.RUNNING
    state = tuple(jnp.where(going[:, None], a, b) for a, b in zip(after, state, strict=True))
    ended = jnp.where(going & steps.beyond(*state[:2]), jnp.int8(rollouts.OUT_OF_BOUNDS), ended)
    return (state, taken + going, ended), None
