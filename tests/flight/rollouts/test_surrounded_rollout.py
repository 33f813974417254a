"""Wind, gusts, payloads, pushes and spinning rotors act in rollouts as they do in flights."""

from __future__ import annotations

import numpy as np
import pytest
from support.blown import TEXT
from support.compiled import emit

from gibbs_codegen import Simulation, UsageError, load, read_scenario, rollout, uniform
from gibbs_codegen.flight.rollouts.vector_env import VectorEnv
from gibbs_codegen.robot.file import parse_robot

DT, STEPS = 0.002, 100
SCENE = {
    "integration": {"method": "rk4", "step": DT, "rate": 1 / DT},
    "duration": 1.0,
    "wind": {
        "velocity": [3.0, -1.0, 0.5],
        "drag": {"base": 0.4, "tip": 0.1},
        "rotational_drag": {"base": 0.03},
        "gusts": [{"amplitude": [0.0, 6.0, 0.0], "begin": 0.05, "duration": 0.1}],
    },
    "payload": [{"frame": "tip", "mass": 0.3, "begin": 0.1, "end": 0.15}],
    "push": {
        "frame": "tip",
        "force": [0.5, 1, -7],
        "torque": [0.1, 0, 0],
        "begin": 0.02,
        "end": 0.1,
    },
}
CHANGES = {"wind.velocity": [-2.0, 0.0, 1.0], "payload": [{**SCENE["payload"][0], "mass": 0.1}]}
U = np.array([3.0, 3.5, 3.2, 4.0, 0.2])
Q, V = np.array([0, 0, 1, 0, 0, 0, 1, 0.3]), np.array([0.5, 0, 0, 1, -2, 3, 0.5])
SETTINGS = {"dt": DT, "time_constants": 0.05, "surroundings": read_scenario("hover", SCENE)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> str:
    robot = parse_robot(TEXT)
    return str(emit(robot, tmp_path_factory.mktemp("blown") / robot.name).folder)


@pytest.fixture(scope="module")
def flown(folder: str) -> list[np.ndarray]:
    """States (steps + 1, nq + nv) of both winds and payloads, as a `Simulation` flies them."""
    found = []
    for changes in ({}, CHANGES):
        simulation = Simulation(load(folder), read_scenario("hover", {**SCENE, **changes}))
        simulation.reset(Q, V)
        rows = [[*simulation.q, *simulation.v]]
        for _ in range(STEPS):
            simulation.advance(U, DT)
            rows.append([*simulation.q, *simulation.v])
        found.append(np.array(rows))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["numpy", "c", "jax"])
def test_states_of_two_winds_and_payloads_fly_as_simulated(
    folder: str, flown: list[np.ndarray], backend: str, request: pytest.FixtureRequest
) -> None:
    varied = {"wind": [[3.0, -1.0, 0.5], [-2.0, 0.0, 1.0]], "payloads": [[0.3], [0.1]]}
    module = load(folder, backend=backend)
    if backend == "jax":
        request.getfixturevalue("jax_in_double_precision")
    done = rollout(module, Q, V, U, STEPS, **SETTINGS, **varied)
    for k, expected in enumerate(flown):
        states = np.concatenate([done.q[k], done.v[k]], axis=1)
        # Thrusts that lag are exact in rollouts, and integrated in flights; so is the quaternion.
        np.testing.assert_allclose(states, expected, rtol=0, atol=2e-7)
    if backend == "c":
        single = rollout(module, Q, V, U, STEPS, **SETTINGS, **varied, precision="single")
        np.testing.assert_allclose(single.q, done.q, rtol=0, atol=1e-4)
    assert np.abs(flown[0] - flown[1]).max() > 0.05


@pytest.mark.slow
def test_a_controller_sees_the_same_surroundings(folder: str) -> None:
    """Pieces between samples have their own part of the time."""
    module = load(folder)
    whole = rollout(module, Q, V, U, STEPS, every=10, **SETTINGS)
    pieces = rollout(module, Q, V, lambda *_: U, STEPS, every=10, **SETTINGS)
    np.testing.assert_allclose(pieces.q, whole.q, rtol=0, atol=1e-14)


@pytest.mark.slow
def test_episodes_of_two_winds_are_rollouts(folder: str) -> None:
    """Gusts blow by the time of the episode, also of one that began later."""
    module, winds = load(folder, "c"), {f"wind_{axis}": uniform(-3.0, 3.0) for axis in "xyz"}
    scene, hover = SETTINGS["surroundings"], [0, 0, 1, 0, 0, 0, 1, 0.3]
    moved = {"time_constants": 0.0, "dt": DT, "surroundings": scene}
    settings = {"hover": hover, "limits": (-9, 9), "steps": 10, "disturbances": winds}
    environments = VectorEnv(module, 2, normalised=False, **settings, **moved)
    environments.reset(seed=0)
    environments.step(np.tile(U, (2, 1)))
    environments.reset(options={"reset_mask": np.array([True, False])})
    drawn = environments.episodes["disturbances"]
    moved["wind"] = np.stack([drawn[name] for name in winds], axis=1)
    done = rollout(module, hover, np.zeros(7), U, STEPS, every=10, **moved)
    for k in range(1, 10):
        observed, *_ = environments.step(np.tile(U, (2, 1)))
        for state, sample in ((0, k), (1, k + 1)):
            q, v = done.q[state, sample], done.v[state, sample]
            wanted = [*module.difference(np.array(hover), q), *v]
            np.testing.assert_allclose(observed[state], wanted, rtol=1e-5, atol=1e-6)


def test_robots_of_three_masses_start_in_one_state_above_a_floor(folder: str) -> None:
    module, masses = load(folder), [1.0, 1.2, 1.4]
    floor = {"kind": "plane", "frame": "tip", "point": [0, 0, 0.7], "normal": [0, 0, 1]}
    scene = read_scenario("hover", {"wall": [{**floor, "stiffness": 2e3, "damping": 10.0}]})
    varied = [{"base_mass": mass} for mass in (masses, *masses)]
    together, *alone = (
        rollout(module, Q, V, U, 20, DT, surroundings=scene, parameters=each).q for each in varied
    )
    np.testing.assert_allclose(together, np.concatenate(alone), rtol=0, atol=1e-12)
    with pytest.raises(UsageError, match="walls: `surroundings` has this wall already; leave"):
        rollout(module, Q, V, U, 20, DT, walls=scene.walls, surroundings=scene)


WRONG = {
    "surroundings: scenario: must be": {"surroundings": 5},
    "surroundings: plant: numbers of the robot are not": {
        "surroundings": read_scenario("hover", {"plant": {"gravity": 1.6}}),
    },
    "wind: replaces that of `surroundings`; give these too": {
        "surroundings": None,
        "wind": [1, 0, 0],
    },
    "payloads: the surroundings have no [[payload]]": {
        "surroundings": "hover",
        "payloads": [1.0],
    },
    "wind: the surroundings have no [wind]": {
        "surroundings": "hover",
        "wind": [1.0, 0, 0],
    },
    "payloads: value [1, 0] of 2 must be 0 or more, in kg": {"payloads": [[1.0], [-1.0]]},
    "payloads: its shape must be (1,) or (states, 1), not (2,)": {"payloads": [1.0, 2.0]},
    "dt: ": {
        "surroundings": read_scenario("hover", {"wind": {"drag": {"base": 5000.0}}}),
        "method": "euler",
    },
}


@pytest.mark.parametrize("message", WRONG)
def test_what_is_wrong_is_told(folder: str, message: str) -> None:
    with pytest.raises(UsageError) as error:
        rollout(load(folder), Q, V, U, 4, **SETTINGS | WRONG[message])
    assert str(error.value).startswith(message)
