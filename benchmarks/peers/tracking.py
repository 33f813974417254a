"""The problem of the predictive controller as CasADi's solvers and Crocoddyl take it.

All get it from one `Problem`: what is off at a node is e, namely the tip's distance from its path,
the displacement from the posture, and velocities and inputs less those that are desired; a node
costs eᵀ W e / 2, with another W at the end of the horizon.

For CasADi it is direct multiple shooting: variables are u₀, x₁, u₁, x₂, … with x = (q, v) by its
entries, also those of a quaternion; the Hessian is Gauss and Newton's. Crocoddyl has the tangent
space itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi as ca
import crocoddyl
import numpy as np
import pinocchio as pin

from gibbs_codegen import Predictive
from gibbs_codegen.runtime.c_library import chosen_compiler, compiled_files

Array = np.ndarray
# Solvers get this share of the cost, and are to be as near to its optimum.
_UNIT, _TOLERANCE = 1e-2, 1e-3
_MOST = 20
_OPTIONS: dict[str, Any] = {
    "fatrop": {"print_level": 0, "tol": _TOLERANCE, "mu_init": 1e-4, "max_iter": _MOST},
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "tol": _TOLERANCE,
        "mu_init": 1e-4,
        "max_iter": _MOST,
        "warm_start_init_point": "yes",
    },
}


class Problem:
    """What a predictive controller that leads one tip minimises, and within which limits."""

    def __init__(self, controller: Predictive) -> None:
        """The problem of a controller that has neither lag nor costs of changes."""
        horizon, self.told = controller.horizon, controller._compiled.arrays
        self.module, self.h, self.nodes = controller.module, controller.step, controller.nodes
        self.frame = horizon.points[0]
        self.hover, limits = controller.hover, controller._limits
        space = horizon.robot.space
        self.nq, self.nv, self.nu = space.coordinates, space.velocities, horizon.robot.inputs
        # By errors of the point, coordinates, velocities and inputs, as the weights are.
        self.running = np.diag(self.told["weights"])
        nv = self.nv
        ahead, turn, tip = np.split(self.told["ahead"], [4 * nv * nv, 4 * nv * nv + 9])
        # What a regulator would start from: the base is where the point needs it.
        start = np.eye(2 * nv, 3 + 2 * nv + self.nu, 3)
        base = start[horizon.robot.layout.v.position]
        base[:, :3] += turn.reshape(3, 3)
        base[:, 3 : 3 + nv] -= turn.reshape(3, 3) @ tip.reshape(3, nv)
        self.ending = self.running + start.T @ ahead.reshape(2 * nv, 2 * nv) @ start
        own, rates = controller.vehicle.arm, controller.vehicle.arm_rates
        self.limits = np.full((2, self.nu + self.nq + nv), np.inf) * [[-1.0], [1.0]]
        self.limits[:, : self.nu] = limits.inputs
        self.limits[:, self.nu : -nv][:, own] = limits.joints
        self.limits[:, -nv:][:, rates] = [-limits.velocities, limits.velocities]

    @property
    def references(self) -> Array:
        """Points, coordinates and velocities that are desired at nodes, as they were told last."""
        return self.told["reference"][:, : 3 + self.nq + self.nv]

    def off(self, reference: Array, x: Array, u: Array) -> Array:
        """What is off, e."""
        place, q_desired, v_desired = np.split(reference, [3, 3 + self.nq])
        q, v = x[: self.nq], x[self.nq :]
        missed = self.module.frame_poses(q)[self.frame, :3, 3] - place
        away = self.module.difference(q_desired, q)
        return np.concatenate([missed, away, v - v_desired, u - self.hover.u])

    def off_by_state(self, reference: Array, x: Array) -> Array:
        """Derivatives of e by displacements of the state."""
        nv, q = self.nv, x[: self.nq]
        slope = np.eye(3 + 2 * nv + self.nu, 2 * nv, -3)
        slope[:3, :nv] = self.module.frame_poses_derivatives(q)[1][self.frame, :3, 3]
        slope[3 : 3 + nv, :nv] = self.module.difference_derivatives(reference[3 : 3 + self.nq], q)[
            2
        ]
        return slope


@dataclass(frozen=True)
class Prediction:
    """Functions of the problem.

    - `step`: x, u -> x_next
    - `slopes`: x, u -> x_next, and its derivatives by x and u
    - `errors`: q, point, q_desired -> errors of the point and of coordinates, and their derivative
    """

    step: ca.Function
    slopes: ca.Function
    errors: ca.Function


def exact(module: ModuleType, problem: Problem) -> Prediction:
    """With the module's functions and derivatives."""
    q, v, u = module.forward_dynamics.sx_in()
    acceleration, *slopes = module.forward_dynamics_derivatives(q, v, u)
    before = ca.SX.sym("before", problem.nq)
    displaced = ca.substitute(ca.jacobian(module.difference(before, q), q), before, q)
    by_x, by_u = ca.horzcat(slopes[0] @ displaced, slopes[1]), slopes[2]
    after, by_q, by_move = _moved(module, q, v, acceleration, problem.h)
    nothing = ca.SX(problem.nv, problem.nq)
    h, rates = problem.h, ca.horzcat(nothing, ca.SX.eye(problem.nv))
    states = ca.horzcat(by_q, by_move @ (h * rates[:, problem.nq :]))
    states += by_move @ (0.5 * h * h * by_x)
    after_by_x = ca.vertcat(states, rates + h * by_x)
    after_by_u = ca.vertcat(by_move @ (0.5 * h * h * by_u), h * by_u)
    first = 4 * problem.frame
    poses, turned = module.frame_poses_derivatives(q)
    rows = [4 * (first + axis) + 3 for axis in range(3)]
    point = poses[first : first + 3, 3], turned[rows, :] @ displaced
    return _compiled(module, (q, v, u), (after, after_by_x, after_by_u), point)


def _moved(
    module: ModuleType, q: ca.SX, v: ca.SX, acceleration: ca.SX, h: float
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The state after a step, and derivatives of its coordinates by those before and by moves."""
    before, move = module.integrate.sx_in()
    found = module.integrate(before, move)
    slopes = [found, *(ca.jacobian(found, each) for each in (before, move))]
    v_next = v + h * acceleration
    function = ca.Function("moved", [before, move], slopes)
    q_next, by_q, by_move = function(q, 0.5 * h * (v + v_next))
    return ca.vertcat(q_next, v_next), by_q, by_move


def traced(module: ModuleType, problem: Problem, accelerate: ca.Function) -> Prediction:
    """With accelerations (q, v, u) that CasADi differentiates; kinematics are the module's."""
    q, v, u = module.forward_dynamics.sx_in()
    unit = ca.vertcat(q[:3], q[3:7] / ca.norm_2(q[3:7]), q[7:])
    after, *_ = _moved(module, q, v, accelerate(unit, v, u), problem.h)
    slopes = (ca.jacobian(after, x) for x in (ca.vertcat(q, v), u))
    first = 4 * problem.frame
    point = module.frame_poses(unit)[first : first + 3, 3]
    return _compiled(module, (q, v, u), (after, *slopes), (point, ca.jacobian(point, q)))


def _compiled(
    module: ModuleType,
    state: tuple[ca.SX, ca.SX, ca.SX],
    after: tuple[ca.SX, ca.SX, ca.SX],
    point: tuple[ca.SX, ca.SX],
) -> Prediction:
    """C of CasADi's code generator, of a step and a point, each with its derivatives."""
    q, v, u = state
    place, desired = ca.SX.sym("place", 3), ca.SX.sym("desired", q.numel())
    away = module.difference(desired, q)
    errors = [
        ca.vertcat(point[0] - place, away),
        ca.vertcat(point[1], ca.jacobian(away, q)),
    ]
    x = ca.vertcat(q, v)
    functions = [
        ca.Function("step", [x, u], ca.cse([after[0]])),
        ca.Function("slopes", [x, u], ca.cse(list(after))),
        ca.Function("errors", [q, place, desired], ca.cse(errors)),
    ]
    generator = ca.CodeGenerator("prediction.c")
    for function in functions:
        generator.add(function)
    source = {"prediction.c": generator.dump().encode()}
    folder = Path(module.__path__[0])
    path = compiled_files(folder, module.NAME, [], chosen_compiler(), others=source)
    return Prediction(*(ca.external(function.name(), str(path)) for function in functions))


class Solver:
    """The problem in a solver of CasADi, "fatrop" or "ipopt", warm from step to step."""

    def __init__(self, problem: Problem, prediction: Prediction, plugin: str) -> None:
        self.problem, self.iterations = problem, []
        nx, nu, n = problem.nq + problem.nv, problem.nu, problem.nodes
        self._sizes = {"x": nu + nx, "lam_x": nu + nx, "lam_g": nx}
        x, p = ca.MX.sym("x", (nu + nx) * n), ca.MX.sym("p", nx * (n + 1) + 3 * n)
        columns = ca.reshape(x, nu + nx, n)
        references = ca.reshape(p[nx:], 3 + nx, n)
        u, after = columns[:nu, :], columns[nu:, :]
        before = ca.horzcat(p[:nx], after[:, :-1])
        gaps = ca.vec(after - prediction.step.map(n)(before, u))
        predicted, by_x, by_u = prediction.slopes.map(n)(before, u)
        # Columns of u and x of a stage, in rows of its own gap and the next one.
        own = ca.vertcat(-by_u, ca.MX(*by_u.shape))
        nothing = ca.MX(nx, nx)
        states = ca.vertcat(ca.repmat(ca.MX.eye(nx), 1, n), ca.horzcat(-by_x[:, nx:], nothing))
        stages = ca.horzcat(
            *(
                part
                for pair in zip(ca.horzsplit(own, nu), ca.horzsplit(states, nx), strict=True)
                for part in pair
            )
        )
        row, column = map(np.array, stages.sparsity().get_triplet())
        row += nx * (column // (nu + nx))
        pattern = ca.Sparsity.triplet(nx * n, (nu + nx) * n, row.tolist(), column.tolist())
        jacobian = ca.MX(pattern, stages.nz[:])
        running, ending = (self._costs(prediction, w) for w in (problem.running, problem.ending))
        costs, gradients, hessians = (
            each.map(n - 1)(columns[:, :-1], references[:, :-1]) for each in running
        )
        after_all = [each(columns[:, -1], references[:, -1]) for each in ending]
        cost = ca.sum2(costs) + after_all[0]
        gradient = ca.vertcat(ca.vec(gradients), after_all[1])
        blocks = ca.diagcat(*[running[2].sparsity_out(0)] * (n - 1))
        hessian = ca.diagcat(ca.MX(blocks, hessians.nz[:]), after_all[2])
        factor, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nx * n)
        structure: dict[str, Any] = {}
        slopes, second = [cost, gradient], [ca.triu(factor * hessian)]
        if plugin == "fatrop":
            # Fatrop computes the gradient of the Lagrangian itself, and takes none from here.
            slopes, second = [gradient], [ca.MX(x.numel(), 1), factor * hessian]
            structure = {
                "structure_detection": "manual",
                "N": n,
                "nx": [0] + [nx] * n,
                "nu": [nu] * n + [0],
                "ng": [0] * (n + 1),
                "equality": [True] * (nx * n),
            }
        given = {
            "nlp_grad_f": ([x, p], slopes),
            "nlp_grad": (
                [x, p, factor, multipliers],
                [cost, gaps, factor * gradient + jacobian.T @ multipliers, ca.MX(*p.shape)],
            ),
            "nlp_jac_g": ([x, p], [ca.vec(after - predicted), jacobian]),
            "nlp_hess_l": ([x, p, factor, multipliers], second),
        }
        # CasADi finds in the cache what it would otherwise derive.
        cache = {name: ca.Function(name, *both) for name, both in given.items()}
        options = {
            "cache": cache,
            "print_time": False,
            plugin: _OPTIONS[plugin],
            **structure,
        }
        self._solver = ca.nlpsol("solver", plugin, {"x": x, "p": p, "f": cost, "g": gaps}, options)
        low, high = np.tile(problem.limits, n)
        self._bounds = {"lbx": low, "ubx": high, "lbg": 0.0, "ubg": 0.0}
        self._guess: dict[str, Array] = {}

    def _costs(self, prediction: Prediction, weights: Array) -> list[ca.Function]:
        """Cost of a stage (u, x), its gradient and the Hessian of Gauss and Newton."""
        problem = self.problem
        nu, nq, nv = problem.nu, problem.nq, problem.nv
        stage, reference = ca.MX.sym("stage", nu + nq + nv), ca.MX.sym("reference", 3 + nq + nv)
        u, q, v = ca.vertsplit(stage, [0, nu, nu + nq, nu + nq + nv])
        place, q_desired, v_desired = ca.vertsplit(reference, [0, 3, 3 + nq, 3 + nq + nv])
        found, by_q = prediction.errors(q, place, q_desired)
        off = ca.vertcat(found, v - v_desired, u - problem.hover.u)
        slope = ca.vertcat(
            ca.horzcat(ca.MX(3 + nv, nu), by_q, ca.MX(3 + nv, nv)),
            ca.horzcat(ca.MX(nv, nu + nq), ca.MX.eye(nv)),
            ca.horzcat(ca.MX.eye(nu), ca.MX(nu, nq + nv)),
        )
        matrix = ca.MX(ca.sparsify(ca.DM(_UNIT * weights)))
        pulled = matrix @ off
        found = {
            "cost": ca.dot(off, pulled) / 2,
            "gradient": slope.T @ pulled,
            "hessian": slope.T @ (matrix @ slope),
        }
        return [ca.Function(name, [stage, reference], [each]) for name, each in found.items()]

    def __call__(self, x: Array) -> Array:
        """Inputs at a state."""
        problem = self.problem
        ahead = problem.references[1:]
        if not self._guess:
            hover = np.tile(np.r_[problem.hover.u, ahead[0, 3:]], (problem.nodes, 1))
            hover[:, problem.nu :] = ahead[:, 3:]
            self._guess = {
                name: np.zeros(size * problem.nodes) for name, size in self._sizes.items()
            }
            self._guess["x"] = hover.ravel()
        guess = {f"{name}0": values for name, values in self._guess.items()}
        found = self._solver(**guess, p=np.r_[x, ahead.ravel()], **self._bounds)
        self.iterations.append(self._solver.stats()["iter_count"])
        values = {name: np.array(found[name]).ravel() for name in self._sizes}
        self._guess = {
            name: np.concatenate([values[name][size:], values[name][-size:]])
            for name, size in self._sizes.items()
        }
        # Solvers keep to limits as nearly as they converge.
        low, high = problem.limits[:, : problem.nu]
        return np.clip(values["x"][: problem.nu], low, high)


class _Node(crocoddyl.ActionModelAbstract):
    """A node of the problem, with the module's functions."""

    def __init__(self, problem: Problem, state: Any, weights: Array) -> None:
        super().__init__(state, problem.nu, 0)
        self.problem, self.weights, self.reference = problem, weights, None
        self.u_lb, self.u_ub = problem.limits[:, : problem.nu]

    def calc(self, data: Any, x: Array, u: Array | None = None) -> None:
        """The next state and the cost."""
        problem = self.problem
        off = problem.off(self.reference, x, problem.hover.u if u is None else u)
        data.cost = off @ self.weights @ off / 2
        if u is not None:
            q, v = x[: problem.nq], x[problem.nq :]
            v_next = v + problem.h * problem.module.forward_dynamics(q, v, u)
            q_next = problem.module.integrate(q, 0.5 * problem.h * (v + v_next))
            data.xnext = np.r_[q_next, v_next]

    def calcDiff(self, data: Any, x: Array, u: Array | None = None) -> None:  # noqa: N802
        """Their derivatives."""
        problem = self.problem
        off = problem.off(self.reference, x, problem.hover.u if u is None else u)
        slope = problem.off_by_state(self.reference, x)
        pulled = slope.T @ self.weights
        data.Lx, data.Lxx = pulled @ off, pulled @ slope
        if u is not None:
            nu, nv, h, module = problem.nu, problem.nv, problem.h, problem.module
            data.Lu, data.Luu = (self.weights @ off)[-nu:], self.weights[-nu:, -nu:]
            data.Lxu = np.zeros((2 * nv, nu))
            q, v = x[: problem.nq], x[problem.nq :]
            acceleration, by_q, by_v, by_u = module.forward_dynamics_derivatives(q, v, u)
            move = h * (v + 0.5 * h * acceleration)
            turned, moved = module.integrate_derivatives(q, move)
            rates = np.hstack([h * by_q, np.eye(nv) + h * by_v])
            mean = 0.5 * h * (rates + np.eye(nv, 2 * nv, nv))
            data.Fx = np.vstack([moved @ mean, rates])
            data.Fx[:nv, :nv] += turned
            data.Fu = np.vstack([moved @ (0.5 * h * h * by_u), h * by_u])


class BoxFDDP:
    """The problem in Crocoddyl, with limits of inputs alone, warm from step to step."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.iterations = problem, []
        space = pin.Model()
        joint = space.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
        for name in problem.module.VELOCITIES[6:]:
            joint = space.addJoint(joint, pin.JointModelRX(), pin.SE3.Identity(), name)
        state, n = crocoddyl.StateMultibody(space), problem.nodes
        weights = [problem.running] * n + [problem.ending]
        self._nodes = [_Node(problem, state, each) for each in weights]
        still = np.r_[problem.hover.q, np.zeros(problem.nv)]
        self._solver = crocoddyl.SolverBoxFDDP(
            crocoddyl.ShootingProblem(still, self._nodes[:-1], self._nodes[-1])
        )
        self._solver.th_stop = _TOLERANCE
        self._xs, self._us = [still] * (n + 1), [problem.hover.u] * n

    def __call__(self, x: Array) -> Array:
        """Inputs at a state."""
        for node, reference in zip(self._nodes, self.problem.references, strict=True):
            node.reference = reference
        self._solver.problem.x0 = x
        self._xs[0] = x
        self._solver.solve(self._xs, self._us, _MOST)
        self.iterations.append(self._solver.iter + 1)
        xs, us = list(self._solver.xs), list(self._solver.us)
        self._xs, self._us = [*xs[1:], xs[-1]], [*us[1:], us[-1]]
        return np.array(us[0])
