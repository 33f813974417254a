"""Inner loops against what they ask for, and programs of decisions against rollouts."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from gibbs_codegen import compile_program
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.rollouts.actions import Actions
from gibbs_codegen.flight.scenario.parts import Control
from gibbs_codegen.machine.rollout_steps import decision_program
from gibbs_codegen.runtime.rollouts import (
    MotorModel,
    Problem,
    Steps,
    compiled_rollout,
    functions_of,
    numpy_rollout,
)

Load = Callable[[str], ModuleType]
# Of errors of attitude, of the rest, and of velocities; 1/s², 1/s.
CONTROL = Control(frequency=4.0, attitude_frequency=15.0)
CASES = [
    ("quadrotor_arm_2link", "rates", "position"),
    ("quadrotor_arm_2link", "attitude", "velocity"),
    ("quadrotor_arm_2link", "velocity", "torque"),
    ("quadrotor_arm_2link", "tip", "position"),
    ("hexarotor_3link", "attitude", "position"),
    ("hexarotor_3link", "velocity", "velocity"),
    ("planar_quadrotor_arm", "rates", "torque"),
    ("rover_arm", "velocity", "velocity"),
    ("panda", "tip", "position"),
]


def actions_of(module: ModuleType, action: str, joints: str) -> tuple[Vehicle, Actions, Array]:
    """A robot, its actions, and a posture with all joints bent."""
    vehicle = Vehicle(module)
    posture = vehicle.neutral.copy()
    posture[vehicle.arm] = np.linspace(-0.6, 0.7, vehicle.joints)
    limits = np.tile([[-np.inf], [np.inf]], len(vehicle.inputs))
    kinds = action, None if action == "tip" else joints
    return vehicle, Actions.of(vehicle, kinds, limits, CONTROL, {}, posture), posture


def problem(module: ModuleType, kinds: tuple[str, str], **others: Any) -> tuple[Problem, Actions]:
    """States near a posture, each with an action of its own, and masses that the loop knows not."""
    vehicle, actions, posture = actions_of(module, *kinds)
    rng, count = np.random.default_rng(3), 3
    away = 0.2 * rng.normal(size=(count, vehicle.layout.v.size))
    q, v = module.integrate(posture, away), 0.3 * rng.normal(size=away.shape)
    asked = rng.uniform(-1.0, 1.0, (count, len(actions.names)))
    if kinds[1] == "position" and kinds[0] != "tip":
        asked[:, len(actions.names) - vehicle.joints :] += posture[vehicle.arm]
    at_once = np.zeros((2, 1, vehicle.rotors))
    free = MotorModel(*np.tile([[-np.inf], [np.inf]], len(vehicle.inputs)), *at_once)
    given = {"steps": 1, "dt": 2e-3, "motors": free, "inner": actions.loop} | others
    loads = {**actions.loads, "target": posture[np.newaxis, np.newaxis]}
    return Problem(module, None, q, v, asked[:, np.newaxis], loads=loads, **given), actions


@pytest.mark.parametrize(("name", "action", "joints"), CASES)
def test_inputs_accelerate_as_actions_ask(
    shipped: Load, name: str, action: str, joints: str
) -> None:
    """The accelerations of all that is asked for, by forward dynamics under the inputs."""
    module = shipped(name)
    given, actions = problem(module, (action, joints))
    vehicle, q, v, asked = Vehicle(module), given.q, given.v, given.inputs[:, 0]
    u = Steps(given, np).commanded()
    a = module.forward_dynamics(q, v, u)
    places, at, ways = vehicle.layout.v, vehicle.layout.q, len(vehicle.layout.driven_axes[0])
    assert actions.loop is not None
    leans, base = actions.loop.leans, len(asked[0]) - vehicle.joints * (action != "tip")
    of_joints = asked[:, base:]
    if action != "tip" and joints == "position":
        expected = 16.0 * (of_joints - q[:, at.joints]) - 8.0 * v[:, places.joints]
        np.testing.assert_allclose(a[:, places.joints], expected, atol=1e-9)
    elif action != "tip" and joints == "velocity":
        expected = 8.0 * (of_joints - v[:, places.joints])
        np.testing.assert_allclose(a[:, places.joints], expected, atol=1e-9)
    elif action != "tip":
        efforts = u[:, vehicle.rotors : vehicle.rotors + vehicle.joints]
        np.testing.assert_array_equal(efforts, of_joints)
    if action == "rates" and leans and joints != "torque":
        turning = 30.0 * (asked[:, 1:base] - v[:, places.attitude])
        np.testing.assert_allclose(a[:, places.attitude], turning, atol=1e-9)
    if leans and action in ("rates", "attitude"):  # Of the weight, whatever the base's attitude.
        thrusts = u[:, : vehicle.rotors].sum(axis=1)
        force = float(vehicle.mass) * (9.81 + asked[:, 0])
        np.testing.assert_allclose(thrusts, force, rtol=1e-3)
    if action == "tip" and not leans:
        tip = module.FRAMES.index("tip")
        moved = module.frame_velocities(q, v)[:, tip, :3]
        jacobian = module.frame_jacobians(q)[:, tip, :3]
        bias = module.frame_bias_accelerations(q, v)[:, tip, :3]
        found = (jacobian @ a[..., np.newaxis])[..., 0] + bias
        np.testing.assert_allclose(found, 8.0 * (asked - moved), atol=1e-6)
    if action == "velocity" and not leans:
        ahead = 8.0 * (asked[:, :ways] - v[:, places.position])
        np.testing.assert_allclose(a[:, places.position], ahead, atol=1e-9)


@pytest.mark.parametrize("action", ["velocity", "tip"])
def test_base_that_leans_goes_on_as_it_is_asked(shipped: Load, action: str) -> None:
    """Level, in its posture and at the velocity that is asked for, nothing accelerates."""
    given, _ = problem(shipped("quadrotor_arm_2link"), (action, "velocity"))
    asked, v = np.zeros(given.inputs.shape), np.zeros(given.v.shape)
    asked[..., :3] = v[:, np.newaxis, :3] = [0.5, -0.3, 0.2]
    q = np.tile(given.loads["target"][0], (len(v), 1))
    still = Problem(**{**vars(given), "q": q, "v": v, "inputs": asked})
    a = given.module.forward_dynamics(q, v, Steps(still, np).commanded())
    np.testing.assert_allclose(a, 0.0, atol=1e-9)


@pytest.mark.parametrize("case", [CASES[0], CASES[3]])
def test_decisions_are_steps_of_the_law(fast: Load, case: tuple[str, str, str]) -> None:
    """In C, in NumPy, and as one program, with a payload's mass that the loop does not know."""
    module = fast(case[0])
    given, _ = problem(module, case[1:], steps=4, every=4)
    heavy = {"base_mass": 1.1 * module.PARAMETERS["base_mass"]}
    given = Problem(**{**vars(given), "constants": module.prepare(heavy)})
    compiled, stepped = compiled_rollout(given), numpy_rollout(given)
    np.testing.assert_allclose(compiled.q, stepped.q, atol=1e-12)
    np.testing.assert_allclose(compiled.v, stepped.v, atol=1e-11)
    program = decision_program(functions_of(module), given.method, given.parts, given.steps)
    values = {**given.loads, "action": given.inputs[:, 0], "time": 0.0, "h": given.dt}
    values["target"] = given.loads["target"][0]
    values["x"] = np.concatenate([given.q, given.v, np.zeros((3, Vehicle(module).rotors))], axis=1)
    values["lag"] = np.zeros((3, Vehicle(module).rotors))
    found = compile_program(program, module)(values, {"robot": given.constants})["x_next"]
    found = found[:, : len(given.q[0]) + len(given.v[0])]
    after = np.concatenate([stepped.q[:, -1], stepped.v[:, -1]], axis=1)
    np.testing.assert_allclose(found, after, atol=1e-11)
