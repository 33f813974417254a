"""A robot's numbers by the names of parameters, and robots with other numbers."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_robots import random_robot, random_tree, robots, trees

from gibbs_codegen import generate, load
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.body import Body, RigidBody, Rod
from gibbs_codegen.verification.contents import has_effect
from gibbs_codegen.verification.parameters import (
    determined,
    parameter_values,
    variation,
    variations,
    with_values,
)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["decarotor_3link"])
def test_names_and_values_are_those_of_the_derivation(robot: str | int) -> None:
    """But for lengths that nothing depends on, of shipped robots and of random trees."""
    made = read_robot(robot)[0] if isinstance(robot, str) else random_tree(robot)
    found = derive(made, keep_zeros=True).defaults
    assert found == {n: x for n, x in parameter_values(made).items() if n in found}
    unused = [n for n in parameter_values(made) if n not in found]
    assert not has_effect(made, unused)


@pytest.mark.slow
def test_names_and_values_of_arms_one_by_one_and_rigid_bodies() -> None:
    robot = random_robot(4, 3, 3)
    assert not robot.base.shares_one_arm
    values = parameter_values(robot)
    # The next link's a takes the place of this length, which changes nothing then.
    del values["link1_length"]
    assert derive(robot, keep_zeros=True).defaults == values


@pytest.mark.slow
@settings(max_examples=30)
@given(robot=robots() | trees())
def test_robots_of_other_numbers_have_those_numbers(robot: Robot) -> None:
    before = parameter_values(robot)
    assert with_values(robot, {}) == robot
    other = {name: 1.0 + number for number, name in enumerate(before)}
    assert parameter_values(with_values(robot, other)) == other


@settings(max_examples=30)
@given(robot=robots(most_rotors=5, most_links=4) | trees(), number=st.integers(0, 3))
def test_variations_change_every_number_by_much(robot: Robot, number: int) -> None:
    before = parameter_values(robot)
    varied = variation(robot, before, 1, number)
    after = parameter_values(varied)
    for name, value in before.items():
        assert after[name] != 0.0, name
        if value != 0.0:
            factor = abs(after[name] / value)
            assert 2.0 <= max(factor, 1.0 / factor) <= 8.0 * (1 + 1e-12), name
    for link in varied.links:
        assert link.body.total_mass > 0.0
        assert min(moments(link.body)) > 0.0


def moments(body: Body) -> tuple[float, ...]:
    """Moments of inertia in a body's own axes."""
    return body.inertia[:3] if isinstance(body, RigidBody) else body.section_inertia


def test_every_parameter_is_larger_smaller_negative_and_zero_in_turn() -> None:
    """But masses and moments of inertia that are negative are none that a body has."""
    robot = random_robot(3, 3, 3)
    names = [name for name, value in parameter_values(robot).items() if value]
    found = [parameter_values(r) for r in variations(robot, names, 0, 4, zeros=True)]
    before = parameter_values(robot)
    for name in names:
        factors = [values[name] / before[name] for values in found]
        assert max(map(abs, factors)) > 2.0, name
        assert min(abs(f) for f in factors if f) < 0.5, name
        positive = name.endswith("_mass") or name[-3:] in ("_xx", "_yy", "_zz")
        assert (min(factors) < 0.0) != positive, name
        assert 0.0 in factors, name


def test_what_leaves_an_acceleration_undetermined_is_not_zero() -> None:
    """All arms without mass at once; and the only mass, though inertia would be left."""
    arm = "name = 'arm'\nbase = { motion = 'fixed' }\n[[link]]\naxis = 'y'\nxyz = [0, 0, 0]\n"
    arm += "mass = 1\ncom = [0.2, 0, 0]\ninertia = [0.001, 0.01, 0.01, 0, 0, 0]\n"
    hexarotor = read_robot("hexarotor")[0]
    pairs = (hexarotor, parameter_values(hexarotor)), (parse_robot(arm), ["link1_mass"])
    for robot, names in pairs:
        for other in variations(robot, names, 0, 4, zeros=True):
            assert other.total_mass > 0.0


def test_two_rods_in_line_need_their_section_inertia() -> None:
    """Their moment about that line is else what rounding leaves of zero."""
    rod = Rod(
        length=0.3215762831449196,
        mass_per_length=0.32828143855895303,
        section_inertia=(0.0148, 0.0103, 0.0110),
    )
    thrust = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    robot = Robot(
        "rods",
        Base(rotors=2, arms=(rod,), thrust=thrust, drag=(0.0, 0.0), attitude="yzx"),
        (),
        9.81,
    )
    assert determined(robot)
    assert not determined(with_values(robot, {"base_arm_section_inertia_xx": 0.0}))


def test_a_module_may_leave_out_what_its_functions_do_not_read(tmp_path: Path) -> None:
    """Of the drag of rotors and the places of frames inverse dynamics knows nothing."""
    found = load(generate("quadrotor", tmp_path, functions=["inverse_dynamics"], verify=False))
    assert found.FUNCTIONS == ("inverse_dynamics",)
    assert "front_left_drag" not in found.PARAMETERS
    robot, _ = read_robot("quadrotor")
    assert has_effect(robot, ["front_left_drag"])
    assert not has_effect(robot, ["front_left_drag"], found.FUNCTIONS)
    assert has_effect(robot, ["base_mass"], found.FUNCTIONS)


def test_a_module_may_leave_out_what_none_of_its_actuators_reads() -> None:
    """The nominal voltage of a battery is that of throttles, of which rods' motors have none."""
    rods = "name = 'rods'\nbase = { rotors = 4, arm = { length = 0.5, mass_per_length = 1 } }\n"
    battery = "[battery]\nvoltage = [13, 16]\nresistance = 0.01\ncapacity = 5\nauxiliary = 4\n"
    robot = parse_robot(rods + battery)
    assert not has_effect(robot, ["battery_nominal"])
    assert has_effect(robot, ["battery_capacity"])
