"""Right modules of odd robots pass, and faults in them are found all the same."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest
from support.emitted import emitted_module

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base, alternating_thrust
from gibbs_codegen.robot.parts.body import RigidBody
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.verification.comparison import failure_text
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.verify import compare_module, formulations


def odd_robot(
    size: float = 1.0,
    tip: float = 1.0,
    gravity: float = 9.81,
    offset: float = 0.5,
    mass: float = 1.0,
) -> Robot:
    """A robot with joints of both kinds, of a size, whose last link has another again."""

    def body(length: float) -> RigidBody:
        i = 0.1 * mass * length**2
        com = (0.4 * length, 0.1 * length, -0.05 * length)
        return RigidBody(length, mass, com, (i, 1.2 * i, 1.1 * i, 0.1 * i, 0.05 * i, -0.1 * i))

    base = Base(rotors=3, arms=(body(size),), thrust=alternating_thrust(3), drag=(0.0,) * 3)
    links = (
        Link(body(size), alpha_deg=Fraction(90), a=offset * size),
        Link(body(size), alpha_deg=Fraction(30), joint="prismatic"),
        Link(body(size * tip), alpha_deg=Fraction(-90), d=0.2 * size * tip),
    )
    return Robot("odd", base, links, gravity)


ODD = {
    "tiny": odd_robot(size=1e-7),
    "a micrometre": odd_robot(size=1e-6, mass=0.1),
    "a micrometre of 1e-15 kg": odd_robot(size=1e-6, mass=1e-16),
    "next to nothing": odd_robot(size=1e-7, mass=1e-20),
    "light": odd_robot(mass=1e-17),
    "light beside the rest": replace(
        odd_robot(), base=replace(odd_robot().base, arms=(odd_robot(mass=1e18).base.arms[0],))
    ),
    "huge": odd_robot(size=1e9),
    "tip of a thousandth": odd_robot(tip=1e-3),
    "tip of a billionth": odd_robot(tip=1e-9),
    "heavy world": odd_robot(gravity=1e9),
    "weightless": odd_robot(gravity=0.0),
    "far joint": odd_robot(offset=1e6),
}


@pytest.mark.slow
def test_what_is_right_passes_every_formulation() -> None:
    robot = ODD["tiny"]
    found, not_done = formulations(robot)
    assert "MuJoCo" not in not_done or "is not installed" in not_done["MuJoCo"]
    comparisons = compare_module(emitted_module(robot), robot, found, 3, 0)
    assert [failure_text(c) for c in comparisons if not c.passed] == []


def test_mujoco_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    mujoco = pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    # MuJoCo warns that the mass matrix of this robot is close to singular.
    found, _ = formulations(ODD["tip of a billionth"])
    for formulation in found[1:]:
        formulation.at(States.random(formulation.tree, 1, (0, 0)))
    assert [*tmp_path.iterdir()] == []
    assert capfd.readouterr().err == ""
    assert mujoco.get_mju_user_warning() is None


@pytest.mark.slow
def test_another_size_of_the_tip_is_seen() -> None:
    """A thousandth of the size, with a millionth more of its mass, as the module of the other."""
    robot = ODD["tip of a thousandth"]
    *inner, last = robot.links
    body = replace(last.body, mass=1.0 + 1e-6)
    other = replace(robot, links=(*inner, replace(last, body=body)))
    comparisons = compare_module(emitted_module(other), robot, [NewtonEuler(Tree(robot))], 2, 0)
    # The defaults are what differs.
    assert [c.what for c in comparisons if not c.passed] == ["PARAMETERS"]
