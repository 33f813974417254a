"""Balance of the base: against emitted functions, and the warning with its remedy."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from support.emitted import emitted_module
from support.random_robots import random_robot

from gibbs_codegen.robot.balance import balance_lines, hover, lopsided
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot, read_robot, shipped_robots
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.body import RigidBody, Rod, as_rigid_body
from gibbs_codegen.robot.posture import MassProperties, base_properties

ARM = "length = 0.3, mass = 0.4, com = [{com}], inertia = [1e-4, 1e-3, 1e-3, 1e-5, 2e-5, 3e-5]"


def machine(arm: str) -> Robot:
    """A hexarotor with tilted rotors and these base arms."""
    tilted = ", ".join("[0, 0.3, 0.9]" if k % 2 else "[0, -0.3, 0.9]" for k in range(6))
    return parse_robot(
        f'name = "lop"\n[base]\nrotors = 6\norigin = "centre"\nthrust = [{tilted}]\n'
        f"drag = [0.02, -0.02, 0.02, -0.02, 0.02, -0.02]\narm = {arm}\n"
    )


def inertia_matrix(found: MassProperties) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = found.inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.slow), 1, 2, 3])
def test_base_is_that_of_the_emitted_mass_matrix(seed: int) -> None:
    robot = random_robot(seed, 3 + seed, 0)
    module, found = emitted_module(robot), base_properties(robot)
    # Level, the rates of the attitude angles are those about the world's axes, in their order.
    order = ["xyz".index(axis) for axis in robot.base.attitude]
    matrix = module.mass_matrix(np.zeros(6))
    start = module.positions(np.zeros(6))[module.POINTS.index("O2")]
    x, y, z = start + found.com
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    about_origin = inertia_matrix(found) - found.mass * skew @ skew
    assert np.allclose(matrix[3:, 3:], found.mass * np.eye(3), rtol=1e-12)
    assert np.allclose(matrix[3:, :3], -found.mass * skew[:, order], atol=1e-12)
    assert np.allclose(matrix[:3, :3], about_origin[np.ix_(order, order)], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("links", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_hover_thrusts_hold_the_machine(links: int) -> None:
    """With an arm, where it hangs."""
    base = machine("{ " + ARM.format(com="0.2, 0.01, -0.05") + " }")
    robot = replace(base, links=paper_family(6, links).links)
    module, found = emitted_module(robot), hover(robot)
    q, u = np.zeros(6 + links), np.zeros(6 + links)
    q[3 + links - 1] = -np.pi / 2 if links else 0.0
    assert found.thrusts is not None
    u[:6] = found.thrusts
    acceleration = module.forward_dynamics(q, np.zeros(6 + links), u)
    assert np.allclose(acceleration, 0.0, atol=1e-9)


def test_hover_thrusts_are_of_least_norm() -> None:
    thrusts = hover(paper_family(8, 0)).thrusts
    assert thrusts == pytest.approx((4 * 9.81 / 4, 0.0) * 4)
    assert "9.81, 0, 9.81, 0" in balance_lines(paper_family(8, 0))[2]
    many = balance_lines(paper_family(20, 0))[2]
    assert many.startswith("hover thrusts: 0 to 9.81 N")


def test_thrusts_that_cannot_carry_the_weight() -> None:
    robot = paper_family(3, 0)
    flat = replace(robot.base, thrust=((0.0, 1.0, 0.0),) * 3)
    flat_robot = replace(robot, base=flat)
    assert hover(flat_robot).thrusts is None
    assert balance_lines(flat_robot)[2].startswith("hover thrusts: no thrusts carry the weight")


@pytest.mark.parametrize("name", shipped_robots())
def test_robots_that_ship_are_balanced(name: str) -> None:
    """Published robots are as they are; where the base is made of arms, the arms balance."""
    robot = read_robot(name)[0]
    assert not robot.base.arms or base_properties(robot).com[:2] == (0.0, 0.0)
    assert lopsided(robot) is None


@pytest.mark.parametrize("com", ["0.23, 0, 0.01", "0.15, 0.02, 0", "0.1, -0.05, 0.03"])
def test_the_remedy_for_one_table_off_the_middle_balances_the_base(com: str) -> None:
    robot = machine("{ " + ARM.format(com=com) + " }")
    warning = lopsided(robot)
    assert warning
    assert "last two entries of inertia of opposite sign" in warning
    (first,) = re.findall(r"com = \[(.*?)\]", warning)
    others = ["{ " + ARM.format(com=com) + " }"] * 5
    arm_1 = "{ " + ARM.format(com=first).replace("2e-5, 3e-5", "-2e-5, -3e-5") + " }"
    remedied = machine(f"[{', '.join([arm_1, *others])}]")
    found = base_properties(remedied)
    assert np.hypot(*found.com[:2]) < 1e-9
    assert lopsided(remedied) is None
    # Six arms that are alike have no principal axis of their own in the plane.
    assert inertia_matrix(found) == pytest.approx(
        np.diag(np.diag(inertia_matrix(found))), abs=1e-12
    )
    assert found.inertia[0] == pytest.approx(found.inertia[1])


def test_the_base_of_the_issue_is_twenty_seven_millimetres_off() -> None:
    robot = machine("{ " + ARM.format(com="0.23, 0, 0") + " }")
    found = base_properties(robot)
    assert found.com[0] == pytest.approx(0.16 / 6)
    assert "0.0267 m off its axis, 0.089 of the arms' length" in str(lopsided(robot))


@pytest.mark.parametrize(("offset", "warns"), [(0.0029, False), (0.0031, True)])
def test_the_limit_is_a_hundredth_of_the_arms_length(offset: float, warns: bool) -> None:
    tables = [RigidBody(0.3, 1.0, (0.15, 0.0, 0.0)) for _ in range(4)]
    # All the others balance each other: 4 kg in all, of which one is moved by four times as much.
    tables[1] = RigidBody(0.3, 1.0, (0.15 + 4 * offset, 0.0, 0.0))
    robot = paper_family(4, 0)
    robot = replace(robot, base=replace(robot.base, arms=tuple(tables)))
    warning = lopsided(robot)
    assert bool(warning) == warns
    assert not warns or "in each table of base.arm" in str(warning)


def test_a_base_without_mass_or_arms_of_no_length_are_not_warned_of() -> None:
    link = "[[link]]\nmass = 1\ninertia = [1, 1, 1, 0, 0, 0]\n"
    for arm in ("{ length = 0.5 }", "{ length = 0, mass = 1, com = [0.1, 0, 0] }"):
        text = f'name = "bare"\n[base]\nrotors = 4\narm = {arm}\n{link}'
        robot = parse_robot(text)
        found = base_properties(robot)
        assert np.isfinite([*found.com, *found.inertia]).all()
        assert lopsided(robot) is None


def test_a_rod_as_a_rigid_body() -> None:
    body = as_rigid_body(Rod(length=2.0, mass_per_length=3.0, section_inertia=(0.1, 0.2, 0.3)))
    assert (body.length, body.mass, body.com) == (2.0, 6.0, (1.0, 0.0, 0.0))
    assert body.inertia == (0.1, 2.2, 2.3, 0.0, 0.0, 0.0)
    assert as_rigid_body(body) is body
