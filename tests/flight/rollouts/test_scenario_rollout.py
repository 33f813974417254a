"""Rollouts of a scenario's closed loop: against flights of `simulate`, one by one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

from gibbs_codegen import Scenario, UsageError, load, read_scenario, rollout, simulate
from gibbs_codegen.flight.scenario.parts import Push, Sensors
from gibbs_codegen.flight.scenario.walls import Plane

LENGTH = "link2_mass_per_length"
STEPS, DT, EVERY = 120, 0.0025, 20


@pytest.fixture(scope="module")
def machine(fast: Callable[[str], ModuleType]) -> ModuleType:
    """The paper's machine."""
    return fast("hexarotor_3link")


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """A hover with a push that begins between two steps."""
    push = Push((1.0, -0.5, 0.5), 0.0512, 0.2, frame="base")
    return replace(read_scenario("hover"), push=push, duration=STEPS * DT)


def scenario_flights(machine: ModuleType, scenario: Scenario, **changed: Any) -> Any:
    """The flight of a scenario in the same steps."""
    settings = replace(scenario.integration, method="rk4", step=DT, rate=1.0 / (DT * EVERY))
    return simulate(machine, replace(scenario, integration=settings, **changed))


@pytest.mark.slow
def test_states_are_those_of_flights(machine: ModuleType, scenario: Scenario) -> None:
    masses = machine.PARAMETERS[LENGTH] * np.array([0.8, 1.0, 1.3])
    lag = np.array([0.01, 0.02, 0.03])
    found = rollout(
        *(machine, None, None, scenario, STEPS, DT),
        every=EVERY,
        parameters={LENGTH: masses},
        time_constants=np.tile(lag[:, None], (1, 6)),
    )
    assert found.ended.tolist() == [0, 0, 0]
    assert found.steps.tolist() == [STEPS] * 3
    for i in range(3):
        motors = replace(scenario.motors, time_constant=lag[i])
        flight = scenario_flights(machine, scenario, plant={LENGTH: masses[i]}, motors=motors)
        np.testing.assert_allclose(found.time, flight.time, atol=1e-12)
        # Compensation of the lag differences thrusts over 1e-7 s, which magnifies rounding.
        np.testing.assert_allclose(found.q[i], flight.q, atol=1e-8)
        np.testing.assert_allclose(found.v[i], flight.v, atol=1e-7)
        np.testing.assert_allclose(found.thrusts[i], flight.applied[:, :6], atol=1e-5)


@pytest.mark.slow
def test_it_begins_where_it_is_told(machine: ModuleType, scenario: Scenario) -> None:
    """Where control is lost a state ends, and changes no other."""
    usual = rollout(machine, None, None, scenario, STEPS, DT, every=EVERY)
    q0 = np.repeat(usual.q[:, 0], 2, axis=0)
    v0 = np.zeros_like(q0)
    v0[1] = 300.0
    found = rollout(machine, q0, v0, scenario, STEPS, DT, every=EVERY)
    np.testing.assert_allclose(found.q[0], usual.q[0], rtol=1e-12, atol=1e-12)
    assert found.ended.tolist() == [0, 2]
    assert found.steps[1] < STEPS
    np.testing.assert_array_equal(found.q[1, -1], found.q[1, -2])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hexarotor"])
def test_single_precision_is_near_double(name: str, fast: Callable[[str], ModuleType]) -> None:
    module = fast(name)
    scenario = read_scenario("circle", {"motors": {"compensation": False}})
    v0 = 0.05 * np.random.default_rng(1).normal(size=(19, len(module.VELOCITIES)))
    given = module, None, v0, scenario, STEPS, DT
    motors = {"time_constants": 0.02, "every": EVERY}
    double, single = (rollout(*given, **motors, precision=p) for p in ("double", "single"))
    for x in ("q", "v", "thrusts"):
        one, other = getattr(double, x), getattr(single, x)
        assert other.dtype == np.float32
        assert 1e-9 < np.abs(other - one).max() < 1e-4
    assert not single.ended.any()


@pytest.mark.slow
def test_thrusts_without_lag_are_those_that_are_commanded(
    machine: ModuleType, scenario: Scenario
) -> None:
    """Of a state without lag beside one with it; and states by themselves tell their progress."""
    slow, told = load(machine.__path__[0]), []
    lag = np.repeat([[0.0], [0.02]], 6, axis=1)
    more = {"every": EVERY, "progress": lambda what, share: told.append((what, share))}
    for module, steps in ((machine, STEPS), (slow, EVERY)):
        scene = replace(scenario, push=replace(scenario.push, begin=0.01))
        found = rollout(module, None, None, scene, steps, DT, time_constants=lag, **more)
        quick = replace(scene.motors, time_constant=0.0)
        flight = scenario_flights(module, replace(scene, duration=steps * DT), motors=quick)
        np.testing.assert_allclose(found.thrusts[0], flight.applied[:, :6], atol=1e-5)
        np.testing.assert_allclose(found.q[0], flight.q, atol=1e-8)
        assert np.ptp(found.thrusts[0, :, 0]) > 1e-3
    shares = [share for what, share in told if what == "rolling out states by themselves"]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(shares) > 2


@pytest.mark.parametrize("masses", [[3.0, 0.3], [0.3, 3.0]])
def test_steps_must_be_short_enough_for_every_state(
    masses: list[float], machine: ModuleType, scenario: Scenario
) -> None:
    """Which of them feels the wall most is not known by the lag."""
    wall = Plane("base", (9.0, 0.0, 0.0), (-1.0, 0.0, 0.0), stiffness=1.4e6, damping=1.0)
    at_wall = replace(scenario, walls=(wall,))
    light = masses.index(0.3)
    with pytest.raises(UsageError, match=f"dt: state {light}: in steps of .* the wall at base"):
        rollout(machine, None, None, at_wall, 2, 0.005, parameters={LENGTH: masses})


def test_a_scenario_is_given_by_its_path(machine: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_bytes((ROOT / "gibbs_codegen" / "scenarios" / "hover.toml").read_bytes())
    found = rollout(machine, None, None, path, 2, DT)
    np.testing.assert_array_equal(found.q, rollout(machine, None, None, "hover", 2, DT).q)


@pytest.mark.slow
def test_what_overflows_changes_no_other_quaternion(fast: Callable[[str], ModuleType]) -> None:
    """Without control nothing is bounded: rates become infinite, and quaternions 0 or NaN."""
    drone = fast("quadrotor")
    falls = read_scenario("hover", {"control": {"law": "off"}})
    v0 = np.zeros((3, 6))
    v0[1:, 3:] = np.array([1e3, 2e3, 3e3])
    v0[2] *= 1e150
    plant = {"base_inertia_yy": 1.7 * drone.PARAMETERS["base_inertia_yy"]}
    found = rollout(drone, None, v0, falls, 60, 0.02, every=10, parameters=plant)
    np.testing.assert_allclose(found.v[0, -1, 2], -9.81 * 1.2, rtol=1e-9)
    assert found.ended.tolist() == [0, 1, 1]
    assert np.all(np.isfinite(found.q))


WRONG = {
    "a scenario has its own method, wrenches, limits": {"limits": (0.0, 1.0)},
    "do not support control.rate, sensors": {"sensors": Sensors()},
    "dt: state 0: in steps of 2 s rk4 makes errors grow": {"dt": 2.0},
    "parameters: link2_mass_per_length: value 1 of 2 must be finite": {
        "parameters": {LENGTH: [1.0, np.nan]}
    },
}


@pytest.mark.parametrize("message", WRONG)
def test_what_is_wrong_is_told(message: str, machine: ModuleType, scenario: Scenario) -> None:
    given = {"dt": DT, **WRONG[message]}
    if sensors := given.pop("sensors", None):
        scenario = replace(scenario, sensors=sensors)
    with pytest.raises(UsageError) as error:
        rollout(machine, None, None, scenario, STEPS, **given)
    assert message in str(error.value)
