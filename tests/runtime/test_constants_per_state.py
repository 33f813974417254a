"""Constants that differ from state to state: results are those of one state at a time."""

from __future__ import annotations

import pickle
import shutil
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from support.calls import as_tuple, random_arguments
from support.compiled import ACTUATED, emit, emit_labelled

from gibbs_codegen import load
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import module_signatures
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.runtime import c_backend

ROWS, COLUMNS = 3, 5
STEPS = ("forward_dynamics_parameters_vjp", "step_euler", "step_rk4_derivatives")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A module with a quaternion, and with functions that are composed of others."""
    path = tmp_path_factory.mktemp("each") / "module"
    robot = paper_family(2, 1)
    robot = replace(robot, base=replace(robot.base, attitude="quaternion"))
    emit(robot, path, derivatives=STEPS)
    return path


@pytest.fixture(scope="module")
def module(folder: Path) -> ModuleType:
    return load(folder)


@pytest.fixture(scope="module")
def compiled(folder: Path) -> ModuleType:
    made = load(folder, backend="c", threads=2)
    assert made.backend == "c"
    return made


@pytest.fixture(scope="module", params=["numpy", "c"])
def either(request: pytest.FixtureRequest, folder: Path) -> ModuleType:
    return request.getfixturevalue("module" if request.param == "numpy" else "compiled")


def parameters(module: ModuleType) -> dict[str, np.ndarray | float]:
    """Values that vary along one axis or the other, along both, or not at all."""
    rng = np.random.default_rng(3)
    shapes = [(COLUMNS,), (ROWS, 1), (ROWS, COLUMNS), ()]
    return {
        name: value * rng.uniform(0.8, 1.2, shapes[i % 4])
        for i, (name, value) in enumerate(module.PARAMETERS.items())
    }


def of_state(values: dict[str, np.ndarray | float], *place: int) -> dict[str, float]:
    return {
        name: float(np.broadcast_to(value, (ROWS, COLUMNS))[place])
        for name, value in values.items()
    }


def assert_as_one_at_a_time(numpy: ModuleType, ours: ModuleType) -> None:
    """Every function, with states that vary along the second axis, against NumPy's of one state."""
    values = parameters(numpy)
    constants = ours.prepare(values)
    singles = {
        place: numpy.prepare(of_state(values, *place)) for place in np.ndindex(ROWS, COLUMNS)
    }
    for signature in module_signatures(numpy):
        given = random_arguments(numpy, signature, COLUMNS)
        # Some arguments are the same for all states, too.
        given = [a[0] if i % 2 else a for i, a in enumerate(given)]
        found = as_tuple(getattr(ours, signature.name)(*given, constants=constants))
        for output, shape in zip(found, signature.shapes, strict=True):
            assert output.shape == (ROWS, COLUMNS, *shape), signature.name
        for (i, j), single in singles.items():
            one = [a if k % 2 else a[j] for k, a in enumerate(given)]
            expected = as_tuple(getattr(numpy, signature.name)(*one, constants=single))
            for many, right in zip(found, expected, strict=True):
                scale = max(1.0, np.abs(right).max(initial=0.0))
                np.testing.assert_allclose(
                    many[i, j], right, rtol=0, atol=1e-12 * scale, err_msg=signature.name
                )


@pytest.mark.slow
def test_functions_give_what_they_give_for_one_state_at_a_time(
    module: ModuleType, either: ModuleType
) -> None:
    assert_as_one_at_a_time(module, either)


@pytest.mark.slow
def test_actuators_have_numbers_of_each_state(tmp_path: Path) -> None:
    folder = emit_labelled(ACTUATED, tmp_path / "module").folder
    assert_as_one_at_a_time(load(folder), load(folder, backend="c"))


def test_one_set_gives_what_it_gave(module: ModuleType) -> None:
    """Floats, also where values are arrays without an axis."""
    constants = module.prepare({"gravity": np.array(3.7)})
    assert {*map(type, constants)} == {float}
    assert constants == module.prepare({"gravity": 3.7})


def test_constants_have_the_batch_of_all_parameters(either: ModuleType) -> None:
    """Also where functions do not depend on what varies; and they are copies of what was given."""
    gravity, q = np.full(4, 9.81), np.zeros(len(either.COORDINATES))
    q[either.COORDINATES.index("qw")] = 1.0
    constants = either.prepare({"gravity": gravity})
    expected = either.potential_energy(q, constants)
    gravity[:] = np.nan
    np.testing.assert_array_equal(either.potential_energy(q, constants), expected)
    assert either.mass_matrix(q, constants).shape[:-2] == (4,)
    assert either.mass_matrix(q, either.prepare({"gravity": []})).shape[:-2] == (0,)


THOUSAND = np.ones(1000)
WRONG = np.where(np.arange(1000) == 17, np.nan, 1.0)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        (
            {"gravity": WRONG},
            ValueError,
            "gravity: value 17 of 1000 must be a finite number, not nan",
        ),
        (
            {"gravity": [[1.0, 2.0], [3.0, -np.inf]]},
            ValueError,
            "gravity: value [1, 1] of 4 must be a finite number, not -inf",
        ),
        (
            {"gravity": [1.0, None, 2.0]},
            TypeError,
            "gravity must be real numbers: not NoneType (value 1 of 3)",
        ),
        (
            {"gravity": [1.0, "2"]},
            TypeError,
            "gravity must be real numbers: not str (value 1 of 2)",
        ),
        (
            {"base_arm_mass_per_length": 1.0 - np.nan_to_num(WRONG), "gravity": THOUSAND},
            ValueError,
            "state 0 of 1000: these parameters leave an acceleration undetermined",
        ),
        (
            {"base_arm_length": np.nan_to_num(WRONG, nan=1e200), "gravity": 1.0},
            ValueError,
            "state 17 of 1000: these parameters are too large or too small to compute with",
        ),
        (
            {"base_arm_length": np.ones((2, 3)), "gravity": THOUSAND},
            ValueError,
            "values do not broadcast: gravity (1000,), base_arm_length (2, 3)",
        ),
    ],
)
def test_the_one_that_is_wrong_is_named(
    given: dict[str, object], error: type[Exception], message: str, either: ModuleType
) -> None:
    module = either
    massless = {name: 0.0 for name in module.PARAMETERS if "mass" in name or "inertia" in name}
    others = massless if "base_arm_mass_per_length" in given else {}
    with pytest.raises(error) as raised:
        module.prepare({**others, **given})
    assert str(raised.value).startswith(message)
    assert len(str(raised.value)) < 200


def test_constants_that_do_not_fit_the_states_are_named(either: ModuleType) -> None:
    constants = either.prepare({"gravity": [9.81, 3.7, 1.6]})
    q = np.zeros((2, len(either.COORDINATES)))
    with pytest.raises(ValueError, match=r"leading axes do not broadcast: q \(2,\), constants \("):
        either.mass_matrix(q, constants)


def test_a_state_that_is_lost_is_named(either: ModuleType) -> None:
    """The state, where all states have the same arguments and only constants differ."""
    constants = either.prepare({"link1_length": [1.0, 1e60, 1.0]})
    signature = next(s for s in module_signatures(either) if s.name == "inverse_dynamics")
    q, v, a = random_arguments(either, signature)
    with pytest.warns(RuntimeWarning, match=r"in 1 of 3 states, first \[1\]"):
        found = either.inverse_dynamics(q, v, 1e200 * a, constants)
    one = either.prepare({"link1_length": 1.0})
    expected = either.inverse_dynamics(q, v, 1e200 * a, one)
    np.testing.assert_allclose(found[[0, 2]], [expected, expected], rtol=1e-13)


def test_compiled_constants_are_those_of_one_at_a_time(compiled: ModuleType) -> None:
    """Bit for bit, and so are those that a process was sent."""
    values = parameters(compiled)
    constants = pickle.loads(pickle.dumps(compiled.prepare(values)))  # noqa: S301
    assert constants.shape[:-1] == (ROWS, COLUMNS)
    for place in np.ndindex(ROWS, COLUMNS):
        assert constants[place].tobytes() == compiled.prepare(of_state(values, *place))
    q = np.zeros(len(compiled.COORDINATES))
    for wrong in (constants[0, 0], constants[..., 1:], constants.astype(np.float32), [constants]):
        with pytest.raises(TypeError, match=r"what this module's prepare\(\) returned"):
            compiled.mass_matrix(q, wrong)


def test_threads_share_the_states(compiled: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks that are not full at the end of either share."""
    monkeypatch.setattr(c_backend, "_MIN_ROWS", 10)
    rng = np.random.default_rng(5)
    signature = next(s for s in module_signatures(compiled) if s.name == "forward_dynamics")
    given = random_arguments(compiled, signature, 43)
    constants = compiled.prepare({"link1_length": rng.uniform(0.5, 1.5, 43)})
    found = compiled.forward_dynamics(*given, constants)
    for i in range(43):
        one = compiled.forward_dynamics(*(a[i : i + 1] for a in given), constants[i : i + 1])
        np.testing.assert_array_equal(found[i], one[0])


def test_a_module_of_an_earlier_version_is_to_be_generated_again(
    folder: Path, tmp_path: Path
) -> None:
    """It still computes with one set of constants."""
    older = tmp_path / folder.name
    shutil.copytree(folder, older)
    next(older.glob("*_each.c")).unlink()
    module = load(older, backend="c")
    q, constants = np.zeros(len(module.COORDINATES)), module.prepare({"gravity": [9.81, 3.7]})
    module.mass_matrix(q, module.prepare({"gravity": 3.7}))
    with pytest.raises(UsageError, match=r"has no \w+_each.c; generate the module again"):
        module.mass_matrix(q, constants)
