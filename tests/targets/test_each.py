"""Functions in C for states that have constants each, against the functions for one state."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.compiled import (
    ACTUATED,
    LANES,
    SMALL,
    Array,
    Emitted,
    Library,
    compile_only,
    emit,
)
from support.tools import run, tool

from gibbs_codegen.interface import module_signatures
from gibbs_codegen.robot.family import paper_family

# No multiple of the states in a block, of floats and of doubles.
STATES = 37
UNUSED = np.array(np.nan)
# The largest deviation from the function for one state, relative to the output's norm, beside which
# compilers contract and reorder operations.
NEAR = {np.float64: 1e-12, np.float32: 1e-4}


@pytest.fixture(scope="module")
def double(
    emitted: Callable[[str], Emitted], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Emitted, Library]:
    """The small robot in double precision."""
    small, folder = emitted(SMALL), tmp_path_factory.mktemp("each")
    return small, Library(small, folder / "small.so", "gcc", ["-O0"], each=True)


def parameters(emitted: Emitted, count: int, real: type[np.floating]) -> Array:
    """Of each state: those of the robot file, each of them up to a fifth more or less."""
    rng = np.random.default_rng(7)
    own = np.array([*emitted.model.defaults.values()])
    return (own * rng.uniform(0.8, 1.2, (count, len(own)))).astype(real)


def arguments(emitted: Emitted, widths: dict[str, int], count: int) -> dict[str, Array]:
    """Random values of all arguments that functions have, by their names."""
    rng = np.random.default_rng(8)
    values = {name: rng.uniform(-0.9, 0.9, (count, width)) for name, width in widths.items()}
    if "h" in values:
        values["h"] = rng.uniform(0.001, 0.01, (count, 1))
    if "quaternion" in emitted.model.robot.base.attitude:
        for name in {"q", "q0", "q1"} & {*values}:
            values[name][:, 3:7] /= np.linalg.norm(values[name][:, 3:7], axis=1)[:, None]
    return values


def compare(library: Library, emitted: Emitted, count: int = STATES) -> None:
    """Compare every function with the function for one state, state by state."""
    given = parameters(emitted, count, library.real)
    returned, constants = library.init_batch(given, UNUSED)
    assert returned == 0
    for i in range(count):
        refused, of_state = library.init(given[i])
        assert not refused
        np.testing.assert_allclose(constants[i], of_state, rtol=NEAR[library.real] / 10)
    signatures = module_signatures(emitted.module)
    widths = {
        name: width
        for signature in signatures
        for name, width in zip(signature.arguments, signature.widths, strict=True)
    }
    values = arguments(emitted, widths, count)
    for signature in signatures:
        rows = [values[name] for name in signature.arguments]
        theirs = library.one(signature, rows, constants)
        ours = library.batch(signature, rows, UNUSED, constants)
        for output, expected in zip(ours, theirs, strict=True):
            scale = np.linalg.norm(expected.reshape(count, -1), axis=1).max(initial=0.0) or 1.0
            gap = np.abs(output - expected).max(initial=0.0)
            assert gap <= NEAR[library.real] * scale, (signature.name, gap, scale)


@pytest.mark.slow
def test_functions_of_the_small_robot(double: tuple[Emitted, Library]) -> None:
    compare(double[1], double[0])


@pytest.mark.slow
def test_functions_of_actuators_in_single_precision(
    emitted: Callable[[str], Emitted], tmp_path: Path
) -> None:
    robot = emitted(ACTUATED)
    path, options = tmp_path / "robot.so", ["-O0", robot.single]
    compare(Library(robot, path, "gcc", options, np.float32, each=True), robot)


@pytest.mark.slow
def test_a_build_that_chooses_among_processors(
    emitted: Callable[[str], Emitted], tmp_path: Path
) -> None:
    """By gcc; where it has no effect, it is silent."""
    small = emitted(SMALL)
    option = f"-D{SMALL.upper()}_DISPATCH"
    library = tmp_path / "small.so"
    compare(Library(small, library, "gcc", ["-O0", option], each=True), small)
    assert re.search(r"forward_dynamics_block\.arch_x86_64_v4", run([tool("nm"), library]))
    compile_only("clang", [option, "-fsyntax-only"], small.functions, tmp_path)


@pytest.mark.slow
def test_derivatives_and_time_steps(tmp_path: Path) -> None:
    robot = paper_family(2, 1)
    robot = replace(robot, base=replace(robot.base, attitude="quaternion"))
    own = emit(robot, tmp_path / "module", derivatives=["step_rk4_derivatives"])
    options = ["-O0", own.single]
    compare(Library(own, tmp_path / "own.so", "gcc", options, np.float32, each=True), own)


@pytest.mark.parametrize("count", [pytest.param(1, marks=pytest.mark.slow), 7, 8, 9])
def test_the_first_state_whose_constants_are_of_no_use_is_told(
    count: int, double: tuple[Emitted, Library]
) -> None:
    small, library = double
    given = parameters(small, count, np.float64)
    assert library.init_batch(given, UNUSED)[0] == 0
    for place, wrong in itertools.product({0, count // 2, count - 1}, (np.nan, np.inf)):
        spoilt = given.copy()
        spoilt[place:, -1] = wrong
        returned, constants = library.init_batch(spoilt, UNUSED)
        assert returned == place + 1
        # The others are what they would be without it.
        assert (constants[:place] == library.init_batch(given, UNUSED)[1][:place]).all()


def test_a_state_without_mass_is_told(double: tuple[Emitted, Library]) -> None:
    small, library = double
    given = parameters(small, STATES, np.float64)
    names = [*small.model.defaults]
    given[20, [i for i, name in enumerate(names) if "mass" in name]] = 0.0
    assert library.init(given[20])[0] == 1
    assert library.init_batch(given, UNUSED)[0] == 21


def test_no_states_are_none(double: tuple[Emitted, Library]) -> None:
    small, library = double
    none = np.empty((0, len(small.model.defaults)))
    assert library.call("init_constants_batch", 0, none, none) == 0
    for signature in small.signatures():
        outputs = [np.full(LANES, 7.0) for _ in signature.shapes]
        arrays = [np.empty(0) for _ in signature.arguments]
        library.call(f"{signature.name}_batch_each", np.empty(0), 0, *arrays, *outputs)
        assert all((output == 7.0).all() for output in outputs)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 16])
def test_a_state_has_the_same_results_among_others(
    count: int, double: tuple[Emitted, Library]
) -> None:
    """Whatever lane it is in, and whatever the constants of the others are, to the last bit."""
    small, library = double
    signature = {s.name: s for s in small.signatures()}["forward_dynamics"]
    values = arguments(small, dict(zip("qvu", signature.widths, strict=True)), STATES)
    rows = [values[name] for name in signature.arguments]
    constants = library.init_batch(parameters(small, STATES, np.float64), UNUSED)[1]
    (expected,) = library.batch(signature, rows, UNUSED, constants)
    part = slice(5, 5 + count)
    (found,) = library.batch(signature, [row[part] for row in rows], UNUSED, constants[part])
    assert found.tobytes() == expected[part].tobytes()
