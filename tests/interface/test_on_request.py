"""Functions that are generated on request: chosen, emitted, loaded, and missed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from support import on_request
from support.tools import tool

from gibbs_codegen import generate, load
from gibbs_codegen.cli.app import main
from gibbs_codegen.errors import MissingFunctionError, UsageError
from gibbs_codegen.flight.scenario.parts import HOLDING
from gibbs_codegen.interface import FUNCTIONS, default_functions, module_signatures
from gibbs_codegen.program.choice import chosen_derivatives
from gibbs_codegen.runtime.loaded_module import require_functions

ROBOT = "quadrotor_2link"
pytestmark = pytest.mark.usefixtures("derived_once")


@pytest.fixture(scope="module")
def names() -> Iterator[list[str]]:
    with pytest.MonkeyPatch.context() as patch:
        yield on_request.add(patch)


@pytest.fixture(scope="module")
def folder(names: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("on_request") / "generated"
    return generate(ROBOT, out, derivatives=names, verify=False)


@pytest.fixture(scope="module", params=["numpy", "c"])
def module(request: pytest.FixtureRequest, folder: Path):
    if request.param == "c":
        tool("cc")
    return load(folder, request.param)


def test_a_choice_is_names_in_the_order_of_the_table(names: list[str]) -> None:
    every = chosen_derivatives(True)
    assert every[-2:] == (*names,)
    assert [name for name in FUNCTIONS if name in every] == [*every]
    assert chosen_derivatives(False) == ()
    assert chosen_derivatives(names[::-1]) == (*names,)
    assert chosen_derivatives("weight") == ("weight",)
    long = {row.name for row in FUNCTIONS.values() if row.is_long}
    assert {*chosen_derivatives("all")} == {*every} | long
    assert long.isdisjoint(every)


def test_a_name_that_is_none_is_refused_with_those_that_are(names: list[str]) -> None:
    one = r"unknown: '\[7\]', 'wieght' \(did you mean weight\?\); known: .*, all$"
    with pytest.raises(UsageError, match=one):
        chosen_derivatives(["weight", "wieght", "[7]"])
    both = r"'forward_dynamic_jvp' \(did you mean forward_dynamics_jvp\?\), "
    with pytest.raises(UsageError, match=both + r"'streched' \(did you mean stretched\?\)$"):
        chosen_derivatives(["forward_dynamic_jvp", "streched"])
    with pytest.raises(UsageError, match=f"known: .*{', '.join(names)}, all$"):
        chosen_derivatives("")
    for wrong in (3, [["weight"]], [7]):
        with pytest.raises(UsageError, match="derivatives: must be True, False, a name or a list"):
            chosen_derivatives(wrong)  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_module_has_what_was_asked_for_and_no_more(folder: Path, names: list[str]) -> None:
    asked, plain = load(folder), load(generate(ROBOT, folder.parent.parent / "plain", verify=False))
    assert (*names,) == asked.DERIVATIVES
    assert plain.DERIVATIVES == ()
    own = {s.name for s in module_signatures(asked)} - {s.name for s in module_signatures(plain)}
    assert own == {*names}
    assert [*asked.PATTERNS] == ["moved_dv", "moved_dq", "blocks"]
    assert not hasattr(plain, "PATTERNS")


def test_what_is_lacking_is_told_in_few_words_with_what_keeps_the_rest() -> None:
    bare = ModuleType("bare")
    vars(bare).update(dict.fromkeys(default_functions()), NAME="bare", weight=None)
    told = "no constrained_forward_dynamics, impact, constraint_jacobian, 3 more, .* bare "
    told += "--derivatives=weight,base_parameters --functions=default,constraints, or"
    with pytest.raises(MissingFunctionError, match=told):
        require_functions(bare, ["mass_matrix", *HOLDING, "base_parameters"])


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["numpy"])
def test_what_a_module_lacks_is_told_with_the_option_that_adds_it(
    backend: str, folder: Path, names: list[str]
) -> None:
    if backend == "c":
        tool("cc")
    plain = load(generate(ROBOT, folder.parent.parent / "lacking", verify=False), backend)
    assert not hasattr(plain, "weight")
    with pytest.raises(MissingFunctionError, match=f"{ROBOT} --derivatives=weight") as error:
        plain.weight()
    assert isinstance(error.value, UsageError)
    assert 'derivatives=["weight"] in Python' in str(error.value)
    asked = load(folder, backend)
    kept = ",".join([*names, "base_parameters"])
    with pytest.raises(MissingFunctionError, match=f"no BASE_PARAMETERS, .* --derivatives={kept}"):
        _ = asked.BASE_PARAMETERS
    assert not hasattr(plain, "weights")
    with pytest.raises(
        AttributeError, match=f"module '{ROBOT}' has no attribute 'weights'; did .* weight"
    ):
        plain.weights()


def test_scalars_broadcast_with_states(module) -> None:
    rng = np.random.default_rng(0)
    q, v, h = rng.normal(size=(3, 11, 8))
    h = h[:, 0].copy()
    frames = len(module.FRAMES)
    wanted = on_request.expected(v, h, frames)
    for found, right in zip(module.stretched(q, v, h), wanted, strict=True):
        np.testing.assert_array_equal(found, right)
    for one in (float(h[3]), h[3], h[3:4].reshape(())):
        for found, right in zip(module.stretched(q[3], v[3], one), wanted, strict=True):
            np.testing.assert_array_equal(found, right[3])
    alike = on_request.expected(v, np.full(11, 0.5), frames)
    for found, right in zip(module.stretched(q, v, 0.5), alike, strict=True):
        np.testing.assert_array_equal(found, right)
    many = module.stretched(q[0], v[0], h.reshape(11, 1))[0]
    np.testing.assert_array_equal(many, h.reshape(11, 1, 1) * v[0])
    with pytest.raises(TypeError, match="h must be real numbers: not str"):
        module.stretched(q[0], v[0], "1")
    with pytest.warns(RuntimeWarning, match="largest there: h of the step, 1e"):
        module.stretched(q[0], 10.0 * np.ones(8), 1e308)


def test_a_function_may_take_constants_alone(module) -> None:
    np.testing.assert_array_equal(module.weight(), np.full(8, 9.81))
    moon = module.prepare({"gravity": 1.62})
    np.testing.assert_array_equal(module.weight(constants=moon), np.full(8, 1.62))
    worlds = module.weight(constants=module.prepare({"gravity": [9.81, 1.62, 3.71]}))
    np.testing.assert_array_equal(worlds, np.tile([[9.81], [1.62], [3.71]], 8))
    with pytest.raises(TypeError, match=r"^weight\(\) .*argument"):
        module.weight(np.zeros(8), None)


def test_patterns_are_the_entries_that_are_not_zero_column_by_column(module) -> None:
    v = np.random.default_rng(1).normal(size=(5, 8))
    names = [output.name for output in on_request.STRETCHED.outputs]
    found = dict(zip(names, module.stretched(v, v, 0.1), strict=True))
    for name, (rows, columns) in module.PATTERNS.items():
        matrices = found[name].reshape(5, -1, found[name].shape[-1])
        places = np.argwhere(matrices.any(axis=0).T)
        assert places.tolist() == [list(place) for place in zip(columns, rows, strict=True)]
        whole = np.zeros_like(matrices)
        whole[(..., *module.PATTERNS[name])] = matrices[(..., *module.PATTERNS[name])]
        np.testing.assert_array_equal(whole, matrices)


def test_derivatives_of_one_name_have_one_shape() -> None:
    """PATTERNS are by name."""
    rows = [row for row in FUNCTIONS.values() if row.derivative_of]
    shapes = {(output.name, output.shape) for row in rows for output in row.outputs}
    assert len(shapes) == len({name for name, _ in shapes})


@pytest.mark.slow
def test_the_command_line_takes_them(
    names: list[str], folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path)
    # A word after the option is no name.
    generate = ["generate", ROBOT, "--out", out]
    first = ["generate", "--no-verify", "--derivatives=weight", ROBOT, "--out", out]
    assert main([*first, "--all-parameters"]) == 0
    assert load(tmp_path / ROBOT).DERIVATIVES == ("weight",)
    header = (tmp_path / ROBOT / f"{ROBOT}.h").read_text("utf-8")
    command = header.partition("SPDX")[0].replace(" */\n/* ", " ")
    assert " --derivatives=weight " in command.partition("From the folder above: ")[2]
    assert main([*generate, "--derivatives=weight", "--check"]) == 0
    # What was chosen before is chosen again, unless something else is.
    assert main([*generate, "--check"]) == 0
    assert main([*generate, "--check", "--derivatives=none"]) == 1
    assert main([*generate, "--check", "--no-all-parameters"]) == 1
    capsys.readouterr()
    assert main([*generate, "--no-verify", "--no-all-parameters"]) == 0
    assert "earlier options: --derivatives=weight\n" in capsys.readouterr().out
    assert main([*generate, "--check"]) == 0
    assert "--all-parameters" not in (tmp_path / ROBOT / "MANIFEST").read_text("utf-8")
    capsys.readouterr()
    assert main(["info", str(folder), "--operations"]) == 0
    assert f"\n{names[0]}  " in capsys.readouterr().out
    assert main(["info", ROBOT, "--derivatives=weight"]) == 0
    said = capsys.readouterr().out
    assert "\nweight  " in said
    assert names[0] not in said
    assert main(["info", ROBOT, "--operations"]) == 0
    assert "\nweight  " not in capsys.readouterr().out
    assert main(["generate", ROBOT, "--derivatives=wieght"]) == 2
    assert "unknown: 'wieght' (did you mean weight?)" in capsys.readouterr().err
