"""Functions in C for states that have constants each, against the functions for one state."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.compiled import SMALL, Array, Emitted, Library

from gibbs_codegen.interface import module_signatures

# No multiple of the states in a block, of floats and of doubles.
STATES = 37
UNUSED = np.array(np.nan)
# The largest deviation from the function for one state, relative to the output's norm, beside which
# compilers contract and reorder operations.
NEAR = {np.float64: 1e-12, np.float32: 1e-4}


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
            scale = np.linalg.norm(expected.reshape(count, -1), axis=1).max() or 1.0
            gap = np.abs(output - expected).max()
            assert gap <= NEAR[library.real] * scale, (signature.name, gap, scale)


@pytest.mark.parametrize(
    ("compiler", "real", "options"),
    [
        ("gcc", np.float64, ["-O3", "-march=native"]),
        ("clang", np.float32, ["-O2", "-march=native"]),
        pytest.param("clang++", np.float64, ["-O2"], marks=pytest.mark.slow),
        pytest.param("g++", np.float32, ["-O2", "-fopenmp"], marks=pytest.mark.slow),
    ],
)
def test_functions_of_the_small_robot(
    compiler: str,
    real: type[np.floating],
    options: list[str],
    emitted: Callable[[str], Emitted],
    tmp_path: Path,
) -> None:
    small = emitted(SMALL)
    options = [*options, *([small.single] if real is np.float32 else [])]
    compare(Library(small, tmp_path / "small.so", compiler, options, real, each=True), small)
