"""The functions of constraints are verified, and faults in each of their parts are found."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import sympy as sp
from support.constrained import TEXT
from support.emitted import module_of

from gibbs_codegen.derivation import constraints
from gibbs_codegen.derivation.constraints import ConstraintEquations
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.comparison import Evaluation
from gibbs_codegen.verification.complex_steps import ComplexSteps
from gibbs_codegen.verification.derivatives import compare_derivatives
from gibbs_codegen.verification.equations import Expected
from gibbs_codegen.verification.formulation import formulated
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.parameters import prepared, variation
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree

FEW = ("constraints", "residual")
HELD, FORCES = "constrained_forward_dynamics", "constrained_forward_dynamics.forces"
ALL = {f"{HELD}.acceleration", FORCES}
IMPACT = {"impact.velocities", "impact.impulses"}
Wanted = list[tuple[Robot, Expected, States]]


@pytest.fixture(scope="module")
def expected() -> Wanted:
    """What Newton and Euler's formulation gives, of a robot of other numbers as well."""
    robot = parse_robot(TEXT)
    names, found = module_of(derive(robot, functions=FEW)).PARAMETERS, []
    for other in (robot, variation(robot, names, 0, 0)):
        states = States.random(Tree(other), 16, 1)
        found.append((other, Expected(formulated(NewtonEuler(Tree(other))), states), states))
    return found


def failing(expected: Wanted) -> set[str]:
    """Functions of the robot's module that are found wrong."""
    module, failed = module_of(derive(parse_robot(TEXT), functions=FEW)), set()
    for robot, rows, states in expected:
        evaluation = Evaluation(module, prepared(module, robot))
        found = rows.compare_functions(evaluation, states, "Newton–Euler")
        failed |= {c.what for c in found if not c.passed}
    return failed


def test_functions_pass(expected: Wanted) -> None:
    assert failing(expected) == set()


@pytest.mark.parametrize(
    ("attribute", "fault", "found"),
    [
        pytest.param(
            "_centripetal", lambda *_: sp.S.Zero, {"constraint_bias", *ALL}, id="turning ropes"
        ),
        pytest.param(
            "_returning", lambda _, held: [sp.S.Zero] * len(held.rows), ALL, id="errors that stay"
        ),
        pytest.param(
            "masks",
            property(lambda self: [sp.S.One for held in self.held for _ in held.rows]),
            {*ALL, *IMPACT, "operational_inertia", "constraint_projection"},
            id="always active",
        ),
        pytest.param(
            "from_solver", lambda _, rows: list(rows), {FORCES, "impact.impulses"}, id="other axes"
        ),
    ],
)
def test_a_fault_of_the_derivation_is_found(
    attribute: str,
    fault: Callable[..., Any],
    found: set[str],
    monkeypatch: pytest.MonkeyPatch,
    expected: Wanted,
) -> None:
    monkeypatch.setattr(ConstraintEquations, attribute, fault)
    assert found <= failing(expected)


def test_the_sign_of_a_turn_is_found(monkeypatch: pytest.MonkeyPatch, expected: Wanted) -> None:
    monkeypatch.setattr(constraints, "_HALF", sp.Rational(-1, 2))
    assert "constraint_errors" in failing(expected)


HELD_STILL = """
name = "perched"

[base]
attitude = "quaternion"
mass     = 1.5
com      = [0.01, 0, 0]
inertia  = [0.015, 0.016, 0.03, 0, 0, 0]

[[link]]
name    = "leg"
xyz     = [0, 0, -0.05]
axis    = "y"
mass    = 0.2
com     = [0, 0, -0.1]
inertia = [1e-3, 1e-3, 1e-4, 0, 0, 0]

[[frame]]
name = "toe"
on   = "leg"
xyz  = [0, 0, -0.3]

[[constraint]]
name  = "grip"
type  = "frame"
frame = "base"

[[constraint]]
name      = "stand"
type      = "point"
frame     = "toe"
frequency = 8
"""


def test_derivatives_pass_where_a_robot_is_held_still_and_faults_are_found() -> None:
    """Velocities after an impact are zero there, but for rounding."""
    robot = parse_robot(HELD_STILL)
    derivatives = (f"{HELD}_derivatives", "impact_derivatives")
    module = module_of(derive(robot, functions=("default", *FEW), derivatives=derivatives))
    states = States.random(Tree(robot), 8, 1)
    evaluation = Evaluation(module, prepared(module, robot))
    found = compare_derivatives(evaluation, ComplexSteps(module, robot), robot, states)
    assert {c.what for c in found if not c.passed} == set()
    other = variation(robot, module.PARAMETERS, 0, 0)
    found = compare_derivatives(evaluation, ComplexSteps(module, other), robot, states)
    wrong = {c.what for c in found if not c.passed}
    assert {"impact_derivatives.velocities_dq", f"{HELD}_derivatives.acceleration_dq"} <= wrong
