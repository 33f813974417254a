"""Simulation of generated modules: desired motion, control, integration, results.

Knows generated modules, NumPy and SciPy, and nothing of the derivation. `simulation` is the map.
What writes and draws flights is in `gibbs_codegen.figures`.
"""

from gibbs_codegen.scenario.attitude import SingularAttitudeError
from gibbs_codegen.scenario.control import Control, Motors
from gibbs_codegen.scenario.file import parse_scenario, read_scenario
from gibbs_codegen.scenario.orientation import Level, Tangent, Turn
from gibbs_codegen.scenario.paths import Circle, Fixed, Harmonic, Line, Sum, Term
from gibbs_codegen.scenario.scenario import (
    ArmTask,
    Push,
    Scenario,
    Settings,
    StartOffset,
)
from gibbs_codegen.scenario.waypoints import Waypoints
from gibbs_codegen.simulator.control.inverse_dynamics import (
    inputs_and_constraint_torques,
    required_inputs,
)
from gibbs_codegen.simulator.desired.continuation import UnreachableError
from gibbs_codegen.simulator.desired.trajectory import desired_motion
from gibbs_codegen.simulator.plant.allocation import Allocation, AllocationError
from gibbs_codegen.simulator.plant.vehicle import Vehicle
from gibbs_codegen.simulator.record.flight import Flight, read_flight
from gibbs_codegen.simulator.simulation import simulate

__all__ = [
    "Allocation",
    "AllocationError",
    "ArmTask",
    "Circle",
    "Control",
    "Fixed",
    "Flight",
    "Harmonic",
    "Level",
    "Line",
    "Motors",
    "Push",
    "Scenario",
    "Settings",
    "SingularAttitudeError",
    "StartOffset",
    "Sum",
    "Tangent",
    "Term",
    "Turn",
    "UnreachableError",
    "Vehicle",
    "Waypoints",
    "desired_motion",
    "inputs_and_constraint_torques",
    "parse_scenario",
    "read_flight",
    "read_scenario",
    "required_inputs",
    "simulate",
]
