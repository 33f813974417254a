"""A and B are how the flow of a robot moves deviations, and their discrete form is exact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.actuated import actuated
from support.blown import TEXT
from support.differences import Array
from support.emitted import module_with_derivatives

from gibbs_codegen import Simulation, UsageError, linearise, lqr, read_scenario, trim
from gibbs_codegen.flight.analysis.linear_model import held
from gibbs_codegen.robot.file import parse_robot

Load = Callable[[str], ModuleType]

# Deviations, and how long they flow, s.
SMALL, SOON = 1e-4, 1e-5


def moving_state(module: ModuleType) -> tuple[Array, Array, Array]:
    """A state far from rest, and inputs."""
    rng = np.random.default_rng(1)
    q = np.array([float(name == "qw") for name in module.COORDINATES])
    q = module.integrate(q, 0.4 * rng.normal(size=len(module.VELOCITIES)))
    return q, rng.normal(size=len(module.VELOCITIES)), 3.0 * rng.normal(size=len(module.INPUTS))


def flowed(module: ModuleType, q: Array, v: Array, u: Array, time: float) -> tuple[Array, Array]:
    """The state a short time later or earlier, by one step of the fourth order."""

    def rates(q: Array, v: Array) -> tuple[Array, Array]:
        return module.coordinate_rates(q, v), module.forward_dynamics(q, v, u)

    first = rates(q, v)
    second = rates(q + 0.5 * time * first[0], v + 0.5 * time * first[1])
    third = rates(q + 0.5 * time * second[0], v + 0.5 * time * second[1])
    last = rates(q + time * third[0], v + time * third[1])
    dq, dv = (
        a + 2.0 * b + 2.0 * c + d for a, b, c, d in zip(first, second, third, last, strict=True)
    )
    return q + time / 6.0 * dq, v + time / 6.0 * dv


def flow_of_deviations(module: ModuleType, q: Array, v: Array, u: Array, time: float) -> Array:
    """The derivative by the deviation now of the deviation later; then that by inputs."""
    nv, nu = len(v), len(u)
    there = flowed(module, q, v, u, time)
    columns = []
    for way in SMALL * np.eye(2 * nv + nu):
        ends = []
        for sign in (1.0, -1.0):
            by_q, by_v, by_u = np.split(sign * way, [nv, 2 * nv])
            now = flowed(module, module.integrate(q, by_q), v + by_v, u + by_u, time)
            ends.append(np.concatenate([module.difference(there[0], now[0]), now[1] - there[1]]))
        columns.append((ends[0] - ends[1]) / (2.0 * SMALL))
    return np.transpose(columns)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hexarotor_3link"])
def test_deviations_grow_as_the_model_says(differentiated: Load, name: str) -> None:
    module = differentiated(name)
    q, v, u = moving_state(module)
    a, b = linearise(module, q, v, u)
    later, earlier = (flow_of_deviations(module, q, v, u, t) for t in (SOON, -SOON))
    found = (later - earlier) / (2.0 * SOON)
    nv = len(v)
    assert a == pytest.approx(found[:, : 2 * nv], rel=1e-5, abs=1e-5 * np.abs(a).max())
    assert b == pytest.approx(found[:, 2 * nv :], rel=1e-5, abs=1e-5 * np.abs(b).max())
    # The upper left block is what the flow makes of it, not nothing.
    assert bool(np.any(np.abs(a[:nv, :nv]) > 0.1)) == (module.ATTITUDE == "quaternion")
    assert np.array_equal(a[:nv, nv:], np.eye(nv))


def test_the_hold_is_exact(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    q, v, u = moving_state(module)
    a, b = linearise(module, q, v, u)
    dt, rng = 0.13, np.random.default_rng(2)
    by_period = linearise(module, q, v, u, dt)
    assert all(map(np.array_equal, by_period, held(a, b, dt)))
    x, w = rng.normal(size=len(a)), rng.normal(size=b.shape[1])
    flown = solve_ivp(
        lambda _, x: a @ x + b @ w, (0.0, dt), x, method="DOP853", rtol=1e-12, atol=1e-12
    )
    assert by_period[0] @ x + by_period[1] @ w == pytest.approx(flown.y[:, -1], rel=1e-9, abs=1e-9)


def test_parameters_are_those_of_the_model(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    moon = {"gravity": 1.62}
    found = trim(module, parameters=moon)
    a, _ = linearise(module, found, parameters=moon)
    # A tilt accelerates at g.
    assert np.abs(a[6:9, 3:6]).max() == pytest.approx(1.62, abs=1e-9)


def test_a_trim_stands_for_its_state(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    found = trim(module, velocity=[1.0, 2.0, 0.0])
    by_parts = linearise(module, found.q, found.v, found.u, 0.1)
    assert all(map(np.array_equal, linearise(module, found, dt=0.1), by_parts))


@pytest.mark.slow
def test_a_trim_is_given_alone_and_of_the_same_robot(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    found = trim(module)
    with pytest.raises(UsageError, match="v, u: a trim already has them"):
        linearise(module, found, found.v)
    with pytest.raises(UsageError, match="q, v, u: give all three, or a trim as q"):
        linearise(module, found.q, found.v)
    with pytest.raises(UsageError, match="the trim belongs to quadrotor, not to hexarotor_3link"):
        linearise(differentiated("hexarotor_3link"), found)


DERIVATIVES = [
    *("forward_dynamics_derivatives", "forward_dynamics_with_wrenches_derivatives"),
    *("frame_poses_derivatives", "frame_velocities_derivatives", "inputs_of_derivatives"),
    *("actuator_rates_derivatives", "rotor_speeds_derivatives"),
    "frame_bias_accelerations_derivatives",
]
STAND = '[[constraint]]\nname = "stand"\ntype = "point"\nframe = "tip"\nfrequency = 3\n'
HOLDING = ["constrained_forward_dynamics_derivatives", "impact_derivatives"]
SCENE = {
    "wind": {
        "velocity": [3.0, -1.0, 0.5],
        "drag": {"base": 0.4},
        "rotational_drag": {"base": 0.03},
    },
    "push": {
        "frame": "base",
        "force": [0.5, 1.0, -0.7],
        "torque": [0.1, 0, 0.05],
        "begin": 0,
        "end": 1,
    },
}


def touching(module: ModuleType, q: Array) -> dict[str, list[dict[str, Any]]]:
    """Payloads, and walls: one that the tip is in, and sticks to, and one that is far away."""
    place = module.frame_poses(q)[module.FRAMES.index("tip"), :3, 3]
    near = {"frame": ["base", "tip"], "normal": [0.3, -0.2, 1.0], "friction": 0.6}
    near |= {"point": place.tolist(), "ball_radius": 0.01, "stiffness": 500.0, "damping": 20.0}
    far = {"kind": "sphere", "frame": "base", "centre": [9, 9, 9], "radius": 1, "stiffness": 500}
    payloads = [{"frame": "tip", "mass": 0.3}, {"frame": "base", "mass": 0.1, "begin": 1.0}]
    return {"wall": [near, far], "payload": payloads}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["blown", "actuated", "held", "touching"])
def test_whatever_acts_is_as_in_flights(name: str) -> None:
    """Against differences of the rates of the flight that `Simulation` flies with held inputs."""
    text = TEXT.replace("quaternion", "zyx") + (STAND if name == "held" else "")
    robot = actuated() if name == "actuated" else parse_robot(text)
    plain = [each for each in DERIVATIVES if each.startswith(("forward", "frame"))]
    names = {"actuated": DERIVATIVES, "held": [*plain, *HOLDING]}
    module = module_with_derivatives(robot, *names.get(name, plain))
    nv, nu, rng = len(module.VELOCITIES), len(module.INPUTS), np.random.default_rng(1)
    q = np.array([float(each == "qw") for each in module.COORDINATES])
    q, v = module.integrate(q, 0.3 * rng.normal(size=nv)), rng.normal(size=nv)
    lag = {} if name == "actuated" else {"time_constants": [0.05, 0.04, 0.0, 0.03]}
    more = {"held": {"hold": [{"constraint": "stand"}]}, "touching": touching(module, q)}
    scene = read_scenario("hover", SCENE | more.get(name, {}))
    loop = Simulation(module, scene).loop
    if lag:
        actuators = replace(loop.actuators, lag=np.array(lag["time_constants"]))
        loop = replace(loop, actuators=actuators)
    u = np.full(nu, 0.4 if name == "actuated" else 3.0) + 0.1 * rng.normal(size=nu)
    if name == "actuated":
        u[1:3] = 500.0, 550.0
    places, count = loop.layout.places, loop.layout.actuators
    x = module.actuator_state_of(u) if name == "actuated" else u[:count]
    if name == "actuated":
        x[-1] = 0.9  # Off the end of the battery's table.
    a, b = linearise(module, q, v, u, x=None if lag else x, surroundings=scene, **lag)
    others = np.arange(places.actuators.start, places.actuators.start + count)
    others = others[loop.actuators.lag > 0.0] if lag else others
    if name == "touching":  # The base is in no wall, and its bristle does nothing.
        others = np.concatenate([others, np.arange(places.bristles.stop)[places.bristles][3:]])
    assert a.shape == (2 * nv + len(others),) * 2

    def rates(deviation: Array) -> Array:
        delta, dv, dx, w = np.split(deviation, [nv, 2 * nv, 2 * nv + len(others)])
        state = np.zeros(loop.size)
        state[places.q], state[places.v] = module.integrate(q, delta), v + dv
        state[places.actuators] = x
        state[others] += dx
        loads = loop.loads(0.0)._replace(inputs=tuple(u + w))
        rate = loop.derivative(0.0, state, loads)
        return np.concatenate([rate[places.v], rate[others]])

    for k, column in enumerate(np.hstack([a, b])[nv:].T):
        aside = np.zeros(len(a) + nu)
        aside[k] = 1e-6
        expected = (rates(aside) - rates(-aside)) / 2e-6
        np.testing.assert_allclose(column, expected, rtol=1e-6, atol=1e-5 * np.abs(a).max())
    if name == "blown":  # The speed of a rotor has no slope by a thrust of nothing.
        models = linearise(module, q, v, 0.0 * u, surroundings=scene, **lag)
        assert all(np.isfinite(matrix).all() for matrix in models)
    if name == "held":
        idle = read_scenario("hover", {"hold": [{"constraint": "stand", "idle": True}]})
        with pytest.raises(UsageError, match="surroundings: a hold stops the motors"):
            linearise(module, q, v, u, surroundings=idle, **lag)


@pytest.mark.slow
def test_a_regulator_stands_on_a_floor() -> None:
    """It holds a robot that a floor with friction carries, and by it the bristles decay."""
    module = module_with_derivatives(parse_robot(TEXT), *DERIVATIVES[:4])
    floor = {"kind": "floor", "frame": "base", "stiffness": 400.0, "damping": 40.0, "friction": 0.5}
    weight = 9.81 * sum(module.PARAMETERS[f"{body}_mass"] for body in ("base", "arm"))
    q = np.array([0, 0, -weight / 400.0, 0, 0, 0, 1, 0])
    still, u = np.zeros(7), np.zeros(5)
    floors = read_scenario("hover", {"wall": [floor]})
    regulator = lqr(module, q, still, u, np.ones(17), np.ones(5), surroundings=floors)
    assert regulator.gain.shape == (5, 17)
    assert regulator.eigenvalues.real.max() < -0.1
    high = [0, 0, 1, 0, 0, 0, 1, 0]
    free = linearise(module, high, still, u)
    assert all(map(np.array_equal, linearise(module, high, still, u, surroundings=floors), free))


def test_time_constants_are_not_negative(differentiated: Load) -> None:
    module = differentiated("quadrotor")
    with pytest.raises(UsageError, match="time_constants: must be a number or 4 numbers, 0 or mor"):
        linearise(module, trim(module).q, np.zeros(6), np.ones(4), time_constants=-1.0)


def test_a_module_without_derivatives_is_told_the_option(shipped: Load) -> None:
    module = shipped("quadrotor")
    q, v, u = moving_state(module)
    with pytest.raises(UsageError, match="quadrotor --derivatives=forward_dynamics_derivatives"):
        linearise(module, q, v, u)


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan, np.inf, "soon", [0.1, 0.2]])
def test_a_period_is_above_zero(differentiated: Load, dt: float) -> None:
    module = differentiated("quadrotor")
    with pytest.raises(UsageError, match="dt: must be a period above zero, s"):
        linearise(module, *moving_state(module), dt)


@pytest.mark.parametrize(
    ("place", "given", "words"),
    [
        (0, np.zeros(7), "q: its quaternion qx, qy, qz, qw must have the length 1, not 0"),
        (1, np.full(6, np.nan), r"v \(.*\): must be 6 finite numbers; some are NaN"),
        (
            1,
            np.zeros((3, 6)),
            r"v \(.*\): must be 6 finite numbers, not an array of shape \(3, 6\)",
        ),
        (2, "four", r"u \(F_front_left, .*\): must be 4 finite numbers, not 'four'"),
    ],
)
def test_a_state_that_is_none_is_refused(
    differentiated: Load, place: int, given: Array, words: str
) -> None:
    module = differentiated("quadrotor")
    state = [*moving_state(module)]
    state[place] = given
    with pytest.raises(UsageError, match=words):
        linearise(module, *state)
