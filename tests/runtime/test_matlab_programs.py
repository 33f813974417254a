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
    absolute,
    arctan2,
    choose,
    clip,
    constant,
    cosine,
    evaluate,
    external,
    jacobian,
    join,
    sine,
    solve,
    square_root,
    total,
    variable,
    write_matlab,
)
from gibbs_codegen.arrays.nodes import copysign, exponential, reshaped, transposed
from gibbs_codegen.flight.integration.closed_loop import loop_program, loop_values
from gibbs_codegen.flight.reference import Reference
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import flight_start
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


@pytest.mark.slow
def test_the_rate_of_a_closed_loop(module: ModuleType, tmp_path: Path) -> None:
    start = flight_start(module, read_scenario("circle"), lambda *_: None, own=False)
    loop = start.loop
    loads = loop.loads(0.0)
    spec = replace(loop_program(loop, loads), shared=False, inputs={})
    owners = {"plant": module, "model": module}

    def desired(at: float) -> np.ndarray:
        return np.concatenate(Reference.__call__(loop.controller.reference, at))

    curves = evaluate(spec.curves, {"time": 0.7}, owners, externals={"desired": desired})
    begin = loop.start(start.q, start.v)
    x = begin + 1e-2 * np.random.default_rng(5).normal(size=begin.shape)
    given = loop_values(loop, 1.0, loads) | {"time": 0.7, "curves": curves["curves"], "x": x}
    check(spec.rate_program, given, owners, tmp_path)


@pytest.fixture(scope="module")
def small() -> ModuleType:
    """A module without a package of MATLAB."""
    return load(ROOT / "generated" / "hexarotor_3link")


@pytest.mark.slow
def test_operations_of_arrays(small: ModuleType, tmp_path: Path) -> None:
    """Of none to three axes: entries row by row, products, parts, sums, functions and choices."""
    a, b, y = variable("a", 3, 4), variable("b", 4, 2, 3), variable("y", 3)
    x, s = variable("x", 4), variable("s")
    inner = Program("inner", (x, s), {"scaled": s * x, "square": x @ x})
    scaled, square = inner(x - 1.0, 2.0 * s)
    outputs = {
        "rows": reshaped(a, (2, 6)),
        "flat": reshaped(b, (24,)),
        "thick": reshaped(a, (2, 3, 2)),
        "one_row": reshaped(x, (1, 4)),
        "one_column": reshaped(x, (4, 1)),
        "turned": transposed(b, (2, 0, 1)),
        "matrix_by_array": a @ b,
        "array_by_vector": b @ y,
        "vector_by_array": x @ b,
        "vector_by_matrix": x @ a.transposed,
        "vector_by_vector": x @ x,
        "summed": total(b, 0, 2),
        "table": constant(np.arange(24.0).reshape(3, 4, 2) - 5.5) * s,
        "shifted": constant(np.eye(3, 4, 1)) + a,
        "diagonal": constant(-0.5 * np.eye(3, 4)) * s,
        "columns": (a + 1.0).transposed[1:3].transposed,
        "turned_pieces": join(a, a[:1] + 1.0).transposed,
        "rows_of_columns": a.transposed[1:3],
        "of_a_sum": (a - s)[1:],
        "entry": (x * s)[2],
        "joined": join(x, s, y[1:]),
        "solved": solve(constant(np.eye(4)) + a.transposed @ a, a.transposed),
        "angles": join(sine(x), cosine(x), arctan2(x, 2.0), exponential(x)),
        "roots": square_root(absolute(x)),
        "within": clip(a, -0.3, 0.2),
        "signs": copysign(x, x - 0.1) - (-x) / (1.5 - (s - 2.0)),
        "chosen": choose(x, 0.0, 1.0 / x, s),
        "inverse": -1.0 / x,
        "scaled": scaled,
        "square": square,
        "again": x,
    }
    rng = np.random.default_rng(4)
    program = Program("several", (a, b, y, x, s), outputs)
    given = {
        name: rng.normal(size=each.shape)
        for name, each in zip(program.names, program.inputs, strict=True)
    }
    check(program, given, {"robot": small}, tmp_path)
    slopes = jacobian(Program("slopes", (x, s), {"chosen": outputs["chosen"]}), ("x", "s"))
    check(slopes, given, {"robot": small}, tmp_path)


@pytest.mark.slow
def test_what_cannot_be_is_said(small: ModuleType, tmp_path: Path) -> None:
    x, robot = variable("x", 2), Functions(small)
    for program, words in (
        (Program("a", (x,), {"y": external("own", (2,), x)}), "a: own is external, and there is"),
        (Program("a", (x,), {"end": x + 1.0}), "a: end is no name of a variable in MATLAB"),
        (Program("a", (x,), {"x": x + 1.0}), "a: x is the name of an input and of an output"),
    ):
        with pytest.raises(UsageError, match=words):
            write_matlab(program, robot, tmp_path)
    with pytest.raises(OutputError, match="cannot be written"):
        write_matlab(Program("a", (x,), {"y": x + 1.0}), robot, tmp_path / "nowhere")
