"""Inverse dynamics: inputs and constraint torques, against the machine and Pinocchio."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest
from support.pinocchio_oracle import Oracle

from gibbs_codegen.flight.control.laws import (
    inputs_and_constraint_torques,
    required_inputs,
)
from gibbs_codegen.flight.desired.trajectory import desired_motion
from gibbs_codegen.flight.plant.allocation import Allocation, AllocationError
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.robot.file import read_robot


@pytest.mark.parametrize("name", ["hexarotor_3link"])
def test_required_inputs_make_the_motion(name: str, fast: Callable[[str], ModuleType]) -> None:
    vehicle = Vehicle(fast(name))
    allocation = Allocation(vehicle.thrust_wrenches())
    q, v, a = np.random.default_rng(1).uniform(-1, 1, (3, 50, len(vehicle.coordinates)))
    inputs = required_inputs(vehicle, allocation, q, v, a)
    force = np.einsum("sij,sj->si", vehicle.input_matrix(q), inputs)
    assert force == pytest.approx(vehicle.inverse_dynamics(q, v, a), abs=1e-10)
    moved = vehicle.forward_dynamics(q, v, inputs)
    condition = np.linalg.cond(vehicle.mass_matrix(q))
    assert np.all(np.abs(moved - a).max(axis=1) < 1e-13 * condition)


@pytest.mark.slow
def test_minimum_norm_where_there_are_rotors_to_spare(fast: Callable[[str], ModuleType]) -> None:
    vehicle = Vehicle(fast("decarotor_3link"))
    q, v, a = np.random.default_rng(2).uniform(-1, 1, (3, len(vehicle.coordinates)))
    inputs = required_inputs(vehicle, Allocation(vehicle.thrust_wrenches()), q, v, a)
    matrix = vehicle.input_matrix(q)
    least = np.linalg.pinv(matrix[vehicle.layout.v.base][:, : vehicle.rotors])
    force = vehicle.inverse_dynamics(q, v, a)[vehicle.layout.v.base]
    assert inputs[: vehicle.rotors] == pytest.approx(least @ force, abs=1e-9)


def test_an_arrangement_that_cannot_make_the_motion_says_so(
    shipped: Callable[[str], ModuleType],
) -> None:
    vehicle = Vehicle(shipped("quadrotor_2link"))
    allocation = Allocation(vehicle.thrust_wrenches())
    q, v, a = np.zeros((3, len(vehicle.coordinates)))
    q[4] = -np.pi / 2
    hover = required_inputs(vehicle, allocation, q, v, a)
    assert vehicle.forward_dynamics(q, v, hover) == pytest.approx(0, abs=1e-9)
    a[-2] = 1.0
    with pytest.raises(AllocationError, match="force along y"):
        required_inputs(vehicle, allocation, q, v, a)


@pytest.mark.slow
def test_constraint_torques_along_the_paper_flight_agree_with_pinocchio(
    fast: Callable[[str], ModuleType],
) -> None:
    """Inverse dynamics of the tree whose base joints are joints that are held (eqs. 14–17)."""
    flight = simulate(fast("hexarotor_3link"), read_scenario("paper"))
    oracle = Oracle(read_robot("hexarotor_3link")[0])
    for k in range(0, len(flight.time), 25):
        torques = oracle.inverse_dynamics(flight.q[k], flight.v[k], flight.a[k])
        torques -= oracle.input_matrix(flight.q[k]) @ flight.applied[k]
        held = torques[oracle.held]
        scale = np.linalg.norm(oracle.inverse_dynamics(flight.q[k], flight.v[k], flight.a[k]))
        assert flight.constraint_torques[k] == pytest.approx(held, abs=1e-9 * scale)
        # What is free is in balance, or the comparison would say little.
        assert torques[oracle.free] == pytest.approx(0, abs=1e-7 * scale)


@pytest.mark.slow
@pytest.mark.parametrize("rotors", [6])
def test_motion_inputs_and_constraint_torques_solve_the_hybrid_system(
    rotors: int, family: Callable[[int, int], ModuleType]
) -> None:
    """Eq. 18, I_H a_H = R_H + B_H u, along the paper's flight."""
    vehicle = Vehicle(family(rotors, 3))
    q, v, a = desired_motion(vehicle, read_scenario("paper"))(np.linspace(0, 12, 7))
    allocation = Allocation(vehicle.thrust_wrenches())
    inputs, torques = inputs_and_constraint_torques(vehicle, allocation, q, v, a)
    assert torques.shape == (7, vehicle.rotors - 1)
    hybrid = np.einsum("sij,sj->si", vehicle.module.hybrid_input_matrix(q), inputs)
    hybrid += vehicle.module.hybrid_residual(q, v)
    n = len(vehicle.coordinates)
    order = [0, 1, 2, *range(vehicle.rotors + 2, vehicle.rotors + n - 1)]
    unknowns = np.zeros_like(hybrid)
    unknowns[:, order] = a
    unknowns[:, -(vehicle.rotors - 1) :] = torques
    left = np.einsum("sij,sj->si", vehicle.module.hybrid_mass_matrix(q), unknowns)
    assert left == pytest.approx(hybrid, abs=1e-8)
