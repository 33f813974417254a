"""Words about what is emitted: for every function, in the form that the templates count on."""

from __future__ import annotations

import pytest

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.targets.documentation import (
    DESCRIPTIONS,
    Description,
    attitude_text,
    output_text,
)


def test_every_function_and_no_other_is_described() -> None:
    program = derive(paper_family(3, 1)).program
    assert [function.name for function in program.functions] == list(DESCRIPTIONS)
    for function in program.functions:
        assert len(DESCRIPTIONS[function.name].outputs) == len(function.outputs)


@pytest.mark.parametrize("described", DESCRIPTIONS.values(), ids=DESCRIPTIONS)
def test_summary_and_details_are_sentences_and_the_source_is_none(described: Description) -> None:
    """A summary says what is returned, and stands in one line: ten letters less than a line has."""
    assert described.summary[0].isupper()
    assert described.summary[-1] == "."
    assert len(described.summary) <= 90
    assert described.details == "" or described.details[-1] == "."
    assert described.source
    assert described.source[-1] != "."


def test_entries_are_told_with_units() -> None:
    robot = paper_family(3, 1)
    assert output_text(robot, "residual", "residual") == (
        "theta_m1 [N m], theta_0 [N m], theta_1 [N m], theta_4 [N m], x [N], y [N], z [N]"
    )
    hybrid = output_text(robot, "hybrid_residual", "residual")
    assert hybrid.startswith("theta_m1 [N m]")
    assert hybrid.endswith("z [N], tau_prime_2 [rad/s^2], tau_prime_3 [rad/s^2]")
    assert output_text(robot, "constraint_torques", "torque") == (
        "tau_prime_2 [N m], tau_prime_3 [N m]"
    )
    assert output_text(robot, "positions", "position") == (
        "O1, O2, motor1, motor2, motor3, joint4, tip [m]"
    )
    assert output_text(robot, "forward_dynamics", "acceleration").endswith("a_z [m/s^2]")
    assert attitude_text(robot) == "R_x(theta_m1) R_y(theta_0) R_z(theta_1)"
