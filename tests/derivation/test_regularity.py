"""Robots on the edge of what has an answer: generated and right, or refused with a reason."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from support.comparison import of_rounding
from support.compiled import emit
from support.degenerate_robots import degenerate_robot, sized
from support.emitted import emitted_module
from support.null_space import SMALLEST, short_names, smallest_eigenvalue, unresisted
from support.tools import tool

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.derivation.regularity import check_range, massless_motions
from gibbs_codegen.errors import RobotFileError, SingularRobotError, UsageError
from gibbs_codegen.program.nodes import (
    Function,
    Name,
    Output,
    Reciprocal,
    ScalarProgram,
    Statement,
    Sum,
)
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import RigidBody, Rod
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.runtime.load import load
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree

BASE = paper_family(4, 0).base
HOLLOW = replace(BASE, arms=(Rod(length=0.5),))
NOTHING, ROD, SLENDER = (
    Rod(length=0.0),
    Rod(length=1.0, mass_per_length=1.0, section_inertia=(1e-3, 1e-3, 1e-3)),
    Rod(length=1.0, mass_per_length=1.0),
)
POINT = RigidBody(1.0, 1.0)
# Along z, which is the axis of the joint that carries it.
PIN = RigidBody(0.0, 1.0, (0.0, 0.0, 0.3), (0.1, 0.1, 0.0, 0.0, 0.0, 0.0))
BODY = RigidBody(0.0, 1.0, (0.3, 0.1, 0.2), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
TURNED, BACK = Fraction(90), Fraction(-90)
LINK = "theta_{} (the joint of link {})".format
SLIDE = "d_{} (the joint of link {})".format
ATTITUDE = "the attitude (theta_m1, theta_0, theta_1)"


def worst(robot: Robot, count: int = 2) -> tuple[float, str]:
    """The largest error of all functions, in units of what is allowed, and of which it is."""
    found = of_rounding(robot, emitted_module(robot), count)
    return max((error, name) for name, error in found.items())


def check(robot: Robot) -> None:
    """Agreement with the oracle, or a refusal that the oracle bears out."""
    singular = smallest_eigenvalue(robot)[0] < SMALLEST
    try:
        error, name = worst(robot)
    except SingularRobotError as error:
        refusal = error
    else:
        assert error <= 1.0, f"{name}: {error:.2g}"
        assert not singular, unresisted(robot)
        return
    assert refusal.ill_conditioned != singular, refusal
    assert refusal.ill_conditioned or short_names(refusal.joints) == unresisted(robot), refusal


def numbered(number: int) -> Robot:
    return degenerate_robot(number, 2 + number % 11, number % 7)


@pytest.mark.slow
@pytest.mark.parametrize("first", [0])
def test_what_nothing_resists_is_the_null_space_of_the_oracle(first: int) -> None:
    """Of hundreds of degenerate robots, before anything is derived; some three in ten singular."""
    count, singular = (1500 if first else 100), 0
    for number in range(first * 10_000, first * 10_000 + count):
        robot = numbered(number)
        motions = massless_motions(robot)
        named = short_names(name for motion in motions for name in motion)
        assert named == unresisted(robot), f"degenerate robot {number}"
        assert bool(motions) == (smallest_eigenvalue(robot)[0] < SMALLEST), number
        singular += bool(motions)
    assert 0.2 * count < singular < 0.6 * count


@pytest.mark.parametrize(
    ("base", "links", "motions"),
    [
        (BASE, (Link(ROD), Link(NOTHING, alpha_deg=TURNED)), [(LINK(6, 2),)]),
        (BASE, (Link(ROD), Link(NOTHING, joint="prismatic")), [(SLIDE(6, 2),)]),
        (BASE, (Link(ROD), Link(PIN, alpha_deg=TURNED)), [(LINK(6, 2),)]),
        (BASE, (Link(ROD), Link(POINT)), [(LINK(6, 2),)]),
        (
            BASE,
            (Link(ROD), Link(NOTHING), Link(NOTHING, alpha_deg=TURNED)),
            [(LINK(6, 2),), (LINK(7, 3),)],
        ),
        (BASE, (Link(NOTHING, alpha_deg=TURNED), Link(ROD)), [(LINK(6, 2), LINK(5, 1))]),
        (
            BASE,
            (Link(Rod(length=0.4), joint="prismatic"), Link(ROD, joint="prismatic")),
            [(SLIDE(6, 2), SLIDE(5, 1))],
        ),
        (
            BASE,
            (
                Link(NOTHING),
                Link(NOTHING, alpha_deg=TURNED),
                Link(NOTHING, alpha_deg=BACK),
                Link(BODY),
            ),
            [(LINK(8, 4), LINK(7, 3))],
        ),
        (HOLLOW, (Link(ROD, joint="prismatic"),), [(SLIDE(5, 1), "the position (x, y, z)")]),
        (HOLLOW, (Link(ROD),), [(LINK(5, 1), ATTITUDE)]),
    ],
)
def test_every_motion_that_nothing_resists_is_named(base, links, motions) -> None:
    """Tips without mass, thickness or lever; axes in line with nothing between; hollow bases."""
    robot = Robot("singular", base, links)
    assert {frozenset(motion) for motion in massless_motions(robot)} == {
        frozenset(motion) for motion in motions
    }
    for keep_zeros in (False, True):
        with pytest.raises(SingularRobotError) as refused:
            derive(robot, keep_zeros)
        assert all(name in str(refused.value) for motion in motions for name in motion)


def test_the_message_says_what_to_do() -> None:
    one = Robot("one", BASE, (Link(ROD), Link(PIN, alpha_deg=TURNED)))
    two = Robot("two", BASE, (Link(NOTHING, alpha_deg=TURNED), Link(ROD)))
    for robot, text in (
        (
            one,
            "one: massless degree of freedom, whose acceleration is not determined: theta_6 (the "
            "joint of link 2); give what it moves mass, or inertia about its axis",
        ),
        (
            two,
            "two: massless degree of freedom, whose acceleration is not determined: theta_6 (the "
            "joint of link 2) and theta_5 (the joint of link 1) moving together; give what it "
            "moves mass, or inertia about its axis; where coordinates move together, give it to "
            "what lies between them",
        ),
    ):
        with pytest.raises(SingularRobotError) as refused:
            derive(robot)
        assert str(refused.value) == text


def test_of_many_motions_the_message_names_some_and_the_error_all() -> None:
    with pytest.raises(SingularRobotError, match=r"theta_8 \(.*; and 2 more") as refused:
        derive(Robot("limp", BASE, (Link(NOTHING, alpha_deg=TURNED),) * 6))
    assert len(refused.value.motions) == len(refused.value.joints) == 6


@pytest.mark.slow
def test_very_unequal_masses_are_no_singularity() -> None:
    """A tip lighter or heavier than the rest: every function to rounding of its own terms."""
    links = (
        Link(BODY, alpha_deg=TURNED),
        Link(sized(BODY, 1e-9, 1.0), alpha_deg=Fraction(30), a=0.4),
    )
    error, name = worst(Robot("unequal", BASE, links), count=5)
    assert error <= 1.0, f"{name}: {error:.2g}"


def test_what_only_rounding_hides_is_told_apart() -> None:
    """A point 1e20 times as heavy as the base that is to be told from it."""
    heavy = Link(sized(RigidBody(0.0, 1.0, (0.5, 0.0, 0.0)), 1e20, 1.0))
    with pytest.raises(SingularRobotError, match="lost in the rounding") as refused:
        derive(Robot("ill_conditioned", BASE, (heavy,)))
    assert refused.value.ill_conditioned
    assert massless_motions(Robot("ill_conditioned", BASE, (heavy,))) == []


FILE = """name = "far"
[base]
rotors = 3
drag = [0, 0, {drag}]
arm = {{ length = {length}, mass_per_length = {density} }}
[[link]]
d = {d}
mass = 1
com = [0.1, 0, 0]
"""


@pytest.mark.parametrize(
    ("key", "value", "place"),
    [
        ("length", "1e-200", "5: base.arm.length"),
        ("density", "1e150", "5: base.arm.mass_per_length"),
        ("drag", "-1e99", "4: base.drag 3"),
        ("d", "1e-51", "7: link 1: d"),
    ],
)
def test_sizes_that_overflow_or_vanish_are_refused_in_their_place(
    key: str, value: str, place: str
) -> None:
    numbers = {"length": "0.5", "density": "1", "d": "0", "drag": "0"}
    assert parse_robot(FILE.format(**numbers))
    with pytest.raises(RobotFileError) as refused:
        parse_robot(FILE.format(**numbers | {key: value}), "far.toml")
    assert str(refused.value).startswith(f"far.toml:{place}: must be 0 or from 1e-50 to 1e+50")


def test_sizes_are_refused_without_a_file_too() -> None:
    for weight in (1e150, 1e-150):
        robot = Robot("far", BASE, (Link(sized(BODY, weight, 1.0)),))
        with pytest.raises(UsageError, match="far: link1_mass must be 0 or from 1e-50"):
            derive(robot)


def test_what_cannot_be_computed_is_not_emitted() -> None:
    """A program that divides by a difference of equals, whatever brought it about."""
    a, b = Name("link1_length"), Name("link2_length")
    division = Statement("c0", Reciprocal(Sum(((1, a), (-1, b)))))
    forward = Function("forward_dynamics", (), ("c0",), (), (Output((1,), (Name("c0"),)),))
    program = ScalarProgram(
        {"q": ("x",), "v": (), "u": ()},
        ("link1_length", "link2_length"),
        ("c0",),
        (division,),
        (forward,),
    )
    robot = Robot("close", BASE)
    check_range(robot, program, {"link1_length": 2.0, "link2_length": 1.0})
    with pytest.raises(UsageError, match="close: accelerations overflow or vanish in") as error:
        check_range(robot, program, {"link1_length": 1e30, "link2_length": 1e30})
    assert "link1_length = 1e+30" in str(error.value)


@pytest.mark.slow
def test_the_comparison_sees_a_light_tip() -> None:
    """A millionth more of a billionth of the mass, as the wrong module for a robot."""
    tip = Link(sized(BODY, 1e-9, 1.0), alpha_deg=TURNED)
    other = replace(tip, body=sized(BODY, 1e-9 * (1 + 1e-6), 1.0))
    robot = Robot("light", BASE, (tip,))
    module = emitted_module(Robot("light", BASE, (other,)))
    found = of_rounding(robot, module, 1)
    names = ("mass_matrix", "residual", "inverse_dynamics", "hybrid_mass_matrix")
    assert min(found[name] for name in names) > 1.0, found


SINGULAR_AT_ZERO = {
    # A massless upper arm and a point at the tip: stretched, both joints move it one way.
    "stretched": (Link(Rod(length=1.0)), Link(RigidBody(1.0, 1.0, (1.0, 0.0, 0.0)))),
    # A massless wrist whose first and last axes are in line.
    "wrist": (Link(NOTHING), Link(NOTHING, alpha_deg=TURNED), Link(BODY, alpha_deg=BACK)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["stretched"])
def test_a_machine_singular_somewhere_is_right_elsewhere(name: str, tmp_path: Path) -> None:
    """And where it is singular, its accelerations are no numbers that one could take for such."""
    tool("cc")
    robot = Robot(name, BASE, SINGULAR_AT_ZERO[name])
    emitted = emit(robot, tmp_path / name)
    states = States.random(Tree(robot), 3, 0)
    q, v, u = states.q[0].copy(), states.v[0], states.u[0]
    joints = slice(3, 3 + len(robot.links))
    q[joints] = 0.0
    for module in (emitted.module, load(emitted.folder, backend="c")):
        assert max(of_rounding(robot, module, 3).values()) <= 1.0
        assert "a joint moves no mass" in " ".join(module.forward_dynamics.__doc__.split())
        with np.errstate(all="ignore"):
            accelerations = module.forward_dynamics(q, v, u)
        assert not (np.abs(accelerations[joints]) < 1e12).all()
        if name == "wrist":
            rest = np.zeros_like(q)
            with pytest.warns(RuntimeWarning, match="forward_dynamics is not finite though"):
                module.forward_dynamics(rest, rest, u)
