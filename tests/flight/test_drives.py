"""Motions of robots on wheels, by closed forms of carts and by an equation of a path's errors."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, logm
from scipy.optimize import least_squares
from support.emitted import compiled_module, emitted_module, module_with_derivatives
from support.machines import RADIUS, WIDTH, cart, frame, link, spring, wheel
from support.random_robots import rolling_robot

from gibbs_codegen import (
    Feedback,
    UsageError,
    displacement,
    generate,
    linearise,
    load,
    lqr,
    parse_robot,
    read_log,
    read_scenario,
    rollout,
    simulate,
    trim,
    write_log,
)
from gibbs_codegen.arrays import Functions, Program, evaluate, gradient, jacobian, join
from gibbs_codegen.flight.control.predictive import Predictive, Tolerances
from gibbs_codegen.flight.figures.flight import estimates
from gibbs_codegen.flight.plant.estimator import Estimator
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.sweeps.sources import robot_data
from gibbs_codegen.machine.filters import FilteredSensor, StateFilter
from gibbs_codegen.machine.sensors import SensorAt
from gibbs_codegen.machine.steps import step_program
from gibbs_codegen.robot.layout import frames_of

EXACT = {"integration.relative_tolerance": 1e-12, "integration.absolute_tolerance": 1e-13}
# As a cart of Fierro and Lewis (1995): its mass, its centre's place ahead, and what turns.
MASS, AHEAD = 30.0, 0.3
CART = cart("cart", com=[AHEAD, 0, 0.2], moments=[10, 10, 15.625], inertia=0.1, effort=60)
TANGENT = {"kind": "tangent"}
DIRECTIONS = ("vx", "vy", "wz")


class Hover(NamedTuple):
    """Coordinates and inputs at rest."""

    q: np.ndarray
    u: np.ndarray


@cache
def cart() -> ModuleType:
    """The module of the cart."""
    return compiled_module(parse_robot(CART))


def driven(module: ModuleType, duration: float, base: dict[str, Any], **tables: Any) -> Any:
    """A motion along a path, which does not end early."""
    scenario = {"name": "way", "duration": duration, "base": base, **tables}
    flight = simulate(module, read_scenario(scenario, EXACT))
    assert not flight.stopped
    return flight


def circle(radius: float, period: float) -> dict[str, Any]:
    """The table of a path round the origin's left, which begins there, ahead."""
    path = {"kind": "circle", "centre": [0, radius, 0], "radius": radius, "period": period}
    return {"attitude": TANGENT, "path": path | {"phase_deg": -90}}


def wheel_torques(speed: float, rate: float) -> list[float]:
    """Those of the cart on a circle: they push with τ / r, each on its side."""
    force, moment = -MASS * AHEAD * rate**2, MASS * AHEAD * speed * rate
    return [0.5 * RADIUS * (force + side * moment / WIDTH) for side in (-1.0, 1.0)]


def straight(speed: float) -> dict[str, Any]:
    """The table of a path along x at one speed."""
    points = [[0, 0, 0], [10.0 * speed, 0, 0]]
    velocities = [[speed, 0, 0]] * 2
    return {
        "path": {"kind": "waypoints", "times": [0, 10], "points": points, "velocities": velocities}
    }


def test_torques_of_wheels_on_a_circle(tmp_path: Path) -> None:
    """The centre of mass is pulled inwards, and back; wheels turn as their rims roll."""
    speed, rate = 2.0 * np.pi * 1.5 / 8.0, 2.0 * np.pi / 8.0
    flight = driven(cart(), 0.4, circle(1.5, 8.0))
    torques = np.tile(wheel_torques(speed, rate), (len(flight.time), 1))
    np.testing.assert_allclose(flight.applied, torques, 1e-7)
    rolled = np.outer(flight.time, speed + rate * WIDTH * np.array([-1.0, 1.0])) / RADIUS
    np.testing.assert_allclose(flight.q[:, 3:], rolled, atol=1e-8)
    np.testing.assert_allclose(flight.q_desired[:, 3:], rolled, atol=1e-8)
    assert flight.centre_error.max() < 1e-9
    assert np.abs(flight.energy_error).max() < 1e-9
    write_log(flight, tmp_path / "log", "csv")
    again = read_log(cart(), tmp_path / "log")
    np.testing.assert_allclose(again.q, flight.q, atol=1e-8)
    places = [again.points.index(name) for name in again.wheel_points]
    np.testing.assert_allclose(again.positions[0, places, 1], [WIDTH, -WIDTH], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("speed", "own"), [(0.8, {}), (-0.8, {"return_rate": 2, "return_speed": 0.4}), (0.05, {})]
)
def test_a_base_beside_its_path_comes_back_as_by_one_equation(
    speed: float, own: dict[str, float]
) -> None:
    """With the heading ψ − ε off, whose error is that of a critically damped oscillator."""
    frequency, off = 4.0, 0.3
    flight = driven(
        cart(),
        5.0,
        straight(speed),
        start={"offset": [0, off, 0]},
        control={"frequency": frequency, **own},
    )
    slow = own.get("return_speed", 0.1)
    steep = own.get("return_rate", 1) * speed / (speed**2 + slow**2)
    begin = np.arctan(-steep * off)

    def error(time: Any) -> Any:
        return begin * (1.0 + frequency * time) * np.exp(-frequency * time)

    def rate(time: float, left: np.ndarray) -> np.ndarray:
        return speed * np.sin(error(time) - np.arctan(steep * left))

    way = solve_ivp(rate, (0.0, 5.0), [-off], "DOP853", flight.time, rtol=1e-11, atol=1e-12).y[0]
    # What is to the left of the base is seen in its own axes, and nothing is ahead.
    place = np.stack([-np.sin(flight.q[:, 2]), np.cos(flight.q[:, 2])], axis=1)
    desired = np.stack([speed * flight.time, 0.0 * flight.time], axis=1)
    left = np.einsum("si,si->s", place, desired - flight.q[:, :2])
    np.testing.assert_allclose(left, way, atol=1e-8)
    assert np.abs(flight.errors[:, 0]).max() < 1e-8
    np.testing.assert_allclose(flight.errors[:, 1], error(flight.time), atol=1e-8)


@pytest.mark.slow
def test_torques_keep_their_limits_and_the_path_is_found_again() -> None:
    begin = {"offset": [-0.4, 0.6, 0], "turn_deg": [0, 0, 70]}
    flight = driven(cart(), 12.0, circle(1.5, 8.0), start=begin)
    assert np.abs(flight.commanded).max() == pytest.approx(60.0)
    assert np.abs(flight.applied).max() <= 60.0
    assert flight.centre_error[0] == pytest.approx(np.hypot(0.4, 0.6))
    assert flight.centre_error[-1] < 1e-3


def test_ways_that_slip_are_refused() -> None:
    level = circle(1.5, 8.0) | {"attitude": {"kind": "level"}}
    with pytest.raises(UsageError, match=r"base.attitude: at t = .* slip sideways at 1\.178 m/s"):
        driven(cart(), 2.0, level)
    turned = {"attitude": {"kind": "turn", "axis": [0, 0, 1], "angle_deg": 90, "duration": 1}}
    flight = driven(cart(), 1.0, turned)
    np.testing.assert_allclose(flight.q[-1, :3], [0, 0, np.pi / 2], atol=1e-9)


def test_a_way_from_rest_to_rest_bends() -> None:
    points = [[0, 0, 0], [1, 0.3, 0], [1.5, 1.2, 0]]
    bend = {"kind": "waypoints", "times": [0, 2, 4], "points": points}
    flight = driven(cart(), 4.0, {"attitude": TANGENT, "path": bend})
    assert flight.centre_error.max() < 1e-6
    np.testing.assert_allclose(flight.q[[0, -1], :2], [[0, 0], [1.5, 1.2]], atol=1e-6)
    np.testing.assert_allclose(flight.v[[0, -1], 0], 0.0, atol=1e-6)
    assert np.ptp(flight.q[:, 2]) > 0.5
    line = {"kind": "line", "start": [0, 0, 0], "end": [0.6, 0.8, 0], "duration": 1, "begin": 0.5}
    flight = driven(cart(), 2.0, {"attitude": TANGENT, "path": line})
    np.testing.assert_allclose(flight.q[:, 2], np.arctan2(0.8, 0.6), atol=1e-8)


ARM = (
    link("shoulder", "z", [0.2, 0, 0.4], 1, [0, 0, 0.1], [0.01, 0.01, 0.01])
    + link("upper", "y", [0, 0, 0.2], 1, [0.25, 0, 0], [0.01, 0.02, 0.02], length=0.5)
    + link("fore", "y", [0.5, 0, 0], 1, [0.2, 0, 0], [0.01, 0.02, 0.02])
    + frame("tip", "fore", [0.4, 0, 0])
)


def test_a_tip_moves_in_the_axes_of_a_rover_that_turns() -> None:
    module = compiled_module(parse_robot(CART + ARM))
    moves = {"kind": "circle", "centre": [0.7, 0.1, 0.5], "radius": 0.1, "period": 2}
    arm = {"arm": {"tip_in_base": moves, "guess_deg": {"upper": -30, "fore": 60}}}
    flight = driven(module, 2.0, circle(1.5, 8.0), **arm)
    ahead = np.stack([np.cos(flight.q[:, 2]), np.sin(flight.q[:, 2])], axis=1)
    away = flight.point("tip")[:, :2] - flight.q[:, :2]
    left = ahead @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    angle = np.pi * flight.time
    np.testing.assert_allclose(np.sum(ahead * away, axis=1), 0.7 + 0.1 * np.cos(angle), atol=1e-6)
    np.testing.assert_allclose(np.sum(left * away, axis=1), 0.1 + 0.1 * np.sin(angle), atol=1e-6)
    assert flight.tip_error.max() < 1e-6


OMNIDIRECTIONAL = CART.replace('drive = "differential"\n', "").replace('"cart"', '"omni"') + wheel(
    "across", [WIDTH, 0, RADIUS], joint="across", axis="x"
)


def test_an_omnidirectional_base_turns_as_it_goes() -> None:
    # What a damper of one wheel takes is of all velocities at once.
    text = OMNIDIRECTIONAL.replace("effort = 60", "effort = 60\ndamping = 0.3", 1)
    module = emitted_module(parse_robot(text))
    turning = {"attitude": {"kind": "level", "rate_deg": 30}}
    flight = driven(module, 0.5, circle(1.5, 8.0) | turning, start={"offset": [0.1, -0.1, 0]})
    off = np.sqrt(0.02) * (1.0 + 5.0 * flight.time) * np.exp(-5.0 * flight.time)
    np.testing.assert_allclose(flight.centre_error, off, atol=1e-9)
    assert np.abs(flight.energy_error).max() < 1e-8
    with pytest.raises(UsageError, match="return_rate and return_speed need a base with a drive"):
        driven(module, 0.5, circle(1.5, 8.0) | turning, control={"return_rate": 2})


def test_trims_of_rest_and_of_rolling() -> None:
    damped = emitted_module(parse_robot(CART.replace("= 0.1\n", "= 0.1\ndamping = 0.2\n")))
    np.testing.assert_allclose(trim(damped).u, 0.0, atol=1e-15)
    rolling = trim(damped, velocity=[0.6, 0, 0])
    # Dampers take 0.2 N m s/rad of the wheels' rates.
    np.testing.assert_allclose(rolling.u, 0.2 * 0.6 / RADIUS, rtol=1e-12)
    np.testing.assert_allclose(rolling.v, [0.6, 0.0], atol=1e-15)
    with pytest.raises(UsageError, match="its base does not move along these"):
        trim(damped, velocity=[0, 0.6, 0])
    # Round a circle the centre of mass is pulled inwards, and back.
    turning, speed = 0.8, 0.6
    round_about = trim(cart(), velocity=[speed, 0, 0], turning=turning)
    np.testing.assert_allclose(round_about.v, [speed, turning], atol=1e-14)
    np.testing.assert_allclose(round_about.a, 0.0, atol=1e-14)
    np.testing.assert_allclose(round_about.u, wheel_torques(speed, turning), rtol=1e-12)


def test_robot_files_tell_what_wheels_do(tmp_path: Path) -> None:
    """As modules do, before there is one; a wheel without effort does nothing."""
    text = OMNIDIRECTIONAL.replace("effort = 60", "effort = 0", 1)
    (tmp_path / "omni.toml").write_text(text)
    told = robot_data(tmp_path / "omni.toml").input_wrenches()
    does = Vehicle(emitted_module(parse_robot(text))).input_wrenches()
    np.testing.assert_allclose(told, does, atol=1e-14)
    assert np.linalg.matrix_rank(told) == 2


@pytest.mark.slow
def test_a_rover_holds_a_place_while_it_drives(tmp_path: Path) -> None:
    module = load(generate("rover_arm", tmp_path, verify=False), backend="c")
    flight = simulate(module, "drive")
    assert not flight.stopped
    assert flight.centre_error.max() < 1e-9
    assert flight.tip_error.max() < 1e-9
    assert np.ptp(flight.point("tip"), axis=0).max() < 1e-9
    assert np.ptp(flight.q, axis=0)[4] > 0.5
    assert np.all(np.abs(flight.applied) < flight.input_limits[1])


def test_fmus_tell_what_has_no_derivatives(tmp_path: Path) -> None:
    (tmp_path / "cart.toml").write_text(f'{CART}[[frame]]\nname = "rim"\non = "left"\n')
    with pytest.raises(UsageError, match="--target fmu: frame rim of cart turns with a wheel"):
        generate(tmp_path / "cart.toml", tmp_path, ["numpy", "fmu"], verify=False)
    (tmp_path / "cart.toml").write_text(CART + RIM + SPRING)
    with pytest.raises(UsageError, match="--laws state_filter: a spring or a rotor of cart turns"):
        generate(tmp_path / "cart.toml", tmp_path, ["c"], laws="state_filter", verify=False)


def logarithm(q0: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The screw (x, y, yaw) from a place in the plane to another, in the axes of the first."""
    poses = [
        np.array([[np.cos(yaw), -np.sin(yaw), x], [np.sin(yaw), np.cos(yaw), y], [0, 0, 1]])
        for x, y, yaw in (q0[:3], q[:3])
    ]
    screw = logm(np.linalg.solve(*poses))
    return np.array([screw[0, 2], screw[1, 2], screw[1, 0]])


def test_displacements_have_what_is_sideways() -> None:
    """As the logarithm of the motion between two places; wheels have none of their own."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        q0, q = rng.uniform(-1.5, 1.5, (2, 5))
        np.testing.assert_allclose(displacement(cart(), q0, q), logarithm(q0, q), atol=1e-12)
    np.testing.assert_allclose(
        displacement(cart(), q0, [*q0[:3], *(q0[3:] + 1.0)]), 0.0, atol=1e-15
    )
    with pytest.raises(UsageError, match=r"control.gain: its shape must be \(2, 5\)"):
        rollout(cart(), q0, [0, 0], Feedback(np.zeros((2, 4)), q0, [0, 0]), 1, 0.01)


def moved(q: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Coordinates after a screw (x, y, yaw) in the axes of the base, and joints and wheels."""
    x, y, turn = way[:3]
    screw = expm(np.array([[0, -turn, x], [turn, 0, y], [0, 0, 0]]))
    c, s = np.cos(q[2]), np.sin(q[2])
    place = q[:2] + np.array([[c, -s], [s, c]]) @ screw[:2, 2]
    return np.r_[place, q[2] + turn, q[3:] + np.r_[way[3:], np.zeros(len(q) - len(way))]]


@pytest.mark.slow
def test_steps_and_places_have_derivatives_sideways() -> None:
    """By differences of what the module gives, displaced by the exponential of the plane."""
    robot = rolling_robot(60)
    module = module_with_derivatives(robot)
    own = Functions(module)
    step = step_program(own, "rk4")
    (q, v, _, _), sides = step.inputs, own.space.displacements
    poses = own.frame_poses(q)
    wheels = [i for i, link in enumerate(robot.links, start=1) if link.rolling]
    frames = [k for k, frame in enumerate(frames_of(robot)) if frame.on not in wheels]
    outputs = {**step.outputs, "poses": join(*(poses[k] for k in frames))}
    outputs["centre"] = own.centre_of_mass(q)
    program = Program("all", step.inputs, outputs)
    rng, small = np.random.default_rng(4), 1e-6
    at = {x.operation.name: rng.normal(size=x.shape) for x in (q, v, program.inputs[2])}
    at["h"] = 0.1

    def away(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.r_[logarithm(a, b), (b - a)[3:sides]]

    def differences(name: str) -> dict[str, np.ndarray]:
        columns: dict[str, list[np.ndarray]] = {}
        for way in small * np.eye(sides if name == "q" else at[name].size):
            put = moved if name == "q" else np.add
            ends = [
                evaluate(program, at | {name: put(at[name], side * way)}, {"robot": module})
                for side in (-1.0, 1.0)
            ]
            for x, (before, after) in ((x, [end[x] for end in ends]) for x in outputs):
                change = away(before, after) if x == "q_next" else after - before
                columns.setdefault(x, []).append(change / (2.0 * small))
        return {x: np.stack(y, axis=-1) for x, y in columns.items()}

    found = evaluate(jacobian(program, ("q", "v", "u")), at, {"robot": module})
    for name in "qvu":
        for x, expected in differences(name).items():
            ours = found[f"{x}_by_{name}"]
            np.testing.assert_allclose(ours, expected, atol=1e-8 * max(1.0, np.abs(ours).max()))
    gradients = gradient(step, "q")
    weights = {"q_next_bar": rng.normal(size=sides), "v_next_bar": rng.normal(size=v.size)}
    (bar,) = evaluate(gradients, at | weights, {"robot": module}).values()
    expected = sum(weights[f"{x}_bar"] @ found[f"{x}_by_q"] for x in ("q_next", "v_next"))
    np.testing.assert_allclose(bar, expected, atol=1e-12)


RIM = frame("rim", "left", [0.1, 0, 0])
SPRING = frame("post", "base", [0.3, 0.2, 0.4]) + spring("rod", "rim", "post", stiffness=3)


def test_what_takes_derivatives_refuses_what_turns_with_wheels() -> None:
    """No derivative is by angles of wheels, of which places of what is on them are functions."""
    rim, sprung = (compiled_module(parse_robot(CART + x)) for x in (RIM, RIM + SPRING))
    rest: Any = Hover(np.zeros(5), np.zeros(2))
    around = {"name": "air", "duration": 1, "payload": [{"mass": 1.0, "frame": "rim"}]}
    sensed = {"name": "seen", "duration": 1, "sensors": {"pose": [{"frame": "rim"}]}}
    wheel = r"rim of cart turns with a wheel, .*; give a frame on another body"
    with pytest.raises(UsageError, match=rf"payload 1: frame: {wheel}"):
        linearise(rim, rest.q, np.zeros(2), rest.u, surroundings=around)
    with pytest.raises(UsageError, match=rf"payload 1: frame: {wheel}"):
        Predictive(rim, rest, surroundings=around)
    with pytest.raises(UsageError, match=rf"sensors.pose: pose: {wheel}"):
        Estimator(rim, read_scenario(sensed).sensors)
    for take in (
        lambda: linearise(sprung, rest.q, np.zeros(2), rest.u),
        lambda: Predictive(sprung, rest),
        lambda: Estimator(sprung, read_scenario(sensed).sensors),
    ):
        with pytest.raises(UsageError, match="cart: a spring or a rotor turns with a wheel"):
            take()


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """The cart in C, with derivatives."""
    folder = tmp_path_factory.mktemp("cart")
    (folder / "cart.toml").write_text(CART)
    return load(generate(folder / "cart.toml", folder, derivatives="all", verify=False), "c")


def test_tolerances_of_efforts_are_of_joints_and_wheels(compiled: ModuleType) -> None:
    rest: Any = Hover(np.zeros(5), np.zeros(2))
    with pytest.raises(UsageError, match="one for each of the 0 joints and 2 wheels of cart"):
        Predictive(compiled, rest, tolerances=Tolerances(effort=[1.0, 2.0, 3.0]))


@pytest.mark.slow
def test_a_plan_is_the_best_of_an_optimiser_of_its_own(compiled: ModuleType) -> None:
    """Of the cart in closed form, by SciPy, with displacements by the logarithm of the plane."""
    tolerances = Tolerances(position=0.05, attitude=0.1, effort=20.0, velocity=0.8)
    (nodes, h), rest = (5, 0.04), Hover(np.zeros(5), np.zeros(2))
    settings: Any = {"iterations": 40, "farthest": 9.0, "method": "trapezoidal"}
    law = Predictive(compiled, rest, nodes=nodes, step=h, tolerances=tolerances, **settings)
    q, v = np.array([-0.1, 0.06, 0.3, 0.0, 0.0]), np.array([0.4, -0.2])
    told = law._compiled.arrays
    told["tolerance"][()] = 1e-11
    law.inputs(0.0, q, v)
    first = law.inputs(0.0, q, v)  # The first plan of all takes fewer rounds.
    along = MASS + 2.0 * 0.1 / RADIUS**2
    # Of a disc half its inertia is across its axis.
    about = 15.625 + MASS * AHEAD**2 + 2.0 * (0.05 + 0.1 * WIDTH**2 / RADIUS**2)
    posture = np.array([20.0, 20.0, 10.0])
    rates, end = 1.0 / np.array([0.8, 1.0]), np.linalg.cholesky(told["ahead"].reshape(5, 5)).T

    def missed(u: np.ndarray) -> np.ndarray:
        place, speed, every = q, v, []
        for torques in u.reshape(nodes, 2):
            off = logarithm(np.zeros(3), place)
            every += [posture * off, rates * speed, torques / 20.0]
            force, moment = np.sum(torques), WIDTH * (torques[1] - torques[0])
            a = np.array(
                [
                    (force / RADIUS + MASS * AHEAD * speed[1] ** 2) / along,
                    (moment / RADIUS - MASS * AHEAD * speed[0] * speed[1]) / about,
                ]
            )
            after = speed + h * a
            ahead, turn = 0.5 * h * (speed + after)
            place, speed = moved(place, np.array([ahead, 0.0, turn])), after
        off = logarithm(np.zeros(3), place)
        return np.concatenate([*every, posture * off, rates * speed, end @ np.r_[off, speed]])

    best = least_squares(missed, np.zeros(2 * nodes), xtol=1e-14, ftol=1e-14, gtol=1e-12)
    assert np.abs(best.x).max() < 59.0
    np.testing.assert_allclose(told["cost"], best.cost, rtol=1e-6)
    np.testing.assert_allclose(first, best.x[:2], atol=1e-4)


@pytest.mark.slow
def test_the_predictive_law_drives_to_a_pose_and_along_a_path(compiled: ModuleType) -> None:
    """Half a metre to its side at rest, by going there and back; and onto a circle."""
    tolerances = Tolerances(position=0.02, attitude=0.1, effort=5.0)
    hover = Hover(np.zeros(5), np.zeros(2))
    law = Predictive(compiled, hover, nodes=40, step=0.05, tolerances=tolerances, farthest=9.0)
    q, v = np.array([0.0, 0.5, 0.0, 0.0, 0.0]), np.zeros(2)
    for k in range(100):
        u = law.inputs(0.05 * k, q, v)
        for _ in range(5):
            v = v + 0.01 * compiled.forward_dynamics(q, v, u)
            q = compiled.integrate(q, 0.01 * v)
    np.testing.assert_allclose(q[:3], 0.0, atol=0.02)
    np.testing.assert_allclose(v, 0.0, atol=1e-2)
    begin, control = {"offset": [-0.1, 0.1, 0]}, {"law": "predictive"}
    flight = driven(compiled, 12.0, circle(1.5, 8.0), start=begin, control=control)
    assert flight.centre_error[-1] < 0.02 * flight.centre_error[0]


@pytest.mark.slow
def test_a_filter_tells_places_by_directions_sideways_too(compiled: ModuleType) -> None:
    """Against a filter whose slopes are differences by the logarithm of the plane."""
    made = StateFilter(Functions(compiled), {"gps": FilteredSensor(SensorAt("gps", 0, ()))})
    programs, rng, h, small = made.programs(), np.random.default_rng(2), 0.02, 1e-6
    noise, variances = np.array([0, 0, 0, 0.3, 0.2]), np.full(6, 0.01)
    x, spread = np.array([0.3, -0.2, 0.8, 0.5, -0.7]), np.diag([1.0, 2.0, 0.3, 0.4, 0.5])
    known = {"q": np.r_[x[:3], 0.0, 0.0], "v": x[3:], "covariance": spread}

    def put(x: np.ndarray, way: np.ndarray) -> np.ndarray:
        return np.r_[moved(x[:3], way[:3]), x[3:] + way[3:]]

    def away(x: np.ndarray, other: np.ndarray) -> np.ndarray:
        return np.r_[logarithm(x[:3], other[:3]), other[3:] - x[3:]]

    def ahead(x: np.ndarray) -> np.ndarray:
        a = compiled.forward_dynamics(np.r_[x[:3], 0.0, 0.0], x[3:], u)
        way = h * (x[3:] + 0.5 * h * a)
        return put(x, np.r_[way[0], 0.0, way[1], h * a])

    def seen(x: np.ndarray) -> np.ndarray:
        return np.r_[x[:2], 0.0, x[3] * np.cos(x[2]), x[3] * np.sin(x[2]), 0.0]

    for _ in range(5):
        u, reading = rng.normal(size=2), rng.normal(size=6)
        ends = [[put(x, side * way) for side in (-1.0, 1.0)] for way in small * np.eye(5)]
        slope = np.array([away(ahead(a), ahead(b)) for a, b in ends]).T / (2.0 * small)
        x, spread = ahead(x), slope @ spread @ slope.T + h * np.diag(noise)
        ends = [[put(x, side * way) for side in (-1.0, 1.0)] for way in small * np.eye(5)]
        slope = np.array([seen(b) - seen(a) for a, b in ends]).T / (2.0 * small)
        gain = spread @ slope.T @ np.linalg.inv(slope @ spread @ slope.T + np.diag(variances))
        x, spread = put(x, gain @ (reading - seen(x))), spread - gain @ slope @ spread
        given = {"u": u, "h": h, "noise": noise, "gravity": np.zeros(3), "gate": np.inf}
        given |= {"reading": reading, "variances": variances}
        for program in (programs["filter_predict"], programs["filter_update_gps"]):
            inputs = {key: value for key, value in (known | given).items() if key in program.names}
            found = evaluate(program, inputs, {"robot": compiled})
            known |= {key.removesuffix("_next"): y for key, y in found.items() if key != "nis"}
        np.testing.assert_allclose(np.r_[known["q"][:3], known["v"]], x, atol=1e-8)
        np.testing.assert_allclose(known["covariance"], spread, atol=1e-8)
    sensed = {"sensors": {"imu": [{"frame": "base"}], "pose": [{"frame": "base"}]}}
    estimated = {"control": {"estimate": True}, "start": {"offset": [0.1, 0.1, 0]}}
    flight = driven(compiled, 4.0, circle(1.5, 8.0), **sensed, **estimated)
    assert flight.centre_error[-1] < 0.2 * flight.centre_error[0]
    names = [name for name, *_ in flight.columns() if name.startswith("displacement_")]
    assert [x.removeprefix("displacement_") for x in names[:3]] == [
        f"{x}_error" for x in DIRECTIONS
    ]
    off = flight.estimate_errors[-1, :3]
    told = logarithm(flight.estimates[-1], flight.q[-1])
    np.testing.assert_allclose(off, told, atol=1e-12)
    assert sum(bool(axes.get_ylabel()) for axes in estimates(flight).axes) == 5


@pytest.mark.slow
def test_a_regulator_brings_a_rover_back_beside_its_line(tmp_path: Path) -> None:
    """By feedback in rollouts, in C too, as in a loop with deviations by the logarithm."""
    (tmp_path / "cart.toml").write_text(CART)
    derivatives = ["forward_dynamics_derivatives"]
    folder = generate(tmp_path / "cart.toml", tmp_path, derivatives=derivatives, verify=False)
    robot, steps, dt, v0 = load(folder), 800, 0.01, np.array([1.0, 0.0])
    gain = lqr(robot, np.zeros(5), v0, np.zeros(2), [1, 9, 1, 1, 1], [1e-3, 1e-3], dt).gain
    line = np.outer(dt * np.arange(steps), [1.0, 0, 0, 0, 0])
    begin = np.array([0, 0.2, 0, 0, 0])
    q, v = begin, v0
    for desired in line:
        u = -gain @ np.concatenate([logarithm(desired, q), v - v0])
        v = v + dt * robot.forward_dynamics(q, v, u)
        q = robot.integrate(q, dt * v)
    np.testing.assert_allclose(q[:3], [steps * dt, 0, 0], atol=1e-3)
    for backend in ("numpy", "c"):
        law = Feedback(gain, line, v0)
        found = rollout(load(folder, backend), begin, v0, law, steps, dt, method="euler")
        np.testing.assert_allclose(found.q[0, -1], q, atol=1e-9)
        np.testing.assert_allclose(found.v[0, -1], v, atol=1e-9)
