"""acados' functions, called through ctypes with the arguments that acados passes."""

from __future__ import annotations

import ctypes
import importlib.util
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.compiled import build, compile_only
from support.derived import derived
from support.differences import rate
from support.kept import kept_folder, made_once
from support.random_robots import random_tree
from support.tools import compiled, tool

from gibbs_codegen.errors import UsageError
from gibbs_codegen.files.templating import render
from gibbs_codegen.interface import default_functions
from gibbs_codegen.program.model import Model
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.load import load
from gibbs_codegen.targets.registry import TARGETS, find_targets, render_module

Array = NDArray[np.float64]

DERIVATIVES = (
    *("forward_dynamics_derivatives", "forward_dynamics_vjp", "forward_dynamics_hessian"),
    *("inverse_dynamics_derivatives", "inverse_dynamics_vjp", "inverse_dynamics_hessian"),
    *("input_forces_derivatives", "input_forces_hessian"),
)
STEP = 0.03
GUARD = 12345.0


def shapes(nx: int, nu: int, np_: int) -> dict[str, tuple[list[tuple[int, int]], Any]]:
    """Rows and columns of inputs and outputs, as acados' casadi_function_generation.py has them."""
    x, u, p, ps = (nx, 1), (nu, 1), (np_, 1), (np_ + 1, 1)
    sx, su, sz, none, both = (nx, nx), (nx, nu), (nx, 0), (0, 0), nx + nu
    dae = [x, x, u, none, none, p]
    return {
        "expl_ode_fun": ([x, u, p], [x]),
        "expl_vde_forw": ([x, sx, su, u, p], [x, sx, su]),
        "expl_vde_adj": ([x, x, u, p], [(both, 1)]),
        "expl_ode_hess": ([x, sx, su, x, u, p], [(both, 1), (both * (both + 1) // 2, 1)]),
        "impl_dae_fun": (dae, [x]),
        "impl_dae_fun_jac_x_xdot_z": (dae, [x, sx, sx, sz]),
        "impl_dae_jac_x_xdot_u_z": (dae, [sx, sx, su, sz]),
        "impl_dae_fun_jac_x_xdot_u": (dae, [x, sx, sx, su]),
        "impl_dae_fun_jac_x_xdot_u_z": (dae, [x, sx, sx, su, sz]),
        "impl_dae_hess": ([x, x, u, none, x, none, p], [(2 * nx + nu, 2 * nx + nu)]),
        "dyn_disc_phi_fun": ([x, u, ps], [x]),
        "dyn_disc_phi_fun_jac": ([x, u, ps], [x, (both, nx)]),
        "dyn_disc_phi_fun_jac_hess": ([x, u, x, ps], [x, (both, nx), (both, both)]),
    }


class Library:
    """A compiled file, whose functions take and return matrices as acados has them."""

    def __init__(self, name: str, path: Path) -> None:
        self._library = ctypes.CDLL(str(path))
        self._name = name

    def function(self, form: str) -> Any:
        """A function of C."""
        return self._library[f"{self._name}_{form}"]

    def shape(self, form: str, way: str, place: int) -> tuple[int, int] | None:
        """Rows and columns of an input or output, which is dense; None beyond the last."""
        found = self.function(f"{form}_sparsity_{way}")
        found.restype = ctypes.POINTER(ctypes.c_int)
        pattern = found(place)
        if not pattern:
            return None
        assert pattern[2] == 1
        return pattern[0], pattern[1]

    def shapes(self, form: str, way: str) -> list[tuple[int, int] | None]:
        """Those of all inputs or outputs."""
        count = self.function(f"{form}_n_{way}")()
        assert self.shape(form, way, count) is None
        assert self.shape(form, way, -1) is None
        return [self.shape(form, way, place) for place in range(count)]

    def __call__(self, form: str, *inputs: Array) -> list[Array]:
        """Results of a function that succeeds."""
        status, results = self.call(form, *inputs)
        assert status == 0
        return results

    def call(self, form: str, *inputs: Array) -> tuple[int, list[Array]]:
        """What a function returns, and its results; nothing is written beyond them."""
        sizes = self.shapes(form, "out")
        work = [ctypes.c_int() for _ in range(4)]
        self.function(f"{form}_work")(*map(ctypes.byref, work))
        assert [item.value for item in work] == [len(inputs), len(sizes), 0, 0]
        self.function(f"{form}_work")(None, None, None, None)
        given = [np.asfortranarray(x, float).ravel(order="F") for x in inputs]
        made = [np.full(rows * columns + 1, GUARD) for rows, columns in sizes]
        pointers = [
            (ctypes.c_void_p * len(arrays))(*(x.ctypes.data for x in arrays))
            for arrays in (given, made)
        ]
        status = self.function(form)(*pointers, None, None, None)
        nowhere = (ctypes.c_void_p * len(made))()
        assert self.function(form)(pointers[0], nowhere, None, None, None) == status
        assert all(x[-1] == GUARD for x in made)
        found = zip(made, sizes, strict=True)
        return status, [x[:-1].reshape(size, order="F") for x, size in found]


class Case:
    """A robot's module and its file for acados, with a state and directions."""

    def __init__(self, robot: Robot, libraries: Path) -> None:
        targets = ["numpy", "c", "acados"]
        self.name, self._libraries = robot.name, libraries
        self.folder = kept_folder(robot, DERIVATIVES, targets) / robot.name
        self.model: Model = derived(robot, derivatives=DERIVATIVES)

        def make() -> None:
            self.folder.mkdir()
            for file, text in render_module(self.model, "", find_targets(targets)).items():
                (self.folder / file).write_text(text, encoding="utf-8")

        made_once(self.folder, make)
        sources = [str(self.folder / f"{robot.name}.c")]
        (self.compiled,) = compile_only("gcc", ["-fPIC"], sources, libraries)
        self.module: ModuleType = load(self.folder)
        self.nq, self.nv = len(self.module.COORDINATES), len(self.module.VELOCITIES)
        self.nx, self.nu = self.nq + self.nv, len(self.module.INPUTS)
        rng = np.random.default_rng(3)
        self.x, self.x_dot, self.w = rng.uniform(-0.9, 0.9, (3, self.nx))
        self.u = rng.uniform(1.0, 3.0, self.nu)
        sizes = shapes(self.nx, self.nu, 0)
        given = {form: [rng.normal(size=size) for size in sizes[form][0][:-1]] for form in sizes}
        self.inputs: dict[str, list[Array]] = given

    def library(self, *options: str) -> Library:
        """The C code, compiled without optimisation."""
        path = self._libraries / f"library{len(list(self._libraries.glob('*.so')))}.so"
        sources = [str(self.folder / f"{self.name}_acados.c"), str(self.compiled)]
        build("gcc", ["-shared", "-fPIC", *options], sources, path)
        return Library(self.name, path)

    def unit(self, x: Array) -> tuple[Array, Array, Array]:
        """Q with a quaternion of unit length, the lengths (…, 1), and v."""
        q, v = x[..., : self.nq].copy(), x[..., self.nq :]
        length = np.ones_like(q[..., :1])
        if self.module.ATTITUDE == "quaternion":
            length = np.linalg.norm(q[..., 3:7], axis=-1, keepdims=True)
            q[..., 3:7] /= length
        return q, length, v

    def rates(self, x: Array) -> Array:
        """Rates of q; those of a quaternion are q ω / 2 at any length."""
        q, length, v = self.unit(x)
        found: Array = self.module.coordinate_rates(q, v)
        if self.module.ATTITUDE == "quaternion":
            found[..., 3:7] *= length
        return found

    def field(self, x: Array, u: Array, **constants: Any) -> Array:
        """Rates of x, for states with a leading axis or without."""
        q, _, v = self.unit(x)
        u = np.broadcast_to(u, (*q.shape[:-1], self.nu))
        accelerations = self.module.forward_dynamics(q, v, u, **constants)
        return np.concatenate([self.rates(x), accelerations], axis=-1)

    def residual(self, x: Array, x_dot: Array, u: Array) -> Array:
        """The implicit equations."""
        q, _, v = self.unit(x)
        q_dot, a = np.split(np.broadcast_to(x_dot, x.shape), [self.nq], axis=-1)
        driven = np.einsum("...ij,...j->...i", self.module.input_matrix(q), u)
        forces = self.module.inverse_dynamics(q, v, a) - driven
        return np.concatenate([q_dot - self.rates(x), forces], axis=-1)

    def step(self, x: Array, u: Array) -> Array:
        """A step of the classical method."""
        first = self.field(x, u)
        second = self.field(x + STEP / 2 * first, u)
        third = self.field(x + STEP / 2 * second, u)
        fourth = self.field(x + STEP * third, u)
        return x + STEP / 6 * (first + 2 * second + 2 * third + fourth)


def slopes(function: Any, *arguments: Array) -> list[Array]:
    """Derivatives of a function of one state by each argument, by central differences."""
    found = []
    for place, argument in enumerate(arguments):
        columns = []
        for direction in np.eye(len(argument)):

            def moved(time: Array, place: int = place, direction: Array = direction) -> Array:
                rows = []
                for t in time:
                    given = list(arguments)
                    given[place] = given[place] + t * direction
                    rows.append(function(*given))
                return np.stack(rows)

            columns.append(rate(moved, np.zeros(1), 0.004)[0])
        shape = (len(argument), *np.shape(function(*arguments)))
        found.append(np.moveaxis(np.reshape(columns, shape), 0, -1))
    return found


def near(ours: Array, theirs: Array, limit: float = 1e-9) -> None:
    """Fail unless an array is what it should be, as a share of its largest entry."""
    assert ours.shape == theirs.shape
    largest = np.abs(theirs).max(initial=1.0)
    assert np.abs(ours - theirs).max(initial=0.0) < limit * largest


EMPTY = np.zeros((0, 1))
H = np.array([STEP])
ROBOTS = {
    "angles": lambda: paper_family(4, 1),
    "quaternion_tree": lambda: replace(random_tree(145, "quaternion"), name="tree"),
    "no_inputs": lambda: replace(read_robot("quadrotor")[0], name="buoy", thrusters=()),
}


@pytest.fixture(scope="module", params=ROBOTS)
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    return Case(ROBOTS[request.param](), tmp_path_factory.mktemp("acados"))


@pytest.fixture(scope="module")
def library(case: Case) -> Library:
    return case.library()


def test_arguments_are_those_of_acados(case: Case, library: Library) -> None:
    for form, (inputs, outputs) in shapes(case.nx, case.nu, 0).items():
        assert library.shapes(form, "in") == inputs, form
        assert library.shapes(form, "out") == outputs, form


def test_explicit_forms(case: Case, library: Library) -> None:
    x, u, w = case.x, case.u, case.w
    (found,) = library("expl_ode_fun", x, u, EMPTY)
    near(found[:, 0], case.field(x, u), 1e-12)
    by_x, by_u = slopes(case.field, x, u)
    rng = np.random.default_rng(4)
    moved_x, moved_u = rng.normal(size=(case.nx, case.nx)), rng.normal(size=(case.nx, case.nu))
    same, along_x, along_u = library("expl_vde_forw", x, moved_x, moved_u, u, EMPTY)
    near(same[:, 0], case.field(x, u), 1e-11)
    near(along_x, by_x @ moved_x)
    near(along_u, by_x @ moved_u + by_u)
    (back,) = library("expl_vde_adj", x, w, u, EMPTY)
    both = np.hstack([by_x, by_u])
    near(back[:, 0], both.T @ w)

    def gradient(x: Array, u: Array) -> Array:
        return library("expl_vde_adj", x, w, u, EMPTY)[0][:, 0]

    hessian = np.hstack(slopes(gradient, x, u))
    block = np.eye(case.nx + case.nu)
    block[: case.nx] = np.hstack([moved_x, moved_u])
    back, lower = library("expl_ode_hess", x, moved_x, moved_u, w, u, EMPTY)
    near(back[:, 0], both.T @ w)
    curved = block.T @ hessian @ block
    places = [(i, j) for j in range(len(curved)) for i in range(j, len(curved))]
    near(lower[:, 0], np.array([curved[i, j] for i, j in places]), 1e-8)


def test_implicit_forms(case: Case, library: Library) -> None:
    x, x_dot, u, w = case.x, case.x_dot, case.u, case.w
    given = x, x_dot, u, np.zeros((0, 0)), np.zeros((0, 0)), EMPTY
    (found,) = library("impl_dae_fun", *given)
    near(found[:, 0], case.residual(x, x_dot, u), 1e-12)
    solved = case.field(x, u)
    near(library("impl_dae_fun", x, solved, *given[2:])[0], np.zeros((case.nx, 1)), 1e-11)
    by = slopes(case.residual, x, x_dot, u)
    for form, places in (
        ("impl_dae_fun_jac_x_xdot_z", [0, 1]),
        ("impl_dae_fun_jac_x_xdot_u", [0, 1, 2]),
        ("impl_dae_fun_jac_x_xdot_u_z", [0, 1, 2]),
        ("impl_dae_jac_x_xdot_u_z", [0, 1, 2]),
    ):
        results = library(form, *given)
        if "fun" in form:
            near(results.pop(0)[:, 0], case.residual(x, x_dot, u), 1e-11)
        assert not sum(result.size for result in results[len(places) :])
        for place, ours in zip(places, results[: len(places)], strict=True):
            near(ours, by[place])

    def gradient(x: Array, x_dot: Array, u: Array) -> Array:
        parts = library("impl_dae_jac_x_xdot_u_z", x, x_dot, u, *given[3:])[:3]
        return np.hstack(parts).T @ w

    hessian = np.hstack(slopes(gradient, x, x_dot, u))
    near(library("impl_dae_hess", *given[:4], w, *given[4:])[0], hessian, 1e-8)


def test_discrete_forms(case: Case, library: Library) -> None:
    x, u, w = case.x, case.u, case.w
    next_x = case.step(x, u)
    near(library("dyn_disc_phi_fun", x, u, H)[0][:, 0], next_x, 1e-13)
    by_x, by_u = slopes(case.step, x, u)
    same, transposed = library("dyn_disc_phi_fun_jac", x, u, H)
    near(same[:, 0], next_x, 1e-13)
    near(transposed, np.hstack([by_u, by_x]).T)

    def gradient(u: Array, x: Array) -> Array:
        return library("dyn_disc_phi_fun_jac", x, u, H)[1] @ w

    same, transposed, hessian = library("dyn_disc_phi_fun_jac_hess", x, u, w, H)
    near(same[:, 0], next_x, 1e-13)
    near(transposed, np.hstack([by_u, by_x]).T)
    near(hessian, np.hstack(slopes(gradient, u, x)), 1e-8)


OPTIONS = {
    "parameters": ["PARAMETERS"],
    "a constant step": [f"STEP={STEP}"],
    "parameters and a constant step": ["PARAMETERS", f"STEP={STEP}"],
}


@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
def test_parameters_and_steps_are_given_where_the_source_is_compiled_so(
    options: list[str], case: Case, library: Library
) -> None:
    changed = case.library(*(f"-D{case.name.upper()}_ACADOS_{option}" for option in options))
    values = np.array(list(case.module.PARAMETERS.values()) if "PARAMETERS" in options else [])
    values_and_step = values if f"STEP={STEP}" in options else np.append(values, STEP)
    for form, (inputs, outputs) in shapes(case.nx, case.nu, len(values)).items():
        steps = "dyn" in form
        last = values_and_step if steps else values
        assert changed.shapes(form, "in") == [*inputs[:-1], (len(last), 1)], form
        assert changed.shapes(form, "out") == outputs, form
        theirs = library(form, *case.inputs[form], H if steps else EMPTY)
        for one, other in zip(changed(form, *case.inputs[form], last), theirs, strict=True):
            near(one, other, 1e-12)


def test_parameters_that_vary_change_the_results(case: Case) -> None:
    changed = case.library(f"-D{case.name.upper()}_ACADOS_PARAMETERS")
    values = case.module.PARAMETERS | {"gravity": 1.62}
    (found,) = changed("expl_ode_fun", case.x, case.u, np.array(list(values.values())))
    constants = case.module.prepare({"gravity": 1.62})
    near(found[:, 0], case.field(case.x, case.u, constants=constants), 1e-12)


def test_results_are_nan_where_the_parameters_are_of_no_use(case: Case) -> None:
    """Acados does not look at what a function returns."""
    changed = case.library(f"-D{case.name.upper()}_ACADOS_PARAMETERS")
    values = np.array([*(case.module.PARAMETERS | {"gravity": np.nan}).values(), STEP])
    for form, inputs in case.inputs.items():
        status, results = changed.call(form, *inputs, values)
        assert status == 1, form
        assert all(np.isnan(result).all() for result in results), form


@pytest.mark.parametrize("compiler", ["gcc", "clang++"])
def test_it_compiles_silently(compiler: str, case: Case, tmp_path: Path) -> None:
    upper, sources = case.name.upper(), [str(case.folder / f"{case.name}_acados.c")]
    compile_only(compiler, [], sources, tmp_path)
    compile_only(compiler, [f"-D{upper}_ACADOS_PARAMETERS"], sources, tmp_path)


PARTS = {
    "no derivatives": (),
    "slopes": DERIVATIVES[:1],
    "gradients": DERIVATIVES[1:2],
    "curvatures": DERIVATIVES[1:3],
    "implicit slopes": (DERIVATIVES[3], DERIVATIVES[6]),
    "implicit curvatures": DERIVATIVES[4:],
}


@pytest.mark.parametrize("names", PARTS.values(), ids=PARTS)
def test_functions_that_need_others_are_missing_and_the_comment_says_what_brings_them(
    names: tuple[str, ...], case: Case, tmp_path: Path
) -> None:
    chosen = (*default_functions(), *names)
    model = replace(case.model, functions=chosen)
    target = TARGETS["acados"]
    template = "acados_source.c.jinja"
    text = render(template, target.context(model, target.printer, [])[template][""])
    (tmp_path / "part.c").write_text(text, encoding="utf-8")
    include = f"-I{case.folder}"
    compile_only("gcc", [include], [str(tmp_path / "part.c")], tmp_path)
    there, _, missing = text.partition("#include")[0].partition("Missing are")
    for form in shapes(1, 1, 0):
        words = set(re.findall(r"\w+", there if f"int MODULE({form})(" in text else missing))
        assert f"{case.name}_{form}" in words, form
    assert all(name in missing for name in DERIVATIVES if name not in names)


def test_without_functions_that_it_links_it_says_which_are_missing(case: Case) -> None:
    target = TARGETS["acados"]
    model = replace(case.model, functions=("mass_matrix",))
    with pytest.raises(UsageError, match="add forward_dynamics and coordinate_rates to --func"):
        target.context(model, target.printer, [])
    model = replace(case.model, functions=("forward_dynamics", "coordinate_rates"))
    text = target.context(model, target.printer, [])["acados_source.c.jinja"][""]
    assert [form.name for form in text["forms"]] == ["expl_ode_fun", "dyn_disc_phi_fun"]


def test_the_target_needs_that_of_c() -> None:
    with pytest.raises(UsageError, match=r"--target acados: .* add --target c"):
        find_targets(["acados"])


class StandIn(ModuleType):
    """What stands for acados_template: it generates files as acados does, and compiles them."""

    class AcadosModel(SimpleNamespace):
        """A model."""

    class AcadosOcp(SimpleNamespace):
        """A problem."""

    class AcadosOcpSolver:
        """A solver that is no more than the functions of the model, in `functions`."""

        def __init__(self, ocp: Any, generate: bool = True) -> None:
            if generate:
                self.generate(ocp, verbose=False)
            folder = Path(ocp.code_gen_options.code_export_directory)
            self.build(str(folder), verbose=False)
            # A library of a path that is open already would not be loaded again.
            kind = ocp.solver_options.integrator_type
            (folder / "solver.so").rename(folder / f"{kind}{generate}.so")
            self.functions = Library(ocp.model.name, folder / f"{kind}{generate}.so")

        @staticmethod
        def generate(ocp: Any, verbose: bool = True) -> None:
            """Write what is to be replaced."""
            name = ocp.model.name
            folder = Path(ocp.code_gen_options.code_export_directory) / f"{name}_model"
            folder.mkdir(exist_ok=True)
            for form in ocp.forms:
                (folder / f"{name}_{form}.c").write_text("#error this was to be replaced")

        @staticmethod
        def build(code_export_dir: str, verbose: bool = True) -> None:
            """Compile what is in the folder of the model."""
            sources = sorted(map(str, Path(code_export_dir).glob("*_model/*.c")))
            output = f"{code_export_dir}/solver.so"
            compiled([tool("gcc"), "-shared", "-fPIC", *sources, "-lm"], Path(output))


@pytest.fixture
def script(case: Case, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The emitted script, with what stands for acados."""
    monkeypatch.setitem(sys.modules, "acados_template", StandIn("acados_template"))
    place = case.folder / f"{case.name}_acados.py"
    spec = importlib.util.spec_from_file_location("script", place)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# What acados generates for an integrator type, without exact Hessians.
EXPLICIT = ["expl_ode_fun", "expl_vde_forw", "expl_vde_adj"]
DISCRETE = ["dyn_disc_phi_fun", "dyn_disc_phi_fun_jac"]
IMPLICIT = [
    *("impl_dae_fun", "impl_dae_fun_jac_x_xdot_z", "impl_dae_fun_jac_x_xdot_u_z"),
    *("impl_dae_fun_jac_x_xdot_u", "impl_dae_jac_x_xdot_u_z"),
]
GENERATED = {"ERK": EXPLICIT, "IRK": IMPLICIT, "LIFTED_IRK": IMPLICIT, "DISCRETE": DISCRETE}


def problem(model: Any, folder: Path, kind: str = "DISCRETE", **options: Any) -> Any:
    """A problem of twenty steps, for which acados generates all functions of a kind."""
    named = {"tf": 20 * STEP, "N_horizon": 20, "shooting_nodes": None, "time_steps": None}
    return StandIn.AcadosOcp(
        model=model,
        code_gen_options=SimpleNamespace(code_export_directory=str(folder)),
        forms=GENERATED.get(kind, []),
        solver_options=SimpleNamespace(integrator_type=kind, **named | options),
    )


def test_the_script_puts_the_functions_in_their_places(
    case: Case, script: ModuleType, tmp_path: Path
) -> None:
    model = script.model()
    assert (model.x.shape, model.u.shape, model.p.shape) == ((case.nx, 1), (case.nu, 1), (0, 1))
    assert model.disc_dyn_expr.shape == model.f_expl_expr.shape == (case.nx, 1)
    assert script.PARAMETERS == case.module.PARAMETERS
    solver = script.solver(problem(model, tmp_path))
    next_x = case.step(case.x, case.u)
    near(solver.functions("dyn_disc_phi_fun", case.x, case.u, EMPTY)[0][:, 0], next_x, 1e-12)


@pytest.mark.parametrize("case", ["no_inputs"], indirect=True)
def test_the_script_leaves_nothing_of_another_integrator(
    case: Case, script: ModuleType, tmp_path: Path
) -> None:
    given = case.inputs
    stale = tmp_path / f"{case.name}_model" / f"{case.name}_expl_vde_forw_p.c"
    for kind, form in (
        *(("IRK", "impl_dae_fun"), ("DISCRETE", "dyn_disc_phi_fun"), ("ERK", "expl_ode_fun")),
        *(("LIFTED_IRK", "impl_dae_fun"), ("DISCRETE", "dyn_disc_phi_fun")),
    ):
        solver = script.solver(problem(script.model(), tmp_path, kind))
        (result, *_) = solver.functions(form, *given[form], EMPTY)
        assert np.isfinite(result).all()
        found = {path.stem for path in stale.parent.glob("*.c")}
        assert found == {f"{case.name}_{form}" for form in GENERATED[kind]}
        stale.write_text("#error this is stale")
    stale.unlink()
    again = script.solver(problem(script.model(), tmp_path, kind), generate=False)
    assert again.functions(form, *given[form], EMPTY)[0] == pytest.approx(result)


def test_the_script_refuses_what_the_functions_do_not_serve(
    case: Case, script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uneven = problem(script.model(), tmp_path, time_steps=[0.1, 0.2])
    with pytest.raises(ValueError, match=r"take model\(step=True\)"):
        script.solver(uneven)
    nodes = problem(script.model(), tmp_path, shooting_nodes=[0.0, 0.1, 0.3])
    with pytest.raises(ValueError, match=r"take model\(step=True\)"):
        script.solver(nodes)
    wrong = script.model()
    wrong.p = np.zeros((2, 1))
    with pytest.raises(ValueError, match=r"p has 2 entries.* must be what model"):
        script.solver(problem(wrong, tmp_path))
    count = len(script.PARAMETERS)
    for kind, parameters in (("ERK", False), ("IRK", True)):
        model = script.model(parameters=parameters, step=True)
        with pytest.raises(
            ValueError, match=rf"p has {parameters * count + 1} .*{kind}: take model\(step=False\)"
        ):
            script.solver(problem(model, tmp_path, kind))
    with pytest.raises(ValueError, match="served are ERK, IRK, LIFTED_IRK, DISCRETE"):
        script.solver(problem(script.model(), tmp_path, "GNSF"))
    monkeypatch.setattr(script, "FUNCTIONS", ("dyn_disc_phi_fun",))
    with pytest.raises(ValueError, match="the module lacks dyn_disc_phi_fun_jac"):
        script.solver(problem(script.model(), tmp_path))
    monkeypatch.setitem(sys.modules, "acados_template", None)
    with pytest.raises(ModuleNotFoundError, match="acados_template is not installed"):
        script.model()
