"""One fault of each kind that hides from random states at the default parameters is found."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.degenerate_robots import degenerate_robot
from support.derived import derived
from support.emitted import NUMPY, emitted_module
from support.tools import tool

from gibbs_codegen.errors import WrongModuleError
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.rollouts import MotorModel, Problem, Rollout, numpy_rollout
from gibbs_codegen.targets.registry import render_module
from gibbs_codegen.verification import c_program
from gibbs_codegen.verification.c_program import compare_rollouts, compare_single_precision
from gibbs_codegen.verification.comparison import Comparison
from gibbs_codegen.verification.modules import verify
from gibbs_codegen.verification.parameters import parameter_values, with_values
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.verify import refuse_wrong

# What looks at parameters that are others than the robot file's, for all states or for each.
OF_PARAMETERS = {"constants of each state", "Newton–Euler, other parameters"}


@pytest.fixture
def copied(small: Path, tmp_path: Path) -> Path:
    """A copy of a module."""
    folder = tmp_path / "quadrotor_2link"
    shutil.copytree(small, folder, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def plant(path: Path, old: str, new: str, place: int = 0) -> None:
    """Replace an occurrence of a text in a file, which must be there."""
    parts = path.read_text(encoding="utf-8").split(old)
    assert len(parts) > place + 1
    before, after = old.join(parts[: place + 1]), old.join(parts[place + 1 :])
    path.write_text(before + new + after, encoding="utf-8")


def failing(folder: Path, backend: str = "numpy") -> set[str]:
    """Against what comparisons fail."""
    found = verify(folder, states=3, backends=[backend])
    assert list(found.comparisons) == [backend], found.not_done
    return {c.against for _, c in found.failures}


def all_parameters() -> str:
    """The NumPy source of a robot whose zeros are parameters."""
    model = derived(read_robot("quadrotor_2link")[0], keep_zeros=True)
    return render_module(model, "", NUMPY)["numpy_module.py"]


@pytest.mark.slow
def test_a_sign_of_any_parameter_that_is_zero_is_found() -> None:
    """By the quick check of `generate`, too."""
    robot, source = read_robot("quadrotor_2link")[0], all_parameters()
    refuse_wrong(robot, source)
    zeros = [line for line in source.splitlines() if line.startswith('    "') and ": 0.0," in line]
    assert len(zeros) > 5
    for line in zeros:
        name = line.split('"')[1]
        load = f'{name} = values["{name}"]'
        assert source.count(load) == 1
        with pytest.raises(WrongModuleError):
            refuse_wrong(robot, source.replace(load, f'{name} = -values["{name}"]'))


@pytest.mark.slow
def test_parameters_far_from_their_defaults(copied: Path) -> None:
    load = 'values["gravity"]'
    plant(copied / "numpy_module.py", load, f"max({load}, 5.0)")
    assert {"Newton–Euler, other parameters"} <= failing(copied) <= OF_PARAMETERS


def test_a_parameter_that_is_zero_or_negative_by_itself(copied: Path) -> None:
    name = "base_arm_length"
    for fault in ("({} or 0.5)", "abs({})"):
        source = (copied / "numpy_module.py").read_text(encoding="utf-8")
        load = f'values["{name}"]'
        plant(copied / "numpy_module.py", load, fault.format(load))
        assert failing(copied) == OF_PARAMETERS, fault
        (copied / "numpy_module.py").write_text(source, encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("form", ["math.sin"])
def test_angles_of_any_size(form: str, copied: Path) -> None:
    """Of one state, and of a batch."""
    wrong_where = "abs(x) > 1e5"
    path = copied / "numpy_module.py"
    called = {"math.sin": "_math_sine", "np.sin": "_array_sine"}[form]
    plant(
        path,
        "\ndef prepare(",
        f"\ndef _math_sine(x):\n    return math.sin(x) * (0.5 if {wrong_where} else 1.0)\n\n\n"
        "def _array_sine(x):\n    return np.vectorize(_math_sine)(x)\n\n\ndef prepare(",
    )
    for place in (0, 0) if form == "np.sin" else (0,):
        plant(path, f"(k, {form}, ", f"(k, {called}, ", place)
    found = verify(copied, states=3, seed=2, backends=["numpy"])
    against = {c.against for _, c in found.failures}
    assert "Newton–Euler, any angles" in against


@pytest.mark.slow
def test_one_state_with_constants_of_its_own(copied: Path) -> None:
    plant(copied / "numpy_module.py", "kernel(k, math.sin", "kernel(self._default, math.sin")
    assert failing(copied) == OF_PARAMETERS


def test_a_compiler_that_does_not_work_is_no_fault_of_the_module(
    copied: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = "for last; do :; done; echo x > library.so"
    compiler = tmp_path / "compiler"
    compiler.write_text(f'#!/bin/sh\n[ "$1" = --version ] && exit 0\n{script}\n')
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    found = verify(copied, states=1)
    assert found.passed, found.failures
    assert list(found.comparisons) == ["numpy"]
    assert "back end c" in found.not_done


def test_c_that_does_not_compile_is_a_fault_of_the_module(copied: Path) -> None:
    tool("cc")
    plant(copied / "quadrotor_2link_batch.c", "#define LANES", "#error no\n#define LANES")
    found = verify(copied, states=1, backends=["c"])
    assert [c.what for _, c in found.failures] == ["the module"]


def extreme(count: int) -> Iterator[np.ndarray]:
    """Angles of a robot's extreme states by their kinds."""
    states = States.extreme(Tree(read_robot("quadrotor_2link")[0]), count, 0)
    yield from (states.q[kind::3, :5] for kind in range(3))


def test_extreme_states_are_what_they_are_called() -> None:
    several, far, near = extreme(60)
    distances = np.abs(np.abs(near[:, 1]) - 0.5 * math.pi)
    assert distances.max() < 0.1001
    assert distances.min() < 1e-6
    assert (np.abs(several) > math.pi).mean() > 0.5
    assert np.abs(far).min() > 1e5


@pytest.mark.parametrize("light", [True, False])
def test_what_single_precision_cannot_hold_is_told(light: bool, copied: Path) -> None:
    """Before anything is computed in it: too light, or with too little beside too much."""
    robot = degenerate_robot(3013, 5, 3)
    if light:
        robot = read_robot("quadrotor_2link")[0]
        values = parameter_values(robot)
        masses = {n: 1e-30 * v for n, v in values.items() if "mass" in n or "inertia" in n}
        robot = with_values(robot, masses)
    found, said = compare_single_precision(str(copied), load(copied), robot, 0)
    assert found == []
    words = "out of the range" if light else "rounding hides the inertia"
    assert words in said["Newton–Euler, single precision"]


def with_feelers(mass: float, links: int = 2, rotors: int = 4, chained: bool = False) -> Robot:
    """A base with rotors and a frame, and links of such a mass, which carry nothing."""
    text = """name = "feelers"
[base]
mass = 2
inertia = [0.02, 0.02, 0.03, 0, 0, 0]
[[frame]]
name = "hook"
on = "base"
xyz = [0.05, 0, -0.1]
"""
    places = ([0.2, 0, 0], [0, 0.2, 0], [-0.2, 0, 0], [0, -0.2, 0])
    for place in places[:rotors]:
        text += f"[[rotor]]\nposition = {place}\ndrag = 0.016\n"
    for k in range(links):
        on = f"link{k}" if chained and k else "base"
        own = 1.0 if chained and k == links - 1 else mass
        text += f"""[[link]]
name = "link{k + 1}"
parent = "{on}"
joint = "revolute"
axis = "y"
xyz = [{0.1 * (-1) ** k}, 0, 0]
mass = {own}
length = 0.1
com = [0.05, 0, 0]
inertia = {[1e-3 * own] * 3 + [0] * 3}
"""
    return parse_robot(text)


def test_links_that_carry_nothing_have_no_share_in_the_sizes_of_efforts() -> None:
    """However light they are: the largest effort, in units of its coordinate, is the base's."""
    largest = []
    for mass in (1e-2, 1e-8):
        tree = Tree(with_feelers(mass))
        sizes = Sizes(tree, States.random(tree, 5, 0))
        thrusts = (sizes.inputs / sizes.units[..., None])[..., :4].max(axis=(1, 2))
        largest.append([thrusts, (sizes.free_pushed / sizes.free_units).max(axis=-1)])
    np.testing.assert_allclose(largest[1], largest[0], rtol=0.1)


def rollout_rows(
    robot: Robot, fault: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> tuple[list[Comparison], dict[str, str]]:
    """Rollouts by NumPy in place of those in C, without some of what a problem has."""

    def wrong(problem: Problem) -> Rollout:
        return numpy_rollout(replace(problem, **{k: f(problem) for k, f in fault.items()}))

    monkeypatch.setattr(c_program, "rollouts_in_c", lambda *_: wrong)
    return compare_rollouts(emitted_module(robot), Tree(robot), 0, "single", ())


@pytest.mark.slow
def test_rollouts_that_ignore_wrenches_are_found_beside_light_links(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fault = {"wrenches": lambda problem: None}
    (row,), _ = rollout_rows(with_feelers(1e-6), fault, monkeypatch)
    assert row.error > 3.0 * row.limit


def test_a_lag_of_one_rotor_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def instant(problem: Problem) -> MotorModel | None:
        motors = problem.motors
        return motors and replace(motors, time_constants=0.0 * motors.time_constants)

    (row,), _ = rollout_rows(with_feelers(0.1, 0, 1), {"motors": instant}, monkeypatch)
    assert row.error > 3.0 * row.limit


@pytest.mark.slow
def test_rollouts_of_too_few_digits_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = with_feelers(1e-4, 4, chained=True)
    rows, said = rollout_rows(robot, {}, monkeypatch)
    assert rows == []
    assert "too few digits" in said["rollouts in single precision"]
