"""The adaptive law in flight: what it does not know it learns, as Lyapunov's function says."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.emitted import module_with_derivatives
from support.machines import machine, rod, table

from gibbs_codegen import parse_robot, read_scenario, simulate
from gibbs_codegen.errors import ScenarioFileError
from gibbs_codegen.flight.integration.integrators import integrate
from gibbs_codegen.flight.simulation import flight_start

ARM = machine(
    "arm_on_a_table",
    table("[base]", motion="fixed"),
    rod("shoulder", "y", [0, 0, 0.1], 0.5, 2),
    rod("elbow", "y", [0.5, 0, 0], 0.4, 1),
)
# The link is heavier than the law knows, and carries what nobody told it.
UNKNOWN: dict[str, Any] = {
    "plant": {"elbow_mass_per_length": 1.4},
    "payload": [{"frame": "tip", "mass": 0.3}],
}
# Steps of which the energy gains nothing.
FINE = {"method": "rk4", "step": 0.01, "rate": 50}
TURNS = {"shoulder": (-40, 10, -60, 0), "elbow": (80, 20, 60, 10)}


@pytest.fixture(scope="module")
def arm() -> ModuleType:
    return module_with_derivatives(parse_robot(ARM), "base_parameters")


def swinging(law: str, duration: float = 8.0, **tables: Any) -> Any:
    """A scenario of an arm that swings."""
    moves = {
        joint: [
            {"to": to, "begin": 2 * k, "duration": 2}
            for k, to in enumerate(turns)
            if 2 * k < duration
        ]
        for joint, turns in TURNS.items()
    }
    control = {"law": law, **tables.pop("control", {})}
    return read_scenario(
        {"name": "swinging", "duration": duration, "arm": {"moves_deg": moves}, "control": control}
        | {"integration": {"method": "rk4", "step": 0.02, "rate": 50}}
        | tables
    )


def test_energy_of_errors_falls(arm: ModuleType) -> None:
    """½ sᵀ M s + ½ εᵀ Γ⁻¹ ε with the mass matrix and the base parameters of the true machine."""
    scenario = swinging("adaptive", 2.0, plant=UNKNOWN["plant"], integration=FINE)
    start = flight_start(arm, scenario, lambda what, share: None, custom_law=False)
    loop, law = start.loop, start.loop.controller
    begin = loop.start(start.q, start.v)
    states = integrate(loop, begin, scenario.duration, scenario.integration)
    parts = loop.parts(states.states)
    wanted_q, wanted_v, _ = law.reference(states.time)
    # d = 2 w and k = w² give λ = w.
    s = wanted_v - parts.v + scenario.control.frequency * (wanted_q - parts.q)
    true = arm.prepare(scenario.plant)
    off = arm.base_parameters(constants=true) - arm.base_parameters() - parts.memory
    gains = law.values["adaptation"]
    energy = 0.5 * np.einsum("ki,kij,kj->k", s, arm.mass_matrix(parts.q, constants=true), s)
    energy += 0.5 * np.sum(off * (off @ np.linalg.pinv(gains)), axis=1)
    assert np.diff(energy).max() < 1e-7 * energy[0]
    assert energy[-1] < 0.8 * energy[0]


@pytest.mark.slow  # 4 s; inline: the energy, above.
def test_errors_fall_where_computed_torque_stays_off(arm: ModuleType) -> None:
    last = {}
    for law in ("computed_torque", "adaptive"):
        flight = simulate(arm, swinging(law, 10.0, **UNKNOWN))
        assert not flight.stopped
        errors = np.abs(flight.q - flight.q_desired).max(axis=1)
        last[law] = errors[flight.time > 9.0].max()
    assert last["adaptive"] < 0.1 * last["computed_torque"]


def test_integral_action_is_refused() -> None:
    with pytest.raises(ScenarioFileError, match="the adaptive law learns parameters"):
        swinging("adaptive", control={"integral": 3.0})
