"""Model predictive control: at every step the problem is solved from where the robot is."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi
import numpy as np

from gibbs_codegen.errors import UsageError, printable
from gibbs_codegen.examples.prediction import Prediction
from gibbs_codegen.examples.task import Weights
from gibbs_codegen.examples.tracking_problem import TrackingProblem
from gibbs_codegen.simulator.vehicle import Array

# Solutions are good to this, in the units of the cost and the states.
TOLERANCE = 1e-3
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


def solver_plugin(wanted: str | None) -> str:
    """CasADi's solver that is used.

    Args:
        wanted: One of `SOLVERS`; fatrop, or IPOPT where CasADi has no fatrop, if None.

    Returns:
        Its name.

    Raises:
        UsageError: It is unknown, or CasADi has no such solver.
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
    """How one solution went.

    Attributes:
        seconds: Of the whole call.
        in_functions: Those of them spent in the functions of the problem and their derivatives.
        iterations: Of the solver.
        succeeded: Whether the solver converged.
    """

    seconds: float
    in_functions: float
    iterations: int
    succeeded: bool


@dataclass
class Controller:
    """Brings a point along a path, within limits.

    Attributes:
        prediction: Of the robot.
        weights: Of the cost; what is wanted is also the first guess.
        limits: Least and greatest u, q and v (2, nu + nq + nv), one after the other.
        path: Positions (…, 3) at times (…), m, world axes.
        h: Length of a step, s.
        nodes: Number of steps of the horizon.
        plugin: CasADi's solver, as of `solver_plugin`.
        solutions: How each call of `inputs` went.
    """

    prediction: Prediction
    weights: Weights
    limits: Array
    path: Callable[[Array], Array]
    h: float = 0.02
    nodes: int = 20
    plugin: str | None = None
    solutions: list[Solution] = field(default_factory=list)

    def __post_init__(self) -> None:
        problem = TrackingProblem(self.prediction, self.weights, self.nodes)
        plugin = solver_plugin(self.plugin)
        self._solver = problem.solver(plugin, SOLVERS[plugin])
        self._sizes = {"x": problem.stage, "lam_x": problem.stage, "lam_g": problem.states}
        self._inputs = problem.inputs
        low, high = (np.tile(bound, self.nodes) for bound in self.limits)
        self._bounds = {"lbx": low, "ubx": high, "lbg": 0.0, "ubg": 0.0}
        self._guess: Mapping[str, Array] = {
            "x": np.tile(self.weights.wanted, self.nodes),
            "lam_x": np.zeros(problem.stage * self.nodes),
            "lam_g": np.zeros(problem.states * self.nodes),
        }

    def inputs(self, now: float, q: Array, v: Array) -> Array:
        """The inputs of the step that begins now.

        Args:
            now: The time, s.
            q, v: The state.

        Returns:
            u (nu), N and N m.
        """
        ahead = self.path(np.asarray(now + self.h * np.arange(1.0, self.nodes + 1)))
        given: dict[str, Any] = {f"{name}0": values for name, values in self._guess.items()}
        start = time.perf_counter()
        given |= {"p": np.concatenate([q, v, ahead.ravel()]), **self._bounds}
        found = self._solver(**given)
        seconds = time.perf_counter() - start
        told = self._solver.stats()
        within = sum(told[name] for name in told if name.startswith("t_wall_nlp_"))
        self.solutions.append(Solution(seconds, within, told["iter_count"], told["success"]))
        values = {name: np.array(found[name]).ravel() for name in self._sizes}
        # The next solution is guessed to be this one a step later.
        self._guess = {
            name: np.concatenate([values[name][size:], values[name][-size:]])
            for name, size in self._sizes.items()
        }
        return values["x"][: self._inputs]
