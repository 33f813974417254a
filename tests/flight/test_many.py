"""Many scenarios at once give what each of them gives by itself."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import fields, replace
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from gibbs_codegen.errors import GibbsCodegenError, ScenarioFileError
from gibbs_codegen.flight import many
from gibbs_codegen.flight.many import simulate_many
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.scenario.parts import Gust, Payload, Push, Settings, StartOffset, Wind
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.runtime.load import load

Load = Callable[[str], ModuleType]

MASS = "link3_mass_per_length"


def _scenario(**changed: object) -> Scenario:
    base = replace(
        read_scenario("circle"), duration=1.0, integration=Settings(method="rk4", step=2e-3)
    )
    return replace(base, **changed)  # type: ignore[arg-type]


def _assert_same(found: Flight | GibbsCodegenError, alone: Flight, tolerance: float = 1e-8) -> None:
    assert isinstance(found, Flight)
    for each in fields(Flight):
        here, there = getattr(found, each.name), getattr(alone, each.name)
        if isinstance(there, np.ndarray):
            np.testing.assert_allclose(
                here, there, rtol=tolerance, atol=tolerance, err_msg=each.name
            )
        else:
            assert here == there, each.name


CASES = {
    "masses": [_scenario(name=f"m{k}", plant={MASS: 0.8 + 0.1 * k}) for k in range(5)],
    "lags and starts": [
        _scenario(
            motors=replace(_scenario().motors, time_constant=0.004 * (k + 1), limits=(-60.0, 60.0)),
            start=StartOffset((0.01 * k, 0.0, 0.02)),
            plant={MASS: 1.1, "gravity": 9.81 - 0.1 * k},
        )
        for k in range(4)
    ],
    "wind and push": [
        _scenario(
            plant={MASS: 1.0 + 0.1 * k},
            wind=Wind({"tip": 0.4}, (1.0, 0.0, 0.0), (Gust((0.0, 2.0, 0.0), 0.5, 0.203),)),
            push=Push((3.0, 0.0, 1.0), 0.2505, 0.7),
        )
        for k in range(3)
    ],
    "payload on other planets": [
        _scenario(plant={"gravity": 9.81 - k}, payloads=(Payload("tip", 0.5, 0.3, 0.8),))
        for k in range(2)
    ],
    "adaptive": [
        _scenario(plant={MASS: 1.0 + 0.1 * k}, integration=Settings(), duration=0.3)
        for k in range(2)
    ],
    "sampled": [
        _scenario(
            plant={MASS: 1.0 + 0.1 * k},
            control=replace(_scenario().control, rate=100.0),
            duration=0.3,
        )
        for k in range(2)
    ],
}


@pytest.mark.parametrize(
    "name", [pytest.param("payload on other planets", marks=pytest.mark.slow), "adaptive"]
)
def test_each_flight_is_that_of_its_scenario(fast: Load, name: str) -> None:
    module, scenarios = fast("hexarotor_3link"), CASES[name]
    # Thin rods magnify what is rounded; so does a difference over 1e-7 s, which makes up for lag.
    tolerance = 1e-6 if name == "lags and starts" else 1e-8
    found = simulate_many(module, scenarios)
    for flight, scenario in zip(found, scenarios, strict=True):
        _assert_same(flight, simulate(module, scenario), tolerance)


@pytest.mark.slow
def test_one_that_cannot_fly_and_one_that_is_lost_change_no_other(fast: Load) -> None:
    module = fast("hexarotor_3link")
    weak = replace(_scenario().motors, limits=(-30.0, 30.0))
    factors = (1.0, -1e3, 4.0, 1.1)
    scenarios = [_scenario(plant={MASS: factor}, motors=weak) for factor in factors]
    found = simulate_many(module, scenarios)
    assert isinstance(found[1], GibbsCodegenError)
    with pytest.raises(type(found[1])) as refused:
        simulate(module, scenarios[1])
    assert str(refused.value) == str(found[1])
    for place in (0, 2, 3):
        _assert_same(found[place], simulate(module, scenarios[place]))


@pytest.mark.slow
def test_different_motions_are_kept_apart(fast: Load) -> None:
    module = fast("hexarotor_3link")
    line = replace(read_scenario("line"), duration=1.0, integration=Settings("rk4", step=2e-3))
    scenarios = [_scenario(plant={MASS: 1.1}), line, _scenario(plant={MASS: 0.9})]
    for flight, scenario in zip(simulate_many(module, scenarios), scenarios, strict=True):
        _assert_same(flight, simulate(module, scenario))


def test_faults_are_found_before_anything_compiles(
    shipped: Callable[[str], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a path: one that NumPy refuses needs no C, and a file that is wrong no module."""

    def in_numpy(path: Any, backend: str = "numpy") -> ModuleType:
        assert backend == "numpy"
        return load(path)

    folder = shipped("hexarotor_3link").__path__[0]
    monkeypatch.setattr(many, "load", in_numpy)
    payload = replace(_scenario(), payloads=(Payload("tipp", 0.1),))
    (found,) = simulate_many(folder, [payload])
    assert "has no frame tipp; did you mean tip?" in str(found)
    with pytest.raises(ScenarioFileError, match="duration: must be from"):
        simulate_many("no_such_module", ["hover", {"duration": -1}])


def test_flights_can_be_sent_to_another_process(fast: Load) -> None:
    module = fast("hexarotor_3link")
    (flight,) = simulate_many(module, [_scenario(duration=0.1)])
    assert isinstance(flight, Flight)
    copied = pickle.loads(pickle.dumps(flight))  # noqa: S301
    np.testing.assert_array_equal(copied.q, flight.q)
