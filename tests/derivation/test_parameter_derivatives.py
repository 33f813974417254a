"""Derivatives by the parameters against complex steps through `prepare`."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.family import benchmark_robot
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.nodes import count_operations

FUNCTIONS = ("inverse_dynamics_parameters", "forward_dynamics_parameters_vjp")


@pytest.mark.slow
def test_operations_are_as_few_as_they_were() -> None:
    """Nor are there many more constants. Signs depend a little on what else has been derived."""
    reached = (570, 760)
    robot = benchmark_robot(3)
    program, without = derive(robot, derivatives=FUNCTIONS).program, derive(robot).program
    found = [count_operations(program.function(name).nodes()).total for name in FUNCTIONS]
    assert np.all(np.array(found) <= reached)
    assert len(program.prepare) < 1.5 * len(without.prepare)
