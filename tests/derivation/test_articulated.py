"""Forward dynamics by articulated bodies, against M's factors and against Pinocchio; the choice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
import sympy as sp
from support.pinocchio_oracle import Oracle
from support.random_robots import SEQUENCES, random_robot

from benchmarks.family import benchmark_robot
from gibbs_codegen.derivation.articulated import SolvedJoint
from gibbs_codegen.derivation.articulated_derivatives import with_joint
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.derivation.forward_dynamics import articulated_dynamics, factorised_dynamics
from gibbs_codegen.derivation.inertia import ArticulatedInertia, Inertia
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.errors import SingularRobotError
from gibbs_codegen.program.lower import Slice, lower
from gibbs_codegen.program.nodes import ScalarProgram, count_operations
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import ROD_ORIGINS
from gibbs_codegen.robot.parts.body import Rod
from gibbs_codegen.robot.parts.link import JOINT_KINDS, Link
from gibbs_codegen.symbolic.ldlt import (
    ZeroPivotError,
    minimum_degree,
    operations_to_solve,
    solve_symmetric,
)
from gibbs_codegen.symbolic.tape import InlineTape, Stage, Tape
from gibbs_codegen.symbolic.vectors import Rotation

TOLERANCE = 1e-10
WAYS = ("articulated", "factorised")
RANDOM_ROBOTS = [random_robot(seed, 2 + seed % 5, seed % 9) for seed in range(18)]


def both_ways(robot: Robot, keep_zeros: bool = False) -> tuple[ScalarProgram, dict[str, float]]:
    """A program of two functions, forward dynamics in one way and in the other, and parameters."""
    tape = Tape()
    symbolic = SymbolicRobot.of(robot, tape, keep_zeros)
    found = articulated_dynamics(symbolic), factorised_dynamics(symbolic, most=10**9)
    slices = [
        Slice(name, ("q", "v", "u"), (((len(entries),), tuple(entries)),))
        for name, entries in zip(WAYS, found, strict=True)
        if entries is not None
    ]
    symbols = zip("qvau", (symbolic.q, symbolic.v, symbolic.a, symbolic.u), strict=True)
    inputs = {name: tuple(symbol.name for symbol in group) for name, group in symbols}
    defaults = symbolic.parameters.defaults
    return lower(tape, inputs, tuple(defaults), slices), defaults


def operations(program: ScalarProgram, name: str) -> int:
    return count_operations(program.function(name).nodes()).total


def relative(ours: np.ndarray, theirs: np.ndarray) -> float:
    return float(np.linalg.norm(ours - theirs) / np.linalg.norm(theirs))


def compare(robot: Robot, keep_zeros: bool = False, states: int = 2) -> None:
    """Both ways against M a = R + B u of the oracle and, at θ₀ = ±90°, against each other."""
    program, parameters = both_ways(robot, keep_zeros)
    oracle = Oracle(robot)
    rng = np.random.default_rng(0)
    n = len(program.inputs["q"])
    for _ in range(states):
        q, v = rng.uniform(-np.pi, np.pi, n), rng.normal(size=n)
        q[1] = rng.uniform(-1.2, 1.2)
        u = rng.normal(size=len(program.inputs["u"]))
        free = oracle.free
        mass = oracle.mass_matrix(q)[np.ix_(free, free)]
        right = (oracle.input_matrix(q) @ u - oracle.inverse_dynamics(q, v, np.zeros(n)))[free]
        exact = np.linalg.solve(mass, right)
        arguments = {"q": q.tolist(), "v": v.tolist(), "u": u.tolist()}
        for way in WAYS:
            a = np.array(program.evaluate(way, parameters, arguments)[0])
            assert relative(mass @ a, right) < TOLERANCE, f"{way}: {robot}"
            if np.linalg.cond(mass) < 1e5:
                assert relative(a, exact) < TOLERANCE, f"{way}: {robot}"
        if np.linalg.cond(mass) < 1e5:
            q[1] = np.copysign(np.pi / 2, q[1])
            arguments["q"] = q.tolist()
            one, other = (np.array(program.evaluate(way, parameters, arguments)[0]) for way in WAYS)
            # These two grow as the inverse, and would hide all others.
            for a in (one, other):
                a[[0, 2]] *= np.cos(q[1])
            assert relative(one, other) < TOLERANCE, robot


@pytest.mark.slow
def test_both_ways_give_what_pinocchio_gives() -> None:
    for robot in RANDOM_ROBOTS[:4]:
        compare(robot)


def test_the_random_robots_have_every_structure() -> None:
    assert {robot.base.attitude for robot in RANDOM_ROBOTS} == set(SEQUENCES)
    assert {robot.base.origin for robot in RANDOM_ROBOTS} == set(ROD_ORIGINS)
    assert {len(robot.links) for robot in RANDOM_ROBOTS} == set(range(9))
    joints = {link.joint for robot in RANDOM_ROBOTS for link in robot.links}
    assert joints == set(JOINT_KINDS)


@pytest.mark.slow
def test_the_family_with_both_origins_and_zeros_kept() -> None:
    """Arms in a plane, and a first link without length or mass."""
    robot = paper_family(5, 0)
    compare(robot)
    compare(replace(robot, base=replace(robot.base, origin="centre")), keep_zeros=True)


@cache
def articulated_operations(links: int) -> int:
    """Operations of the recursion alone, for the benchmark family."""
    tape = Tape()
    symbolic = SymbolicRobot.of(benchmark_robot(links), tape)
    entries = tuple(articulated_dynamics(symbolic))
    piece = Slice("articulated", ("q", "v", "u"), (((len(entries),), entries),))
    program = lower(tape, {}, tuple(symbolic.parameters.defaults), [piece])
    return operations(program, "articulated")


def test_operations() -> None:
    assert articulated_operations(3) <= 365


@pytest.mark.slow
def test_the_way_with_fewer_operations_is_emitted() -> None:
    robot, shorter = benchmark_robot(2), "articulated"
    program, _ = both_ways(robot)
    found = {way: operations(program, way) for way in WAYS}
    assert min(WAYS, key=found.__getitem__) == shorter, found
    # Signs depend on what else is on the tape.
    emitted = operations(derive(robot).program, "forward_dynamics")
    assert emitted == pytest.approx(found[shorter], rel=0.01)
    assert emitted < max(found.values())


@pytest.mark.slow
def test_factors_that_cannot_win_are_not_derived() -> None:
    """What is left is the matrix: nothing is divided by but the mass."""
    symbolic = SymbolicRobot.of(benchmark_robot(30), tape := Tape())
    assert factorised_dynamics(symbolic, most=articulated_operations(30)) == []
    assert sum(value.is_Pow for value in tape.statements.values()) == 1


NOTHING, ROD = (
    Rod(length=0.0),
    Rod(length=1.0, mass_per_length=1.0, section_inertia=(1e-3, 1e-3, 1e-3)),
)


@pytest.mark.parametrize(
    ("arm", "coordinate"),
    [
        ((Link(ROD), Link(NOTHING, alpha_deg=Fraction(90))), "theta_6"),
        ((Link(ROD), Link(NOTHING, alpha_deg=Fraction(90), joint="prismatic")), "d_6"),
        ((Link(ROD), Link(NOTHING, alpha_deg=Fraction(90)), Link(ROD)), "theta_6"),
    ],
)
def test_an_undetermined_joint_is_named(arm: tuple[Link, ...], coordinate: str) -> None:
    """A tip without mass, and two joints about one axis with nothing between them."""
    robot = replace(paper_family(4, 2), links=arm)
    with pytest.raises(SingularRobotError) as refused:
        articulated_dynamics(SymbolicRobot.of(robot, Tape()))
    assert refused.value.joints[0].startswith(coordinate)
    for keep_zeros in (False, True):
        with pytest.raises(SingularRobotError, match=r"theta_|d_"):
            derive(robot, keep_zeros)


@pytest.mark.slow
def test_a_link_without_mass_is_fine_where_others_resist() -> None:
    arm = (Link(NOTHING), Link(NOTHING, alpha_deg=Fraction(90)), Link(ROD, alpha_deg=Fraction(-90)))
    compare(replace(paper_family(4, 2), links=arm))


def test_an_undetermined_root_is_named() -> None:
    base = replace(paper_family(4, 2).base, arms=(Rod(length=0.5, mass_per_length=0.0),))
    for arm, coordinate in (((), "theta_1"), ((Link(ROD, alpha_deg=Fraction(90)),), "theta_0")):
        with pytest.raises(SingularRobotError) as refused:
            articulated_dynamics(SymbolicRobot.of(Robot("hollow", base, arm), Tape()))
        assert refused.value.joints == (coordinate,)


def numbers(rows: Sequence[Sequence[sp.Expr]]) -> np.ndarray:
    return np.array([[float(entry) for entry in row] for row in rows])


def symmetric(size: int) -> np.ndarray:
    half = np.random.default_rng(3).normal(size=(size, size))
    return half + half.T


def articulated(matrix: np.ndarray) -> ArticulatedInertia:
    return ArticulatedInertia.of_entries(lambda i, j: sp.Float(matrix[i, j]))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("degrees", [0, 37, 90, 180, -90])
def test_rotation(axis: int, degrees: int) -> None:
    """Also of a matrix that no rigid body has."""
    matrix, tape = symmetric(6), InlineTape()
    rotation = Rotation.degrees(axis, Fraction(degrees))
    columns = [rotation.vector(tape, tuple(row)) for row in sp.eye(3).tolist()]
    turn = np.kron(np.eye(2), np.array(columns, dtype=float).T)
    turned = articulated(matrix).rotated(tape, rotation)
    np.testing.assert_allclose(numbers(turned.rows), turn @ matrix @ turn.T, atol=1e-13)


@pytest.mark.parametrize("arm", [(0, 0, 0), (2, 0, 0), (0.5, -1.5, 0), (0, 0, 3), (1, 2, -0.7)])
def test_shift(arm: tuple[float, float, float]) -> None:
    """The old point at `arm` has the acceleration r̈ + ω̇ × arm."""
    matrix = symmetric(6)
    passed = np.eye(6)
    passed[:3, 3:] = np.cross(np.eye(3), arm).T
    x, y, z = map(sp.nsimplify, arm)
    shifted = articulated(matrix).shifted(InlineTape(), (x, y, z))
    np.testing.assert_allclose(numbers(shifted.rows), passed.T @ matrix @ passed, atol=1e-13)


def test_a_rigid_body_is_shifted_as_its_ten_numbers_are() -> None:
    tape = InlineTape()
    m, x, y, z, *second = sp.symbols("m x y z xx yy zz xy xz yz")
    body = Inertia(m, (x, y, z), tuple(second))
    arm = sp.symbols("a b c")
    shifted = ArticulatedInertia.rigid(tape, body).shifted(tape, arm)
    expected = ArticulatedInertia.rigid(tape, body.shifted(tape, arm))
    assert sp.Matrix(shifted.rows).expand() == sp.Matrix(expected.rows).expand()


@pytest.mark.parametrize("direction", [2, 5])
def test_schur_complement(direction: int) -> None:
    matrix = symmetric(6)
    column, pivot = matrix[direction], matrix[direction, direction]
    ratios = tuple(sp.Float(entry) for entry in column / pivot)
    rest = numbers(articulated(matrix).without(InlineTape(), direction, ratios).rows)
    expected = matrix - np.outer(column, column) / pivot
    np.testing.assert_allclose(rest, expected, atol=1e-13)
    assert not rest[direction].any()
    assert not rest[:, direction].any()


def rational(rows: Sequence[Sequence[sp.Expr]]) -> sp.Matrix:
    return sp.Matrix([[sp.Rational(float(entry)) for entry in row] for row in rows])


@pytest.mark.parametrize("direction", [2, 5])
@pytest.mark.parametrize("ratio", [1e-10, 0.3])
def test_little_armature_keeps_its_digits(direction: int, ratio: float) -> None:
    """Inwards U − U·D/(D + J), and outwards (1 − D/(D + J))·Y, against exact arithmetic."""
    matrix, tape, unit = symmetric(6), InlineTape(), sp.eye(6)[:, direction]
    armature = float(abs(matrix[direction, direction]) * ratio)
    inertia = articulated(matrix)
    pivot = sp.Rational(matrix[direction, direction]) + sp.Rational(armature)
    column = rational(inertia.rows)[:, direction]
    ratios = tuple(sp.Float(float(entry / pivot)) for entry in column)
    found = inertia.without(tape, direction, ratios, sp.Float(armature)).rows
    exact = rational(inertia.rows) - column * column.T / pivot
    near = np.array(exact, dtype=float)
    np.testing.assert_allclose(numbers(found)[direction], near[direction], rtol=1e-15)
    np.testing.assert_allclose(numbers(found), near, atol=1e-13)

    alone = tuple(r if i == direction else sp.S.Zero for i, r in enumerate(ratios))
    joint = SolvedJoint(direction, alone, sp.S.Zero, sp.Float(float(1 / pivot)), sp.Float(armature))
    passed = with_joint(tape, joint, inertia.rows).rows
    given = sp.eye(6) - unit * unit.T * column[direction] / pivot
    outward = given * rational(inertia.rows) * given + unit * unit.T / pivot
    first = [(i + 3) % 6 for i in range(6)]  # ω̇ before r̈.
    expected = np.array(outward, dtype=float)[np.ix_(first, first)]
    np.testing.assert_allclose(numbers(passed), expected, rtol=1e-14)


def named_system(tape: Tape, size: int, zeros: set[tuple[int, int]]) -> list[list[sp.Expr]]:
    def entry(i: int, j: int) -> sp.Expr:
        if (min(i, j), max(i, j)) in zeros:
            return sp.S.Zero
        return tape.symbol(f"m_{min(i, j)}_{max(i, j)}", Stage.MOTION)

    return [[entry(i, j) for j in range(size)] for i in range(size)]


@pytest.mark.parametrize("zeros", [set(), {(0, 1), (2, 3)}, {(0, 1), (0, 2), (0, 3), (0, 4)}])
@pytest.mark.parametrize("order", [[0, 1, 2, 3, 4], [4, 2, 0, 1, 3]])
def test_ldlt_solves_and_its_operations_are_known_before(
    zeros: set[tuple[int, int]], order: list[int]
) -> None:
    tape = Tape()
    matrix = named_system(tape, 5, zeros)
    right = [tape.symbol(f"b_{i}", Stage.MOTION) for i in range(5)]
    solution = solve_symmetric(tape, matrix, right, order)
    inputs = [symbol for row in matrix for symbol in row if symbol != 0]
    names = tuple(dict.fromkeys(symbol.name for symbol in (*inputs, *right)))
    piece = Slice("solve", ("q",), (((5,), tuple(solution)),))
    program = lower(tape, {"q": names}, (), [piece])
    given = dict(zip(names, np.random.default_rng(1).uniform(1, 9, len(names)), strict=True))
    found = program.evaluate("solve", {}, {"q": list(given.values())})[0]
    system = np.array([[given[e.name] if e != 0 else 0.0 for e in row] for row in matrix])
    np.testing.assert_allclose(system @ found, [given[b.name] for b in right], rtol=1e-9)
    # Signs apart, of which the tape may leave one in a column.
    assert 0 <= operations(program, "solve") - operations_to_solve(matrix, order) <= 5


def test_minimum_degree_fills_no_arrow() -> None:
    """An unknown coupled to all others, which are coupled to it alone, comes last."""
    tape = Tape()
    arrow = named_system(tape, 5, {(i, j) for i in range(1, 5) for j in range(i + 1, 5)})
    assert minimum_degree(arrow) in ([4, 3, 2, 1, 0], [4, 3, 2, 0, 1])
    assert operations_to_solve(arrow, minimum_degree(arrow)) < operations_to_solve(arrow, range(5))


def test_a_zero_pivot_is_named() -> None:
    tape = Tape()
    matrix = named_system(tape, 3, {(1, 1)})
    with pytest.raises(ZeroPivotError) as refused:
        solve_symmetric(tape, matrix, [sp.S.One] * 3, [1, 0, 2])
    assert refused.value.unknown == 1
