"""The rows of the table that are generated on request only: derivatives, parameters, time steps.

`derivative_of` names the function of a derivative, and `kind` is its form. It is
that of a displacement in the tangent space: `_dq` belongs to the function that takes a displacement
d to f(integrate(q, d)), at d = 0. It has a column for each of VELOCITIES.

Where bodies' numbers are what varies, the equations are linear in the base parameters; in the
parameters of the robot file they are not. Time steps are `composed` of other functions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from gibbs_codegen.interface.dynamics import DYNAMICS
from gibbs_codegen.interface.kinematics import KINEMATICS
from gibbs_codegen.interface.rows import (
    ACCELERATIONS,
    COLUMNS,
    INERTIAS,
    MOTIONS,
    Output,
    Row,
    derivative,
    on_request,
)

_OF = {row.name: row for row in (*DYNAMICS, *KINEMATICS)}
_DISPLACED = ", by a displacement in rad or m along each of VELOCITIES"
_BY = {
    "q": _DISPLACED,
    "q0": f"{_DISPLACED} of q0",
    "q1": f"{_DISPLACED} of q1",
    "v": ", by each of VELOCITIES",
    "u": ", by each of INPUTS",
    "a": ", by the rate of each of VELOCITIES",
    "W": ", by each component of the wrenches on {frames}",
}
_WEIGHTED = "[{unit}], with w without units"
_BY_Q_AND_U = (
    f"{_WEIGHTED}; rows by a displacement along each of VELOCITIES, columns by each of INPUTS"
)
_BETWEEN = "[kg m^2/s] between angles, [kg/s] between lengths, [kg m/s] between both"
_SPACES = "1, rad/m or m/rad"
TANGENT = "Derivatives by q are by a displacement in the tangent space, which integrate applies."
_MOTION = "eqs. 4-6, differentiated"
_INPUTS = "eqs. 7-13, differentiated"
_BOTH_TRIANGLES = "symmetric, with both triangles filled."


def _details(row: Row) -> str:
    """What is to be said of derivatives by the arguments of a function."""
    held = " While q changes, wrenches stay as they are in world axes." * ("W" in row.arguments)
    return f"{TANGENT}{held}"


def _jacobian(
    of: str,
    summary: str,
    entries: str = "[{unit}]",
    value: str = "",
    slopes: str = "",
    by: Sequence[str] = "",
    units: Sequence[str] = (),
    more: tuple[Output, ...] = (),
    **others: Any,
) -> Row:
    """What a function gives, derived by `value`, and its derivatives, called by `slopes`."""
    row, columns = _OF[of], by or _OF[of].arguments
    (output,) = row.outputs
    outputs = [replace(output, derivation=value or of)]
    for x, unit in zip(columns, units or [output.unit] * len(columns), strict=True):
        name, shape = f"{slopes or output.name}_d{x}", output.shape + COLUMNS.get(x, "v")
        outputs.append(Output(name, shape, unit, entries + _BY[x], f"{of}_d{x}", x))
    others = {"details": _details(row)} | others
    return derivative(row, "jacobian", (*outputs, *more), summary, **others)


def _along(of: str, summary: str, details: str = TANGENT, **others: Any) -> Row:
    """The derivative of what a function gives along a direction of its arguments."""
    row = _OF[of]
    outputs = tuple(replace(output, name=f"{output.name}_dot") for output in row.outputs)
    others["arguments"] = (*row.arguments, *(f"{x}_dot" for x in row.arguments))
    return derivative(row, "jvp", outputs, summary, details=details, **others)


def _gradient(of: str, weighed: str = "") -> Row:
    """The gradient of the weighed results of a function by each of its arguments."""
    row, (output,) = _OF[of], _OF[of].outputs
    *first, last = by = row.arguments
    outputs = tuple(
        Output(f"{x}_bar", COLUMNS.get(x, "v"), output.unit, _WEIGHTED + _BY[x], f"{of}_{x}_bar")
        for x in by
    )
    listed = f"{', '.join(first)} and {last}" if first else last
    weighed = weighed or f"w^T {of}({', '.join(by)})"
    arguments = (*by, "w" if output.shape == "v" else f"w_{output.name}")
    others = {"arguments": arguments, "details": _details(row)}
    return derivative(row, "vjp", outputs, f"Gradient of {weighed} by {listed}.", **others)


def _hessian(of: str, outputs: tuple[Output, ...], summary: str, details: str) -> Row:
    """The second derivatives of the weighed results of a function."""
    row = derivative(_OF[of], "hessian", outputs, summary, details=details, is_long=True)
    return replace(row, arguments=(*row.arguments, "w"), source=f"{row.source} twice")


def _block(rows: str, columns: str) -> Output:
    """A block of second derivatives of inverse dynamics by `rows` and `columns`."""
    name, entries = rows + columns, f"{_WEIGHTED}, by {rows} and {columns}; rows by {rows}"
    return Output(name, "vv", "N m or N", entries, f"inverse_dynamics_{name}")


DERIVATIVES = on_request(
    "derivatives",
    _jacobian(
        "inverse_dynamics",
        "Generalised forces M a - R, and their derivatives by q, v and a, the last being M.",
        "{forces}",
        by="qv",
        more=(Output("mass_matrix", "vv", "kg m^2, kg or kg m", INERTIAS, "mass_matrix", "a"),),
    ),
    _jacobian(
        "forward_dynamics",
        "Accelerations a of M a = R + B u, and their derivatives by q, v and u.",
        "{accelerations}",
        value="differentiated_dynamics",
    ),
    _jacobian(
        "forward_dynamics_with_wrenches",
        "Accelerations a of M a = R + B u + the sum of J^T W, with derivatives by q, v, u and W.",
        "{accelerations}",
        value="differentiated_loaded",
        # A name of their own, since W fills entries that are zero without it, and PATTERNS are by
        # name.
        slopes="loaded",
    ),
    _along(
        "inverse_dynamics",
        "Derivative of the generalised forces M a - R along a direction of q, v and a.",
        "It is force_dq q_dot + force_dv v_dot + M a_dot, computed without these matrices. With "
        "the rates of q, v and a as the direction it is the rate of the forces.",
    ),
    _along(
        "forward_dynamics",
        "Derivative of the accelerations a of M a = R + B u along a direction of q, v and u.",
        "It is acceleration_dq q_dot + acceleration_dv v_dot + acceleration_du u_dot, computed "
        "without these matrices.",
    ),
    _along(
        "forward_dynamics_with_wrenches",
        "Derivative of forward_dynamics_with_wrenches along a direction of q, v, u and W.",
        "It is loaded_dq q_dot + loaded_dv v_dot + loaded_du u_dot + loaded_dW W_dot, computed "
        "without these matrices.",
    ),
    _along(
        "joint_wrenches_with_wrenches",
        "Derivative of joint_wrenches_with_wrenches along a direction of q, v, a, u and W.",
        source=_MOTION,
        is_long=True,
    ),
    *map(_gradient, ("inverse_dynamics", "forward_dynamics", "forward_dynamics_with_wrenches")),
    _hessian(
        "inverse_dynamics",
        (_block("q", "q"), _block("q", "v"), _block("v", "v"), _block("q", "a")),
        "Second derivatives of w^T inverse_dynamics(q, v, a).",
        f"The others, by v and a and by a twice, are zero. {TANGENT} qq and vv are "
        f"{_BOTH_TRIANGLES}",
    ),
    _hessian(
        "forward_dynamics",
        (
            Output(
                "hessian", "xx", ACCELERATIONS, f"{_WEIGHTED}, by q, v and u in rows and in columns"
            ),
        ),
        "Second derivatives of w^T forward_dynamics(q, v, u) by (q, v, u).",
        f"{TANGENT} The matrix is {_BOTH_TRIANGLES}",
    ),
    _along(
        "input_matrix",
        "Derivative of the input matrix B along a direction of q.",
        "With the rate of q as the direction it is the rate of B.",
    ),
    _gradient("input_matrix", "the sum of the entries of B, each times its weight,"),
    Row(
        "input_forces_derivatives",
        "qu",
        (
            Output("input_forces", "v", "N m or N", "{forces}", "input_forces"),
            Output("input_forces_dq", "vv", "N m or N", "{forces}" + _BY["q"], "input_forces_dq"),
        ),
        "Generalised forces B u of the inputs, and their derivatives by q.",
        _INPUTS,
        TANGENT,
    ),
    Row(
        "input_forces_hessian",
        "quw",
        (
            Output("input_forces_qq", "vv", "N m or N", _WEIGHTED + _BY["q"], "input_forces_qq"),
            Output("input_forces_qu", "vu", "1 or m", _BY_Q_AND_U, "input_forces_qu"),
        ),
        "Second derivatives of w^T B u by q, and by q and u.",
        f"{_INPUTS} twice",
        f"{TANGENT} The first matrix is {_BOTH_TRIANGLES}",
        is_long=True,
    ),
    Row(
        "coriolis_matrix",
        "qv",
        (Output("coriolis", "vv", "kg m^2/s, kg/s or kg m/s", _BETWEEN),),
        "Matrix C whose product with v is the velocity terms of M a - R.",
        "eqs. 4-6",
        "C v = residual(q, 0) - residual(q, v), without dampers, and the rate of M less 2 C is "
        "skew-symmetric. The same matrix as Pinocchio's computeCoriolisMatrix gives.",
    ),
    _jacobian(
        "frame_poses",
        "Homogeneous transforms from the frames to the world, and their derivatives by q.",
    ),
    _jacobian(
        "frame_velocities",
        "Velocities of the frames, linear entries first, and their derivatives by q and v.",
        units=("m/s or rad/s", "m/rad, rad/m or 1"),
        details=f"{TANGENT} Those by v are frame_jacobians.",
    ),
    _jacobian(
        "frame_bias_accelerations",
        "Accelerations of the frames where a is zero, and their derivatives by q and v.",
        MOTIONS,
    ),
    _along(
        "centre_of_mass_jacobian",
        "Derivative of the Jacobian of the centre of mass along a direction of q.",
        "With the rate of q as the direction it is the Jacobian's rate.",
    ),
    _gradient(
        "centre_of_mass_jacobian", "the sum of the Jacobian's entries, each times its weight,"
    ),
    derivative(
        _OF["integrate"],
        "jacobian",
        tuple(
            Output(f"coordinates_d{x}", "vv", _SPACES, derivation=f"integrated_d{x}", by=x)
            for x in "qv"
        ),
        "Derivatives of integrate(q, v) by q and v, in the tangent spaces at q and at the result.",
        source=_OF["integrate"].source,
        details="The same as Pinocchio's dIntegrate. A displacement d of q moves the result by "
        "coordinates_dq d, one of v by coordinates_dv d.",
    ),
    _jacobian(
        "difference",
        "Displacement from q0 to q1, and its derivatives by both.",
        units=(_SPACES, _SPACES),
        source=_OF["difference"].source,
        details="The same as Pinocchio's dDifference. Displacements d of q0 and e of q1, in the "
        "tangent spaces there, change it by displacement_dq0 d + displacement_dq1 e.",
    ),
)


def _by_parameters(of: str) -> Row:
    """The gradient of the weighed accelerations of a function by the parameters."""
    row = _OF[of]
    p_bar = Output(
        *("p_bar", "p", f"{ACCELERATIONS}, by the unit of the parameter"),
        f"{_WEIGHTED}, by each of PARAMETERS",
        f"{of}_p_bar",
    )
    summary = f"Gradient of w^T {of}({', '.join(row.arguments)}) by the parameters."
    name, arguments = f"{of}_parameters_vjp", (*row.arguments, "w")
    return derivative(row, "parameters", (p_bar,), summary, name=name, arguments=arguments)


PARAMETERS = on_request(
    "parameters",
    Row(
        "regressor",
        "qva",
        (Output("regressor", "vn", "N m or N", "{forces}, each by each of BASE_PARAMETERS"),),
        "Matrix whose product with the base parameters is the inertial part of M a - R.",
        "eqs. 4-6, which are linear in the inertias",
        "regressor(q, v, a) base_parameters() = inverse_dynamics(q, v, a) without dampers, "
        "springs and armature. The columns are linearly independent over all states.",
    ),
    Row(
        "base_parameters",
        "",
        (Output("parameters", "n", "kg, kg m or kg m^2", "{base_parameters}"),),
        "Base parameters: the fewest inertial numbers that determine the equations of motion.",
        "regrouping of the inertias",
        "Mass, first moment and second moments (integrals of r r^T dm, not moments of inertia) "
        "about the joint, with z along its axis. Missing numbers are added to those of the "
        "parent body: for a rotating body its mass and moments along the axis, for a sliding "
        "body its second moments.",
    ),
    derivative(
        _OF["inverse_dynamics"],
        "parameters",
        (
            Output(
                *("force_dp", "vp", "N m or N"),
                "{forces}, each by each of PARAMETERS",
                "inverse_dynamics_dp",
            ),
        ),
        "Derivatives of the generalised forces M a - R by the parameters.",
    ),
    *map(_by_parameters, ("forward_dynamics", "forward_dynamics_with_wrenches")),
)


_ENTRIES = "[{unit}]; rows belong to q_next and then to v_next"
_SLOPES = (
    Output(
        "A", "ss", "1, s, 1/s, rad/m or m/rad", entries=f"{_ENTRIES}, columns to q and then to v"
    ),
    Output("B", "su", "rad or m, or their rates, by N or N m", entries=f"{_ENTRIES}, columns to u"),
)


def _step(name: str, method: str, composed: dict[str, int], details: str) -> tuple[Row, Row]:
    """Rows of a time step by itself, and with its derivatives.

    `method` is the numerical method in words; `composed` says how often it calls forward_dynamics
    and integrate, `details` what is to be said of the method.
    """
    after = (
        Output("q_next", "q", "rad or m", entries="{coordinates}"),
        Output("v_next", "v", "rad/s or m/s", entries="{velocities}"),
    )
    moves = composed["integrate"]
    with_derivatives = {
        "forward_dynamics_derivatives": composed["forward_dynamics"],
        "integrate": moves,
        "integrate_derivatives": moves,
    }
    source = "eq. 19, integrated over a step of time"
    return (
        Row(
            name,
            "qvuh",
            after,
            f"Coordinates and velocities after a step of time, by {method}.",
            source,
            details,
            composed=composed,
        ),
        Row(
            f"{name}_derivatives",
            "qvuh",
            (*after, *_SLOPES),
            f"Results of {name}, and their derivatives by q, v and u.",
            source,
            "A displacement d of (q, v) and a change e of u move the result by A d + B e. "
            "Displacements of q and q_next are in the tangent space, as integrate applies them.",
            composed=with_derivatives,
            derivative_of=name,
            kind="jacobian",
        ),
    )


STEPS = on_request(
    "steps",
    *_step(
        "step_euler",
        "the semi-implicit Euler method",
        {"forward_dynamics": 1, "integrate": 1},
        "Inputs are constant in the step. v_next = v + h a, and q_next = integrate(q, h v_next). "
        "The method is of first order.",
    ),
    *_step(
        "step_rk4",
        "a Runge-Kutta method of fourth order",
        {"forward_dynamics": 4, "integrate": 5},
        "Inputs are constant in the step. With attitude angles it is the classical method. A "
        "quaternion moves by exponentials without commutators (Celledoni, Marthinsen and Owren, "
        "2003), which keeps the order and the unit length.",
    ),
)
