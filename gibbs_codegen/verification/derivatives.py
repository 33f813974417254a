"""A module's derivatives compared with what its other functions give, which are verified first.

Whatever a module has in DERIVATIVES is compared, and nothing else. References are differences of
eighth order, but where there is algebra: see the modules that the table names.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification.comparison import (
    Comparison,
    Evaluation,
    compared,
    explained,
    failed,
)
from gibbs_codegen.verification.derivative_row import DerivativeRow, Point
from gibbs_codegen.verification.dynamics_derivatives import (
    coriolis_rows,
    hessian_rows,
    jacobian_rows,
    jvp_rows,
    vjp_rows,
)
from gibbs_codegen.verification.input_derivatives import input_hessian_rows, input_rows
from gibbs_codegen.verification.motion_derivatives import (
    euler_step,
    frame_rows,
    integrate_rows,
    rk4_step,
    step_rows,
)
from gibbs_codegen.verification.parameter_derivatives import (
    base_parameter_rows,
    parameter_rows,
    regressor_rows,
    weighed_parameter_rows,
)
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array

OTHER_FUNCTIONS, ZEROS = "other functions", "zeros outside PATTERNS"
_Rows = Callable[[Point, Mapping[str, Array]], Iterator[DerivativeRow]]
_ROWS: dict[str, _Rows] = {
    "inverse_dynamics_derivatives": partial(jacobian_rows, forward=False),
    "forward_dynamics_derivatives": partial(jacobian_rows, forward=True),
    "inverse_dynamics_jvp": partial(jvp_rows, forward=False),
    "forward_dynamics_jvp": partial(jvp_rows, forward=True),
    "inverse_dynamics_vjp": partial(vjp_rows, forward=False),
    "forward_dynamics_vjp": partial(vjp_rows, forward=True),
    "inverse_dynamics_hessian": partial(hessian_rows, forward=False),
    "forward_dynamics_hessian": partial(hessian_rows, forward=True),
    "input_forces_derivatives": input_rows,
    "input_forces_hessian": input_hessian_rows,
    "coriolis_matrix": coriolis_rows,
    "frame_poses_derivatives": frame_rows,
    "frame_velocities_derivatives": frame_rows,
    "integrate_derivatives": integrate_rows,
    "step_euler": partial(step_rows, step=euler_step),
    "step_rk4": partial(step_rows, step=rk4_step),
    "step_euler_derivatives": partial(step_rows, step=euler_step),
    "step_rk4_derivatives": partial(step_rows, step=rk4_step),
    "regressor": regressor_rows,
    "base_parameters": base_parameter_rows,
    "inverse_dynamics_parameters": parameter_rows,
    "forward_dynamics_parameters_vjp": weighed_parameter_rows,
}


def compare_derivatives(
    call: Evaluation, robot: Robot, states: States, circumstance: str = "", long: bool = True
) -> list[Comparison]:
    """Compare the arrays of the functions of a module that are generated on request.

    No state is next to a singular attitude; `circumstance` is added to the names of what is
    compared with; `long` is whether to compare Hessians, whose differences take many evaluations.
    """
    point = Point(call, robot, Tree(robot), states)
    comparisons: list[Comparison] = []
    for name in filter(_ROWS.__contains__, call.signatures):
        if FUNCTIONS[name].is_long and not long:
            continue
        values = call.results(name, states)
        against = OTHER_FUNCTIONS + circumstance
        with np.errstate(all="ignore"):
            rows = list(_ROWS[name](point, values))
        comparisons += [
            compared(what, against, ours, theirs, size + np.abs(theirs), limit)
            for what, ours, theirs, size, limit in rows
        ]
        comparisons += _outside_patterns(call, name, values, ZEROS + circumstance)
    return explained(comparisons, call.faults)


def _outside_patterns(
    call: Evaluation, name: str, values: Mapping[str, Array], against: str
) -> Iterator[Comparison]:
    """Compare entries that are said to be zero at every state with zero."""
    patterns = getattr(call.module, "PATTERNS", {})
    for output, (what, array) in zip(FUNCTIONS[name].outputs, values.items(), strict=True):
        if output.name not in patterns:
            continue
        height = math.prod(array.shape[1:-1])  # Not −1: without columns that is not told.
        matrix = array.reshape(len(array), height, array.shape[-1]).copy()
        try:
            rows, columns = patterns[output.name]
            matrix[:, rows, columns] = 0.0
        except (IndexError, TypeError, ValueError) as error:
            yield failed(what, against, error)
            continue
        yield compared(what, against, matrix, np.zeros_like(matrix), 1.0, 0.0)
