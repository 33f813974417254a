"""Constraints, coupling map and the hybrid system (eqs. 14–19, Figs. 6–9)."""

from __future__ import annotations

from fractions import Fraction
from types import ModuleType

import numpy as np
import pytest
from support.emitted import emitted_module
from support.random_robots import random_tree

from gibbs_codegen.derivation.hybrid import (
    LinearSystem,
    chain_system,
    hybrid_from_chains,
    hybrid_system,
    reduced_system,
)
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.program.lower import Slice, lower
from gibbs_codegen.robot.chains import coupling_map, decompose
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.parts.body import RigidBody
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.parts.rotor import Rotor
from gibbs_codegen.symbolic.tape import Tape


def numbers(symbolic: SymbolicRobot, system: LinearSystem, q: np.ndarray, v: np.ndarray) -> list:
    """Matrix, residual and inputs of a system at a state, by interpreting the tape."""
    parts = [system.matrix, [system.residual], system.inputs]
    outputs = tuple(
        ((len(part), len(part[0])), tuple(entry for row in part for entry in row)) for part in parts
    )
    inputs = {
        "q": tuple(s.name for s in symbolic.q),
        "v": tuple(s.name for s in symbolic.v),
    }
    defaults = symbolic.parameters.defaults
    program = lower(symbolic.tape, inputs, tuple(defaults), [Slice("system", ("q", "v"), outputs)])
    values = program.evaluate("system", defaults, {"q": q, "v": v})
    return [np.array(v).reshape(shape) for v, (shape, _) in zip(values, outputs, strict=True)]


def random_state(module: ModuleType, seed: int = 3) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    n = len(module.COORDINATES)
    return (*rng.normal(size=(2, n)), rng.normal(size=len(module.INPUTS)))


def test_rows_of_the_papers_robot_are_in_the_papers_order() -> None:
    """θ̈₋₁ … θ̈₁, θ̈₂ … θ̈₆, θ̈₇ … θ̈₉, ẍ, ÿ, z̈, τ'₂ … τ'₆: 19 rows, counted from −1."""
    robot = read_robot("hexarotor_3link")[0]
    names = [c.name for c in Description(robot).hybrid_coordinates]
    angles = ["theta_m1", *(f"theta_{k}" for k in range(10))]
    assert names == [*angles, "x", "y", "z", *(f"tau_prime_{k}" for k in range(2, 7))]
    assert len(names) == 19


def test_chain_five_takes_the_rows_that_the_paper_names() -> None:
    rows = [place - 1 for place in coupling_map(read_robot("hexarotor_3link")[0])[4]]
    assert rows == [-1, 0, 1, 6, 10, 11, 12, 17]


@pytest.mark.parametrize("number", range(1, 6))
def test_constrained_chain_has_the_form_of_eq_15(number: int) -> None:
    robot = read_robot("hexarotor_3link")[0]
    symbolic = SymbolicRobot.of(robot, Tape())
    chain = decompose(robot)[number - 1]
    system = chain_system(symbolic, number)
    assert len(system.matrix) == len(system.residual) == len(chain.unknowns) == 8
    assert system.matrix[7] == [0, 0, 0, 1, 0, 0, 0, 0]
    assert [row[7] for row in system.matrix] == [0, 0, 0, -1, 0, 0, 0, 0]
    assert system.residual[7] == 0
    pushing = {j + 1 for j in range(6) if any(row[j] != 0 for row in system.inputs)}
    assert pushing == ({1, 2} if number == 1 else {number + 1})


def test_free_chain_has_no_constraint() -> None:
    robot = read_robot("hexarotor_3link")[0]
    system = chain_system(SymbolicRobot.of(robot, Tape()), 6)
    assert len(system.matrix) == 9


# A tree in which held links carry others, between links that move.
@pytest.mark.slow
def test_chains_of_a_tree_add_up_to_the_emitted_hybrid_system() -> None:
    check_chains(random_tree(16, "tait_bryan"))


def test_what_holds_a_hand_is_shared_by_its_fingers() -> None:
    """The wrist is held: each finger's chain has the joint, the first has the wrist's mass too."""
    body = RigidBody(0.3, 1.0, (0.1, 0.02, 0.03), (0.01, 0.02, 0.02, 0.001, 0.0, 0.0))
    links = (
        Link(body, name="arm"),
        Link(body, joint="fixed", constrained=True, alpha_deg=Fraction(90), name="wrist"),
        Link(body, name="thumb"),
        Link(body, joint="prismatic", parent=2, name="finger"),
    )
    base = Base(origin="base", body=body)
    robot = Robot("hand", base, links, thrusters=(Rotor(on=2), Rotor(on=4)))
    thumb, finger = decompose(robot)
    assert (thumb.path, thumb.own, thumb.motors) == ((1, 2, 3), (1, 2, 3), (1,))
    assert (finger.path, finger.own, finger.motors) == ((1, 2, 4), (4,), (2,))
    assert thumb.constrained == finger.constrained == (4,)
    check_chains(robot)


def check_chains(robot: Robot) -> None:
    """Eq. 18 against the combiner's short cut, on one tape."""
    symbolic = SymbolicRobot.of(robot, Tape())
    rng = np.random.default_rng(5)
    q, v = rng.normal(size=len(symbolic.q)), rng.normal(size=len(symbolic.v))
    layout = layout_of(robot)
    if layout.is_quaternion:
        q[layout.q.attitude] /= np.linalg.norm(q[layout.q.attitude])
    emitted = numbers(symbolic, hybrid_system(symbolic, reduced_system(symbolic)), q, v)
    added = numbers(symbolic, hybrid_from_chains(symbolic), q, v)
    for ours, theirs in zip(emitted, added, strict=True):
        assert np.linalg.norm(ours - theirs) <= 1e-12 * max(1.0, float(np.linalg.norm(theirs)))


@pytest.mark.slow
@pytest.mark.parametrize(
    "robot",
    [pytest.param(read_robot("hexarotor_3link")[0], marks=pytest.mark.slow), paper_family(4, 2)],
    ids=lambda robot: robot.name,
)
def test_hybrid_system_gives_the_reduced_accelerations(robot: Robot) -> None:
    """Eq. 19 solved: θ̈ = 0 on the constrained rows, the reduced accelerations elsewhere."""
    module = emitted_module(robot)
    for seed in range(40):
        q, v, u = random_state(module, seed)
        right = module.hybrid_residual(q, v) + module.hybrid_input_matrix(q) @ u
        solution = np.linalg.solve(module.hybrid_mass_matrix(q), right)
        names = module.HYBRID_COORDINATES
        held = [names.index(f"theta_{k}") for k in range(2, robot.rotors + 1)]
        free = [names.index(name) for name in module.COORDINATES]
        torques = [names.index(f"tau_prime_{k}") for k in range(2, robot.rotors + 1)]
        matrix, residual = module.mass_matrix_and_residual(q, v)
        reduced = np.linalg.solve(matrix, residual + module.input_matrix(q) @ u)
        # Any solution is off by the condition number times ε: 1e-12 up to a condition of 4e3, which
        # an arm that is nearly stretched, its rods as good as free to spin, exceeds.
        size = np.linalg.norm(reduced) * max(1.0, np.linalg.cond(matrix) / 4e3)
        assert np.linalg.norm(solution[held]) <= 1e-12 * size
        assert np.linalg.norm(solution[free] - reduced) <= 1e-12 * size
        assert np.linalg.norm(module.forward_dynamics(q, v, u) - reduced) <= 1e-12 * size
        direct = module.constraint_torques(q, v, reduced, u)
        assert np.linalg.norm(solution[torques] - direct) <= 1e-12 * size
