"""Time the flight of docs/howto/crocoddyl.md: `python benchmarks/crocoddyl_times.py`.

Box-FDDP finds it by the module's C functions, which Crocoddyl calls through Python at every node,
and by Crocoddyl's own dynamics, in C++ with Pinocchio, with armature and without: with armature
Crocoddyl inverts the mass matrix, without it the articulated-body algorithm is used. Rounds go
through all models in turn; what is reported is the least time of each.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from typing import Any

import crocoddyl

sys.path[:0] = [str(Path(__file__).parents[1])]

from support.pages import run_python  # noqa: E402
from support.robot_in_crocoddyl import crocoddyls_own  # noqa: E402

ROUNDS = 20


def main() -> None:
    """Print the times of each model."""
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        page = run_python("docs/howto/crocoddyl.md")
    flight, start, hover = page["flight"], page["start"], page["hover"]
    name = page["uav"].NAME
    rows: dict[str, list[Callable[[], Any]]] = {}
    solvers: dict[str, Any] = {}
    guess = [start] * (flight.problem.T + 1), [hover.u] * flight.problem.T
    for label, model in {
        "module, C through Python": page["Dynamics"],
        "Crocoddyl's own, mass matrix": crocoddyls_own(name),
        "Crocoddyl's own, articulated bodies": crocoddyls_own(name, armature=False),
    }.items():
        problem = page["problem"](model)
        solver = crocoddyl.SolverBoxFDDP(problem)
        rows[label] = [
            lambda problem=problem: problem.calc(flight.xs, flight.us),
            lambda problem=problem: problem.calcDiff(flight.xs, flight.us),
            lambda solver=solver: solver.solve(*guess, 50),
        ]
        solvers[label] = solver
    least: dict[tuple[str, int], float] = {}
    for _ in range(ROUNDS):
        for label, calls in rows.items():
            for i, call in enumerate(calls):
                begun = time.perf_counter()
                call()
                taken = time.perf_counter() - begun
                least[label, i] = min(taken, least.get((label, i), taken))
    nodes = flight.problem.T
    print(f"{nodes} nodes; times per node in µs, per iteration in ms")
    for label, solver in solvers.items():
        dynamics, derivatives, solution = (least[label, i] for i in range(3))
        iterations = solver.iter + 1
        print(
            f"{label:<36} calc {1e6 * dynamics / nodes:5.1f}  calcDiff "
            f"{1e6 * derivatives / nodes:5.1f}  iteration {1e3 * solution / iterations:5.1f} "
            f"({iterations} of them)"
        )


if __name__ == "__main__":
    main()
