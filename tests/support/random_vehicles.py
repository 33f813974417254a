"""Vehicles of random robots, made once per process: all attitude sequences, slides and hinges."""

from __future__ import annotations

import pytest

from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load
from support.random_robots import random_robot

# Seeds whose robots have each attitude sequence but x-y-z, both origins, and arms of three or four
# joints of both kinds: rpr, prr, rrpr, rrpr, pprr.
SEEDS = {"yxz": 10, "zxy": 15, "zyx": 16, "xzy": 21, "yzx": 31}

_made: dict[int, Vehicle] = {}


def random_vehicle(seed: int, factory: pytest.TempPathFactory) -> Vehicle:
    """The vehicle of a seed."""
    if seed not in _made:
        robot = random_robot(seed, 3 + seed % 3, 3 + seed % 5)
        folder = factory.mktemp("random")
        generate_robot(robot, robot_text(robot), folder, targets=("numpy",), verify=False)
        _made[seed] = Vehicle(load(folder / robot.name))
    return _made[seed]
