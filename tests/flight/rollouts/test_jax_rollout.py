"""Rollouts in JAX: those of NumPy, in both precisions, traced, transformed and differentiated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.compiled import Emitted, emit
from support.tools import missing

from gibbs_codegen import Feedback, UsageError, load, rollout
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot

try:
    import jax
    import jax.numpy as jnp
except ImportError:
    missing("jax is not installed")

pytestmark = pytest.mark.usefixtures("jax_in_double_precision")

Array = np.ndarray
STATES, STEPS, DT = 3, 4, 0.02
# A motor that lags, a battery that sags, and a servo.
DRIVEN = """
name = "driven"
base = { mass = 1.8, inertia = [0.02, 0.02, 0.02, 0, 0, 0] }
battery = { voltage = [20, 24], resistance = 0.05, capacity = 3 }
rotor = [{ command = "throttle", max_thrust = 30, full_speed = 600, time_constant = 0.02 }]
[[link]]
name = "upper"
xyz = [0, 0, -0.1]
axis = "-y"
mass = 0.2
com = [0, 0, -0.09]
inertia = [8e-4, 8e-4, 6e-5, 0, 0, 0]
servo = { stiffness = 30, damping = 0.4, rate = 6, delay = 0.02 }
"""
PARAMETERS = {"link1_mass_per_length": np.array([0.5, 0.7, 0.9]), "gravity": 3.7}


@pytest.fixture(scope="module")
def emitted_steps(tmp_path_factory: pytest.TempPathFactory) -> Emitted:
    """A small robot with a quaternion, and its time steps."""
    robot = paper_family(3, 1)
    robot = replace(robot, base=replace(robot.base, attitude="quaternion"))
    folder = tmp_path_factory.mktemp("rollouts") / robot.name
    return emit(robot, folder, derivatives=["step_euler", "step_rk4"])


@pytest.fixture
def jax_module(emitted_steps: Emitted) -> ModuleType:
    """The functions of JAX."""
    return load(emitted_steps.folder, backend="jax")


def arguments(module: ModuleType) -> dict[str, Any]:
    """A rollout with everything at once; the second state gets out of bounds."""
    rng = np.random.default_rng(2)
    nq, nv, nu = (len(names) for names in (module.COORDINATES, module.VELOCITIES, module.INPUTS))
    q, v = rng.uniform(-0.5, 0.5, (STATES, nq)), rng.uniform(-0.5, 0.5, (STATES, nv))
    v[1] = 8.0
    most = np.where(np.arange(nq + nv) < nq, np.inf, 8.2)
    control = Feedback(rng.normal(size=(nu, 2 * nv)), q[0], v[0], rng.uniform(0, 4, (STEPS, nu)))
    return {
        **{"q0": q, "v0": v, "control": control, "steps": STEPS, "dt": DT, "every": 2},
        "parameters": PARAMETERS,
        "wrenches": rng.normal(size=(STEPS, len(module.FRAMES), 6)),
        "limits": (0.5, 3.5),
        "time_constants": rng.uniform(0.01, 0.1, (STATES, 3)),
        "bounds": (-most, most),
    }


@pytest.mark.slow
def test_everything_is_as_in_numpy(module: ModuleType, jax_module: ModuleType) -> None:
    given = arguments(module)
    found, expected = (rollout(m, **given, method="euler") for m in (jax_module, module))
    for name in ("time", "q", "v", "thrusts", "steps", "ended"):
        ours, others = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(ours, others, rtol=1e-12, atol=1e-12, err_msg=name)
    assert expected.ended.tolist() == [0, 2, 0]
    assert isinstance(found.q, jax.Array)
    assert found.q.dtype == jnp.float64


@pytest.mark.slow
def test_without_lag_there_are_no_thrusts(module: ModuleType, jax_module: ModuleType) -> None:
    given = arguments(module) | {"time_constants": 0.0}
    assert rollout(jax_module, **given).thrusts is None
    del given["time_constants"], given["limits"]
    assert rollout(jax_module, **given).thrusts is None


@pytest.mark.slow
def test_a_controller_is_traced(module: ModuleType, jax_module: ModuleType) -> None:
    given = arguments(module)

    def law(time: Any, q: Any, v: Any) -> Any:
        rates = v[:, : len(module.INPUTS)]
        return 2.0 + time - 0.5 * rates + 0.1 * q[:, -len(module.INPUTS) :]

    found, expected = (rollout(m, **given | {"control": law}) for m in (jax_module, module))
    np.testing.assert_allclose(found.q, expected.q, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.thrusts, expected.thrusts, rtol=1e-12)


@pytest.mark.slow
def test_it_is_differentiated_and_transformed(tmp_path: Path) -> None:
    """By a parameter and by inputs; against differences."""
    robot = paper_family(2, 1)
    robot = replace(robot, base=replace(robot.base, attitude="quaternion"))
    needed = ["forward_dynamics_derivatives", "forward_dynamics_parameters_vjp"]
    emit(robot, tmp_path / robot.name, derivatives=[*needed, "integrate_derivatives"])
    jax_module = load(tmp_path / robot.name, backend="jax")
    q, v = np.zeros(len(jax_module.COORDINATES)), np.full(len(jax_module.VELOCITIES), 0.3)
    q[jax_module.COORDINATES.index("qw")] = 1.0

    @jax.jit
    def away(mass: Any, u: Any) -> Any:
        parameters = {"link1_mass_per_length": mass}
        lag = {"time_constants": 0.05, "thrusts": 1.0}
        found = rollout(jax_module, q, v, u, 3, DT, method="euler", parameters=parameters, **lag)
        return (found.q[:, -1] ** 2).sum() + (found.v[:, -1] ** 2).sum()

    rng = np.random.default_rng(3)
    at = [np.array([0.5, 0.9]), rng.uniform(0.0, 3.0, (2, 3, len(jax_module.INPUTS)))]
    for place, slope in enumerate(jax.grad(away, argnums=(0, 1))(*at)):
        direction, ends = rng.normal(size=slope.shape), []
        for sign in (1.0, -1.0):
            moved = [*at]
            moved[place] = at[place] + sign * 1e-5 * direction
            ends.append(float(away(*moved)))
        expected = (ends[0] - ends[1]) / 2e-5
        assert float((slope * direction).sum()) == pytest.approx(expected, rel=1e-6)


@pytest.mark.slow
def test_single_precision_is_jax_s_default(module: ModuleType, jax_module: ModuleType) -> None:
    given = arguments(module)
    jax.config.update("jax_enable_x64", False)
    try:
        found = rollout(jax_module, **given)
    finally:
        jax.config.update("jax_enable_x64", True)
    assert found.q.dtype == jnp.float32
    np.testing.assert_allclose(found.q, rollout(module, **given).q, rtol=1e-4, atol=1e-5)


def test_wrong_values_are_told_where_they_are_known(jax_module: ModuleType) -> None:
    given = arguments(jax_module)
    with pytest.raises(UsageError, match=r"v0: value \[1, 0\] of \d+ must be finite, not nan"):
        rollout(jax_module, **given | {"v0": jnp.asarray(given["v0"]).at[1, 0].set(jnp.nan)})
    with pytest.raises(UsageError, match="masses and inertias that are zero or negative"):
        rollout(jax_module, **given | {"parameters": {"link1_mass_per_length": -5.0}})
    with pytest.raises(UsageError, match="precision: JAX has its own setting"):
        rollout(jax_module, **given, precision="single")
    with pytest.raises(UsageError, match="3 in q0, 4 in v0"):
        jax.jit(lambda v: rollout(jax_module, **given | {"v0": v}).q)(
            np.zeros((4, len(jax_module.VELOCITIES)))
        )


@pytest.mark.slow
def test_commands_and_numbers_of_actuators_are_differentiated(tmp_path: Path) -> None:
    """Against differences of NumPy's rollouts, where no choice is near another."""
    needed = ["forward_dynamics_derivatives", "forward_dynamics_parameters_vjp"]
    needed += ["inputs_of_derivatives", "inputs_of_parameters", "integrate_derivatives"]
    needed += ["actuator_rates_derivatives", "actuator_rates_parameters"]
    robot = emit(parse_robot(DRIVEN), tmp_path / "driven", derivatives=needed).module
    q0, v0 = np.array([0.1, 0.2, 0.3, 0.5, 0, 0, 1]), np.array([0.2, 0.1, 0.3, 0.3, 0, 0, 0.2])
    command = np.array([0.7, 0.52])
    x0 = robot.actuator_state_of(0.98 * command)
    names = ["rotor1_time_constant", "upper_servo_stiffness", "battery_voltage_1"]

    def away(module: ModuleType, values: Any, commands: Any) -> Any:
        own = dict(zip(names, values, strict=True))
        settings = {"method": "euler", "x0": x0, "parameters": own}
        found = rollout(module, q0, v0, commands, 3, 5e-4, **settings)
        return (found.v[:, -1] ** 2).sum() + ((found.x[:, -1] - x0) ** 2).sum()

    jax_module = load(tmp_path / "driven", backend="jax")
    sizes = np.array([0.1, 0.05])
    values = np.array([robot.PARAMETERS[name] for name in names])
    begin = [values, command]
    slopes = jax.grad(lambda *x: away(jax_module, *x), argnums=(0, 1))(*begin)
    for place, (slope, unit) in enumerate(zip(slopes, (values, sizes), strict=True)):
        for k in range(len(unit)):
            ends = []
            for sign in (1.0, -1.0):
                moved = [x.copy() for x in begin]
                moved[place][k] += sign * 1e-5 * unit[k]
                ends.append(float(away(robot, *moved)))
            expected = (ends[0] - ends[1]) / 2e-5
            assert float(slope[k] * unit[k]) == pytest.approx(expected, rel=1e-5, abs=1e-7)
