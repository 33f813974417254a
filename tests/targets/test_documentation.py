"""Words about what is emitted: for every function, in the form that the templates count on."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from support.actuated import actuated
from support.derived import derived

from gibbs_codegen.interface import FUNCTIONS, Output, Row
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.constraint import Constraint
from gibbs_codegen.targets.documentation import attitude_lines, attitude_text, output_text
from gibbs_codegen.targets.registry import find_targets, render_module


@pytest.mark.parametrize("described", FUNCTIONS.values(), ids=FUNCTIONS)
def test_summary_and_details_are_sentences_and_the_source_is_none(described: Row) -> None:
    """A summary says what is returned, and stands in one line: ten letters less than a line has."""
    assert described.summary[0].isupper()
    assert described.summary[-1] == "."
    assert len(described.summary) <= 90
    assert described.details == "" or described.details[-1] == "."
    assert described.source
    assert described.source[-1] != "."


def told_units(output: Output, description: Description) -> list[set[str]]:
    """Units in brackets of what is said of an output's entries, and those of the table."""
    brackets = re.findall(r"\[(.*?)\]", output_text(description, output))
    return [set(re.split(", | or ", text)) for text in (" or ".join(brackets), output.unit)]


OUTPUTS = [(row.name, output) for row in FUNCTIONS.values() for output in row.outputs]


@pytest.mark.parametrize(("function", "output"), OUTPUTS, ids=[f"{n}.{o.name}" for n, o in OUTPUTS])
def test_units_in_the_text_are_those_of_the_table(function: str, output: Output) -> None:
    """A robot with joints of both kinds, so that there are entries of every unit."""
    if "COMMANDS" in FUNCTIONS[function].needs or "ACTUATOR_STATES" in FUNCTIONS[function].needs:
        told, units = told_units(output, Description(actuated()))
        assert told == units
        return
    robot = paper_family(3, 2)
    links = (robot.links[0], replace(robot.links[1], joint="prismatic"))
    held = (Constraint("held", "frame", "tip"),)
    told, units = told_units(output, Description(replace(robot, links=links, constraints=held)))
    # The ±1 by which a constrained joint and its torque enter are left out of the text.
    assert told == units - {"1"} if function == "hybrid_mass_matrix" else told == units


def text(function: str) -> str:
    """What is said of the entries that a function of one array returns."""
    return output_text(Description(paper_family(3, 1)), FUNCTIONS[function].outputs[0])


def test_entries_are_told_with_units() -> None:
    assert text("residual") == (
        "theta_m1 [N m], theta_0 [N m], theta_1 [N m], theta_4 [N m], x [N], y [N], z [N]"
    )
    assert text("hybrid_residual").startswith("theta_m1 [N m]")
    assert text("hybrid_residual").endswith("z [N], tau_prime_2 [rad/s^2], tau_prime_3 [rad/s^2]")
    assert text("constraint_torques") == "tau_prime_2 [N m], tau_prime_3 [N m]"
    assert text("positions") == "O1, O2, motor1, motor2, motor3, joint4, tip [m]"
    assert text("forward_dynamics").endswith("a_z [m/s^2]")
    assert (
        attitude_text(Description(paper_family(3, 1))) == "R_x(theta_m1) R_y(theta_0) R_z(theta_1)"
    )


MOUNTED = """
name = "carried"
base = { mass = 1.0, inertia = [1, 1, 1, 0, 0, 0], attitude = "quaternion" }
[[link]]
name = "mount"
joint = "fixed"
constrained = true
mass = 1.0
inertia = [1, 1, 1, 0, 0, 0]
"""


def header(robot: Robot) -> str:
    """The C header of a robot, its comment in one line."""
    text = render_module(derived(robot), "", find_targets(["c"]))[f"{robot.name}.h"]
    return " ".join(text.replace("\n *", " ").split())


def test_only_bases_of_rods_have_words_of_arms_and_motors() -> None:
    rods, placed, carried = paper_family(2, 0), read_robot("quadrotor")[0], parse_robot(MOUNTED)
    assert attitude_lines(Description(rods))[0].endswith(
        "From base arm 1's frame to the world the attitude is"
    )
    assert "gives in the frame of the motor's arm." in header(rods)
    assert attitude_lines(Description(placed)) == [
        "From the base's frame to the world the attitude is",
        "the unit quaternion qx, qy, qz, qw, its scalar part last.",
    ]
    assert "gives in the frame of the body that carries the rotor." in header(placed)
    told = header(carried)
    assert "from the base's frame to the world" in told
    assert "motor" not in told
    assert "A thrust acts" not in told


def test_a_table_without_entries_is_left_out() -> None:
    lone = parse_robot('name = "lone"\n[base]\nmass = 1.0\ninertia = [1, 1, 1, 0, 0, 0]\n')
    assert "Inputs u" not in header(lone)


@pytest.mark.slow
def test_unknowns_of_the_hybrid_system_are_accelerations_and_torques() -> None:
    told = header(parse_robot(MOUNTED))
    assert "vx [m/s^2] derivative of the velocity of the base's frame, along the" in told
    assert "mount [rad/s^2] second derivative of the constrained angle of the joint of" in told
    assert "tau_prime_mount [N m] constraint torque of the joint of mount" in told
    told = header(paper_family(2, 1))
    assert "theta_m1 [rad/s^2] second derivative of the first attitude angle, about x" in told
    assert "theta_m1 [rad] first attitude angle" in told
