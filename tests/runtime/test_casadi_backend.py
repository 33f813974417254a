"""Modules as CasADi's functions: the module's numbers, and exact derivatives of any order."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from support.calls import Pair, as_tuple, random_arguments, state
from support.comparison import assert_close
from support.compiled import ACTUATED, emit, emit_labelled
from support.pages import run_python
from support.random_robots import random_tree
from support.tools import missing, run, tool
from support.tree_cases import QUICK_TREES

from gibbs_codegen import generate
from gibbs_codegen.errors import MissingFunctionError, UsageError
from gibbs_codegen.interface import DATA, DATA_ON_REQUEST, FUNCTIONS, module_signatures
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.runtime.load import load

try:
    import casadi
except ImportError:
    missing("casadi is not installed")

pytestmark = pytest.mark.usefixtures("derived_once")

Array = np.ndarray
ANGLES, TREE, DERIVATIVES = "hexarotor_3link", "a tree with a quaternion", "all derivatives"
STEPS = "steps with angles"
STEP_FUNCTIONS = ["step_euler", "step_rk4_derivatives"]
TOLERANCE = 1e-13


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Pair]:
    """The back ends of a module, which is made when it is first asked for."""
    made: dict[str, Pair] = {}

    def folder(label: str) -> Path:
        if label == ANGLES:
            return ROOT / "generated" / ANGLES
        new = tmp_path_factory.mktemp("casadi") / "module"
        if label == ACTUATED:
            return emit_labelled(label, new).folder
        if label == TREE:
            return emit(random_tree(*QUICK_TREES[1]), new).folder
        if label == STEPS:
            return emit(paper_family(3, 0), new, derivatives=STEP_FUNCTIONS).folder
        robot = paper_family(2, 1)
        turning = replace(robot, base=replace(robot.base, attitude="quaternion"))
        return emit(turning, new, derivatives="all").folder

    def both(label: str) -> Pair:
        if label not in made:
            path = folder(label)
            made[label] = Pair(load(path), load(path, backend="casadi"))
        return made[label]

    return both


def assert_agree(found: Any, expected: Any, name: str) -> None:
    """CasADi's outputs are those of NumPy, blocks one below the other."""
    for ours, right in zip(as_tuple(found), as_tuple(expected), strict=True):
        columns = right.shape[-1] if right.ndim > 1 else 1
        assert ours.shape == (right.size // columns if columns else 0, columns), name
        assert_close(
            name, np.asarray(casadi.DM(ours).full()).reshape(right.shape), right, TOLERANCE
        )


@pytest.mark.parametrize(
    "label",
    [
        ANGLES,
        pytest.param(DERIVATIVES, marks=pytest.mark.slow),
        pytest.param(ACTUATED, marks=pytest.mark.slow),
    ],
)
def test_every_function_is_that_of_the_numpy_module(
    label: str, pair: Callable[[str], Pair]
) -> None:
    numpy, ours = pair(label)
    lengths = {name: 0.9 * value for name, value in numpy.PARAMETERS.items() if "length" in name}
    for signature in module_signatures(numpy):
        name = signature.name
        function, expected = getattr(ours, name), getattr(numpy, name)
        assert isinstance(function, casadi.Function)
        assert function.name_in() == list(signature.arguments)
        assert function.name_out() == [output.name for output in FUNCTIONS[name].outputs]
        assert function.is_a("SXFunction")
        assert getattr(ours, name) is function
        for seed in (0, 1):
            given = random_arguments(numpy, signature, seed=seed)
            assert_agree(function(*given), expected(*given), name)
        changed = expected(*given, constants=numpy.prepare(lengths))
        assert_agree(function(*given, constants=ours.prepare(lengths)), changed, name)


@pytest.mark.parametrize("label", [ANGLES, pytest.param(DERIVATIVES, marks=pytest.mark.slow)])
def test_constants_and_names_are_those_of_the_module(
    label: str, pair: Callable[[str], Pair]
) -> None:
    numpy, ours = pair(label)
    for name in (*DATA, *DATA_ON_REQUEST):
        if hasattr(numpy, name):
            assert getattr(ours, name) == getattr(numpy, name)
    public = {name for name in dir(numpy) if not name.startswith("_")}
    assert public - {"numpy_module"} <= {*dir(ours)}


@pytest.mark.slow
def test_matrices_have_the_exact_zeros_of_patterns(pair: Callable[[str], Pair]) -> None:
    numpy, ours = pair(DERIVATIVES)
    found = {}
    for signature in module_signatures(numpy):
        function = getattr(ours, signature.name)
        if FUNCTIONS[signature.name].on_request:
            found |= {name: function.sparsity_out(name) for name in function.name_out()}
    for name, (rows, columns) in numpy.PATTERNS.items():
        assert (found[name].row(), found[name].get_col()) == (list(rows), list(columns)), name
    assert len(numpy.PATTERNS) > 10
    assert ours.forward_dynamics.sparsity_out(0).is_dense()


@pytest.mark.slow
def test_casadis_derivatives_are_the_modules(pair: Callable[[str], Pair]) -> None:
    numpy, ours = pair(DERIVATIVES)
    q, v, u, w = state(numpy, "forward_dynamics_vjp")
    size, inputs = len(v), len(u)
    x = casadi.MX.sym("x", 2 * size + inputs)
    d, rates, thrusts = casadi.vertsplit(x, [0, size, 2 * size, 2 * size + inputs])
    a = ours.forward_dynamics(ours.integrate(q, d), rates, thrusts)
    second, first = casadi.hessian(casadi.dot(w, a), x)
    at = casadi.Function("at", [x], [casadi.jacobian(a, x), first, second])
    jacobian, gradient, hessian = at(np.concatenate([np.zeros(size), v, u]))
    _, *blocks = numpy.forward_dynamics_derivatives(q, v, u)
    assert_close("Jacobian", jacobian.full(), np.hstack(blocks), 1e-12)
    bars = np.concatenate(numpy.forward_dynamics_vjp(q, v, u, w))
    assert_close("gradient", gradient.full().ravel(), bars, 1e-12)
    assert_close("Hessian", hessian.full(), numpy.forward_dynamics_hessian(q, v, u, w), 1e-11)


@pytest.mark.slow
def test_functions_do_not_depend_on_the_length_of_a_quaternion(pair: Callable[[str], Pair]) -> None:
    numpy, ours = pair(TREE)
    attitude = [numpy.COORDINATES.index(name) for name in ("qx", "qy", "qz", "qw")]
    q, v, u = state(numpy, "forward_dynamics")
    longer = q.copy()
    longer[attitude] *= 3.0
    radial = np.zeros_like(q)
    radial[attitude] = q[attitude]
    for name, others in (
        ("forward_dynamics", (v, u)),
        ("frame_poses", ()),
        ("integrate", (v,)),
        ("coordinate_rates", (v,)),
    ):
        function = getattr(ours, name)
        assert_agree(function(longer, *others), getattr(numpy, name)(q, *others), name)
        slope = function.jacobian()(longer, *others, *[0.0] * function.n_out())
        along = (as_tuple(slope)[0] @ radial).full()
        assert np.abs(along).max() < 1e-13 * np.abs(as_tuple(slope)[0].full()).max()


@pytest.mark.slow
def test_integrate_is_smooth_where_nothing_moves(pair: Callable[[str], Pair]) -> None:
    """A solver begins there: no derivative by a displacement of zero is lost."""
    numpy, ours = pair(TREE)
    (q,) = state(numpy, "mass_matrix")
    rest = np.zeros(len(numpy.VELOCITIES))
    v = casadi.MX.sym("v", len(rest))
    slope = casadi.Function("slope", [v], [casadi.jacobian(ours.integrate(q, v), v)])
    rates = np.transpose([numpy.coordinate_rates(q, row) for row in np.eye(len(rest))])
    assert_close("rates", slope(rest).full(), rates, TOLERANCE)
    back = casadi.Function(
        "back", [v], [casadi.jacobian(ours.difference(q, ours.integrate(q, v)), v)]
    )
    assert_close("identity", back(rest).full(), np.eye(len(rest)), TOLERANCE)


@pytest.mark.parametrize("kind", ["SX", "MX"])
def test_constants_may_be_symbols(kind: str, pair: Callable[[str], Pair]) -> None:
    numpy, ours = pair(DERIVATIVES)
    q, v, a = state(numpy, "inverse_dynamics")
    symbol = getattr(casadi, kind).sym
    p = symbol("p", len(numpy.PARAMETERS))
    constants = ours.prepare(dict(zip(numpy.PARAMETERS, casadi.vertsplit(p), strict=True)))
    assert type(constants).__name__ == kind
    force = ours.inverse_dynamics(q, v, a, constants=constants)
    slope = casadi.Function("slope", [p], [casadi.jacobian(force, p)])
    found = slope(list(numpy.PARAMETERS.values())).full()
    assert_close("slope", found, numpy.inverse_dynamics_parameters(q, v, a), 1e-12)
    # One symbol among numbers.
    gravity = symbol("gravity")
    mixed = ours.prepare({"gravity": gravity, "link1_length": 0.7})
    force = casadi.Function("force", [gravity], [ours.inverse_dynamics(q, v, a, constants=mixed)])
    other = numpy.prepare({"gravity": 3.7, "link1_length": 0.7})
    assert_agree(force(3.7), numpy.inverse_dynamics(q, v, a, other), "force")


def test_functions_are_called_as_casadis_are(pair: Callable[[str], Pair]) -> None:
    numpy, ours = pair(ANGLES)
    q, v, u = state(numpy, "forward_dynamics")
    moon = {"gravity": 1.62}
    expected = numpy.forward_dynamics(q, v, u)
    lighter = numpy.forward_dynamics(q, v, u, numpy.prepare(moon))
    named = ours.forward_dynamics(q=q, v=v, u=u)
    assert_agree(named["acceleration"], expected, "named")
    named = ours.forward_dynamics(q=q, v=v, u=u, constants=ours.prepare(moon))
    assert_agree(named["acceleration"], lighter, "named with constants")
    given = ours.forward_dynamics.with_constants(
        q, v, u, ours.prepare({"gravity": casadi.DM(1.62)})
    )
    assert_agree(given, lighter, "with constants")
    given = ours.forward_dynamics(q, v, u, ours.prepare(moon))
    assert_agree(given, lighter, "constants for the last argument")
    columns = ours.forward_dynamics(np.transpose([q, q]), np.transpose([v, v]), u)
    assert_close("columns", columns.full(), np.transpose([expected, expected]), TOLERANCE)
    symbols = [casadi.MX.sym(name, len(x)) for name, x in (("q", q), ("v", v), ("u", u))]
    graph = casadi.Function("graph", symbols, [2.0 * ours.forward_dynamics(*symbols)])
    assert graph.is_a("MXFunction")
    assert_agree(graph(q, v, u), 2.0 * expected, "a graph of calls")
    assert_agree(graph.expand()(q, v, u), 2.0 * expected, "the same, expanded")
    sent = pickle.loads(pickle.dumps(ours.forward_dynamics))  # noqa: S301
    copies = copy.copy(ours.forward_dynamics), copy.deepcopy(ours.forward_dynamics)
    for other in (sent, *copies):
        assert_agree(other(q, v, u, constants=ours.prepare(moon)), lighter, "sent elsewhere")
        assert other.__doc__ == numpy.forward_dynamics.__doc__


def test_a_step_takes_the_name_of_its_method(pair: Callable[[str], Pair]) -> None:
    numpy, ours = pair(DERIVATIVES)
    q, v, u, h = state(numpy, "step_rk4")
    half = {"gravity": 4.9}
    expected = numpy.step(q, v, u, h, "rk4", numpy.prepare(half))
    assert_agree(ours.step(q, v, u, h, "rk4", ours.prepare(half)), expected, "step")
    every = ours.step_derivatives(q, v, u, h, method="euler")
    assert_agree(every, numpy.step_derivatives(q, v, u, h), "step_derivatives")


def test_functions_become_c(pair: Callable[[str], Pair], tmp_path: Path) -> None:
    numpy, ours = pair(TREE)
    q, v, u = state(numpy, "forward_dynamics")
    generator = casadi.CodeGenerator("functions.c")
    generator.add(ours.forward_dynamics)
    generator.add(ours.forward_dynamics.jacobian())
    source = generator.generate(f"{tmp_path}/")
    library = tmp_path / "functions.so"
    run([tool("cc"), "-O0", "-shared", "-fPIC", source, "-o", library, "-lm"])
    compiled = casadi.external("forward_dynamics", str(library))
    assert_agree(compiled(q, v, u), numpy.forward_dynamics(q, v, u), "in C")
    slopes = casadi.external("jac_forward_dynamics", str(library))
    for found, right in zip(
        slopes(q, v, u, 0), ours.forward_dynamics.jacobian()(q, v, u, 0), strict=True
    ):
        assert_close("Jacobian in C", found.full(), right.full(), TOLERANCE)


@pytest.mark.slow
def test_the_page_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    page = run_python("docs/howto/casadi.md")
    assert_close("falling", page["falling"].full().ravel(), np.array([0.0] * 8 + [-9.81]), 1e-12)
    folder = generate(
        "quadrotor", tmp_path, derivatives=["forward_dynamics_derivatives"], verify=False
    )
    for robot in (page["robot"], load(folder, backend="casadi")):
        given = [np.linspace(0.4, -0.7, x.numel()) for x in robot.forward_dynamics.sx_in()]
        plain = robot.forward_dynamics
        ours = page["dynamics"]
        if robot is not page["robot"]:
            # Another library of the same name would not be loaded.
            ours = page["differentiable"](robot)
        assert_close("value", ours(*given).full(), plain(*given).full(), TOLERANCE)
        pairs = zip(ours.jacobian()(*given, 0), plain.jacobian()(*given, 0), strict=True)
        for found, expected in pairs:
            assert_close("Jacobian", found.full(), expected.full(), 1e-11)
    weighted = casadi.DM(np.linspace(-1.0, 1.0, 9))
    level = [casadi.DM(np.linspace(0.4, -0.7, 9))] * 3
    curvature = page["curvature"]
    assert curvature.is_a("External")
    by_q = curvature.jacobian()(*level, weighted, 0)[0].full()
    assert_close("second", by_q[:9], by_q[:9].T, 1e-10)
    bent = casadi.Function("bent", [page[name] for name in "qvuw"], [page["hessian"]])
    assert_close("second", by_q, bent(*level, weighted).full()[:, :9], 1e-11)


@pytest.mark.slow
def test_both_solvers_find_the_flight_of_the_page(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It keeps within limits, and its steps are those of a robot of larger armature."""
    monkeypatch.chdir(tmp_path)
    page = run_python("docs/howto/own-nmpc.md", slice(1))
    plan, robot, h = page["plan"], page["robot"], page["STEP"]
    again, converged = page["solved"]("fatrop")
    assert converged
    assert_close("plan", again, plan, 5e-3)
    known, nu, nq = robot.PARAMETERS, page["nu"], page["nq"]
    changed = {
        name.replace("damping", "armature"): h * value
        for name, value in known.items()
        if name.endswith("_damping")
    }
    assert set(changed.values()) == {0.02 * h}
    constants = robot.prepare(changed)
    before = np.vstack([page["first"], plan[:-1, nu:]])
    for begin, stage in zip(before, plan, strict=True):
        found = robot.step_euler(begin[:nq], begin[nq:], stage[:nu], h, constants=constants)
        assert_close("step", np.concatenate(found), stage[nu:], 1e-6)
    least, most = np.transpose([robot.INPUT_LIMITS[name] for name in robot.INPUTS])
    assert (plan[:, :nu] > least - 1e-6).all()
    assert (plan[:, :nu] < most + 1e-6).all()


def test_what_is_wrong_is_said(pair: Callable[[str], Pair]) -> None:
    numpy, ours = pair(ANGLES)
    q, v, u = state(numpy, "forward_dynamics")
    with pytest.raises(MissingFunctionError, match="--derivatives=forward_dynamics_derivatives"):
        ours.forward_dynamics_derivatives(q, v, u)
    with pytest.raises(AttributeError, match="no attribute 'forward_dynamic'"):
        ours.forward_dynamic(q, v, u)
    for value in (1.62, casadi.SX.sym("g"), casadi.MX.sym("g")):
        with pytest.raises(ValueError, match=r"unknown parameter 'gravitation'.*gravity"):
            ours.prepare({"gravitation": value})
    with pytest.raises(ValueError, match="gravity must be a finite number"):
        ours.prepare({"gravity": np.nan})
    for constants in (numpy.prepare({}), ours.prepare({})[:-1], 1.0, np.float64(3.0)):
        with pytest.raises(TypeError, match=r"what this module's prepare\(\) returned"):
            ours.forward_dynamics(q, v, u, constants=constants)
    constants = ours.prepare({})
    with pytest.raises(TypeError, match=r"^forward_dynamics\(\) got constants both by"):
        ours.forward_dynamics(q, v, u, constants, constants=constants)
    for value in (casadi.SX.sym("g", 2), casadi.MX.sym("g", 2), casadi.DM([1.0, 2.0])):
        with pytest.raises(TypeError, match=r"^gravity must be one number or symbol, not of shape"):
            ours.prepare({"gravity": value})
    with pytest.raises(TypeError, match="all SX or all MX"):
        ours.prepare({"gravity": casadi.SX.sym("g"), "link3_length": casadi.MX.sym("l")})
    with pytest.raises(TypeError, match="mapping"):
        ours.prepare([1.0])
    with pytest.raises(RuntimeError, match=r"shape|dimension"):
        ours.forward_dynamics(q[:-1], v, u)
    with pytest.raises(UsageError, match="threads"):
        load(ROOT / "generated" / ANGLES, backend="casadi", threads=0)
