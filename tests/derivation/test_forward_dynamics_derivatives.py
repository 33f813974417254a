"""Structured derivatives of forward dynamics, against a complex step of forward dynamics itself."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np
import pytest
import sympy as sp
from support.complex_tape import derivatives, entries, inputs_at, stepped, tape_values
from support.random_robots import random_robot, random_tree

from benchmarks.family import benchmark_robot
from gibbs_codegen.derivation.forces import input_matrix
from gibbs_codegen.derivation.forward_dynamics import articulated_dynamics
from gibbs_codegen.derivation.forward_dynamics_derivatives import (
    ForwardDynamicsDerivatives,
    forward_dynamics_derivatives,
)
from gibbs_codegen.derivation.hybrid import reduced_system
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.program.lower import Slice, lower
from gibbs_codegen.program.nodes import count_operations
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.symbolic.tape import Tape

TOLERANCE = 1e-11
WAYS = (True, False)
# With joints of both kinds, branches, rotors on links, springs, dampers and armature; odd seeds
# have a quaternion. The others have all six sequences of angles, and each origin.
ROBOTS = {
    **{f"tree_{seed}": random_tree(seed) for seed in range(8)},
    **{f"random_{seed}": random_robot(seed, 2 + seed % 5, seed % 5) for seed in range(6)},
    **{
        name: read_robot(name)[0]
        for name in ("octorotor_7link", "hydrus", "dual_arm", "hextilt_flying_arm_5")
    },
}
Point = dict[str, np.ndarray]


def flat(matrix: Sequence[Sequence[sp.Expr]]) -> tuple[sp.Expr, ...]:
    """Entries of a matrix, row by row."""
    return tuple(chain.from_iterable(matrix))


def random_point(symbolic: SymbolicRobot, seed: int) -> Point:
    """Coordinates, velocities and inputs."""
    rng = np.random.default_rng(seed)
    point = {name: rng.uniform(-1.0, 1.0, len(getattr(symbolic, name))) for name in "qvu"}
    if symbolic.description.layout.is_quaternion:
        point["q"][symbolic.description.layout.q.attitude] /= np.linalg.norm(
            point["q"][symbolic.description.layout.q.attitude]
        )
    return point


def tangent(symbolic: SymbolicRobot, tape: Tape, point: Point) -> np.ndarray:
    """Rates of the coordinates for a unit of each velocity: a basis of the tangent space."""
    wanted = symbolic.coordinate_rates(symbolic.v)
    steps = stepped(np.zeros(len(symbolic.v)), np.eye(len(symbolic.v)))
    values = tape_values(tape, inputs_at(symbolic, {**point, "v": steps}))
    return derivatives(values, wanted, len(symbolic.v))


def stepped_dynamics(
    symbolic: SymbolicRobot, tape: Tape, accelerations: Sequence[sp.Expr], point: Point
) -> dict[str, np.ndarray]:
    """Derivatives of the accelerations by q, v and u."""
    found = {}
    bases = {"q": tangent(symbolic, tape, point)}
    bases |= {name: np.eye(len(point[name])) for name in "vu"}
    for name, basis in bases.items():
        moved = {**point, name: stepped(point[name], basis)}
        values = tape_values(tape, inputs_at(symbolic, moved))
        found[name] = derivatives(values, accelerations, basis.shape[1])
    return found


def matrices(
    symbolic: SymbolicRobot, tape: Tape, point: Point, structured: ForwardDynamicsDerivatives
) -> dict[str, np.ndarray]:
    """The structured derivatives by q, v and u, in numbers."""
    values = tape_values(tape, inputs_at(symbolic, point))
    rows = len(symbolic.v)
    parts = (
        structured.acceleration_dq,
        structured.acceleration_dv,
        structured.acceleration_du,
    )
    return {
        name: entries(values, flat(matrix)).reshape(rows, -1)
        for name, matrix in zip("qvu", parts, strict=True)
    }


@pytest.mark.slow
def test_derivatives_are_those_of_forward_dynamics() -> None:
    """In both ways in which a change's effect on its own parent is found."""
    tape = Tape()
    symbolic = SymbolicRobot.of(ROBOTS["random_4"], tape)
    accelerations = articulated_dynamics(symbolic)
    structured = [forward_dynamics_derivatives(symbolic, by_inertia=way) for way in WAYS]
    point = random_point(symbolic, 7)
    expected = stepped_dynamics(symbolic, tape, accelerations, point)
    for one in structured:
        assert one.acceleration == accelerations
        found = matrices(symbolic, tape, point, one)
        for argument, matrix in expected.items():
            error = np.abs(found[argument] - matrix).max(initial=0.0)
            assert error <= TOLERANCE * np.abs(matrix).max(initial=0.0), argument


@pytest.mark.slow
def test_what_is_zero_or_linear() -> None:
    """The position moves nothing, and inputs act by M⁻¹B."""
    robot = benchmark_robot(3)
    tape = Tape()
    symbolic = SymbolicRobot.of(robot, tape)
    structured = forward_dynamics_derivatives(symbolic)
    position = symbolic.places.position
    assert all(entry == 0 for row in structured.acceleration_dq for entry in row[position])
    mass, forces = reduced_system(symbolic).matrix, input_matrix(symbolic)
    point = random_point(symbolic, 1)
    by_inputs = matrices(symbolic, tape, point, structured)["u"]
    values = tape_values(tape, inputs_at(symbolic, point))
    rows = len(symbolic.v)
    product = entries(values, flat(mass)).reshape(rows, rows) @ by_inputs
    np.testing.assert_allclose(product, entries(values, flat(forces)).reshape(rows, -1), atol=1e-11)


def count(robot: Robot) -> int:
    """Operations of the function with all derivatives."""
    tape = Tape()
    symbolic = SymbolicRobot.of(robot, tape)
    found = forward_dynamics_derivatives(symbolic)
    v, u = len(symbolic.v), len(symbolic.u)
    outputs = (
        ((v,), tuple(found.acceleration)),
        ((v, v), flat(found.acceleration_dq)),
        ((v, v), flat(found.acceleration_dv)),
        ((v, u), flat(found.acceleration_du)),
    )
    inputs = {name: tuple(s.name for s in getattr(symbolic, name)) for name in "qvu"}
    names = tuple(symbolic.parameters.defaults)
    program = lower(tape, inputs, names, [Slice("derivatives", ("q", "v", "u"), outputs)])
    return count_operations(program.function("derivatives").nodes()).total


@pytest.mark.slow
def test_operations_are_as_few_as_they_were() -> None:
    """Whoever finds a shorter way changes the numbers; whoever makes it longer is told."""
    assert count(benchmark_robot(3, attitude="quaternion")) == 1251
