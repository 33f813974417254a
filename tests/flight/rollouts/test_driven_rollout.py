"""Rollouts of robots whose file describes actuators: what is commanded, and what follows it."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.actuated import actuated, air, at_once
from support.compiled import Emitted, compile_only, emit

from gibbs_codegen import Rollout, UsageError, rollout, trim, uniform
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.rollouts import (
    MotorModel,
    Problem,
    compiled_rollout,
    numpy_rollout,
    rollout_function,
)

# In such steps dry friction throws the wrist about, in every back end alike.
STATES, STEPS, DT = 18, 6, 0.01
pytestmark = pytest.mark.filterwarnings("ignore:.* dt. in steps of 0.01 s:RuntimeWarning")
# Share of its torque that does not throw the wrist about.
LIGHT = 1e-3
ACTUATED, AT_ONCE = "with every actuator", "whose actuators have no states"


@pytest.fixture(scope="module", params=[ACTUATED, pytest.param(AT_ONCE, marks=pytest.mark.slow)])
def emitted(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Emitted:
    robot = actuated() if request.param == ACTUATED else at_once()
    return emit(robot, tmp_path_factory.mktemp("driven") / robot.name)


@pytest.fixture
def module(emitted: Emitted) -> ModuleType:
    """Its NumPy functions."""
    return emitted.module


def arguments(module: ModuleType, beyond: float = 0.0) -> dict[str, Any]:
    """States and commands, another for each state and step, some of them `beyond` limits."""
    rng = np.random.default_rng(3)
    q = np.zeros((STATES, len(module.COORDINATES)))
    q[:, module.COORDINATES.index("qw")] = 1.0
    size = len(module.VELOCITIES)
    q = module.integrate(q, rng.uniform(-0.3, 0.3, (STATES, size)))
    low, high = limits(module)
    shares = rng.uniform(-beyond, 1.0 + beyond, (STATES, STEPS, len(low)))
    v = rng.uniform(-0.5, 0.5, (STATES, size))
    commands = low + shares * (high - low)
    commands[..., -1] *= LIGHT
    return {"q0": q, "v0": v, "control": commands, "steps": STEPS, "dt": DT}


def limits(module: ModuleType) -> np.ndarray:
    """The least and the greatest commands, m where the file has none."""
    return np.array([module.COMMAND_LIMITS.get(x, (-0.1, 0.1)) for x in module.COMMANDS]).T


def assert_same(found: Rollout, expected: Rollout, room: float) -> None:
    """Whether all that comes out is the same, but for rounding."""
    for name in ("time", "q", "v", "x", "steps", "ended"):
        ours, theirs = getattr(found, name), getattr(expected, name)
        assert (ours is None) == (theirs is None), name
        if ours is not None:
            size = np.abs(theirs).max(axis=(0, 1) if theirs.ndim == 3 else None)
            assert np.all(np.abs(ours - theirs) <= room * np.maximum(size, 1.0)), name
    assert found.thrusts is None


@pytest.mark.slow
def test_states_of_actuators_are_integrated_with_the_motion(module: ModuleType) -> None:
    """Against the whole system, integrated to rounding where no choice is near another."""
    given = arguments(module) | {"steps": 200, "dt": 5e-5}
    names, places = module.ACTUATOR_STATES, len(module.COORDINATES)
    commands = given["control"][5, 0]
    own = {"q0": given["q0"][5], "v0": given["v0"][5], "control": commands}
    # So that dry friction keeps its direction, backlash its side, and torques are within limits.
    own["v0"][-3:] = 1.0, 0.2, 5.0
    commands[-3:-1] = np.add(own["q0"][-3:-1], [0.08, 0.02])
    commands[-1] = 0.01
    x0 = module.actuator_state_of(0.97 * commands) if names else np.zeros(0)
    found = rollout(module, **given | own, **({"x0": x0} if names else {}))
    split = [places, places + len(module.VELOCITIES)]

    def rates(_: float, state: np.ndarray) -> np.ndarray:
        q, v, x = np.split(state, split)
        u, speeds = module.inputs_of(q, v, x, commands), module.rotor_speeds(x, commands)
        wrenches = air(module, q, v, speeds[0], u[0])
        a = module.forward_dynamics_with_wrenches(q, v, u, wrenches)
        follow = module.actuator_rates(x, commands) if names else x
        return np.concatenate([module.coordinate_rates(q, v), a, follow])

    begin = np.concatenate([own["q0"], own["v0"], x0])
    whole = solve_ivp(rates, (0.0, 200 * 5e-5), begin, "DOP853", rtol=1e-11, atol=1e-12)
    q, v, x = np.split(whole.y[:, -1], split)
    np.testing.assert_allclose(found.q[0, -1], q, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(found.v[0, -1], v, rtol=1e-6, atol=1e-6)
    if names:
        np.testing.assert_allclose(found.x[0, -1], x, rtol=1e-8)
        assert np.abs(x / x0 - 1.0)[:-1].max() > 0.005
    else:
        assert found.x is None


def test_commands_are_within_the_limits_of_the_file(module: ModuleType) -> None:
    given = arguments(module, 0.5)
    low, high = (
        np.array(
            [
                np.nan_to_num(module.COMMAND_LIMITS.get(x, (-np.inf, np.inf))[k], nan=s * np.inf)
                for x in module.COMMANDS
            ]
        )
        for k, s in ((0, -1.0), (1, 1.0))
    )
    clipped = given | {"control": np.clip(given["control"], low, high)}
    unlimited = {"limits": (-np.inf, np.inf)}
    most = given["control"][..., 0].max()
    words = rf"held within their limits: throttle_front_left is {most:.4g}, above its limit of 1;"
    with pytest.warns(RuntimeWarning, match=words):
        held = rollout(module, **given)
    assert_same(held, rollout(module, **clipped, **unlimited), 0.0)
    free = rollout(module, **given, **unlimited)
    assert np.abs(free.v - held.v).max() > 1e-2


def test_a_controller_commands_at_every_sample(module: ModuleType) -> None:
    given = arguments(module)
    held = given["control"].copy()
    held[:, 1::2] = held[:, ::2]

    def law(time: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return held[:, round(time / DT)]

    expected = rollout(module, **given | {"control": held}, every=2)
    assert_same(rollout(module, **given | {"control": law}, every=2), expected, 1e-13)


def test_what_the_file_says_is_not_said_again(module: ModuleType) -> None:
    given = arguments(module)
    for name in ("time_constants", "thrusts"):
        with pytest.raises(
            UsageError, match=rf"{name}: the robot file of {module.NAME} has motors"
        ):
            rollout(module, **given | {name: 0.05})
    with pytest.raises(UsageError, match="time_constants: the robot file of"):
        rollout(module, None, None, "hover", STEPS, DT, time_constants=0.05)
    words = (
        r"\(6,\) or \(states, 6\)"
        if module.ACTUATOR_STATES
        else "x0: the actuators of at_once have no states"
    )
    with pytest.raises(UsageError, match=words):
        rollout(module, **given, x0=[1.0, 2.0])


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_the_generated_source_compiles_without_a_warning(
    emitted: Emitted, compiler: str, tmp_path: Path
) -> None:
    options = ["-Wno-psabi", "-Wno-unused-macros"]
    compile_only(compiler, options, [str(emitted.file("_rollout.c"))], tmp_path)


@pytest.mark.slow
def test_the_generated_source_does_the_same(emitted: Emitted, module: ModuleType) -> None:
    given = arguments(module)
    motors = MotorModel(*limits(module), *np.zeros((2, 1, 4)))
    x = module.actuator_state_of(given["control"][:, 0]) if module.ACTUATOR_STATES else None
    state = given["q0"], given["v0"], given["control"]
    problem = Problem(module, None, *state, STEPS, DT, motors=motors, x=x)
    found = compiled_rollout(problem, function=rollout_function(module, "double"))
    assert_same(found, numpy_rollout(problem), 1e-11)


def test_actions_of_environments_are_commands(module: ModuleType) -> None:
    environments = pytest.importorskip("gibbs_codegen.flight.rollouts.vector_env")
    low, high = limits(module)
    name = "rear_left_thrust_2"
    varied = {name: uniform(0.9 * module.PARAMETERS[name], 1.1 * module.PARAMETERS[name])}
    seen = []

    def reward(now: Any) -> np.ndarray:
        seen.append(now)
        return np.zeros(3)

    settings = {"dt": DT, "steps": 2, "parameters": varied, "reward": reward, "terminated": reward}
    with pytest.raises(UsageError, match="limits: slider_position: no limits"):
        environments.VectorEnv(module, 3, **settings)
    envs = environments.VectorEnv(module, 3, limits=(low, high), **settings)
    envs.reset(seed=1)
    actions = np.random.default_rng(2).uniform(-0.3, 0.3, (2, 3, len(low)))
    for each in actions:
        envs.step(each)
    commands = low + 0.5 * (actions + 1.0) * (high - low)
    hover = trim(module)
    start = {} if hover.x is None or not len(hover.x) else {"x0": hover.x}
    steps = np.repeat(np.moveaxis(commands, 0, 1), 2, axis=1)
    found = rollout(module, hover.q, hover.v, steps, 4, DT, parameters=envs.parameters, **start)
    np.testing.assert_allclose(seen[-1].q, found.q[:, -1], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(seen[-1].inputs, commands[-1], rtol=1e-12)
    x = np.zeros((3, 0)) if found.x is None else found.x[:, -1]
    constants = module.prepare(envs.parameters)
    acting = module.inputs_of(found.q[:, -1], found.v[:, -1], x, commands[-1], constants=constants)
    np.testing.assert_allclose(seen[-1].thrusts, acting[:, :4], rtol=1e-11)
    assert np.ptp(acting[:, 1]) > 0.01


@pytest.mark.slow
def test_inner_loops_command_motors_and_servos(emitted: Emitted) -> None:
    """A servo is sent where its joint is to be, and motors hover by throttle, speed and thrust."""
    module = load(emitted.folder, backend="c")
    environments = pytest.importorskip("gibbs_codegen.flight.rollouts.vector_env")
    settings = {"dt": 4e-4, "steps": 25, "normalised": False, "limits": limits(module)}
    envs = environments.VectorEnv(module, 2, action="velocity", **settings)
    assert envs.actions == ("x", "y", "z", "spin", "upper", "slider", "wrist")
    envs.reset()
    asked = np.zeros((2, len(envs.actions)))
    asked[:, envs.actions.index("upper")] = 0.1
    for _ in range(60):
        envs.step(asked)
    now = envs.now
    np.testing.assert_allclose(now.q[:, module.COORDINATES.index("upper")], 0.1, atol=0.01)
    np.testing.assert_allclose(now.v[:, :6], 0.0, atol=0.1)
