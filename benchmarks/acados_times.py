"""Time solvers of acados: `python benchmarks/acados_times.py [ROBOT ...] [--form FORM]`.

It needs an interpreter that has acados, and gives the numbers of docs/explanation/measurements.md:
a robot goes back to rest from 0.1 off in its first coordinate and last velocity, by one real-time
iteration at each instant of the plan itself. In turn: processor seconds of compilers, and of
Python, which makes the model and the solver's sources; the most memory of a compiler, or of Python
as it starts one; and by acados' own clock, wall time, the least and the median of an instant, and
the least of the linearisation.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from gibbs_codegen import acados_model, load
from gibbs_codegen.runtime.acados import DERIVATIVES

INTEGRATORS = {"discrete": "DISCRETE", "explicit": "ERK", "implicit": "IRK"}
H, NODES, INSTANTS = 0.02, 20, 50
# It takes minutes.
LEFT_OUT = "delta_hexarotor"


def row(folder: Path, form: str, method: str) -> str:
    """The row of a module's robot; files are written where it is."""
    from acados_template import AcadosOcp, AcadosOcpSolver

    robot, begin = load(folder), time.process_time()
    os.chdir(folder)
    options = {"step": H, "method": method} if form == "discrete" else {}
    ocp = AcadosOcp()
    ocp.model = acados_model(robot, form, **options)
    nx, nu = ocp.model.x.numel(), ocp.model.u.numel()
    rest = np.zeros(nx)
    if robot.ATTITUDE == "quaternion":
        rest[6] = 1.0
    away = rest + 0.1 * (np.eye(nx)[0] + np.eye(nx)[-1])
    cost, solving = ocp.cost, ocp.solver_options
    cost.cost_type = cost.cost_type_e = "LINEAR_LS"
    cost.Vx, cost.Vu = np.eye(nx + nu, nx), np.eye(nx + nu)[:, nx:]
    cost.W, cost.W_e = np.diag(np.repeat([100.0, 0.001], [nx, nu])), 100.0 * np.eye(nx)
    cost.yref, cost.yref_e, cost.Vx_e = np.r_[rest, np.zeros(nu)], rest, np.eye(nx)
    ocp.constraints.x0, ocp.dims.N = away, NODES
    solving.tf, solving.integrator_type = NODES * H, INTEGRATORS[form]
    solving.nlp_solver_type, solving.qp_solver = "SQP_RTI", "PARTIAL_CONDENSING_HPIPM"
    solving.ext_fun_compile_flags = "-O3 -march=native"
    solver = AcadosOcpSolver(ocp)
    python, compilers = time.process_time() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    for k in range(NODES + 1):
        solver.set(k, "x", rest)
    spent, x = [], away
    for _ in range(INSTANTS):
        solver.set(0, "lbx", x)
        solver.set(0, "ubx", x)
        if status := solver.solve():
            raise SystemExit(f"{robot.NAME}: status {status} of acados")
        spent.append([1e3 * np.sum(solver.get_stats(f"time_{word}")) for word in ("tot", "lin")])
        x = solver.get(1, "x")
    (median, _), (least, linear) = np.median(spent, 0), np.min(spent, 0)
    seconds = f"{compilers.ru_utime + compilers.ru_stime:.1f} | {python:.1f}"
    memory = f"{compilers.ru_maxrss / 1024:.0f}"
    return f"| `{robot.NAME}` | {seconds} | {memory} | {least:.2f} | {median:.2f} | {linear:.2f} |"


def main() -> None:
    from gibbs_codegen import generate, robots  # Which what is measured does without.

    shipped = sorted(file.stem for file in Path(robots.__file__).parent.glob("*.toml"))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="*", default=[x for x in shipped if x != LEFT_OUT])
    parser.add_argument("--form", choices=INTEGRATORS, default="discrete")
    parser.add_argument("--method", choices=("trapezoidal", "rk4"), default="trapezoidal")
    parser.add_argument("--module", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.module:
        rows = os.fdopen(os.dup(1), "w")
        os.dup2(2, 1)  # What acados and its compilers print.
        print(row(given.module, given.form, given.method), file=rows, flush=True)
        return
    print(
        "| robot | to compile, s | Python, s | MB | ms an instant: least | median | linearisation |"
    )
    print("|---|---:|---:|---:|---:|---:|---:|", flush=True)
    # Each in a process of its own, whose children are its compilers alone.
    again = [sys.executable, __file__, "--form", given.form, "--method", given.method, "--module"]
    with tempfile.TemporaryDirectory() as folder:
        for name in given.robots:
            made = generate(name, folder, derivatives=DERIVATIVES, verify=False)
            subprocess.run([*again, str(made)], check=True)


if __name__ == "__main__":
    main()
