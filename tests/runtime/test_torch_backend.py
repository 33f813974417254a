"""Modules and array programs as PyTorch's functions: numbers, derivatives, transformations."""

from __future__ import annotations

import gc
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.calls import Pair, as_tuple, random_arguments, state
from support.comparison import assert_close
from support.compiled import emit
from support.complex_step import complex_values
from support.pages import run_python
from support.random_robots import rolling_robot
from support.tools import tool

from gibbs_codegen import differentiable
from gibbs_codegen.arrays import Functions, Program, variable
from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.arrays.nodes import entries_of, reshaped
from gibbs_codegen.errors import MissingFunctionError, UsageError
from gibbs_codegen.interface import module_signatures
from gibbs_codegen.machine.rollout_steps import Parts, rollout_step
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.runtime.load import load

torch = pytest.importorskip("torch")
tool("cc")

from gibbs_codegen.runtime import torch_backend  # noqa: E402

pytestmark = [
    pytest.mark.usefixtures("derived_once"),
    pytest.mark.filterwarnings("ignore:.*torch.jit:FutureWarning"),
    pytest.mark.filterwarnings("ignore:.*torch.jit:DeprecationWarning"),
]
DERIVATIVES = [
    *("forward_dynamics_vjp", "forward_dynamics_jvp", "forward_dynamics_hessian"),
    *("forward_dynamics_derivatives", "forward_dynamics_parameters_vjp", "step_euler"),
    *("integrate_derivatives", "frame_poses_derivatives"),
]
Array = np.ndarray


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Pair:
    """A robot with a quaternion in NumPy and in PyTorch."""
    robot = paper_family(2, 1)
    robot = replace(robot, base=replace(robot.base, attitude="quaternion"))
    folder = tmp_path_factory.mktemp("torch") / "module"
    emit(robot, folder, derivatives=DERIVATIVES)
    return Pair(load(folder), load(folder, backend="torch"))


def tensors(module: ModuleType, *batch: int) -> list[Any]:
    """q, v and u, of which derivatives are wanted; quaternions have any length."""
    q, v, u = map(torch.from_numpy, state(module, "forward_dynamics", *batch))
    return [x.requires_grad_() for x in (1.3 * q, v, u)]


def unit(q: Array) -> Array:
    """Coordinates whose quaternion has unit length."""
    length = np.linalg.norm(q[..., 3:7], axis=-1, keepdims=True)
    return np.concatenate([q[..., :3], q[..., 3:7] / length, q[..., 7:]], axis=-1)


@pytest.mark.slow
def test_every_function_is_that_of_the_numpy_module(pair: Pair) -> None:
    for signature in module_signatures(pair.numpy):
        given = random_arguments(pair.numpy, signature, 3, 2)
        found = getattr(pair.ours, signature.name)(*map(torch.from_numpy, given))
        right = as_tuple(getattr(pair.numpy, signature.name)(*given))
        for ours, values in zip(as_tuple(found), right, strict=True):
            assert ours.dtype == torch.float64
            assert_close(signature.name, ours.numpy(), values, 1e-12)


def test_derivatives_are_those_of_differences_and_of_the_module(pair: Pair) -> None:
    """Backward, forward, twice, broadcast; and matrices by `torch.func`."""
    function, (q, v, u) = pair.ours.forward_dynamics, tensors(pair.numpy, 3)
    assert torch.autograd.gradcheck(function, (q, v, u), check_forward_ad=True)
    assert torch.autograd.gradcheck(function, (q, v[:1], u[0]))
    assert torch.autograd.gradgradcheck(function, (q[:1], v[:1], u[:1]))
    given = [x.detach() for x in (q, v, u)]
    at = (x.numpy() for x in given)
    right = pair.numpy.forward_dynamics_derivatives(unit(next(at)), *at)
    for mode in (torch.func.jacrev, torch.func.jacfwd):
        _, by_v, by_u = torch.vmap(mode(function, (0, 1, 2)))(*given)
        assert_close("by v", by_v.numpy(), right[2], 1e-12)
        assert_close("by u", by_u.numpy(), right[3], 1e-12)
    nested = torch.vmap(torch.vmap(function, (None, 0, None)), (0, None, 0))(*given)
    assert torch.equal(nested, function(given[0][:, None], given[1], given[2][:, None]))


@pytest.mark.parametrize("seed", [0, 1])
def test_angles_of_wheels_are_differentiated(seed: int, tmp_path: Path) -> None:
    """After two displacements, with a drive and without: displacements do not have them."""
    robot = rolling_robot(seed)
    emit(robot, tmp_path / "module", derivatives=["integrate_derivatives"])
    module = load(tmp_path / "module", backend="torch")
    shapes = len(module.COORDINATES), len(module.VELOCITIES)
    given = [torch.rand(n, dtype=torch.float64, requires_grad=True) for n in shapes]
    calls = Functions(module.in_c)
    q, v = calls.state()
    twice = Program("twice", (q, v), {"end": calls.integrate(calls.integrate(q, v), 2.0 * v)})
    entries = 2.0 * entries_of(twice.results(q, v)["end"])
    called = Program("called", (q, v), {"entries": entries})
    for function in (module.integrate, *(differentiable(x, module) for x in (twice, called))):
        assert torch.autograd.gradcheck(function, given)


@pytest.mark.filterwarnings("ignore:The .grad attribute")  # Of what opcheck makes.
def test_torch_compile_takes_them_whole(pair: Pair) -> None:
    """With numbers beside tensors, and with parameters."""

    def loss(q: Any, v: Any, u: Any, gravity: Any) -> Any:
        constants = pair.ours.prepare({"gravity": gravity})
        a = pair.ours.forward_dynamics(q, v, u, constants=constants)
        after = pair.ours.step_euler(q, v, u, 0.01)
        return (a**2).sum() + torch.tanh(v).sum() + sum(x.sum() for x in after)

    gravity = torch.tensor(9.0, dtype=torch.float64, requires_grad=True)
    given = [*tensors(pair.numpy, 3), gravity]
    right = torch.autograd.grad(loss(*given), given)
    compiled = torch.compile(loss, fullgraph=True, backend="aot_eager")
    for ours, values in zip(torch.autograd.grad(compiled(*given), given), right, strict=True):
        assert torch.equal(ours, values)
    key = pair.ours.forward_dynamics._on_tensors._by_owners[()].key
    torch.library.opcheck(torch_backend.call, (given[:3], key))
    with pytest.raises(UsageError, match="load the module"):
        torch_backend.call(given, "unheard of")


def test_parameters_are_differentiated_through_prepare(pair: Pair) -> None:
    given = [x.detach() for x in tensors(pair.numpy, 3)]

    def by(length: Any, gravity: Any) -> Any:
        constants = pair.ours.prepare({"link1_length": length, "gravity": gravity})
        return pair.ours.forward_dynamics(*given, constants=constants)

    lengths = torch.tensor([0.7, 0.8, 0.9], dtype=torch.float64, requires_grad=True)
    gravity = torch.tensor(9.0, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(by, (lengths, gravity))
    values = {"link1_length": lengths.detach().numpy(), "gravity": 9.0}
    q, v, u = (x.numpy() for x in given)
    right = pair.numpy.forward_dynamics(unit(q), v, u, pair.numpy.prepare(values))
    assert_close("constants", by(lengths, gravity).detach().numpy(), right, 1e-12)
    lengths, gravity = lengths.detach(), gravity.detach()
    mapped = torch.vmap(by, (None, 0))(lengths, gravity + torch.arange(2.0))
    assert torch.equal(mapped[0], by(lengths, gravity))
    slope = torch.func.grad(lambda g: by(lengths, g).sum())(gravity)
    step = 1e-4
    difference = (by(lengths, gravity + step) - by(lengths, gravity - step)).sum() / (2 * step)
    assert abs(float(slope - difference)) < 1e-6
    with pytest.raises(UsageError, match="in reverse alone"):
        torch.func.jvp(lambda g: by(lengths, g), (gravity,), (gravity,))


class ComplexModule:
    """The functions of a module at complex arguments."""

    def __init__(self, module: ModuleType) -> None:
        self._module = module
        self._arguments = {x.name: x.arguments for x in module_signatures(module)}

    def __getattr__(self, name: str) -> Any:
        def function(*given: Any, constants: None = None) -> Any:
            values = complex_values(
                self._module, name, dict(zip(self._arguments[name], given, strict=True))
            )
            return values[0] if len(values) == 1 else tuple(values)

        return function


def test_a_hundred_steps_have_the_gradient_of_complex_steps(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a rollout with lag and limits, that a linear law leads, by its gains and the start."""
    module, robot = pair.numpy, Functions(pair.numpy)
    sign = lambda x: np.copysign(1.0, np.real(x))  # noqa: E731 - as the module has it, of complex
    monkeypatch.setattr(sys.modules[module.mass_matrix.__module__], "sign", sign)
    program = rollout_step(robot, "euler", Parts(limits=True, lag=True), "flown")
    step, h, count = differentiable(program, pair.ours), 0.01, robot.inputs
    start = [*module.integrate(*state(module, "integrate")), *np.full(robot.space.velocities, 0.1)]
    start += [1.0] * robot.rotors
    size = len(start)
    gains = np.random.default_rng(0).uniform(-0.1, 0.1, (count, size))
    decay = [[math.exp(-0.5 * k * h / 0.03)] * robot.rotors for k in range(3)]
    shared = {"time": 0.0, "h": h, "least": np.full(count, -0.5), "most": np.full(count, 0.5)}
    shared["lag"] = np.array(decay)

    def flown(x: Any, gain: Any, take: Any) -> Any:
        for _ in range(100):
            x = take(x=x, u=(gain @ x[..., None])[..., 0], **shared)
        return (x * x).sum(-1)

    by = [torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in (start, gains)]
    found = torch.autograd.grad(flown(*by, lambda **given: step(**given)[0]), by)
    evaluator = Evaluator(program, {"robot": ComplexModule(module)}, np)
    # Entries of the quaternion keep its length.
    rows = 1e-40j * np.delete(np.eye(size + gains.size), range(3, 7), axis=0)
    x, gain = start + rows[:, :size], gains + rows[:, size:].reshape(-1, *gains.shape)
    right = flown(x, gain, lambda **given: evaluator(given, {"robot": None})["x_next"]).imag / 1e-40
    ours = np.concatenate([np.delete(found[0].numpy(), range(3, 7)), found[1].numpy().ravel()])
    assert_close("gradient", ours, right, 1e-10)


def test_what_is_uniform_may_differ_from_state_to_state(pair: Pair) -> None:
    """And a result that no input has is that of each."""
    x, gain = variable("x", 3), variable("gain", uniform=True)
    program = Program("scaled", (x, gain), {"y": gain * x, "one": 1.0 + 0.0 * x[:2]})
    function = differentiable(program, pair.ours)
    x, gain = torch.ones(4, 1, 3, requires_grad=True), torch.arange(2.0, requires_grad=True)
    y, one = function(x, gain=gain)
    assert y.dtype == torch.float32
    assert y.tolist() == [[[0.0] * 3, [1.0] * 3]] * 4
    assert one.tolist() == [[[1.0] * 2] * 2] * 4
    y.sum().backward()
    assert gain.grad.tolist() == [12.0, 12.0]
    assert x.grad.tolist() == [[[1.0] * 3]] * 4
    assert function(np.zeros((0, 3)), 1.0)[0].shape == (0, 3)


def test_doubles_are_read_where_they_are(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    given, seen = tensors(pair.numpy, 3), []
    run = torch_backend.BlockProgram.run
    monkeypatch.setattr(
        torch_backend.BlockProgram, "run", lambda *every: seen.extend(every[3]) or run(*every)
    )
    found = pair.ours.forward_dynamics(*given)
    assert seen[:3] == [x.data_ptr() for x in given]
    assert seen[-1] == found.data_ptr()


def test_programs_are_kept_while_somebody_has_them(pair: Pair) -> None:
    """One of two that are the same, too."""
    x = variable("x", 2)
    program = Program("kept", (x,), {"y": x * x})
    first, known = differentiable(program, pair.ours), len(torch_backend._KNOWN)
    second = differentiable(program, pair.ours)
    assert len(torch_backend._KNOWN) == known
    del first
    gc.collect()
    given = torch.ones(2, requires_grad=True)
    torch.compile(second, backend="eager")(given).sum().backward()
    assert given.grad.tolist() == [2.0, 2.0]
    torch.compiler.reset()
    del second
    gc.collect()
    assert len(torch_backend._KNOWN) < known


def test_programs_of_the_same_text_have_shapes_of_their_own(pair: Pair) -> None:
    kept = []
    for size, shape in ((4, (2,)), (6, (2,)), (6, (2, 1)), (6, (1, 2))):
        x = variable("x", size)
        program = Program("some", (x,), {"y": reshaped(2.0 * x[1:3], shape)})
        kept.append(differentiable(program, pair.ours))
        found = kept[-1](torch.arange(float(size), dtype=torch.float64))
        assert (found.flatten().tolist(), found.shape) == ([2.0, 4.0], shape)


def test_arguments_are_refused_as_by_the_numpy_module(pair: Pair) -> None:
    numpy, ours = pair
    q, v, u = state(numpy, "forward_dynamics")
    with pytest.raises(UsageError, match="constants are of none, not of robot"):
        differentiable(Program("f", (x := variable("x"),), {"y": x}), ours)(
            1.0, constants={"robot": 1}
        )
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
    with pytest.raises(TypeError, match="q must be float64 or float32, not int64"):
        ours.forward_dynamics(torch.zeros(8, dtype=torch.int64), v, u)
    with pytest.raises(TypeError, match="on the CPU, not on meta"):
        ours.forward_dynamics(torch.zeros(8, device="meta"), v, u)
    with pytest.raises(TypeError, match="what this module's prepare"):
        ours.mass_matrix(q, constants=numpy.prepare({}))
    with pytest.raises(ValueError, match="unknown parameter 'gravitation'"):
        ours.prepare({"gravitation": 1.0})
    with pytest.raises(ValueError, match=r"^values do not broadcast: gravity \(2,\), link1_length"):
        ours.prepare({"gravity": np.ones(2), "link1_length": np.ones(3)})
    with pytest.raises(MissingFunctionError, match="inverse_dynamics_derivatives"):
        ours.inverse_dynamics(*tensors(numpy)[:2], v).sum().backward()


def test_there_is_no_back_end_without_a_compiler(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(UsageError, match=r"'torch'.*no such compiler"):
        load(pair.numpy.__path__[0], backend="torch")
    x = variable("x")
    with pytest.raises(UsageError, match='backend="torch"'):
        differentiable(Program("f", (x,), {"y": x}), pair.numpy)


@pytest.mark.slow
def test_the_page_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    page = run_python("docs/howto/torch.md")
    assert page["last"] < 0.3 * page["first"]
