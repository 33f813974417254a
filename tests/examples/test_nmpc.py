"""Model predictive control: the problem's derivatives, and flights that keep near their path."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from gibbs_codegen.errors import UsageError
from gibbs_codegen.examples import nmpc
from gibbs_codegen.examples.task import Circle, Task, Weights, circle_task, module_of
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.runtime.load import load
from gibbs_codegen.simulator.vehicle import Vehicle

casadi = pytest.importorskip("casadi")

from gibbs_codegen.examples.controller import Controller  # noqa: E402
from gibbs_codegen.examples.flight import fly  # noqa: E402
from gibbs_codegen.examples.prediction import predicted_robot, traced  # noqa: E402
from gibbs_codegen.examples.tracking_problem import TrackingProblem  # noqa: E402

H = nmpc.STEP
PAPER = Circle(posture={"theta_8": -1.871, "theta_9": 1.39}, radius=0.5, thrust=(-60.0, 60.0))


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
    return module_of(predicted_robot(damped, H), out, ("step_euler",))


@pytest.fixture(scope="module")
def task(plant: ModuleType) -> Task:
    circle = Circle(None, {"theta_6": -1.0}, 0.05, 1.5, thrust=(-60.0, 60.0), effort=30.0)
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


@pytest.mark.parametrize("plugin", ["fatrop", "ipopt"])
def test_derivatives_of_the_problem(predicted: Path, task: Task, plugin: str) -> None:
    """Against differences; the Hessian is that of the squares of the linearised residuals."""
    nodes = 3
    prediction = traced(load(predicted, backend="casadi"), task.frame, H)
    rng = np.random.default_rng(8)
    weights = Weights(3.0, rng.uniform(0.1, 1.0, len(task.weights.stage)), task.weights.wanted)
    problem = TrackingProblem(prediction, weights, nodes)
    solver = problem.solver(plugin, {"print_level": 0})
    x = np.tile(weights.wanted, nodes) + rng.uniform(-0.2, 0.2, problem.stage * nodes)
    p = np.concatenate([x[problem.inputs : problem.stage], rng.uniform(-0.3, 0.3, 3 * nodes)])

    def values(name: str, output: int, *more: float) -> np.ndarray:
        return np.array(casadi.densify(solver.get_function(name).call([x, p, *more])[output]))

    def differences(name: str) -> np.ndarray:
        function, step = solver.get_function(name), 1e-6
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
    assert np.allclose(hessian, wanted if plugin == "fatrop" else np.triu(wanted), rtol=1e-12)


def test_the_tip_keeps_near_its_path(plant: ModuleType, predicted: Path, task: Task) -> None:
    """Without a compiler: CasADi's symbols predict, and NumPy flies."""
    prediction = traced(load(predicted, backend="casadi"), task.frame, H)
    controller = Controller(prediction, task.weights, task.limits, task.path, H)
    flown = fly(plant, task.frame, controller, (task.q, task.v), 0.5)
    assert all(solution.succeeded for solution in flown.solutions)
    assert np.ptp(flown.wanted, axis=0).max() > 0.02
    assert flown.error.max() < 0.003
    low, high = task.limits[:, : len(plant.INPUTS)]
    assert (low - 1e-9 <= flown.u).all()
    assert (flown.u <= high + 1e-9).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "circle", "most"),
    [("hexarotor_3link", PAPER, 0.003), ("hextilt_flying_arm_5", Circle(duration=4.0), 0.001)],
)
def test_robots_that_ship(
    name: str, circle: Circle, most: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With compiled functions and their exact derivatives, as the command flies them."""
    monkeypatch.setenv("CC", "cc -O0")
    flown = nmpc.track(name, tmp_path, circle, until=1.6)
    assert np.ptp(flown.wanted, axis=0).max() > 0.02
    assert flown.error.max() < most
    assert f"{len(flown.time)} control steps" in nmpc.report(flown)


def test_what_is_wrong_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], plant: ModuleType
) -> None:
    with pytest.raises(UsageError, match="has no such frame; its frames: base, tip"):
        circle_task(plant, Circle(frame="hand"))
    monkeypatch.setitem(sys.modules, "casadi", None)
    assert nmpc.main(["hexarotor_3link"]) == 2
    assert "pip install 'gibbs_codegen[casadi]'" in capsys.readouterr().err
