"""Parameters of a module: those of the robot file that change what its functions give."""

from __future__ import annotations

import pytest
from support.random_robots import random_robot

from gibbs_codegen.derivation.derive import derive


@pytest.mark.slow
def test_every_parameter_changes_a_constant() -> None:
    robot = random_robot(2, 5, 2)
    model = derive(robot)
    program = model.program
    before = program.prepared(model.defaults)
    for name, value in model.defaults.items():
        after = program.prepared(model.defaults | {name: 1.1 * value})
        assert any(after[constant] != before[constant] for constant in program.constants), name
