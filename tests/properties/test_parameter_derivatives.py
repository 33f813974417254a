"""Derivatives by parameters against complex steps through `prepare`; the regressor."""

from __future__ import annotations

import numpy as np
import pytest
from support.comparison import assert_close, states
from support.complex_step import Array, parameter_derivative
from support.derivative_oracle import DerivativeOracle
from support.emitted import module_with_derivatives
from support.random_robots import random_tree
from support.tree_cases import QUICK_TREES

TOLERANCE = 1e-12
NAMES = (
    *("inverse_dynamics_parameters", "forward_dynamics_parameters_vjp"),
    *("regressor", "base_parameters"),
)


@pytest.fixture(scope="module", params=QUICK_TREES[:1], ids=lambda value: value[1])
def tree(request: pytest.FixtureRequest):
    robot = random_tree(*request.param)
    return robot, module_with_derivatives(robot)


def first_state(robot, module) -> dict[str, Array]:
    rows = states(robot, module, 1)
    return {key: values[0] for key, values in zip("qvau", rows, strict=True)}


@pytest.mark.slow
def test_forces_by_parameters(tree) -> None:
    robot, module = tree
    at = first_state(robot, module)
    ours = module.inverse_dynamics_parameters(at["q"], at["v"], at["a"])
    (expected,) = parameter_derivative(module, "inverse_dynamics", at)
    assert_close("force_dp", ours, expected, TOLERANCE)


@pytest.mark.slow
def test_accelerations_by_parameters(tree) -> None:
    robot, module = tree
    at = first_state(robot, module)
    w = np.random.default_rng(5).normal(size=len(at["v"]))
    ours = module.forward_dynamics_parameters_vjp(at["q"], at["v"], at["u"], w)
    (expected,) = parameter_derivative(module, "forward_dynamics", at)
    assert_close("p_bar", ours, w @ expected, TOLERANCE)


@pytest.mark.slow
def test_regressor_times_base_parameters_is_inverse_dynamics(tree) -> None:
    """But for what acts in the joints by itself; no column depends on the others."""
    robot, module = tree
    oracle = DerivativeOracle(robot)
    q, v, a, _ = states(robot, module, 40)
    regressor, parameters = module.regressor(q, v, a), module.base_parameters()
    assert len(module.BASE_PARAMETERS) == len(parameters) == regressor.shape[-1]
    passive = [oracle.passive_terms(row) for row in q]
    own = [p.springs + p.damping * v[i] + p.armature * a[i] for i, p in enumerate(passive)]
    forces = module.inverse_dynamics(q, v, a) - np.array(own)
    assert_close("forces", regressor @ parameters, forces, TOLERANCE)
    columns = regressor.reshape(-1, len(parameters))
    assert np.linalg.matrix_rank(columns / np.linalg.norm(columns, axis=0)) == len(parameters)
