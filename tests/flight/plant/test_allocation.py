"""Allocation: wrenches become thrusts, and what no thrusts make is named."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from gibbs_codegen.flight.plant.allocation import Allocation, AllocationError
from gibbs_codegen.flight.plant.vehicle import Vehicle

SHIPPED = ("hexarotor_3link", "quadrotor_2link", "decarotor_3link", "hexarotor")


def random_wrenches(seed: int, rotors: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(6, rotors))


@pytest.mark.parametrize("name", ["hexarotor_3link", "quadrotor_2link", "hexarotor"])
def test_thrust_wrenches_are_forces_and_torques_about_the_centre(
    name: str, shipped: Callable[[str], ModuleType]
) -> None:
    """Against what a thrust along a direction of its arm's frame does at the arm's end."""
    vehicle = Vehicle(shipped(name))
    drag = {k.split("_")[-1]: v for k, v in vehicle.module.PARAMETERS.items() if "drag" in k}
    length = vehicle.module.PARAMETERS["base_arm_length"]
    wrenches = vehicle.thrust_wrenches()
    for k in range(vehicle.rotors):
        angle = -np.pi + 2 * np.pi * k / vehicle.rotors
        outwards = np.array([np.cos(angle), np.sin(angle), 0])
        # Arm 1 points inwards, so its y axis is the other way round.
        tangential = np.array([-np.sin(angle), np.cos(angle), 0]) * (-1 if k == 0 else 1)
        thrust = np.array([0, 0, 1]) if k % 2 == 0 else tangential
        torque = np.cross(length * outwards, thrust) + float(drag.get(str(k + 1), 0)) * thrust
        assert wrenches[:, k] == pytest.approx(np.concatenate([thrust, torque]), abs=1e-14)


@pytest.mark.parametrize("name", SHIPPED)
def test_thrust_wrenches_are_the_same_at_every_configuration(
    name: str, shipped: Callable[[str], ModuleType]
) -> None:
    vehicle = Vehicle(shipped(name))
    rng = np.random.default_rng(1)
    for _ in range(5):
        q = rng.uniform(-1.2, 1.2, len(vehicle.coordinates))
        columns = vehicle.input_matrix(q)[:, : vehicle.rotors].T
        made = vehicle.base_wrench(np.tile(q, (vehicle.rotors, 1)), columns).T
        assert made == pytest.approx(vehicle.thrust_wrenches(), abs=1e-12)


@pytest.mark.slow
@settings(max_examples=2)
@given(st.integers(0, 10_000), st.integers(6, 8))
def test_thrusts_make_the_wrench_and_are_the_smallest(seed: int, rotors: int) -> None:
    wrenches = random_wrenches(seed, rotors)
    wanted = np.random.default_rng(seed + 1).normal(size=(4, 6))
    thrusts = Allocation(wrenches).thrusts(wanted)
    assert thrusts @ wrenches.T == pytest.approx(wanted, abs=1e-8)
    # Of all thrusts that make the wrench the smallest have no part that makes none.
    _, _, rows = np.linalg.svd(wrenches)
    assert thrusts @ rows[6:].T == pytest.approx(0, abs=1e-8)


@pytest.mark.slow
@settings(max_examples=15)
@given(st.integers(0, 10_000), st.integers(6, 9))
@example(2634, 6)  # Takes more iterations than there are rotors.
def test_limits_are_kept_and_nothing_within_them_is_nearer(seed: int, rotors: int) -> None:
    wrenches = random_wrenches(seed, rotors)
    rng = np.random.default_rng(seed + 1)
    wanted = 3.0 * rng.normal(size=6)
    limits = (-0.5, 1.0)
    thrusts = Allocation(wrenches, limits).thrusts(wanted)
    assert np.all((thrusts >= limits[0]) & (thrusts <= limits[1]))
    # Torque counts by the lever that thrusts have on the whole.
    lever = np.linalg.norm(wrenches[3:]) / np.linalg.norm(wrenches[:3])
    weight = np.repeat([1.0, 1.0 / lever], 3)
    wrenches, wanted = weight[:, np.newaxis] * wrenches, weight * wanted
    found = np.linalg.norm(wrenches @ thrusts - wanted)
    start = rng.uniform(*limits, rotors)
    other = minimize(
        lambda f: 0.5 * np.sum((wrenches @ f - wanted) ** 2),
        start,
        jac=lambda f: wrenches.T @ (wrenches @ f - wanted),
        method="L-BFGS-B",
        bounds=[limits] * rotors,
    )
    assert found <= np.sqrt(2 * other.fun) + 1e-5


def test_limits_that_do_not_matter_change_nothing() -> None:
    wrenches = random_wrenches(0, 8)
    wanted = np.random.default_rng(3).normal(size=(5, 6))
    free = Allocation(wrenches).thrusts(wanted)
    assert np.array_equal(Allocation(wrenches, (-100.0, 100.0)).thrusts(wanted), free)


def test_missing_directions_are_named(shipped: Callable[[str], ModuleType]) -> None:
    allocation = Allocation(Vehicle(shipped("quadrotor_2link")).thrust_wrenches())
    assert allocation.missing == ("force along y", "torque about x")
    held = allocation.thrusts(np.array([1.0, 0, 9.81, 0, 0.3, -0.2]))
    assert allocation.wrenches @ held == pytest.approx([1.0, 0, 9.81, 0, 0.3, -0.2], abs=1e-12)
    with pytest.raises(AllocationError, match=r"up to 0\.5 N or N m") as refused:
        allocation.thrusts(np.array([[0, 0, 1.0, 0, 0, 0], [0, 0.5, 1.0, 0, 0, 0]]))
    assert refused.value.missing == ("force along y", "torque about x")


def test_a_plain_quadrotor_lacks_its_horizontal_forces() -> None:
    """Four rotors that push upwards, with drag: the machine that most people fly."""
    angles = -np.pi + np.pi / 2 * np.arange(4)
    places = 0.3 * np.stack([np.cos(angles), np.sin(angles), np.zeros(4)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    drag = 0.02 * np.array([1, -1, 1, -1])
    wrenches = np.stack(
        [np.concatenate([up, np.cross(p, up) + d * up]) for p, d in zip(places, drag, strict=True)],
        axis=-1,
    )
    assert Allocation(wrenches).missing == ("force along x", "force along y")


def test_a_direction_askew_is_told_by_its_parts() -> None:
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(6, 6)))[0]
    wrenches = turn[:, :5] @ np.random.default_rng(6).normal(size=(5, 6))
    (missing,) = Allocation(wrenches).missing
    assert missing.count("×") == 5
    assert "force along x" in missing
    assert "torque about z" in missing


def test_rotors_that_all_push_inwards_command_almost_nothing() -> None:
    angles = np.arange(6) * np.pi / 3
    wrenches = np.zeros((6, 6))
    wrenches[:3] = np.stack([np.cos(angles), np.sin(angles), np.zeros(6)])
    assert Allocation(wrenches).missing == (
        "force along z",
        "torque about x",
        "torque about y",
        "torque about z",
    )


def test_one_wrench_and_any_batch_agree() -> None:
    allocation = Allocation(random_wrenches(2, 7), (-0.4, 0.4))
    wanted = np.random.default_rng(4).normal(size=(2, 3, 6))
    batch = allocation.thrusts(wanted)
    assert batch.shape == (2, 3, 7)
    for i in range(2):
        for j in range(3):
            assert allocation.thrusts(wanted[i, j]) == pytest.approx(batch[i, j], abs=1e-13)
