"""Integral action: what lasts is learned, errors decay as stated, and nothing winds up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate

Load = Callable[[str], ModuleType]

FIXED = {"method": "rk4", "step": 0.002}
PUSH = {"frame": "base", "force": [1.0, -2.0, 3.0], "torque": [0.1, 0.2, -0.1], "begin": 0.0}


def hover(duration: float, **changes: Any) -> Any:
    return read_scenario("hover", {"duration": duration, "integration": FIXED, **changes})


@pytest.mark.slow
def test_errors_under_a_constant_push_decay_as_stated(fast: Load) -> None:
    """Along z, e⃛ + d ë + k ė + i k e = 0 from rest with ë = −force / mass; in C as in Python."""
    rate, force = 1.5, 3.0
    push = {"frame": "base", "force": [0.0, 0.0, force]}
    scenario = hover(6.0, push=push, control={"integral": rate})
    flight = simulate(fast("hexarotor"), scenario)
    w = scenario.control.frequency
    # Position is the last of the coordinates.
    mass = fast("hexarotor").mass_matrix(flight.q[0])[-1, -1]
    roots = np.roots([1.0, 2.0 * w, w**2, rate * w**2])
    shares = np.linalg.solve(np.vander(roots, 3, increasing=True).T, [0.0, 0.0, force / mass])
    expected = (shares * np.exp(np.outer(flight.time, roots))).sum(axis=1).real
    assert flight.q[:, -1] - flight.q_desired[:, -1] == pytest.approx(expected, abs=1e-7)
    assert np.abs(expected).max() > 0.01
    other = replace(scenario, integration=replace(scenario.integration, method="adaptive"))
    adaptive = simulate(fast("hexarotor"), other)
    assert adaptive.q == pytest.approx(flight.q, abs=1e-7)


@pytest.mark.slow
def test_what_lasts_is_learned(fast: Load) -> None:
    """A push, and masses that the controller does not know; without, errors stay."""
    changes: dict[str, Any] = {"push": PUSH, "plant": {"gravity": 10.8}}
    changes["arm"] = {"posture_deg": {"theta_8": -70, "theta_9": 35}}
    module = fast("hexarotor_3link")
    for rate, least, most in ((0.0, 0.01, np.inf), (1.5, 0.0, 1e-4)):
        flight = simulate(module, hover(12.0, control={"integral": rate}, **changes))
        assert not flight.stopped
        off = np.abs(flight.q - flight.q_desired)[-1].max()
        assert least < off < most


@pytest.mark.slow
def test_the_geometric_law_learns_what_lasts(fast: Load) -> None:
    """Its centre of mass comes to rest where it should, but for which the base leans for good."""
    push = {**PUSH, "torque": [0.0, 0.0, 0.0]}
    for rate, least, most in ((0.0, 0.1, np.inf), (1.5, 0.0, 3e-3)):
        changes = {"push": push, "plant": {"gravity": 10.8}, "control": {"integral": rate}}
        flight = simulate(fast("quadrotor"), hover(8.0, **changes))
        assert not flight.stopped
        assert least < flight.centre_error[-1] < most


@pytest.mark.slow
def test_nothing_winds_up_at_limits(fast: Load) -> None:
    """A push that is too strong for the motors ends, and the robot does not shoot past."""
    push = {"frame": "base", "force": [0.0, 0.0, -8.0], "begin": 0.5, "end": 3.0}
    motors = {"limits": [-12.0, 12.0]}
    changes = {"push": push, "motors": motors, "control": {"integral": 2.0}}
    flight = simulate(fast("hexarotor"), hover(9.0, **changes))
    height = flight.q[:, -1] - flight.q_desired[:, -1]
    pushed = flight.time < 3.0
    assert height.min() < -0.2
    assert height[~pushed].max() < 0.25 * np.abs(height.min())
    assert np.abs(height[-1]) < 0.05


@pytest.mark.parametrize("robot", ["hexarotor"])
def test_integral_action_that_makes_errors_grow_is_refused(robot: str, fast: Load) -> None:
    message = r"control\.integral: 10 1/s makes errors grow; give less than 10 1/s"
    with pytest.raises(UsageError, match=message):
        simulate(fast(robot), hover(1.0, control={"integral": 10.0}))
