"""Flights that are stepped from outside: those of `simulate`, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from gibbs_codegen import view_html
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.control.sampled_control import Observation
from gibbs_codegen.flight.figures.results import write_results
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.flight.record.flight import read_flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.flight.stepping import Simulation
from gibbs_codegen.runtime import programs

Load = Callable[[str], ModuleType]

# A push that begins and ends between steps, limits that bind, lag, noise and delays.
EVERYTHING: dict[str, Any] = {
    "duration": 0.4,
    "start": {"offset": [0.1, -0.05, 0.1], "turn_deg": [3, 5, 0]},
    "motors": {"limits": [0, 3.68], "time_constant": 0.02},
    "push": {"frame": "base", "force": [0.5, 0, -0.3], "begin": 0.113, "end": 0.254},
    "sensors": {"position": 0.002, "attitude_deg": 0.1, "velocity": 0.01, "seed": 7},
}


def hover(**changes: Any) -> Scenario:
    return read_scenario("hover", EVERYTHING | changes)


def controller(module: ModuleType) -> Callable[[Observation], Array]:
    zero = np.zeros(6)

    def inputs(seen: Observation) -> Array:
        wanted = -6.0 * module.difference(seen.q_desired, seen.q) - 3.0 * seen.v
        force = module.inverse_dynamics(seen.q_desired, zero, wanted)
        u: Array = np.linalg.pinv(module.input_matrix(seen.q_desired)) @ force
        return u

    return inputs


@pytest.mark.parametrize(
    ("method", "delay", "late"),
    [
        ("rk4", 0.013, 0.033),
        pytest.param("adaptive", 0.027, 0.0, marks=pytest.mark.slow),
    ],
)
def test_a_loop_of_ones_own_flies_what_simulate_flies(
    method: str, delay: float, late: float, fast: Load
) -> None:
    module = fast("quadrotor")
    scenario = hover(
        control={"rate": 50, "delay": delay},
        sensors=EVERYTHING["sensors"] | {"delay": late},
        integration={"method": method, "step": 0.0005},
    )
    flight = simulate(module, scenario, controller(module))
    choose, simulation = controller(module), Simulation(module, scenario)
    seen = simulation.reset()
    while simulation.time < scenario.duration - 1e-9:
        seen = simulation.step(choose(seen))
    stepped = simulation.flight()
    assert np.any(flight.commanded > 3.68)
    assert (stepped.law, stepped.control_rate, stepped.stopped) == ("own", 0.0, "")
    assert stepped.time == pytest.approx(flight.time, abs=1e-12)
    for name in ("q", "v", "applied", "commanded", "work"):
        values, wanted = getattr(stepped, name)[:-1], getattr(flight, name)[:-1]
        assert values == pytest.approx(wanted, abs=1e-8), name
    assert simulation.q == pytest.approx(flight.q[-1], abs=1e-8)
    assert simulation.v == pytest.approx(flight.v[-1], abs=1e-8)


def test_steps_of_any_length(fast: Load) -> None:
    """With the same inputs, how the time is cut into steps makes no difference."""
    module, u = fast("quadrotor"), np.array([4.0, 4.1, 4.2, 4.1])
    settings = {"relative_tolerance": 1e-12, "absolute_tolerance": 1e-13}
    simulation = Simulation(module, hover(sensors={"seed": 0}, integration=settings))
    ends = []
    for steps in ([0.3], [0.1, 0.0037, 0.1963]):
        simulation.reset()
        for duration in steps:
            seen = simulation.step(u, duration)
        ends.append(seen.q)
        assert seen.time == pytest.approx(0.3)
    assert ends[1] == pytest.approx(ends[0], abs=1e-10)
    simulation.reset()
    assert simulation.step(u).time == 0.001


def test_what_is_seen_is_not_what_is_flown_and_no_time_is_no_step(fast: Load) -> None:
    simulation = Simulation(fast("quadrotor"), hover())
    simulation.step(np.full(4, 4.0), 1.25)
    before = [simulation.q, simulation.v, simulation.a]
    for each in (simulation.q, simulation.v, simulation.a):
        each *= 0.0
    simulation.step(np.full(4, 4.0), 1e-18)
    assert simulation.time == 1.25
    assert all(map(np.array_equal, before, [simulation.q, simulation.v, simulation.a]))


@pytest.mark.parametrize("method", ["adaptive", "rk4"])
def test_nothing_is_compiled_after_it_was_prepared(
    method: str, fast: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = hover(integration={"method": method}, sensors={"imu": [{"rate": 500}]})
    simulation = Simulation(fast("quadrotor"), scenario)
    simulation.prepare()
    monkeypatch.setattr(programs, "compiled_files", None)
    simulation.step(np.full(4, 4.0), 0.2)
    assert np.isfinite(simulation.sensors["imu"].values).all()


def test_reset(fast: Load) -> None:
    module = fast("quadrotor")
    simulation = Simulation(module, hover())
    first = simulation.reset()
    again, other = simulation.reset(), simulation.reset(seed=8)
    assert np.array_equal(first.q, again.q)
    assert not np.array_equal(first.q, other.q)
    assert np.array_equal(other.q, simulation.reset().q)
    q, v = np.array([1.0, 2, 3, 0, 0, 0.6, 0.8]), np.arange(6.0)
    simulation.reset(2.0 * q - np.array([1.0, 2, 3, 0, 0, 0, 0]), v)
    assert simulation.q == pytest.approx(q)
    assert simulation.v == pytest.approx(v)
    assert simulation.time == 0.0
    simulation.step(np.ones(4), 0.05)
    assert simulation.flight().q[0] == pytest.approx(q)
    simulation.reset()
    assert simulation.flight().time.tolist() == [0.0]


@pytest.mark.slow
def test_before_the_first_step_a_flight_is_the_start(fast: Load, tmp_path: Path) -> None:
    module = fast("quadrotor")
    limits = {"limits": [0.5, 3.68], "time_constant": 0.02}
    simulation = Simulation(module, hover(motors=limits))
    simulation.step(np.ones(4), 0.05)
    q, v = np.array([1.0, 2, 3, 0, 0, 0.6, 0.8]), np.arange(6.0)
    simulation.reset(q, v)
    flight = simulation.flight()
    for name, _, values in flight.columns():
        assert values.shape == (1,), name
    assert flight.q[0] == pytest.approx(q)
    assert flight.commanded.tolist() == [[0.0] * 4]
    assert flight.applied.tolist() == [[0.5] * 4]
    assert flight.a[0] == pytest.approx(module.forward_dynamics(q, v, flight.applied[0]))
    assert flight.work == 0.0
    write_results(flight, tmp_path, figures=False)
    again = read_flight(tmp_path / "flight.npz")
    assert again.positions.tolist() == flight.positions.tolist()
    view_html(again).save(tmp_path / "flight.html")
    assert simulation.stopped == ""
    simulation.step(np.ones(4), 0.05)
    assert simulation.flight().commanded[0].tolist() == [1.0] * 4


def test_what_is_refused(fast: Load) -> None:
    simulation = Simulation(fast("quadrotor"), hover(integration={"divergence": 0.5}))
    for u, words in (([1.0], "u: is an array of shape"), ([1, 1, 1, np.nan], "u: is nan for F_")):
        with pytest.raises(UsageError, match=words):
            simulation.step(u)
    for duration in (0.0, -1, np.inf, np.nan, "long"):
        with pytest.raises(UsageError, match="duration: must be a finite time above 0 s"):
            simulation.step(np.ones(4), duration)  # type: ignore[arg-type]
    for wrong in ([1.0], [np.inf] * 6, "fast"):
        with pytest.raises(UsageError, match="v: must be 6 finite numbers"):
            simulation.reset(v=wrong)  # type: ignore[arg-type]
    for length in (0.0, 1e-160, 1e200):
        with pytest.raises(
            UsageError, match="q: must be coordinates with a quaternion of length 1"
        ):
            simulation.reset(q=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, length]))
    for length in (1e-152, 1e151):
        simulation.reset(q=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, length]))
        assert simulation.q.tolist() == [0.0] * 6 + [1.0]
    simulation.reset()
    simulation.step(np.zeros(4), 1.0)
    assert "control is lost" in simulation.stopped
    assert simulation.time < 0.6
    assert simulation.flight().stopped == simulation.stopped
    with pytest.raises(UsageError, match=r"the flight has ended, at t = .* call reset"):
        simulation.step(np.zeros(4))
    simulation.reset()
    assert simulation.stopped == ""


def test_a_flight_that_ends_within_a_step_is_still_observed(fast: Load) -> None:
    """It falls, and ends before the time at which the sensors would have measured."""
    changes = {"integration": {"divergence": 0.5}, "sensors": {"delay": 0.02}}
    simulation = Simulation(fast("quadrotor"), hover(duration=1.0, **changes))
    for _ in range(100):
        seen = simulation.step(np.zeros(4), 0.05)
        if simulation.stopped:
            break
    assert "control is lost" in simulation.stopped
    flight = simulation.flight()
    before = np.interp(simulation.time - 0.02, flight.time, flight.q[:, 2])
    assert seen.q[2] == pytest.approx(before, abs=1e-3)


@pytest.mark.parametrize("seed", [-1, "a", 1.5])
def test_a_seed_that_is_none_changes_nothing(seed: Any, fast: Load) -> None:
    simulation = Simulation(fast("quadrotor"), hover())
    simulation.step(np.full(4, 4.0))
    time, q = simulation.time, simulation.q
    with pytest.raises(UsageError, match="seed: must be a whole number of 0 or more, not"):
        simulation.reset(q=[*q[:-1], 9.0], seed=seed)
    assert simulation.time == time
    assert np.array_equal(simulation.q, q)
    assert np.array_equal(simulation.reset().q, Simulation(fast("quadrotor"), hover()).reset().q)
