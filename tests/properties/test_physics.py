"""Invariants that hold for any machine: finite differences, power, energy and momentum."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from support.emitted import emitted_module
from support.random_robots import robots

from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base, alternating_thrust
from gibbs_codegen.robot.parts.body import Rod

STEP = 1e-6


def gradient(function, x: np.ndarray) -> np.ndarray:
    """Central differences of a scalar function of one state."""
    steps = STEP * np.eye(len(x))
    return np.array([(function(x + h) - function(x - h)) / (2 * STEP) for h in steps])


@pytest.mark.slow
@settings(max_examples=4)
@given(robot=robots(most_rotors=5, most_links=4))
def test_gradients_of_gibbs_function_and_energies_and_power(robot: Robot) -> None:
    """∂S/∂a = M a − R, ∂T/∂v = M v; J v is the tip's velocity, J̇ v its acceleration at a = 0.

    The energy changes at the rate vᵀBu, whatever the inputs.
    """
    module = emitted_module(robot)
    rng = np.random.default_rng(2)
    q, v, a = rng.uniform(-1, 1, (3, len(module.COORDINATES)))
    inverse = module.inverse_dynamics(q, v, a)
    by_differences = gradient(lambda x: module.gibbs(q, v, x), a)
    np.testing.assert_allclose(by_differences, inverse, atol=1e-7 * np.abs(inverse).max())
    matrix, residual = module.mass_matrix_and_residual(q, v)
    np.testing.assert_allclose(matrix @ a - residual, inverse, atol=1e-11 * np.abs(inverse).max())
    momentum = matrix @ v
    by_differences = gradient(lambda x: module.kinetic_energy(q, x), v)
    np.testing.assert_allclose(by_differences, momentum, atol=1e-7 * np.abs(momentum).max())
    assert module.kinetic_energy(q, v) == pytest.approx(0.5 * v @ momentum, rel=1e-12)
    moved = module.positions(q + STEP * v)[-1] - module.positions(q - STEP * v)[-1]
    np.testing.assert_allclose(module.tip_jacobian(q)[:3] @ v, moved / (2 * STEP), atol=1e-8)
    gained = (module.tip_jacobian(q + STEP * v) - module.tip_jacobian(q - STEP * v)) @ v
    bias = module.tip_bias_acceleration(q, v)
    np.testing.assert_allclose(bias, gained / (2 * STEP), atol=1e-8 * np.abs(bias).max())
    u = rng.normal(size=len(module.INPUTS))
    a = module.forward_dynamics(q, v, u)

    def energy(t: float) -> float:
        x = q + v * t + 0.5 * a * t * t
        return float(module.kinetic_energy(x, v + a * t) + module.potential_energy(x))

    h = 1e-5
    # Richardson: the truncation of the central difference is removed to fourth order.
    rate = (8 * (energy(h) - energy(-h)) - (energy(2 * h) - energy(-2 * h))) / (12 * h)
    power = v @ module.input_matrix(q) @ u
    assert rate == pytest.approx(power, abs=1e-6 * (abs(energy(0.0)) + np.abs(a).max()))


@pytest.mark.slow
def test_attitude_is_the_sequence_of_the_angles() -> None:
    """Without an arm the tip has the axes of base arm 1."""
    base = Base(
        rotors=4,
        arms=(Rod(length=0.5, mass_per_length=1.0),),
        thrust=alternating_thrust(4),
        drag=(0.0,) * 4,
        attitude="yzx",
    )
    module = emitted_module(Robot("armless", base, ()), "tip_pose")
    q = np.array([0.4, -0.7, 1.1, 0.0, 0.0, 0.0])
    expected = Rotation.from_euler(module.ATTITUDE.upper(), q[:3]).as_matrix()
    np.testing.assert_allclose(module.tip_pose(q)[:3, :3], expected, atol=1e-15)


def test_free_fall_conserves_energy_and_horizontal_momentum(shipped) -> None:
    module = shipped("quadrotor_2link")
    n = len(module.COORDINATES)
    rng = np.random.default_rng(0)
    start = np.concatenate([rng.uniform(-0.3, 0.3, n), rng.uniform(-0.3, 0.3, n)])
    idle = np.zeros(len(module.INPUTS))

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[n:], module.forward_dynamics(x[:n], x[n:], idle)])

    end = solve_ivp(rate, (0, 0.3), start, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]

    def energy(x: np.ndarray) -> float:
        return float(module.kinetic_energy(x[:n], x[n:]) + module.potential_energy(x[:n]))

    def momentum(x: np.ndarray) -> np.ndarray:
        return module.mass_matrix(x[:n])[-3:] @ x[n:]

    assert energy(end) == pytest.approx(energy(start), rel=1e-8)
    np.testing.assert_allclose(momentum(end)[:2], momentum(start)[:2], atol=1e-8)
    fallen = momentum(end)[2] - momentum(start)[2]
    mass = module.mass_matrix(start[:n])[-1, -1]
    assert fallen == pytest.approx(-0.3 * mass * module.PARAMETERS["gravity"], rel=1e-8)


def test_hover_thrust_carries_the_weight(shipped) -> None:
    """Hand-worked: level, at rest, the three upward motors share the weight; nothing accelerates.

    The arm hangs straight down, so its centre of mass is below the base centre.
    """
    module = shipped("hexarotor_3link")
    q = np.zeros(9)
    q[module.COORDINATES.index("theta_8")] = -np.pi / 2
    u = np.zeros(9)
    u[[0, 2, 4]] = 9.0 * 9.81 / 3
    np.testing.assert_allclose(module.forward_dynamics(q, np.zeros(9), u), 0, atol=1e-12)
