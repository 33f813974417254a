"""Modules of trees: what is right passes, and what is wrong anywhere does not."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.random_robots import random_tree
from support.tools import tool

from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.verification.comparison import failure_text
from gibbs_codegen.verification.modules import verify

# With a quaternion, rotors on links, a link that is held, one that is welded, and passive joints.
SEED = 45


def failures(folder: Path, backends: list[str]) -> list[str]:
    """What `gibbs-codegen verify` finds wrong with a module."""
    found = verify(folder, states=2, backends=backends)
    assert list(found.comparisons) == backends, found.not_done
    assert not any(what.endswith("with a formulation") for what in found.not_done)
    return [failure_text(comparison) for _, comparison in found.failures]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4])
def test_random_trees_pass(seed: int, tmp_path: Path) -> None:
    """Of every third, the C back end too."""
    backends = ["numpy"]
    if seed % 3 == 0:
        tool("cc")
        backends.append("c")
    robot = random_tree(seed)
    _, folder = generate_robot(robot, robot_text(robot), tmp_path, backends, verify=False)
    assert failures(folder, backends) == []


def test_the_robot_of_planted_faults_has_what_trees_have() -> None:
    robot = random_tree(SEED)
    assert robot.base.attitude == "quaternion"
    assert any(rotor.on for rotor in robot.thrusters)
    assert robot.constrained
    assert any(not link.moves and not link.constrained for link in robot.links)
    assert any(link.passive.damping for link in robot.links)
