"""A law of one's own as an array program: compiled for many states, and written for firmware."""

from __future__ import annotations

import ctypes
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT
from support.compiled import LANGUAGES, build, compile_only
from support.pages import run_python
from support.tools import tool

from gibbs_codegen import OutputError, UsageError, compile_program, load
from gibbs_codegen.arrays import (
    Functions,
    Node,
    Program,
    evaluate,
    external,
    sine,
    solve,
    square_root,
    total,
    variable,
    write_c,
)

FOLDER = ROOT / "generated" / "hexarotor_3link"
NAME = "hexarotor_3link"
GAINS = {"stiffness": 25.0, "most": 3.0}


@pytest.fixture(scope="module")
def module() -> ModuleType:
    tool("cc")
    return load(FOLDER, backend="c")


@pytest.fixture(scope="module")
def law(module: ModuleType) -> Program:
    """Inputs, and how far the robot is off, which is a number of each state."""
    robot = Functions(module)
    q, v = robot.state()
    wanted, weight = robot.coordinates("wanted"), variable("weight")
    stiffness, most = (variable(name, uniform=True) for name in GAINS)
    error = robot.difference(q, wanted)
    pull = stiffness * error + weight * sine(error)
    pull = pull / square_root(1.0 + pull * pull / (most * most))
    b = robot.input_matrix(q)
    u = solve(b.transposed @ b, b.transposed @ robot.inverse_dynamics(q, v, pull))
    outputs = {"u": u, "off": total(error * error), "bound": most * most}
    return Program("soft", (q, v, wanted, weight, stiffness, most), outputs)


def states(law: Program, *batch: int) -> dict[str, np.ndarray]:
    """Random values of the inputs of so many states."""
    rng = np.random.default_rng(3)
    each = {
        name: rng.uniform(-0.4, 0.4, (*batch, *x.shape))
        for name, x in zip(law.names, law.inputs, strict=True)
        if not x.is_uniform
    }
    return each | {name: np.array(value) for name, value in GAINS.items()}


@pytest.mark.parametrize("single", [False, True])
@pytest.mark.parametrize("batch", [(), (1,), (8,), (3, 7)])
def test_any_number_of_states_has_the_numbers_of_numpy(
    single: bool, batch: tuple[int, ...], module: ModuleType, law: Program
) -> None:
    given = states(law, *batch)
    given["wanted"] = given["wanted"].reshape(-1, 9)[0]  # The same for all.
    found = compile_program(law, module, single=single)(given)
    right = evaluate(law, given, {"robot": load(FOLDER)})
    for name, values in right.items():
        assert found[name].dtype == (np.float32 if single else np.float64)
        assert found[name].shape == values.shape, name
        tolerance = (1e-4 if single else 1e-12) * max(1.0, np.abs(values).max())
        np.testing.assert_allclose(found[name], values, rtol=0, atol=tolerance)


def test_a_state_is_no_concern_of_the_others(module: ModuleType, law: Program) -> None:
    compiled, given = compile_program(law, module), states(law, 11)
    before = compiled(given)["u"]
    given["v"][4] = np.nan
    after = compiled(given)["u"]
    others = np.arange(11) != 4
    assert after[others].tobytes() == before[others].tobytes()
    assert np.isnan(after[4]).any()


def test_constants_are_those_that_are_given(module: ModuleType, law: Program) -> None:
    given, moon = states(law, 5), {"gravity": 1.62}
    found = compile_program(law, module)(given, {"robot": module.prepare(moon)})["u"]
    numpy = load(FOLDER)
    right = evaluate(law, given, {"robot": numpy}, {"robot": numpy.prepare(moon)})["u"]
    np.testing.assert_allclose(found, right, rtol=0, atol=1e-12 * np.abs(right).max())


@pytest.mark.parametrize("compiler", LANGUAGES)
@pytest.mark.parametrize("single", [False, True])
def test_what_is_written_compiles_silently(
    compiler: str, single: bool, law: Program, module: ModuleType, tmp_path: Path
) -> None:
    _, source = write_c(law, Functions(module), tmp_path)
    options = ["-O0", f"-I{FOLDER}", *([f"-D{NAME.upper()}_FLOAT"] if single else [])]
    compile_only(compiler, options, [str(source)], tmp_path)


@pytest.mark.slow
def test_what_is_written_has_the_numbers_of_numpy(
    law: Program, module: ModuleType, tmp_path: Path
) -> None:
    header, source = write_c(law, Functions(module), tmp_path, "A bounded pull.")
    assert header.name == f"{NAME}_soft.h"
    assert "@brief A bounded pull." in header.read_text(encoding="utf-8")
    sources = [str(source), str(FOLDER / f"{NAME}.c")]
    path = build("gcc", ["-O0", f"-I{FOLDER}", "-shared", "-fPIC"], sources, tmp_path / "law.so")
    library, given = ctypes.CDLL(str(path)), states(law)
    constants = ctypes.addressof(ctypes.c_char.in_dll(library, f"{NAME}_default_constants"))
    found = {name: np.full(x.shape, np.nan) for name, x in law.outputs.items()}
    library[f"{NAME}_soft"](
        ctypes.c_void_p(constants),
        *(
            ctypes.c_void_p(value.ctypes.data) if value.ndim else ctypes.c_double(value)
            for value in (given[name] for name in law.names)
        ),
        *(ctypes.c_void_p(x.ctypes.data) for x in found.values()),
    )
    for name, values in evaluate(law, given, {"robot": load(FOLDER)}).items():
        tolerance = 1e-12 * max(1.0, np.abs(values).max())
        np.testing.assert_allclose(found[name], values, rtol=0, atol=tolerance)


def test_a_program_without_a_robot_needs_no_constants(module: ModuleType, tmp_path: Path) -> None:
    x = variable("x", 3)
    program = Program("square", (x,), {"y": x * x})
    text = write_c(program, Functions(module), tmp_path)[0].read_text(encoding="utf-8")
    assert f"void {NAME}_square(\n    const {NAME}_real *x,\n    {NAME}_real *y);" in text
    y = compile_program(program, module)({"x": np.arange(6.0).reshape(2, 3)})["y"]
    assert y == pytest.approx(np.arange(6.0).reshape(2, 3) ** 2)


def test_products_of_any_axes_and_letters_have_the_numbers_of_numpy(module: ModuleType) -> None:
    """Results of three axes, and inputs with the names that loops have."""
    rng = np.random.default_rng(4)
    a, b = variable("a", 5, 6, 7), variable("b", 7, 8)
    squares = [variable(letter, 6, 6) for letter in "ijklmn"]
    y: Node = squares[0]
    for one, other in pairwise(squares):
        y = y + one @ other
    outputs = {"product": a @ b, "sums": total(y, 0), "y": y}
    program = Program("letters", (a, b, *squares), outputs)
    given = {
        name: rng.normal(size=(3, *x.shape))
        for name, x in zip(program.names, program.inputs, strict=True)
    }
    found = compile_program(program, module)(given)
    for name, values in evaluate(program, given, {}).items():
        np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-12)


def test_what_all_states_share_is_there_without_states(module: ModuleType) -> None:
    shared, own = variable("shared", 3, uniform=True), variable("own", 3)
    program = Program("none", (shared, own), {"y": 2.0 * shared, "z": own + shared})
    found = compile_program(program, module)({"shared": np.ones(3), "own": np.zeros((0, 3))})
    assert found["y"].tolist() == [2.0, 2.0, 2.0]
    assert found["z"].shape == (0, 3)


def test_rows_may_be_larger_than_the_stack(module: ModuleType) -> None:
    """Where they are read and written; what is computed between them may not."""
    x, each = variable("x", 200_000), np.add.outer([0.0, 0.5, 1.0], np.arange(200_000.0))
    found = compile_program(Program("rows", (x,), {"y": 2.0 * x}), module)({"x": each})
    np.testing.assert_array_equal(found["y"], 2.0 * each)
    squares = x * x
    with pytest.raises(UsageError, match=r"wide: .* take 12\.8 MB, more than 4 MB of the stack"):
        compile_program(Program("wide", (x,), {"y": total(squares) * squares}), module)


def test_what_cannot_be_is_said(module: ModuleType, law: Program, tmp_path: Path) -> None:
    x: Node = variable("x", 2)
    by_hand = Program("by_hand", (x,), {"y": external("own", (2,), x)})
    with pytest.raises(UsageError, match="by_hand: own is written by hand and has no C"):
        write_c(by_hand, Functions(module), tmp_path)
    with pytest.raises(UsageError, match="by_hand: own is written by hand and cannot be compiled"):
        compile_program(by_hand, module)
    with pytest.raises(UsageError, match=r'load the module with backend="c"'):
        compile_program(law, load(FOLDER))
    with pytest.raises(OutputError, match="cannot be written"):
        write_c(law, Functions(module), tmp_path / "nowhere")
    for name in ("double", "y-1", "minimum", "Parts"):
        with pytest.raises(UsageError, match=f"cannot use the name '{name}'"):
            compile_program(Program("f", (x,), {name: x + 1.0}), module)
    with pytest.raises(UsageError, match="laws: a module has a file of that name"):
        write_c(Program("laws", (x,), {"y": x + 1.0}), Functions(module), tmp_path)
    inner = [Program("f", (x,), {"y": x * factor}) for factor in (2.0, 3.0)]
    twice = Program("twice", (x,), {"y": inner[0](x)[0] + inner[1](x)[0]})
    with pytest.raises(UsageError, match="two programs are called f"):
        compile_program(twice, module)
    compiled, given = compile_program(law, module), states(law, 3)
    constants = module.prepare({"gravity": np.array([9.8, 1.6, 3.7])})
    for wrong in ({"robot": constants}, {"robot": b"few"}, {"robto": module.prepare({})}):
        with pytest.raises(UsageError, match="constants"):
            compiled(given, wrong)
    with pytest.raises(UsageError, match="soft has no inputs stifness"):
        compiled(given | {"stifness": 1.0})
    with pytest.raises(UsageError, match="soft: no value for v, most"):
        compiled({name: x for name, x in given.items() if name not in ("v", "most")})
    with pytest.raises(UsageError, match=r"v has the shape \(3, 8\), not \(9,\)"):
        compiled(given | {"v": np.zeros((3, 8))})
    with pytest.raises(UsageError, match=r"most has the shape \(3,\).*shared by all states"):
        compiled(given | {"most": np.ones(3)})
    with pytest.raises(UsageError, match="states"):
        compiled(given | {"v": np.zeros((4, 9))})


@pytest.mark.slow
def test_the_page_flies_its_law(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    page = run_python("docs/howto/own-law.md")
    flight, numpy = page["flight"], load(page["folder"])
    assert not flight.stopped
    assert np.abs(flight.q - flight.q_desired)[-1].max() < 0.02
    assert page["source"].is_file()
    given, slopes = page["given"], page["slopes"]
    ahead = [
        evaluate(page["law"], given | {"stiffness": 25.0 + change}, {"robot": numpy})["u"]
        for change in (1e-4, -1e-4)
    ]
    near = (ahead[0] - ahead[1]) / 2e-4
    assert slopes["u_by_stiffness"][..., 0] == pytest.approx(near, abs=1e-6 * np.abs(near).max())
    turned = np.zeros(9)
    turned[4] = 1e-6
    halves = [
        evaluate(
            page["law"], given | {"q": numpy.integrate(given["q"], s * turned)}, {"robot": numpy}
        )
        for s in (1, -1)
    ]
    change = (halves[0]["u"] ** 2 - halves[1]["u"] ** 2).sum(-1) / 4e-6
    found = page["weighted"]["q_bar"][:, 4]
    assert found == pytest.approx(change, abs=1e-5 * np.abs(change).max())
