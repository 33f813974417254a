"""The regressor and the base parameters: linear, minimal, and those of Pinocchio's regressor."""

from __future__ import annotations

from functools import cache
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest
from support.comparison import states
from support.emitted import module_of
from support.pinocchio_oracle import Oracle
from support.random_robots import random_robot, random_tree

from benchmarks.family import benchmark_robot
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.nodes import count_operations
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.model import Robot

NAMES = ("regressor", "base_parameters")
PASSIVE = ("_damping", "_armature", "_stiffness")
STATES = 40
# Slides and hinges, both attitudes and both origins, trees, links that are held, and no links.
ROBOTS = [
    random_robot(2, 5, 2),
    random_tree(9, "tait_bryan"),
    random_tree(6, "quaternion"),
    *(
        pytest.param(robot, marks=pytest.mark.slow)
        for robot in (
            random_robot(0, 2, 0),
            random_tree(6, "tait_bryan"),
            random_tree(11, "quaternion"),
            benchmark_robot(3),
        )
    ),
]


@pytest.fixture(params=ROBOTS[:1], ids=lambda robot: f"{robot.name}-{robot.base.attitude}")
def robot(request: pytest.FixtureRequest) -> Robot:
    return request.param


@cache
def emitted(robot: Robot) -> ModuleType:
    """The module with both functions."""
    return module_of(derive(robot, functions=("inverse_dynamics",), derivatives=NAMES))


def independent(matrix: np.ndarray) -> int:
    """How many columns no others combine to."""
    sizes = np.linalg.norm(matrix, axis=0)
    values = np.linalg.svd(matrix[:, sizes > 0.0] / sizes[sizes > 0.0], compute_uv=False)
    return int((values > 1e-10 * values[0]).sum())


def pinocchio_regressor(oracle: Oracle, *state: np.ndarray) -> np.ndarray:
    """Pinocchio's regressor by the ten numbers of the base and of each link on a joint."""
    q, v, a = state
    every = pin.computeJointTorqueRegressor(
        oracle.model,
        oracle.data,
        oracle.configuration(q),
        oracle.spread(v),
        oracle.spread(a),
    )
    joints = sorted({joint for joint, _ in oracle.bodies.values()})
    columns = [10 * (joint - 1) + number for joint in joints for number in range(10)]
    return every[np.ix_(oracle.order, columns)]


@pytest.mark.slow
def test_it_is_inverse_dynamics_and_no_parameter_is_superfluous(robot: Robot) -> None:
    """Its columns span what Pinocchio's ten numbers of each body span, and are independent."""
    module, oracle = emitted(robot), Oracle(robot, rigid_base=True)
    state = states(robot, module, STATES)[:3]
    found, numbers = module.regressor(*state), module.base_parameters()
    assert found.shape == (STATES, len(module.VELOCITIES), len(module.BASE_PARAMETERS))
    assert numbers.shape == (len(module.BASE_PARAMETERS),)
    passive = {name: 0.0 for name in module.PARAMETERS if name.endswith(PASSIVE)}
    forces = module.inverse_dynamics(*state, module.prepare(passive))
    np.testing.assert_allclose(found @ numbers, forces, rtol=0, atol=1e-12 * np.abs(forces).max())
    theirs = np.array([pinocchio_regressor(oracle, *(x[i] for x in state)) for i in range(STATES)])
    ours, theirs = (x.reshape(-1, x.shape[-1]) for x in (found, theirs))
    size = len(module.BASE_PARAMETERS)
    assert (
        independent(ours) == independent(theirs) == independent(np.hstack([ours, theirs])) == size
    )


def test_a_body_that_turns_has_seven_and_one_that_slides_four() -> None:
    robot = random_tree(9, "tait_bryan")
    joints = [robot.links[i - 1].joint for i in robot.moving]
    assert {*joints} == {"revolute", "prismatic"}
    listed = [entry.name for entry in Description(robot).base_parameters]
    assert len({*listed}) == len(listed) == 10 + sum(7 if j == "revolute" else 4 for j in joints)


@pytest.mark.slow
def test_operations_are_as_few_as_they_were() -> None:
    """Signs and shared pairs depend a little on what else has been derived."""
    program = derive(benchmark_robot(3), derivatives=["regressor"]).program
    assert count_operations(program.function("regressor").nodes()).total <= 716
