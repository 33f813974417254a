"""The attitude of the base along its path, against searches and differences in time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from support.differences import rate

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.orientation import (
    Level,
    Orientation,
    Tangent,
    heading_error,
)
from gibbs_codegen.flight.scenario.paths import Circle, Fixed, Harmonic, Path, Term, Waypoints
from gibbs_codegen.flight.vectors import Array

TIME = np.linspace(0.0, 12.0, 37)
STEP = 0.002  # of differences: some paths turn sharply
PAPER = read_scenario("paper").base
# Up and down, and never straight so.
WAVY = Harmonic(
    x=(Term(2.0, 0.05, 1.0), Term(4.0, 0.1)),
    y=(Term(1.5, 0.0, 0.7, -1.0),),
    z=(Term(1.0, 0.0, 1.9), Term(1.0, -0.1)),
)
PATHS: dict[str, Path] = {
    "paper": PAPER,
    "wavy": WAVY,
    "level circle": Circle((0, 0, 2), 2.0, 8.0),
    "steep circle": Circle((0, 0, 2), 2.0, -8.0, normal=(1, 0.4, 0.3)),
}


def arm_angles(rotors: int) -> Array:
    """Of the method's section 1: θ_k = −180° + 360° (k − 1)/N, and 0 for arm 1 itself."""
    return np.radians([0.0, *(-180.0 + 360.0 * (k - 1) / rotors for k in range(2, rotors + 1))])


def unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def vector(matrix: Array) -> Array:
    return np.stack([matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0]], axis=-1)


def assert_turning(orientation: Orientation, path: Path, angles: Array) -> None:
    """ω and dω/dt against the rotation's differences, and the rotation is one."""
    turning = orientation(path, TIME, angles)
    back = np.swapaxes(turning.rotation, -1, -2)
    assert_allclose(turning.rotation @ back, np.broadcast_to(np.eye(3), back.shape), atol=1e-13)
    assert np.all(np.linalg.det(turning.rotation) > 0.0)
    spin = rate(lambda t: orientation(path, t, angles).rotation, TIME, STEP) @ back
    assert_allclose(spin, -np.swapaxes(spin, -1, -2), atol=1e-9)
    assert_allclose(turning.velocity, vector(spin), rtol=0, atol=1e-8)
    growth = rate(lambda t: orientation(path, t, angles).velocity, TIME, STEP)
    assert_allclose(turning.acceleration, growth, rtol=0, atol=1e-8)


@pytest.mark.parametrize("rotors", range(2, 11))
def test_the_arm_lies_along_the_tangent(rotors: int) -> None:
    angles = arm_angles(rotors)
    for arm in range(1, rotors + 1):
        turning = Tangent(arm)(PAPER, TIME, angles)
        # An arm's direction in arm 1's frame: x, turned about the normal.
        turned = Rotation.from_euler("z", angles[arm - 1]).as_matrix() @ [1.0, 0.0, 0.0]
        along = turning.rotation @ turned
        assert_allclose(along, unit(PAPER(TIME)[:, 1]), rtol=0, atol=1e-14)
        assert_allclose(heading_error(PAPER, TIME, along), 0.0, atol=1e-14)


@pytest.mark.parametrize("name", PATHS)
def test_no_normal_is_nearer_to_the_vertical(name: str) -> None:
    """Against a search over all attitudes with the arm along the tangent."""
    turning = Tangent(2)(PATHS[name], TIME, arm_angles(6))
    tangents = unit(PATHS[name](TIME)[:, 1])
    rolls = np.linspace(-np.pi, np.pi, 721)
    for rotation, tangent in zip(turning.rotation, tangents, strict=True):
        rolled = Rotation.from_rotvec(np.outer(rolls, tangent)).as_matrix() @ rotation
        heights = rolled[:, 2, 2]
        assert heights.max() <= rotation[2, 2] + 1e-12
        # The search did find worse, and the best of all is where it began.
        assert heights.min() < rotation[2, 2] - 0.1
        assert rolls[np.argmax(heights)] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("arm", [1, 2, 5])
def test_angular_velocity_and_acceleration_along_a_path(name: str, arm: int) -> None:
    assert_turning(Tangent(arm), PATHS[name], arm_angles(6))


@pytest.mark.slow
@settings(max_examples=40)
@given(
    amplitudes=st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3),
    frequencies=st.lists(st.floats(0.2, 1.5), min_size=3, max_size=3),
    phases=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    rotors=st.integers(2, 12),
    data=st.data(),
)
def test_along_any_path(
    amplitudes: list[float],
    frequencies: list[float],
    phases: list[float],
    rotors: int,
    data: st.DataObject,
) -> None:
    waves = [
        (Term(*wave[:1], 0.0, *wave[1:]),)
        for wave in zip(amplitudes, frequencies, phases, strict=True)
    ]
    # Forward speed of 3 m/s and more, so that the path neither stands still nor rises upright.
    path = _Onwards(Harmonic(*waves), speed=4.6)
    arm = data.draw(st.integers(1, rotors))
    assert_turning(Tangent(arm), path, arm_angles(rotors))


class _Onwards:
    """A path carried along X."""

    def __init__(self, path: Path, speed: float) -> None:
        self.path, self.speed = path, speed

    def __call__(self, time: Array | float) -> Array:
        """Position and derivatives."""
        out = self.path(time).copy()
        out[..., 0, 0] += self.speed * np.asarray(time)
        out[..., 1, 0] += self.speed
        return out


def test_on_a_level_circle_the_base_turns_as_the_path_does() -> None:
    turning = Tangent(2)(PATHS["level circle"], TIME, arm_angles(6))
    assert_allclose(turning.rotation[:, :, 2], [(0, 0, 1)] * len(TIME), atol=1e-15)
    assert_allclose(turning.velocity, [(0, 0, 2 * np.pi / 8.0)] * len(TIME), atol=1e-14)
    assert_allclose(turning.acceleration, 0.0, atol=1e-14)


@pytest.mark.parametrize(("heading", "turn"), [(0.0, 0.0), (0.7, 0.0), (-2.0, 1.3), (0.4, -0.5)])
def test_level_with_a_heading(heading: float, turn: float) -> None:
    level = Level(heading, turn)
    assert_turning(level, Fixed((0, 0, 1)), arm_angles(6))
    turning = level(Fixed((0, 0, 1)), TIME, arm_angles(6))
    assert_allclose(turning.rotation[:, :, 2], [(0, 0, 1)] * len(TIME), atol=1e-15)
    assert_allclose(turning.velocity, [(0, 0, turn)] * len(TIME))
    now = heading + turn * TIME
    arm = np.stack([np.cos(now), np.sin(now), 0.0 * now], axis=1)
    assert_allclose(turning.rotation[:, :, 0], arm, atol=1e-15)


@pytest.mark.parametrize("arm", [7, 256])
def test_an_arm_that_is_not_there(arm: int) -> None:
    with pytest.raises(UsageError, match=f"base.attitude.arm: {arm}: there are arms 1 to 6"):
        Tangent(arm)(PAPER, TIME, arm_angles(6))


def test_a_base_without_arms_has_its_x_axis_along_the_path() -> None:
    turning = Tangent()(PAPER, TIME, arm_angles(6)[:0])
    assert heading_error(PAPER, TIME, turning.rotation[:, :, 0]).max() < 1e-12


def test_a_path_that_stands_still() -> None:
    time = np.linspace(0.0, 4.0, 9)
    with pytest.raises(UsageError, match=r"stands still at t = 0 s.*choose a level attitude"):
        Tangent(2)(Fixed((0, 0, 1)), time, arm_angles(6))
    # There and back.
    with pytest.raises(UsageError, match=r"stands still at t = 2 s.*changes its direction"):
        Tangent(2)(Harmonic(y=(Term(1.0, 0.0, 0.5 * np.pi),)), time, arm_angles(6))


def test_a_path_that_rests_has_the_tangent_of_where_it_moves() -> None:
    """A parabola from rest, x = t², y = t³: its tangent is (2, 3t), by which it begins to turn."""

    def parabola(time: ArrayLike) -> Array:
        t = np.asarray(time, dtype=np.float64)
        x, y = ([t**2, 2 * t, 2 + 0 * t, 0 * t], [t**3, 3 * t**2, 6 * t, 6 + 0 * t])
        return np.stack([np.stack(x, -1), np.stack(y, -1), np.zeros((*t.shape, 4))], axis=-1)

    time = np.linspace(0.0, 1.0, 11)
    turning = Tangent()(parabola, time, np.zeros(0))
    yaw = np.arctan(1.5 * time)
    assert_allclose(turning.rotation[:, :2, 0], np.stack([np.cos(yaw), np.sin(yaw)], 1), atol=1e-9)
    assert_allclose(turning.velocity[:, 2], 1.5 / (1.0 + 2.25 * time**2), atol=1e-9)
    # At rest until 0.5 s and from 7.5 s on, it bends from x to y in between.
    points = ((0, 0, 0), (0.6, 0, 0), (2, 0.7, 0), (2.8, 1.9, 0), (2.8, 2.6, 0))
    rates = ("rest", (0.6, 0, 0), "free", (0, 0.6, 0), "rest")
    bend = Waypoints(times=(0.5, 2, 4, 6, 7.5), points=points, velocities=rates)
    turning = Tangent()(bend, time := np.linspace(0.0, 9.0, 901), np.zeros(0))
    still = (time <= 0.5) | (time >= 7.5)
    assert_allclose(turning.velocity[still], 0.0, atol=1e-6)
    assert np.abs(np.diff(turning.rotation[:, 0, 0])).max() < 0.02
    for side, places in ((0.503, time <= 0.5), (7.497, time >= 7.5)):
        way = bend(side)[1]
        there = np.tile(way / np.linalg.norm(way), (np.sum(places), 1))
        assert_allclose(turning.rotation[places][:, :, 0], there, atol=1e-3)
    assert heading_error(bend, time, turning.rotation[:, :, 0]).max() < 1e-12
    # Where it would turn in a jerk, with words of its own, and by however little it is a corner.
    points = ((0, 0, 0), (1, 0.3, 0), (1.5, 1.2, 0))
    for times, at in (((0.5, 2, 5), "0.51"), ((0, 2, 3.5), "3.49")):
        with pytest.raises(UsageError, match=f"bends at t = {at}.*make it straight there"):
            Tangent()(Waypoints(times=times, points=points), time[:501], np.zeros(0))
    corner = Waypoints(times=(0, 1, 3, 4), points=((0, 0, 0), (1, 0, 0), (1, 0, 0), (2, 0.04, 0)))
    with pytest.raises(UsageError, match="stands still at t = 1 s, where it changes its direction"):
        Tangent()(corner, time[:401], np.zeros(0))


@pytest.mark.parametrize("amplitude", [1.0, 2.3])
def test_a_path_that_ends_where_it_turns_back_has_the_tangent_of_before(amplitude: float) -> None:
    path, time = Harmonic(y=(Term(amplitude, 0.0, 0.5 * np.pi),)), np.linspace(0.0, 2.0, 9)
    assert_allclose(Tangent()(path, time, np.zeros(0)).rotation[:, 1, 0], -1.0)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_path_that_goes_straight_up_or_down(direction: float) -> None:
    time = np.linspace(0.0, 4.0, 9)
    upright = Harmonic(z=(Term(direction, 0.5),))
    with pytest.raises(UsageError, match=r"is vertical at t = 0 s.*choose a level attitude"):
        Tangent(2)(upright, time, arm_angles(6))
    # A standing circle is upright a quarter of a turn after its top, at 2 s.
    standing = Circle((0, 0, 0), 1.0, direction * 8.0, normal=(0, 1, 0), phase=np.pi / 2)
    with pytest.raises(UsageError, match=r"is vertical at t = 2 s"):
        Tangent(2)(standing, time, arm_angles(6))


def test_heading_errors_of_any_size() -> None:
    path = Harmonic(x=(Term(1.0, 0.3),))
    for angle in (0.0, 1e-12, 1e-3, 1.0, np.pi / 2, 3.0, np.pi):
        direction = np.array([[np.cos(angle), np.sin(angle), 0.0]])
        # Near a half turn a chord tells little of its angle.
        found = heading_error(path, np.zeros(1), direction)
        assert found == pytest.approx(angle, rel=1e-9, abs=1e-15)
