"""The model predictive controller of the examples, flown by `simulate` as one of a user."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.tools import missing

from examples.task import Circle, circle_task
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.pipeline import generate
from gibbs_codegen.runtime.load import load

try:
    import casadi  # noqa: F401
except ImportError:
    missing("casadi is not installed")

from examples.controller import Controller, fly
from examples.tracking_problem import DERIVATIVES, traced

pytestmark = pytest.mark.usefixtures("derived_once")

STEP = 0.02


def test_the_simulator_flies_the_example(tmp_path: Path) -> None:
    """With fixed steps of the same size, it is the flight of the example's own loop."""
    folder = generate("quadrotor_2link", tmp_path, derivatives=["step_rk4", *DERIVATIVES])
    plant, posture = load(folder), {"theta_6": -1.0}
    circle = Circle(None, posture, 0.05, 4.0, thrust=(-60.0, 60.0), effort=30.0)
    task = circle_task(plant, circle)
    prediction = traced(load(folder, backend="casadi"), task.frame, STEP)
    controller = Controller(prediction, task, STEP, nodes=5)
    wanted = fly(plant, controller, 0.1)
    vehicle = Vehicle(plant)
    centre = task.q[vehicle.layout.q.position] + vehicle.centre_offset(task.q)
    scenario = read_scenario(
        "hover",
        {
            "duration": 0.1,
            "base": {"path": {"position": centre.tolist()}},
            "arm": {"posture_deg": {"theta_6": float(np.degrees(-1.0))}},
            "motors": {"time_constant": 0},
            "integration": {"method": "rk4", "step": 1e-3, "rate": 50},
        },
    )
    flight = simulate(plant, scenario, controller)
    assert (flight.law, flight.control_rate, flight.stopped) == ("own", 50.0, "")
    assert len(controller.solutions) == len(wanted.solutions) == 5
    assert flight.q[0] == pytest.approx(task.q, abs=1e-12)
    assert flight.q[1:] == pytest.approx(wanted.q, abs=1e-9)
    assert flight.commanded[:-1] == pytest.approx(wanted.u, abs=1e-9)
