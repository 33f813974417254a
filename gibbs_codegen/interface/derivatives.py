"""The rows of the table that are generated on request only: derivatives, parameters, time steps.

Of a derivative, `derivative_of` names the function and `kind` says in which form it is given. It is
that of a displacement in the tangent space: `_dq` belongs to the function that takes a displacement
d to f(integrate(q, d)), at d = 0. It has a column for each of VELOCITIES.

Where bodies' numbers are what varies, the equations are linear in the base parameters; in the
parameters of the robot file they are not. Time steps are `composed` of other functions.
"""

from __future__ import annotations

from dataclasses import replace

from gibbs_codegen.interface.kinematics import (
    BIAS_ACCELERATIONS,
    CENTRE_JACOBIAN,
    DISPLACEMENT,
    POSES,
    VELOCITIES,
)
from gibbs_codegen.interface.rows import (
    ACCELERATIONS,
    INERTIAS,
    LEVERS,
    LOADS,
    MOTIONS,
    Output,
    Row,
    on_request,
)

_FORCE = Output("force", "v", "N m or N", "{forces}", "inverse_dynamics")
_ACCELERATION = Output(
    "acceleration", "v", ACCELERATIONS, "{accelerations}", "differentiated_dynamics"
)
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
# Shapes of what a derivative by an argument has for each entry, where that is not "v".
_COLUMNS = {"u": "u", "W": "f6"}
_WEIGHTED = "[{unit}], with w without units"
_BY_Q_AND_U = (
    f"{_WEIGHTED}; rows by a displacement along each of VELOCITIES, columns by each of INPUTS"
)
_BETWEEN = "[kg m^2/s] between angles, [kg/s] between lengths, [kg m/s] between both"
TANGENT = (
    "Derivatives by q are those by a displacement in the tangent space, which integrate applies."
)
_MOTION = "eqs. 4-6, differentiated"
_LOADED = Output("acceleration", "v", ACCELERATIONS, "{accelerations}", "differentiated_loaded")
_LOADED_DYNAMICS = "forward_dynamics_with_wrenches"
# Names of their own, since W fills entries that are zero without it, and PATTERNS are by name.
_UNDER_LOAD = replace(_LOADED, name="loaded")
_SOLVED = "eq. 19, solved for the free coordinates and differentiated"
_INPUTS = "eqs. 7-13, differentiated"
_FIRST_MOMENT = "the first moment of mass, differentiated"
_BOTH_TRIANGLES = "symmetric, with both triangles filled."


def _jacobian(of: str, output: Output, by: str, unit: str, entries: str = "[{unit}]") -> Output:
    """The derivative of an output of the function `of` by its argument `by`."""
    shape = output.shape + _COLUMNS.get(by, "v")
    return Output(f"{output.name}_d{by}", shape, unit, entries + _BY[by], f"{of}_d{by}", by)


def _gradients(of: str, unit: str, by: str) -> tuple[Output, ...]:
    """Gradients of the weighted results of the function `of` by each of its arguments."""
    return tuple(
        Output(f"{x}_bar", _COLUMNS.get(x, "v"), unit, _WEIGHTED + _BY[x], f"{of}_{x}_bar")
        for x in by
    )


def _hessian(rows: str, columns: str) -> Output:
    """A block of second derivatives of inverse dynamics by `rows` and `columns`."""
    name, entries = rows + columns, f"{_WEIGHTED}, by {rows} and {columns}; rows by {rows}"
    return Output(name, "vv", "N m or N", entries, f"inverse_dynamics_{name}")


DERIVATIVES = on_request(
    "derivatives",
    Row(
        "inverse_dynamics_derivatives",
        "qva",
        (
            _FORCE,
            *(_jacobian("inverse_dynamics", _FORCE, by, "N m or N", "{forces}") for by in "qv"),
            Output("mass_matrix", "vv", "kg m^2, kg or kg m", INERTIAS, "mass_matrix", "a"),
        ),
        "Generalised forces M a - R, and their derivatives by q, v and a, the last being M.",
        _MOTION,
        TANGENT,
        derivative_of="inverse_dynamics",
        kind="jacobian",
    ),
    Row(
        "forward_dynamics_derivatives",
        "qvu",
        (
            _ACCELERATION,
            *(
                _jacobian("forward_dynamics", _ACCELERATION, by, ACCELERATIONS, "{accelerations}")
                for by in "qvu"
            ),
        ),
        "Accelerations a of M a = R + B u, and their derivatives by q, v and u.",
        _SOLVED,
        TANGENT,
        derivative_of="forward_dynamics",
        kind="jacobian",
    ),
    Row(
        "forward_dynamics_with_wrenches_derivatives",
        "qvuW",
        (
            _LOADED,
            *(
                _jacobian(_LOADED_DYNAMICS, _UNDER_LOAD, by, ACCELERATIONS, "{accelerations}")
                for by in "qvuW"
            ),
        ),
        "Accelerations a of M a = R + B u + the sum of J^T W, with derivatives by q, v, u and W.",
        _SOLVED,
        f"{TANGENT} While q changes, wrenches stay as they are in world axes.",
        derivative_of=_LOADED_DYNAMICS,
        kind="jacobian",
    ),
    Row(
        "inverse_dynamics_jvp",
        ("q", "v", "a", "q_dot", "v_dot", "a_dot"),
        (Output("force_dot", "v", "N m or N", "{forces}"),),
        "Derivative of the generalised forces M a - R along a direction of q, v and a.",
        _MOTION,
        "It is force_dq q_dot + force_dv v_dot + M a_dot, without these matrices. With the rates "
        "of q, v and a for the direction it is the rate of the forces.",
        derivative_of="inverse_dynamics",
        kind="jvp",
    ),
    Row(
        "forward_dynamics_jvp",
        ("q", "v", "u", "q_dot", "v_dot", "u_dot"),
        (Output("acceleration_dot", "v", ACCELERATIONS, "{accelerations}"),),
        "Derivative of the accelerations a of M a = R + B u along a direction of q, v and u.",
        _SOLVED,
        "It is acceleration_dq q_dot + acceleration_dv v_dot + acceleration_du u_dot, without "
        "these matrices.",
        derivative_of="forward_dynamics",
        kind="jvp",
    ),
    Row(
        "forward_dynamics_with_wrenches_jvp",
        ("q", "v", "u", "W", "q_dot", "v_dot", "u_dot", "W_dot"),
        (Output("acceleration_dot", "v", ACCELERATIONS, "{accelerations}"),),
        "Derivative of forward_dynamics_with_wrenches along a direction of q, v, u and W.",
        _SOLVED,
        "It is loaded_dq q_dot + loaded_dv v_dot + loaded_du u_dot + loaded_dW W_dot, without "
        "these matrices.",
        derivative_of=_LOADED_DYNAMICS,
        kind="jvp",
    ),
    Row(
        "joint_wrenches_with_wrenches_jvp",
        ("q", "v", "a", "u", "W", "q_dot", "v_dot", "a_dot", "u_dot", "W_dot"),
        (Output("wrenches_dot", "b6", "N or N m", LOADS),),
        "Derivative of joint_wrenches_with_wrenches along a direction of q, v, a, u and W.",
        _MOTION,
        TANGENT,
        derivative_of="joint_wrenches_with_wrenches",
        kind="jvp",
        is_long=True,
    ),
    Row(
        "inverse_dynamics_vjp",
        "qvaw",
        _gradients("inverse_dynamics", "N m or N", "qva"),
        "Gradient of w^T inverse_dynamics(q, v, a) by q, v and a.",
        _MOTION,
        TANGENT,
        derivative_of="inverse_dynamics",
        kind="vjp",
    ),
    Row(
        "forward_dynamics_vjp",
        "qvuw",
        _gradients("forward_dynamics", ACCELERATIONS, "qvu"),
        "Gradient of w^T forward_dynamics(q, v, u) by q, v and u.",
        _SOLVED,
        TANGENT,
        derivative_of="forward_dynamics",
        kind="vjp",
    ),
    Row(
        "forward_dynamics_with_wrenches_vjp",
        "qvuWw",
        _gradients(_LOADED_DYNAMICS, ACCELERATIONS, "qvuW"),
        "Gradient of w^T forward_dynamics_with_wrenches(q, v, u, W) by q, v, u and W.",
        _SOLVED,
        f"{TANGENT} While q changes, wrenches stay as they are in world axes.",
        derivative_of=_LOADED_DYNAMICS,
        kind="vjp",
    ),
    Row(
        "inverse_dynamics_hessian",
        "qvaw",
        (_hessian("q", "q"), _hessian("q", "v"), _hessian("v", "v"), _hessian("q", "a")),
        "Second derivatives of w^T inverse_dynamics(q, v, a).",
        f"{_MOTION} twice",
        "Those that are left out, by v and a and by a twice, are zero. "
        f"{TANGENT} qq and vv are {_BOTH_TRIANGLES}",
        derivative_of="inverse_dynamics",
        kind="hessian",
        is_long=True,
    ),
    Row(
        "forward_dynamics_hessian",
        "qvuw",
        (
            Output(
                "hessian", "xx", ACCELERATIONS, f"{_WEIGHTED}, by q, v and u in rows and in columns"
            ),
        ),
        "Second derivatives of w^T forward_dynamics(q, v, u) by (q, v, u).",
        f"{_SOLVED} twice",
        f"{TANGENT} The matrix is {_BOTH_TRIANGLES}",
        derivative_of="forward_dynamics",
        kind="hessian",
        is_long=True,
    ),
    Row(
        "input_matrix_jvp",
        ("q", "q_dot"),
        (Output("input_matrix_dot", "vu", "N/N, N m/N or N m/(N m)", LEVERS),),
        "Derivative of the input matrix B along a direction of q.",
        _INPUTS,
        "With the rate of q for the direction it is the rate of B.",
        derivative_of="input_matrix",
        kind="jvp",
    ),
    Row(
        "input_matrix_vjp",
        ("q", "w_input_matrix"),
        _gradients("input_matrix", "N/N, N m/N or N m/(N m)", "q"),
        "Gradient of the sum of the entries of B, each times its weight, by q.",
        _INPUTS,
        TANGENT,
        derivative_of="input_matrix",
        kind="vjp",
    ),
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
        "eqs. 7-13, differentiated twice",
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
    Row(
        "frame_poses_derivatives",
        "q",
        (
            replace(POSES, derivation="frame_poses"),
            _jacobian("frame_poses", POSES, "q", "1 or m"),
        ),
        "Homogeneous transforms from the frames to the world, and their derivatives by q.",
        "forward kinematics, differentiated",
        TANGENT,
        derivative_of="frame_poses",
        kind="jacobian",
    ),
    Row(
        "frame_velocities_derivatives",
        "qv",
        (
            replace(VELOCITIES, derivation="frame_velocities"),
            _jacobian("frame_velocities", VELOCITIES, "q", "m/s or rad/s"),
            _jacobian("frame_velocities", VELOCITIES, "v", "m/rad, rad/m or 1"),
        ),
        "Velocities of the frames, linear entries first, and their derivatives by q and v.",
        "forward kinematics, differentiated",
        TANGENT + " Those by v are frame_jacobians.",
        derivative_of="frame_velocities",
        kind="jacobian",
    ),
    Row(
        "frame_bias_accelerations_derivatives",
        "qv",
        (
            replace(BIAS_ACCELERATIONS, derivation="frame_bias_accelerations"),
            *(
                _jacobian(
                    "frame_bias_accelerations", BIAS_ACCELERATIONS, by, "m/s^2 or rad/s^2", MOTIONS
                )
                for by in "qv"
            ),
        ),
        "Accelerations of the frames where a is zero, and their derivatives by q and v.",
        "forward kinematics, differentiated",
        TANGENT,
        derivative_of="frame_bias_accelerations",
        kind="jacobian",
    ),
    Row(
        "centre_of_mass_jacobian_jvp",
        ("q", "q_dot"),
        (replace(CENTRE_JACOBIAN, name="jacobian_dot"),),
        "Derivative of the Jacobian of the centre of mass along a direction of q.",
        _FIRST_MOMENT,
        "With the rate of q for the direction it is the Jacobian's rate.",
        derivative_of="centre_of_mass_jacobian",
        kind="jvp",
    ),
    Row(
        "centre_of_mass_jacobian_vjp",
        ("q", "w_jacobian"),
        _gradients("centre_of_mass_jacobian", "m/rad or 1", "q"),
        "Gradient of the sum of the Jacobian's entries, each times its weight, by q.",
        _FIRST_MOMENT,
        TANGENT,
        derivative_of="centre_of_mass_jacobian",
        kind="vjp",
    ),
    Row(
        "integrate_derivatives",
        "qv",
        (
            Output("coordinates_dq", "vv", "1, rad/m or m/rad", derivation="integrated_dq", by="q"),
            Output("coordinates_dv", "vv", "1, rad/m or m/rad", derivation="integrated_dv", by="v"),
        ),
        "Derivatives of integrate(q, v) by q and v, in the tangent spaces at q and at the result.",
        "sums, or the exponential map of SE(3) for a quaternion with its position",
        "The same as Pinocchio's dIntegrate. A displacement d of q moves the result by "
        "coordinates_dq d, one of v by coordinates_dv d.",
        derivative_of="integrate",
        kind="jacobian",
    ),
    Row(
        "difference_derivatives",
        ("q0", "q1"),
        (
            replace(DISPLACEMENT, derivation="difference"),
            *(
                _jacobian("difference", DISPLACEMENT, by, "1, rad/m or m/rad")
                for by in ("q0", "q1")
            ),
        ),
        "Displacement from q0 to q1, and its derivatives by both.",
        "differences, or the logarithm of SE(3) for a quaternion with its position",
        "The same as Pinocchio's dDifference. Displacements d of q0 and e of q1, in the tangent "
        "spaces there, change it by displacement_dq0 d + displacement_dq1 e.",
        derivative_of="difference",
        kind="jacobian",
    ),
)


_BY_PARAMETERS = Output(
    *("p_bar", "p", f"{ACCELERATIONS}, by the unit of the parameter"),
    f"{_WEIGHTED}, by each of PARAMETERS",
    "forward_dynamics_p_bar",
)
PARAMETERS = on_request(
    "parameters",
    Row(
        "regressor",
        "qva",
        (Output("regressor", "vn", "N m or N", "{forces}, each by each of BASE_PARAMETERS"),),
        "Matrix whose product with the base parameters is the inertial part of M a - R.",
        "eqs. 4-6, which are linear in the inertias",
        "regressor(q, v, a) base_parameters() = inverse_dynamics(q, v, a) without dampers, springs "
        "and armature. No column is a combination of the others at every state.",
    ),
    Row(
        "base_parameters",
        "",
        (Output("parameters", "n", "kg, kg m or kg m^2", "{base_parameters}"),),
        "The fewest numbers of the bodies that determine the equations of motion.",
        "regrouping of the inertias",
        "Mass, first moment and second moments (integrals of r r^T dm, not moments of inertia) "
        "about the joint, with z along it. The numbers that are missing here are added to those of "
        "the parent: of a body that turns, its mass and what is along the joint; of a body that "
        "slides, its second moments.",
    ),
    Row(
        "inverse_dynamics_parameters",
        "qva",
        (
            Output(
                *("force_dp", "vp", "N m or N"),
                "{forces}, each by each of PARAMETERS",
                "inverse_dynamics_dp",
            ),
        ),
        "Derivatives of the generalised forces M a - R by the parameters.",
        _MOTION,
        derivative_of="inverse_dynamics",
        kind="parameters",
    ),
    Row(
        "forward_dynamics_parameters_vjp",
        "qvuw",
        (_BY_PARAMETERS,),
        "Gradient of w^T forward_dynamics(q, v, u) by the parameters.",
        _SOLVED,
        derivative_of="forward_dynamics",
        kind="parameters",
    ),
    Row(
        "forward_dynamics_with_wrenches_parameters_vjp",
        "qvuWw",
        (replace(_BY_PARAMETERS, derivation=f"{_LOADED_DYNAMICS}_p_bar"),),
        "Gradient of w^T forward_dynamics_with_wrenches(q, v, u, W) by the parameters.",
        _SOLVED,
        derivative_of=_LOADED_DYNAMICS,
        kind="parameters",
    ),
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
            f"What {name} gives, and its derivatives by q, v and u.",
            source,
            "A displacement d of q and v together and one e of u move the result by A d + B e, "
            "with displacements of q and q_next in the tangent space, as integrate applies them.",
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
        "quaternion moves by exponentials alone, without commutators (Celledoni, Marthinsen and "
        "Owren, 2003), which keeps the order, and the unit length.",
    ),
)
