"""The root with a quaternion: its functions are Pinocchio's of a free flyer.

Arrays go to the oracle and come back as they are.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.comparison import assert_close, compare, states
from support.compiled import Emitted, Library, emit
from support.derived import derived
from support.emitted import emitted_module
from support.pinocchio_oracle import Oracle
from support.random_robots import random_robot

from gibbs_codegen.interface import module_signatures
from gibbs_codegen.interface.table import GROUPS
from gibbs_codegen.program.nodes import names_in
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import ROD_ORIGINS

SPECIAL = [0.0, 1e-300, 1e-160, 1e-40, 1e-18, 1e-9, 1e-8, 1e-5, 1e-3, 0.1, 1.0, 3.0]
NEAR_HALF_TURN = [np.pi - step for step in (1e-3, 1e-7, 1e-9, 1e-13)]


def with_quaternion(robot: Robot) -> Robot:
    """The robot with other coordinates of its base."""
    return replace(robot, base=replace(robot.base, attitude="quaternion"))


@cache
def quadrotor() -> tuple[Robot, ModuleType]:
    """A robot that ships, with its module."""
    robot = with_quaternion(read_robot("quadrotor_2link")[0])
    return robot, emitted_module(robot)


@pytest.mark.parametrize("number", [0, pytest.param(4, marks=pytest.mark.slow)])
def test_random_robots(number: int) -> None:
    """Every structure, about either origin."""
    robot = with_quaternion(random_robot(300 + number, 2 + number % 5, number % 6))
    robot = replace(robot, base=replace(robot.base, origin=ROD_ORIGINS[number // 2 % 2]))
    compare(robot, emitted_module(robot), count=4)


@pytest.mark.slow
def test_coordinates_are_those_of_a_free_flyer() -> None:
    _, module = quadrotor()
    assert module.ATTITUDE == "quaternion"
    assert module.COORDINATES == ("x", "y", "z", "qx", "qy", "qz", "qw", "theta_5", "theta_6")
    assert module.COORDINATE_UNITS == ("m", "m", "m", "1", "1", "1", "1", "rad", "rad")
    assert module.VELOCITIES == ("vx", "vy", "vz", "wx", "wy", "wz", "theta_5", "theta_6")
    assert module.VELOCITY_UNITS == ("m/s",) * 3 + ("rad/s",) * 5
    constrained = ("theta_2", "theta_3", "theta_4")
    torques = tuple(f"tau_prime_{k}" for k in (2, 3, 4))
    before, after = module.VELOCITIES[:6], module.VELOCITIES[6:]
    assert (*before, *constrained, *after, *torques) == module.HYBRID_COORDINATES


@pytest.mark.slow
def test_attitude_and_position_enter_through_gravity_alone() -> None:
    """M and B read no coordinate of the base, R its attitude, and without gravity not even that."""
    robot, _ = quadrotor()
    base = set("xyz") | {"qx", "qy", "qz", "qw"}
    weightless = replace(robot, gravity=0.0)
    for machine, attitude in ((robot, base - set("xyz")), (weightless, set())):
        program = derived(machine, functions=("default", *GROUPS)).program
        for name, read in (("mass_matrix", set()), ("input_matrix", set()), ("residual", attitude)):
            function = program.function(name)
            names = {used for node in function.nodes() for used in names_in(node)}
            assert names & base == read, name


def test_forces_are_the_partial_derivatives_of_the_gibbs_function() -> None:
    """S is a polynomial of the second degree in a, so central differences of it are exact."""
    robot, module = quadrotor()
    q, v, a, _ = (x[0] for x in states(robot, module, 1))
    steps = np.eye(len(a))
    partials = (module.gibbs(q, v, a + steps) - module.gibbs(q, v, a - steps)) / 2
    assert_close("dS/da", partials, module.inverse_dynamics(q, v, a))


@pytest.mark.parametrize("upside_down", [False, True])
def test_free_flight_conserves_energy_and_momentum(upside_down: bool) -> None:
    """Steps on the manifold, by Runge and Kutta's method in the coordinates' own rates."""
    _, module = quadrotor()
    rng = np.random.default_rng(5)
    attitude = [1.0, 0.0, 0.0, 0.0] if upside_down else [0.0, 0.0, 0.0, 1.0]
    q = np.array([0.1, -0.2, 0.3, *attitude, 0.5, -0.8])
    v = rng.uniform(-0.5, 0.5, 8)
    u, h, steps = np.zeros(6), 2e-3, 250

    def rates(q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return module.coordinate_rates(q, v), module.forward_dynamics(q, v, u)

    def totals(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        energy = module.kinetic_energy(q, v) + module.potential_energy(q)
        momentum = Rotation.from_quat(q[3:7]).apply((module.mass_matrix(q) @ v)[:3])
        return np.array([energy, *momentum[:2]])

    before = totals(q, v)
    for _ in range(steps):
        first = rates(q, v)
        second = rates(q + h / 2 * first[0], v + h / 2 * first[1])
        third = rates(q + h / 2 * second[0], v + h / 2 * second[1])
        fourth = rates(q + h * third[0], v + h * third[1])
        moved, gained = (
            h / 6 * (a + 2 * b + 2 * c + d)
            for a, b, c, d in zip(first, second, third, fourth, strict=True)
        )
        q, v = q + moved, v + gained
    assert np.linalg.norm(q[3:7]) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(totals(q, v), before, atol=1e-8 * abs(before[0]))


def twist(angle: float, rng: np.random.Generator) -> np.ndarray:
    """A displacement of the base that turns by an angle."""
    axis = rng.normal(size=3)
    return np.concatenate([rng.normal(size=3), angle * axis / np.linalg.norm(axis)])


@pytest.mark.parametrize("angle", [*SPECIAL, *NEAR_HALF_TURN])
def test_difference_undoes_integrate(angle: float) -> None:
    """At every angle below half a turn, to a rounding or two of the displacement itself.

    From the identity, where coordinates hold a small displacement to its last digit.
    """
    _, module = quadrotor()
    rng = np.random.default_rng(3)
    q = np.array([0.0] * 6 + [1.0] + [0.0] * 2)
    for _ in range(20):
        v = np.concatenate([twist(angle, rng), rng.normal(size=2)])
        found = module.difference(q, module.integrate(q, v))
        for part in (slice(0, 3), slice(3, 6), slice(6, 8)):
            size = np.linalg.norm(v[part])
            assert np.linalg.norm(found[part] - v[part]) <= 2e-15 * size


@pytest.mark.parametrize("angle", [*SPECIAL, *NEAR_HALF_TURN, np.pi + 0.1, 5.0, 6.28, 30.0])
def test_integrate_is_that_of_pinocchio(angle: float) -> None:
    robot, module = quadrotor()
    oracle, rng = Oracle(robot), np.random.default_rng(4)
    q = states(robot, module, 1)[0][0]
    for _ in range(10):
        v = np.concatenate([twist(angle, rng), rng.normal(size=2)])
        found = module.integrate(q, v)
        assert np.linalg.norm(found - oracle.integrated(q, v)) < 1e-13
        assert np.linalg.norm(found[3:7]) == pytest.approx(1.0, abs=5e-16)


@pytest.mark.slow
@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_shorter_way_is_taken_from_either_of_two_opposite_quaternions(seed: int) -> None:
    robot, module = quadrotor()
    q, p = states(robot, module, 2, seed)[0]
    opposite = q * np.where(np.char.startswith(module.COORDINATES, "q"), -1.0, 1.0)
    forth = module.difference(p, q)
    assert np.linalg.norm(forth[3:6]) <= np.pi + 1e-15
    np.testing.assert_allclose(module.difference(p, opposite), forth, atol=1e-13)
    there = module.integrate(p, forth)
    turned = Rotation.from_quat(there[3:7]).inv() * Rotation.from_quat(q[3:7])
    assert turned.magnitude() < 1e-14
    np.testing.assert_allclose(np.delete(there, range(3, 7)), np.delete(q, range(3, 7)), atol=1e-13)


@pytest.mark.parametrize("axis", range(3))
def test_a_half_turn_is_found(axis: int) -> None:
    """Also where the scalar part between the quaternions is exactly zero, of either sign."""
    _, module = quadrotor()
    q = np.array([0.0] * 6 + [1.0] + [0.0] * 2)
    for sign in (1.0, -1.0):
        for scalar in (0.0, -0.0):
            there = q.copy()
            there[3:7] = 0.0
            there[3 + axis], there[6] = sign, scalar
            found = module.difference(q, there)
            assert np.abs(found[3:6]) == pytest.approx(np.pi * np.eye(3)[axis], abs=1e-15)
            assert np.abs(module.integrate(q, found)[3:7]) == pytest.approx(
                np.eye(4)[axis], abs=1e-15
            )


def test_integrate_normalises() -> None:
    robot, module = quadrotor()
    q, v, *_ = (x[0] for x in states(robot, module, 1))
    longer = q.copy()
    longer[3:7] *= 3.0
    np.testing.assert_allclose(module.integrate(longer, v), module.integrate(q, v), atol=1e-14)


@pytest.fixture(scope="module")
def emitted(tmp_path_factory: pytest.TempPathFactory) -> Emitted:
    return emit(quadrotor()[0], tmp_path_factory.mktemp("quaternion") / "module")


@pytest.mark.slow
def test_tiny_angles_in_single_precision(emitted: Emitted, tmp_path: Path) -> None:
    path, options = tmp_path / "library.so", ["-O0", emitted.single]
    library = Library(emitted, path, "gcc", options, np.float32)
    signature = {s.name: s for s in module_signatures(emitted.module)}
    q = np.array([[0.0] * 6 + [1.0] + [0.0] * 2])
    rng = np.random.default_rng(1)
    for angle in (0.0, 1e-37, 1e-30, 1e-19, 1e-12, 1e-6, 1e-4, 1e-2, 1.0, 3.1):
        v = np.concatenate([twist(angle, rng), [0.5, -0.2]])[np.newaxis]
        (there,) = library.batch(signature["integrate"], [q, v], np.nan)
        (back,) = library.one(signature["difference"], [q, there])
        assert np.linalg.norm(back - v) <= 2e-6 * np.linalg.norm(v)
        assert np.linalg.norm((back - v)[0, 3:6]) <= 2e-6 * angle
