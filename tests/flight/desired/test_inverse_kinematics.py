"""Inverse kinematics: the base against the module's positions, the arm against its closed form."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import minimize
from support.angle_rates import bias_acceleration, rate_matrix
from support.differences import series_rate
from support.emitted import emitted_module
from support.random_vehicles import SEEDS, random_vehicle

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.attitude import Turning, rotation_matrix
from gibbs_codegen.flight.desired import inverse_kinematics as continuation
from gibbs_codegen.flight.desired.base_trajectory import base_motion, desired_base, knots
from gibbs_codegen.flight.desired.inverse_kinematics import (
    REACHED,
    Array,
    JointBounds,
    SingularArmError,
    UnreachableError,
    arm_motion,
    arm_rates,
    desired_with_tip,
    first_posture,
    reach,
)
from gibbs_codegen.flight.plant.vehicle import Flags, Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.orientation import Level, Orientation, Tangent
from gibbs_codegen.flight.scenario.paths import (
    Circle,
    Fixed,
    Harmonic,
    Line,
    Path,
    Sum,
    Term,
    Waypoints,
)
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.parts.body import RigidBody
from gibbs_codegen.robot.parts.link import Link
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load
from gibbs_codegen.verification.vectors import times

pytestmark = pytest.mark.usefixtures("derived_once")

CENTRE = Fixed((0.0, 0.0, 5.0))
LEVEL = Level(0.3)
# Length of the paper's arm, both links stretched, m.
ARM = 6.0


def free(vehicle: Vehicle) -> JointBounds:
    return np.full(vehicle.joints, -np.inf), np.full(vehicle.joints, np.inf)


def fly(
    vehicle: Vehicle,
    tip: Path,
    duration: float = 1.0,
    *,
    spacing: float = 0.01,
    base: Path = CENTRE,
    attitude: Orientation = LEVEL,
    limits: JointBounds | None = None,
    guess: Array | None = None,
) -> Motion:
    base_at = partial(desired_base, vehicle, centre=base, orientation=attitude)
    time = knots(duration, spacing)
    return desired_with_tip(vehicle, time, base_at, tip, limits or free(vehicle), guess)


def tip_of(vehicle: Vehicle, motion: Motion) -> Array:
    return vehicle.tip_pose(motion.q)[..., :3, 3]


def assert_consistent(motion: Motion, tolerance: float = 1e-8) -> None:
    """Rates are the derivatives of coordinates along the path, and accelerations of rates."""
    step = motion.time[1] - motion.time[0]
    for series, rates in ((motion.q, motion.v), (motion.v, motion.a)):
        scale = 1.0 + np.abs(rates).max()
        assert_allclose(series_rate(series, step), rates[4:-4], rtol=0, atol=tolerance * scale)


@pytest.fixture(scope="module")
def hexa(shipped: Callable[[str], ModuleType]) -> Vehicle:
    return Vehicle(shipped("hexarotor_3link"))


@pytest.fixture(scope="module")
def octo(shipped: Callable[[str], ModuleType]) -> Vehicle:
    return Vehicle(shipped("octorotor_7link"))


@pytest.fixture(scope="module")
def any_vehicle(
    hexa: Vehicle, tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], Vehicle]:
    """A vehicle with a given attitude sequence."""

    def vehicle(sequence: str) -> Vehicle:
        found = hexa if sequence == "xyz" else random_vehicle(SEEDS[sequence], tmp_path_factory)
        assert found.attitude == sequence
        return found

    return vehicle


@pytest.fixture(scope="module")
def short_arm(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], Vehicle]:
    """Members of the paper's family with three rotors and an arm of 0, 1 or 2 joints."""
    folder = tmp_path_factory.mktemp("short")
    made: dict[int, Vehicle] = {}

    def vehicle(links: int) -> Vehicle:
        if links not in made:
            robot = paper_family(3, links)
            generate_robot(robot, robot_text(robot), folder, targets=("numpy",), verify=False)
            made[links] = Vehicle(load(folder / robot.name))
        return made[links]

    return vehicle


# --- the base


BASE_PATH = Harmonic(
    x=(Term(2.0, -0.05, 1.5),), y=(Term(2.0, -0.05, 1.5, -np.pi / 2),), z=(Term(0.3, 0.0, 1.0),)
)


class Tumbling:
    """An attitude that goes round about the first and the third axis of its sequence."""

    def __init__(self, sequence: str) -> None:
        self.sequence = sequence

    def angles(self, time: Array) -> tuple[Array, Array, Array]:
        """Angles, rates and accelerations (s, 3)."""
        zero = 0.0 * time
        angles = [3.0 + 1.5 * time, 0.8 * np.sin(time), 1.0 - time + 0.3 * np.cos(2 * time)]
        rates = [zero + 1.5, 0.8 * np.cos(time), -1.0 - 0.6 * np.sin(2 * time)]
        growth = [zero, -0.8 * np.sin(time), -1.2 * np.cos(2 * time)]
        first, second, third = (np.stack(c, axis=-1) for c in (angles, rates, growth))
        return first, second, third

    def __call__(self, path: Path, time: Array, arm_angles: Array) -> Turning:
        """As an orientation is called, whatever the path."""
        angles, rates, growth = self.angles(time)
        # `growth` takes the place of rates in E θ̈.
        spin_rate = times(rate_matrix(self.sequence, angles), growth)
        return Turning(
            rotation_matrix(self.sequence, angles),
            times(rate_matrix(self.sequence, angles), rates),
            spin_rate + bias_acceleration(self.sequence, angles, rates),
        )


@pytest.mark.parametrize("sequence", ["xyz"])
def test_base_is_exact_and_goes_on_through_half_turns(
    any_vehicle: Callable[[str], Vehicle], sequence: str
) -> None:
    vehicle, attitude = any_vehicle(sequence), Tumbling(sequence)
    time = np.linspace(0.0, 9.0, 901)
    motion = desired_base(vehicle, time, BASE_PATH, attitude)
    # The same angles, more than a turn of them, but for whole turns at the start.
    exact = attitude.angles(time)
    turns = (motion.q[0, :3] - exact[0][0]) / (2 * np.pi)
    assert_allclose(turns, np.round(turns), atol=1e-12)
    assert np.all(np.abs(motion.q[0, :3]) <= np.pi)
    start = 2 * np.pi * np.round(turns)
    assert_allclose(motion.q[:, :3], exact[0] + start, rtol=0, atol=1e-12)
    assert_allclose(motion.v[:, :3], exact[1], rtol=0, atol=1e-12)
    assert_allclose(motion.a[:, :3], exact[2], rtol=0, atol=1e-11)
    assert np.ptp(motion.q[:, [0, 2]], axis=0).min() > 2.0 * np.pi
    centre = vehicle.positions(motion.q)[:, vehicle.points.index("O2")]
    assert_allclose(centre, BASE_PATH(time)[:, 0], rtol=0, atol=1e-12)
    assert_consistent(motion)
    assert not motion.q[:, vehicle.arm].any()


# A whole turn about the vertical brings these to no singularity.
@pytest.mark.parametrize("sequence", ["xyz"])
@pytest.mark.parametrize("attitude", [Tangent(2)])
def test_arms_point_where_they_should_on_and_on(
    any_vehicle: Callable[[str], Vehicle], sequence: str, attitude: Orientation
) -> None:
    vehicle = any_vehicle(sequence)
    time = np.linspace(0.0, 9.0, 901)
    motion = desired_base(vehicle, time, BASE_PATH, attitude)
    places = vehicle.positions(motion.q)
    column = {name: places[:, k] for k, name in enumerate(vehicle.points)}
    if isinstance(attitude, Tangent):
        arm = column["motor2"] - column["O2"]
        ahead = BASE_PATH(time)[:, 1]
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    else:
        arm = column["O2"] - column["motor1"]
        heading = 3.0 + 1.5 * time
        ahead = np.stack([np.cos(heading), np.sin(heading), 0 * time], axis=1)
    assert_allclose(arm / np.linalg.norm(arm, axis=1, keepdims=True), ahead, atol=1e-12)
    # No jumps: the angle that turns with the base goes on beyond ±π.
    assert np.abs(np.diff(motion.q[:, :3], axis=0)).max() < 0.2
    assert np.ptp(motion.q[:, :3], axis=0).max() > 2.0 * np.pi
    assert_consistent(motion)


@pytest.mark.parametrize("sequence", ["xyz"])
def test_base_motion_of_a_given_rotation(
    any_vehicle: Callable[[str], Vehicle], sequence: str
) -> None:
    """Rotation in, the same rotation out: that of the module's points."""
    vehicle = any_vehicle(sequence)
    time = np.linspace(0.0, 2.0, 21)
    turning = Tangent(1)(BASE_PATH, time, vehicle.arm_angles())
    motion = base_motion(vehicle, time, BASE_PATH(time), turning)
    assert_allclose(vehicle.base_rotation(motion.q), turning.rotation, rtol=0, atol=1e-13)


# --- the paper's arm and its closed form


def closed_forms(place: Array) -> list[Array]:
    """Joints of the paper's arm that put its tip at `place`, in arm 1's frame from the centre.

    Joint 7 turns the plane of the arm about the base normal, joints 8 and 9 turn links of 3 m
    upwards in it: out = 3 cos θ₈ + 3 cos(θ₈ + θ₉) and up = 3 sin θ₈ + 3 sin(θ₈ + θ₉).
    """
    found = []
    for side in (1.0, -1.0):
        out, up = side * np.hypot(place[0], place[1]), place[2]
        yaw = np.arctan2(side * place[1], side * place[0])
        for elbow in (1.0, -1.0):
            bend = elbow * np.arccos((out**2 + up**2 - 18.0) / 18.0)
            lift = np.arctan2(up, out) - np.arctan2(np.sin(bend), 1.0 + np.cos(bend))
            found.append(np.array([yaw, lift, bend]))
    return found


def closed_form_number(vehicle: Vehicle, q: Array, target: Array) -> int:
    """Which of the closed forms the arm of `q` is in; fails if in none."""
    centre = vehicle.positions(q)[vehicle.points.index("O2")]
    place = vehicle.base_rotation(q).T @ (target - centre)
    off = [np.abs(np.exp(1j * q[vehicle.arm]) - np.exp(1j * f)).max() for f in closed_forms(place)]
    assert min(off) < 1e-8
    return int(np.argmin(off))


def test_closed_form_puts_the_tip_there(hexa: Vehicle) -> None:
    q = np.zeros(9)
    place = np.array([2.0, -1.0, -3.0])
    for joints in closed_forms(place):
        q[hexa.arm] = joints
        centre = hexa.positions(q)[hexa.points.index("O2")]
        assert_allclose(hexa.tip_pose(q)[:3, 3] - centre, place, atol=1e-14)


@pytest.mark.slow
def test_the_paper_s_arm_is_in_closed_form(hexa: Vehicle) -> None:
    paper = read_scenario("paper")
    assert paper.arm.tip is not None
    time = knots(paper.duration, 0.02)
    base = desired_base(hexa, time, paper.base, paper.attitude)
    motion = desired_with_tip(hexa, time, lambda _: base, paper.arm.tip, free(hexa))
    targets = paper.arm.tip(time)[:, 0]
    assert_allclose(tip_of(hexa, motion), targets, rtol=0, atol=REACHED)
    forms = {closed_form_number(hexa, *pair) for pair in zip(motion.q, targets, strict=True)}
    assert len(forms) == 1
    # The base's part is as it was.
    assert_array_equal(motion.q[:, hexa.layout.q.base], base.q[:, hexa.layout.q.base])
    fine = fly(hexa, paper.arm.tip, 2.0, spacing=0.005, base=paper.base, attitude=paper.attitude)
    assert_consistent(fine)


@pytest.mark.slow
def test_tip_moves_as_its_path_wants(hexa: Vehicle, octo: Vehicle) -> None:
    """ẋ = J v and ẍ = J a + J̇ v at every knot, with a base that moves and turns."""
    beside = Circle((0.3, 0.1, -0.35), 0.1, 2.0, normal=(1, 0, 1))
    for vehicle, tip in ((hexa, Circle((3, 0, -2), 0.5, 2.0)), (octo, beside)):
        path = Sum((BASE_PATH, tip))
        motion = fly(vehicle, path, 1.0, base=BASE_PATH, attitude=Tangent(3))
        wanted = path(motion.time)
        jacobian = vehicle.tip_jacobian(motion.q)[:, :3]
        speed = np.einsum("tij,tj->ti", jacobian, motion.v)
        bias = vehicle.tip_bias_acceleration(motion.q, motion.v)[:, :3]
        acceleration = np.einsum("tij,tj->ti", jacobian, motion.a) + bias
        assert_allclose(tip_of(vehicle, motion), wanted[:, 0], rtol=0, atol=REACHED)
        assert_allclose(speed, wanted[:, 1], rtol=0, atol=1e-10)
        assert_allclose(acceleration, wanted[:, 2], rtol=0, atol=1e-9)


def test_knots_at_once_are_those_from_one_to_the_next(
    hexa: Vehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    tip, taken = Circle((0.0, 0.0, 2.0), 1.5, 4.0), []
    advance = continuation._Continuation.advance

    def counted(arm: Any, k: int) -> None:
        taken.append(k)
        advance(arm, k)

    monkeypatch.setattr(continuation._Continuation, "advance", counted)
    at_once = fly(hexa, tip)
    assert len(taken) < len(at_once.time) / 4
    monkeypatch.setattr(continuation._Continuation, "solved_at_once", lambda arm: 1)
    one_by_one = fly(hexa, tip)
    for name, room in (("q", 1e-9), ("v", 1e-8), ("a", 1e-7)):
        assert_allclose(getattr(at_once, name), getattr(one_by_one, name), atol=room)


def test_of_all_postures_one_far_from_singular_and_near_zero_is_chosen(hexa: Vehicle) -> None:
    target = (2.0, -1.0, 2.0)
    chosen = fly(hexa, Fixed(target), 0.01, attitude=Level()).q[0]
    forms = closed_forms(np.array([2.0, -1.0, -3.0]))

    def measure(joints: Array) -> float:
        q = chosen.copy()
        q[hexa.arm] = joints
        return float(np.linalg.svd(hexa.tip_jacobian(q)[:3, hexa.arm], compute_uv=False)[-1])

    assert measure(chosen[hexa.arm]) == pytest.approx(max(map(measure, forms)), rel=1e-6)
    wrapped = [np.angle(np.exp(1j * form)) for form in forms]
    nearest = min(np.linalg.norm(form) for form in wrapped)
    assert np.linalg.norm(chosen[hexa.arm]) == pytest.approx(nearest, rel=1e-6)
    assert np.all(np.abs(chosen[hexa.arm]) <= np.pi)


def test_the_choice_of_a_posture_is_the_same_every_time(hexa: Vehicle, octo: Vehicle) -> None:
    for vehicle, target in ((hexa, (1.0, 2.0, 3.0)), (octo, (0.3, 0.2, 4.5))):
        first, second = (fly(vehicle, Fixed(target), 0.02).q for _ in range(2))
        assert_array_equal(first, second)


@pytest.mark.parametrize("number", range(4))
def test_a_guess_is_where_the_search_begins(hexa: Vehicle, number: int) -> None:
    place = np.array([2.0, -1.0, -3.0])
    target = place + np.array([0.0, 0.0, 5.0])
    guess = closed_forms(place)[number] + [0.1, -0.1, 0.1]
    motion = fly(hexa, Fixed(tuple(target)), 0.1, attitude=Level(), guess=guess)
    assert closed_form_number(hexa, motion.q[0], target) == number
    # It stays there, and is not a posture a turn away either.
    assert_allclose(motion.q[:, hexa.arm], [guess] * len(motion.q), atol=0.3)


def test_through_the_axis_of_the_first_joint(hexa: Vehicle) -> None:
    """Straight across the base normal the plane of the arm need not turn."""
    motion = fly(hexa, Line((2.5, 0, 3), (-2.5, 0, 3), 1.0), attitude=Level())
    assert np.ptp(motion.q[:, 3]) < 1e-6
    assert_allclose(tip_of(hexa, motion)[-1], (-2.5, 0, 3), atol=1e-9)


# --- redundant arms, and prismatic joints


@pytest.mark.slow
def test_a_redundant_arm_moves_slowly_and_consistently(octo: Vehicle) -> None:
    tip = Circle((0.25, 0.1, 4.6), 0.12, 1.5, normal=(1, 1, 0.5))
    motion = fly(octo, tip, 1.5, spacing=0.005)
    assert_allclose(tip_of(octo, motion), tip(motion.time)[:, 0], rtol=0, atol=REACHED)
    assert_consistent(motion)
    # Of all rates that move the tip so, the least: nothing of them is in the null space.
    jacobian = octo.tip_jacobian(motion.q)[:, :3, octo.arm]
    null = np.eye(7) - np.linalg.pinv(jacobian) @ jacobian
    assert_allclose(np.einsum("tij,tj->ti", null, motion.v[:, octo.arm]), 0.0, atol=1e-10)
    assert np.abs(motion.v[:, octo.arm]).max() > 0.1


@pytest.mark.slow
def test_knots_of_a_redundant_arm_may_be_as_far_apart_as_one_likes(octo: Vehicle) -> None:
    tip = Circle((0.25, 0.1, 4.6), 0.12, 1.5, normal=(1, 1, 0.5))
    coarse, fine = (fly(octo, tip, 0.6, spacing=spacing).q for spacing in (0.02, 0.005))
    assert_allclose(coarse[-1], fine[-1], rtol=0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("sequence", ["yxz"])
def test_arms_with_prismatic_joints(any_vehicle: Callable[[str], Vehicle], sequence: str) -> None:
    vehicle = any_vehicle(sequence)
    assert any(name.startswith("d_") for name in vehicle.joint_names)
    start = np.zeros(len(vehicle.coordinates))
    joints = np.random.default_rng(3).uniform(0.3, 0.9, vehicle.joints)
    start[vehicle.arm] = joints
    level = desired_base(vehicle, knots(0.1), CENTRE, Level(0.3))
    there = level.q[0].copy()
    there[vehicle.arm] = joints
    least = np.linalg.svd(vehicle.tip_jacobian(there)[:3, vehicle.arm], compute_uv=False)[-1]
    assert least > 0.05
    x, y, z = vehicle.tip_pose(there)[:3, 3]
    tip = Circle((x - 0.05, y, z), 0.05, 1.5, normal=(0, 0, 1))
    motion = fly(vehicle, tip, 0.75, spacing=0.005, guess=joints)
    assert_allclose(motion.q[0, vehicle.arm], joints, atol=1e-9)
    assert_allclose(tip_of(vehicle, motion), tip(motion.time)[:, 0], rtol=0, atol=REACHED)
    assert_consistent(motion)


# --- limits


def reached_and_left(octo: Vehicle) -> tuple[Path, Motion, JointBounds, int]:
    """A path, its motion without limits, and limits of one joint, which that motion crosses."""
    tip = Circle((0.25, 0.1, 4.6), 0.12, 1.5, normal=(1, 1, 0.5))
    unlimited = fly(octo, tip, 1.5)
    arm = unlimited.q[:, octo.arm]
    joint = int(np.argmax(np.ptp(arm, axis=0)))
    low, high = free(octo)
    high[joint] = arm[0, joint] + 0.6 * (arm[:, joint].max() - arm[0, joint])
    low[joint] = arm[0, joint] - 3.0
    assert high[joint] > arm[0, joint] + 0.01
    return tip, unlimited, (low, high), joint


@pytest.mark.slow
def test_joints_brake_before_their_limits_and_leave_them_again(octo: Vehicle) -> None:
    tip, unlimited, limits, joint = reached_and_left(octo)
    start = unlimited.q[0, octo.arm]
    motion = fly(octo, tip, 1.5, limits=limits, guess=start)
    assert_allclose(tip_of(octo, motion), tip(motion.time)[:, 0], rtol=0, atol=REACHED)
    kept = motion.q[:, octo.arm][:, joint]
    room = limits[1][joint] - kept
    nearest = int(np.argmin(room))
    assert 1e-3 < room[nearest] < 0.05
    assert 0 < nearest < len(kept) - 20
    assert room[-1] > 0.3
    # No jump in any rate: on a fine grid between knots too, accelerations stay those of a motion
    # that takes a second. With a jump at the limit they would be a hundred times as large.
    reference = octo.kinematics.reference(motion)
    q, v, a = reference(np.linspace(0.0, 1.5, 6001))
    assert np.abs(a[:, octo.arm_rates]).max() < 4.0 * np.abs(unlimited.a[:, octo.arm_rates]).max()
    assert np.abs(np.diff(v[:, octo.arm_rates], axis=0)).max() < 0.01
    assert_allclose(
        tip_of(octo, Motion(q, q, v, a)), tip(np.linspace(0, 1.5, 6001))[:, 0], atol=1e-6
    )
    # Where no limit is near, it changes nothing.
    brakes = int(np.argmax(unlimited.v[:, octo.arm_rates][:, joint] > 4.0 * room))
    assert brakes > 20
    assert_allclose(motion.q[:brakes], unlimited.q[:brakes], atol=1e-9)


def braking_state(octo: Vehicle) -> tuple[Array, Array, JointBounds]:
    """Coordinates, what the tip is to do, and limits at which two joints brake and one rests."""
    q = desired_base(octo, knots(0.1), CENTRE, LEVEL).q[0]
    q[octo.arm] = 0.3 + 0.1 * np.arange(octo.joints)
    target = np.array([[0.0, 0.0, 0.0], [0.4, -0.3, 0.5], [1.0, 2.0, -1.0]])
    still = np.zeros(octo.layout.v.size)
    rates = arm_rates(octo, (q, still, still), target, free(octo)).rates
    low, high = free(octo)
    for joint, room in zip(np.argsort(-np.abs(rates))[:3], (0.05, 0.02, 0.0), strict=True):
        bound = high if rates[joint] > 0.0 else low
        bound[joint] = q[octo.arm][joint] + np.sign(rates[joint]) * room
    return q, target, (low, high)


def test_rates_near_limits_are_those_of_least_cost(octo: Vehicle) -> None:
    """Beyond 4 d/s, d before its limit, a joint costs (d + 3) / d as much: a convex programme."""
    q, target, limits = braking_state(octo)
    still = np.zeros(octo.layout.v.size)
    found = arm_rates(octo, (q, still, still), target, limits)
    rooms = q[octo.arm] - limits[0], limits[1] - q[octo.arm]

    def cost(rates: Array) -> float:
        room = np.where(rates > 0.0, rooms[1], rooms[0])
        beyond = np.maximum(np.abs(rates) - 4.0 * room, 0.0)
        # One that has come to its limit is kept there by bounds.
        steep = np.divide(3.0 * beyond**2, room, out=0.0 * rates, where=room > 0.0)
        return float(np.sum(rates**2 + steep))

    jacobian = octo.tip_jacobian(q)[:3, octo.arm]
    best = minimize(
        cost,
        np.linalg.pinv(jacobian) @ target[1],
        bounds=[
            (0.0 if d == 0.0 else None, 0.0 if u == 0.0 else None)
            for d, u in zip(*rooms, strict=True)
        ],
        constraints={"type": "eq", "fun": lambda rates: jacobian @ rates - target[1]},
        options={"ftol": 1e-13, "maxiter": 500},
    )
    assert best.success
    assert found.at_limit.sum() == 1
    assert_allclose(jacobian @ found.rates, target[1], atol=1e-12)
    assert cost(found.rates) <= best.fun * (1.0 + 1e-9)
    assert_allclose(found.rates, best.x, atol=1e-4)


def test_accelerations_near_limits_are_those_of_the_rates(octo: Vehicle) -> None:
    q, target, limits = braking_state(octo)
    still, step = np.zeros(octo.layout.v.size), 1e-5
    found = arm_rates(octo, (q, still, still), target, limits)
    moving = still.copy()
    moving[octo.arm_rates] = found.rates
    ahead, behind = (
        arm_rates(
            octo,
            (octo.integrate(q, sign * step * moving), still, still),
            target + sign * step * np.vstack([target[1:], np.zeros(3)]),
            limits,
        ).rates
        for sign in (1.0, -1.0)
    )
    assert_allclose(found.accelerations, (ahead - behind) / (2.0 * step), rtol=1e-6, atol=1e-6)


@pytest.mark.slow
def test_without_redundancy_only_a_limit_that_is_crossed_matters(hexa: Vehicle) -> None:
    tip = Circle((2.0, -1.0, 3.0), 0.5, 2.0)
    unlimited = fly(hexa, tip, attitude=Level())
    joints = unlimited.q[:, hexa.arm]
    near = joints.min(axis=0) - 1e-3, joints.max(axis=0) + 1e-3
    motion = fly(hexa, tip, attitude=Level(), limits=near, guess=joints[0])
    assert_allclose(motion.q, unlimited.q, atol=1e-8)
    assert_allclose(motion.v, unlimited.v, atol=1e-8)
    assert_allclose(motion.a, unlimited.a, atol=1e-6)
    crossed = joints.min(axis=0) - 1.0, joints.max(axis=0) + np.array([1.0, 1.0, -0.05])
    with pytest.raises(UsageError, match=r"at its limits|cannot reach its path"):
        fly(hexa, tip, attitude=Level(), limits=crossed, guess=joints[0])


def test_limits_choose_the_posture(hexa: Vehicle) -> None:
    place = np.array([2.0, -1.0, -3.0])
    target = Fixed((2.0, -1.0, 2.0))
    for number, form in enumerate(closed_forms(place)):
        limits = form - 0.3, form + 0.2
        motion = fly(hexa, target, 0.02, attitude=Level(), limits=limits)
        assert closed_form_number(hexa, motion.q[0], np.array([2.0, -1.0, 2.0])) == number
        assert np.all((motion.q[:, hexa.arm] >= limits[0]) & (motion.q[:, hexa.arm] <= limits[1]))


@pytest.mark.slow
def test_what_limits_put_out_of_reach_is_told(hexa: Vehicle) -> None:
    """With joint 9 held from 30° to 60° on, the tip comes no nearer than the law of cosines has."""
    low, high = free(hexa)
    low[2], high[2] = np.radians([30.0, 60.0])
    target = np.array([2.0, 0.0, 5.0])
    with pytest.raises(UnreachableError, match="m away, with theta_9 at its limit; ") as refusal:
        fly(hexa, Fixed(tuple(target)), 0.05, attitude=Level(), limits=(low, high))
    nearest = 6.0 * np.cos(np.radians(30.0)) - 2.0
    assert_allclose(refusal.value.distances, nearest, rtol=1e-7)


def test_an_arm_with_all_joints_at_their_limits_does_not_move(hexa: Vehicle) -> None:
    start = np.array([0.0, -1.0, -0.5])
    q = desired_base(hexa, knots(0.01), CENTRE, Level()).q[0]
    q[hexa.arm] = start
    x, y, z = hexa.tip_pose(q)[:3, 3]
    away = Sum((Fixed((x, y, z)), Harmonic(z=(Term(0.2, 0.0, 1.0, -np.pi / 2),))))
    held = start - 1e-12, start + 1e-12
    base = desired_base(hexa, np.array([0.0, 1e-9]), CENTRE, Level())
    with pytest.raises(SingularArmError, match=r"at its limits at t = 0 s.*0\.2 of the speed, m/s"):
        arm_motion(hexa, base, away, held, start)


@pytest.mark.slow
def test_a_single_joint_at_its_limit_does_not_move(short_arm: Callable[[int], Vehicle]) -> None:
    vehicle = short_arm(1)
    upwards = Circle((0, 0, 5), 3.0, 5.0, normal=(0, -1, 0))
    base = desired_base(vehicle, np.array([0.0, 1e-10]), CENTRE, Level())
    speed = f"{3.0 * 2 * np.pi / 5.0:.3g} of the speed, m/s, is missing"
    with pytest.raises(SingularArmError, match=f"at its limits at t = 0 s.*{re.escape(speed)}"):
        arm_motion(vehicle, base, upwards, (np.array([-1.0]), np.zeros(1)), np.zeros(1))


# --- what cannot be reached


@pytest.mark.parametrize("path", [Waypoints([0, 0.5, 1], [(4, 0, 5), (8, 0, 5), (4, 0, 5)])])
def test_unreachable_points_are_told_with_times_and_distances(hexa: Vehicle, path: Path) -> None:
    time = knots(1.0, 0.01)
    with pytest.raises(UnreachableError) as refusal:
        fly(hexa, path, attitude=Level())
    error = refusal.value
    beyond = np.linalg.norm(path(time)[:, 0] - (0.0, 0.0, 5.0), axis=1) - ARM
    far = beyond > REACHED
    assert 0 < far.sum() < len(time)
    assert_array_equal(error.times, time[far])
    assert_allclose(error.distances, beyond[far], rtol=0, atol=2e-6)
    said = re.fullmatch(
        r"the tip cannot reach its path at (\d+) of (\d+) instants tried, from t = (\S+) s to "
        r"(\S+) s; at t = (\S+) s it stays (\S+) m away; move the path within the arm's reach, or "
        r"choose a scenario without a path of the tip, such as --scenario hold",
        str(error),
    )
    assert said is not None
    worst = int(np.argmax(beyond))
    facts = [far.sum(), len(time), time[far][0], time[far][-1], time[worst], beyond[worst]]
    assert_allclose([float(word) for word in said.groups()], facts, rtol=6e-3)


@pytest.mark.slow
def test_beyond_its_reach_only_some_of_a_path_is_tried(hexa: Vehicle) -> None:
    """Up to the first knot out of reach every knot, then one of five, and always the last."""
    path = Line((1, 0, 0.5), (9, 0, 5), 1.0)
    time = knots(1.0, 0.001)
    beyond = np.linalg.norm(path(time)[:, 0] - (0.0, 0.0, 5.0), axis=1) - ARM
    first = int(np.argmax(beyond > REACHED))
    with pytest.raises(UnreachableError) as refusal:
        fly(hexa, path, spacing=0.001, attitude=Level())
    tried = [k for k in range(first, len(time)) if k in (first, len(time) - 1) or k % 5 == 0]
    assert_array_equal(refusal.value.times, time[tried])
    assert_allclose(refusal.value.distances, beyond[tried], rtol=0, atol=2e-6)


def test_reach_comes_as_near_as_it_can_and_is_finite(hexa: Vehicle) -> None:
    q = desired_base(hexa, knots(0.01), CENTRE, Level()).q[0]
    for target in ([0.0, 0.0, 5.0], [0.0, 0.0, 11.0], [0.0, 0.0, 25.0], [1e6, 0, 0], [6, 0, 5]):
        place = np.array(target, dtype=np.float64)
        for start in ([0.0, 0.0, 0.0], [0.3, -1.0, 1.0], [0.0, np.pi / 2, 0.0]):
            q[hexa.arm] = start
            found, left = reach(hexa, q, place, free(hexa))
            assert np.all(np.isfinite(found))
            assert left == pytest.approx(np.linalg.norm(hexa.tip_pose(found)[:3, 3] - place))


@pytest.mark.slow
def test_an_arm_on_the_edge_of_its_reach_can_go_along_it(hexa: Vehicle) -> None:
    """Stretched all the way the arm is singular, but not in the direction of this path."""
    motion = fly(hexa, Circle((0, 0, 5), ARM, 5.0), 0.5, attitude=Level())
    assert_allclose(motion.v[:, 3], 2 * np.pi / 5.0, rtol=1e-6)


@pytest.mark.slow
def test_a_singular_arm_that_cannot_follow_is_told(hexa: Vehicle) -> None:
    # At t = 0 stretched, and the path bends otherwise than an arm of 6 m would let it.
    with pytest.raises(SingularArmError) as refusal:
        fly(hexa, Circle((3, 0, 5), 3.0, 4.0), 0.1, attitude=Level())
    # Missing: v²/3 − v²/6 towards the centre, with v = 2π·3/4 m/s.
    missing = (2 * np.pi * 3 / 4) ** 2 / 6
    assert str(refusal.value) == (
        "the arm is singular or at its limits at t = 0 s: its joints (theta_7, theta_8, theta_9) "
        "cannot move the tip along its path; "
        f"{missing:.3g} of the acceleration, m/s², is missing"
    )


def humming(frequency: float) -> Path:
    wave = Term(1e-4, 0.0, 2 * np.pi * frequency)
    return Sum((Fixed((3, 0, 3)), Harmonic(x=(wave,))))


def test_a_tip_path_gets_the_knots_it_takes(hexa: Vehicle) -> None:
    motion = fly(hexa, humming(200.0), 0.1, spacing=0.005)
    pieces = len(motion.time) - 1
    assert pieces in {20 * 2**n for n in range(1, 6)}
    assert_allclose(np.diff(motion.time), 0.1 / pieces, rtol=1e-9)
    time = np.linspace(0.0, 0.1, 7001)
    off = hexa.tip_pose(Reference(motion)(time)[0])[:, :3, 3] - humming(200.0)(time)[:, 0]
    assert np.linalg.norm(off, axis=-1).max() < 1.5e-7


def test_a_tip_path_too_fast_for_knots_is_told(hexa: Vehicle) -> None:
    with pytest.raises(
        UsageError,
        match=r"at t = \S+ s the arm, or the path of its tip, moves too fast: with knots "
        r"0.000156 s apart \(the closest .*\) the trajectory is off by \S+ m; slow it down",
    ) as refusal:
        fly(hexa, humming(6000.0), 0.1, spacing=0.005)
    missed = re.search(r"off by (\S+) m", str(refusal.value))
    assert missed is not None
    assert 1e-7 < float(missed[1]) < 1e-3


@pytest.mark.slow
def test_a_path_that_begins_on_the_axis_of_a_joint(hexa: Vehicle) -> None:
    """The first joint is turned the way the path goes on, which its first place leaves open."""
    for heading in (0.0, 0.4, -2.0):
        end = (2 * np.cos(heading), 2 * np.sin(heading), 2.0)
        motion = fly(hexa, Line((0, 0, 2), end, 1.0), spacing=0.005, attitude=Level())
        assert_allclose(np.sin(motion.q[:, 3] - heading), 0.0, atol=1e-6)
        assert np.abs(motion.v[:, 3]).max() < 1e-3


def test_a_singular_arm_is_not_called_too_short(hexa: Vehicle) -> None:
    """Finding to begin with its first joint across the path, the arm does not find onto it."""
    start = fly(hexa, Fixed((0, 0, 2)), 0.1, attitude=Level()).q[0, hexa.arm]
    start[0] = np.pi / 2
    with pytest.raises(SingularArmError, match=r"is singular: .* it stays \S+ m away; .* guess"):
        fly(hexa, Line((0, 0, 2), (3, 0, 2), 1.0), 0.003, attitude=Level(), guess=start)


def test_redundant_joints_do_not_hide_that_the_tip_is_off(
    octo: Vehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The distance left is that of the coordinates which are returned."""
    calls = 0

    def failing(arm: Any, k: int, at_limit: Flags) -> None:
        nonlocal calls
        calls += 1
        holding(arm, k, at_limit)
        arm.distances[k] = arm.distances[k] if calls % 4 else 0.25

    holding = continuation._Continuation._reach
    monkeypatch.setattr(continuation._Continuation, "_reach", failing)
    with pytest.raises(UnreachableError, match=r"it stays 0\.25 m away"):
        fly(octo, Circle((0.25, 0.1, 4.6), 0.12, 1.5, normal=(1, 1, 0.5)), 0.05)


def test_a_tip_path_beyond_all_bounds_is_told(hexa: Vehicle) -> None:
    growing = Harmonic(x=(Term(1.0, growth=1000.0),))
    with pytest.raises(UsageError, match=r"at t = 0\.01 s the path of the tip .* exceeds 1e\+12"):
        fly(hexa, growing, 1.0)


# --- short arms


@pytest.mark.slow
def test_a_machine_without_an_arm(short_arm: Callable[[int], Vehicle]) -> None:
    with pytest.raises(UsageError, match="rotor3_0link: has no arm"):
        fly(short_arm(0), Fixed((0, 0, 4)))


def test_arms_of_one_joint(short_arm: Callable[[int], Vehicle]) -> None:
    """A link of 3 m that turns upwards along arm 1."""
    vehicle = short_arm(1)
    # Standing circle about the centre, in the plane of X and Z with heading 0; −Y is its axis.
    around = Circle((0, 0, 5), 3.0, 5.0, normal=(0, -1, 0), phase=-1.0)
    motion = fly(vehicle, around, attitude=Level())
    assert_allclose(motion.q[:, 3], -1.0 + 2 * np.pi / 5 * motion.time, atol=1e-9)
    assert_allclose(motion.v[:, 3], 2 * np.pi / 5, rtol=1e-9)
    with pytest.raises(UnreachableError, match="at 101 of 101 instants") as refusal:
        fly(vehicle, Fixed((2, 0, 5)), attitude=Level())
    assert_allclose(refusal.value.distances, 1.0, rtol=1e-9)
    with pytest.raises((UnreachableError, SingularArmError)):
        fly(vehicle, Line((3, 0, 5), (3, 1, 5), 1.0), attitude=Level())


@pytest.mark.slow
def test_arms_of_two_joints(short_arm: Callable[[int], Vehicle]) -> None:
    """A link of 3 m on a turntable reaches a sphere and nothing else."""
    vehicle = short_arm(2)
    level = Circle((0, 0, 5 - 1.8), 2.4, 5.0)
    motion = fly(vehicle, level, attitude=Level())
    assert_allclose(motion.v[:, 3], 2 * np.pi / 5, rtol=1e-8)
    assert_allclose(np.sin(motion.q[:, 4]), -0.6, rtol=1e-8)
    inside = Circle((0, 0, 5 - 1.8), 2.0, 5.0)
    with pytest.raises(UnreachableError) as refusal:
        fly(vehicle, inside, attitude=Level())
    assert_allclose(refusal.value.distances, 3.0 - np.hypot(2.0, 1.8), rtol=1e-6)
    # Out of the sphere at the first step, though it is on it at first.
    with pytest.raises((UnreachableError, SingularArmError)):
        fly(vehicle, Line((2.4, 0, 3.2), (2, 0, 3.2), 1.0), attitude=Level())


PLANAR = """
name = "planar"
[base]
motion = {}
mass = 1
inertia = [0.01, 0.01, 0.01, 0, 0, 0]
"""
PLANAR += "".join(
    f'[[link]]\nname = "{name}"\nxyz = [{x}, 0, 0]\naxis = "y"\nmass = 1\n'
    "inertia = [0.01, 0.01, 0.01, 0, 0, 0]\n"
    for name, x in (("upper", 0.1), ("fore", 0.3), ("hand", 0.3))
)
PLANAR += '[[frame]]\nname = "tip"\non = "hand"\nxyz = [0.1, 0, 0]\n'


@pytest.mark.slow
@pytest.mark.parametrize("motion", ['"fixed"', '["yaw"]', '"planar"'])
def test_parallel_joints_of_which_one_is_more_than_the_path_needs(motion: str) -> None:
    """Their Jacobian is never of full rank; the tip goes round in its plane, wherever that is."""
    vehicle = Vehicle(emitted_module(parse_robot(PLANAR.format(motion))))
    path = Circle((0.4, 0.0, 0.1), 0.1, 4.0, normal=(0, 1, 0))
    time = knots(0.5, 0.01)
    q = np.tile(vehicle.neutral, (len(time), 1))
    still = np.zeros((len(time), vehicle.layout.v.size))
    moved = arm_motion(vehicle, Motion(time, q, still, still), path, free(vehicle))
    first, second, third = np.cumsum(moved.q[:, vehicle.arm], axis=1).T
    x = 0.1 + 0.3 * np.cos(first) + 0.3 * np.cos(second) + 0.1 * np.cos(third)
    z = -0.3 * np.sin(first) - 0.3 * np.sin(second) - 0.1 * np.sin(third)
    assert_allclose(np.stack([x, 0 * x, z], axis=1), path(time)[:, 0], rtol=0, atol=REACHED)
    assert_consistent(moved)


@pytest.mark.slow
def test_a_joint_that_moves_nothing_leaves_the_tip_where_it_is(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """The tip lies on the axis: there is no posture that is farther from singular than others."""
    disc = RigidBody(0.0, 1.0, (0.1, 0.0, 0.0), (0.1, 0.1, 0.1, 0.0, 0.0, 0.0))
    robot = replace(paper_family(3, 0), name="turntable", links=(Link(disc),))
    folder = tmp_path_factory.mktemp("turntable")
    generate_robot(robot, robot_text(robot), folder, targets=("numpy",), verify=False)
    vehicle = Vehicle(load(folder / robot.name))
    motion = fly(vehicle, CENTRE, 0.05)
    assert not motion.v[:, vehicle.arm].any()
    with pytest.raises(UnreachableError) as refusal:
        fly(vehicle, Fixed((0.25, 0, 5)), 0.05)
    assert_allclose(refusal.value.distances, 0.25, rtol=1e-12)


@pytest.mark.slow
def test_a_posture_is_given_without_whole_turns(hexa: Vehicle, octo: Vehicle) -> None:
    for vehicle, size in ((hexa, 4.5), (octo, 0.45)):
        q = desired_base(vehicle, knots(0.01), CENTRE, Level()).q[0]
        for direction in np.random.default_rng(6).normal(size=(4, 3)):
            target = np.array([0, 0, 5]) + size * direction / np.linalg.norm(direction)
            found, left = first_posture(vehicle, q, target, free(vehicle), None)
            assert left <= REACHED
            assert np.linalg.norm(vehicle.tip_pose(found)[:3, 3] - target) <= REACHED
            assert np.all(np.abs(found[vehicle.arm]) <= np.pi)


def test_a_joint_that_does_not_move_the_tip(hexa: Vehicle) -> None:
    """With the tip in the centre no turn of joint 7 or 8 moves it: no posture is regular."""
    motion = fly(hexa, CENTRE, 0.05)
    assert_allclose(tip_of(hexa, motion), [(0, 0, 5)] * len(motion.q), atol=REACHED)
    assert_allclose(np.abs(np.sin(motion.q[:, 5] / 2)), 1.0)
