"""Closed loops in blocks: each flight is that of the loop of one state, whatever others do."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.tools import missing

from gibbs_codegen.flight.control.laws import Controller
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import CompiledLoop, steps_of
from gibbs_codegen.flight.integration.state_history import Loads
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import flight_start
from gibbs_codegen.runtime.blocks import Blocks
from gibbs_codegen.runtime.program_steps import ProgramSteps

Array = NDArray[np.float64]
Load = Callable[[str], ModuleType]

pytestmark = pytest.mark.usefixtures("optimized")

STEP = 1e-3
# More than two blocks, the last of which is not full.
COUNT = 19


def _silent(what: str, share: float) -> None:
    """Nobody is told of the progress."""


def loop_of(fast: Load, robot: str, scenario: str, changes: dict[str, Any]) -> ClosedLoop:
    module = fast(robot)
    if (module.__file__ or "").endswith(".py"):
        missing("nothing compiles")
    return flight_start(module, read_scenario(scenario, changes), _silent, False).loop


def starts(closed: ClosedLoop, count: int = COUNT, scatter: float = 0.02) -> Array:
    """States (count, size) about the start of the motion, each with its own errors."""
    q, v, _ = closed.controller.reference(0.0)
    off = scatter * np.random.default_rng(7).standard_normal((count, closed.size))
    return closed.start(q, v) + off


def block_of(
    closed: ClosedLoop, loads: Loads, count: int, bounds: Array | float = np.inf
) -> ProgramSteps:
    return steps_of(closed, bounds, loads, count, Blocks.widest())


def varied(closed: ClosedLoop, factors: Array) -> ClosedLoop:
    """The loop with gains, lag and limits of each flight, by factors (count); or of one, by ()."""
    by = factors[..., np.newaxis]
    gains = closed.controller.gains
    gains = replace(
        gains,
        stiffness=gains.stiffness * by,
        damping=gains.damping * by,
        integral=gains.integral * factors,
    )
    limits = np.where(np.isfinite(closed.actuators.thrusts), closed.actuators.thrusts, 0.0)
    limits = limits + np.where(np.isfinite(closed.actuators.thrusts), 0.0, [[-1e3], [1e3]])
    actuators = replace(
        closed.actuators, lag=closed.actuators.lag * by, thrusts=limits * by[..., np.newaxis]
    )
    return replace(closed, controller=replace(closed.controller, gains=gains), actuators=actuators)


def rounding_of(closed: ClosedLoop) -> float:
    """Compensation differences thrusts over so short a time that rounding shows."""
    return 1e-8 if closed.compensates else 1e-11


FLIGHTS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "angles": ("hexarotor_3link", "hover", {}),
    "lag": ("hexarotor", "hover", {"motors": {"time_constant": 0.02}}),
    "compensated": (
        "hexarotor",
        "circle",
        {"motors": {"time_constant": 0.02, "compensation": True}},
    ),
    "integral": ("hexarotor", "hover", {"control": {"integral": 0.5}}),
    "open loop": ("hexarotor_3link", "hover", {"control": {"law": "open_loop"}}),
    "off": ("hexarotor", "hover", {"control": {"law": "off"}}),
    "surrounded": (
        "hexarotor_3link",
        "hover",
        {
            "wind": {"velocity": [4, 1, 0], "drag": {"base": 0.5, "tip": 0.3}},
            "payload": [{"frame": "tip", "mass": 0.2}],
            "wall": [{"frame": "base", "point": [0, 0, 2], "normal": [0, 0, 1], "stiffness": 300}],
            "push": {"force": [1, 0, 2], "begin": 0, "end": 1},
        },
    ),
    "geometric": ("quadrotor_arm_2link", "circle", {"motors": {"time_constant": 0.02}}),
    "rotors that move": ("hydrus", "hover", {}),
    "quaternion": ("hextilt_flying_arm_5", "hover", {"motors": {"time_constant": 0.01}}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["off"])
def test_each_flight_is_that_of_the_loop_of_one_state(name: str, fast: Load) -> None:
    """Also with gains, limits and lags of its own, in samples and at the end."""
    closed, factors = loop_of(fast, *FLIGHTS[name]), np.linspace(0.8, 1.2, COUNT)
    loads, states = closed.loads(0.0), starts(closed)
    loads = loads._replace(push=bool(loads.push), payloads=tuple(np.atleast_1d(loads.payloads)))
    found = block_of(varied(closed, factors), loads, COUNT)(0.0, states, STEP, 100, 7, 3)
    assert not np.any(found.refused)
    for k, state in enumerate(states):
        one = CompiledLoop(varied(closed, factors[k]), np.inf, loads)
        taken, samples, last = one(0.0, state, STEP, 100, 7, 3)
        assert taken == found.taken[k] == 100
        rounding = rounding_of(closed)
        off = np.linalg.norm(found.samples[k] - samples, axis=1)
        assert np.all(off <= rounding * np.linalg.norm(samples, axis=1)), off
        assert np.linalg.norm(found.last[k] - last) <= rounding * np.linalg.norm(last)
        assert np.abs(last - state).max() > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["angles"])
def test_plant_and_model_may_differ_from_flight_to_flight(name: str, fast: Load) -> None:
    """Each law reckons with its own robot, and each robot moves and works by its own numbers."""
    closed = loop_of(fast, *FLIGHTS[name])
    module, law, count = closed.vehicle.module, closed.controller, 9
    masses = [key for key in module.PARAMETERS if "mass" in key]
    random = np.random.default_rng(3).uniform(0.9, 1.1, (2, len(masses), count))
    given = [
        {key: module.PARAMETERS[key] * by for key, by in zip(masses, factors, strict=True)}
        for factors in random
    ]

    def variant(of: int | slice) -> ClosedLoop:
        plant, model = (Vehicle(module, {k: x[of] for k, x in each.items()}) for each in given)
        # The geometric law knows a motion of the centre of mass, which is for one model.
        model = law.vehicle if name == "geometric" else model
        return replace(closed, vehicle=plant, controller=replace(law, vehicle=model))

    states = starts(closed, count)
    found = block_of(variant(slice(None)), Loads(), count)(0.0, states, STEP, 100, 10)
    for k, state in enumerate(states):
        one = CompiledLoop(variant(k), np.inf, Loads())
        taken, samples, _ = one(0.0, state, STEP, 100, 10)
        assert taken == found.taken[k] == 100
        off = np.linalg.norm(found.samples[k] - samples, axis=1)
        assert np.all(off <= rounding_of(closed) * np.linalg.norm(samples, axis=1)), off
    assert np.ptp(found.last, axis=0).min() > 0.0


@pytest.mark.slow
def test_a_flight_that_ends_changes_no_other(fast: Load) -> None:
    """One diverges, one is not finite, one is not flown; samples repeat where they ended."""
    closed = loop_of(fast, *FLIGHTS["lag"])
    loads, states = Loads(), starts(closed)
    bounds = np.repeat([0.5, np.inf], closed.vehicle.layout.v.size)
    block = block_of(closed, loads, COUNT, bounds)
    alone = block(0.0, states, STEP, 50, 5)
    assert np.all(alone.taken == 50)
    wrong, going = states.copy(), np.ones(COUNT, dtype=bool)
    wrong[3, 0] = np.nan
    wrong[9, closed.vehicle.layout.q.position.start] += 0.495
    wrong[9, closed.vehicle.layout.q.size + closed.vehicle.layout.v.position.start] += 2.0
    going[17] = False
    found = block(0.0, wrong, STEP, 50, 5, 0, going=going)
    others = np.delete(np.arange(COUNT), [3, 9, 17])
    for name in ("taken", "samples", "last"):
        assert np.array_equal(getattr(found, name)[others], getattr(alone, name)[others])
    assert found.taken[3] == 1
    assert found.taken[17] == 0
    assert np.array_equal(found.last[17], states[17])
    assert 1 < found.taken[9] < 50
    kept = found.taken[9] // 5
    assert np.all(np.isfinite(found.samples[9]))
    assert np.array_equal(found.samples[9, kept:], np.tile(found.last[9], (10 - kept, 1)))
    assert not np.any(found.refused)


@pytest.mark.slow
def test_a_wrench_that_rotors_cannot_produce_ends_its_flight_alone(fast: Load) -> None:
    closed = loop_of(fast, "quadrotor", "hover", {"control": {"law": "geometric"}})
    law = closed.controller
    allocation = copy.copy(law.allocation)
    allocation.refuses = True
    assert allocation.missing
    controller = Controller(law.vehicle, law.reference, allocation, law.gains)
    closed = replace(closed, controller=controller)
    q, v, _ = closed.controller.reference(0.0)
    states = np.tile(closed.start(q, v), (COUNT, 1))
    states[5, closed.vehicle.layout.q.position.start] += 0.1
    found = block_of(closed, Loads(), COUNT)(0.0, states, STEP, 20)
    assert np.flatnonzero(found.refused).tolist() == [5]
    assert found.taken[5] == 0
    assert np.array_equal(found.last[5], states[5])
    assert np.all(np.delete(found.taken, 5) == 20)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1])
def test_threads_make_no_difference(count: int, fast: Load) -> None:
    closed = loop_of(fast, *FLIGHTS["lag"])
    states = starts(closed, count)
    block = block_of(closed, Loads(), count)
    one, three = (block(0.0, states, STEP, 30, 3, threads=threads) for threads in (1, 3))
    assert all(np.array_equal(a, b) for a, b in zip(one, three, strict=True))


def test_calls_go_on_where_the_last_one_ended(fast: Load) -> None:
    closed = loop_of(fast, *FLIGHTS["lag"])
    states = starts(closed)
    block = block_of(closed, Loads(), COUNT)
    whole = block(0.0, states, 2.0**-10, 40, 4)
    first = block(0.0, states, 2.0**-10, 17, 4)
    rest = block(17 * 2.0**-10, first.last, 2.0**-10, 23, 4, 17)
    assert np.array_equal(np.concatenate([first.samples, rest.samples], axis=1), whole.samples)
    assert np.array_equal(rest.last, whole.last)
