"""Trim, linear models and regulators of robots whose file describes actuators."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from support.actuated import NO_AIR, actuated
from support.compiled import emit

from gibbs_codegen import Feedback, UsageError, linearise, lqr, rollout, trim
from gibbs_codegen.flight.analysis.linear_model import held

# So that no servo is within its backlash.
POSTURE = {"upper": 0.5, "slider": 0.02, "wrist": 0.3}
DERIVATIVES = ["forward_dynamics_derivatives", "inputs_of_derivatives"]


@pytest.fixture(scope="module")
def module(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """Its rotors are in no air, which trims and linear models leave out."""
    folder, robot = tmp_path_factory.mktemp("driven") / "actuated", actuated()
    robot = replace(robot, thrusters=tuple(replace(x, **NO_AIR) for x in robot.thrusters))
    return emit(robot, folder, derivatives=[*DERIVATIVES, "actuator_rates_derivatives"]).module


@pytest.mark.slow
def test_commands_keep_the_inputs_of_a_trim(module: ModuleType) -> None:
    # Torques that are smaller than what backlash takes, too; and a battery that has sagged.
    for posture in (POSTURE, POSTURE | {"upper": 0.02}):
        found = trim(module, posture)
        acting = module.inputs_of(found.q, found.v, found.x, found.command)
        np.testing.assert_allclose(acting, found.u, rtol=1e-12, atol=1e-12)
        rates = module.actuator_rates(found.x, found.command)
        assert rates[-1] < 0.0
        np.testing.assert_allclose(rates[:-1], 0.0, atol=1e-9)
        throttle = module.COMMANDS.index("throttle_front_left")
        assert found.command[throttle] > 1.01 * found.x[0]
    assert found.beyond_limits == ()
    lines = [" ".join(line.split()) for line in str(found).splitlines()]
    used = 100.0 * found.command[throttle]
    assert f"throttle_front_left {used:.4g} % {100.0 - used:.4g} % from a limit" in lines
    # Of commands between 100 and 900 rad/s the lower limit is farther, at 623 rad/s.
    speed = found.command[1]
    assert f"speed_rear_left {speed:.4g} rad/s {900.0 - speed:.4g} rad/s from a limit" in lines
    np.testing.assert_allclose(found.command_margins[1], 900.0 - speed, rtol=1e-12)
    assert f"slider_position {found.command[5]:.4g} m" in lines


def test_commands_beyond_their_limits_are_told(module: ModuleType) -> None:
    found = trim(module, POSTURE, parameters={"battery_resistance": 0.35})
    [words] = found.beyond_limits
    assert words.startswith("throttle_front_left is 1.")
    assert words.endswith("above its limit of 1")
    with pytest.warns(RuntimeWarning, match=rf"u: {words}, where motors do not follow"):
        linearise(module, found)


def test_the_model_is_of_motion_and_actuators(module: ModuleType) -> None:
    """Against differences; levels at rest have the mean of two paces, as central ones have."""
    at = trim(module, POSTURE)
    q, v, command, x = at.q, at.v, at.command, at.x.copy()
    x[-1] = 0.9
    nv, nx = len(v), len(x)
    a, b = linearise(module, q, v, command, x=x)

    def rates(deviation: np.ndarray) -> np.ndarray:
        delta, dv, dx, w = np.split(deviation, [nv, 2 * nv, 2 * nv + nx])
        moved, now = (module.integrate(q, delta), v + dv), (x + dx, command + w)
        dynamics = module.forward_dynamics(*moved, module.inputs_of(*moved, *now))
        return np.concatenate([v + dv, dynamics, module.actuator_rates(*now)])

    for k, column in enumerate(np.hstack([a, b]).T):
        aside = np.zeros(2 * nv + nx + len(command))
        aside[k] = 1e-6
        expected = (rates(aside) - rates(-aside)) / 2e-6
        np.testing.assert_allclose(column, expected, rtol=1e-6, atol=2e-5)
    for found, expected in zip(
        linearise(module, q, v, command, 0.01, x=x), held(a, b, 0.01), strict=True
    ):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.slow
def test_a_regulator_of_commands_brings_the_robot_back(module: ModuleType) -> None:
    loose = {name: 0.0 for name in module.PARAMETERS if "friction_" in name}
    loose = {name: x for name, x in loose.items() if not name.endswith("velocity")}
    at = trim(module, POSTURE, parameters=loose)
    size, unit = 2 * len(at.v) + len(at.x), np.array([0.3, 150, 150, 2, 0.5, 0.2, 0.5])
    regulator = lqr(module, at, Q=np.ones(size), R=unit**-2, dt=0.01, parameters=loose)
    assert regulator.gain.shape == (len(unit), size)
    assert not regulator.gain[:, -1].any()
    assert len(regulator.eigenvalues) == size - 1
    assert np.abs(regulator.eigenvalues).max() < 1.0
    away = np.linspace(-0.1, 0.1, len(at.v))
    control = Feedback(regulator.gain, at.q, at.v, at.command, at.x)
    start, steps = (module.integrate(at.q, away), at.v), {"steps": 600, "dt": 0.01, "every": 300}
    found = rollout(module, *start, control, **steps, x0=at.x, parameters=loose)
    left = np.abs(module.difference(at.q, found.q[0])).max(axis=1)
    assert left[0] == pytest.approx(0.1)
    assert left[-1] < 0.03 * left[0]


def test_states_of_actuators_are_asked_for_by_name(module: ModuleType) -> None:
    at = trim(module, POSTURE)
    with pytest.raises(
        UsageError, match=r"x \(throttle_front_left, .*, charge\): must be 6 finite numbers"
    ):
        linearise(module, at.q, at.v, at.command, x=[1.0])
    with pytest.raises(UsageError, match="a trim already has them"):
        linearise(module, at, x=at.x)
