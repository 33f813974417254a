"""Modules as JAX's functions: the module's numbers, derivatives, transformations, precisions."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import copytree
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from support.calls import Pair, as_tuple, random_arguments, state
from support.command import ENVIRONMENT
from support.comparison import assert_close
from support.compiled import ACTUATED, emit, emit_labelled
from support.differences import rate
from support.pages import run_python
from support.tools import missing, tool

from gibbs_codegen.errors import UsageError
from gibbs_codegen.interface import DATA, module_signatures
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.runtime.load import load

try:
    import jax
    import jax.numpy as jnp
except ImportError:
    missing("jax is not installed")

from gibbs_codegen.runtime import jax_ffi
from gibbs_codegen.runtime.jax_backend import JaxFunctions

pytestmark = pytest.mark.usefixtures("derived_once", "jax_in_double_precision")

Array = np.ndarray
ANGLES, TURNING = "angles", "quaternion"
DERIVATIVES = [
    *("forward_dynamics_derivatives", "frame_poses_derivatives", "step_euler"),
    *("step_rk4_derivatives", "forward_dynamics_parameters_vjp"),
]
MORE = [
    *("forward_dynamics_hessian", "inverse_dynamics_derivatives", "inverse_dynamics_hessian"),
    *("frame_velocities_derivatives", "inverse_dynamics_parameters"),
    *("difference_derivatives", "forward_dynamics_with_wrenches_derivatives"),
]


# The second robot, and what XLA takes long to compile, are for the slow run.
@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Pair]:
    """The back ends of a module, which is made when it is first asked for."""
    made: dict[str, Pair] = {}

    def both(label: str) -> Pair:
        if label not in made:
            path = tmp_path_factory.mktemp("jax") / "module"
            if label == ACTUATED:
                emit_labelled(label, path)
            else:
                robot = paper_family(2, 1)
                if label == TURNING:
                    robot = replace(robot, base=replace(robot.base, attitude="quaternion"))
                emit(robot, path, derivatives=DERIVATIVES + MORE * (label == TURNING))
            made[label] = Pair(load(path), load(path, backend="jax"))
            # Compiled at the first call, whatever compiler there may be later.
            made[label].ours.mass_matrix(made[label].numpy.integrate(*start(made[label].numpy)))
        return made[label]

    return both


@pytest.fixture
def traced(pair: Callable[[str], Pair], monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module with a quaternion where nothing compiles, so that XLA has all functions."""
    folder = Path(pair(TURNING).numpy.__file__ or "").parent
    monkeypatch.setenv("CC", "no-such-compiler")
    return load(folder, backend="jax")


def start(module: ModuleType) -> tuple[Array, Array]:
    """Coordinates to move from, and a displacement."""
    q = np.linspace(0.3, -0.5, len(module.COORDINATES))
    return q, np.linspace(-0.2, 0.4, len(module.VELOCITIES))


def assert_agree(found: Any, expected: Any, name: str, tolerance: float = 1e-12) -> None:
    for ours, right in zip(as_tuple(found), as_tuple(expected), strict=True):
        assert_close(name, np.asarray(ours), right, tolerance)


def jacobian(function: Callable[[Array], Any], at: Array, step: float = 2e-3) -> Array:
    """Derivatives of a function by differences of eighth order, columns last."""
    columns = [
        rate(lambda t, e=e: np.stack([function(at + x * e) for x in t]), np.zeros(1), step)[0]
        for e in np.eye(len(at))
    ]
    return np.stack(columns, axis=-1)


@pytest.mark.slow
def test_every_function_is_that_of_the_numpy_module(
    pair: Callable[[str], Pair], caplog: pytest.LogCaptureFixture
) -> None:
    """XLA calls the compiled ones, however many arrays they have."""
    numpy, ours = pair(ACTUATED)
    for signature in module_signatures(numpy):
        name = signature.name
        given = random_arguments(numpy, signature, 3, 2)
        found = getattr(ours, name)(*given)
        assert {output.dtype for output in as_tuple(found)} == {np.dtype("float64")}
        assert_agree(found, getattr(numpy, name)(*given), name)
    assert "XLA compiles" not in caplog.text
    for name in DATA:
        assert getattr(ours, name) == getattr(numpy, name)


@pytest.mark.slow
def test_axes_of_arguments_and_constants_broadcast(pair: Callable[[str], Pair]) -> None:
    numpy, ours = pair(TURNING)
    q, v, _ = state(numpy, "forward_dynamics", 4, 1)
    u = state(numpy, "forward_dynamics", 3, seed=1)[2]
    assert_agree(ours.forward_dynamics(q, v[0], u), numpy.forward_dynamics(q, v[0], u), "axes")
    gravities = np.array([9.81, 3.7, 0.0])
    constants = ours.prepare({"gravity": gravities})
    expected = [
        numpy.forward_dynamics(q[:, 0], v[:, 0], u[0], numpy.prepare({"gravity": gravity}))
        for gravity in gravities
    ]
    found = ours.forward_dynamics(q, v, u[0], constants=constants)
    assert_agree(found, np.stack(expected, axis=1), "constants")
    mapped = jax.vmap(jax.vmap(ours.forward_dynamics, (None, None, 0, None)), (0, 0, None, 0))
    found = mapped(q[:3, 0], v[:3, 0], u, constants)
    single = [
        [numpy.forward_dynamics(q[i, 0], v[i, 0], w, numpy.prepare({"gravity": g})) for w in u]
        for i, g in enumerate(gravities)
    ]
    assert_agree(found, np.array(single), "vmap of vmap")
    assert ours.forward_dynamics(q[:0, 0], v[:0, 0], u[0]).shape == (0, len(numpy.VELOCITIES))


@pytest.mark.slow
def test_constants_of_each_state_go_in_blocks(
    pair: Callable[[str], Pair], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The last of which is not full; and one by one where the source for blocks is missing."""
    numpy, ours = pair(TURNING)
    folder = tmp_path / "older"
    copytree(Path(numpy.__path__[0]), folder)
    next(folder.glob("*_each.c")).unlink()
    older = load(folder, backend="jax")
    count = 21
    lengths = np.linspace(0.7, 1.3, count)
    given = state(numpy, "forward_dynamics", count)
    expected = numpy.forward_dynamics(*given, numpy.prepare({"link1_length": lengths}))

    def by_length(module: ModuleType) -> Callable[..., Any]:
        return lambda q, v, u, length: module.forward_dynamics(
            q, v, u, module.prepare({"link1_length": length})
        )

    for module in (ours, older):
        for function in (by_length(module), jax.vmap(by_length(module))):
            assert_agree(function(*given, lengths), expected, "constants of each state")
        single = [np.float32(values) for values in (*given, lengths)]
        assert_agree(by_length(module)(*single), expected, "single precision", 1e-4)
    assert "computed one by one" in caplog.text
    assert "generate the module again" in caplog.text


@pytest.mark.slow
@pytest.mark.parametrize("label", [TURNING])
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_derivatives_are_those_of_the_module(
    label: str, mode: Any, pair: Callable[[str], Pair]
) -> None:
    """By v and u they are its matrices, by entries of q differences of a normalised quaternion."""
    numpy, ours = pair(label)
    q, v, u = state(numpy, "forward_dynamics")
    by_q, by_v, by_u = jax.jit(mode(ours.forward_dynamics, argnums=(0, 1, 2)))(q, v, u)
    _, dq, dv, du = numpy.forward_dynamics_derivatives(q, v, u)
    assert_agree((by_v, by_u), (dv, du), "by v and u")
    if label == ANGLES:
        assert_agree(by_q, dq, "by q")
    assert_close("by q", by_q, jacobian(lambda x: ours.forward_dynamics(x, v, u), q), 1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param("frame_velocities", marks=pytest.mark.slow), "forward_dynamics_with_wrenches"],
)
def test_derivatives_of_other_functions(name: str, pair: Callable[[str], Pair]) -> None:
    """With a rule or by the kernel, by every argument."""
    numpy, ours = pair(TURNING)
    given, function = state(numpy, name), getattr(ours, name)
    found = jax.jit(jax.jacrev(function, argnums=(*range(len(given)),)))(*given)
    for i, at in enumerate(given):

        def moved(x: Array, i: int = i, shape: tuple[int, ...] = at.shape) -> Any:
            return function(*given[:i], x.reshape(shape), *given[i + 1 :])

        expected = jacobian(moved, at.ravel())
        assert_close(f"{name} by {i}", found[i].reshape(expected.shape), expected, 1e-10)


@pytest.mark.slow
def test_matrices_are_computed_once_for_all_columns(pair: Callable[[str], Pair]) -> None:
    numpy, ours = pair(TURNING)
    q, v, u = state(numpy, "forward_dynamics", 5)
    whole = jax.vmap(jax.jacfwd(ours.forward_dynamics, argnums=(0, 1, 2)))
    program = jax.jit(whole).lower(q, v, u).compile().as_text()
    calls = [line for line in program.splitlines() if "custom-call(" in line and "gibbs" in line]
    size = len(numpy.VELOCITIES)
    assert len(calls) == 1
    assert f"f64[5,{size * size}]" in calls[0]


@pytest.mark.slow
def test_gradient_of_a_rollout_is_that_of_differences(pair: Callable[[str], Pair]) -> None:
    """100 steps, from rest with a level base: where the angle of a displacement is zero."""
    numpy, ours = pair(TURNING)
    q, v, u = state(numpy, "forward_dynamics")
    v = np.zeros_like(v)

    @jax.jit
    def loss(v: Any, u: Any) -> Any:
        def step(before: Any, _: Any) -> Any:
            after = ours.step_euler(*before, u, 0.005)
            return after, after[0]

        return jnp.sum(jax.lax.scan(step, (q, v), length=100)[1] ** 2)

    by_v, by_u = jax.jit(jax.grad(loss, argnums=(0, 1)))(v, u)
    assert_close("by v", by_v, jacobian(lambda x: loss(x, u), v), 1e-8)
    assert_close("by u", by_u, jacobian(lambda x: loss(v, x), u), 1e-8)


@pytest.mark.slow
def test_single_precision_where_arguments_have_it(pair: Callable[[str], Pair]) -> None:
    numpy, ours = pair(TURNING)
    given = state(numpy, "forward_dynamics", 3)
    single = [jnp.asarray(array, jnp.float32) for array in given]
    expected = numpy.forward_dynamics(*(np.asarray(array, np.float64) for array in single))
    found = ours.forward_dynamics(*single)
    assert found.dtype == jnp.float32
    assert_close("float32", np.asarray(found), expected, 1e-6)
    after = ours.step_euler(*single, 0.01)
    assert {array.dtype for array in after} == {np.dtype("float32")}
    by_v = jax.jacfwd(ours.forward_dynamics, argnums=1)(*(array[0] for array in single))
    right = numpy.forward_dynamics_derivatives(*(array[0] for array in given))[2]
    assert by_v.dtype == jnp.float32
    assert_close("float32", np.asarray(by_v), right, 1e-4)


@pytest.mark.slow
def test_where_nothing_compiles_xla_has_all_functions(
    pair: Callable[[str], Pair], traced: ModuleType, caplog: pytest.LogCaptureFixture
) -> None:
    """As on a GPU. The log says it once."""
    numpy, _ = pair(TURNING)
    for name in ("mass_matrix", "forward_dynamics", "tip_pose", "step_euler"):
        given = state(numpy, name, 2)
        assert_agree(getattr(traced, name)(*given), getattr(numpy, name)(*given), name)
    assert caplog.text.count("XLA compiles the functions") == 1
    q, v, u = state(numpy, "forward_dynamics")
    single = traced.forward_dynamics(*(jnp.asarray(array, jnp.float32) for array in (q, v, u)))
    assert single.dtype == jnp.float32
    assert_agree(single, numpy.forward_dynamics(q, v, u), "float32", 1e-4)
    found = jax.jacfwd(traced.forward_dynamics, argnums=1)(q, v, u)
    assert_agree(found, numpy.forward_dynamics_derivatives(q, v, u)[2], "by v")


def test_operations_are_those_of_the_kernel() -> None:
    """Entries that are taken of arrays are no operations, though Python 3.14 counts them in."""
    folder = ROOT / "generated" / "hexarotor_3link"
    assert JaxFunctions(load(folder), folder)._operations("mass_matrix") == 184


@pytest.fixture
def little_for_xla(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gibbs_codegen.runtime.jax_backend._MOST_OPERATIONS", 10)


@pytest.mark.usefixtures("little_for_xla")
def test_what_is_too_long_for_xla_is_refused_with_the_reason(
    pair: Callable[[str], Pair],
    traced: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    numpy = pair(TURNING).numpy
    given = state(numpy, "residual")
    with pytest.raises(
        UsageError, match=r"too many for XLA; it cannot be compiled.*no such compiler"
    ):
        traced.residual(*given)
    copytree(numpy.__path__[0], tmp_path / "module")
    (tmp_path / "module" / f"{numpy.NAME}.c").unlink()
    with pytest.raises(UsageError, match=r"cannot be compiled.*generated without the C target"):
        load(tmp_path / "module", backend="jax").residual(*given)
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    with pytest.raises(UsageError, match=r"JAX computes on the gpu.*on the CPU only"):
        load(numpy.__path__[0], backend="jax").residual(*given)


@pytest.mark.slow
@pytest.mark.usefixtures("little_for_xla")
def test_a_derivative_too_long_for_xla_is_refused_with_the_reason() -> None:
    """Compiled or not: the function that gives it is named, where there is one."""
    robot = load(ROOT / "generated" / "hexarotor_3link", backend="jax")
    q, v, u = np.zeros(9), np.zeros(9), np.zeros(9)
    with pytest.raises(UsageError, match="too many for XLA; no function of a module gives"):
        jax.jacfwd(robot.residual)(q, v)
    with pytest.raises(UsageError, match=r"XLA; .*--derivatives=forward_dynamics_derivatives,"):
        jax.jacfwd(robot.forward_dynamics)(q, v, u)
    with pytest.raises(UsageError, match=r"XLA; .*--derivatives=forward_dynamics_parameters_vjp,"):
        jax.jacfwd(lambda g: robot.forward_dynamics(q, v, u, robot.prepare({"gravity": g})))(9.8)


@pytest.mark.parametrize("flags", ["-O0 -fvisibility=hidden", "-O0"])
def test_what_xla_cannot_call_is_traced(
    flags: str, pair: Callable[[str], Pair], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Functions that are hidden, and those that cannot be added."""
    numpy = pair(TURNING).numpy
    refuses = SimpleNamespace(gibbs_codegen_jax_add=lambda *_: -1)
    monkeypatch.setattr(jax_ffi, "_caller", lambda: refuses)
    monkeypatch.setenv("CC", f"{tool('cc')} {flags}")
    calls = jax_ffi.compiled_calls(numpy, Path(numpy.__path__[0]))
    if not isinstance(calls, str):
        (signature,) = [s for s in module_signatures(numpy) if s.name == "mass_matrix"]
        calls = calls.why_not(signature)
    assert ("do flags in CC hide" if "hidden" in flags else "cannot be added") in calls


@pytest.mark.slow
def test_the_page_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    page = run_python("docs/howto/jax.md")
    assert page["loss"](page["learned"]) < 1e-6


def test_arguments_are_refused_as_by_the_numpy_module(pair: Callable[[str], Pair]) -> None:
    numpy, ours = pair(TURNING)
    q, v, u = state(numpy, "forward_dynamics")
    for given in ((q[:-1], v, u), (q, v, 1j * u), (q, v, ["text"] * len(u))):
        with pytest.raises((TypeError, ValueError)) as expected:
            numpy.forward_dynamics(*given)
        with pytest.raises(expected.type) as found:
            ours.forward_dynamics(*given)
        assert str(found.value) == str(expected.value)
    with pytest.raises(TypeError, match=r"^forward_dynamics\(\) missing.*'u'"):
        ours.forward_dynamics(q, v)
    with pytest.raises(ValueError, match="leading axes"):
        ours.forward_dynamics(np.stack([q] * 2), np.stack([v] * 3), u)
    with pytest.raises(TypeError, match="float64 or float32, not bfloat16"):
        ours.mass_matrix(jnp.asarray(q, jnp.bfloat16))
    with pytest.raises(TypeError, match="what this module's prepare"):
        ours.mass_matrix(q, constants=numpy.prepare({}))
    with pytest.raises(TypeError, match=r"^constants must be float64 or float32, not complex128$"):
        ours.mass_matrix(q, constants=1j * ours.prepare({}))
    with pytest.raises(TypeError, match=r"^constants must be real numbers: not complex \("):
        ours.mass_matrix(q, constants=1j * np.asarray(ours.prepare({})))
    with pytest.raises(TypeError, match="not a mapping"):
        ours.prepare([1.0])
    with pytest.raises(ValueError, match="unknown parameter 'gravitation'"):
        ours.prepare({"gravitation": 1.0})
    with pytest.raises(ValueError, match=r"^values do not broadcast: gravity \(2,\), link1_length"):
        ours.prepare({"gravity": np.ones(2), "link1_length": jnp.ones(3)})


def test_a_program_of_another_process_says_what_it_lacks(pair: Callable[[str], Pair]) -> None:
    pair(TURNING)
    call = jax.ffi.ffi_call("gibbs_codegen", jax.ShapeDtypeStruct((3,), jnp.float64))
    with pytest.raises(Exception, match="load the module before a program that calls it is run"):
        jax.block_until_ready(call(jnp.zeros(3), function="unheard/of"))


@pytest.mark.slow
def test_the_switch_for_double_precision_is_left_alone() -> None:
    """Without it all is float32, and nothing warns."""
    code = (
        "import jax, numpy as np\n"
        "from gibbs_codegen import load\n"
        "robot = load('hexarotor_3link', backend='jax')\n"
        "assert not jax.config.jax_enable_x64\n"
        "rates = robot.coordinate_rates(np.zeros(9), np.ones(9))\n"
        "assert rates.dtype == 'float32' and (rates == 1.0).all()\n"
        "assert robot.prepare({'gravity': 1.62}).dtype == 'float32'\n"
        "q = np.linspace(-0.5, 0.7, 18).reshape(2, 9)\n"
        "assert 'gibbs' in jax.jit(robot.positions).lower(q).as_text()\n"
        "right = load('hexarotor_3link').positions(q)\n"
        "found = robot.positions(q)\n"
        "assert found.dtype == 'float32' and abs(found - right).max() < 1e-6\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=ENVIRONMENT,
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
