"""A force and a torque at any frame: against momentum and energy, and in both loops alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import Push, Settings
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import simulate

Load = Callable[[str], ModuleType]

FORCE, TORQUE = np.array([0.7, -0.4, 0.5]), np.array([0.02, 0.05, -0.03])
BEGIN, END = 0.1003, 0.3007  # Neither is on the grid of steps.
RK4 = Settings(method="rk4", step=0.0005, rate=1000.0)
TIGHT = Settings(relative_tolerance=1e-12, absolute_tolerance=1e-13, rate=1000.0)


@pytest.fixture(scope="module")
def dual_arm(fast: Load) -> ModuleType:
    return fast("dual_arm")


def adrift(push: Push, settings: Settings) -> Scenario:
    """A robot that falls, bent and turned, with its motors off, and is pushed."""
    start = {"turn_deg": [20, 30, 40]}
    scenario = read_scenario("hover", {"start": start, "control": {"law": "off"}})
    return replace(scenario, duration=0.4, integration=settings, push=push)


@pytest.mark.slow
@pytest.mark.parametrize("frame", ["right_hand"])
def test_both_loops_push_alike_and_energy_balances(frame: str, dual_arm: ModuleType) -> None:
    push = Push(tuple(FORCE), BEGIN, END, tuple(TORQUE), frame)
    exact = simulate(dual_arm, adrift(push, TIGHT))
    compiled = simulate(dual_arm, adrift(push, RK4))
    free = simulate(dual_arm, replace(adrift(push, RK4), push=None))
    assert np.abs(exact.energy_error).max() < 1e-9
    assert np.ptp(exact.work) > 1e-3
    assert compiled.q == pytest.approx(exact.q, abs=1e-7)
    assert compiled.work == pytest.approx(exact.work, abs=1e-7)
    assert compiled.a == pytest.approx(exact.a, abs=1e-4)
    assert np.abs(free.q - exact.q)[-1].max() > 1e-3


def test_a_push_at_the_tip_is_what_a_force_there_was(fast: Load) -> None:
    """By the mass matrix and the Jacobian of the tip, as flights were computed before."""
    module = fast("hexarotor_3link")
    push = Push((3.0, -1.0, 2.0), 0.0, 1.0)
    flight = simulate(module, replace(read_scenario("circle"), duration=0.2, push=push))
    force = np.asarray(push.force) @ module.tip_jacobian(flight.q)[:, :3]
    free = module.forward_dynamics(flight.q, flight.v, flight.applied)
    extra = np.linalg.solve(module.mass_matrix(flight.q), force[..., np.newaxis])[..., 0]
    assert flight.a == pytest.approx(free + extra, rel=1e-9, abs=1e-9)


def test_an_unknown_frame_is_refused_with_those_there_are(fast: Load) -> None:
    scenario = replace(read_scenario("hover"), push=Push(frame="hand\n"))
    message = r"push.frame: hexarotor_3link has no frame hand\\n; its frames: base, tip"
    with pytest.raises(UsageError, match=message):
        simulate(fast("hexarotor_3link"), scenario)
