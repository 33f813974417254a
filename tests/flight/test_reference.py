"""The desired motion in time: quintics between knots, refusals of the base, and how arms hang."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from support.differences import rate
from support.random_vehicles import SEEDS, random_vehicle

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.attitude import SINGULAR_COSINE, SingularAttitudeError, Turning
from gibbs_codegen.flight.desired.base_trajectory import KNOT_SPACING, desired_base, knots
from gibbs_codegen.flight.desired.inverse_kinematics import Array, JointBounds
from gibbs_codegen.flight.desired.posture import joint_motion, rest_posture, with_joints
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.file import read_scenario, shipped_scenarios
from gibbs_codegen.flight.scenario.orientation import Level, Orientation, Tangent
from gibbs_codegen.flight.scenario.paths import Circle, Fixed, Harmonic, Path, Term
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load

pytestmark = pytest.mark.usefixtures("derived_once")


@pytest.fixture(scope="module")
def hexa(shipped: Callable[[str], ModuleType]) -> Vehicle:
    return Vehicle(shipped("hexarotor_3link"))


# --- quintics


def smooth(time: Array) -> Motion:
    """Three coordinates with their exact rates and accelerations."""
    w, phase = np.array([1.0, 2.0, 0.6]), np.array([0.3, -1.0, 2.0])
    angle = np.multiply.outer(time, w) + phase
    return Motion(time, np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle))


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(2, 9),
    begin=st.floats(-5.0, 5.0),
    step=st.floats(0.001, 2.0),
)
def test_knots_are_met_and_rates_are_derivatives(
    seed: int, count: int, begin: float, step: float
) -> None:
    """Whatever the knots are, be they of one motion or not."""
    q, v, a = np.random.default_rng(seed).normal(size=(3, count, 4))
    # Of like size in units of the step, as rounding of powers of it is not the matter here.
    time, v, a = begin + step * np.arange(count), v / step, a / step**2
    reference = Reference(Motion(time, q, v, a))
    unit = step ** np.arange(3)[:, np.newaxis, np.newaxis]
    at_knots, given_there = np.stack(reference(time)), np.stack([q, v, a])
    assert_allclose(at_knots * unit, given_there * unit, rtol=0, atol=1e-8)
    # C² at the knots between: just before them they are the same, from the piece before.
    before = np.stack(reference(time[1:] - 1e-9 * step))
    assert_allclose(before * unit, given_there[:, 1:] * unit, rtol=0, atol=1e-5)
    inside = (time[:-1] + time[1:]) / 2.0
    for order in range(2):
        found = rate(lambda t, k=order: reference(t)[k], inside, step=0.1 * step)
        assert_allclose(
            found * step, reference(inside)[order + 1] * step, rtol=1e-7, atol=1e-7 / step**order
        )


def test_a_polynomial_of_fifth_degree_is_exact() -> None:
    time = np.array([1.0, 3.0])
    powers = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.3, -0.2, 0.05])

    def motion(t: Array) -> list[Array]:
        return [
            powers.deriv(order)(t)[:, np.newaxis] if order else powers(t)[:, np.newaxis]
            for order in range(3)
        ]

    between = np.linspace(1.0, 3.0, 11)
    for found, exact in zip(
        Reference(Motion(time, *motion(time)))(between), motion(between), strict=True
    ):
        assert_allclose(found, exact, rtol=1e-12, atol=1e-12)


def test_error_falls_with_the_sixth_power_of_the_spacing() -> None:
    every = np.linspace(0.0, 4.0, 1001)
    exact = smooth(every)
    errors = []
    for count in (9, 17, 33):
        q, v, a = Reference(smooth(np.linspace(0.0, 4.0, count)))(every)
        errors.append(
            [np.abs(q - exact.q).max(), np.abs(v - exact.v).max(), np.abs(a - exact.a).max()]
        )
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert_allclose(orders, [[6, 5, 4]] * 2, atol=0.25)
    # With the knots of simulations there is nothing left of it.
    q, v, _ = Reference(smooth(knots(4.0)))(every)
    assert_allclose(q, exact.q, rtol=0, atol=1e-14)
    assert_allclose(v, exact.v, rtol=0, atol=1e-11)


def test_before_and_after_the_ends_are_held() -> None:
    motion = smooth(np.linspace(1.0, 2.0, 5))
    reference = Reference(motion)
    assert (reference.begin, reference.end) == (1.0, 2.0)
    for found, given_there in zip(
        reference(np.array([-9.0, 1.0, 2.0, 9.0])), (motion.q, motion.v, motion.a), strict=True
    ):
        assert_allclose(found, given_there[[0, 0, -1, -1]], rtol=0, atol=1e-12)


def test_single_times_and_batches_agree() -> None:
    reference = Reference(smooth(np.linspace(0.0, 3.0, 7)))
    time = np.linspace(-0.5, 3.5, 12).reshape(3, 4)
    batch = reference(time)
    assert [part.shape for part in batch] == [(3, 4, 3)] * 3
    for place in np.ndindex(3, 4):
        for single, part in zip(reference(float(time[place])), batch, strict=True):
            assert_array_equal(single, part[place])


@pytest.mark.parametrize("duration", [0.001, 0.0049, 0.005, 0.0051, 1.0, 4 * np.pi, 3600.0])
def test_knots_are_even_and_near_enough(duration: float) -> None:
    time = knots(duration)
    assert (time[0], time[-1]) == (0.0, duration)
    steps = np.diff(time)
    assert steps.max() <= KNOT_SPACING * (1 + 1e-9)
    assert_allclose(steps, duration / len(steps), rtol=1e-6)
    # No more of them than that takes, but for rounding.
    assert len(steps) <= np.ceil(duration / KNOT_SPACING) + 1


# --- the base


def test_scenarios_that_ship_have_a_base_that_can_be_followed(hexa: Vehicle) -> None:
    # In a flip angles are singular; others have no path of the base.
    for name in {*shipped_scenarios()} - {"flip", "hold", "reach"}:
        scenario = read_scenario(name)
        time = knots(scenario.duration, 0.02)
        motion = desired_base(hexa, time, scenario.base, scenario.attitude)
        centre = hexa.positions(motion.q)[:, hexa.points.index("O2")]
        assert_allclose(centre, scenario.base(time)[:, 0], rtol=0, atol=1e-12)
        assert np.all(np.isfinite([motion.q, motion.v, motion.a]))


LEVEL = Level()


def endless_spin(path: Path, time: Array, arm_angles: Array) -> Turning:
    rate = np.full((len(time), 3), 1e300)
    return Turning(np.broadcast_to(np.eye(3), (len(time), 3, 3)), rate, 0.0 * rate)


@pytest.mark.parametrize(
    ("path", "attitude", "message"),
    [
        (Fixed((0, 0, 1)), Tangent(2), r"stands still at t = 0 s"),
        (Harmonic(x=(Term(1.0, 0.0, 8.0),)), Tangent(2), r"at t = 0\.\d+ s .* attitude jumps"),
        (Harmonic(z=(Term(1.0, 1.0),)), Tangent(2), r"is vertical at t = 0 s"),
        (Circle((0, 0, 0), 1.0, 4.0, (0, 1, 0)), Tangent(1), r"is vertical at t = 0 s"),
        (Circle((0, 0, 0), 1.0, 4.0), Tangent(7), r"base.attitude.arm: 7: there are arms 1 to 6"),
        (
            Harmonic(x=(Term(1e-3, 0.0, 2 * np.pi * 8000),)),
            LEVEL,
            r"at t = \S+ s the base moves too fast or its attitude jumps",
        ),
        (Fixed((0, 0, 1)), endless_spin, r"at t = 0 s the base turns too fast"),
        (
            Harmonic(x=(Term(1.0, 5e3),)),
            LEVEL,
            r"at t = 0\.00125 s the path .* exceeds",
        ),
        (Harmonic(y=(Term(1.0, 0.0, 1e12),)), LEVEL, r"at t = 0 s the path .* exceeds"),
        (
            lambda time: np.full((*np.shape(time), 4, 3), np.nan),
            LEVEL,
            r"at t = 0 s the path .* exceeds",
        ),
        (Fixed((0, 0, 1e12)), LEVEL, r"at t = 0 s the path .* exceeds"),
    ],
)
def test_a_base_that_cannot_be_followed_is_told_with_the_time(
    hexa: Vehicle, path: Path, attitude: Orientation, message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        desired_base(hexa, knots(1.0), path, attitude)


def test_the_time_of_a_singular_attitude_is_told(hexa: Vehicle) -> None:
    """Where arm 1 points straight up x-y-z is singular; knots lie on both sides of that."""
    upright, turn = 0.999375, 2 * np.pi / 3.0
    standing = Circle((0, 0, 0), 1.0, 3.0, (0, -1, 0), phase=-turn * upright)
    with pytest.raises(SingularAttitudeError, match="sequence xyz") as refusal:
        desired_base(hexa, knots(2.0), standing, Tangent(1))
    # The first instant of those checked, 1.25 ms apart, that is too near to it.
    first = np.ceil((upright - np.arcsin(SINGULAR_COSINE) / turn) / 0.00125) * 0.00125
    assert str(refusal.value).startswith(
        f"at t = {first:.6g} s the attitude reaches the singularity"
    )


@pytest.mark.slow
def test_turning_once_between_samples_is_not_taken_for_standing(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Every sample of the attitude is the same, and with O2 the origin all of the position too."""
    vehicle = random_vehicle(SEEDS["zyx"], tmp_path_factory)
    assert not vehicle.centre_offset(np.zeros(len(vehicle.coordinates))).any()
    spin = 2 * np.pi / (KNOT_SPACING / 4 / 32)
    with pytest.raises(UsageError, match=r"the base moves too fast .* off by \S+ rad;"):
        desired_base(vehicle, knots(1.0), Fixed((0, 0, 1)), Level(0.0, spin))


def test_a_base_gets_the_knots_it_takes(hexa: Vehicle) -> None:
    """Evenly spaced, and as few as hold to 1e-7 m and rad between them."""
    path = Harmonic(x=(Term(1e-3, 0.0, 2 * np.pi * 150),))
    time = knots(0.5)
    motion = desired_base(hexa, time, path, LEVEL)
    pieces = len(motion.time) - 1
    assert pieces in {100 * 2**n for n in range(1, 6)}
    assert_allclose(np.diff(motion.time), 0.5 / pieces, rtol=1e-9)

    def off(coarser: int) -> float:
        series = (s[::coarser] for s in (motion.time, motion.q, motion.v, motion.a))
        every = np.linspace(0.0, 0.5, 16 * pieces + 1)
        centre = hexa.positions(Reference(Motion(*series))(every)[0])[:, hexa.points.index("O2")]
        return float(np.linalg.norm(centre - path(every)[:, 0], axis=-1).max())

    assert off(1) < 1.2e-7
    assert off(2) > 1e-7


def test_a_long_motion_is_worked_on_in_parts(hexa: Vehicle) -> None:
    """Parts fit together, angles go on over their ends, and the share that is done is told."""
    turning_on = Level(0.3, 2.0)
    told: list[float] = []
    time = knots(30.0)
    motion = desired_base(hexa, time, Fixed((0, 0, 1)), turning_on, told.append)
    assert len(told) > 3
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert_array_equal(motion.time, time)
    heading = motion.q[:, 2] if np.ptp(motion.q[:, 2]) > 1.0 else motion.q[:, 0]
    assert_allclose(heading, 0.3 + 2.0 * time, rtol=0, atol=1e-11)


@pytest.mark.slow
def test_a_jump_late_in_a_motion_is_told(hexa: Vehicle) -> None:
    """In a later part than the first; all parts before it were fine."""
    back = Harmonic(x=(Term(1.0, 0.0, np.pi / 20, -np.pi / 20 * 10.001),))
    with pytest.raises(UsageError, match=r"at t = 10\.\d+ s"):
        desired_base(hexa, knots(12.0), back, Tangent(2))


def test_a_posture_is_held(hexa: Vehicle) -> None:
    base = desired_base(hexa, knots(0.1), Fixed((0, 0, 1)), LEVEL)
    posture = np.array([0.1, -1.0, 0.5])
    motion = with_joints(hexa, base, joint_motion(hexa, posture, {}, base.time))
    assert_array_equal(motion.q[:, hexa.arm], [posture] * len(motion.q))
    assert not motion.v[:, hexa.arm].any()
    assert not motion.a[:, hexa.arm].any()
    assert_array_equal(motion.q[:, hexa.layout.q.base], base.q[:, hexa.layout.q.base])
    assert not base.q[:, hexa.arm].any()


# --- how an arm hangs


def free(vehicle: Vehicle) -> JointBounds:
    return np.full(vehicle.joints, -np.inf), np.full(vehicle.joints, np.inf)


def turning(vehicle: Vehicle) -> Array:
    """Places of the revolute joints among the coordinates."""
    return np.array(
        [i for i, n in enumerate(vehicle.coordinates) if n in vehicle.joint_names and n[0] == "t"],
        dtype=int,
    )


def energies(vehicle: Vehicle, postures: Array) -> Array:
    """Potential energy under a level base, of arm coordinates (…, n)."""
    q = np.zeros((*postures.shape[:-1], len(vehicle.coordinates)))
    q[..., vehicle.arm] = postures
    return np.asarray(vehicle.potential_energy(q))


def assert_hangs(vehicle: Vehicle, limits: JointBounds) -> Array:
    """Within its limits, at rest but for what pushes into limits, and no random posture lower."""
    posture = rest_posture(vehicle, limits)
    assert np.all((posture >= limits[0]) & (posture <= limits[1]))
    hinges = turning(vehicle) - 3
    slides = np.setdiff1d(np.arange(vehicle.joints), hinges)
    assert_array_equal(posture[slides], np.clip(0.0, *limits)[slides])

    def energy(angles: Array) -> Array:
        postures = np.broadcast_to(posture, (*angles.shape[:-1], vehicle.joints)).copy()
        postures[..., hinges] = angles
        return energies(vehicle, postures)

    # The gradient that the module's inverse dynamics has, which other tests hold against it.
    q = np.zeros(len(vehicle.coordinates))
    q[vehicle.arm] = posture
    torque = vehicle.inverse_dynamics(q, 0 * q, 0 * q)[turning(vehicle)]
    angles = posture[hinges]
    low, high = limits[0][hinges], limits[1][hinges]
    inside = (angles > low) & (angles < high)
    assert_allclose(torque[inside], 0.0, atol=1e-9)
    assert np.all(torque[angles <= low] > -1e-9)
    assert np.all(torque[angles >= high] < 1e-9)
    # Hessian by differences of the energy, of the joints that can move both ways.
    step = 1e-3
    axes = step * np.eye(len(angles))[inside]
    hessian = np.array(
        [
            [
                energy(angles + a + b)
                - energy(angles + a - b)
                - energy(angles - a + b)
                + energy(angles - a - b)
                for b in axes
            ]
            for a in axes
        ]
    ) / (4 * step**2)
    if len(axes):
        assert np.linalg.eigvalsh(hessian).min() > -1e-5 * max(1.0, np.abs(hessian).max())
    shares = np.random.default_rng(4).uniform(size=(2000, len(angles)))
    low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
    assert np.all(energy(low + shares * (high - low)) > energy(angles) - 1e-9)
    return posture


def test_the_paper_s_arm_hangs_straight_down(hexa: Vehicle) -> None:
    assert_allclose(assert_hangs(hexa, free(hexa)), [0.0, -np.pi / 2, 0.0], atol=1e-12)


def test_arms_that_ship_hang(shipped: Callable[[str], ModuleType]) -> None:
    vehicle = Vehicle(shipped("quadrotor_2link"))
    assert_hangs(vehicle, free(vehicle))


@pytest.mark.slow
def test_any_arm_hangs(tmp_path_factory: pytest.TempPathFactory) -> None:
    vehicle = random_vehicle(SEEDS["zyx"], tmp_path_factory)
    assert_hangs(vehicle, free(vehicle))
    rng = np.random.default_rng(5)
    for _ in range(3):
        low = rng.uniform(-3.0, 2.0, vehicle.joints)
        assert_hangs(vehicle, (low, low + rng.uniform(0.1, 2.0, vehicle.joints)))


def test_an_arm_held_up_by_its_limits(hexa: Vehicle) -> None:
    """By hand: with the elbow held at 90° or more, the two links hang as a bent rod does."""
    low, high = free(hexa)
    low[2], high[2] = np.pi / 2, np.pi
    # Equal links at right angles about the shoulder: the first weighs at 1.5 m, the second at 3 m
    # and 1.5 m across, so the whole hangs with the first out of plumb by atan(1.5 / 4.5).
    lift = -np.pi / 2 - np.arctan2(1.5, 4.5)
    posture = assert_hangs(hexa, (low, high))
    assert posture[2] == np.pi / 2
    assert_allclose(np.exp(1j * posture[1]), np.exp(1j * lift), atol=1e-9)


@pytest.mark.slow
def test_what_hangs_all_but_at_zero_is_not_put_there(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Zero and the posture of rest differ by less energy than counts, but not by no torque."""
    robot = paper_family(3, 1)
    angle = Fraction("0.00001")
    robot = replace(robot, links=(replace(robot.links[0], theta_deg=-90 - angle),))
    folder = tmp_path_factory.mktemp("plumb")
    generate_robot(robot, robot_text(robot), folder, targets=("numpy",), verify=False)
    vehicle = Vehicle(load(folder / robot.name))
    assert_allclose(assert_hangs(vehicle, free(vehicle)), math.radians(angle), rtol=1e-6)


def test_without_an_arm_or_gravity_nothing_hangs(
    shipped: Callable[[str], ModuleType], hexa: Vehicle
) -> None:
    without = Vehicle(shipped("hexarotor"))
    assert rest_posture(without, free(without)).shape == (0,)
    weightless = Vehicle(hexa.module, {"gravity": 0.0})
    assert_array_equal(rest_posture(weightless, free(hexa)), [0, 0, 0])
    limits = np.array([0.5, -1.0, -1.0]), np.array([1.0, -0.5, 1.0])
    assert_array_equal(rest_posture(weightless, limits), [0.5, -0.5, 0.0])
