"""Flights of generated modules: from a module and a scenario to time series, pictures and tables.

`simulation` is the map of this wing of the package: it knows generated modules, NumPy and SciPy,
and nothing of the derivation. What takes time to import is imported when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_LAZY = {
    "Allocation": "plant.allocation",
    "AllocationError": "plant.allocation",
    "ArmTask": "scenario.scenario",
    "Circle": "scenario.paths",
    "Control": "scenario.parts",
    "Fixed": "scenario.paths",
    "Flight": "record.flight",
    "Harmonic": "scenario.paths",
    "Level": "scenario.orientation",
    "Line": "scenario.paths",
    "Motors": "scenario.parts",
    "Push": "scenario.parts",
    "Scenario": "scenario.scenario",
    "Settings": "scenario.parts",
    "SingularAttitudeError": "attitude",
    "StartOffset": "scenario.parts",
    "Sum": "scenario.paths",
    "Tangent": "scenario.orientation",
    "Term": "scenario.paths",
    "Turn": "scenario.orientation",
    "UnreachableError": "desired.inverse_kinematics",
    "Vehicle": "plant.vehicle",
    "Waypoints": "scenario.paths",
    "desired_motion": "desired.trajectory",
    "inputs_and_constraint_torques": "control.laws",
    "parse_scenario": "scenario.file",
    "read_flight": "record.flight",
    "read_scenario": "scenario.file",
    "required_inputs": "control.laws",
    "simulate": "simulation",
}

__all__ = [*_LAZY]


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
