"""Rollouts in JAX: one compiled program that scans over steps, on the CPU or a GPU."""

from __future__ import annotations

import functools
from dataclasses import replace
from types import ModuleType
from typing import Any

import jax
import jax.numpy

from gibbs_codegen.flight.arguments import numpy_array
from gibbs_codegen.flight.rollouts.arguments import Controller, RolloutArguments
from gibbs_codegen.machine.rollout_steps import Parts
from gibbs_codegen.runtime import rollouts

jnp: Any = jax.numpy

# The fields with arrays; all else is fixed when XLA compiles.
_ARRAYS = {
    rollouts.Feedback: ["gain", "q", "v", "u", "x"],
    rollouts.MotorModel: ["least", "most", "time_constants", "thrusts"],
    rollouts.Problem: [
        *("constants", "q", "v", "inputs", "dt", "feedback", "motors", "wrenches", "bounds"),
        *("x", "bristles", "loads"),
    ],
    rollouts.Rollout: ["time", "q", "v", "thrusts", "steps", "ended", "x", "bristles"],
}
_FIXED = ["module", "steps", "method", "every", "precision", "around", "figures", "inner"]
for _kind, _names in _ARRAYS.items():
    jax.tree_util.register_dataclass(_kind, _names, _FIXED if _kind is rollouts.Problem else [])


def jax_arguments(module: ModuleType, steps: int) -> RolloutArguments:
    """The reader of a rollout's arguments as arrays of JAX, in the precision that JAX is set to."""
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
    rolled: rollouts.Rollout = _rollout(problem, controller, problem.parts)
    return rolled


@functools.partial(jax.jit, static_argnums=(1, 2))
def _rollout(
    problem: rollouts.Problem, controller: Controller | None, parts: Parts
) -> rollouts.Rollout:
    """The rollout of a problem with some parts."""
    (count, nq), every = problem.q.shape, problem.every

    def sample(carried: rollouts.Carried, first: Any) -> tuple[rollouts.Carried, Any]:
        piece, x = problem, carried[0]
        if controller is not None:
            q, v = x[:, :nq], x[:, nq : nq + problem.v.shape[1]]
            inputs = jnp.asarray(controller(first * problem.dt, q, v))
            wide = jnp.broadcast_to(inputs, (count, inputs.shape[-1]))
            piece = replace(problem, inputs=wide[:, None])
        steps = rollouts.Steps(piece, jnp, parts)

        def step(carried: rollouts.Carried, number: Any) -> tuple[rollouts.Carried, None]:
            return steps.after(number, carried), None

        carried, _ = jax.lax.scan(step, carried, first + jnp.arange(every))
        return carried, carried[0]

    steps = rollouts.Steps(problem, jnp, parts)
    begin = steps.begin()
    (_, taken, ended), after = jax.lax.scan(sample, begin, jnp.arange(0, problem.steps, every))
    samples = jnp.concatenate([begin[0][:, None], jnp.moveaxis(after, 0, 1)], axis=1)
    return steps.rollout(samples, taken, ended)
