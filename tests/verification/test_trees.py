"""Modules of trees: what is right passes, and what is wrong anywhere does not."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.random_robots import random_tree

from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.verification.comparison import failure_text
from gibbs_codegen.verification.modules import verify

# With a quaternion, rotors on links, a link that is held, one that is welded, and passive joints.
SEED = 45


@pytest.mark.slow
def test_a_random_tree_passes(tmp_path: Path) -> None:
    robot = random_tree(4)
    _, folder = generate_robot(robot, robot_text(robot), tmp_path, ["numpy"], verify=False)
    found = verify(folder, states=2, backends=["numpy"])
    assert [*found.comparisons] == ["numpy"], found.not_done
    assert not any(what.endswith("with a formulation") for what in found.not_done)
    assert [failure_text(comparison) for _, comparison in found.failures] == []


def test_the_robot_of_planted_faults_has_what_trees_have() -> None:
    robot = random_tree(SEED)
    assert robot.base.attitude == "quaternion"
    assert any(rotor.on for rotor in robot.thrusters)
    assert robot.constrained
    assert any(not link.moves and not link.constrained for link in robot.links)
    assert any(link.passive.damping for link in robot.links)
