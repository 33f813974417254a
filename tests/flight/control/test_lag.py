"""Motor lag, compensated: flights as if there were none, and thrusts that find back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.emitted import emitted_module

from gibbs_codegen.flight.control.laws import Controller, Gains
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.state_history import NOTHING
from gibbs_codegen.flight.plant.actuators import Actuators
from gibbs_codegen.flight.plant.allocation import allocation_of
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import Law
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.robot.file import read_robot

Array = NDArray[np.float64]
Load = Callable[[str], ModuleType]


def flight_scenario(name: str, **changes: Any) -> Scenario:
    return read_scenario(name, {"integration": {"method": "rk4"}, **changes})


@pytest.mark.slow
def test_the_papers_flight_goes_on_with_lagging_motors(fast: Load) -> None:
    """Without compensation control is lost at once."""
    changes: dict[str, Any] = {"duration": 0.4, "motors": {"time_constant": 0.02}}
    flight = simulate(fast("hexarotor_3link"), flight_scenario("paper", **changes))
    assert not flight.stopped
    assert flight.time[-1] == pytest.approx(0.4)
    assert flight.tip_error.max() < 1e-4
    assert flight.centre_error.max() < 1e-5
    changes["motors"]["compensation"] = False
    lost = simulate(fast("hexarotor_3link"), flight_scenario("paper", **changes))
    assert lost.time[-1] < 0.1


@pytest.mark.parametrize("time_constant", [0.2])
def test_a_flight_with_lag_is_that_without(time_constant: float, fast: Load) -> None:
    """Feedback and all, from a start that is off."""
    start = {"offset": [0.2, -0.1, 0.1], "turn_deg": [5, 10, -5]}
    free = flight_scenario("circle", start=start, duration=2.0)
    lagging = replace(free, motors=replace(free.motors, time_constant=time_constant))
    with_lag, without = (simulate(fast("hexarotor_3link"), each) for each in (lagging, free))
    assert with_lag.centre_error.max() > 0.1
    for name in ("q", "v", "applied"):
        theirs = getattr(without, name)
        tolerance = 1e-5 * np.abs(theirs).max()
        assert getattr(with_lag, name) == pytest.approx(theirs, rel=0, abs=tolerance), name


def test_open_loop_thrusts_are_those_of_the_desired_motion(fast: Load) -> None:
    changes: dict[str, Any] = {
        "base": {"attitude": {"kind": "level"}},
        "control": {"law": "open_loop"},
        "motors": {"time_constant": 0.1},
    }
    flight = simulate(fast("hexarotor"), flight_scenario("circle", **changes, duration=1.0))
    assert flight.centre_error.max() < 1e-4
    asked, given = flight.commanded[:, :6], flight.applied[:, :6]
    assert np.abs(asked - given).max() > 0.01 * np.ptp(given)


def loop_of(module: ModuleType, law: Law = "computed_torque", lag: float = 0.05) -> ClosedLoop:
    """A loop along a smooth motion, whose first motor does not lag and last does most."""
    vehicle = Vehicle(module)
    count = vehicle.layout.v.size
    time = np.linspace(0.0, 2.0, 9)
    rates, phases = 0.5 + 0.1 * np.arange(count), np.arange(count)
    angles = rates * time[:, np.newaxis] + phases
    motion = 0.3 * np.array([np.sin(angles), rates * np.cos(angles), -(rates**2) * np.sin(angles)])
    reference = Reference(Motion(time, *motion))
    controller = Controller(
        vehicle, reference, allocation_of(vehicle).in_flight(), Gains.of(5.0, 0.8, count), law
    )
    actuators = Actuators.unlimited(vehicle)
    actuators.lag[1:] = lag * np.arange(1, vehicle.rotors)
    return ClosedLoop(vehicle, controller, actuators, compensated=True)


def start_of(loop: ClosedLoop, off: float) -> Array:
    """A state beside the motion at its begin, whose lagging thrusts are `off` what is wanted."""
    q, v, _ = loop.controller.reference(0.0)
    state = loop.start(q + 0.05 * np.cos(np.arange(len(q))), v)
    state[loop.layout.places.actuators][1:] += off
    return state


@pytest.mark.parametrize("law", ["computed_torque", "open_loop"])
def test_a_thrust_that_is_off_finds_back_within_its_time_constant(law: Law, fast: Load) -> None:
    """As e^(−t/T), each with its own T, whatever else happens."""
    loop = loop_of(fast("hexarotor"), law)
    state, size = start_of(loop, 2.0), 0.002
    for step in range(50):
        state = loop.step(step * size, state, size, NOTHING)
    q, v, _, thrusts, memory, _ = loop.parts(state)
    wanted = loop.controller.commanded(50 * size, q, v, memory, {})[0][: len(thrusts)]
    decay = np.exp(-50 * size / loop.actuators.lag[1:])
    assert (thrusts - wanted)[1:] == pytest.approx(2.0 * decay, abs=1e-5)


@pytest.mark.parametrize(
    ("robot", "heavier"),
    [
        ("hexarotor_3link", 1.0),
        ("hexarotor_3link", 1.3),
        pytest.param("everything", 1.3, marks=pytest.mark.slow),
    ],
)
def test_commands_look_ahead_along_the_motion_of_the_flight(
    robot: str, heavier: float, fast: Load
) -> None:
    """By thrusts that the law wants a little earlier and later in flights that are integrated.

    Of masses that it does not know, and in wind.
    """
    file = Path(__file__).parents[2] / "robots/everything.toml"
    module = (
        fast(robot)
        if robot != "everything"
        else emitted_module(read_robot(str(file))[0], "default")
    )
    loop = loop_of(module)
    if heavier != 1.0:
        plant = {k: heavier * x for k, x in module.PARAMETERS.items() if "mass" in k}
        wind = {"velocity": [6, 4, 0], "drag": {"base": 0.8}}
        loop = loop.with_plant(plant, loop.actuators.lag, flight_scenario("hover", wind=wind))
    rotors, state, time, size = loop.vehicle.rotors, start_of(loop, 0.3), 0.3, 1e-6
    wanted = []
    for side in (-size, size):
        q, v, _, _, memory, _ = loop.parts(loop.step(time, state, side, NOTHING))
        wanted.append(loop.controller.commanded(time + side, q, v, memory, {})[0][:rotors])
    parts = loop.parts(state)
    law, _ = loop.controller.commanded(time, parts.q, parts.v, parts.memory, {})
    more = loop.inputs(time, parts)[0] - law
    rates = (wanted[1] - wanted[0]) / (2.0 * size)
    assert more[:rotors] == pytest.approx(loop.actuators.lag * rates, rel=1e-3, abs=1e-3)
    assert np.abs(more[1:rotors]).max() > 0.02
    assert more[0] == 0.0
    assert not np.any(more[rotors:])


@pytest.mark.parametrize("side", [0, 1])
def test_commands_do_not_jump_where_a_thrust_comes_to_its_limit(side: int, fast: Load) -> None:
    """Beside a limit that the law just wants, and with none that it could lead beyond."""
    loop = loop_of(fast("hexarotor"))
    state, rotor = start_of(loop, 2.0), 3
    parts = loop.parts(state)
    wanted = loop.controller.commanded(0.3, parts.q, parts.v, parts.memory, {})[0]
    led = loop.inputs(0.3, parts)[0]
    assert abs(led - wanted)[rotor] > 0.1

    def commanded(beyond: float) -> Array:
        thrusts = np.full((2, 6), [[-1e3], [1e3]])
        thrusts[side, rotor] = wanted[rotor] + (beyond if side == 0 else -beyond)
        controller = replace(
            loop.controller, allocation=allocation_of(loop.vehicle, limits=thrusts).in_flight()
        )
        actuators = replace(loop.actuators, thrusts=thrusts)
        limited = replace(loop, controller=controller, actuators=actuators)
        return limited.inputs(0.3, parts)[0]

    assert commanded(-1e-6) == pytest.approx(led, abs=1e-5)
    assert commanded(1e-6) == pytest.approx(led, abs=1e-3)
    # Far beyond a limit nothing is led.
    far = commanded(50.0)
    held = wanted[rotor] + (50.0 if side == 0 else -50.0)
    assert far[rotor] == pytest.approx(held, abs=1e-9)


def test_commands_at_limits_stay_within_them_and_bring_the_robot_back(fast: Load) -> None:
    """Where limits begin to bind the law's thrusts have kinks, and no rate there is endless."""
    changes = {
        "motors": {"limits": [-10, 13], "time_constant": 0.03},
        "start": {"offset": [0.8, 0.4, -0.3], "turn_deg": [10, 5, 0]},
    }
    scenario = flight_scenario("hover", **changes, duration=3.0)
    flight = simulate(fast("hexarotor"), scenario)
    assert not flight.stopped
    assert np.all((flight.applied[:, :6] >= -10.0) & (flight.applied[:, :6] <= 13.0))
    assert np.any(np.abs(flight.applied[:, :6] - 13.0) < 1e-3)
    assert np.abs(flight.commanded[:, :6]).max() < 100.0
    assert flight.centre_error[-1] < 1e-3
