"""Model predictive control: the problem's derivatives, and flights that keep near their path."""

from __future__ import annotations

import re
import shlex
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from support.pages import blocks, run_python
from support.tools import missing, tool

from examples import nmpc
from examples.task import Circle, Task, circle_task, module_of
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.robot.file import parse_robot, read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.load import load

try:
    import casadi
except ImportError:
    missing("casadi is not installed")

from examples import controller as control
from examples.controller import (
    Controller,
    SolverStuckError,
    control_steps,
    fly,
    solver_plugin,
)
from examples.tracking_problem import (
    DERIVATIVES,
    Prediction,
    TrackingProblem,
    compiled,
    cost_to_go,
    predicted_robot,
    traced,
)

pytestmark = pytest.mark.usefixtures("derived_once")

H = nmpc.STEP
PAPER = Circle(
    posture={"theta_8": -1.871, "theta_9": 1.39}, radius=0.5, thrust=(-38.0, 38.0), effort=45.0
)


@pytest.fixture(scope="module")
def damped() -> Robot:
    """A small robot with dampers in its joints."""
    robot, _ = read_robot("quadrotor_2link")
    links = tuple(
        replace(link, passive=replace(link.passive, damping=0.3 + place / 10))
        for place, link in enumerate(robot.links)
    )
    return replace(robot, links=links)


@pytest.fixture(scope="module")
def plant(damped: Robot, tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    return load(module_of(damped, tmp_path_factory.mktemp("plant"), ("step_rk4",)))


@pytest.fixture(scope="module")
def predicted(damped: Robot, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("predicted")
    return module_of(predicted_robot(damped, H), out, DERIVATIVES)


@pytest.fixture(scope="module")
def prediction(predicted: Path, task: Task) -> Prediction:
    return traced(load(predicted, backend="casadi"), task.frame, H)


@pytest.fixture(scope="module")
def task(plant: ModuleType) -> Task:
    circle = Circle(None, {"theta_6": -1.0}, 0.05, 4.0, thrust=(-60.0, 60.0), effort=30.0)
    return circle_task(plant, circle)


def test_the_step_takes_the_dampers_torques_at_its_end(
    damped: Robot, plant: ModuleType, predicted: Path
) -> None:
    rng = np.random.default_rng(5)
    q, v = rng.uniform(-0.5, 0.5, (2, len(plant.COORDINATES)))
    u = rng.uniform(0.0, 5.0, len(plant.INPUTS))
    _, v_next = load(predicted).step_euler(q, v, u, H)
    damping = np.zeros(len(v))
    damping[Vehicle(plant).arm_rates] = [link.passive.damping for link in damped.links]
    force = plant.inverse_dynamics(q, v, (v_next - v) / H) + damping * (v_next - v)
    assert np.allclose(force, plant.input_matrix(q) @ u, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", ["quadrotor_2link", "quadrotor"])
def test_compiled_functions_have_the_jacobians_of_casadi(name: str, tmp_path: Path) -> None:
    """With angles and with a quaternion, of any length: by its entries."""
    module = load(module_of(read_robot(name)[0], tmp_path, DERIVATIVES), backend="casadi")
    ours, theirs = (
        f(module, "base" if name == "quadrotor" else "tip", H) for f in (compiled, traced)
    )
    q, v, u = (
        np.linspace(0.2, -0.7, len(x))
        for x in (module.COORDINATES, module.VELOCITIES, module.INPUTS)
    )
    for one, other, given in (
        (ours.step, theirs.step, (q, v, u)),
        (ours.point, theirs.point, (q,)),
    ):
        assert one.is_a("External")
        nothing = [casadi.DM(*one.size_out(k)) for k in range(one.n_out())]
        pairs = zip(
            [*one.call(given), *one.jacobian().call([*given, *nothing])],
            [*other.call(given), *other.jacobian().call([*given, *nothing])],
            strict=True,
        )
        for found, expected in pairs:
            assert np.allclose(found.full(), expected.full(), rtol=0, atol=1e-12)


@pytest.mark.parametrize("plugin", ["fatrop", "ipopt"])
def test_derivatives_of_the_problem(prediction: Prediction, task: Task, plugin: str) -> None:
    """Against differences; the Hessian is that of the squares of the linearised residuals."""
    nodes = 3
    rng = np.random.default_rng(8)
    stage = rng.uniform(0.1, 1.0, len(task.weights.stage))
    weights = replace(task.weights, point=3.0, stage=stage)
    problem = TrackingProblem(prediction, weights, nodes)
    solver = problem.solver(plugin, {"print_level": 0})
    x = np.tile(weights.wanted, nodes) + rng.uniform(-0.2, 0.2, problem.stage * nodes)
    p = rng.uniform(-0.3, 0.3, 2 * problem.states + 3 * nodes)

    def values(name: str, output: int, *more: float) -> np.ndarray:
        return np.array(casadi.densify(solver.get_function(name).call([x, p, *more])[output]))

    def differences(name: str) -> np.ndarray:
        function, step = solver.get_function(name), 1e-5
        columns = [
            (np.array(function(x + step * e, p)) - np.array(function(x - step * e, p))) / (2 * step)
            for e in np.eye(len(x))
        ]
        return np.hstack(columns)

    slope = values("nlp_grad_f", -1).ravel()
    assert np.allclose(slope, differences("nlp_f"), rtol=0, atol=1e-7)
    assert np.allclose(values("nlp_jac_g", 1), differences("nlp_g"), rtol=0, atol=1e-7)
    hessian = values("nlp_hess_l", -1, 2.0, np.zeros(problem.states * nodes)) / 2.0
    by_q = prediction.point.jacobian()
    wanted = np.zeros((len(x), len(x)))
    for k in range(nodes):
        begin = problem.stage * k
        stage = slice(begin, begin + problem.stage)
        wanted[stage, stage] = np.diag(weights.stage)
        q = slice(begin + problem.inputs, begin + problem.inputs + prediction.point.size1_in(0))
        rows = np.array(casadi.densify(by_q(x[q], casadi.DM(3, 1))))
        wanted[q, q] += weights.point * rows.T @ rows
    # The end's base is where the point's deviation, less that by the other coordinates, puts it.
    hover = weights.wanted[problem.inputs : problem.stage][: len(task.q)]
    linear = np.array(casadi.densify(by_q(hover, casadi.DM(3, 1))))
    by_last = np.eye(problem.states)
    by_last[weights.position, : len(task.q)] += rows - linear
    end = slice(-problem.states, None)
    wanted[end, end] += by_last.T @ cost_to_go(prediction, weights) @ by_last
    assert np.allclose(hessian, wanted if plugin == "fatrop" else np.triu(wanted), rtol=1e-12)


def test_the_tip_keeps_near_its_path(plant: ModuleType, prediction: Prediction, task: Task) -> None:
    """Without a compiler: CasADi's symbols predict, and NumPy flies."""
    flown = fly(plant, Controller(prediction, task, H), 1.0)
    assert flown.ended is None
    assert all(solution.succeeded for solution in flown.solutions)
    assert np.ptp(flown.wanted, axis=0).max() > 0.02
    assert flown.error.max() < 0.003
    low, high = task.limits[:, : len(plant.INPUTS)]
    assert (low <= flown.u).all()
    assert (flown.u <= high).all()


def test_states_that_are_carried_along_move_as_the_point_is_to(
    plant: ModuleType, shipped: Callable[[str], ModuleType]
) -> None:
    """With a quaternion too, where v is in the axes of a base that leans."""
    times, dt = np.array([0.0, 0.4, 0.9, 1.5]), 1e-6
    posture = {f"flying_arm_5__j_link_{i}_link_{i + 1}": 0.4 for i in (1, 3)}
    bent = Circle(None, {"theta_6": -1.0}, 0.2, 1.5, thrust=(-60.0, 60.0))
    leaning = Circle(None, posture, 0.2, 1.5)
    for module, circle in ((plant, bent), (shipped("hextilt_flying_arm_5"), leaning)):
        task = circle_task(module, circle)
        q, v = np.split(task.carried(times), [len(task.q)], axis=-1)
        place = module.FRAMES.index(task.frame)
        point = module.frame_poses(q)[:, place, :3, 3]
        assert np.allclose(point, task.path(times), rtol=0, atol=1e-12)
        later = module.integrate(q, v * dt)
        moved = (module.frame_poses(later)[:, place, :3, 3] - point) / dt
        assert np.abs(moved[1:3]).max() > 0.1
        assert np.allclose(moved, task.path.velocity(times), rtol=0, atol=1e-5)


def test_the_cost_to_go_is_that_of_the_best_regulator(prediction: Prediction, task: Task) -> None:
    """Against SciPy's solution of the Riccati equation for a horizon without an end."""
    q, v = task.q, task.v
    nq, nu = len(q), task.limits.shape[1] - len(q) - len(v)
    nothing = [casadi.DM(len(x), 1) for x in (q, v)]
    jacobian = prediction.step.jacobian().call([q, v, task.weights.wanted[:nu], *nothing])
    q_q, q_v, q_u, v_q, v_v, v_u = (np.array(casadi.densify(block)) for block in jacobian)
    a, b = np.block([[q_q, q_v], [v_q, v_v]]), np.vstack([q_u, v_u])
    states = np.diag(task.weights.stage[nu:])
    by_q = np.array(casadi.densify(prediction.point.jacobian()(q, casadi.DM(3, 1))))
    states[:nq, :nq] += task.weights.point * by_q.T @ by_q
    whole = solve_discrete_are(a, b, states, np.diag(task.weights.stage[:nu]))
    ahead = cost_to_go(prediction, task.weights)
    assert np.allclose(ahead, whole - states, rtol=0, atol=1e-6 * np.abs(whole).max())


def test_a_short_horizon_is_stable(plant: ModuleType, prediction: Prediction) -> None:
    """Without the cost of what follows, the machine soon tips over about its tip."""
    circle = Circle(None, {"theta_6": -1.0}, 0.05, 1e3, thrust=(-60.0, 60.0), effort=30.0)
    task = circle_task(plant, circle)
    pushed = 0.002 * np.eye(len(task.v))[Vehicle(plant).layout.v.attitude.start]
    flown = fly(plant, Controller(prediction, replace(task, v=pushed), H, nodes=4), 3.0)
    assert flown.ended is None
    assert all(solution.succeeded for solution in flown.solutions)
    assert np.abs(flown.v[-1]).max() < 1e-3
    assert flown.error.max() < 1e-3


@pytest.mark.slow
def test_the_papers_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With compiled functions and their exact derivatives, as the command flies them."""
    monkeypatch.setenv("CC", f"{tool('cc')} -O0")
    flown = nmpc.track("hexarotor_3link", tmp_path, PAPER)
    assert (flown.ended, len(flown.time)) == (None, 400)
    assert all(solution.succeeded for solution in flown.solutions)
    assert np.ptp(flown.wanted, axis=0).max() == pytest.approx(1.0, abs=1e-3)
    assert flown.error.max() < 0.005
    thrusts = flown.u[:, :6]
    assert 37.5 < thrusts.max() <= 38.0
    assert thrusts.min() >= -38.0
    assert np.abs(flown.u[:, 6:]).max() <= 45.0
    assert "400 control steps" in nmpc.report(flown)


@pytest.mark.exhaustive
@pytest.mark.slow
def test_the_flight_of_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CC", f"{tool('cc')} -O0")
    time, point, wanted, u = run_python("docs/howto/nmpc.md")["fly"](tmp_path)
    assert time[-1] == pytest.approx(4.0)
    assert len(u) == len(time) == 200
    assert np.ptp(wanted, axis=0).max() > 0.1
    assert np.linalg.norm(point - wanted, axis=1).max() < 0.002
    assert "200 control steps" in capsys.readouterr().out


@pytest.mark.slow
def test_the_problem_of_ones_own_of_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With IPOPT, with fatrop, and the example's controller with a delay of a step."""
    monkeypatch.setenv("CC", f"{tool('cc')} -O0")
    names, nlpsol = run_python("docs/howto/own-nmpc.md"), casadi.nlpsol
    flight, missed, converged = names["fly_own"](tmp_path)
    assert (flight.stopped, converged) == ("", [True] * 120)
    assert missed.max() < 1e-4
    name = "hextilt_flying_arm_5"
    plant, folder = load(tmp_path / name, backend="c"), tmp_path / f"{name}_predicted"
    task = circle_task(plant, Circle())
    model = compiled(load(folder, backend="casadi"), task.frame, H)
    place = {"base.path.position": task.q[:3].tolist(), "duration": 1}
    scenario = read_scenario("hover", place | {"integration": {"method": "rk4", "step": 1e-4}})
    late = names["OneStepLate"](model, Controller(model, task, H), task.weights.wanted[:11])
    assert not simulate(plant, scenario, late).stopped

    def by_fatrop(name: str, _: str, of: dict[str, casadi.MX], told: dict) -> casadi.Function:
        x, p, factor, multipliers = given = told["hess_lag"].mx_in()
        hessian = casadi.triu2symm(told["hess_lag"](*given))
        problem = casadi.Function("problem", [of["x"], of["p"]], [of["f"], of["g"]])
        cost, gaps = problem(x, p)
        options = names["fatrop_options"](x, p, factor, multipliers, hessian, gaps)
        return nlpsol(name, "fatrop", {"x": x, "p": p, "f": cost, "g": gaps}, options)

    monkeypatch.setattr(casadi, "nlpsol", by_fatrop)
    monkeypatch.setitem(names, "generate", lambda *_, **__: tmp_path / name)
    monkeypatch.setattr(names["task"], "module_of", lambda *_: folder)
    flight, missed, converged = names["fly_own"](tmp_path)
    assert (flight.stopped, converged) == ("", [True] * 120)
    assert missed.max() < 1e-4


class Scripted:
    """A solver that finds what it is told to, and remembers how it was called."""

    def __init__(self, values: list[float]) -> None:
        self.values = iter(values)
        self.guesses: list[dict[str, np.ndarray]] = []

    def __call__(self, **given: np.ndarray) -> dict[str, np.ndarray]:
        """Values that count up from the next one told."""
        self.guesses.append(given)
        value = next(self.values)
        return {name: value + np.arange(given[f"{name}0"].size) for name in ("x", "lam_x", "lam_g")}

    def stats(self) -> dict[str, object]:
        """It never converges."""
        return {"iter_count": 20, "success": False}


def test_guesses_are_the_last_solution_where_there_is_one(
    prediction: Prediction, task: Task
) -> None:
    controller = Controller(prediction, task, H, nodes=3)
    solver = controller._solver = Scripted([0.5, np.nan, 0.0])
    u = [controller.inputs(k * H, task.q, task.v) for k in range(3)]
    nu, stage = len(u[0]), task.limits.shape[1]
    first, second, third = (given["x0"].reshape(3, stage) for given in solver.guesses)
    times = H * np.arange(1.0, 4.0)
    for start, guess in ((0.0, first), (2 * H, third)):
        assert np.array_equal(guess[:, nu:], task.carried(start + times))
        assert np.array_equal(guess[:, :nu], np.tile(task.weights.wanted[:nu], (3, 1)))
    found = 0.5 + np.arange(3 * stage).reshape(3, stage)
    assert np.array_equal(second, found[[1, 2, 2]])
    for name in ("lam_x0", "lam_g0"):
        one, two, three = (given[name] for given in solver.guesses)
        assert not one.any()
        assert two.all()
        assert not three.any()
    low, high = task.limits[:, :nu]
    assert np.array_equal(u[0], np.clip(found[0, :nu], low, high))


def test_a_solver_that_does_not_come_back_is_not_waited_for(
    plant: ModuleType, prediction: Prediction, task: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller, back = Controller(prediction, task, H, nodes=3), threading.Event()
    solver = controller._solver
    monkeypatch.setattr(controller, "_solver", lambda **given: back.wait(60))
    monkeypatch.setattr(control, "_PATIENCE", 0.1)
    told = r"solver fatrop: has not come back for 0\.1 s, at 0\.00 s of the flight"
    with pytest.raises(SolverStuckError, match=told):
        fly(plant, controller, 0.1)

    class Stuck(Scripted):
        def __call__(self, **given: np.ndarray) -> dict[str, np.ndarray]:
            if self.guesses:
                back.wait(60)
            self.guesses.append(given)
            return solver(**given)

    monkeypatch.setattr(controller, "_solver", Stuck([]))
    flown = fly(plant, controller, 0.1)
    back.set()
    assert len(flown.time) == 1
    assert "the flight ended early: solver fatrop: has not come back" in nmpc.report(flown)


def test_errors_of_the_solver_are_raised(prediction: Prediction, task: Task) -> None:
    controller = Controller(prediction, task, H, nodes=3)
    controller._solver = lambda **given: 1 / 0
    with pytest.raises(ZeroDivisionError):
        controller.inputs(0.0, task.q, task.v)


@pytest.mark.parametrize("plugin", ["fatrop", "ipopt"])
def test_a_flight_that_is_lost_ends(plant: ModuleType, prediction: Prediction, plugin: str) -> None:
    """A circle in a tenth of a second."""
    circle = Circle(None, {"theta_6": -1.0}, 0.2, 0.1, thrust=(-60.0, 60.0), effort=30.0)
    task = circle_task(plant, circle)
    flown = fly(plant, Controller(prediction, task, H, plugin=plugin), 1.0)
    assert 1 <= len(flown.time) < 50
    told = "the flight ended early: .* off its path .*\n[0-9]+ control steps of"
    assert re.match(told, nmpc.report(flown))


def test_what_is_wrong_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], plant: ModuleType
) -> None:
    with pytest.raises(UsageError, match="has no such frame; its frames: base, tip"):
        circle_task(plant, Circle(frame="hand"))
    monkeypatch.setitem(sys.modules, "casadi", None)
    assert nmpc.main(["hexarotor_3link"]) == 2
    assert "gibbs_codegen with its extra casadi" in capsys.readouterr().err


# Without gravity it needs no thrust, and it has no rotors.
DRIFTING = """
name = "drifting"
gravity = 0.0

[base]
attitude = "quaternion"
mass = 2.0
com = [0, 0, 0]
inertia = [0.02, 0.03, 0.04, 0, 0, 0]

[[frame]]
name = "camera"
xyz = [0.2, 0, 0]
"""


def test_robots_that_the_weights_do_not_suit_are_refused(
    plant: ModuleType, shipped: Callable[[str], ModuleType], tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=r"'base': is at the base .*; choose one .*: tip$"):
        circle_task(plant, Circle(frame="base"))
    with pytest.raises(UsageError, match=r"'tip': is at the base of hexarotor, .* needs an arm"):
        circle_task(shipped("hexarotor"), Circle())
    drifting = load(module_of(parse_robot(DRIFTING), tmp_path, ()))
    with pytest.raises(UsageError, match=r"drifting: no thrust carries it in hover, .* rotors"):
        circle_task(drifting, Circle())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("--duration 0", "duration: must be a finite time above zero, s, not 0"),
        ("--duration -4", "duration: must be a finite time above zero, s, not -4"),
        ("--until 0.005", "duration of the flight: must be at least one step .* 0.02 s"),
        ("--until 0", "duration of the flight: must be at least one step .*, not 0 s"),
        ("--until nan", "duration of the flight: must be at least one step .* NaN"),
        ("--radius nan", "radius: must be a finite length above zero, m; some are NaN"),
        ("--radius 0", "radius: must be a finite length above zero, m, not 0"),
        ("--effort 0", "effort: must be a torque or force above zero, N m or N, not 0"),
        ("--thrust 60 -60", "thrust: must be the least thrust and a greater one, N, not 60"),
        ("--thrust nan 60", "thrust: must be the least thrust and a greater one, N, not nan"),
        ("--figure no/such.png", "--figure no/such.png: must be a file in a folder that exists"),
        ("--figure flight.txt", "--figure flight.txt: must end with one of .*, .png, "),
    ],
)
def test_what_cannot_be_flown_is_told_first(
    words: str,
    told: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def long(*given: object) -> None:
        pytest.fail("this takes long")

    monkeypatch.setattr(nmpc, "module_of", long)
    assert nmpc.main(["quadrotor_2link", *words.split()]) == 2
    assert re.search(f"^nmpc: {told}", capsys.readouterr().err)


def test_words_that_are_no_posture_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    for word in ("theta", "theta=bent"):
        with pytest.raises(SystemExit):
            nmpc.main(["hexarotor_3link", "--posture", word])
        assert f"--posture: {word}: must be JOINT=VALUE, such as" in capsys.readouterr().err


def test_the_solver_is_one_that_casadi_has(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert solver_plugin(None) == "fatrop"
    with pytest.raises(UsageError, match="solver sqp: unknown; known: fatrop, ipopt"):
        nmpc.track("hexarotor_3link", tmp_path, Circle(), plugin="sqp")
    # As an older CasADi has it.
    monkeypatch.setattr(casadi, "has_nlpsol", "ipopt".__eq__)
    assert solver_plugin(None) == "ipopt"
    with pytest.raises(UsageError, match=r"solver fatrop: CasADi .* since 3\.6\.7 also fatrop"):
        solver_plugin("fatrop")


def test_without_a_compiler_it_says_so(
    plant: ModuleType, predicted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    made = iter([Path(plant.__path__[0]), predicted])
    monkeypatch.setattr(nmpc, "module_of", lambda *given: next(made))
    why = "quadrotor_2link_predicted: its functions are not compiled, .*no-such-compiler.* CC"
    with pytest.raises(UsageError, match=why):
        nmpc.track("quadrotor_2link", predicted, Circle(thrust=(-60.0, 60.0)))


def test_a_flight_has_a_step(plant: ModuleType) -> None:
    with pytest.raises(UsageError, match=r"at least one step of the controller, 0\.02 s"):
        control_steps(0.005, H)
    assert control_steps(0.5, H) == 25


def test_commands_of_the_page_have_options_that_exist() -> None:
    (block,) = blocks("docs/howto/nmpc.md", "sh")
    commands = [
        line.removeprefix("python -m examples.nmpc ")
        for line in block.replace("\\\n", " ").splitlines()
    ]
    first, second = (nmpc.argument_parser().parse_args(shlex.split(c)) for c in commands)
    assert (first.robot, first.duration) == ("hextilt_flying_arm_5", 4.0)
    posture, thrust = dict(second.posture), tuple(second.thrust)
    assert Circle(None, posture, second.radius, 8.0, thrust, second.effort) == PAPER
