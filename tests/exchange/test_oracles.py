"""Imported robots have the dynamics that Pinocchio computed from their URDFs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from support.pinocchio_oracle import free_flyer

from gibbs_codegen.exchange.importing import ImportOptions, import_robot
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.parts.base import Attitude
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load

pytestmark = pytest.mark.usefixtures("derived_once")

SOURCES = Path(__file__).parent / "sources"
NAMES = ("hextilt_flying_arm_5", "hydrus", "everything")
# The coordinates that the oracles are given in, by the attitude of the robot file.
COORDINATES: dict[Attitude, str] = {"quaternion": "free_flyer", "xyz": "tait_bryan_xyz"}
BACKENDS: tuple[Literal["numpy", "c"], ...] = ("numpy", "c")


def stored(name: str) -> dict[str, Any]:
    """The oracle of a robot."""
    found: dict[str, Any] = json.loads((SOURCES / f"{name}.json").read_text())
    return found


def states(name: str, attitude: Attitude) -> list[tuple[Any, ...]]:
    """q, v and u of each state of the oracle, with what it found there by name."""
    found = []
    for state in stored(name)["states"]:
        there = {key: np.array(value) for key, value in state[COORDINATES[attitude]].items()}
        found.append((there["q"], there["v"], np.array(state["u"]), there))
    return found


def assert_same(found: Mapping[str, np.ndarray], expected: Mapping[str, np.ndarray]) -> None:
    """Arrays to 1e-12 of the norm of the oracle's."""
    for key, values in found.items():
        error = np.linalg.norm(values - expected[key]) / np.linalg.norm(expected[key])
        assert error < 1e-12, (key, error)


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
    model = free_flyer(robot)
    for q, v, u, state in states(name, "quaternion"):
        found = model.dynamics(q, v, u)
        assert_same(dict(zip(("M", "nle", "B", "a"), found, strict=True)), state)


@pytest.mark.parametrize("name", NAMES)
def test_snapping_changes_next_to_nothing(name: str) -> None:
    exact, _ = import_robot(
        SOURCES / f"{name}.urdf", ImportOptions("xyz", rotors=rotors_file(name), snap=True)
    )
    model = free_flyer(exact)
    for q, v, u, state in states(name, "quaternion"):
        matrix, expected = model.dynamics(q, v, u).mass_matrix, state["M"]
        assert np.linalg.norm(matrix - expected) < 2e-5 * np.linalg.norm(expected)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "attitude"), [("hydrus", "quaternion")])
def test_emitted_functions_are_those_of_the_source(
    name: str, attitude: Attitude, tmp_path: Path
) -> None:
    options = ImportOptions(attitude, rotors=rotors_file(name), snap=False)
    robot, _ = import_robot(SOURCES / f"{name}.urdf", options)
    folder = generate_robot(robot, robot_text(robot), tmp_path, verify=False)[1]
    damping = np.zeros(6 + len(robot.links))
    damping[layout_of(robot).v.joints] = [link.passive.damping for link in robot.links]
    for backend in BACKENDS:
        module = load(folder, backend)
        for q, v, u, state in states(name, attitude):
            matrix, inputs = module.mass_matrix(q), module.input_matrix(q)
            nonlinear = -module.residual(q, v) - damping * v
            accelerations = np.linalg.solve(matrix, inputs @ u - nonlinear)
            assert_same(
                {"M": matrix, "nle": nonlinear, "B": inputs, "a": accelerations},
                state,
            )
            damped = module.forward_dynamics(q, v, u)
            balance = matrix @ damped - (inputs @ u - nonlinear - damping * v)
            assert np.linalg.norm(balance) < 1e-12 * np.linalg.norm(nonlinear)
