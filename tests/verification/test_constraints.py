"""The functions of constraints are verified, and faults in each of their parts are found."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import sympy as sp
from support.constrained import HELD_STILL, LIGHT_FINGER, TEXT
from support.derived import derived
from support.emitted import module_of
from support.tools import tool

from gibbs_codegen.derivation.constraints import ConstraintEquations
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.c_library import chosen_compiler, compiled_library
from gibbs_codegen.runtime.load import load
from gibbs_codegen.symbolic import ldlt
from gibbs_codegen.targets.registry import find_targets, render_module
from gibbs_codegen.verification.c_program import compare_single_precision
from gibbs_codegen.verification.comparison import Results
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
IMPACT = {"impact.velocities_after", "impact.impulses"}
Wanted = list[tuple[Robot, Expected, States]]


@pytest.fixture(scope="module")
def expected() -> Wanted:
    """What Newton and Euler's formulation gives, of a robot of other numbers as well."""
    robot = parse_robot(TEXT)
    names, found = module_of(derived(robot, functions=FEW)).PARAMETERS, []
    for other in (robot, variation(robot, names, 0, 0)):
        states = States.random(Tree(other), 16, 1)
        found.append((other, Expected(formulated(NewtonEuler(Tree(other))), states), states))
    return found


def failing(expected: Wanted, derive: Callable[..., Model] = derive) -> set[str]:
    """Functions of the robot's module that are found wrong."""
    module, failed = module_of(derive(parse_robot(TEXT), functions=FEW)), set[str]()
    for robot, rows, states in expected:
        evaluation = Results(module, prepared(module, robot))
        found = rows.compare_functions(evaluation, states, "Newton–Euler")
        failed |= {c.what for c in found if not c.passed}
    return failed


@pytest.mark.slow
def test_functions_pass(expected: Wanted) -> None:
    assert failing(expected, derived) == set()


NEAR = """
[[frame]]
name = "near"
on   = "finger"
xyz  = [0, {place}, -0.2]

[[constraint]]
name  = "first"
type  = "point"
frame = "claw"
xyz   = [0.1, 0, 2]

[[constraint]]
name  = "second"
type  = "point"
frame = "near"
xyz   = [0.1, 0.1, 2]
"""


@pytest.mark.slow
@pytest.mark.parametrize("apart", [1e-4, 1e-7])
def test_points_held_next_to_each_other_pass_and_faults_are_found(apart: float) -> None:
    """Where rounding does not decide what is redundant, digits are lost as rows are conditioned."""
    text = TEXT[: TEXT.index("[[constraint]]")] + NEAR.format(place=0.01 + apart)
    robot = parse_robot(text)
    module = module_of(derived(robot, functions=FEW))
    for number in range(2):
        other = variation(robot, module.PARAMETERS, 0, number)
        states = States.random(Tree(other), 16, [1, number])
        rows = Expected(formulated(NewtonEuler(Tree(other))), states)
        right, wrong = (
            rows.compare_functions(Results(module, prepared(module, x)), states, "")
            for x in (other, robot)
        )
        assert {c.what for c in right if not c.passed} == set()
        missed = {c.what for c in wrong if c.passed}
        assert apart < 1e-6 or not missed & {"operational_inertia", FORCES}


@pytest.mark.slow
def test_a_fault_of_the_derivation_is_found(
    monkeypatch: pytest.MonkeyPatch,
    expected: Wanted,
) -> None:
    fault = property(lambda self: [sp.S.One for held in self.held for _ in held.rows])
    found = {*ALL, *IMPACT, "operational_inertia", "constraint_projection"}
    monkeypatch.setattr(ConstraintEquations, "masks", fault)
    assert found <= failing(expected)


@pytest.mark.slow
def test_derivatives_pass_where_a_robot_is_held_still_and_faults_are_found() -> None:
    """Velocities after an impact are zero there, but for rounding."""
    robot = parse_robot(HELD_STILL)
    derivatives = (f"{HELD}_derivatives", "impact_derivatives")
    module = module_of(derive(robot, functions=("default", *FEW), derivatives=derivatives))
    states = States.random(Tree(robot), 8, 1)
    evaluation = Results(module, prepared(module, robot))
    found = compare_derivatives(evaluation, ComplexSteps(module, robot), robot, states)
    assert {c.what for c in found if not c.passed} == set()
    other = variation(robot, module.PARAMETERS, 0, 0)
    found = compare_derivatives(evaluation, ComplexSteps(module, other), robot, states)
    wrong = {c.what for c in found if not c.passed}
    assert {"impact_derivatives.velocities_after_dq", f"{HELD}_derivatives.acceleration_dq"} < wrong


@pytest.mark.slow
@pytest.mark.parametrize("lost", [False])
def test_single_precision_is_verified_where_light_and_heavy_are_held(
    lost: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also that it loses what is heavy, if it takes too much for rounding."""
    tool("cc")
    if lost:
        monkeypatch.setattr(ldlt, "_LOST", sp.Integer(10**4))
    robot, folder = parse_robot(LIGHT_FINGER), tmp_path / "light"
    folder.mkdir()
    model = derive(robot, functions=("default", "constraints"))
    for name, content in render_module(model, LIGHT_FINGER, find_targets(("numpy", "c"))).items():
        (folder / name).write_text(content, encoding="utf-8")
    flags = ("-DLIGHT_FLOAT", "-O0")
    path = compiled_library(folder, robot.name, chosen_compiler(), flags)
    found, said = compare_single_precision(str(path), load(folder, backend="c"), robot, 0)
    assert not said
    failed = {c.what for c in found if not c.passed}
    assert failed == ({"impact.impulses", "operational_inertia"} if lost else set())
