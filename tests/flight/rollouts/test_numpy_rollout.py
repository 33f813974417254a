"""Rollouts in NumPy: against the module's own steps, and against an accurate integration."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
from scipy.integrate import solve_ivp

from gibbs_codegen.runtime.rollouts import (
    DIVERGED,
    OUT_OF_BOUNDS,
    RUNNING,
    Method,
    MotorModel,
    Problem,
    numpy_rollout,
)

STATES, STEPS, DT = 4, 6, 0.02
ROTORS = 3


def problem_of(module: ModuleType, method: Method = "rk4") -> Problem:
    """Random states and inputs, another input for each state and step."""
    rng = np.random.default_rng(5)
    v = rng.uniform(-0.5, 0.5, (STATES, len(module.VELOCITIES)))
    q = rng.uniform(-0.5, 0.5, (STATES, len(module.COORDINATES)))
    inputs = rng.uniform(0.0, 4.0, (STATES, STEPS, len(module.INPUTS)))
    q = module.integrate(q, np.zeros_like(v))
    return Problem(module, None, q, v, inputs, STEPS, DT, method)


def motors_of(problem: Problem, *time_constants: float) -> MotorModel:
    """Motors that limit nothing."""
    some = np.linspace(1.0, 2.0, STATES * ROTORS).reshape(STATES, ROTORS)
    return MotorModel(
        np.full(problem.inputs.shape[-1], -np.inf),
        np.full(problem.inputs.shape[-1], np.inf),
        np.array([time_constants]),
        some,
    )


def test_every_second_step_is_kept(module: ModuleType) -> None:
    problem = problem_of(module)
    every, some = numpy_rollout(problem), numpy_rollout(replace(problem, every=2))
    np.testing.assert_array_equal(some.q, every.q[:, ::2])
    np.testing.assert_allclose(some.time, every.time[::2])


def test_thrusts_follow_their_commands_between_steps_too(module: ModuleType) -> None:
    """Against the whole system, thrusts among its states, integrated to rounding."""
    problem = problem_of(module)
    problem = replace(problem, steps=80, dt=DT / 40, inputs=problem.inputs[:, :1])
    lag = np.array([0.02, 0.05, 0.0])
    problem = replace(problem, motors=motors_of(problem, *lag))
    found = numpy_rollout(problem)
    q0, v0, thrusts0, u = (
        problem.q[1],
        problem.v[1],
        problem.motors.thrusts[1],
        problem.inputs[1, 0],
    )

    def rates(_: float, x: np.ndarray) -> np.ndarray:
        q, v, thrusts = np.split(x, [len(q0), len(q0) + len(v0)])
        acting = np.concatenate([[*thrusts[:2], u[2]], u[ROTORS:]])
        growth = (u[:ROTORS] - thrusts) / np.where(lag > 0.0, lag, 1.0)
        a = module.forward_dynamics(q, v, acting)
        return np.concatenate([module.coordinate_rates(q, v), a, growth])

    begin = np.concatenate([q0, v0, thrusts0])
    whole = solve_ivp(
        rates, (0.0, problem.steps * problem.dt), begin, "DOP853", rtol=1e-12, atol=1e-13
    )
    q, v, thrusts = np.split(whole.y[:, -1], [len(q0), len(q0) + len(v0)])
    np.testing.assert_allclose(found.thrusts[1, -1, :2], thrusts[:2], rtol=1e-9)
    np.testing.assert_allclose(found.thrusts[1, 1:, 2], u[2])
    np.testing.assert_allclose(found.q[1, -1], q, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(found.v[1, -1], v, rtol=1e-9, atol=1e-9)


def test_states_that_end_change_no_other(module: ModuleType) -> None:
    problem = problem_of(module)
    calm = numpy_rollout(problem)
    q, v = problem.q.copy(), problem.v.copy()
    v[1], v[2] = 1e200, 40.0
    size = q.shape[1] + v.shape[1]
    bounds = np.full((2, size), [[-np.inf], [np.inf]])
    bounds[:, q.shape[1] :] = [[-30.0], [30.0]]
    found = numpy_rollout(replace(problem, q=q, v=v, bounds=bounds))
    assert found.ended.tolist() == [RUNNING, DIVERGED, OUT_OF_BOUNDS, RUNNING]
    assert found.steps.tolist() == [STEPS, 0, 1, STEPS]
    for lane in (0, 3):
        np.testing.assert_array_equal(found.q[lane], calm.q[lane])
    np.testing.assert_array_equal(found.v[1], np.broadcast_to(v[1], found.v[1].shape))
    np.testing.assert_array_equal(
        found.v[2, 2:], np.broadcast_to(found.v[2, 1], found.v[2, 2:].shape)
    )
    assert np.abs(found.v[2, 1]).max() > 30.0
