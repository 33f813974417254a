"""The least and the greatest inputs between samples, by both methods, in Python and in C."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from gibbs_codegen.flight.integration import compiled_loop
from gibbs_codegen.flight.integration.state_history import InputRanges
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.series import RANGES
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate

# A second from a start that is off, which takes inputs that change fast, at 20 samples a second.
DISTURBED = {
    "duration": 1.0,
    "start": {"offset": [0.1, -0.05, 0.1], "turn_deg": [5, 0, 3]},
    "control": {"frequency": 25.0},
}
FIXED = {"method": "rk4", "step": 1e-3}


@pytest.fixture(scope="module")
def module(fast: Callable[[str], ModuleType]) -> ModuleType:
    return fast("hexarotor")


def fly(module: ModuleType, **integration: object) -> Flight:
    changes = {**DISTURBED, "integration": {"rate": 20.0, **integration}}
    changes["motors"] = {"time_constant": 0.01, "limits": [-1e4, 1e4]}
    return simulate(module, read_scenario("hover", changes))


def extremes_of(fine: Flight, coarse: Flight) -> dict[str, np.ndarray]:
    """What the samples of `fine` tell of the ranges of `coarse`, whose samples they include."""
    every = (len(fine.time) - 1) // (len(coarse.time) - 1)
    found = {}
    for name in RANGES:
        series = getattr(fine, name.partition("_")[0])
        pick = np.min if name.endswith("least") else np.max
        rows = [series[:1]] + [
            series[k * every : (k + 1) * every + 1] for k in range(len(coarse.time) - 1)
        ]
        found[name] = np.array([pick(row, axis=0) for row in rows])
    return found


def test_ranges_are_those_of_all_steps(module: ModuleType) -> None:
    """A flight in which every step is a sample is the oracle, in C and with steps in Python."""
    coarse = fly(module, **FIXED)
    fine = fly(module, **{**FIXED, "rate": 1000.0})
    for name, expected in extremes_of(fine, coarse).items():
        np.testing.assert_allclose(getattr(coarse, name), expected, rtol=1e-8, atol=1e-8)
    between = coarse.commanded_greatest[1:] - np.maximum(
        coarse.commanded[1:], coarse.commanded[:-1]
    )
    assert between.max() > 1e-2


@pytest.mark.slow
def test_steps_in_python_see_the_same(module: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = fly(module, **FIXED)
    monkeypatch.setattr(compiled_loop, "is_compiled", lambda *_: False)
    plain = fly(module, **FIXED)
    for name in RANGES:
        np.testing.assert_allclose(getattr(plain, name), getattr(compiled, name), atol=1e-9)


def test_adaptive_steps_are_looked_into(module: ModuleType) -> None:
    coarse, fine = fly(module, method="adaptive"), fly(module, method="adaptive", rate=2000.0)
    spread = np.ptp(fine.commanded, axis=0).max()
    for name, expected in extremes_of(fine, coarse).items():
        assert np.abs(getattr(coarse, name) - expected).max() < 0.02 * spread
    assert np.all(coarse.commanded_least <= coarse.commanded)
    assert np.all(coarse.applied_greatest >= coarse.applied)


def test_a_stretch_belongs_to_the_sample_after_it() -> None:
    values = np.array([[[[5.0], [6.0]], [[1.0], [9.0]]], [[[0.0], [1.0]], [[2.0], [2.0]]]])
    ranges = InputRanges(np.array([0.5, 2.5]), values)
    commanded, applied = np.array([[4.0], [7.0]]), np.array([[3.0], [4.0]])
    found = ranges.up_to_samples(np.array([0.0, 1.0]), commanded, applied)
    assert found[..., 0].tolist() == [[[4, 4], [4, 7]], [[3, 1], [3, 9]]]
    # Without anything between, samples are all there is.
    empty = InputRanges(ranges.time[:0], ranges.values[:0])
    found = empty.up_to_samples(np.array([0.0, 1.0]), commanded, applied)
    assert found[..., 0].tolist() == [[[4, 4], [4, 7]], [[3, 3], [3, 4]]]
