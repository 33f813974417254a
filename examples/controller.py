"""Model predictive control: at every step of a flight the problem is solved from where it is."""

from __future__ import annotations

import math
import threading
import time
from concurrent.futures import Future
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import casadi
import numpy as np

from examples.task import Task
from examples.tracking_problem import Prediction, TrackingProblem
from gibbs_codegen.errors import GibbsCodegenError, UsageError, printable
from gibbs_codegen.flight.analysis.arguments import numbers
from gibbs_codegen.flight.control.sampled_control import Observation
from gibbs_codegen.flight.plant.vehicle import Array

# Solutions are good to this, in the units of the cost and the states.
TOLERANCE = 1e-3
# How long a solver may take, s. Fatrop regularises what it cannot factorise until it can, which is
# never where derivatives are so large that their products over the horizon overflow.
_PATIENCE = 10.0
# Barrier that a solver begins with, since the solution before is near.
_BARRIER = 1e-4
SOLVERS: dict[str, dict[str, Any]] = {
    "fatrop": {"print_level": 0, "tol": TOLERANCE, "mu_init": _BARRIER, "max_iter": 20},
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "tol": TOLERANCE,
        "mu_init": _BARRIER,
        "max_iter": 20,
        "warm_start_init_point": "yes",
    },
}


class SolverStuckError(GibbsCodegenError):
    """A solver that does not come back."""

    exit_code = 1


def solver_plugin(wanted: str | None) -> str:
    """CasADi's solver that is used: the one wanted, or fatrop, or IPOPT where there is no fatrop.

    Raises `UsageError` if it is unknown, or CasADi has no such solver.
    """
    if wanted is None:
        wanted = "fatrop" if casadi.has_nlpsol("fatrop") else "ipopt"
    if wanted not in SOLVERS:
        raise UsageError(f"solver {printable(wanted)}: unknown; known: {', '.join(SOLVERS)}")
    if not casadi.has_nlpsol(wanted):
        raise UsageError(
            f"solver {wanted}: CasADi as it is installed has none; its wheel has ipopt, and since "
            "3.6.7 also fatrop"
        )
    return wanted


@dataclass(frozen=True)
class Solution:
    """How one solution went: seconds of the whole call, and those in the problem's functions.

    The functions' derivatives are among them. `succeeded`: whether the solver converged.
    """

    seconds: float
    in_functions: float
    iterations: int
    succeeded: bool


@dataclass
class Controller:
    """Brings a point along a path, within limits, over a horizon of `nodes` steps of `h`, s.

    `plugin` is as of `solver_plugin`; `solutions` tells how each call of `inputs` went.
    """

    prediction: Prediction
    task: Task
    h: float = 0.02
    nodes: int = 20
    plugin: str | None = None
    solutions: list[Solution] = field(default_factory=list)

    def __post_init__(self) -> None:
        problem = TrackingProblem(self.prediction, self.task.weights, self.nodes)
        self.plugin = solver_plugin(self.plugin)
        self._solver = problem.solver(self.plugin, SOLVERS[self.plugin])
        self._sizes = {"x": problem.stage, "lam_x": problem.stage, "lam_g": problem.states}
        self._inputs = problem.inputs
        low, high = (np.tile(bound, self.nodes) for bound in self.task.limits)
        self._bounds = {"lbx": low, "ubx": high, "lbg": 0.0, "ubg": 0.0}
        self._guess: dict[str, Array] = {}

    @property
    def rate(self) -> float:
        """How often `simulate` asks for inputs, Hz: once in a step."""
        return 1.0 / self.h

    def reset(self) -> None:
        """Forget the solutions, before a flight."""
        self.solutions.clear()
        self._guess = {}

    def __call__(self, seen: Observation) -> Array:
        """The inputs u (nu) of a step, for `simulate`; of the scenario's motion nothing is used.

        Raises `SolverStuckError` if the solver does not come back.
        """
        return self.inputs(seen.time, seen.q, seen.v)

    def inputs(self, now: float, q: Array, v: Array) -> Array:
        """The inputs u (nu), N and N m, of the step that begins now.

        Raises `SolverStuckError` if the solver does not come back.
        """
        ahead = np.asarray(now + self.h * np.arange(1.0, self.nodes + 1))
        guess = self._guess or self._hovering(ahead)
        given: dict[str, Any] = {f"{name}0": values for name, values in guess.items()}
        given["p"] = np.r_[q, v, self.task.path(ahead).ravel(), self.task.carried(ahead[-1])]
        found, seconds = self._solved(given | self._bounds, now)
        told = self._solver.stats()
        within = sum(told[name] for name in told if name.startswith("t_wall_nlp_"))
        self.solutions.append(Solution(seconds, within, told["iter_count"], told["success"]))
        values = {name: np.array(found[name]).ravel() for name in self._sizes}
        # The next solution is guessed to be this one a step later. That is a better guess than
        # hovering even where the solver did not converge, unless it found no numbers.
        self._guess = {
            name: np.concatenate([values[name][size:], values[name][-size:]])
            for name, size in self._sizes.items()
        }
        if not all(np.isfinite(guess).all() for guess in self._guess.values()):
            self._guess = {}
        # Solvers keep to limits as nearly as they converge.
        low, high = self.task.limits[:, : self._inputs]
        return np.asarray(np.clip(values["x"][: self._inputs], low, high))

    def _hovering(self, ahead: Array) -> dict[str, Array]:
        """A guess that depends on no other solution: hovering along the path, at times (nodes)."""
        hover = np.tile(self.task.weights.wanted, (self.nodes, 1))
        hover[:, self._inputs :] = self.task.carried(ahead)
        guess = {name: np.zeros(size * self.nodes) for name, size in self._sizes.items()}
        return guess | {"x": hover.ravel()}

    def _solved(self, given: dict[str, Any], now: float) -> tuple[dict[str, Any], float]:
        """What the solver finds, and how long it takes, s."""
        found: Future[tuple[dict[str, Any], float]] = Future()

        def solve() -> None:
            start = time.perf_counter()
            try:
                found.set_result((self._solver(**given), time.perf_counter() - start))
            except Exception as error:
                found.set_exception(error)

        # Nothing ends a solver that is stuck; but a thread that is a daemon need not be waited for.
        threading.Thread(target=solve, daemon=True).start()
        try:
            return found.result(_PATIENCE)
        except TimeoutError:
            raise SolverStuckError(
                f"solver {self.plugin}: has not come back for {_PATIENCE:g} s, at {now:.2f} s of "
                "the flight; the robot cannot do what it is to do, such as to follow a path so "
                "fast; or, if its arm hangs straight down, it needs a bent one (option --posture)"
            ) from None


# Steps of the plant in a step of the controller, and how much of its fastest decay one covers: a
# Runge–Kutta method of fourth order is stable up to 2.7.
_FEWEST_STEPS, _DECAY = 20, 1.0


@dataclass(frozen=True)
class TrackedPath:
    """What was flown, a row for each step of the controller.

    - `time` (s): ends of the steps, s
    - `point`, `wanted` (s, 3): where the point was then, and was to be, m, world axes
    - `q` (s, nq), `v` (s, nv): states then; `u` (s, nu): inputs during the step, N and N m
    - `ended`: why the flight ended before its time, in words, or None
    """

    time: Array
    point: Array
    wanted: Array
    q: Array
    v: Array
    u: Array
    solutions: tuple[Solution, ...]
    ended: str | None

    @property
    def error(self) -> Array:
        """Distance of the point from its path (s), m."""
        return np.asarray(np.linalg.norm(self.point - self.wanted, axis=-1))


def fly(plant: ModuleType, controller: Controller, duration: float) -> TrackedPath:
    """Fly a controller's task, until its time is over or the robot is lost.

    It is lost where its point is further from the circle than that is wide, or the solver is stuck.
    `plant` is the robot's module, with `step_rk4`. Raises `UsageError` if the flight is shorter
    than a step, and `SolverStuckError` if the solver is stuck at the first one.
    """
    task, h = controller.task, controller.h
    q, v, place = task.q, task.v, plant.FRAMES.index(task.frame)
    steps = _steps(plant, (q, v), h)
    rows: list[tuple[Any, ...]] = []
    ended = None
    for k in range(control_steps(duration, h)):
        try:
            u = controller.inputs(k * h, q, v)
        except SolverStuckError as error:
            if not rows:
                raise
            ended = str(error)
            break
        for _ in range(steps):
            q, v = plant.step_rk4(q, v, u, h / steps)
        now, point = (k + 1) * h, plant.frame_poses(q)[place, :3, 3]
        rows.append((now, point, q, v, u))
        # Comparisons with what is no number are false.
        if not np.linalg.norm(point - task.path(np.asarray(now))) <= task.path.radius:
            ended = f"after {now:.2f} s the point is off its path by more than the circle's radius"
            break
    time, point, qs, vs, us = (np.array(column) for column in zip(*rows, strict=True))
    solutions = tuple(controller.solutions[-len(rows) :])
    return TrackedPath(time, point, task.path(time), qs, vs, us, solutions, ended)


def control_steps(duration: float, h: float) -> int:
    """How many steps of `h`, s, a flight has. Raises `UsageError` if there is none."""
    wanted = f"at least one step of the controller, {h:g} s, and finite"
    steps = round(float(numbers("duration of the flight", duration, wanted, ())) / h)
    if steps < 1:
        raise UsageError(f"duration of the flight: must be {wanted}, not {duration:g} s")
    return steps


def _steps(plant: ModuleType, start: tuple[Array, Array], h: float) -> int:
    """How many steps of the plant a step of the controller takes, so that they are stable."""
    q, v = start
    u = np.zeros(len(plant.INPUTS))
    turned = plant.forward_dynamics(q, v + np.eye(len(v)), u)
    rates = np.linalg.eigvals(turned - plant.forward_dynamics(q, v, u))
    fastest = float(np.abs(rates).max())
    return max(_FEWEST_STEPS, math.ceil(h * fastest / _DECAY))
