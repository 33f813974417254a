"""Every emitted function against Pinocchio, on random robots of every structure.

The oracle's tree is built from the robot's data alone and shares no code with the derivation; its
constrained joints are real joints.
"""

from __future__ import annotations

import pytest
from support.comparison import compare
from support.emitted import emitted_module, module_with_derivatives
from support.random_robots import random_robot, random_tree
from support.tree_cases import QUICK_TREES

from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import read_robot


@pytest.mark.slow
def test_random_robots() -> None:
    """Of few and many rotors, and of no links and several."""
    for number in (0, 18, 37, 50):
        robot = random_robot(number, 2 + number % 11, number // 11 % 9)
        try:
            compare(robot, emitted_module(robot))
        except AssertionError as error:
            raise AssertionError(f"random robot {number}: {error}\n{robot}") from None


def test_quick_trees_have_every_structure() -> None:
    robots = [random_tree(*case) for case in QUICK_TREES]
    assert len({robot.base.attitude == "quaternion" for robot in robots}) == 2
    links = [link for robot in robots for link in robot.links]
    assert {link.joint for link in links} == {"revolute", "prismatic", "fixed"}
    assert {link.constrained for link in links if not link.moves} == {True, False}
    assert {link.pose is None for link in links} == {True, False}
    assert any(link.passive.stiffness for link in links)
    assert all(len(set(robot.parents)) < len(robot.links) for robot in robots)
    assert any(rotor.on for robot in robots for rotor in robot.thrusters)


@pytest.mark.slow
def test_random_trees() -> None:
    robot = random_tree(*QUICK_TREES[1])
    compare(robot, module_with_derivatives(robot))


@pytest.mark.parametrize(
    "name",
    [pytest.param("decarotor_3link", marks=pytest.mark.slow), "hexarotor_3link", "quadrotor"],
)
def test_shipped_robots(name: str, shipped) -> None:
    compare(read_robot(name)[0], shipped(name), count=20)


@pytest.mark.slow
def test_family() -> None:
    robot = paper_family(2, 0)
    compare(robot, emitted_module(robot))


@pytest.mark.slow
def test_keeping_zero_parameters_changes_nothing() -> None:
    robot = paper_family(3, 1)
    compare(robot, emitted_module(robot, keep_zeros=True))
