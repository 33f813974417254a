"""A robot's numbers by the names of parameters, and robots with other numbers."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from support.random_robots import random_robot, robots

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.robot.file import read_robot, shipped_robots
from gibbs_codegen.robot.model import RigidBody, Robot
from gibbs_codegen.robot.rigid_body import inertia_fault
from gibbs_codegen.verification.parameters import parameter_values, varied


@pytest.mark.parametrize("name", shipped_robots())
def test_names_and_values_are_those_of_the_derivation(name: str) -> None:
    robot = read_robot(name)[0]
    assert derive(robot, keep_zeros=True).defaults == parameter_values(robot)


def test_names_and_values_of_arms_one_by_one_and_rigid_bodies() -> None:
    robot = random_robot(4, 3, 3)
    assert not robot.base.shares_one_arm
    assert derive(robot, keep_zeros=True).defaults == parameter_values(robot)


@settings(max_examples=30)
@given(robot=robots())
def test_varied_robots_are_robots_and_zeros_stay(robot: Robot) -> None:
    before, after = parameter_values(robot), parameter_values(varied(robot, 1))
    assert before.keys() == after.keys()
    for name, value in before.items():
        assert (after[name] == 0.0) == (value == 0.0), name
        assert value == 0.0 or 0.7 < after[name] / value < 1.3, name
    for link in varied(robot, 1).links:
        if isinstance(link.body, RigidBody):
            assert inertia_fault(link.body.mass, link.body.inertia) is None
