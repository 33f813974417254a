"""The C back end: the same functions as the NumPy back end, compiled."""

from __future__ import annotations

import copy
import gc
import inspect
import logging
import os
import pickle
import shutil
import signal
import sys
import sysconfig
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT
from support.derived import derived
from support.tools import missing, tool

from gibbs_codegen import load
from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import FUNCTIONS, module_signatures, signatures
from gibbs_codegen.pipeline import generate
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.runtime import c_backend, caller
from gibbs_codegen.runtime.c_library import chosen_compiler, find_compiler

ROBOT = ROOT / "generated" / "hexarotor_3link"
STATES = 10_000


@pytest.fixture(autouse=True, scope="module")
def _compiler(optimized: None) -> None:
    tool("cc")


def compiled_of(numpy: ModuleType) -> ModuleType:
    """The C back end of a module, and not NumPy's in its stead, which would agree with itself."""
    compiled = load(Path(numpy.__file__ or "").parent, backend="c")
    assert (compiled.__file__ or "").endswith(".so")
    return compiled


@pytest.fixture(scope="module")
def backends(shipped: Callable[[str], ModuleType]) -> tuple[ModuleType, ModuleType]:
    """Both back ends of what is emitted now, which what is committed need not be."""
    numpy = shipped("hexarotor_3link")
    return numpy, compiled_of(numpy)


def random_states(module: ModuleType) -> dict[str, np.ndarray]:
    """Random states, among them angles of ±π and 1e4."""
    rng = np.random.default_rng(7)
    size = len(module.COORDINATES)
    q = rng.uniform(-np.pi, np.pi, (STATES, size))
    q[0::10, :-3] = np.pi
    q[1::10, :-3] = -np.pi
    q[2::10, :-3] = rng.uniform(-1e4, 1e4, q[2::10, :-3].shape)
    q[3::10, :-3] = 1e4
    v, a = rng.uniform(-3, 3, (2, STATES, size))
    u = rng.uniform(-20, 20, (STATES, len(module.INPUTS)))
    wrenches = rng.uniform(-20, 20, (STATES, len(module.FRAMES), 6))
    named = {"q": q, "v": v, "a": a, "u": u, "W": wrenches, "q0": q, "q1": q[::-1]}
    return named | {"v_r": v[::-1], "a_r": a[::-1]}


@pytest.fixture(scope="module")
def states(backends: tuple[ModuleType, ModuleType]) -> dict[str, np.ndarray]:
    return random_states(backends[0])


def results(function, arguments) -> list[np.ndarray]:
    returned = function(*arguments)
    return list(returned) if isinstance(returned, tuple) else [returned]


def disagreement(
    name: str, numpy: ModuleType, compiled: ModuleType, states: dict[str, np.ndarray]
) -> float:
    """Largest error of the C function, of the norm of each state's result.

    Accelerations solve a linear system, so they agree to the system's condition number times that
    of a rounding error: the matrices themselves differ in the last bit. A scalar that happens to be
    near zero is compared with its mean square over the states.
    """
    signature = next(s for s in module_signatures(numpy) if s.name == name)
    arguments = [states[argument] for argument in signature.arguments]
    scale = np.ones(STATES)
    if name.startswith("forward_dynamics"):
        scale = np.maximum(1.0, np.linalg.cond(numpy.mass_matrix(states["q"])) / 10)
    worst = 0.0
    expected, found = (results(getattr(m, name), arguments) for m in (numpy, compiled))
    for right, ours in zip(expected, found, strict=True):
        axes = tuple(range(1, right.ndim))
        norm = np.abs(right).max(axis=axes) if axes else np.sqrt(np.mean(right**2))
        error = np.abs(ours - right).max(axis=axes) / norm
        worst = np.maximum(worst, (error / scale).max())
    return float(worst)


@pytest.mark.parametrize(
    "name", [s.name for s in signatures(Description(read_robot("hexarotor_3link")[0]).lists())]
)
def test_both_back_ends_agree(name: str, backends, states: dict[str, np.ndarray]) -> None:
    """To 1e-14 of the norm over ten thousand states."""
    assert disagreement(name, *backends, states) < 1e-14


@pytest.mark.slow
def test_one_state_equals_a_batch(backends, states: dict[str, np.ndarray]) -> None:
    compiled = backends[1]
    for signature in module_signatures(compiled):
        function = getattr(compiled, signature.name)
        arguments = [states[argument][:37] for argument in signature.arguments]
        for batch, *single in zip(
            zip(*results(function, arguments), strict=True), *arguments, strict=True
        ):
            for many, one in zip(batch, results(function, single), strict=True):
                assert one.shape == np.shape(many)
                np.testing.assert_allclose(one, many, rtol=0, atol=1e-12 * np.abs(many).max())


@pytest.mark.slow
def test_interface_is_what_is_emitted() -> None:
    robot, _ = read_robot("quadrotor")
    program = derived(robot).program
    made = signatures(Description(robot).lists())
    found = {s.name: (s.arguments, s.shapes) for s in made}
    assert found == {
        f.name: (f.arguments, tuple(o.shape for o in f.outputs)) for f in program.functions
    }


def test_batches_broadcast(backends, states: dict[str, np.ndarray]) -> None:
    for module in backends:
        matrix, residual = module.mass_matrix_and_residual(states["q"][0], states["v"][:6])
        assert (matrix.shape, residual.shape) == ((6, 9, 9), (6, 9))
        q = np.broadcast_to(states["q"][:2].reshape(2, 1, 9), (2, 3, 9))
        assert module.kinetic_energy(q, states["v"][:3]).shape == (2, 3)
        assert module.mass_matrix(np.zeros((0, 9))).shape == (0, 9, 9)


def test_any_array_is_taken(backends, states: dict[str, np.ndarray]) -> None:
    """Lists, other types, other byte orders, strides, read-only arrays: as NumPy takes them."""
    compiled = backends[1]
    q = np.round(states["q"][5], 3).astype(np.float32).astype(np.float64)
    expected = compiled.mass_matrix(q)
    spread = np.zeros((9, 5))
    spread[:, 2] = q
    frozen = q.copy()
    frozen.flags.writeable = False
    shifted = np.frombuffer(b"\0" + q.tobytes(), np.uint8)[1:].view(np.float64)
    for same in (
        q.tolist(),
        tuple(q),
        q.astype(np.float32),
        q.astype(">f8"),
        spread[:, 2],
        frozen,
        shifted,
        np.asfortranarray(q),
    ):
        np.testing.assert_array_equal(compiled.mass_matrix(same), expected)


def test_not_a_number_in_is_not_a_number_out(backends) -> None:
    compiled = backends[1]
    q = np.full(9, np.nan)
    assert np.isnan(compiled.mass_matrix(q)).any()
    assert np.isnan(compiled.mass_matrix(np.full((3, 9), np.inf))).any()


def test_results_are_arrays_of_their_own(backends) -> None:
    compiled = backends[1]
    first, second = compiled.mass_matrix(np.zeros(9)), compiled.mass_matrix(np.ones(9))
    kept = first.copy()
    second[:] = 5.0
    np.testing.assert_array_equal(first, kept)
    assert first.flags.owndata
    assert first.flags.writeable


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda m: m.mass_matrix(np.zeros(8)), ValueError),
        (lambda m: m.mass_matrix(np.zeros((9, 2))), ValueError),
        (lambda m: m.mass_matrix(3.0), ValueError),
        (lambda m: m.mass_matrix("nine"), TypeError),
        (lambda m: m.mass_matrix([1j] * 9), TypeError),
        (lambda m: m.residual(np.zeros((2, 9)), np.zeros((3, 9))), ValueError),
        (lambda m: m.mass_matrix(np.zeros(9), constants=7), TypeError),
        (lambda m: m.mass_matrix(np.zeros(9), constants=b"short"), TypeError),
        (lambda m: m.prepare({"gravitation": 1.0}), ValueError),
        (lambda m: m.prepare({"gravity": np.nan}), ValueError),
    ],
)
def test_wrong_use_is_refused_alike(call, error: type[Exception], backends) -> None:
    texts = []
    for module in backends:
        with pytest.raises(error) as raised:
            call(module)
        texts.append(str(raised.value))
    assert texts[0] == texts[1]


@pytest.mark.parametrize(
    "call",
    [
        lambda m: m.mass_matrix(),
        lambda m: m.mass_matrix(np.zeros(9), None, None),
        lambda m: m.mass_matrix(np.zeros(9), constant=None),
        lambda m: m.mass_matrix(np.zeros(9), None, constants=None),
        lambda m: m.mass_matrix(np.zeros(9), v=np.zeros(9)),
    ],
)
def test_other_arguments_are_refused(call, backends) -> None:
    for module in backends:
        with pytest.raises(TypeError, match=r"mass_matrix\(\) .*argument"):
            call(module)


def test_constants_of_other_parameters(backends, states: dict[str, np.ndarray]) -> None:
    values = {"gravity": 3.71, "link2_length": 1.25}
    q, v = states["q"][:5], states["v"][:5]
    arrays = []
    for module in backends:
        constants = module.prepare(values)
        arrays.append(module.residual(q, v, constants=constants))
        arrays.append(np.array([module.residual(*s, constants) for s in zip(q, v, strict=True)]))
        assert not np.allclose(arrays[-1], module.residual(q, v))
    for other in arrays[1:]:
        np.testing.assert_allclose(other, arrays[0], rtol=0, atol=1e-13 * np.abs(arrays[0]).max())


def test_functions_say_what_they_are(backends) -> None:
    numpy, compiled = backends
    for signature in module_signatures(numpy):
        ours, theirs = getattr(compiled, signature.name), getattr(numpy, signature.name)
        assert ours.__name__ == theirs.__name__
        assert ours.__doc__ == theirs.__doc__
        assert inspect.signature(ours) == inspect.signature(theirs)
    names = [name for name in numpy.__all__ if name.isupper()]
    assert "ATTITUDE" in names
    assert all(getattr(compiled, name) == getattr(numpy, name) for name in names)
    assert Path(compiled.__file__).suffix == ".so"


@pytest.mark.slow
def test_weak_references_end_with_what_they_refer_to() -> None:
    module = load(ROBOT, backend="c")
    references = [weakref.ref(getattr(module, name)) for name in ("residual", "prepare")]
    del module
    gc.collect()
    assert [reference() for reference in references] == [None, None]


@pytest.mark.slow
def test_threads_share_a_batch(
    states: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(c_backend, "_MIN_ROWS", 256)
    alone, shared = load(ROBOT, backend="c"), load(ROBOT, backend="c", threads=3)
    for rows in (1, 255, 769, 5003):
        q, v = states["q"][:rows], states["v"][:rows]
        for one, many in zip(
            alone.mass_matrix_and_residual(q, v), shared.mass_matrix_and_residual(q, v), strict=True
        ):
            np.testing.assert_array_equal(one, many)


def test_calls_from_many_threads(backends, states: dict[str, np.ndarray]) -> None:
    compiled = backends[1]
    q = states["q"][:200]
    expected = [compiled.mass_matrix(state) for state in q]
    wrong: list[int] = []

    def call() -> None:
        for i, state in enumerate(q):
            if not np.array_equal(compiled.mass_matrix(state), expected[i]):
                wrong.append(i)

    threads = [threading.Thread(target=call) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:os.fork")  # JAX, once another test has it imported, warns.
def test_a_forked_process_has_threads_of_its_own(
    states: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(c_backend, "_MIN_ROWS", 256)
    compiled = load(ROBOT, backend="c", threads=2)
    q = states["q"][:2000]
    expected = compiled.mass_matrix(q)
    child = os.fork()
    if child == 0:
        os._exit(0 if np.array_equal(compiled.mass_matrix(q), expected) else 1)
    for _ in range(300):
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            break
        time.sleep(0.1)
    else:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        pytest.fail("the child hangs")
    assert status == 0


@pytest.mark.slow
def test_many_threads_load_at_once() -> None:
    with ThreadPoolExecutor(8) as pool:
        modules = list(pool.map(lambda _: load(ROBOT, backend="c"), range(16)))
    assert all(module.__file__ == modules[0].__file__ for module in modules)


@pytest.fixture
def no_extension(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The package as it is where the extension was not built at installation."""
    monkeypatch.setitem(sys.modules, caller.__name__.replace("caller", "_caller"), None)
    caller.caller_type.cache_clear()
    yield
    caller.caller_type.cache_clear()


@pytest.mark.slow
@pytest.mark.usefixtures("no_extension")
def test_without_extension_calls_are_as_cheap(states: dict[str, np.ndarray]) -> None:
    if not (Path(sysconfig.get_path("include")) / "Python.h").is_file():
        missing("Python's headers")
    compiled = load(ROBOT, backend="c")
    assert type(compiled.mass_matrix).__name__ == "Caller"
    one = compiled.mass_matrix(states["q"][0])
    np.testing.assert_array_equal(one, compiled.mass_matrix.__wrapped__(states["q"][0]))


@pytest.mark.slow
def test_functions_of_nine_arrays_take_batches(tmp_path: Path) -> None:
    names = [f"forward_dynamics_with_wrenches_{kind}" for kind in ("vjp",)]
    options = {"functions": ["forward_dynamics_with_wrenches"], "verify": False}
    folder = generate("quadrotor_2link", tmp_path, derivatives=names, **options)
    numpy = load(folder)
    compiled = compiled_of(numpy)
    shapes = {s.name: s.argument_shapes for s in module_signatures(numpy)}
    rng = np.random.default_rng(7)
    for name in names:
        given = [rng.normal(size=(11, *shape)) for shape in shapes[name]]
        found, right = (getattr(m, name)(*given) for m in (compiled, numpy))
        pairs = (
            [(found, right)] if isinstance(right, np.ndarray) else zip(found, right, strict=True)
        )
        for one, other in pairs:
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_function_has_the_short_way(name: str) -> None:
    made = caller.caller_type(chosen_compiler())
    assert made is not None
    row = FUNCTIONS[name]
    taken, given = (((2,),) * len(each) for each in (row.arguments, row.outputs))
    function = made(taken, given, b"", lambda *_: "the long way")
    assert function(*[0.0] * len(row.arguments)) == "the long way"


@pytest.mark.slow
@pytest.mark.usefixtures("no_extension")
def test_without_extension_and_python_headers(
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    backends,
    states: dict[str, np.ndarray],
) -> None:
    caplog.set_level("DEBUG", "gibbs_codegen")
    monkeypatch.setattr(caller.sysconfig, "get_path", lambda _: "/nowhere")
    plain = load(ROBOT, backend="c")
    assert isinstance(plain.mass_matrix, c_backend.GeneralFunction)
    assert "unusable: import of gibbs_codegen.runtime._caller halted" in caplog.text
    np.testing.assert_array_equal(
        plain.mass_matrix(states["q"][0]), backends[1].mass_matrix(states["q"][0])
    )


def test_functions_are_not_pickled_but_copied(
    monkeypatch: pytest.MonkeyPatch, backends: tuple[ModuleType, ModuleType]
) -> None:
    """Pickled by its name, a function would become NumPy's in the other process."""
    monkeypatch.setattr(c_backend, "caller_type", lambda _: None)
    for compiled in (backends[1], load(ROBOT, backend="c")):
        for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
            with pytest.raises(TypeError, match=r"^residual\(\) is compiled code, which cannot be"):
                pickle.dumps(compiled.residual, protocol)
        for function in (compiled.residual, compiled.prepare):
            assert copy.copy(function) is function
            assert copy.deepcopy({"f": function})["f"] is function
            reference = weakref.ref(function)
            assert reference() is function
        assert repr(compiled.residual) == "<compiled function residual>"
        constants = compiled.prepare({"gravity": 3.7})
        assert pickle.loads(pickle.dumps(constants)) == constants  # noqa: S301


@pytest.fixture
def said(caplog: pytest.LogCaptureFixture) -> Iterator[pytest.LogCaptureFixture]:
    with caplog.at_level(logging.WARNING, "gibbs_codegen"):
        yield caplog


@pytest.mark.parametrize(
    ("compiler", "reason"),
    [
        ("/nowhere/cc", "no such compiler"),
        ("false", "failed"),
        ("true", "failed"),
        ('cc "', "quotation"),
        ("cc --no-such-flag", "--no-such-flag"),
        ("cc -O0 -DHEXAROTOR_3LINK_FLOAT", "the library has no hexarotor_3link_init_constants"),
    ],
)
def test_numpy_serves_where_nothing_compiles(
    compiler: str,
    reason: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    said: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setenv("CC", compiler)
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "cache"))
    module = load(ROBOT, backend="c")
    assert module.__file__.endswith(".py")
    assert module.mass_matrix(np.zeros(9)).shape == (9, 9)
    assert len(said.records) == 1
    message = said.records[0].getMessage()
    assert message.startswith("hexarotor_3link: runs in NumPy instead of C: ")
    assert reason in message
    assert "\n" not in message


def test_numpy_serves_where_there_is_no_compiler(
    monkeypatch: pytest.MonkeyPatch, said: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    find_compiler.cache_clear()
    assert load(ROBOT, backend="c").__file__.endswith(".py")
    assert [record.getMessage() for record in said.records] == [
        "hexarotor_3link: runs in NumPy instead of C: no C compiler found; "
        "flights take many times as long"
    ]


def test_numpy_serves_where_what_was_compiled_is_no_library(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, said: pytest.LogCaptureFixture
) -> None:
    script = tmp_path / "compiler"
    script.write_text(
        '#!/bin/sh\nwhile test $# -gt 0; do test "$1" = -o && echo no >"$2"; shift; done\n'
    )
    script.chmod(0o755)
    monkeypatch.setenv("CC", str(script))
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "cache"))
    assert load(ROBOT, backend="c").__file__.endswith(".py")
    assert len(said.records) == 1
    assert "library.so cannot be loaded" in said.records[0].getMessage()


def test_numpy_serves_where_nothing_can_be_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, said: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "file" / "cache"))
    assert load(ROBOT, backend="c").__file__.endswith(".py")
    assert [record.getMessage().split(": ")[1] for record in said.records] == [
        "runs in NumPy instead of C"
    ]


@pytest.mark.slow
def test_a_module_without_c_is_refused(tmp_path: Path) -> None:
    folder = generate("hexarotor", tmp_path, targets=("numpy",), verify=False)
    with pytest.raises(UsageError, match=r"has no gibbs_runtime\.h, hexarotor\.h"):
        load(folder, backend="c")
    with pytest.raises(UsageError, match="threads"):
        load(folder, threads=0)


def test_a_compiler_that_hangs_is_given_up_with_all_it_started(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, said: pytest.LogCaptureFixture
) -> None:
    script = tmp_path / "hanging"
    script.write_text('#!/bin/sh\ntest "$1" = --version || sleep 987\n')
    script.chmod(0o755)
    monkeypatch.setenv("CC", str(script))
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("gibbs_codegen.runtime.c_library._TIMEOUT_SECONDS", 0.5)
    assert load(ROBOT, backend="c").__file__.endswith(".py")
    assert "did not finish" in said.records[0].getMessage()
    commands = [
        path.read_bytes().split(b"\0")
        for path in Path("/proc").glob("[0-9]*/cmdline")
        if path.is_file()
    ]
    assert [b"sleep", b"987"] not in [command[:2] for command in commands]


@pytest.mark.slow
def test_a_launcher_may_stand_before_the_compiler(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It takes all that follows for a command, as ccache does."""
    launcher = tmp_path / "launcher"
    launcher.write_text('#!/bin/sh\necho "$@" >>"$0.log"\nexec "$@"\n')
    launcher.chmod(0o755)
    monkeypatch.setenv("CC", f"{launcher} {tool('cc')} -O0")
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "cache"))
    assert Path(load(ROBOT, backend="c").__file__).suffix == ".so"
    version, *compilations = (tmp_path / "launcher.log").read_text().splitlines()
    assert version == f"{tool('cc')} -O0 --version"
    for words in map(str.split, compilations):
        assert words[0] == str(tool("cc"))
        # Which flags it knows is asked without compiling.
        assert "-E" in words or words.index("-O3") < words.index("-O0")


@pytest.mark.slow
def test_flags_of_the_user_come_last(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CC", f"{tool('cc')} -O0 -DMARK")
    monkeypatch.setenv("GIBBS_CODEGEN_CACHE", str(tmp_path / "cache"))
    compiler = find_compiler(os.environ["CC"])
    assert compiler.command[1:] == ("-O0", "-DMARK")
    module = load(ROBOT, backend="c")
    assert module.__file__.startswith(str(tmp_path))
    assert module.mass_matrix(np.zeros(9)).shape == (9, 9)


@pytest.mark.parametrize(
    ("changed", "line", "place"),
    [
        ("hexarotor_3link.h", 2, -2),
        ("hexarotor_3link.c", 2, -2),
        ("hexarotor_3link_batch.c", 2, -2),
        ("numpy_module.py", 2, -1),
        ("gibbs_runtime.h", 0, 4),  # It names no robot, but the version.
    ],
)
def test_files_of_different_makes_are_refused(
    changed: str, line: int, place: int, tmp_path: Path
) -> None:
    folder = tmp_path / "hexarotor_3link"
    shutil.copytree(ROBOT, folder)
    lines = (folder / changed).read_text(encoding="utf-8").splitlines()
    lines[line] = lines[line].replace(lines[line].split()[place], "0" * 64)
    (folder / changed).write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(UsageError, match="generate the module again"):
        load(folder, backend="c")


def test_any_folder_name_will_do(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"a b\xff-x 'q'") / "hexarotor_3link"
    shutil.copytree(ROBOT, folder)
    assert load(folder, backend="c").mass_matrix(np.zeros(9)).shape == (9, 9)
