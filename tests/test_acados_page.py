"""The page on acados: expressions of its models, against the module's functions in NumPy."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from support.pages import run_python
from support.tools import missing

from gibbs_codegen import generate, load

try:
    import casadi
except ImportError:
    missing("casadi is not installed")

pytestmark = pytest.mark.usefixtures("derived_once")


@pytest.fixture(scope="module", params=["quadrotor_arm_2link", "quadrotor_2link"])
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot with a quaternion, and one with angles."""
    wanted = ["forward_dynamics_derivatives", "inverse_dynamics_derivatives"]
    out = tmp_path_factory.mktemp("modules")
    return generate(request.param, out, derivatives=wanted, verify=False)


@pytest.mark.slow
@pytest.mark.parametrize("parameters", [True])
def test_models_of_the_page_are_the_equations_of_motion(
    robot: Path, parameters: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    acados = ModuleType("acados_template")
    acados.AcadosModel = SimpleNamespace  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "acados_template", acados)
    numpy = load(robot)
    model = run_python("docs/howto/acados.md")["acados_model"](load(robot, "casadi"), parameters)
    p = np.array([*numpy.PARAMETERS.values()]) * 1.03 if parameters else np.zeros(0)
    constants = numpy.prepare(dict(zip(numpy.PARAMETERS, p, strict=False)))
    q, v, a = (np.linspace(0.3, -0.8, len(x)) for x in (numpy.COORDINATES, *[numpy.VELOCITIES] * 2))
    u = np.linspace(1.0, 2.0, len(numpy.INPUTS))
    if numpy.ATTITUDE == "quaternion":
        q[3:7] /= np.linalg.norm(q[3:7])
    h = 1e-6
    # What moves along the velocities for a moment, and back.
    rates = (numpy.integrate(q, h * v) - numpy.integrate(q, -h * v)) / (2 * h)
    x, x_dot = np.r_[q, v], np.r_[rates, a]
    nq = len(q)

    given = [model.x, model.u, model.p]
    slopes = [casadi.jacobian(model.f_expl_expr, y) for y in (model.x[nq:], model.u)]
    explicit = casadi.Function("explicit", given, [model.f_expl_expr, *slopes])
    value, by_v, by_u = (y.full() for y in explicit(x, u, p))
    found = numpy.forward_dynamics_derivatives(q, v, u, constants)
    assert value.ravel() == pytest.approx(np.r_[rates, found[0]], abs=1e-9)
    assert by_v[nq:] == pytest.approx(found[2], abs=1e-10)
    assert by_u[nq:] == pytest.approx(found[3], abs=1e-10)
    assert not by_u[:nq].any()

    given = [model.x, model.xdot, model.u, model.p]
    slopes = [casadi.jacobian(model.f_impl_expr, y) for y in (model.x[nq:], model.xdot, model.u)]
    implicit = casadi.Function("implicit", given, [model.f_impl_expr, *slopes])
    value, by_v, by_rate, by_u = (y.full() for y in implicit(x, x_dot, u, p))
    force, _, force_dv, mass = numpy.inverse_dynamics_derivatives(q, v, a, constants)
    inputs = numpy.input_matrix(q, constants)
    assert value.ravel() == pytest.approx(np.r_[np.zeros(nq), force - inputs @ u], abs=1e-8)
    assert by_v[nq:] == pytest.approx(force_dv, abs=1e-10)
    assert by_rate[nq:, nq:] == pytest.approx(mass, abs=1e-10)
    assert by_rate[:nq, :nq] == pytest.approx(np.eye(nq))
    assert by_u[nq:] == pytest.approx(-inputs, abs=1e-10)
    # Both are of one motion: the explicit form's rates have no residual in the implicit one.
    there = explicit(x, u, p)[0].full().ravel()
    assert implicit(x, there, u, p)[0].full().ravel() == pytest.approx(np.zeros(len(x)), abs=1e-8)
