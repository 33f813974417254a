"""A small robot with its time steps, for tests of rollouts."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import pytest
from support.compiled import Emitted, emit

from gibbs_codegen.robot.family import paper_family

ROTORS = 3


@pytest.fixture(scope="session", params=["xyz", "quaternion"])
def emitted_steps(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Emitted:
    robot = paper_family(ROTORS, 1)
    robot = replace(robot, base=replace(robot.base, attitude=request.param))
    folder = tmp_path_factory.mktemp("rollouts") / robot.name
    return emit(robot, folder, derivatives=["step_euler", "step_rk4"])


@pytest.fixture
def module(emitted_steps: Emitted) -> ModuleType:
    """Its NumPy functions."""
    return emitted_steps.module
