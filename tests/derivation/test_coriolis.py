"""The Coriolis matrix: Pinocchio's, whose product with v is the velocity terms, Ṁ − 2C skew."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from support.comparison import assert_close, states
from support.complex_step import along
from support.emitted import module_of
from support.pinocchio_oracle import Oracle
from support.random_robots import random_robot, random_tree

from benchmarks.family import benchmark_robot
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.nodes import count_operations
from gibbs_codegen.robot.model import Robot

ROBOTS = [
    random_tree(9, "tait_bryan"),
    random_tree(6, "quaternion"),
    *(
        pytest.param(robot, marks=pytest.mark.slow)
        for robot in (
            random_robot(0, 2, 0),
            random_robot(2, 5, 2),
            random_tree(6, "tait_bryan"),
            random_tree(9, "quaternion"),
            random_tree(11, "tait_bryan"),
            benchmark_robot(3, attitude="quaternion"),
        )
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS[:1], ids=lambda r: f"{r.name}-{r.base.attitude}")
def test_the_coriolis_matrix(robot: Robot) -> None:
    functions = ("coordinate_rates", "mass_matrix", "residual")
    module = module_of(derive(robot, functions=functions, derivatives=["coriolis_matrix"]))
    oracle = Oracle(robot, rigid_base=True)
    undamped = {name: 0.0 for name in module.PARAMETERS if name.endswith("_damping")}
    constants = module.prepare(undamped)
    for q, v, _, _ in zip(*states(robot, module, 3), strict=True):
        found = module.coriolis_matrix(q, v)
        theirs = pin.computeCoriolisMatrix(
            oracle.model, oracle.data, oracle.configuration(q), oracle.spread(v)
        )
        assert_close("C", found, theirs[np.ix_(oracle.order, oracle.order)])
        terms = module.residual(q, 0.0 * v, constants) - module.residual(q, v, constants)
        np.testing.assert_allclose(found @ v, terms, rtol=0, atol=1e-11 * np.abs(terms).max())
        rate = along(module, "mass_matrix", {"q": q}, {"q": v[None]})[0][0]
        skew = rate - 2.0 * found
        np.testing.assert_allclose(skew, -skew.T, rtol=0, atol=1e-11 * np.abs(rate).max())


@pytest.mark.slow
def test_operations_are_as_few_as_they_were() -> None:
    robot = benchmark_robot(3, attitude="quaternion")
    program = derive(robot, derivatives=["coriolis_matrix"]).program
    assert count_operations(program.function("coriolis_matrix").nodes()).total == 359
