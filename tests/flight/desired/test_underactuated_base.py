"""Motions of bases that push along one axis: against mechanics written out by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.attitude import turning_of
from gibbs_codegen.flight.desired import underactuated_base
from gibbs_codegen.flight.desired.demands import needed_inputs
from gibbs_codegen.flight.desired.led_frames import led_frames
from gibbs_codegen.flight.desired.posture import authority_posture
from gibbs_codegen.flight.desired.trajectory import desired_motion
from gibbs_codegen.flight.desired.underactuated_base import (
    Tilt,
    UnderactuatedBase,
    differences,
)
from gibbs_codegen.flight.plant.allocation import thrust_axis
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.orientation import Level, Turn
from gibbs_codegen.flight.scenario.paths import Circle, Line, Path
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.vectors import Array

# Of the robot file.
HANGS, GRAVITY = 0.01, 9.81


@pytest.fixture(scope="module")
def quadrotor(fast: Callable[[str], ModuleType]) -> Vehicle:
    return Vehicle(fast("quadrotor"))


def pose(vehicle: Vehicle, reference: Reference, time: Array) -> tuple[Array, Array]:
    """Base centre (s, 3) and rotation of the base (s, 3, 3)."""
    q, _, _ = reference(time)
    return q[:, vehicle.layout.q.position], vehicle.base_rotation(q)


def sideways(vehicle: Vehicle, reference: Reference, time: Array) -> Array:
    """Acceleration across the thrust axis, as differences of the centre of mass have it (s)."""
    step = 2e-4
    centres = []
    for shift in (-step, 0.0, step):
        place, rotation = pose(vehicle, reference, time + shift)
        centres.append(place - HANGS * rotation[:, :, 2])
    needed = (centres[0] - 2.0 * centres[1] + centres[2]) / step**2 + [0.0, 0.0, GRAVITY]
    _, rotation = pose(vehicle, reference, time)
    return np.linalg.norm(np.cross(rotation[:, :, 2], needed), axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("heading", [1.9])
def test_a_line_is_flown_by_leaning_from_rest_to_rest(quadrotor: Vehicle, heading: float) -> None:
    line = Line((0.0, 0.0, 2.0), (3.0, -2.0, 2.5), 2.0, begin=0.5)
    reference = desired_motion(quadrotor, Scenario("line", 3.0, line, Level(heading)))
    time = np.linspace(0.01, 2.99, 400)
    assert sideways(quadrotor, reference, time).max() < 0.02
    place, rotation = pose(quadrotor, reference, time)
    assert np.linalg.norm(place - line(time)[:, 0], axis=-1).max() < 3e-4
    # It leans a little ahead of its path and after it, and less the farther that is away.
    for instant in (0.0, 3.0):
        q, v, _ = reference(instant)
        assert_allclose(quadrotor.base_rotation(q)[:, 2], [0, 0, 1], atol=2e-3)
        assert_allclose(v, 0.0, atol=0.1)
    # Turned back by the heading, the base is turned about a level axis only.
    tilt = rotation @ Rotation.from_rotvec([0.0, 0.0, -heading]).as_matrix()
    assert np.abs(Rotation.from_matrix(tilt).as_rotvec()[:, 2]).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("begin", "before"), [(0.4, 0.8)])
def test_an_arm_swings_ahead_of_a_path_gently(
    begin: float, before: float, fast: Callable[[str], ModuleType]
) -> None:
    """Thrusts by the inverse dynamics, also between knots: near hover before the path sets out."""
    vehicle = Vehicle(fast("quadrotor_arm_2link"))
    path = {"begin": begin, "duration": 2.4}
    scenario = read_scenario("line", {"base": {"path": path}, "duration": begin + 2.8})
    reference = desired_motion(vehicle, scenario)
    time = np.linspace(0.0, reference.end, 10 * len(reference.knots))
    q, v, a = reference(time)
    thrusts = needed_inputs(vehicle, q, v, a)[:, : vehicle.rotors]
    hover = needed_inputs(vehicle, q[:1], 0.0 * v[:1], 0.0 * a[:1])[:, : vehicle.rotors]
    # The last fifth of a second before it sets out is the swing that the start needs.
    early = time <= max(begin - 0.2, 0.0)
    assert np.abs(thrusts - hover)[early].max() < before
    assert thrusts.min() > 4.0
    assert thrusts.max() < 9.0
    assert np.abs(np.gradient(thrusts, time, axis=0)).max() < 40.0
    off = q[:, vehicle.layout.q.position] + vehicle.centre_offset(q) - scenario.base(time)[:, 0]
    assert np.linalg.norm(off, axis=-1).max() < 2e-3


@pytest.mark.slow
def test_a_path_that_sets_out_at_once_is_flown_from_the_swing_it_needs(quadrotor: Vehicle) -> None:
    """Waypoints and a hover, both from t = 0 on: thrusts stay near those of the acceleration."""
    path = {"kind": "waypoints", "times": [0, 3], "points": [[0, 0, 0], [1, 0, 1]]}
    for changes in ({"duration": 3.0, "base": {"path": path}}, {"duration": 0.05}):
        scenario = read_scenario("line" if "base" in changes else "hover", changes)
        reference = desired_motion(quadrotor, scenario)
        time = np.linspace(0.0, reference.end, 2000)
        thrusts = needed_inputs(quadrotor, *reference(time))[:, :4]
        assert np.abs(thrusts - 3.679).max() < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hover"])
def test_rotors_in_a_row_are_bent_to_where_they_command(
    name: str, shipped: Callable[[str], ModuleType]
) -> None:
    """Hydrus as it hangs has all rotors in a row; bent, it flies what ships within its limits."""
    vehicle = Vehicle(shipped("hydrus"))
    limits = (np.full(3, -np.pi / 2), np.full(3, np.pi / 2))
    rest = np.zeros(3)
    assert thrust_axis(vehicle, vehicle.neutral) is None
    bent = authority_posture(vehicle, limits, rest)
    assert_allclose(bent, np.radians(60.0))
    assert authority_posture(vehicle, limits, bent) is bent
    scenario = replace(read_scenario(name), duration=2.0)
    reference = desired_motion(vehicle, scenario)
    q, v, a = reference(np.linspace(0.0, 2.0, 300))
    assert_allclose(q[:, vehicle.arm], np.tile(bent, (300, 1)), atol=1e-12)
    thrusts = needed_inputs(vehicle, q, v, a)[:, :4]
    assert thrusts.min() > 5.0
    assert thrusts.max() < 15.0


def test_a_joint_move_that_is_too_fast_is_told_as_one(fast: Callable[[str], ModuleType]) -> None:
    vehicle = Vehicle(fast("quadrotor_arm_2link"))
    name = vehicle.joint_names[0]
    moves = {name: [{"to": 40, "begin": 1, "duration": 0.02}]}
    arm = {"moves_deg": moves, "velocity": {name: 5.0}}
    with pytest.raises(UsageError, match=f"{name} has to move at .*, faster than its limit of 5"):
        desired_motion(vehicle, read_scenario("hover", {"arm": arm}))


def test_pieces_whose_thrusts_leave_those_of_the_knots_are_found(quadrotor: Vehicle) -> None:
    """A jolt straight up needs no lateral force, and shows between knots only."""
    reference = desired_motion(quadrotor, read_scenario("hover", {"duration": 0.5}))
    time = reference.knots
    motion = Motion(time, *reference(time))
    free = led_frames(quadrotor, {}, (np.zeros(0), np.zeros(0)))
    assert underactuated_base._deviation(quadrotor, motion, 14.7, free) is None
    motion.v[40, quadrotor.layout.v.position.stop - 1] = 1e-3
    found = underactuated_base._deviation(quadrotor, motion, 14.7, free)
    assert found is not None
    assert abs(found.piece - 39.5) < 1.0


@pytest.mark.slow
def test_on_a_circle_it_leans_as_its_centre_of_mass_does(quadrotor: Vehicle) -> None:
    """Tan θ = ω² R / g, where the centre of mass hangs outside of the base centre's circle."""
    scenario = replace(read_scenario("circle"), duration=4.0)
    reference = desired_motion(quadrotor, scenario)
    time = np.linspace(0.0, 4.0, 57)
    place, rotation = pose(quadrotor, reference, time)
    lean = 0.0
    for _ in range(50):
        lean = np.arctan((2 * np.pi / 8) ** 2 * (2.0 + HANGS * np.sin(lean)) / GRAVITY)
    inwards = ([0.0, 0.0, 2.0] - place) / 2.0
    assert_allclose(rotation[:, :, 2], np.sin(lean) * inwards + [0, 0, np.cos(lean)], atol=5e-6)
    # A base without arms has its x axis along the path.
    assert_allclose(rotation[:, :, 0], np.cross([0, 0, 1], inwards) * -1.0, atol=5e-6)
    assert_allclose(place, scenario.base(time)[:, 0], atol=1e-7)


@pytest.mark.slow
def test_spans_are_joined_without_a_seam(
    quadrotor: Vehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(underactuated_base, "_SPAN", 100)
    monkeypatch.setattr(underactuated_base, "_OVERLAP", 100)
    circle = Scenario("circle", 2.0, Circle((0.0, 0.0, 2.0), 1.0, 3.0), Level())
    reference = desired_motion(quadrotor, circle)
    time = np.linspace(0.01, 1.99, 300)
    assert sideways(quadrotor, reference, time).max() < 1e-5
    lean = np.linalg.norm(reference(time)[2][:, quadrotor.layout.v.attitude], axis=-1)
    assert np.ptp(lean) < 0.05


@pytest.mark.slow
def test_a_flip_turns_once_with_positive_thrust(quadrotor: Vehicle) -> None:
    scenario = read_scenario("flip")
    reference = desired_motion(quadrotor, scenario)
    time = np.linspace(0.01, scenario.duration - 0.01, 400)
    place, rotation = pose(quadrotor, reference, time)
    assert np.linalg.norm(place - scenario.base(time)[:, 0], axis=-1).max() < 1e-4
    assert sideways(quadrotor, reference, time).max() < 0.01
    turned = np.unwrap(np.arctan2(rotation[:, 0, 2], rotation[:, 2, 2]))
    assert np.degrees(turned[-1] - turned[0]) == pytest.approx(360.0, abs=1.0)
    q, v, a = reference(time)
    wrenches = quadrotor.base_wrench(q, quadrotor.inverse_dynamics(q, v, a))
    thrusts = wrenches @ np.linalg.pinv(quadrotor.thrust_wrenches()).T
    assert thrusts.min() > 0.0
    assert thrusts.max() < 8.5


@pytest.mark.parametrize(
    ("path", "attitude", "message"),
    [
        (Line((0, 0, 50), (0, 0, 40), 1.21), Level(), "t = .* falls faster than free fall"),
        (Line((0, 0, 50), (0, 0, 40), 2.43), Level(), "t = .* close to free fall"),
        (Circle((0, 0, 2), 0.0, 1.0), Turn((1, 0, 0), np.pi, 1.0), r"t = .*that.*kind = .turn"),
    ],
)
def test_what_no_thrust_does_is_refused(
    quadrotor: Vehicle, path: Path, attitude: Level | Turn, message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        desired_motion(quadrotor, Scenario("wild", 1.5, path, attitude))


def test_the_shortest_rotation_and_its_rates() -> None:
    time = np.linspace(0.0, 1.0, 11)

    def vectors(time: Array) -> tuple[tuple[Array, Array, Array], ...]:
        angles = ((0.3 + 2.0 * time, 0.5 * time**2), (1.1 - time, 1.0 + np.sin(time)))
        rates = ((2.0 + 0.0 * time, time), (0.0 * time - 1.0, np.cos(time)))
        seconds = ((0.0 * time, 1.0 + 0.0 * time), (0.0 * time, -np.sin(time)))
        return tuple(_direction(*each) for each in zip(angles, rates, seconds, strict=True))

    begin, end = vectors(time)
    rotation = Tilt(np.stack(begin), np.stack(end)).rotation
    assert_allclose(np.einsum("sij,sj->si", rotation[0], begin[0]), end[0], atol=1e-14)
    about = Rotation.from_matrix(rotation[0]).as_rotvec()
    assert_allclose(np.sum(about * begin[0], axis=-1), 0.0, atol=1e-13)
    step = 1e-4
    ahead, behind = (
        Tilt(*(np.stack(each) for each in vectors(time + by))).rotation[0] for by in (step, -step)
    )
    assert_allclose((ahead - behind) / (2 * step), rotation[1], atol=1e-6)
    assert_allclose((ahead - 2 * rotation[0] + behind) / step**2, rotation[2], atol=1e-5)
    assert_allclose(turning_of(*rotation).rotation, rotation[0])


def test_what_has_to_vanish_is_lateral_force_and_its_slopes_are_those_of_differences(
    fast: Callable[[str], ModuleType],
) -> None:
    """The force by the inverse dynamics of the motion, at axes that are not of unit length."""
    vehicle = Vehicle(fast("quadrotor_arm_2link"))
    time = np.linspace(0.0, 1.0, 201)
    wave = np.sin(np.outer(2.0 * time, np.arange(1.0, 9.0)) + np.arange(8.0))
    path, level = Circle((0.0, 0.0, 2.0), 1.0, 3.0), Level(rate=0.7)
    tip = Circle((0.3, 0.0, 1.5), 1.1, 3.0)
    led = led_frames(vehicle, {"tip": tip}, (np.full(2, -1.0), np.full(2, 2.0)))
    axis = np.tile([0.0, 0.0, 1.0], (len(time), 1))
    still = Motion(time, np.tile(vehicle.neutral, (len(time), 1)), *np.zeros((2, len(time), 8)))
    turning = level(path, time, vehicle.arm_angles())
    base = UnderactuatedBase(vehicle, still, axis, path(time), turning, led, led.targets(time))
    unknowns = np.repeat([[0.0, 0.0, 1.1, 0.0, 0.0, 0.0, 0.4, 0.2]], len(time), axis=0)
    unknowns += np.repeat([0.3, 0.1, 0.5], [3, 3, 2]) * wave
    given = unknowns, base.grid.rate @ unknowns, base.grid.growth @ unknowns
    missing, slopes = base.linear(*given)
    motion = base.motion(*given)
    force = vehicle.inverse_dynamics(motion.q, motion.v, motion.a)
    lateral = vehicle.base_wrench(motion.q, force)[:, :2] / (base.mass * base.gravity)
    assert_allclose(np.linalg.norm(missing[:, :2], axis=-1), np.linalg.norm(lateral, axis=-1))
    assert_allclose(missing[:, 3:], led.misses(vehicle, motion.q, base.targets), atol=1e-13)
    # Rates of what joints change are differences of knots.
    inside = slice(4, -4)
    for order, step in enumerate((1e-6, 1e-4, 1e-2)):
        for column in range(8):
            ahead, behind = [*given], [*given]
            ahead[order] = given[order] + step * np.eye(8)[column]
            behind[order] = given[order] - step * np.eye(8)[column]
            slope = (base.linear(*ahead)[0] - base.linear(*behind)[0]) / (2.0 * step)
            found = slopes[order, :, :, column]
            assert_allclose(found[inside], slope[inside], atol=2e-6 * 100.0 ** (column > 5))


def _direction(
    angles: tuple[Array, Array], rates: tuple[Array, Array], seconds: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Cos a cos b, sin a cos b, sin b and derivatives, by the complex exponentials of both sums."""
    out = []
    for sign, share in ((1.0, 0.5), (-1.0, 0.5)):
        angle, rate, second = (each[0] + sign * each[1] for each in (angles, rates, seconds))
        wave = share * np.exp(1j * angle)
        out.append((wave, 1j * rate * wave, (1j * second - rate**2) * wave))
    plane = [sum(waves) for waves in zip(*out, strict=True)]
    wave = np.exp(1j * angles[1])
    upright = (wave, 1j * rates[1] * wave, (1j * seconds[1] - rates[1] ** 2) * wave)
    first, second, third = (
        np.stack([p.real, p.imag, u.imag], axis=-1) for p, u in zip(plane, upright, strict=True)
    )
    return first, second, third


@pytest.mark.parametrize("order", [1, 2, 3])
def test_differences_are_exact_for_polynomials(order: int) -> None:
    time = 0.3 + 0.1 * np.arange(12)
    polynomial = np.polynomial.Polynomial([0.2, -1.0, 0.7, 2.0, -0.4])
    found = differences(order, 12, 0.1) @ polynomial(time)
    assert_allclose(found, polynomial.deriv(order)(time), atol=1e-9)
