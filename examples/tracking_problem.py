"""The optimal control problem: bring a point along a path, by direct multiple shooting.

Variables are the inputs and the state after each step, u₀, x₁, u₁, x₂, …; the state where the
horizon begins is a parameter. Constraints are x⁺ − step(x, u) = 0. A state is q and v as the module
has them, so a quaternion keeps its four entries. It needs no constraint of its own, since the step
returns one of unit length; and its functions are those of the normalised quaternion, so that their
derivatives by its entries exist. Bounds of joints stay bounds of variables, as they would not in a
tangent space that moves along with the solution.

The cost is a sum of squares, and the Hessian is Gauss and Newton's: that of the squares of the
linearised residuals. It is positive definite, and needs no second derivatives of the dynamics.

The end of the horizon also costs what would follow, to second order. A controller that looks no
further than a short horizon need not be stable. A machine that holds the tip of a long arm in its
place may tip over about it, and lean a little more at every step: within 0.4 s that costs less than
what would set it upright. So the end costs what a linear-quadratic regulator would need from there,
which is small only where the machine can be caught. A deviation there is one from a state that
hovers and moves along with the path, which is a parameter like the path itself.

The step that predicts is semi-implicit Euler's, which evaluates the forward dynamics once. Dampers
would make it unstable where links are light: a motion with a damper d and an inertia I decays
within I / d, which may be a hundredth of a step. The step is stable for every damper if the
dampers' torques are those at its end. Since these are linear in the rates, that is the usual step
of a robot whose joints have an armature that is larger by h d:

    M (v⁺ − v) / h = R − D v⁺ + B u    is    (M + h D) (v⁺ − v) / h = R − D v + B u
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi
import numpy as np

from examples.task import Weights
from gibbs_codegen.errors import UsageError
from gibbs_codegen.flight.plant.vehicle import Array
from gibbs_codegen.robot.model import Link, Robot
from gibbs_codegen.runtime.c_library import CompilerError, chosen_compiler, compiled_files

# What a module must have to be predicted with.
DERIVATIVES = ("step_euler", "step_euler_derivatives", "frame_poses_derivatives")


@dataclass(frozen=True)
class Prediction:
    """A time step (q, v, u) -> (q_next, v_next) and a point, both differentiable once.

    `point` takes q to a position (3), world axes, m.
    """

    step: casadi.Function
    point: casadi.Function


def predicted_robot(robot: Robot, h: float) -> Robot:
    """The robot whose semi-implicit Euler step treats the dampers of another one's joints stably.

    It is the same, named so, with joints of a larger armature; `h` is the step, s.
    """

    def damped(link: Link) -> Link:
        passive = link.passive
        armature = passive.armature + h * passive.damping
        return replace(link, passive=replace(passive, armature=armature))

    links = tuple(map(damped, robot.links))
    return replace(robot, name=f"{robot.name}_predicted", links=links)


def compiled(module: ModuleType, frame: str, h: float) -> Prediction:
    """Predict with C that CasADi generates of a module's functions and their exact derivatives.

    The module has the CasADi back end and the functions of `DERIVATIVES`; the origin of `frame` is
    the point. Raises `UsageError` where nothing compiles.
    """
    return in_c(exact(module, frame, h), module)


def exact(module: ModuleType, frame: str, h: float) -> Prediction:
    """Predict with a module's functions as CasADi's symbols, and with the module's derivatives."""
    return Prediction(_step(module, h), _point(module, frame))


def traced(module: ModuleType, frame: str, h: float) -> Prediction:
    """Predict with CasADi's own symbols, which it differentiates itself.

    The module has the CasADi back end and the functions of `DERIVATIVES`.
    """
    functions = (_step(module, h), _point(module, frame))
    given = [(f.name(), symbols := f.sx_in(), f.call(symbols)) for f in functions]
    return Prediction(*(casadi.Function(*each) for each in given))


def in_c(prediction: Prediction, module: ModuleType) -> Prediction:
    """The same functions and Jacobians as C of CasADi's code generator, kept in the cache.

    Raises `UsageError` where nothing compiles.
    """
    functions = (prediction.step, prediction.point)
    generator = casadi.CodeGenerator("prediction.c")
    for function in functions:
        generator.add(function)
        generator.add(function.jacobian())
    source = {"prediction.c": generator.dump().encode()}
    folder = Path(module.__path__[0])
    try:
        path = compiled_files(folder, module.NAME, [], chosen_compiler(), others=source)
    except CompilerError as error:
        raise UsageError(
            f"{module.NAME}: its functions are not compiled, and the controller predicts with "
            f"compiled functions: {error}; set CC to a C compiler that works"
        ) from None
    return Prediction(*(casadi.external(f.name(), str(path)) for f in functions))


def _step(module: ModuleType, h: float) -> casadi.Function:
    """A time step of fixed length, with the Jacobian that the module has, by the entries of q."""
    q, v, u, _ = module.step_euler.sx_in()
    *after, by_state, by_u = module.step_euler_derivatives(q, v, u, h)
    ends = [0, q.numel(), q.numel() + v.numel()]
    rates = casadi.SX.eye(v.numel())
    entries = casadi.diagcat(_entries(module, after[0]), rates)
    states = entries @ by_state @ casadi.diagcat(_displacements(module, q), rates)
    whole = casadi.horzcat(states, entries @ by_u)
    rows = casadi.blocksplit(whole, ends, [*ends, ends[-1] + u.numel()])
    return _with_jacobian("step", [q, v, u], after, [block for row in rows for block in row])


def _point(module: ModuleType, frame: str) -> casadi.Function:
    """The origin of a frame, with the rows of the poses' Jacobian that belong to it."""
    (q,) = module.frame_poses.sx_in()
    poses, by_q = module.frame_poses_derivatives(q)
    first = 4 * module.FRAMES.index(frame)
    rows = [4 * (first + axis) + 3 for axis in range(3)]
    slope = by_q[rows, :] @ _displacements(module, q)
    return _with_jacobian("point", [q], [poses[first : first + 3, 3]], [slope])


def _displacements(module: ModuleType, q: casadi.SX) -> casadi.SX:
    """Derivatives (nv, nq) of a displacement of coordinates by their entries."""
    before = casadi.SX.sym("before", q.numel())
    return casadi.substitute(casadi.jacobian(module.difference(before, q), q), before, q)


def _entries(module: ModuleType, q: casadi.SX) -> casadi.SX:
    """Derivatives (nq, nv) of the entries of coordinates by a displacement."""
    before, moved = module.integrate.sx_in()
    slope = casadi.jacobian(module.integrate(before, moved), moved)
    return casadi.Function("entries", [before, moved], [slope])(q, 0)


def _with_jacobian(
    name: str, inputs: list[casadi.SX], outputs: list[casadi.SX], blocks: list[casadi.SX]
) -> casadi.Function:
    """A function that CasADi differentiates by given blocks and not through its expressions.

    They are the derivative of each output by each input, those of the first output first.
    """
    unused = [casadi.SX.sym(f"out{i}", casadi.Sparsity(*x.shape)) for i, x in enumerate(outputs)]
    jacobian = casadi.Function(f"jac_{name}", [*inputs, *unused], casadi.cse(blocks))
    return casadi.Function(name, inputs, casadi.cse(outputs), {"custom_jacobian": jacobian})


# Steps that the regulator goes on for. Without an end, the cost of a motion that no input reaches
# might not be finite.
_STEPS = 500


def cost_to_go(prediction: Prediction, weights: Weights) -> Array:
    """The Hessian (nq + nv, nq + nv) of the cost of all steps after a state, without its own.

    It is of deviations of q and v from what is wanted, about which step and point are linearised.
    """
    step, point = prediction.step, prediction.point
    nq, nv, nu = (step.size1_in(i) for i in range(3))
    u, q, v = np.split(weights.wanted, [nu, nu + nq])
    nothing = [casadi.DM(nq, 1), casadi.DM(nv, 1)]
    blocks = [np.array(casadi.densify(b)) for b in step.jacobian().call([q, v, u, *nothing])]
    a, b = np.block([blocks[:2], blocks[3:5]]), np.vstack([blocks[2], blocks[5]])
    by_q = np.array(casadi.densify(point.jacobian()(q, casadi.DM(3, 1))))
    inputs, states = np.diag(weights.stage[:nu]), np.diag(weights.stage[nu:])
    states[:nq, :nq] += weights.point * by_q.T @ by_q
    after = np.zeros_like(a)
    for _ in range(_STEPS):
        cost = states + after
        gain = np.linalg.solve(inputs + b.T @ cost @ b, b.T @ cost @ a)
        closed = a - b @ gain
        after = gain.T @ inputs @ gain + closed.T @ cost @ closed
    return after


class TrackingProblem:
    """The functions of the problem of `nodes` steps, which a solver takes as they are."""

    def __init__(self, prediction: Prediction, weights: Weights, nodes: int) -> None:
        self._prediction, self._weights = prediction, weights
        self.nodes = nodes
        self._nq, self._nv, self.inputs = (prediction.step.size1_in(i) for i in range(3))
        self.states = self._nq + self._nv
        self.stage = self.inputs + self.states
        self._variables = casadi.MX.sym("x", self.stage * nodes)
        self._parameters = casadi.MX.sym("p", 2 * self.states + 3 * nodes)
        self._columns = casadi.reshape(self._variables, self.stage, nodes)
        start, path, self._end = casadi.vertsplit(
            self._parameters, [0, self.states, self.states + 3 * nodes, 2 * self.states + 3 * nodes]
        )
        self._path = casadi.reshape(path, 3, nodes)
        after = self._columns[self.inputs :, :]
        before = casadi.horzcat(start, after[:, :-1])
        self._arguments = [
            before[: self._nq, :],
            before[self._nq :, :],
            self._columns[: self.inputs, :],
        ]
        predicted = prediction.step.map(nodes).call(self._arguments)
        self._gaps = casadi.vec(after - casadi.vertcat(*predicted))
        self._cost, self._gradient, self._hessian = self._costs()

    def solver(self, plugin: str, options: Mapping[str, Any]) -> casadi.Function:
        """A solver, "fatrop" or "ipopt", of the problem with these derivatives.

        Its parameters are, in turn, the state, the points of the path, and the state that the end
        is to be near to.
        """
        x, p = self._variables, self._parameters
        factor = casadi.MX.sym("lam_f")
        multipliers = casadi.MX.sym("lam_g", self.states * self.nodes)
        hessian, gradient = factor * self._hessian, [self._gradient]
        structure: dict[str, Any] = {}
        if plugin == "fatrop":
            structure = self._structure()
            # Fatrop computes the gradient of the Lagrangian itself, and takes none from here.
            second = [casadi.MX(x.shape[0], 1), hessian]
        else:
            gradient, second = [self._cost, *gradient], [casadi.triu(hessian)]
        given = {
            "nlp_grad_f": ([x, p], gradient),
            "nlp_jac_g": ([x, p], [self._gaps, self._jacobian()]),
            "nlp_hess_l": ([x, p, factor, multipliers], second),
        }
        # CasADi finds in the cache what it would otherwise derive.
        cache = {name: casadi.Function(name, *both) for name, both in given.items()}
        return casadi.nlpsol(
            "solver",
            plugin,
            {"x": x, "p": p, "f": self._cost, "g": self._gaps},
            {"cache": cache, "print_time": False, plugin: dict(options), **structure},
        )

    def _structure(self) -> dict[str, Any]:
        """The stages as fatrop is told of them."""
        nodes = self.nodes
        return {
            "structure_detection": "manual",
            "N": nodes,
            "nx": [0] + [self.states] * nodes,
            "nu": [self.inputs] * nodes + [0],
            "ng": [0] * (nodes + 1),
            "equality": [True] * (self.states * nodes),
        }

    def _costs(self) -> tuple[casadi.MX, casadi.MX, casadi.MX]:
        """The cost, its gradient and its Hessian."""
        stage, aim = casadi.MX.sym("stage", self.stage), casadi.MX.sym("aim", 3)
        q = stage[self.inputs : self.inputs + self._nq]
        point = self._prediction.point
        by_q = point.jacobian()(q, casadi.MX(3, 1))
        weight, weights = self._weights.point, casadi.DM(self._weights.stage)
        off, miss = stage - casadi.DM(self._weights.wanted), point(q) - aim
        cost = (weight * casadi.sumsqr(miss) + casadi.dot(weights * off, off)) / 2
        around = (self.inputs, self._nv)
        pulled = [casadi.MX(size, 1) for size in around]
        pulled.insert(1, weight * casadi.mtimes(by_q.T, miss))
        bent = [casadi.MX(size, size) for size in around]
        bent.insert(1, weight * casadi.mtimes(by_q.T, by_q))
        functions = [
            casadi.Function("cost", [stage, aim], [cost]),
            casadi.Function("gradient", [stage, aim], [weights * off + casadi.vertcat(*pulled)]),
            casadi.Function(
                "hessian", [stage, aim], [casadi.diag(weights) + casadi.diagcat(*bent)]
            ),
        ]
        costs, gradients, hessians = (
            function.map(self.nodes)(self._columns, self._path) for function in functions
        )
        blocks = casadi.diagcat(*[functions[2].sparsity_out(0)] * self.nodes)
        after, slope, bend = self._cost_of_the_end()
        return (
            casadi.sum2(costs) + after,
            casadi.vec(gradients) + slope,
            casadi.MX(blocks, hessians.nz[:]) + bend,
        )

    def _cost_of_the_end(self) -> tuple[casadi.MX, casadi.MX, casadi.MX]:
        """What follows the horizon costs, the gradient of that and its Hessian.

        Where the base should be follows from where the point is, for angles of any size. With a
        deviation of the base's position itself, the cost would hold two models of the point against
        each other: the one of the path, and a linear one.
        """
        nq, earlier = self._nq, self.stage * self.nodes - self.states
        last, by_q = self._columns[self.inputs :, -1], self._prediction.point.jacobian()
        hover = self._weights.wanted[self.inputs : self.inputs + nq]
        linear = by_q(hover, casadi.DM(3, 1))
        base = casadi.DM(np.eye(self.states)[:, self._weights.position])
        q, off = last[:nq], last - self._end
        off += base @ (self._prediction.point(q) - self._path[:, -1] - linear @ off[:nq])
        more = base @ (by_q(q, casadi.MX(3, 1)) - linear)
        by_last = casadi.DM.eye(self.states) + casadi.horzcat(
            more, casadi.MX(self.states, self._nv)
        )
        ahead = casadi.DM(cost_to_go(self._prediction, self._weights))
        return (
            casadi.dot(off, ahead @ off) / 2,
            casadi.vertcat(casadi.MX(earlier, 1), by_last.T @ ahead @ off),
            casadi.diagcat(casadi.MX(earlier, earlier), by_last.T @ ahead @ by_last),
        )

    def _jacobian(self) -> casadi.MX:
        """Derivatives of the gaps: entries of the steps' Jacobians, gathered column by column."""
        jacobian = self._prediction.step.jacobian()
        nothing = [casadi.MX(size, self.nodes) for size in (self._nq, self._nv)]
        blocks = jacobian.map(self.nodes).call([*self._arguments, *nothing])
        # Columns of q, v and u in a stage. The state is that of the stage before.
        begins = (self.inputs, self.inputs + self._nq, 0)
        rows, columns, places, count = [], [], [], 0
        for place in range(len(blocks)):
            row, column = map(np.array, jacobian.sparsity_out(place).get_triplet())
            output, argument = divmod(place, len(begins))
            for k in range(self.nodes):
                stage = k if argument == 2 else k - 1
                if stage >= 0:
                    rows.append(row + self.states * k + self._nq * output)
                    columns.append(column + self.stage * stage + begins[argument])
                    places.append(count + np.arange(len(row)))
                count += len(row)
        after = np.arange(self.states)
        for k in range(self.nodes):
            rows.append(after + self.states * k)
            columns.append(after + self.stage * k + self.inputs)
            places.append(np.full(self.states, count))
        row, column, source = map(np.concatenate, (rows, columns, places))
        order = np.lexsort((row, column))
        pattern = casadi.Sparsity.triplet(
            *self._gaps.shape[:1],
            self.stage * self.nodes,
            row[order].tolist(),
            column[order].tolist(),
        )
        entries = casadi.vertcat(*(-block.nz[:] for block in blocks), 1)
        return casadi.MX(pattern, entries.nz[source[order].tolist()])
