"""Derivatives of the dynamics against Pinocchio's, on random trees of every structure."""

from __future__ import annotations

import numpy as np
import pytest
from support.comparison import assert_close, states
from support.derivative_oracle import Array, DerivativeOracle
from support.emitted import module_with_derivatives
from support.random_robots import random_tree
from support.tree_cases import QUICK_TREES

from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.robot.model import Robot

TOLERANCE = 1e-11
# Up to this condition number of the mass matrix, accelerations keep the digits that are compared.
CONDITION = 1e4
ARGUMENTS = {
    "inverse_dynamics_derivatives": "qva",
    "forward_dynamics_derivatives": "qvu",
    "coriolis_matrix": "qv",
}


def compare_derivatives(robot: Robot, count: int = 2) -> None:
    """Functions of ARGUMENTS, evaluated as a batch, against the oracle state by state."""
    oracle, module = DerivativeOracle(robot), module_with_derivatives(robot)
    at = dict(zip("qvau", states(robot, module, count), strict=True))
    for name, letters in ARGUMENTS.items():
        ours = getattr(module, name)(*(at[letter] for letter in letters))
        for i in range(count):
            assert np.linalg.cond(oracle.mass_matrix(at["q"][i])) < CONDITION
            theirs = getattr(oracle, name)(*(at[letter][i] for letter in letters))
            _compare_outputs(name, ours, theirs, i)


def _compare_outputs(name: str, ours: tuple[Array, ...] | Array, theirs: tuple, i: int) -> None:
    """State i of a batch against the oracle, output by output."""
    outputs = FUNCTIONS[name].outputs
    batches = ours if isinstance(ours, tuple) else (ours,)
    for output, batch, expected in zip(outputs, batches, theirs, strict=True):
        assert_close(f"{output.name} of {name}", batch[i], expected, TOLERANCE)


@pytest.mark.slow
def test_random_trees() -> None:
    compare_derivatives(random_tree(*QUICK_TREES[1]))


@pytest.mark.slow
def test_derivatives_of_integrate() -> None:
    """For displacements small and large; Pinocchio's own are less exact from 1e-6 to 1e-2 rad.

    Those sizes are held against series of sixty digits in `test_time_steps`.
    """
    robot = random_tree(*QUICK_TREES[0])
    module, oracle = module_with_derivatives(robot), DerivativeOracle(robot)
    q, v, _, _ = (rows[0] for rows in states(robot, module, 1))
    for size in (0.0, 1e-160, 1e-9, 0.1, 1.0, 3.0):
        ours = [one[None] for one in module.integrate_derivatives(q, size * v)]
        theirs = oracle.integrate_derivatives(q, size * v)
        _compare_outputs("integrate_derivatives", tuple(ours), theirs, 0)


# Other robots that ship have cond(M) above 1e4, where rounding alone is more than the limit;
# complex steps hold their derivatives (`tests/derivation`).
