"""The optimal control problem: bring a point along a path, by direct multiple shooting.

Variables are the inputs and the state after each step, u₀, x₁, u₁, x₂, …; the state where the
horizon begins is a parameter. Constraints are x⁺ − step(x, u) = 0. A state is q and v as the module
has them, so a quaternion keeps its four entries. It needs no constraint of its own, since the step
returns one of unit length; and its functions are those of the normalised quaternion, so that their
derivatives by its entries exist. Bounds of joints stay bounds of variables, as they would not in a
tangent space that moves along with the solution.

The end of the horizon also costs what would follow, to second order. There a deviation is one from
a state that hovers and moves along with the path, which is a parameter like the path itself.

The cost is a sum of squares, and the Hessian is Gauss and Newton's: that of the squares of the
linearised residuals. It is positive definite, and needs no second derivatives of the dynamics.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi
import numpy as np

from gibbs_codegen.examples.cost_to_go import cost_to_go
from gibbs_codegen.examples.prediction import Prediction
from gibbs_codegen.examples.task import Weights


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
