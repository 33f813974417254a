"""The compiled loop: the same steps as in Python, samples, early ends, and C under instruments."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import DOP853
from support.tools import missing

from gibbs_codegen.flight.attitude import LARGEST_THETA_0
from gibbs_codegen.flight.control.laws import Controller, Gains
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import (
    CompiledLoop,
    CompiledLoops,
)
from gibbs_codegen.flight.integration.state_history import NOTHING, Loads
from gibbs_codegen.flight.plant.actuators import Actuators
from gibbs_codegen.flight.plant.allocation import Allocation
from gibbs_codegen.flight.plant.environment import Environment
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.parts import Law, Push
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.runtime import program_flow
from gibbs_codegen.runtime.c_library import ModuleLibrary
from gibbs_codegen.runtime.program_flow import Flow, Leg

pytestmark = pytest.mark.usefixtures("derived_once", "optimized")

Array = NDArray[np.float64]
Load = Callable[[str], ModuleType]

LAWS: tuple[Law, ...] = ("computed_torque", "open_loop", "off")
# A power of two, so that times are exact and calls can be told apart by nothing but mistakes; and
# long, so that slopes at the wrong times would show.
STEP = 2.0**-8
# Along no axis, so that every row of the Jacobian counts.
PUSH = Push((0.7, -0.4, 0.5), 0.0, 1.0, (0.2, 0.3, -0.1))


@pytest.fixture(scope="module")
def modules(fast: Load) -> Load:
    """Load the C back end of a robot that ships."""

    def module(name: str) -> ModuleType:
        found = fast(name)
        if (found.__file__ or "").endswith(".py"):
            missing("nothing compiles")
        return found

    return module


def smooth(count: int) -> Reference:
    """A motion of `count` coordinates that keeps away from the singularity."""
    time = np.linspace(0.0, 0.5, 8)
    rates = 1.0 + 0.3 * np.arange(count)
    phases = rates * time[:, np.newaxis] + np.arange(count)
    return Reference(
        Motion(time, np.sin(phases), rates * np.cos(phases), -(rates**2) * np.sin(phases))
    )


def closed_loop_of(module: ModuleType, law: Law = "computed_torque") -> ClosedLoop:
    vehicle = Vehicle(module)
    count = len(vehicle.coordinates)
    gains = Gains.of(np.linspace(4.0, 9.0, count), np.linspace(0.5, 1.1, count), count)
    allocation = Allocation(vehicle.thrust_wrenches())
    controller = Controller(vehicle, smooth(count), allocation, gains, law)
    return ClosedLoop(vehicle, controller, Actuators.unlimited(vehicle))


def restricted(
    closed: ClosedLoop, limits: tuple[float, float] | None = None, lag: float = 0.0
) -> ClosedLoop:
    """The loop with limits of all thrusts, and motors that lag by `lag` and up to twice as much."""
    actuators = Actuators.unlimited(closed.vehicle)
    if limits:
        actuators.thrusts[:] = np.transpose([limits])
    actuators.lag[:] = lag * np.linspace(1.0, 2.0, closed.vehicle.rotors)
    return replace(closed, actuators=actuators)


def start_of(closed: ClosedLoop) -> Array:
    """A state beside the reference at time 0, with every coordinate off by its own amount."""
    q, v, _ = closed.controller.reference(0.0)
    off = 0.1 * np.cos(np.arange(len(q)))
    return closed.start(q + off, v - 2.0 * off)


def unbounded(closed: ClosedLoop) -> Array:
    return np.full(2 * len(closed.vehicle.coordinates), np.inf)


def loop_of(
    closed: ClosedLoop, bounds: Array | None = None, loads: Loads = NOTHING
) -> CompiledLoop:
    return CompiledLoop(closed, unbounded(closed) if bounds is None else bounds, loads)


# Steps


def test_steps_of_adaptive_size_are_those_of_scipy(modules: Load) -> None:
    """The same method: as many steps, of the same sizes, and the same states on the way."""
    closed = closed_loop_of(modules("hexarotor"))
    compiled, state, end = (
        CompiledLoop(closed, unbounded(closed), method="adaptive"),
        start_of(closed),
        0.5,
    )
    slope, leg = compiled.slope, (Leg * 1)(Leg(0.0, end, 0.0, 0, 1))
    relative, absolute = 1e-8, 1e-9 * np.linspace(1.0, 3.0, len(state))
    first, times = 0.01, np.linspace(0.0, end, 41)[1:]

    def flown(flow: Flow, scale: Array) -> tuple[list[float], list[Array], Array]:
        """Ends of steps, samples, and the last state."""
        ends, samples, x = [0.0], [np.empty((0, len(state)))], state
        while flow.leg < 1:
            flow.steps = 1
            flow.scale = scale.ctypes.data
            found = compiled.flow(flow, leg, x, times[sum(map(len, samples)) :])
            samples.append(found.samples)
            x = found.last
            ends.append(flow.time)
        return ends, samples, x

    flow = Flow(0.0, first, budget=1e6, most=1e6, smooth=1)
    flow.relative, flow.absolute = (relative,) * 2, (1.0, 1.0)
    ends, found, last = flown(flow, absolute)
    solver = DOP853(slope, 0.0, state, end, rtol=relative, atol=absolute, first_step=first)
    steps, samples = [0.0], [np.empty((0, len(state)))]
    while solver.status == "running":
        solver.step()
        inside = times[(times > steps[-1]) & (times <= solver.t)]
        samples.append(solver.dense_output()(inside).T)
        steps.append(solver.t)
    assert 5 < len(steps) < 100
    assert ends == pytest.approx(steps, rel=1e-6)
    assert np.concatenate(samples) == pytest.approx(np.concatenate(found), rel=1e-9, abs=1e-11)
    assert last == pytest.approx(solver.y, rel=1e-9, abs=1e-11)
    # Each call begins with an evaluation.
    assert 1e6 - flow.budget - (len(steps) - 2) == solver.nfev
    assert flow.step == pytest.approx(solver.h_abs, rel=1e-4)
    # At knots third derivatives jump: steps end there where it matters.
    knots = closed.controller.reference.knots[1:]
    assert not np.isin(knots, ends)[:-1].any()
    flow = Flow(0.0, first, budget=1e6, most=1e6, smooth=1, piece=knots[0])
    flow.relative, flow.absolute = (1e-12,) * 2, (1e-3, 1e-3)
    ends, *_ = flown(flow, absolute)
    assert knots == pytest.approx(np.array(ends)[np.isin(ends, knots)], abs=1e-9)


# Compensation differences thrusts over so short a time that rounding shows.
@pytest.mark.slow
@pytest.mark.parametrize(("compensated", "rounding"), [(False, 1e-12)])
@pytest.mark.parametrize("law", ["computed_torque"])
@pytest.mark.parametrize(
    ("name", "lag", "push"),
    [("hexarotor_3link", 0.0, None)],
)
def test_every_step_is_that_of_python(
    name: str,
    law: Law,
    lag: float,
    push: Push | None,
    compensated: bool,
    rounding: float,
    modules: Load,
) -> None:
    """From each state that the loop comes to, Python takes the next step to the same state."""
    limits = None if law == "off" else (-1e6, 1e6)
    closed = restricted(closed_loop_of(modules(name), law), limits, lag)
    environment = Environment(closed.vehicle, push) if push else None
    closed = replace(closed, environment=environment, compensated=compensated)
    state = start_of(closed)
    after_work = 2 * len(closed.vehicle.coordinates) + 1
    state[after_work:] += np.cos(np.arange(len(state) - after_work))
    loads = Loads(push=push is not None)
    taken, samples, last = loop_of(closed, loads=loads)(0.0, state, STEP, 25, 1)
    assert taken == len(samples) == 25
    assert np.array_equal(samples[-1], last)
    q, _, work, thrusts, *_ = closed.parts(np.ptp(samples, axis=0))
    assert min([*q, *thrusts]) > 1e-3
    assert work > 1e-3 or (law == "off" and not lag and not push)
    for done, after in enumerate(samples):
        expected = closed.step(done * STEP, state, STEP, loads)
        moved = np.linalg.norm(expected - state)
        assert np.linalg.norm(after - expected) <= rounding * (np.linalg.norm(state) + moved)
        state = after


@pytest.mark.slow
def test_a_push_that_does_not_act_changes_nothing(modules: Load) -> None:
    closed = closed_loop_of(modules("hexarotor_3link"))
    state = start_of(closed)
    _, free, _ = loop_of(closed)(0.0, state, STEP, 10, 1)
    pushed = replace(closed, environment=Environment(closed.vehicle, PUSH))
    _, waiting, _ = loop_of(pushed)(0.0, state, STEP, 10, 1)
    assert np.array_equal(waiting, free)
    loop = loop_of(pushed, loads=Loads(push=True))
    assert np.abs(loop(0.0, state, STEP, 10, 1)[1] - free).max() > 1e-4


# Samples


@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.slow), 3, 5, 7, 100])
def test_samples_do_not_depend_on_how_steps_are_shared_among_calls(
    every: int, modules: Load
) -> None:
    closed = closed_loop_of(modules("hexarotor_3link"))
    loop, state = loop_of(closed), start_of(closed)
    _, all_states, end = loop(0.0, state, STEP, 40, 1)
    done, found = 0, []
    for count in (7, 1, 0, 12, 3, 4, 13):
        taken, samples, state = loop(done * STEP, state, STEP, count, every, done)
        assert taken == count
        found.append(samples)
        done += taken
    assert np.array_equal(state, end)
    assert np.array_equal(np.concatenate(found), all_states[every - 1 :: every])


def test_a_call_leaves_the_state_that_it_is_given(modules: Load) -> None:
    closed = closed_loop_of(modules("hexarotor"))
    state = start_of(closed)
    before = state.copy()
    loop_of(closed)(0.0, state, STEP, 5, 1)
    assert np.array_equal(state, before)


# Early ends


@pytest.mark.parametrize("place", [0, 4, 8, 9, 13, 17])
def test_a_flight_ends_after_the_step_that_diverges(place: int, modules: Load) -> None:
    """Each coordinate and each rate is held to a bound of its own."""
    closed = closed_loop_of(modules("hexarotor_3link"), "off")
    state = start_of(closed)
    _, states, _ = loop_of(closed)(0.0, state, STEP, 40, 1)
    wanted = np.concatenate(closed.controller.reference(STEP * np.arange(1, 41))[:2], axis=1)
    error = np.abs(states[:, : wanted.shape[1]] - wanted)[:, place]
    bound = (error[20] + error[21]) / 2.0
    first = int(np.argmax(error > bound))
    bounds = unbounded(closed)
    bounds[place] = bound
    taken, samples, last = loop_of(closed, bounds)(0.0, state, STEP, 40, 4)
    assert 0 < taken == first + 1 < 40
    assert np.array_equal(samples, states[3:taken:4])
    assert np.array_equal(last, states[first])


@pytest.mark.parametrize("rate", [-3.0, 3.0, 40.0, -1000.0, 1400.0])
def test_a_flight_ends_after_the_step_that_reaches_the_singularity(
    rate: float, modules: Load
) -> None:
    """Also where the step goes across it, once or twice or all the way round."""
    closed = closed_loop_of(modules("hexarotor"), "off")
    state = np.zeros(closed.size)
    state[1], state[len(closed.vehicle.coordinates) + 1] = math.copysign(1.2, rate), rate
    taken, samples, last = loop_of(closed)(0.0, state, STEP, 100, 1)
    assert 0 < taken == len(samples) < 100
    assert np.array_equal(samples[-1], last)
    assert abs(last[1]) > LARGEST_THETA_0
    assert np.all(np.abs(samples[:-1, 1]) <= LARGEST_THETA_0)
    if abs(rate) > 30.0:
        turned = abs(1.2 + abs(rate) * taken * STEP)
        assert abs(last[1]) == pytest.approx(turned, rel=0.05)


@pytest.mark.parametrize("wrong", [np.inf, 1e200])
def test_a_flight_ends_where_it_is_not_finite(wrong: float, modules: Load) -> None:
    free = closed_loop_of(modules("hexarotor_3link"))
    for closed in (free, restricted(free, (-1e6, 1e6))):
        state = start_of(closed)
        state[len(closed.vehicle.coordinates)] = wrong
        taken, samples, last = loop_of(closed)(0.0, state, STEP, 10, 1)
        assert taken == len(samples) == 1
        assert not np.all(np.isfinite(last))


# Who has a loop


def test_python_takes_the_steps_of_numpy(shipped: Load) -> None:
    plain = closed_loop_of(shipped("hexarotor"))
    assert CompiledLoops(plain, np.inf).at(NOTHING) is None


def test_without_a_compiler_python_takes_the_steps(
    modules: Load, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    closed = closed_loop_of(modules("hexarotor"))
    monkeypatch.setenv("CC", "no_such_compiler")
    assert CompiledLoops(closed, np.inf).at(NOTHING) is None
    assert "steps run in Python instead of C" in caplog.text


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"control": {"rate": 100.0}, "integration": {"method": "rk4"}},
        {
            "wind": {"velocity": [1.0, 0.0, 0.0], "drag": {"base": 0.3}},
            "control": {"integral": 0.5},
        },
    ],
    ids=["at all times", "sampled", "in wind"],
)
def test_a_flight_by_what_was_compiled_while_it_was_planned(
    changes: dict[str, Any], modules: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The text that is compiled ahead, for a machine at rest, is that of the flight."""
    texts = list[str]()

    class KnownError(Exception):
        pass

    def source(*given: Any) -> str:
        texts.append(flow_source(*given))
        raise KnownError

    @contextmanager
    def built(_: object, ahead: Callable[[], Callable[[], object]]) -> Iterator[None]:
        with pytest.raises(KnownError):
            ahead()()
        yield

    flow_source = program_flow.flow_source
    monkeypatch.setattr(program_flow, "flow_source", source)
    monkeypatch.setattr(ModuleLibrary, "built", built)
    path = {"kind": "line", "start": [0, 0, 2], "end": [0.01, 0, 2], "duration": 1}
    scenario = {"name": "line", "duration": 1, "base": {"path": path}, **changes}
    with pytest.raises(KnownError):
        simulate(modules("quadrotor_arm_2link"), scenario)
    assert len(texts) == 2
    assert texts[0] == texts[1]
