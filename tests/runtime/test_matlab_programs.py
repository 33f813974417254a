"""Array programs as functions of MATLAB, in Octave: NumPy's numbers, and refusals in words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from support.kept import kept_folder, made_once
from support.octave import octave_arrays

from gibbs_codegen import OutputError, UsageError
from gibbs_codegen.arrays import (
    Functions,
    Program,
    evaluate,
    external,
    variable,
    write_matlab,
)
from gibbs_codegen.machine.base import Motion
from gibbs_codegen.machine.laws import Aim, Gains, computed_torque
from gibbs_codegen.pipeline import generate_robot
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load

TARGETS = ("numpy", "matlab")


@pytest.fixture(scope="module", params=["zyx", "quaternion"])
def module(request: pytest.FixtureRequest) -> ModuleType:
    """A module for each root, with its package of MATLAB beside it."""
    shipped = read_robot("hexarotor_3link")[0]
    robot = replace(shipped, base=replace(shipped.base, attitude=request.param))
    folder = kept_folder(robot, TARGETS)

    def make() -> None:
        generate_robot(robot, robot_text(robot), folder, TARGETS, verify=False)

    return load(made_once(folder / robot.name, make))


def check(
    program: Program, given: dict[str, Any], modules: dict[str, ModuleType], folder: Path
) -> None:
    """Compare what a program's function in Octave returns with NumPy's numbers."""
    module = next(iter(modules.values()))
    path = write_matlab(program, Functions(module), folder, "What it does.")
    package = Path(str(module.__file__)).parent
    columns = {
        name: np.reshape(given[name], (*x.shape, 1, 1)[: max(2, len(x.shape))])
        for name, x in zip(program.names, program.inputs, strict=True)
    }
    outputs = [f"{name}_found" for name in program.outputs]
    called = f"[{', '.join(outputs)}] = {path.stem}({', '.join(program.names)});"
    lines = [f"addpath('{package}'); addpath('{folder}');", called]
    wanted = evaluate(program, given, modules)
    arrays = octave_arrays(folder, columns, lines, outputs)
    for (name, right), left in zip(wanted.items(), arrays, strict=True):
        # MATLAB drops axes of one entry behind the second.
        size = (*right.shape, 1, 1)[: max(2, right.ndim)]
        assert left.shape == (size[:2] if set(size[2:]) == {1} else size), name
        np.testing.assert_allclose(
            left.reshape(right.shape),
            right,
            rtol=0,
            atol=1e-11 * max(1.0, np.abs(right).max(initial=0.0)),
            err_msg=name,
        )


@pytest.mark.slow
def test_computed_torque(module: ModuleType, tmp_path: Path) -> None:
    robot = Functions(module)
    q, v = robot.state()
    desired = Motion(
        robot.coordinates("q_desired"), robot.velocities("v_desired"), robot.velocities("a_desired")
    )
    gains = Gains(robot.velocities("stiffness"), robot.velocities("damping"))
    force = computed_torque(robot, q, v, Aim(desired, gains))
    inputs = (q, v, desired.q, desired.v, desired.a, gains.stiffness, gains.damping)
    law = Program("law", inputs, {"force": force})
    rng = np.random.default_rng(8)
    given = {
        name: rng.uniform(-1.0, 1.0, x.shape) for name, x in zip(law.names, law.inputs, strict=True)
    }
    if robot.space.has_quaternion:
        for name in ("q", "q_desired"):
            given[name][3:7] /= np.linalg.norm(given[name][3:7])
    check(law, given, {"robot": module}, tmp_path)


@pytest.fixture(scope="module")
def small() -> ModuleType:
    """A module without a package of MATLAB."""
    return load(ROOT / "generated" / "hexarotor_3link")


@pytest.mark.slow
def test_what_cannot_be_is_said(small: ModuleType, tmp_path: Path) -> None:
    x, robot = variable("x", 2), Functions(small)
    for program, words in (
        (
            Program("a", (x,), {"y": external("own", (2,), x)}),
            "a: own is written by hand and has no MATLAB",
        ),
        (Program("a", (x,), {"end": x + 1.0}), "a: MATLAB cannot name a variable end; rename"),
        (Program("a", (x,), {"x": x + 1.0}), "a: an input and an output are both called x"),
    ):
        with pytest.raises(UsageError, match=words):
            write_matlab(program, robot, tmp_path)
    with pytest.raises(OutputError, match="cannot be written"):
        write_matlab(Program("a", (x,), {"y": x + 1.0}), robot, tmp_path / "nowhere")
