"""Parameters of a module: those of the robot file that change what its functions give."""

from __future__ import annotations

from dataclasses import replace

import pytest
from support.random_robots import random_robot

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.robot.model import Robot


@pytest.mark.exhaustive
@pytest.mark.parametrize("keep_zeros", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_length_that_changes_nothing_is_no_parameter(keep_zeros: bool) -> None:
    """A rigid link needs its length for the tip, and for the next joint unless that has an `a`."""
    robot = random_robot(2, 5, 2)
    bodies = [replace(link.body, length=0.4) for link in robot.links]
    first, last = (replace(x, body=b, a=0.2) for x, b in zip(robot.links, bodies, strict=True))
    kept = derive(replace(robot, links=(first, replace(last, a=None))), keep_zeros)
    left_out = derive(replace(robot, links=(first, last)), keep_zeros)
    assert "link1_length" in kept.defaults
    assert "link1_length" not in left_out.defaults
    assert list(left_out.units) == list(left_out.defaults) == list(left_out.program.parameters)
    assert {"link1_a", "link2_a", "link2_length"} <= left_out.defaults.keys()


@pytest.mark.parametrize("robot", [random_robot(2, 5, 2), random_robot(1, 4, 3)])
def test_every_parameter_changes_a_constant(robot: Robot) -> None:
    model = derive(robot)
    program = model.program
    before = program.prepared(model.defaults)
    for name, value in model.defaults.items():
        after = program.prepared(model.defaults | {name: 1.1 * value})
        assert any(after[constant] != before[constant] for constant in program.constants), name
