"""The functions of actuators are verified, and faults in each of their parts are found."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.actuated import TEXT, actuated, by_rates
from support.derived import derived
from support.emitted import NUMPY
from support.planted_faults import planted
from support.tools import tool

from gibbs_codegen.arrays.nodes import absolute, square_root
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.graph import from_program
from gibbs_codegen.interface.actuators import ACTUATORS
from gibbs_codegen.machine import battery, friction, motor, servo
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.targets.registry import render_module
from gibbs_codegen.verification.comparison import Results, failure_text
from gibbs_codegen.verification.equations import Expected
from gibbs_codegen.verification.formulation import formulated
from gibbs_codegen.verification.modules import verify
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.parameters import prepared, variation, with_values
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.verify import compare_module, module_of

# Of motors, servos and battery, with one function of all bodies.
FEW = ("actuators", "residual")
# With what derivatives are measured by.
MORE = (
    *(*FEW, "mass_matrix", "input_matrix", "forward_dynamics", "inverse_dynamics"),
    *("integrate", "coordinate_rates"),
)
OWN = tuple(row.name for row in ACTUATORS)


@pytest.mark.slow
def test_a_robot_with_every_kind_passes_in_both_back_ends(tmp_path: Path) -> None:
    tool("cc")
    derivatives = ("inputs_of_derivatives", "actuator_rates_parameters")
    robot, options = actuated(), {"derivatives": derivatives, "functions": MORE, "verify": False}
    _, folder = generate_robot(robot, TEXT, tmp_path, ["numpy", "c"], **options)
    found = verify(folder, states=2)
    assert found.passed, [failure_text(c) for _, c in found.failures]
    assert list(found.comparisons) == ["numpy", "c"]
    for comparisons in found.comparisons.values():
        against = {(c.what.split(".")[0], c.against) for c in comparisons}
        assert {(name, "Newton–Euler") for name in OWN} <= against
        assert {(name, "other functions, other parameters") for name in derivatives} <= against


def source(robot: Robot, **options: Any) -> str:
    """The NumPy source of the functions of the actuators."""
    model = derived(robot, functions=FEW, **options)
    return render_module(model, "", NUMPY)["numpy_module.py"]


Wanted = list[tuple[Robot, Expected, States]]


@pytest.fixture(scope="module")
def expected() -> Wanted:
    """What Newton and Euler's formulation gives, of two robots of other numbers as well."""
    robot = actuated()
    names, found = module_of(source(robot)).PARAMETERS, []
    for number in (None, 0, 1):
        other = robot if number is None else variation(robot, names, 0, number)
        tree = Tree(other)
        states = States.random(tree, 30, 1)
        found.append((other, Expected(formulated(NewtonEuler(tree)), states), states))
    return found


def failing(module: ModuleType, expected: Wanted) -> set[str]:
    """Functions of a module that are found wrong."""
    failed = set()
    for robot, rows, states in expected:
        evaluation = Results(module, prepared(module, robot))
        found = rows.compare_functions(evaluation, states, "Newton–Euler")
        failed |= {c.what for c in found if not c.passed}
    return failed


def falling() -> Robot:
    """The robot with a rotor whose thrust falls beyond its greatest speed."""
    return parse_robot(TEXT.replace("constant = 1e-5", "curve = [0, 2e-2, -1e-5]"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "zeros"),
    [(falling(), False), (by_rates(), True)],
    ids=["falling", "zeros with rates"],
)
def test_other_curves_and_servos_and_zeros_that_are_parameters_pass(
    robot: Robot, zeros: bool
) -> None:
    against = [formulated(NewtonEuler(Tree(robot)))]
    found = compare_module(module_of(source(robot, keep_zeros=zeros)), robot, against, 4, 0)
    assert [failure_text(c) for c in found if not c.passed] == []


@pytest.mark.parametrize(
    ("modules", "attribute", "fault", "found"),
    [
        pytest.param(
            [servo], "_within", lambda x, _: x, {"inputs_of", "actuator_rates"}, id="limits"
        ),
        pytest.param([friction], "_SMOOTH", 1.0 / 9.0, {"inputs_of"}, id="smooth friction"),
        pytest.param(
            [motor, battery],
            "positive_root",
            lambda x: square_root(absolute(x)),
            {"command_of", "actuator_rates"},
            id="too little voltage",
        ),
        pytest.param(
            [from_program],
            "_above",
            lambda graph, a, b, above=from_program._above: above(graph, b, a),
            {"command_of", "inputs_of", "actuator_rates"},
            id="the wrong side",
        ),
    ],
)
def test_a_fault_of_the_programs_is_found(
    modules: list[ModuleType],
    attribute: str,
    fault: object,
    found: set[str],
    monkeypatch: pytest.MonkeyPatch,
    expected: Wanted,
) -> None:
    for module in modules:
        monkeypatch.setattr(module, attribute, fault)
    text = render_module(derive(actuated(), functions=FEW), "", NUMPY)["numpy_module.py"]
    assert failing(module_of(text), expected) == found


def test_each_number_of_actuators_counts(expected: Wanted) -> None:
    """A thousandth more of any is found, and times of speeding up and slowing down that change."""
    text = source(actuated())
    module, (robot, rows, states) = module_of(text), expected[0]
    words = ("_servo_", "_friction_", "battery_", "_thrust_", "_time_", "_speed")
    names = [name for name in module.PARAMETERS if any(word in name for word in words)]
    assert len(names) > 30

    def wrong(**others: float) -> set[str]:
        evaluation = Results(module, prepared(module, with_values(robot, others)))
        found = rows.compare_functions(evaluation, states, "Newton–Euler")
        return {c.what for c in found if not c.passed}

    assert [name for name in names if not wrong(**{name: 1.001 * module.PARAMETERS[name]})] == []
    assert wrong(front_left_time_up=0.05, front_left_time_down=0.03) == {"actuator_rates"}


def test_planted_faults_are_found(expected: Wanted) -> None:
    """One sign, index or name altered."""
    text = source(actuated())
    begin, functions = text.index("\ndef _thrusts_of("), text.index("\ndef actuator_state_of(")
    assert failing(module_of(text), expected) == set()
    missed = []
    for altered, what in planted(text[begin:functions], 20, seed=3):
        if not failing(module_of(text[:begin] + altered + text[functions:]), expected):
            missed.append(what)
    assert not missed


def test_states_reach_both_sides_of_every_limit() -> None:
    """Of torques, rates, backlash, time constants, pieces of the voltage, and the power."""
    robot = actuated()
    tree = Tree(robot)
    states = States.random(tree, 60, 0)
    upper, slider = states.x[:, 3], states.x[:, 4]
    way = upper - states.q[:, 7]
    torque = 30.0 * (way - np.clip(way, -0.005, 0.005)) - 0.4 * states.v[:, 6]
    force = 400.0 * (slider - states.q[:, 8]) - 8.0 * states.v[:, 7]
    rate = (states.command[:, 4] - upper) / 0.02
    for value, limit in ((way, 0.005), (torque, 4.0), (force, 20.0), (rate, 6.0)):
        shares = np.mean(value < -limit), np.mean(np.abs(value) < limit), np.mean(value > limit)
        assert min(shares) > 0.05
    for rotor, place in ((1, 1), (3, 2)):
        slower = np.mean(states.command[:, rotor] < states.x[:, place])
        assert 0.2 < slower < 0.8
    pieces = np.histogram(states.x[:, -1], [-1.0, 0.0, 1 / 3, 2 / 3, 1.0, 2.0])[0]
    assert pieces.min() > 3
