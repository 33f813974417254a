"""The MATLAB package in Octave: NumPy's numbers, help, and errors in words."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from support.actuated import DERIVATIVES as OWN_LISTS
from support.actuated import actuated
from support.derived import derived
from support.kept import kept_folder, made_once
from support.octave import octave, octave_arrays
from support.random_robots import random_tree, rigid_body

from gibbs_codegen import pipeline
from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.module_writer import differing_files, write_module
from gibbs_codegen.files.templating import render
from gibbs_codegen.interface import (
    ARGUMENTS,
    FUNCTIONS,
    Signature,
    module_signatures,
)
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.file import read_robot, shipped_robots
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.base import Base
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.runtime.load import load
from gibbs_codegen.targets.matlab.statements import TAKEN, check_names, variable
from gibbs_codegen.targets.matlab.target import LISTS, list_texts
from gibbs_codegen.targets.printers import Context
from gibbs_codegen.targets.registry import find_targets, render_module

COUNT = 3
TARGETS = ("numpy", "matlab")
SMALL = "hexarotor_3link"
# Lines in which a function names its own variables.
OWN = re.compile(r"^function .*|^ +.*?(?= =)|for \w+|@\(.*?\)", re.MULTILINE)


@dataclass(frozen=True)
class Packaged:
    """A module of NumPy with its package of MATLAB."""

    folder: Path
    module: ModuleType

    @property
    def name(self) -> str:
        """The robot's name, which is the package's."""
        return str(self.module.NAME)


def ball() -> Robot:
    """One body that flies: without rotors, joints and frames, and with a quaternion."""
    body = replace(rigid_body(np.random.default_rng(7)), length=0.0)
    return Robot("ball", Base(attitude="quaternion", origin="base", body=body))


def robots() -> dict[str, tuple[Robot, Any]]:
    """Robots by their names, and the functions that they have besides those by default."""
    of_tree = ("step_rk4_derivatives",)
    of_small = ("step_rk4_derivatives", "step_euler", "regressor", "inverse_dynamics_derivatives")
    tree = replace(random_tree(29, "quaternion"), name="tree")
    every = tuple(row.name for row in FUNCTIONS.values() if row.on_request)
    return {
        "tree": (tree, of_tree),
        SMALL: (read_robot(SMALL)[0], of_small),
        "ball": (ball(), every),
        "actuated": (actuated(), OWN_LISTS),
    }


@pytest.fixture(scope="module")
def packaged() -> Callable[[str], Packaged]:
    """Generate a robot's module for NumPy and MATLAB."""

    @functools.cache
    def made(name: str) -> Packaged:
        robot, functions = robots()[name]
        chosen = ("default", *functions)
        folder = kept_folder(robot, TARGETS, chosen) / name

        def make() -> None:
            text = robot_text(robot)
            pipeline.generate_robot(
                robot, text, folder.parent, TARGETS, verify=False, functions=chosen
            )

        made_once(folder, make)
        return Packaged(folder, load(folder))

    return made


def arguments(module: ModuleType, signature: Signature, count: int) -> dict[str, np.ndarray]:
    """Random states (count, ...), with quaternions of unit length."""
    rng = np.random.default_rng(count)
    given = {}
    for name, shape in zip(signature.arguments, signature.argument_shapes, strict=True):
        values = rng.uniform(-1.0, 1.0, (count, *shape))
        if ARGUMENTS[name].is_coordinates and module.ATTITUDE == "quaternion":
            values[:, 3:7] /= np.linalg.norm(values[:, 3:7], axis=1, keepdims=True)
        given[name] = 0.01 * values if name == "h" else values
    return given


def as_pages(array: np.ndarray) -> np.ndarray:
    """States along the last axis in place of the first."""
    pages = np.moveaxis(array, 0, -1)
    return pages if pages.ndim > 1 else pages[np.newaxis]


def one_axis_of_states(result: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A result for states, or for one without an axis for it; it may be without entries."""
    states = np.shape(result)[: np.ndim(result) - len(shape)]
    return np.reshape(result, (math.prod(states), *shape))


@pytest.mark.slow
def test_numbers_are_those_of_numpy(packaged: Callable[[str], Packaged], tmp_path: Path) -> None:
    """Of every function: for many states, for one, and for many of which one argument has one."""
    made = packaged("actuated")
    module = made.module
    # Also of less than a kilogram in all.
    share = {name: 0.02 if "mass" in name else 1.1 for name in module.PARAMETERS}
    changed = {name: share[name] * value for name, value in module.PARAMETERS.items()}
    constants = module.prepare(changed)
    given: dict[str, Any] = {"changed": {variable(name): v for name, v in changed.items()}}
    lines = [f"addpath('{made.folder}');", f"constants = {made.name}.prepare(changed);"]
    expected: dict[str, np.ndarray] = {}
    for number, signature in enumerate(module_signatures(module)):
        name, outputs = signature.name, FUNCTIONS[signature.name].outputs
        function = getattr(module, name)
        for case, count in (("many", COUNT), ("one", 1), ("mixed", COUNT)):
            values = arguments(module, signature, count)
            if case == "mixed" and values:
                first = signature.arguments[0]
                values[first] = values[first][:1]
            results = function(*values.values(), constants=constants)
            results = results if isinstance(results, tuple) else (results,)
            key = f"{name[:12]}_{number}_{case}"  # Octave cuts longer names when it saves them.
            given |= {f"{key}_{argument}": as_pages(array) for argument, array in values.items()}
            passed = ", ".join([*(f"{key}_{argument}" for argument in values), "constants"])
            found = [f"{key}_{output.name}_" for output in outputs]
            lines.append(f"[{', '.join(found)}] = {made.name}.{name}({passed});")
            shapes = zip(found, results, signature.shapes, strict=True)
            expected |= {
                variable: as_pages(one_axis_of_states(result, shape))
                for variable, result, shape in shapes
            }
    for (key, right), array in zip(
        expected.items(), octave_arrays(tmp_path, given, lines, [*expected]), strict=True
    ):
        left = array.reshape(right.shape)
        np.testing.assert_allclose(
            left, right, rtol=1e-13, atol=1e-13 * np.abs(right).max(initial=0.0), err_msg=key
        )


def every_list() -> dict[Robot, dict[str, Context]]:
    """The lists of robots, with those that a function on request brings."""
    listed = [read_robot(name)[0] for name in shipped_robots()] + [ball()]
    return {robot: list_texts(Description(robot), ("regressor",), ["header"]) for robot in listed}


def test_lines_of_lists_break_between_entries() -> None:
    for texts in every_list().values():
        for line in (line for text in texts.values() for line in (*text["names"], *text["units"])):
            assert re.fullmatch(r"('[^']+'; )*'[^']+';?", line)


def test_every_list_has_its_names_and_the_units_that_its_kind_has(tmp_path: Path) -> None:
    wanted: dict[str, tuple[str, ...]] = {}
    lines = []
    for robot, texts in every_list().items():
        package = tmp_path / f"+{robot.name}"
        package.mkdir()
        for constant, names in Description(robot).lists(("regressor",)).items():
            name = LISTS[constant][0]
            (package / f"{name}.m").write_text(render("matlab_list.m.jinja", texts[name]))
            key = f"{robot.name}_{name}"
            wanted[key] = names
            call = f"{robot.name}.{name}();"
            if constant in ("POINTS", "FRAMES", "BODIES", "CONSTRAINTS"):
                lines.append(f"{key} = {call}")
            else:
                lines += [f"[{key}, units] = {call}", f"assert(size(units), size({key}))"]
    for (key, names), cells in zip(
        wanted.items(), octave_arrays(tmp_path, {}, lines, [*wanted]), strict=True
    ):
        assert tuple(str(cell[0]) for cell in cells.ravel()) == names, key


@pytest.mark.slow
def test_default_parameters_lists_and_patterns(
    packaged: Callable[[str], Packaged], tmp_path: Path
) -> None:
    made = packaged(SMALL)
    module, name = made.module, made.name
    lines = [
        f"addpath('{made.folder}');",
        f"constants = {name}.prepare();",
        "[q_names, q_units] = hexarotor_3link.coordinate_names();",
        "input_names = hexarotor_3link.input_names();",
        "[values, units] = hexarotor_3link.parameters();",
        "found = hexarotor_3link.patterns();",
        "[M, R] = hexarotor_3link.mass_matrix_and_residual(q, 2 * q);",
    ]
    wanted = ["constants", "q_names", "q_units", "input_names", "values", "units", "found", "M"]
    q = np.linspace(-0.5, 0.5, 9)
    got = dict(zip(wanted, octave_arrays(tmp_path, {"q": q[:, None]}, lines, wanted), strict=True))
    constants = module.prepare({})
    np.testing.assert_allclose(got["constants"].ravel(), constants, rtol=1e-14)

    def texts(cells: np.ndarray) -> tuple[str, ...]:
        return tuple(str(cell[0]) for cell in cells.ravel())

    assert texts(got["q_names"]) == module.COORDINATES
    assert texts(got["q_units"]) == module.COORDINATE_UNITS
    assert texts(got["input_names"]) == module.INPUTS
    values, units = got["values"][0, 0], got["units"][0, 0]
    assert {key: float(values[key][0, 0]) for key in values.dtype.names} == module.PARAMETERS
    assert units["gravity"][0] == "m/s^2"
    np.testing.assert_allclose(got["M"], module.mass_matrix(q), rtol=1e-13, atol=1e-13)
    found = got["found"][0, 0]
    assert set(found.dtype.names) == set(module.PATTERNS)
    for matrix, (rows, columns) in module.PATTERNS.items():
        entries = found[matrix].ravel().astype(int) - 1
        shape = next(
            shape
            for s in module_signatures(module)
            for output, shape in zip(FUNCTIONS[s.name].outputs, s.shapes, strict=True)
            if output.name == matrix
        )
        places = np.unravel_index(entries, shape, order="F")
        flat = np.ravel_multi_index(places, shape)
        np.testing.assert_array_equal(flat // shape[-1], rows)
        np.testing.assert_array_equal(flat % shape[-1], columns)


@pytest.mark.slow
def test_help_and_errors_are_in_words(packaged: Callable[[str], Packaged], tmp_path: Path) -> None:
    made = packaged(SMALL)
    calls = {
        "residual(zeros(7, 1), zeros(9, 1))": "q must be 9 x k for k states, not 7 x 1",
        "mass_matrix(zeros(1, 9))": "q must be 9 x k for k states, not 1 x 9",
        "wrench_forces(zeros(9, 1), zeros(6, 2))": "W must be 2 x 6 x k for k states, not 6 x 2",
        "residual(zeros(9, 2), zeros(9, 3))": "v has 3 states, but arguments before it have 2",
        "mass_matrix({1})": "q must be real numbers",
        "mass_matrix('12345678')": "q must be real numbers",
        "mass_matrix(1i * ones(9, 1))": "q must be real numbers",
        "mass_matrix(zeros(9, 1), 1)": "constants must be",
        "mass_matrix()": "not enough input arguments",
        "prepare(struct('gravty', 1))": "unknown parameter gravty: the function parameters of this",
        "prepare(struct('link1_d', 1))": "link1_d is not a parameter of this module, because",
        "prepare(struct('gravity', 'g'))": "gravity must be one finite real number",
        "prepare(struct('gravity', inf))": "gravity must be one finite real number",
        "prepare(3)": "parameters must be one struct of numbers",
        "prepare(struct('base_arm_length', 1e300))": "these parameters leave an acceleration",
    }
    lines = [f"addpath('{made.folder}');", "help hexarotor_3link.forward_dynamics"]
    for call in calls:
        lines += ["try", f"hexarotor_3link.{call};", "disp('no error')"]
        lines += ["catch reason", "disp(['said: ', reason.message])", "end"]
    said = octave(tmp_path, lines)
    helped, *messages = said.split("said: ")
    for words in (
        "FORWARD_DYNAMICS Accelerations a of M a = R + B u.",
        "acceleration = hexarotor_3link.forward_dynamics(q, v, u, constants)",
        "q  9 x k: coordinates, theta_m1 [rad]",
        "acceleration  9 x k: a_theta_m1 [rad/s^2]",
        "Source: eq. 19",
    ):
        assert words in helped
    assert "Generated by" not in helped
    assert len(messages) == len(calls), said
    for message, words in zip(messages, calls.values(), strict=True):
        assert words in message


@pytest.mark.slow
def test_what_the_page_shows_runs_and_reaches_the_goal(
    packaged: Callable[[str], Packaged], tmp_path: Path
) -> None:
    """The blocks of the page as one script: it ends within a millimetre of where it hovers."""
    made = packaged(SMALL)
    (tmp_path / "generated").symlink_to(made.folder.parent)
    page = (ROOT / "docs" / "howto" / "matlab.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```matlab\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE)
    said = octave(tmp_path, blocks)
    assert "FORWARD_DYNAMICS Accelerations a" in said
    assert "ans = 8.19" in said
    distance = float(said.rpartition("distance = ")[2])
    assert 0.0 < distance < 1e-3


@pytest.mark.slow
def test_source_keeps_to_what_matlab_has_too(packaged: Callable[[str], Packaged]) -> None:
    """No word of Octave alone, no statement over 100 columns, a file for each function."""
    for robot in ("tree", SMALL):
        made = packaged(robot)
        for path in sorted(made.folder.rglob("*.m")):
            text = path.read_text(encoding="utf-8")
            code = re.sub(r"%.*", "", text)
            assert not re.search(r"""[!#"]|\b(end\w+|\*\*|printf|[+*-]=)""", code), path
            body = [line for line in code.splitlines() if line.startswith(" ")]
            assert max(map(len, body)) <= 100, path
            assert not any(line != line.rstrip() for line in text.splitlines())
            assert re.match(rf"function (.* = )?{path.stem}\(.*\)\n%{path.stem.upper()} ", text)
            assert text.endswith("\n")
            code = re.sub(r"'[^'\n]*'", "", code)
            called = {*re.findall(r"(?<![.\w])([a-z]\w*)\(", code)}
            own = {path.stem, *re.findall(r"\w+", " ".join(OWN.findall(code)))}
            assert called - own <= TAKEN, path


@pytest.mark.slow
def test_names_that_matlab_does_not_take() -> None:
    """A name that begins with a digit gets an x; a robot's that hides another is refused."""
    robot = read_robot("quadrotor_2link")[0]
    links = tuple(replace(robot.links[1], name=name) for name in ("1st", "e"))
    given = derived(replace(robot, links=links))
    source = render_module(given, "", find_targets(["matlab"]))["+quadrotor_2link/mass_matrix.m"]
    assert re.search(r"^    x_1st_q = q\(4, :\);$", source, flags=re.MULTILINE)
    assert "e_q = q(5, :);" in source
    assert not re.search(r"(?<!\w)_", re.sub("%.*", "", source))
    for name in ("end", "case", "cos", "reshape", "pi", "u", "residual", "count", "k1", "x"):
        with pytest.raises(UsageError, match=f"--target matlab: the robot's name {name} is"):
            check_names(replace(given, description=Description(replace(robot, name=name))))
    with pytest.raises(UsageError, match=f"{'b' * 64} has 64 characters, more than the 63 "):
        check_names(replace(given, description=Description(replace(robot, name="b" * 64))))
    for names, words in (
        (["a" * 64], r"a{64} has 64 characters, more than the 63 "),
        (["_1st_x", "x_1st_x"], "_1st_x would be x_1st_x, which exists already"),
    ):
        with pytest.raises(UsageError, match=words):
            check_names(replace(given, defaults=dict.fromkeys(names, 1.0)))
    # Entries of arguments of functions that are not there have longer names.
    links = tuple(replace(robot.links[1], name=name * 40) for name in "ab")
    check_names(derived(replace(robot, links=links)))


def test_a_package_is_whole_in_the_module_that_has_it(
    packaged: Callable[[str], Packaged], tmp_path: Path
) -> None:
    """A file that was changed, one too many, and one that a package lost: each is named."""
    robot, text = read_robot("quadrotor")
    model = derived(robot)
    files = render_module(model, text, find_targets(["matlab"]))
    folder = tmp_path / robot.name
    write_module(folder, files)
    package = folder / "+quadrotor"
    assert differing_files(folder, files) == []
    (package / "prepare.m").write_text("", encoding="utf-8")
    (package / "mine.m").write_text("", encoding="utf-8")
    (package / "+internal" / "states.m").unlink()
    (package / "empty").mkdir()
    assert differing_files(folder, files) == [
        "+quadrotor/prepare.m",
        "+quadrotor/+internal/states.m",
        "+quadrotor/empty",
        "+quadrotor/mine.m",
    ]
    with pytest.raises(UsageError, match=r"\+quadrotor/mine\.m"):
        write_module(folder, files)
    (package / "mine.m").unlink()
    (package / "empty").rmdir()
    (package / "prepare.m").unlink()
    write_module(folder, render_module(model, text, find_targets()))
    assert not package.exists()
