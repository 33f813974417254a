"""Imported robots have the dynamics that Pinocchio computed from their URDFs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from support.robot_in_pinocchio import PinocchioRobot

from gibbs_codegen.exchange.importing import ImportOptions, import_robot
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load

SOURCES = Path(__file__).parent / "sources"
NAMES = ("hextilt_flying_arm_5", "hydrus", "everything")


def stored(name: str) -> dict[str, Any]:
    """The oracle of a robot."""
    found: dict[str, Any] = json.loads((SOURCES / f"{name}.json").read_text())
    return found


def rotors_file(name: str) -> Path | None:
    """The file of rotors of a robot whose own file has none."""
    path = SOURCES / f"{name}_rotors.toml"
    return path if path.exists() else None


@pytest.mark.parametrize("name", NAMES)
def test_numbers_are_those_of_the_source(name: str) -> None:
    options = ImportOptions("xyz", rotors=rotors_file(name), snap=False)
    robot, _ = import_robot(SOURCES / f"{name}.urdf", options)
    oracle = stored(name)
    assert [link.name for link in robot.links] == oracle["links"]
    assert [link.coordinate for link in robot.links] == oracle["joints"]
    model = PinocchioRobot(robot)
    for state in oracle["states"]:
        q, v, u = (np.array(state[key]) for key in "qvu")
        found = model.at(q, v, u)
        for key, values in zip(("M", "nle", "B", "a"), found, strict=True):
            expected = np.array(state[key])
            error = np.linalg.norm(values - expected) / np.linalg.norm(expected)
            assert error < 1e-12, (key, error)


@pytest.mark.parametrize("name", NAMES)
def test_snapping_changes_next_to_nothing(name: str) -> None:
    exact, _ = import_robot(
        SOURCES / f"{name}.urdf", ImportOptions("xyz", rotors=rotors_file(name), snap=True)
    )
    model = PinocchioRobot(exact)
    for state in stored(name)["states"]:
        q, v, u = (np.array(state[key]) for key in "qvu")
        matrix, expected = model.at(q, v, u).mass_matrix, np.array(state["M"])
        assert np.linalg.norm(matrix - expected) < 2e-5 * np.linalg.norm(expected)


@pytest.mark.parametrize("backend", ["numpy", pytest.param("c", marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", NAMES)
def test_emitted_functions_are_those_of_the_source(
    name: str, backend: Literal["numpy", "c"], tmp_path: Path
) -> None:
    options = ImportOptions("quaternion", rotors=rotors_file(name), snap=False)
    robot, _ = import_robot(SOURCES / f"{name}.urdf", options)
    folder = generate_robot(robot, robot_text(robot), tmp_path, verify=False)[1]
    module = load(folder, backend)
    damping = np.zeros(6 + len(robot.links))
    damping[6:] = [link.passive.damping for link in robot.links]
    for state in stored(name)["states"]:
        q, v, u = (np.array(state[key]) for key in "qvu")
        matrix, inputs = module.mass_matrix(q), module.input_matrix(q)
        nonlinear = -module.residual(q, v) - damping * v
        accelerations = np.linalg.solve(matrix, inputs @ u - nonlinear)
        found = {"M": matrix, "nle": nonlinear, "B": inputs, "a": accelerations}
        for key, values in found.items():
            expected = np.array(state[key])
            error = np.linalg.norm(values - expected) / np.linalg.norm(expected)
            assert error < 1e-12, (key, error)
        damped = module.forward_dynamics(q, v, u)
        balance = matrix @ damped - (inputs @ u - nonlinear - damping * v)
        assert np.linalg.norm(balance) < 1e-12 * np.linalg.norm(nonlinear)
