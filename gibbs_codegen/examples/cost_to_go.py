"""What it costs to go on hovering after the horizon, to second order.

A controller that looks no further than a short horizon need not be stable. A machine that holds the
tip of a long arm in its place may tip over about it, and lean a little more at every step: within
0.4 s that costs less than what would set it upright. So the end of the horizon costs what a
linear-quadratic regulator would need from there, which is small only where the machine can be
caught.
"""

from __future__ import annotations

import casadi
import numpy as np

from gibbs_codegen.examples.prediction import Prediction
from gibbs_codegen.examples.task import Weights
from gibbs_codegen.simulator.plant.vehicle import Array

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
