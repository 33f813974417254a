"""Arguments of a module's functions: taken as NumPy takes them, or refused by name; no crash."""

from __future__ import annotations

import os
import secrets
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT
from support.tools import HANGING, tool

from gibbs_codegen import load
from gibbs_codegen.interface import module_signatures
from gibbs_codegen.runtime import c_backend

ROBOT = ROOT / "generated" / "hexarotor_3link"


def fuzz(examples: int) -> None:
    """Random calls in a process of its own, from a seed that a failure names."""
    tool("cc")
    seed = 0 if os.environ.get("CI") else secrets.randbelow(2**31)
    program = ROOT / "tests" / "support" / "argument_fuzz.py"
    done = subprocess.run(
        [sys.executable, str(program), str(ROBOT), str(seed), str(examples)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=HANGING,
    )
    what = f"argument_fuzz.py with seed {seed} and {examples} examples exits {done.returncode}"
    assert done.returncode == 0, f"{what}:\n{done.stderr[-6000:]}"


@pytest.mark.slow
def test_random_calls_give_the_right_result_or_are_refused_by_name() -> None:
    fuzz(100)


@pytest.fixture(scope="module")
def ways() -> list[ModuleType]:
    """NumPy, C, and C as it is where Python's headers are not installed."""
    tool("cc")
    with pytest.MonkeyPatch.context() as patch:
        made = [load(ROBOT), load(ROBOT, backend="c")]
        patch.setattr(c_backend, "caller_type", lambda _: None)
        return [*made, load(ROBOT, backend="c")]


def test_views_of_one_array_may_overlap(ways: list[ModuleType]) -> None:
    rng = np.random.default_rng(4)
    line, table = rng.normal(size=11), rng.normal(size=(7, 9))
    before = line.copy(), table.copy()
    for module in ways:
        for q, v, a in ((line[:9], line[1:10], line[2:]), (table[:5], table[1:6], table[2:])):
            apart = module.inverse_dynamics(q.copy(), v.copy(), a.copy())
            np.testing.assert_array_equal(module.inverse_dynamics(q, v, a), apart)
        np.testing.assert_array_equal(
            module.residual(line[:9], line[:9]), module.residual(line[:9].copy(), line[:9].copy())
        )
    np.testing.assert_array_equal(line, before[0])
    np.testing.assert_array_equal(table, before[1])


def test_not_a_number_in_any_argument_is_one_in_the_result(ways: list[ModuleType]) -> None:
    """For one state and in a batch, where the states beside it keep their numbers."""
    for module in ways:
        for signature in module_signatures(module):
            function = getattr(module, signature.name)
            # With attitude angles the rates of coordinates are the velocities, wherever it is.
            unread = int(signature.name == "coordinate_rates")
            for place in range(unread, len(signature.widths)):
                states = [np.full((3, *shape), 0.5) for shape in signature.argument_shapes]
                states[place][1] = np.nan
                with np.errstate(invalid="ignore"):
                    batch = function(*states)
                    one = function(*(argument[1] for argument in states))
                for many, single in zip(
                    *((r if isinstance(r, tuple) else (r,)) for r in (batch, one)), strict=True
                ):
                    # The mass matrix of the pair is one of q alone.
                    if place == 0 or single.shape != (9, 9):
                        assert np.isnan(single).any()
                        assert np.isnan(many[1]).any()
                    assert np.isfinite(many[[0, 2]]).all()


def test_constants_of_another_robot_are_refused(
    small: Path, ways: list[ModuleType], tmp_path: Path
) -> None:
    other = load(small).prepare({})
    others = [other, np.array(other).tobytes(), np.array(other).tobytes()]
    for module, constants in zip(ways, others, strict=True):
        with pytest.raises(TypeError, match=r"what this module's prepare\(\) returned"):
            module.mass_matrix(np.zeros(9), constants)


@pytest.mark.parametrize(
    ("parameters", "error", "message"),
    [
        ({"gravity": "9.81"}, TypeError, "gravity must be real numbers: not str"),
        ({"gravity": 1j}, TypeError, "gravity must be real numbers: not complex"),
        ({"gravity": 10**400}, ValueError, "gravity must be real numbers: int too large"),
        ({"gravity": [9.81, np.inf]}, ValueError, "gravity: value 1 of 2 must be a finite number"),
        ({"gravity": np.ones((1,) * 32)}, ValueError, "gravity must have at most 31 axes, not 32"),
        ({"gravity": None}, TypeError, "gravity must be real numbers: not NoneType"),
        ({3: 1.0, "x": 1.0}, ValueError, "unknown parameter 3: PARAMETERS has all names; unknown"),
        ({"link2_mas": 1.0}, ValueError, "'link2_mas': did you mean link2_mass_per_length or link"),
        (
            {"link2_d": 1.0},
            ValueError,
            "link2_d is not a parameter of this module, because it is zero in",
        ),
        ({"link2_d": 1.0}, ValueError, "generate the module with --all-parameters to keep it"),
        ({"x" * 9999: 1.0}, ValueError, "x: PARAMETERS has all names"),
        (None, TypeError, "parameters must map names to numbers"),
        ([("gravity", 9.81)], TypeError, "parameters must map names to numbers"),
    ],
)
def test_parameters_that_are_none_are_refused_alike(
    parameters: object, error: type[Exception], message: str, ways: list[ModuleType]
) -> None:
    for module in ways:
        with pytest.raises(error) as raised:
            module.prepare(parameters)
        assert message in str(raised.value)
        assert len(str(raised.value)) < 200


def test_any_number_may_be_a_parameter(ways: list[ModuleType]) -> None:
    numpy, *compiled = ways
    for number in (4, True, np.float32(4.0), np.array(4.0), np.int8(4)):
        assert numpy.prepare({"gravity": number}) == numpy.prepare({"gravity": float(number)})
        for module in compiled:
            expected = module.prepare({"gravity": float(number)})
            assert module.prepare({"gravity": number}) == expected


def test_parameters_are_refused_by_both_back_ends_or_by_none(ways: list[ModuleType]) -> None:
    """Zero, negative, huge and tiny ones, of which many leave no mass or overflow."""
    numpy, compiled, _ = ways
    rng = np.random.default_rng(11)
    values = np.array([0.0, -1.0, 1e-3, 1e3, 1e150, -1e150, 1e300, 1e-300, 5e-324])
    refused = 0
    for _ in range(300):
        changed = rng.random(len(numpy.PARAMETERS)) < rng.random()
        parameters = {
            name: rng.choice(values)
            for name, change in zip(numpy.PARAMETERS, changed, strict=True)
            if change
        }
        verdicts = []
        for module in (numpy, compiled):
            try:
                module.prepare(parameters)
            except ValueError:
                verdicts.append(False)
            else:
                verdicts.append(True)
        assert verdicts[0] == verdicts[1], parameters
        refused += not verdicts[0]
    assert 50 < refused < 250
