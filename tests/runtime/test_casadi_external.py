"""Derivatives that CasADi finds in the compiled adapter, against its own of the same kernels."""

from __future__ import annotations

import ctypes
import subprocess
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.compiled import LANGUAGES, Emitted, build, emit
from support.tools import missing, run, tool

from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.runtime.kernels import Kernels

try:
    import casadi
except ImportError:
    missing("casadi is not installed")

# A base with two arms, of one joint each, and with rotors on the base and on both arms.
TREE = """
name = "two_arms"

[base]
attitude = "quaternion"
mass = 2.0
com = [0.01, -0.02, 0.03]
inertia = [0.02, 0.03, 0.04, 0.001, 0.002, -0.003]

[[rotor]]
name = "left"
position = [0.1, 0.2, 0.05]
drag = 0.02

[[rotor]]
name = "on_arm"
on = "arm"
position = [0.1, 0.1, 0]
direction = "y"
drag = -0.01

[[link]]
name = "arm"
xyz = [0.1, 0, -0.1]
axis = "y"
mass = 0.4
com = [0.1, 0.02, 0.01]
inertia = [0.001, 0.002, 0.003, 0, 0, 0]
damping = 0.1

[[link]]
name = "slide"
parent = "base"
joint = "prismatic"
xyz = [-0.1, 0.1, 0]
axis = "x"
mass = 0.3
com = [0.05, 0, 0.03]
inertia = [0.001, 0.002, 0.001, 0, 0, 0]

[[frame]]
name = "tip"
on = "arm"
xyz = [0.2, 0, 0.01]
"""
TOLERANCE = 1e-10
DERIVATIVES = [
    f"{name}_{form}"
    for names, forms in (
        (("inverse_dynamics", "forward_dynamics"), ("derivatives", "vjp", "hessian")),
        (("frame_poses", "frame_velocities", "integrate"), ("derivatives",)),
        (("difference", "frame_bias_accelerations"), ("derivatives",)),
        (("forward_dynamics_with_wrenches",), ("derivatives", "vjp", "parameters_vjp")),
        (("step_euler", "step_rk4"), ("derivatives",)),
        (("inverse_dynamics",), ("parameters",)),
        (("forward_dynamics",), ("parameters_vjp",)),
    )
    for name in names
    for form in forms
] + ["step_euler", "step_rk4"]
SECOND = ("forward_dynamics", "inverse_dynamics")
FIRST = (
    *SECOND,
    *("integrate", "step_euler", "step_rk4", "frame_poses", "tip_pose", "frame_velocities"),
    *("difference", "frame_bias_accelerations", "forward_dynamics_with_wrenches"),
)


class External:
    """The functions of a module in CasADi: compiled, and traced on symbols for comparison."""

    def __init__(self, emitted: Emitted, folder: Path) -> None:
        self.emitted = emitted
        options = ["-O0", "-shared", "-fPIC"]
        self.path = build("gcc", options, emitted.sources, folder / "library.so")
        self._signatures = {signature.name: signature for signature in emitted.signatures()}
        names = (*("sin", "cos", "sqrt", "atan"), "sign")
        self._kernels = Kernels(emitted.module, {name: getattr(casadi, name) for name in names})
        self._rng = np.random.default_rng(7)

    def external(self, name: str, **options: Any) -> Any:
        """A function of the library."""
        return casadi.external(f"{self.emitted.name}_casadi_{name}", str(self.path), options)

    @cached_property
    def parameters(self) -> dict[str, float]:
        """The parameters, other than those of the robot file."""
        defaults = self.emitted.model.defaults
        return {
            name: value * (1.05 + 0.001 * i) for i, (name, value) in enumerate(defaults.items())
        }

    def state(self, name: str) -> list[np.ndarray]:
        """Random arguments of a function; a quaternion is not of unit length."""
        signature = self._signatures[name]
        arguments = dict(zip(signature.arguments, signature.argument_shapes, strict=True))
        drawn = {key: self._rng.uniform(-1, 1, shape) for key, shape in arguments.items()}
        return [np.abs(value) * 0.1 if key == "h" else value for key, value in drawn.items()]

    def oracle(self, name: str, of_parameters: bool = False) -> Any:
        """The function on symbols, of the normalised quaternion."""
        signature = self._signatures[name]
        symbols = [
            casadi.SX.sym(key, *shape)
            for key, shape in zip(signature.arguments, signature.argument_shapes, strict=True)
        ]
        parameters = casadi.SX.sym("parameters", len(self.parameters))
        given = dict(zip(self.parameters, casadi.vertsplit(parameters), strict=True))
        constants = self._kernels.constants(given if of_parameters else self.emitted.model.defaults)
        outputs = self._traced(name, constants, [normalised(self.emitted, s) for s in symbols])
        inputs = [*symbols, parameters] if of_parameters else symbols
        return casadi.Function("oracle", inputs, outputs)

    def _traced(self, name: str, constants: Any, arguments: list[Any]) -> list[Any]:
        """Outputs of a function as columns in CasADi's order."""
        if name in ("step_euler", "step_rk4"):
            return getattr(self, f"_{name}")(constants, *arguments)
        # Row by row, as the kernels take a matrix.
        entries = self._kernels.entries(
            name, constants, *(casadi.vertsplit(casadi.vec(x.T)) for x in arguments)
        )
        (shape,) = self._signatures[name].shapes
        columns = shape[-1] if len(shape) > 1 else 1
        rows = casadi.reshape(casadi.vertcat(*entries), columns, len(entries) // columns)
        return [casadi.vec(rows.T)]

    def _acceleration(self, constants: Any, *state: Any) -> Any:
        return self._traced("forward_dynamics", constants, [*state])[0]

    def _moved(self, constants: Any, q: Any, displacement: Any) -> Any:
        return self._traced("integrate", constants, [q, displacement])[0]

    def _step_euler(self, constants: Any, q: Any, v: Any, u: Any, h: Any) -> list[Any]:
        after = v + h * self._acceleration(constants, q, v, u)
        return [self._moved(constants, q, h * after), after]

    def _step_rk4(self, constants: Any, q: Any, v: Any, u: Any, h: Any) -> list[Any]:
        a = [self._acceleration(constants, q, v, u)]
        half = self._moved(constants, q, h / 2 * v)
        rate = v + h / 2 * a[0]
        a.append(self._acceleration(constants, half, rate, u))
        later, rate = self._moved(constants, q, h / 2 * rate), v + h / 2 * a[1]
        a.append(self._acceleration(constants, later, rate, u))
        later = self._moved(constants, half, h * (rate - v / 2))
        a.append(self._acceleration(constants, later, v + h * a[2], u))
        half = self._moved(constants, q, h / 2 * (v + h / 6 * (a[0] + a[1] - a[2])))
        after = self._moved(constants, half, h / 2 * (v + h / 6 * (a[0] + a[1] + 3 * a[2])))
        return [after, v + h / 6 * (a[0] + 2 * a[1] + 2 * a[2] + a[3])]


def normalised(emitted: Emitted, symbols: Any) -> Any:
    """Coordinates with a quaternion of unit length; anything else as it is."""
    if emitted.module.ATTITUDE != "quaternion" or not symbols[0].name().startswith("q"):
        return symbols
    unit = symbols[3:7] / casadi.norm_2(symbols[3:7])
    return casadi.vertcat(symbols[:3], unit, symbols[7:])


@pytest.fixture(
    scope="module", params=[pytest.param("angles", marks=pytest.mark.slow), "quaternion"]
)
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> External:
    tool("gcc")
    folder = tmp_path_factory.mktemp("casadi")
    made = paper_family(3, 1) if request.param == "angles" else parse_robot(TREE)
    return External(emit(made, folder / "module", derivatives=DERIVATIVES), folder)


def full(values: Any) -> list[np.ndarray]:
    """Matrices of numbers."""
    values = values if isinstance(values, tuple | list) else (values,)
    return [np.asarray(value.full()) for value in values]


def assert_near(ours: np.ndarray, expected: np.ndarray) -> None:
    largest = np.abs(expected).max(initial=1.0)
    np.testing.assert_allclose(ours, expected, rtol=0, atol=TOLERANCE * largest)


@pytest.mark.parametrize("name", FIRST)
def test_jacobians_are_exact(name: str, robot: External) -> None:
    function, oracle = robot.external(name), robot.oracle(name)
    jacobian, expected = function.jacobian(), oracle.jacobian()
    state = robot.state(name)
    blank = [np.zeros(function.size_out(i)) for i in range(function.n_out())]
    ours = full(jacobian(*state, *blank))
    right = full(expected(*state, *(np.zeros(oracle.size_out(i)) for i in range(oracle.n_out()))))
    for found, sought in zip(ours, right, strict=True):
        assert_near(found, sought)


@pytest.mark.parametrize("name", ["step_euler", "step_rk4"])
def test_steps_of_constant_length_are_mapped_and_wrapped(name: str, robot: External) -> None:
    """CasADi then multiplies the derivatives by the length by seeds that are zero."""
    step, (*state, h) = robot.external(name), robot.state(name)
    blank = [np.zeros(step.size_out(i)) for i in range(2)]
    by_u = np.vstack([full(step.jacobian()(*state, h, *blank))[place] for place in (2, 6)])
    symbols = [casadi.MX.sym(key, len(value), 2) for key, value in zip("qvu", state, strict=True)]
    wrapped = casadi.Function("wrapped", symbols, step.map(2)(*symbols, h), {"never_inline": True})
    result = casadi.vec(casadi.vertcat(*wrapped(*symbols)))
    jacobian = casadi.Function("j", symbols, [casadi.jacobian(result, casadi.vec(symbols[2]))])
    found = full(jacobian(*(np.column_stack([value, value]) for value in state)))[0]
    assert_near(found, np.kron(np.eye(2), by_u))


@pytest.mark.parametrize("name", FIRST)
def test_patterns_have_no_more_entries_than_casadi_finds(name: str, robot: External) -> None:
    """That they lack none that matters is tested above, where whole matrices are compared."""
    jacobian, expected = robot.external(name).jacobian(), robot.oracle(name).jacobian()
    for i, output in enumerate(jacobian.name_out()):
        ours, theirs = jacobian.sparsity_out(i), expected.sparsity_out(i)
        assert ours.is_subset(theirs), output


@pytest.mark.parametrize("name", SECOND)
def test_gradients_and_hessians_are_exact(name: str, robot: External) -> None:
    function, oracle = robot.external(name), robot.oracle(name)
    state = robot.state(name)
    symbols = [casadi.MX.sym(key, oracle.size1_in(i)) for i, key in enumerate(oracle.name_in())]
    weights = np.random.default_rng(3).normal(size=oracle.size1_out(0))
    x = casadi.vertcat(*symbols)
    found = []
    for f in (function, oracle):
        hessian, gradient = casadi.hessian(casadi.dot(weights, f(*symbols)), x)
        jacobian = casadi.jacobian(f(*symbols), x)
        outputs = [jacobian, gradient, hessian]
        found.append(full(casadi.Function("all", symbols, outputs)(*state)))
    for ours, right in zip(*found, strict=True):
        assert_near(ours, right)


@pytest.mark.parametrize("name", [*SECOND, "forward_dynamics_with_wrenches"])
def test_parameters_are_an_input(name: str, robot: External) -> None:
    function, oracle = (
        robot.external(f"{name}_of_parameters"),
        robot.oracle(name, of_parameters=True),
    )
    state = [*robot.state(name), np.array([*robot.parameters.values()])]
    assert_near(full(function(*state))[0], full(oracle(*state))[0])
    symbols = [casadi.MX.sym(key, *oracle.size_in(i)) for i, key in enumerate(oracle.name_in())]
    weights = np.random.default_rng(3).normal(size=oracle.size1_out(0))
    x = casadi.veccat(*symbols)
    found = []
    for f in (function, oracle):
        gradient = casadi.gradient(casadi.dot(weights, f(*symbols)), x)
        outputs = [casadi.jacobian(f(*symbols), x), gradient]
        found.append(full(casadi.Function("all", symbols, outputs)(*state)))
    for ours, right in zip(*found, strict=True):
        assert_near(ours, right)


def nearest(function: Any, state: list[np.ndarray], target: np.ndarray) -> tuple[Any, int]:
    """Arguments next to a state for which a function has a value, and IPOPT's iterations."""
    symbols = [casadi.MX.sym(key, len(value)) for key, value in zip("qvu", state, strict=True)]
    x, start = casadi.vertcat(*symbols), np.concatenate(state)
    problem = {"x": x, "f": casadi.sumsqr(x - start), "g": function(*symbols)}
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}}
    solver = casadi.nlpsol("solver", "ipopt", problem, options)
    solution = solver(x0=start, lbg=target, ubg=target)["x"]
    assert solver.stats()["success"]
    return full(solution)[0], solver.stats()["iter_count"]


def test_ipopt_takes_the_same_steps_as_with_derivatives_of_casadi(robot: External) -> None:
    name = "forward_dynamics"
    function, oracle = robot.external(name), robot.oracle(name)
    state = robot.state(name)
    state[0] = state[0] + 1.0
    target = full(oracle(*(value + 0.02 for value in state)))[0]
    (ours, steps), (right, expected) = (nearest(f, state, target) for f in (function, oracle))
    np.testing.assert_allclose(ours, right, atol=1e-7)
    assert steps == expected


def test_generated_code_calls_the_library(
    robot: External, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "forward_dynamics"
    function = robot.external(name)
    symbols = [casadi.MX.sym(key, function.size1_in(i)) for i, key in enumerate("qvu")]
    x = casadi.vertcat(*symbols)
    acceleration = function(*symbols)
    outputs = [casadi.jacobian(acceleration, x), casadi.hessian(casadi.sumsqr(acceleration), x)[0]]
    traced = casadi.Function("traced", symbols, outputs)
    # CasADi writes to the working folder only.
    monkeypatch.chdir(tmp_path)
    source = tmp_path / traced.generate("traced.c")
    assert "#define casadi_int long long int" in source.read_text(encoding="utf-8")
    library = tmp_path / "traced.so"
    linked = [str(robot.path), f"-Wl,-rpath,{robot.path.parent}"]
    run([tool("gcc"), "-O0", "-shared", "-fPIC", source, *linked, "-o", library])
    state = robot.state(name)
    for found, right in zip(
        full(casadi.external("traced", str(library))(*state)), full(traced(*state)), strict=True
    ):
        assert_near(found, right)


def test_sizes_are_written_only_where_they_are_asked_for(robot: External) -> None:
    work = getattr(ctypes.CDLL(str(robot.path)), f"{robot.emitted.name}_casadi_integrate_work")
    sizes = [ctypes.c_longlong(-1) for _ in range(4)]
    assert work(None, None, None, None) == 0
    for i, size in enumerate(sizes):
        assert work(*(ctypes.byref(size) if k == i else None for k in range(4))) == 0
    assert [size.value for size in sizes[:3]] == [2, 1, 0]
    assert sizes[3].value >= 0


def test_what_has_no_second_derivatives_says_so(robot: External) -> None:
    poses = robot.external("frame_poses")
    q = casadi.MX.sym("q", poses.size1_in(0))
    missing = f"Derivatives cannot be calculated for jac_{robot.emitted.name}_casadi_frame_poses"
    with pytest.raises(RuntimeError, match=missing):
        casadi.hessian(casadi.sum1(casadi.vec(poses(q))), q)


@pytest.mark.parametrize("compiler", LANGUAGES)
def test_the_adapter_compiles_silently(compiler: str, robot: External) -> None:
    options = [*LANGUAGES[compiler], "-fsyntax-only", "-Dcasadi_int=int"]
    run([tool(compiler), *options, robot.emitted.sources[1]])


def test_single_precision_is_refused(robot: External) -> None:
    """CasADi would take floats for doubles."""
    flags = ["-fsyntax-only", robot.emitted.single]
    command = [tool("gcc"), *flags, robot.emitted.sources[1]]
    refused = subprocess.run(command, capture_output=True, text=True, check=False)
    assert refused.returncode != 0
    assert f"compile without {robot.emitted.name.upper()}_FLOAT" in refused.stderr
