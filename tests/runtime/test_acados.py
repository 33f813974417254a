"""Models for acados: expressions against the module's functions, and the C that acados calls."""

from __future__ import annotations

import ctypes
import functools
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.actuated import TEXT as ACTUATED
from support.differences import rate
from support.pages import run_python
from support.tools import compiled, missing, tool

from gibbs_codegen import UsageError, acados_model, generate, load, rollout
from gibbs_codegen.runtime.acados import DERIVATIVES

try:
    import casadi
except ImportError:
    missing("casadi is not installed")

pytestmark = pytest.mark.usefixtures("derived_once")
Array = np.ndarray
INSTALLED = importlib.util.find_spec("acados_template") is not None
H = 0.015
FOUR_BAR = """
name = "bars"
[base]
motion = "fixed"
""" + "".join(
    f'[[link]]\nname = "{name}"\nparent = "{parent}"\nxyz = [{x}, 0, 0]\naxis = "y"\n'
    f"mass = {mass}\ncom = [{x}, 0, 0]\ninertia = [0, 1e-3, 1e-3, 0, 0, 0]\n{rest}\n"
    for name, parent, x, mass, rest in (
        ("crank", "base", 0, 0.3, "damping = 0.1"),
        ("coupler", "crank", 0.2, 0.2, "effort = 0"),
        ("rocker", "base", 1.0, 0.4, "effort = 0"),
    )
) + """
[[frame]]
name = "tip"
on = "coupler"
xyz = [0.6, 0, 0]
[[frame]]
name = "pin"
on = "rocker"
xyz = [0.5, 0, 0]
[[constraint]]
name = "closure"
type = "loop"
frame = "tip"
to = "pin"
joint = "spherical"
"""  # fmt: skip
SERVED = """
name = "served"
[base]
motion = "fixed"
[[link]]
name = "arm"
xyz = [0, 0, 0]
axis = "y"
mass = 0.1
com = [0.1, 0, 0]
inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]
servo = { stiffness = 30, damping = 0.4 }
"""
# What acados' headers have, and its matrices as plain columns.
HEADERS = {
    "acados/utils/external_function_generic.h": """
struct blasfeo_dvec_args { struct blasfeo_dvec *x; int xi; };
struct blasfeo_dmat_args { struct blasfeo_dmat *A; int ai, aj; };
""",
    "blasfeo/include/blasfeo_d_aux.h": """
struct blasfeo_dvec { double *pa; };
struct blasfeo_dmat { double *pA; int m; };
""",
    "blasfeo/include/blasfeo_d_aux_ext_dep.h": """
static void blasfeo_unpack_dvec(int m, struct blasfeo_dvec *v, int vi, double *x, int step)
{ for (int i = 0; i < m; ++i) x[i * step] = v->pa[vi + i]; }
static void blasfeo_pack_dvec(int m, double *x, int step, struct blasfeo_dvec *v, int vi)
{ for (int i = 0; i < m; ++i) v->pa[vi + i] = x[i * step]; }
static void blasfeo_pack_dmat(int m, int n, double *x, int ld, struct blasfeo_dmat *a, int i, int j)
{ for (int k = 0; k < m * n; ++k) a->pA[i + k % m + (j + k / m) * a->m] = x[k % m + k / m * ld]; }
""",
}
DRIVER = """
#include "{source}"
/* Inputs begin behind others, as they do in acados' vectors. */
void call(double *x_after_1, double *u_after_2, double *p, double *x_next, double *slopes)
{{
    struct blasfeo_dvec x = {{x_after_1}}, u = {{u_after_2}}, after = {{x_next}};
    struct blasfeo_dmat by = {{slopes, NU + NX}};
    struct blasfeo_dvec_args in_x = {{&x, 1}}, in_u = {{&u, 2}}, out = {{&after, 0}};
    struct blasfeo_dmat_args out_by = {{&by, 0, 0}};
    void *in[] = {{&in_x, &in_u}}, *both[] = {{&out, &out_by}}, *one[] = {{&out}};
    MODULE(acados_derivatives)(in, both, p);
    after.pa += NX;
    MODULE(acados)(in, one, p);
}}
"""


@pytest.fixture(autouse=True)
def _models(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A class of models, where acados is not installed."""
    if not INSTALLED:
        acados = ModuleType("acados_template")
        acados.AcadosModel = SimpleNamespace  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "acados_template", acados)
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def module(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Any]:
    """A module with the derivatives, of a robot that ships or of a text."""
    out = tmp_path_factory.mktemp("modules")

    @functools.cache
    def made(robot: str) -> Any:
        if "\n" in robot:
            file = out / "robot.toml"
            file.write_text(robot)
            robot = str(file)
        wanted = [*DERIVATIVES, "step_rk4_derivatives", "inverse_dynamics_derivatives"]
        return load(generate(robot, out, derivatives=wanted, verify=False))

    return made


class Step:
    """The discrete form, compiled."""

    def __init__(self, robot: Any, folder: Path, step: float = H, **options: Any) -> None:
        self.model = acados_model(robot, "discrete", step=step, folder=folder, **options)
        for name, text in HEADERS.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        driver, library = folder / "driver.c", folder / "driver.so"
        driver.write_text(DRIVER.format(source=self.model.dyn_generic_source))
        flags = [
            "-std=c99",
            "-O1",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-fPIC",
            "-shared",
            f"-I{folder}",
        ]
        compiled([tool("gcc"), *flags, driver, "-lm"], library)
        self._call = ctypes.CDLL(str(library)).call
        self.nx, self.nu = self.model.x.numel(), self.model.u.numel()

    def at(self, x: Array, u: Array, p: Array | None = None) -> tuple[Array, Array, Array]:
        """x_next, A and B."""
        after, slopes = np.zeros(2 * self.nx), np.zeros((self.nx, self.nu + self.nx))
        given = np.r_[0.0, x], np.r_[0.0, 0.0, u], np.zeros(1) if p is None else p
        self._call(*(ctypes.c_void_p(each.ctypes.data) for each in (*given, after, slopes)))
        assert after[self.nx :] == pytest.approx(after[: self.nx], rel=1e-13, abs=1e-13)
        return after[: self.nx], slopes[:, self.nu :], slopes[:, : self.nu]

    def check_slopes(self, x: Array, u: Array, p: Array | None = None, near: float = 1.0) -> None:
        """See that derivatives are those of what it gives, by differences over a share of 0.04."""
        _, by_x, by_u = self.at(x, u, p)
        for slopes, way in ((by_x, lambda d: (x + d, u)), (by_u, lambda d: (x, u + d))):
            for place, unit in enumerate(np.eye(slopes.shape[1])):
                found = rate(
                    lambda t, d=near * unit, to=way: np.array(
                        [self.at(*to(s * d), p)[0] for s in t]
                    ),
                    np.zeros(1),
                )
                assert slopes[:, place] == pytest.approx(found[0] / near, rel=1e-6, abs=1e-6)


def state(robot: Any, seed: int) -> tuple[Array, Array, Array]:
    """Coordinates, velocities and inputs."""
    rng = np.random.default_rng(seed)
    q, v = (rng.uniform(-1.0, 1.0, len(x)) for x in (robot.COORDINATES, robot.VELOCITIES))
    if robot.ATTITUDE == "quaternion":
        q[3:7] /= np.linalg.norm(q[3:7])
    return q, v, rng.uniform(1.0, 3.0, len(robot.INPUTS))


def entries(robot: Any, q: Array) -> Array:
    """How entries of the state (q, v) move with displacements of it."""
    nv = len(robot.VELOCITIES)
    moved = np.zeros((len(q) + nv, 2 * nv))
    moved[: len(q), :nv] = np.transpose([robot.coordinate_rates(q, unit) for unit in np.eye(nv)])
    moved[len(q) :, nv:] = np.eye(nv)
    return moved


@pytest.mark.parametrize("name", ["quadrotor_arm_2link", "quadrotor_2link"])
def test_the_discrete_form_is_the_modules_step(
    name: str, module: Callable[[str], Any], tmp_path: Path
) -> None:
    robot = module(name)
    step = Step(robot, tmp_path)
    for seed in range(3):
        q, v, u = state(robot, seed)
        q_next, v_next, by_state, by_u = robot.step_rk4_derivatives(q, v, u, H)
        x = np.r_[q, v]
        after, by_x, by_inputs = step.at(x, u)
        here, there = entries(robot, q), entries(robot, q_next)
        assert after == pytest.approx(np.r_[q_next, v_next], rel=1e-12, abs=1e-12)
        assert by_x @ here == pytest.approx(there @ by_state, rel=1e-11, abs=1e-11)
        assert by_inputs == pytest.approx(there @ by_u, rel=1e-11, abs=1e-12)
        if robot.ATTITUDE == "quaternion":  # Of any length, which changes nothing.
            longer = np.r_[q[:3], 1.7 * q[3:7], q[7:], v]
            same, slopes, _ = step.at(longer, u)
            assert same == pytest.approx(after, rel=1e-12, abs=1e-12)
            assert slopes[:, 3:7] == pytest.approx(by_x[:, 3:7] / 1.7, rel=1e-11, abs=1e-11)
            assert by_x[:, 3:7] @ q[3:7] == pytest.approx(0.0, abs=1e-11)


def test_angles_of_wheels_are_no_states(module: Callable[[str], Any], tmp_path: Path) -> None:
    robot = module("rover_arm")
    step, (q, v, u) = Step(robot, tmp_path, method="euler"), state(robot, 1)
    v_next = v + H * robot.forward_dynamics(q, v, u)
    x, expected = np.r_[q[:-2], v], np.r_[robot.integrate(q, H * v_next)[:-2], v_next]
    assert step.at(x, u)[0] == pytest.approx(expected, rel=1e-12, abs=1e-12)
    step.check_slopes(x, u)


def test_dampers_act_at_the_end_of_a_step(module: Callable[[str], Any], tmp_path: Path) -> None:
    robot = module("quadrotor_arm_2link")
    step = Step(robot, tmp_path, method="trapezoidal", parameters=True)
    q, v, u = state(robot, 4)
    p = {name: 1.1 * value for name, value in robot.PARAMETERS.items()}
    joints = [name.removesuffix("_damping") for name in p if name.endswith("_damping")]
    pull = {f"{x}_armature": p[f"{x}_armature"] + H * p[f"{x}_damping"] for x in joints}
    assert max(pull.values()) > 0.0
    constants = robot.prepare({**p, **pull})
    v_next = v + H * robot.forward_dynamics(q, v, u, constants)
    expected = np.r_[robot.integrate(q, 0.5 * H * (v + v_next)), v_next]
    given = np.r_[q, v], u, np.array([*p.values()])
    assert step.at(*given)[0] == pytest.approx(expected, rel=1e-12, abs=1e-12)
    step.check_slopes(*given)


def test_servos_push_as_at_the_end_of_a_step(module: Callable[[str], Any], tmp_path: Path) -> None:
    """By q + h v, and h d + h² k / 2 as an armature."""
    robot, h = module(SERVED), 0.02
    step = Step(robot, tmp_path, h, method="trapezoidal", parameters=True)
    p = {**robot.PARAMETERS, "arm_servo_stiffness": 40.0}
    (q, v), reference, (k, d) = (0.1, -0.7), 0.3, (40.0, 0.4)
    push = k * (reference - q - h * v) - d * v + 0.1 * 9.81 * 0.1 * np.cos(q)
    v_next = v + h * push / (1e-4 + 0.1 * 0.1**2 + h * d + 0.5 * h * h * k)
    given = np.array([q, v]), np.array([reference]), np.array([*p.values()])
    expected = np.array([q + 0.5 * h * (v + v_next), v_next])
    assert step.at(*given)[0] == pytest.approx(expected, rel=1e-12)
    step.check_slopes(*given)


def test_thrusts_may_lag(module: Callable[[str], Any], tmp_path: Path) -> None:
    robot = module("quadrotor_arm_2link")
    step = Step(robot, tmp_path, method="euler", lags=True)
    (q, v, u), thrusts = state(robot, 5), np.linspace(1.0, 4.0, 4)
    times = np.array([*robot.TIME_CONSTANTS.values()])
    assert times.shape == thrusts.shape
    v_next = v + H * robot.forward_dynamics(q, v, np.r_[thrusts, u[4:]])
    after = thrusts + H * (u[:4] - thrusts) / times
    expected = np.r_[robot.integrate(q, H * v_next), v_next, after]
    x = np.r_[q, v, thrusts]
    assert step.at(x, u)[0] == pytest.approx(expected, rel=1e-12, abs=1e-12)
    step.check_slopes(x, u)


def test_drives_and_air_are_those_of_rollouts(module: Callable[[str], Any], tmp_path: Path) -> None:
    robot = module(ACTUATED)
    h, rng = 4e-4, np.random.default_rng(2)
    step = Step(robot, tmp_path, h)
    q, v, _ = state(robot, 2)
    command = robot.command_of(q, v, rng.uniform(0.5, 0.9, len(robot.INPUTS)))
    motors = robot.actuator_state_of(command) * rng.uniform(0.8, 0.9, len(robot.ACTUATOR_STATES))
    rolled = rollout(robot, q, v, command[None], dt=h, steps=1, method="rk4", x0=motors)
    expected = np.concatenate([np.ravel(x[..., -1, :]) for x in (rolled.q, rolled.v, rolled.x)])
    assert step.at(np.r_[q, v, motors], command)[0] == pytest.approx(expected, rel=1e-11, abs=1e-12)
    # Within the play of a servo.
    step.check_slopes(np.r_[q, v, motors], command, near=1e-3)


def test_loops_of_mechanisms_hold(module: Callable[[str], Any], tmp_path: Path) -> None:
    robot = module(FOUR_BAR)
    step = Step(robot, tmp_path)
    q, v, u = np.array([0.5, 0.2, -0.4]), 0.3 * np.arange(1.0, 4.0), np.ones(3)

    def rates(x: Array) -> Array:
        return np.r_[x[3:], robot.constrained_forward_dynamics(x[:3], x[3:], u, np.ones(1))[0]]

    x = np.r_[q, v]
    k1 = rates(x)
    k2 = rates(x + 0.5 * H * k1)
    k3 = rates(x + 0.5 * H * k2)
    k4 = rates(x + H * k3)
    expected = x + H / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    assert step.at(x, u)[0] == pytest.approx(expected, rel=1e-12, abs=1e-12)
    step.check_slopes(x, u)
    for form, options, words in (
        ("implicit", {}, "form must be explicit or discrete for bars, not implicit"),
        ("discrete", {}, "step must be above 0 s in the discrete form"),
        ("discrete", {"step": "0.02"}, "step must be above 0 s in the discrete form"),
        ("explicit", {"method": "rk4"}, "method must be .* in the discrete form, and left out in"),
        ("discrete", {"step": H, "method": ["rk4"]}, "method must be euler or rk4"),
        ("explicit", {"folder": "here"}, "folder must be a path in the discrete form"),
        ("discrete", {"step": H, "folder": 3}, "folder must be a path"),
        ("explicit", {"constraints": "closure"}, "constraints must be a list of closure, not clos"),
        ("explicit", {"constraints": [["x"]]}, "constraints must be a list of closure"),
        (["explicit"], {}, "form must be"),
        ("explicit", {"constraints": ["hinge"]}, "constraints must be a list of closure, not"),
        ("discrete", {"step": H, "method": "heun"}, "method must be euler or rk4 or trapezoidal"),
    ):
        with pytest.raises(UsageError, match=words):
            acados_model(robot, form, **options)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="robot must be a module, not bars"):
        acados_model("bars")  # type: ignore[arg-type]


def test_the_page_runs() -> None:
    page = run_python("docs/howto/own-nmpc.md", slice(1, None if INSTALLED else 2))
    assert Path(page["model"].dyn_generic_source).is_file()
    if INSTALLED:  # Thrusts that carry it, and hardly a torque.
        assert page["solver"].get(0, "u") == pytest.approx(np.array([3.0] * 4 + [0.0] * 2), abs=1.0)


@pytest.mark.skipif(not INSTALLED, reason="acados is not installed")
@pytest.mark.slow
def test_all_forms_make_one_plan(module: Callable[[str], Any]) -> None:
    from acados_template import AcadosOcp, AcadosOcpSolver

    robot, first = module("quadrotor_2link"), {}
    for form, integrator in (("discrete", "DISCRETE"), ("explicit", "ERK"), ("implicit", "IRK")):
        ocp, options = AcadosOcp(), {"step": H} if form == "discrete" else {}
        ocp.model, ocp.dims.N = acados_model(robot, form, **options), 10
        ocp.model.name = form
        nx, nu = ocp.model.x.numel(), ocp.model.u.numel()
        x = 0.1 * np.arange(nx) / nx
        cost, ocp.constraints.x0 = ocp.cost, x
        cost.cost_type = cost.cost_type_e = "LINEAR_LS"
        cost.Vx, cost.Vu, cost.Vx_e = np.eye(nx + nu, nx), np.eye(nx + nu, nu, -nx), np.eye(nx)
        cost.W, cost.W_e = np.eye(nx + nu), np.eye(nx)
        cost.yref, cost.yref_e = np.zeros(nx + nu), np.zeros(nx)
        ocp.solver_options.tf, ocp.solver_options.integrator_type = 10 * H, integrator
        solver = AcadosOcpSolver(ocp, json_file=f"{form}.json")
        for _ in range(3):
            assert solver.solve() in {0, 2}
        first[form] = solver.get(0, "u")
    assert first["explicit"] == pytest.approx(first["discrete"], rel=1e-8, abs=1e-9)
    assert first["implicit"] == pytest.approx(first["discrete"], rel=1e-5, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "parameters"), [("quadrotor_arm_2link", True), ("quadrotor_2link", False)]
)
def test_expressions_are_the_equations_of_motion(
    name: str, parameters: bool, module: Callable[[str], Any]
) -> None:
    robot = module(name)
    p = np.array([*robot.PARAMETERS.values()]) * 1.03 if parameters else np.zeros(0)
    constants = robot.prepare(dict(zip(robot.PARAMETERS, p, strict=False)))
    (q, v, u), a = state(robot, 7), np.linspace(0.3, -0.8, len(robot.VELOCITIES))
    h, nq = 1e-6, len(q)
    # What moves along the velocities for a moment, and back.
    rates = (robot.integrate(q, h * v) - robot.integrate(q, -h * v)) / (2 * h)
    x, x_dot = np.r_[q, v], np.r_[rates, a]

    model = acados_model(robot, "explicit", parameters=parameters)
    given = [model.x, model.u, model.p]
    slopes = [casadi.jacobian(model.f_expl_expr, y) for y in (model.x[nq:], model.u)]
    explicit = casadi.Function("explicit", given, [model.f_expl_expr, *slopes])
    value, by_v, by_u = (y.full() for y in explicit(x, u, p))
    found = robot.forward_dynamics_derivatives(q, v, u, constants)
    assert value.ravel() == pytest.approx(np.r_[rates, found[0]], abs=1e-9)
    assert by_v[nq:] == pytest.approx(found[2], abs=1e-10)
    assert by_u[nq:] == pytest.approx(found[3], abs=1e-10)
    assert not by_u[:nq].any()

    model = acados_model(robot, "implicit", parameters=parameters)
    given = [model.x, model.xdot, model.u, model.p]
    slopes = [casadi.jacobian(model.f_impl_expr, y) for y in (model.x[nq:], model.xdot, model.u)]
    implicit = casadi.Function("implicit", given, [model.f_impl_expr, *slopes])
    value, by_v, by_rate, by_u = (y.full() for y in implicit(x, x_dot, u, p))
    force, _, force_dv, mass = robot.inverse_dynamics_derivatives(q, v, a, constants)
    inputs = robot.input_matrix(q, constants)
    assert value.ravel() == pytest.approx(np.r_[np.zeros(nq), force - inputs @ u], abs=1e-8)
    assert by_v[nq:] == pytest.approx(force_dv, abs=1e-10)
    assert by_rate[nq:, nq:] == pytest.approx(mass, abs=1e-10)
    assert by_rate[:nq, :nq] == pytest.approx(np.eye(nq))
    assert by_u[nq:] == pytest.approx(-inputs, abs=1e-10)
    # Both are of one motion: the explicit form's rates have no residual in the implicit one.
    there = explicit(x, u, p)[0].full().ravel()
    assert implicit(x, there, u, p)[0].full().ravel() == pytest.approx(np.zeros(len(x)), abs=1e-8)
