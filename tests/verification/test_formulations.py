"""Every formulation against Pinocchio, whose tree is built from the robot by other code.

`pinocchio_oracle` shares nothing with `verification.tree`, so both readings of the robot file are
compared here too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from support.emitted import NUMPY
from support.machines import cart
from support.pages import blocks
from support.pinocchio_oracle import InPinocchio, Oracle
from support.planted_faults import planted
from support.random_robots import random_robot, random_tree, robots, trees

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base, alternating_thrust
from gibbs_codegen.robot.parts.body import RigidBody, Rod
from gibbs_codegen.targets.registry import render_module
from gibbs_codegen.verification.comparison import Results
from gibbs_codegen.verification.equations import Expected, input_matrix
from gibbs_codegen.verification.formulation import (
    Formulation,
    NotApplicableError,
    formulated,
)
from gibbs_codegen.verification.lagrange import Lagrange
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.parameters import InOwnUnits, parameter_values, with_values
from gibbs_codegen.verification.pinocchio_tree import Pinocchio
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.verify import formulations, module_of

# Exact formulations to rounding; Lagrange's differences of fourth order to their truncation.
EXACT, BY_DIFFERENCES = 1e-12, 1e-8
BY_BODIES = ("centre_of_mass", "centre_jacobian", "momentum", "gravity_forces")
NOT_COMPUTED = {("MuJoCo", name) for name in ("positions", "bias_accelerations", *BY_BODIES)}
NOT_COMPUTED |= {
    (name, f"{loaded}joint_wrenches")
    for name in ("MuJoCo", "Lagrange", "Pinocchio")
    for loaded in ("", "loaded_")
}
# These robots have no actuators.
EVERY = ("Newton–Euler", "MuJoCo", "Lagrange", "Pinocchio")
NOT_COMPUTED |= {(name, "actuators") for name in EVERY}


def assert_agree(formulation: Formulation, robot: Robot, tolerance: float) -> None:
    """All that a formulation gives, relative to the norm of what the oracle gives."""
    oracle, states = Oracle(robot), States.random(formulation.tree, 2, 5)
    expected = InPinocchio(oracle, formulation.tree).at(states)
    found = formulation.at(states).with_passive(formulation.tree, states)
    inputs = input_matrix(formulation.tree, found)
    pairs = [*zip(found._fields, found, expected, strict=True)]
    pairs.append(("input_matrix", inputs, [oracle.input_matrix(x) for x in states.q]))
    for name, ours, theirs in pairs:
        if ours is None:
            assert (formulation.name, name) in NOT_COMPUTED
            continue
        theirs = np.array(theirs)
        assert ours.shape == theirs.shape, name
        error = np.linalg.norm(ours - theirs) / max(np.linalg.norm(theirs), 1e-3)
        assert error < tolerance, f"{name}: {error:.1e}"


@pytest.mark.slow
@settings(max_examples=6)
@given(robot=robots(most_rotors=7, most_links=6) | trees())
def test_newton_euler(robot: Robot) -> None:
    assert_agree(formulated(NewtonEuler(Tree(robot))), robot, EXACT)


@pytest.mark.parametrize("robot", [random_robot(2, 5, 2), random_tree(1), random_tree(4)])
def test_lagrange(robot: Robot) -> None:
    assert_agree(formulated(Lagrange(Tree(robot))), robot, BY_DIFFERENCES)


@settings(max_examples=4)
@given(robot=robots(most_rotors=5, most_links=4) | trees())
def test_pinocchio(robot: Robot) -> None:
    assert_agree(formulated(Pinocchio(Tree(robot))), robot, EXACT)


def test_pinocchio_takes_what_rotors_leave_of_light_carriers() -> None:
    """A fixed base and a shaft without mass: less what is a rotor's, their inertia is negative."""
    link = "[[link]]\naxis = '{}'\nxyz = [0, 0, 0.1]\nmass = {}\n"
    link += "motor = {{ rotor_inertia = 1e-4, gear_ratio = 50 }}\n"
    text = "name = 'arm'\nbase = { motion = 'fixed' }\n" + link.format("y", 0)
    text += link.format("x", 1) + "com = [0, 0, 0.2]\ninertia = [0.01, 0.01, 1e-3, 0, 0, 0]\n"
    tree = Tree(parse_robot(text))
    assert sum(joint.inertia.min() < 0.0 for joint in tree.joints) == 2
    states = States.random(tree, 2, 5)
    ours, theirs = (formulated(kind(tree)).at(states) for kind in (Pinocchio, NewtonEuler))
    for name, a, b in zip(ours._fields, ours, theirs, strict=True):
        if a is not None:
            tolerance = EXACT * np.abs(b).max(initial=0.0)
            np.testing.assert_allclose(a, b, rtol=0, atol=tolerance, err_msg=name)


@pytest.mark.parametrize(
    "robot", [paper_family(5, 3), random_robot(3, 4, 5), random_tree(1), random_tree(4)]
)
def test_mujoco(robot: Robot) -> None:
    """One with a link without mass, one with joints of both kinds, and trees."""
    mujoco_tree = pytest.importorskip("gibbs_codegen.verification.mujoco_tree")
    assert_agree(formulated(mujoco_tree.MuJoCo(Tree(robot))), robot, EXACT)


@pytest.fixture
def of_rods(tmp_path: Path) -> Robot:
    """The robot of the README, whose links are thin rods."""
    (text,) = blocks("README.md", "toml")
    path = tmp_path / "my_uav.toml"
    path.write_text(text, encoding="utf-8")
    return read_robot(str(path))[0]


def test_mujoco_takes_thin_rods_and_points(of_rods: Robot) -> None:
    """It refuses both by itself, since some of their moments of inertia are zero."""
    mujoco_tree = pytest.importorskip("gibbs_codegen.verification.mujoco_tree")
    assert {link.body.section_inertia for link in of_rods.links} == {(0.0, 0.0, 0.0)}
    point = replace(of_rods.links[1], body=RigidBody(0.25, 0.1, (0.2, 0.0, 0.0)))
    at_joint = replace(of_rods.links[1], body=RigidBody(0.25, 0.1))
    for link in of_rods.links[1], point, at_joint:
        robot = replace(of_rods, links=(of_rods.links[0], link))
        assert_agree(formulated(mujoco_tree.MuJoCo(Tree(robot))), robot, EXACT)
        assert formulations(robot)[1].keys() <= {"Pinocchio"}


@pytest.mark.slow
def test_mujoco_finds_faults_in_modules_of_thin_rods(of_rods: Robot) -> None:
    mujoco_tree = pytest.importorskip("gibbs_codegen.verification.mujoco_tree")
    formulation = InOwnUnits(mujoco_tree.MuJoCo, of_rods)
    states = States.random(formulation.tree, 3, 0)
    expected = Expected(formulation, states)
    text = render_module(derive(of_rods), "", NUMPY)["numpy_module.py"]
    start = text.index("\ndef _mass_matrix_and_residual(")
    end = text.index("\ndef ", start + 1)

    def passes(kernel: str) -> bool:
        module = module_of(text[:start] + kernel + text[end:])
        return all(c.passed for c in expected.compare(Results(module).all(states)))

    assert passes(text[start:end])
    missed = [what for kernel, what in planted(text[start:end], 30, seed=3) if passes(kernel)]
    assert len(missed) <= 1, missed


@pytest.mark.parametrize("length", [1e-3, 1e5])
def test_own_units_are_turned_back(length: float) -> None:
    """Whatever is computed in them, of robots with joints of both kinds, small and large."""
    robot = random_robot(3, 4, 5)
    values = parameter_values(robot)
    lengths = ("length", "_a", "_d", "com_x", "com_y", "com_z")
    factors = {n: length for n in values if n.endswith(lengths) or n.startswith("base_drag")}
    factors |= {n: 0.01 * length**2 for n in values if "inertia" in n}
    factors |= {n: 0.01 / length for n in values if n.endswith("mass_per_length")}
    factors |= {n: 0.01 for n in values if n.endswith("_mass")}
    robot = with_values(robot, {n: factors.get(n, 1.0) * value for n, value in values.items()})
    tree = Tree(robot)
    states = States.random(tree, 2, 5)
    ours, theirs = InOwnUnits(NewtonEuler, robot).at(states), NewtonEuler(tree).at(states)
    for name, a, b in zip(ours._fields, ours, theirs, strict=True):
        if name == "actuators":
            continue
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-13 * np.abs(b).max(), err_msg=name)


def test_mujoco_says_what_it_refuses() -> None:
    """A body that moves needs mass there; an arm of the base without any is refused."""
    mujoco_tree = pytest.importorskip("gibbs_codegen.verification.mujoco_tree")
    tree = Tree(paper_family(4, 2))
    tree.joints[7] = _without_mass(tree.joints[7])
    with pytest.raises(NotApplicableError, match=r"MuJoCo rejects it: .*mass"):
        mujoco_tree.MuJoCo(tree)
    wheeled = parse_robot(cart("cart", com=[0, 0, 0], moments=[1, 1, 1]))
    with pytest.raises(NotApplicableError, match="rejects it: left moves, without"):
        mujoco_tree.MuJoCo(Tree(wheeled))


def _without_mass(joint: Any) -> Any:
    return type(joint)(**{**vars(joint), "mass": 0.0, "inertia": np.zeros((3, 3))})


@pytest.mark.parametrize(
    ("formulation", "state", "effort"),
    [
        # Hand-worked: a base of two arms, 1 kg each, 1 m long, both ways along x, held level at
        # rest. It weighs 2 kg · 10 m/s², and the half on either side balances about the centre.
        (NewtonEuler, "rest", {"z": 20.0}),
        (Lagrange, "rest", {"z": 20.0}),
        # Turning about z at 3 rad/s, each arm pulls with m ω² l/2; both pulls cancel, and θ₁ has
        # no moment at a steady rate.
        (NewtonEuler, "turning", {"z": 20.0}),
        (Lagrange, "turning", {"z": 20.0}),
    ],
)
def test_a_rod_worked_by_hand(
    formulation: Callable[[Tree], Formulation], state: str, effort: dict[str, float]
) -> None:
    base = Base(
        rotors=2,
        arms=(Rod(length=1.0, mass_per_length=1.0),),
        thrust=alternating_thrust(2),
        drag=(0.0, 0.0),
        origin="centre",
    )
    tree = Tree(Robot("rod", base, (), gravity=10.0))
    q = np.zeros((1, 6))
    v = np.zeros((1, 6))
    if state == "turning":
        v[0, 2] = 3.0
    still = States(q, v, np.zeros((1, 6)), np.zeros((1, 2)), np.zeros((1, 2, 6)))
    found = formulation(tree).at(still).inverse_dynamics[0][tree.free]
    expected = np.zeros(6)
    expected[5] = effort["z"]
    np.testing.assert_allclose(found, expected, atol=1e-9)
