"""Attitude angles, against rotations that are multiplied out and differences in time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from support.angle_rates import bias_acceleration, rate_matrix
from support.differences import rate
from support.random_robots import SEQUENCES

from gibbs_codegen.flight.attitude import (
    SINGULAR_COSINE,
    SingularAttitudeError,
    Turning,
    attitude_angles,
    quaternion_of,
    rotation_matrix,
    rotation_of,
)
from gibbs_codegen.flight.plant.kinematics import Kinematics, kinematics_of
from gibbs_codegen.flight.vectors import Array
from gibbs_codegen.robot.layout import Layout
from gibbs_codegen.verification.vectors import times

every_sequence = pytest.mark.parametrize("sequence", SEQUENCES)
TIME = np.linspace(0.0, 5.0, 23)


def elementary(letter: str, angle: float) -> Array:
    """Rotation about one axis, by hand."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array(
        {
            "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[letter]
    )


def angles_at(time: Array) -> Array:
    """Angles that wander, the second away from ±90°."""
    return np.stack([1.5 * np.sin(time), 1.2 * np.sin(1.3 * time + 0.5), 0.7 * time - 2.0], axis=-1)


def vector(matrix: Array) -> Array:
    """The vector of skew matrices (…, 3, 3)."""
    return np.stack([matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0]], axis=-1)


def turning_at(sequence: str, time: Array) -> Turning:
    """The wandering attitude, its ω and dω/dt by differences of R: Ṙ Rᵀ and its derivative."""

    def spin(t: Array) -> Array:
        turned = rotation_matrix(sequence, angles_at(t))
        return rate(lambda s: rotation_matrix(sequence, angles_at(s)), t) @ np.swapaxes(
            turned, -1, -2
        )

    rotation = rotation_matrix(sequence, angles_at(time))
    return Turning(rotation, vector(spin(time)), vector(rate(spin, time)))


def kinematics(sequence: str) -> Kinematics:
    """Those of a base without joints."""
    names, units = ("theta_m1", "theta_0", "theta_1", "x", "y", "z"), ("rad",) * 3 + ("m",) * 3
    return kinematics_of(Layout.listed(sequence, names, units, 0))


def test_the_six_sequences() -> None:
    assert sorted(SEQUENCES) == ["xyz", "xzy", "yxz", "yzx", "zxy", "zyx"]


@every_sequence
def test_rotation_is_the_product_of_elementary_ones(sequence: str) -> None:
    angles = np.random.default_rng(1).uniform(-7.0, 7.0, (20, 3))
    for row, found in zip(angles, rotation_matrix(sequence, angles), strict=True):
        a, b, c = (elementary(*pair) for pair in zip(sequence, row, strict=True))
        assert_allclose(found, a @ b @ c, rtol=0, atol=1e-14)


@every_sequence
def test_rates_make_the_angular_velocity(sequence: str) -> None:
    rates = rate(angles_at, TIME)
    turning = turning_at(sequence, TIME)
    product = times(rate_matrix(sequence, angles_at(TIME)), rates)
    assert_allclose(product, turning.velocity, rtol=0, atol=1e-10)


@every_sequence
def test_bias_is_the_acceleration_at_constant_rates(sequence: str) -> None:
    angles, rates = angles_at(TIME), rate(angles_at, TIME)
    for q, v in zip(angles, rates, strict=True):
        moved = rate(
            lambda t, q=q, v=v: times(rate_matrix(sequence, q + np.outer(t, v)), v), np.zeros(1)
        )
        assert_allclose(bias_acceleration(sequence, q, v), moved[0], rtol=0, atol=1e-10)


@every_sequence
def test_angles_rates_and_accelerations_come_back(sequence: str) -> None:
    angles, rates, accelerations = kinematics(sequence).turned(turning_at(sequence, TIME))
    exact = angles_at(TIME)
    # As the world sees them, whatever whole turns there are.
    assert_allclose(np.exp(1j * angles), np.exp(1j * exact), rtol=0, atol=1e-12)
    assert_allclose(rates, rate(angles_at, TIME), rtol=0, atol=1e-8)
    second = rate(lambda t: rate(angles_at, t), TIME)
    assert_allclose(accelerations, second, rtol=0, atol=1e-8)


@pytest.mark.slow
@settings(max_examples=4)
@given(
    sequence=st.sampled_from(SEQUENCES),
    first=st.floats(-np.pi, np.pi),
    second=st.floats(-1.56, 1.56),
    third=st.floats(-np.pi, np.pi),
)
def test_any_attitude_and_back(sequence: str, first: float, second: float, third: float) -> None:
    angles = attitude_angles(sequence, rotation_matrix(sequence, [first, second, third]))
    assert np.all(np.abs(angles) <= np.pi)
    assert abs(angles[1]) <= np.pi / 2
    turned = np.exp(1j * angles) / np.exp(1j * np.array([first, second, third]))
    # Near the singularity angles are less exact than rotations: by the inverse of its cosine.
    assert_allclose(turned, 1.0, rtol=0, atol=1e-13 / np.cos(second))


@every_sequence
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_singularity_is_refused_where_it_begins(sequence: str, sign: float) -> None:
    edge = np.pi / 2 - np.arcsin(SINGULAR_COSINE)

    def at(angle: float) -> Array:
        angles = [[0.3, 0.1, 0.2], [0.3, sign * angle, -0.7], [0.3, sign * angle, 0.0]]
        return rotation_matrix(sequence, angles)

    angles = attitude_angles(sequence, at(edge - 1e-6))
    assert angles[1, 1] == pytest.approx(sign * (edge - 1e-6), abs=1e-10)
    for angle in (edge + 1e-6, np.pi / 2):
        with pytest.raises(SingularAttitudeError, match=f"the sequence {sequence}") as refusal:
            attitude_angles(sequence, at(angle))
        assert refusal.value.place == 1
        assert refusal.value.exit_code == 2


@every_sequence
@pytest.mark.parametrize("shape", [(), (1,), (4,), (2, 3)])
def test_any_leading_axes(sequence: str, shape: tuple[int, ...]) -> None:
    angles, spin, growth = np.random.default_rng(2).uniform(-1.5, 1.5, (3, *shape, 3))
    q = np.concatenate([angles, angles], axis=-1)
    rotation, base = rotation_matrix(sequence, angles), kinematics(sequence)
    results = [rotation, attitude_angles(sequence, rotation), *base.attitude_rates(q, spin, growth)]
    assert [r.shape for r in results] == [(*shape, 3, 3)] + [(*shape, 3)] * 3
    for place in np.ndindex(shape):
        alone = [
            rotation_matrix(sequence, angles[place]),
            attitude_angles(sequence, rotation[place]),
            *base.attitude_rates(q[place], spin[place], growth[place]),
        ]
        for result, single in zip(results, alone, strict=True):
            assert_allclose(result[place], single, rtol=1e-12, atol=1e-13)
    rates, accelerations = results[2:]
    assert_allclose(times(rate_matrix(sequence, angles), rates), spin, rtol=0, atol=1e-12)
    found = times(rate_matrix(sequence, angles), accelerations)
    found += bias_acceleration(sequence, angles, rates)
    assert_allclose(found, growth, rtol=1e-12, atol=1e-10)


def test_quaternions_are_those_of_scipy_in_any_attitude() -> None:
    """Half turns among them, about which each entry in turn is the largest."""
    turns = np.concatenate([np.pi * np.eye(3), np.random.default_rng(1).normal(size=(50, 3)) * 2.0])
    theirs = Rotation.from_rotvec(turns)
    ours = quaternion_of(theirs.as_matrix())
    assert_allclose(np.abs(np.sum(ours * theirs.as_quat(), axis=-1)), 1.0, atol=1e-14)
    assert_allclose(rotation_of(3.0 * ours), theirs.as_matrix(), atol=1e-14)
