"""The problem of `tracking` in acados, in a process of its own: its package may bring a CasADi.

It is given pickles: the problem once, then a state and what nodes are to be at each instant. It
answers with inputs, its processor time, s, and that of acados alone.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import sys
import time
from typing import Any

import casadi as ca
import numpy as np
from acados_template import AcadosOcp, AcadosOcpSolver

from gibbs_codegen import acados_model, load

# Iterations of the first plan, which may take its time.
_FIRST = 30


def solver_of(given: dict[str, Any]) -> Any:
    """A solver with one real-time iteration, of HPIPM."""
    robot, h, nodes = load(given["folder"], "casadi"), given["h"], given["nodes"]
    model = acados_model(robot, "discrete", step=h, method="trapezoidal")
    nq, nv = len(robot.COORDINATES), len(robot.VELOCITIES)
    q, v = ca.vertsplit(model.x, [0, nq, nq + nv])
    if given["dynamics"] != "our functions":
        model.dyn_ext_fun_type = "casadi"
        v_next = v + h * robot.forward_dynamics(q, v, model.u)
        model.disc_dyn_expr = ca.vertcat(robot.integrate(q, 0.5 * h * (v + v_next)), v_next)
    model.p = ca.SX.sym("p", 3 + nq + nv)
    place, q_desired, v_desired = ca.vertsplit(model.p, [0, 3, 3 + nq, 3 + nq + nv])
    first = 4 * given["frame"]
    missed = robot.frame_poses(q)[first : first + 3, 3] - place
    off = ca.vertcat(missed, robot.difference(q_desired, q), v - v_desired)
    model.cost_y_expr, model.cost_y_expr_e = ca.vertcat(off, model.u - given["u"]), off
    ocp = AcadosOcp()
    ocp.model, ocp.dims.N = model, nodes
    ocp.parameter_values = given["references"][0]
    cost, ends = ocp.cost, off.numel()
    cost.cost_type = cost.cost_type_e = "NONLINEAR_LS"
    cost.W, cost.W_e = given["running"], given["ending"][:ends, :ends]
    cost.yref, cost.yref_e = np.zeros(len(cost.W)), np.zeros(ends)
    limits, low, high = ocp.constraints, *given["limits"]
    nu = model.u.numel()
    limits.idxbu, limits.lbu, limits.ubu = np.arange(nu), low[:nu], high[:nu]
    bounded = np.flatnonzero(np.isfinite(low[nu:]))
    limits.idxbx = limits.idxbx_e = bounded
    limits.lbx = limits.lbx_e = low[nu:][bounded]
    limits.ubx = limits.ubx_e = high[nu:][bounded]
    limits.x0 = given["x"]
    options = ocp.solver_options
    # Costs of steps are not integrals, as acados takes them.
    options.tf = float(nodes)
    options.integrator_type, options.nlp_solver_type = "DISCRETE", "SQP_RTI"
    options.qp_solver, options.hessian_approx = "PARTIAL_CONDENSING_HPIPM", "GAUSS_NEWTON"
    options.ext_fun_compile_flags = "-O3 -march=native"
    solver = AcadosOcpSolver(ocp)
    for k, reference in enumerate(given["references"]):
        solver.set(k, "p", reference)
        solver.set(k, "x", given["x"])
        if k < nodes:
            solver.set(k, "u", given["u"])
    for _ in range(_FIRST):
        solver.solve()
    return solver


def main() -> None:
    """Build, and answer until there is no more."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # What acados and its compilers print.
    source = sys.stdin.buffer
    solver, spent = solver_of(pickle.load(source)), 0.0  # noqa: S301
    pickle.dump(None, answers)
    answers.flush()
    with contextlib.suppress(EOFError):
        while True:
            x, references = pickle.load(source)  # noqa: S301
            nodes, begin = len(references) - 1, time.process_time()
            for k, reference in enumerate(references):
                solver.set(k, "p", reference)
            solver.set(0, "lbx", x)
            solver.set(0, "ubx", x)
            status = solver.solve()
            u = solver.get(0, "u")
            spent += time.process_time() - begin
            own = float(np.ravel(solver.get_stats("time_tot"))[0])
            pickle.dump((u, spent, own, status), answers)
            answers.flush()
            # What takes microseconds in C is not counted.
            shifted = [*zip(range(nodes), [*range(1, nodes), nodes - 1], strict=True)]
            moved = [(k, name, solver.get(after, name)) for k, after in shifted for name in "xu"]
            moved.append((nodes - 1, "x", solver.get(nodes, "x")))
            for place in moved:
                solver.set(*place)


if __name__ == "__main__":
    main()
