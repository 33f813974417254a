"""Derivatives by the parameters against complex steps through `prepare`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from support.comparison import states
from support.complex_step import parameter_derivative
from support.emitted import module_of
from support.random_robots import random_robot, random_tree

from benchmarks.family import benchmark_robot
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.nodes import count_operations
from gibbs_codegen.robot.model import Robot

FUNCTIONS = ("inverse_dynamics_parameters", "forward_dynamics_parameters_vjp")
ROBOTS = [
    random_tree(6, "tait_bryan"),
    random_tree(9, "quaternion"),
    *(
        pytest.param(robot, marks=pytest.mark.slow)
        for robot in (random_robot(0, 2, 0), random_robot(2, 5, 2), benchmark_robot(3))
    ),
]


def assert_alike(found: np.ndarray, expected: np.ndarray, parameters: Sequence[str]) -> None:
    """Agreement of each parameter's derivatives, to their size."""
    for name, ours, theirs in zip(parameters, found.T, expected.T, strict=True):
        error, size = np.abs(ours - theirs).max(), np.abs(theirs).max()
        assert error <= 1e-10 * size + 1e-13 * np.abs(expected).max(), (name, error, size)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS[:1], ids=lambda r: f"{r.name}-{r.base.attitude}")
def test_derivatives_by_the_parameters(robot: Robot) -> None:
    functions = ("forward_dynamics", "inverse_dynamics", "mass_matrix")
    module = module_of(derive(robot, functions=functions, derivatives=FUNCTIONS))
    assert [*module.PARAMETERS] == [*derive(robot, functions=functions).defaults]
    q, v, a, u = (x[0] for x in states(robot, module, 1))
    w = np.random.default_rng(1).normal(size=len(v))
    (expected,) = parameter_derivative(module, "inverse_dynamics", {"q": q, "v": v, "a": a})
    found = module.inverse_dynamics_parameters(q, v, a)
    assert_alike(found, expected, [*module.PARAMETERS])
    (expected,) = parameter_derivative(module, "forward_dynamics", {"q": q, "v": v, "u": u})
    gradient = module.forward_dynamics_parameters_vjp(q, v, u, w)
    assert_alike(gradient[None], w[None] @ expected, [*module.PARAMETERS])


@pytest.mark.slow
@pytest.mark.parametrize(("links", "reached"), [(3, (570, 760))])
def test_operations_are_as_few_as_they_were(links: int, reached: tuple[int, int]) -> None:
    """Nor are there many more constants. Signs depend a little on what else has been derived."""
    robot = benchmark_robot(links)
    program, without = derive(robot, derivatives=FUNCTIONS).program, derive(robot).program
    found = [count_operations(program.function(name).nodes()).total for name in FUNCTIONS]
    assert np.all(np.array(found) <= reached)
    assert len(program.prepare) < 1.5 * len(without.prepare)
