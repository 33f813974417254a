"""CUDA as text: what it computes on the CPU, thread by thread, and what NVRTC makes of it.

NVRTC is in the extra `cuda`; where it is not, tests with it are skipped.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable
from dataclasses import astuple, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from support.actuated import DERIVATIVES, actuated
from support.calls import as_tuple, random_arguments
from support.cuda_on_cpu import code_for_cpu, cuda_on_cpu
from support.derived import derived

from benchmarks.cuda_device import Kernels, Resources, machine_code, nvrtc
from gibbs_codegen import robots
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import module_signatures
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.rollouts import (
    DIVERGED,
    REALS,
    RUNNING,
    Feedback,
    Method,
    MotorModel,
    Precision,
    Problem,
    compiled_rollout,
    functions_of,
)
from gibbs_codegen.targets.registry import find_targets, render_module

PAGE = ROOT / "docs" / "howto" / "cuda.md"
STATES, STEPS, DT, EVERY = 5, 12, 0.002, 5
# Of the largest number of a result: of the same in C, and of doubles.
ROOM = {"double": 1e-14, "single": 1e-6}
ROOM_OF_DOUBLES = {"double": 1e-14, "single": 1e-5}
# Angles with sines: of the limits those of the text.
LIMITS = {"double": 1e5, "single": 400.0}
STEP_FUNCTIONS = ("step_euler", "step_rk4", "forward_dynamics_derivatives", "integrate_derivatives")


def written(robot: Robot, folder: Path, derivatives: Any = False) -> Path:
    """A module with its CUDA source."""
    folder.mkdir()
    model = derived(robot, derivatives=derivatives)
    for name, text in render_module(model, "", find_targets(("numpy", "c", "cuda"))).items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(
    scope="module", params=[pytest.param("xyz", marks=pytest.mark.slow), "quaternion", "actuated"]
)
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    robot, derivatives = actuated(), DERIVATIVES
    if request.param != "actuated":
        robot, derivatives = paper_family(3, 1), STEP_FUNCTIONS
        robot = replace(robot, base=replace(robot.base, attitude=request.param))
    return written(robot, tmp_path_factory.mktemp("cuda") / robot.name, derivatives)


@pytest.fixture(scope="module")
def module(folder: Path) -> ModuleType:
    return load(folder, backend="c")


@pytest.fixture(scope="module", params=["double", "single"])
def kernels(request: pytest.FixtureRequest, folder: Path, module: ModuleType) -> Kernels:
    return on_cpu(folder, module, request.param)


def on_cpu(folder: Path, module: ModuleType, precision: Precision) -> Kernels:
    """The kernels as the CPU computes them."""
    gpu = cuda_on_cpu(folder)
    gpu.load(code_for_cpu(folder, single=precision == "single"))
    return Kernels(gpu, module, precision)


def parameters_of(module: ModuleType) -> dict[str, np.ndarray]:
    """Parameters of states, all of them changed."""
    rng = np.random.default_rng(1)
    return {
        name: value * rng.uniform(0.9, 1.1, STATES) for name, value in module.PARAMETERS.items()
    }


def assert_close(found: np.ndarray, expected: np.ndarray, room: float) -> None:
    """Whether differences are small beside the largest number."""
    assert found.shape == expected.shape
    most = room * np.abs(expected).max(initial=1.0)
    assert np.abs(found - expected).max(initial=0.0) <= most


def test_functions_are_those_of_c(module: ModuleType, kernels: Kernels) -> None:
    """With constants of each state, which a kernel makes of parameters."""
    values = parameters_of(module)
    given, room = module.prepare(values), ROOM_OF_DOUBLES[kernels.precision]
    constants, useless = kernels.constants(np.stack([*values.values()], axis=1))
    assert_close(constants, np.asarray(given), room)
    assert not useless.any()
    for signature in module_signatures(module):
        arguments = random_arguments(module, signature, STATES)
        expected = as_tuple(getattr(module, signature.name)(*arguments, constants=given))
        found = kernels.function(signature.name, constants, *arguments)
        for ours, theirs in zip(found, expected, strict=True):
            assert_close(ours, theirs, room)


def test_parameters_of_no_use_are_told(module: ModuleType, kernels: Kernels) -> None:
    values = np.stack([*parameters_of(module).values()], axis=1)
    values[1, 0], values[3] = np.nan, 0.0
    np.testing.assert_array_equal(kernels.constants(values)[1], [0, 1, 0, 1, 0])


def problem_of(module: ModuleType, precision: Precision) -> Problem:
    """Random states and inputs, another input for each state and step."""
    rng, robot = np.random.default_rng(3), functions_of(module)
    q = rng.uniform(-0.5, 0.5, (STATES, len(module.COORDINATES)))
    v = rng.uniform(-0.5, 0.5, (STATES, len(module.VELOCITIES)))
    inputs = rng.uniform(0.0, 0.5, (STATES, STEPS, robot.inputs))
    if robot.driven:
        low, high = np.array(
            [module.COMMAND_LIMITS.get(x, (-1e-4, 1e-4)) for x in module.COMMANDS]
        ).T
        inputs = low + inputs * (high - low)
    x = module.actuator_state_of(0.9 * inputs[:, 0]) if robot.actuator_states else None
    q = module.integrate(q, np.zeros_like(v))
    return Problem(module, None, q, v, inputs, STEPS, DT, every=EVERY, precision=precision, x=x)


def with_all(problem: Problem) -> Problem:
    """The same with a law that leads each state elsewhere in each step, limits and lag."""
    rng, robot = np.random.default_rng(4), functions_of(problem.module)
    count, size = problem.inputs.shape[-1], problem.v.shape[1]
    away = robot.layout.displaced.size + size
    desired = 0.01 * rng.normal(size=(STATES, STEPS, size))
    gain = 1e-3 * rng.normal(size=(count, away))
    lags = rng.uniform(0.01, 0.05, (STATES, robot.rotors)) * (np.arange(robot.rotors) % 2)
    lags *= not robot.driven  # Drives have their own.
    limits = np.full(count, -1e3), np.quantile(problem.inputs, 0.8, axis=(0, 1))
    return replace(
        problem,
        feedback=Feedback(gain, problem.q[:1, None], desired),
        motors=MotorModel(*limits, lags, np.ones((STATES, robot.rotors))),
    )


@pytest.mark.parametrize("method", ["euler", "rk4"])
@pytest.mark.parametrize("changed", [lambda problem: problem, with_all])
def test_rollouts_are_those_of_c(
    module: ModuleType, kernels: Kernels, method: Method, changed: Callable[[Problem], Problem]
) -> None:
    problem = replace(changed(problem_of(module, kernels.precision)), method=method)
    of_each = module.prepare(parameters_of(module))
    for constants in (None, of_each):
        expected = compiled_rollout(replace(problem, constants=constants))
        call = kernels.prepared(replace(problem, constants=constants))
        call.run()
        call.restart()  # To take the same way once more.
        call.run()
        found = call.rollout()
        np.testing.assert_array_equal(found.steps, expected.steps)
        np.testing.assert_array_equal(found.ended, expected.ended)
        for name in ("q", "v", "thrusts", "x"):
            if (theirs := getattr(expected, name)) is not None:
                assert_close(getattr(found, name), theirs, ROOM[kernels.precision])


def test_matrices_too_large_for_arguments_are_behind_pointers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gibbs_codegen.targets.cuda.target._ROOM", 0)
    folder = written(read_robot("cart_pole")[0], tmp_path / "cart_pole")
    module = load(folder, backend="c")
    problem = with_all(problem_of(module, "double"))
    found, expected = on_cpu(folder, module, "double").rollout(problem), compiled_rollout(problem)
    assert_close(found.q, expected.q, ROOM["double"])
    assert_close(found.v, expected.v, ROOM["double"])


def test_a_state_beyond_the_angles_of_sines_ends(module: ModuleType, kernels: Kernels) -> None:
    """Where a joint has turned too often."""
    problem, limit = problem_of(module, kernels.precision), LIMITS[kernels.precision]
    problem.q[1:3, functions_of(module).layout.q.joints.start] = 0.99 * limit, 1.01 * limit
    problem = replace(problem, v=0.0 * problem.v, inputs=0.0 * problem.inputs)
    found = kernels.rollout(problem)
    np.testing.assert_array_equal(found.ended, [RUNNING, RUNNING, DIVERGED, RUNNING, RUNNING])
    np.testing.assert_array_equal(found.q[2], np.tile(found.q[2, :1], (len(found.q[2]), 1)))


def test_what_rollouts_call_must_be_there() -> None:
    model = derived(paper_family(3, 1), functions=["mass_matrix"])
    with pytest.raises(UsageError, match="--target cuda: its rollouts call forward_dynamics"):
        render_module(model, "", find_targets(("cuda",)))


def test_times_are_of_rollouts_that_were_compared(
    folder: Path,
    module: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    from cuda_times import measured

    code = {
        single: (code_for_cpu(folder, single=single), defaultdict(lambda: Resources(0, 0, 0, 0)))
        for single in (False, True)
    }
    monkeypatch.setattr("cuda_times.machine_code", lambda *_, single, flags: code[single])
    monkeypatch.setattr("cuda_times.ROUNDS", 1)
    if functions_of(module).driven:
        with pytest.raises(SystemExit, match="actuated: has actuators"):
            measured(cuda_on_cpu(folder), folder, 4, 2)
        return
    measured(cuda_on_cpu(folder), folder, 4, 2)
    assert capsys.readouterr().out.count("| rk4 | commands | 128 | 0 |") == 2
    monkeypatch.setattr("cuda_times.DT", 1e3)
    for apart, words in ((0.0, "4 states end"), (np.nan, "differs by nan")):
        monkeypatch.setattr("cuda_times.difference", lambda *_, apart=apart: apart)
        with pytest.raises(SystemExit, match=words):
            measured(cuda_on_cpu(folder), folder, 4, 2)


SHIPPED = sorted(file.stem for file in Path(robots.__file__).parent.glob("*.toml"))
SOON = ("quadrotor", "quadrotor_arm_2link")
ROW = r"^\| {} \| (float|double) \| (\d+) \| (\d+) \| (\d+) \| (\d+) \|"


@pytest.mark.parametrize(
    "name",
    [pytest.param(x, marks=() if x in SOON else pytest.mark.slow) for x in SHIPPED],
)
def test_every_robot_compiles_and_takes_no_more_than_the_page_says(
    name: str, tmp_path: Path
) -> None:
    if nvrtc() is None:
        pytest.skip("NVRTC is not installed")
    folder = written(read_robot(name)[0], tmp_path / name)
    page = PAGE.read_text(encoding="utf-8")
    rows = {word: most for word, *most in re.findall(ROW.format(name), page, re.MULTILINE)}
    machine_code(folder, "sm_80", single=False)
    for word in ("float", "double"):
        found = machine_code(folder, "sm_90", single=word == "float")[1]
        taken = astuple(found[f"{name}_rollout_euler_commands"])
        if rows:  # The page has some.
            most = map(int, rows[word])
            assert all(ours <= theirs for ours, theirs in zip(taken, most, strict=True)), taken


# A rail, loops, a tree, many links, a plane, wheels, and an arm on a table.
KINDS = ("cart_pole", "delta_hexarotor", "dual_arm", "octorotor_7link")
KINDS += ("planar_quadrotor_arm", "rover_arm", "ur5e")


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_rollouts_of_every_kind_of_robot_are_those_of_c(name: str, tmp_path: Path) -> None:
    folder = written(read_robot(name)[0], tmp_path / name)
    module = load(folder, backend="c")
    for precision in REALS:
        kernels = on_cpu(folder, module, precision)
        # Light links of some would fly away in larger steps.
        problem = replace(problem_of(module, precision), dt=0.01 * DT)
        for changed in (problem, with_all(problem)):
            expected, found = compiled_rollout(changed), kernels.rollout(changed)
            assert_close(found.q, expected.q, ROOM[precision])
            assert_close(found.v, expected.v, ROOM[precision])
