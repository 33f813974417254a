"""The rows of the table that are generated on request only: derivatives, parameters, time steps.

Of a derivative, `derivative_of` names the function and `kind` says in which form it is given. It is
that of a displacement in the tangent space: `_dq` belongs to the function that takes a displacement
d to f(integrate(q, d)), at d = 0. It has a column for each of VELOCITIES.

Where bodies' numbers are what varies, the equations are linear in the base parameters; in the
parameters of the robot file they are not. Time steps are `composed` of other functions.
"""

from __future__ import annotations

from gibbs_codegen.interface.rows import Output, Row

_FORCE = Output("force", "v", "N m or N", "inverse_dynamics", "{forces}")
_ACCELERATION = Output(
    "acceleration", "v", "rad/s^2 or m/s^2", "differentiated_dynamics", "{accelerations}"
)
_INERTIAS = "[kg m^2] between angles, [kg] between lengths, [kg m] between both"
BY_Q = ", by a displacement in rad or m along each of VELOCITIES"
BY_V = ", by each of VELOCITIES"
_BY_U = ", by each of INPUTS"
_WEIGHTED = "[{unit}], with w without units"
TANGENT = (
    "Derivatives by q are those by a displacement in the tangent space, which integrate applies."
)


def _hessian(name: str, rows: str, columns: str) -> Output:
    """A block of second derivatives of inverse dynamics by `rows` and `columns`."""
    entries = f"{_WEIGHTED}, by {rows} and {columns}; rows by {rows}"
    return Output(name, "vv", "N m or N", f"inverse_dynamics_{name}", entries)


DERIVATIVES = (
    Row(
        "inverse_dynamics_derivatives",
        "qva",
        (
            _FORCE,
            Output("force_dq", "vv", "N m or N", "inverse_dynamics_dq", "{forces}" + BY_Q, "q"),
            Output("force_dv", "vv", "N m or N", "inverse_dynamics_dv", "{forces}" + BY_V, "v"),
            Output("mass_matrix", "vv", "kg m^2, kg or kg m", "mass_matrix", _INERTIAS, "a"),
        ),
        "Generalised forces M a - R, and their derivatives by q, v and a, the last being M.",
        "eqs. 4-6, differentiated",
        TANGENT,
        on_request=True,
        derivative_of="inverse_dynamics",
        kind="jacobian",
    ),
    Row(
        "forward_dynamics_derivatives",
        "qvu",
        (
            _ACCELERATION,
            Output(
                "acceleration_dq",
                "vv",
                "rad/s^2 or m/s^2",
                "forward_dynamics_dq",
                "{accelerations}" + BY_Q,
                "q",
            ),
            Output(
                "acceleration_dv",
                "vv",
                "rad/s^2 or m/s^2",
                "forward_dynamics_dv",
                "{accelerations}" + BY_V,
                "v",
            ),
            Output(
                "acceleration_du",
                "vu",
                "rad/s^2 or m/s^2",
                "forward_dynamics_du",
                "{accelerations}" + _BY_U,
                "u",
            ),
        ),
        "Accelerations a of M a = R + B u, and their derivatives by q, v and u.",
        "eq. 19, solved for the free coordinates and differentiated",
        TANGENT,
        on_request=True,
        derivative_of="forward_dynamics",
        kind="jacobian",
    ),
    Row(
        "inverse_dynamics_jvp",
        ("q", "v", "a", "q_dot", "v_dot", "a_dot"),
        (Output("force_dot", "v", "N m or N", "inverse_dynamics_jvp", "{forces}"),),
        "Derivative of the generalised forces M a - R along a direction of q, v and a.",
        "eqs. 4-6, differentiated",
        "It is force_dq q_dot + force_dv v_dot + M a_dot, without these matrices. With the rates "
        "of q, v and a for the direction it is the rate of the forces.",
        on_request=True,
        derivative_of="inverse_dynamics",
        kind="jvp",
    ),
    Row(
        "forward_dynamics_jvp",
        ("q", "v", "u", "q_dot", "v_dot", "u_dot"),
        (
            Output(
                "acceleration_dot",
                "v",
                "rad/s^2 or m/s^2",
                "forward_dynamics_jvp",
                "{accelerations}",
            ),
        ),
        "Derivative of the accelerations a of M a = R + B u along a direction of q, v and u.",
        "eq. 19, solved for the free coordinates and differentiated",
        "It is acceleration_dq q_dot + acceleration_dv v_dot + acceleration_du u_dot, without "
        "these matrices.",
        on_request=True,
        derivative_of="forward_dynamics",
        kind="jvp",
    ),
    Row(
        "inverse_dynamics_vjp",
        ("q", "v", "a", "w"),
        (
            Output("q_bar", "v", "N m or N", "inverse_dynamics_q_bar", _WEIGHTED + BY_Q),
            Output("v_bar", "v", "N m or N", "inverse_dynamics_v_bar", _WEIGHTED + BY_V),
            Output(
                "a_bar",
                "v",
                "N m or N",
                "inverse_dynamics_a_bar",
                _WEIGHTED + ", by the rate of each of VELOCITIES",
            ),
        ),
        "Gradient of w^T inverse_dynamics(q, v, a) by q, v and a.",
        "eqs. 4-6, differentiated",
        TANGENT,
        on_request=True,
        derivative_of="inverse_dynamics",
        kind="vjp",
    ),
    Row(
        "forward_dynamics_vjp",
        ("q", "v", "u", "w"),
        (
            Output("q_bar", "v", "rad/s^2 or m/s^2", "forward_dynamics_q_bar", _WEIGHTED + BY_Q),
            Output("v_bar", "v", "rad/s^2 or m/s^2", "forward_dynamics_v_bar", _WEIGHTED + BY_V),
            Output(
                "u_bar",
                "u",
                "rad/s^2 or m/s^2",
                "forward_dynamics_u_bar",
                _WEIGHTED + _BY_U,
            ),
        ),
        "Gradient of w^T forward_dynamics(q, v, u) by q, v and u.",
        "eq. 19, solved for the free coordinates and differentiated",
        TANGENT,
        on_request=True,
        derivative_of="forward_dynamics",
        kind="vjp",
    ),
    Row(
        "inverse_dynamics_hessian",
        ("q", "v", "a", "w"),
        (
            _hessian("qq", "q", "q"),
            _hessian("qv", "q", "v"),
            _hessian("vv", "v", "v"),
            _hessian("qa", "q", "a"),
        ),
        "Second derivatives of w^T inverse_dynamics(q, v, a).",
        "eqs. 4-6, differentiated twice",
        "Those that are left out, by v and a and by a twice, are zero. " + TANGENT + " qq and vv "
        "are symmetric, with both triangles filled.",
        on_request=True,
        derivative_of="inverse_dynamics",
        kind="hessian",
        is_long=True,
    ),
    Row(
        "forward_dynamics_hessian",
        ("q", "v", "u", "w"),
        (
            Output(
                "hessian",
                "xx",
                "rad/s^2 or m/s^2",
                "forward_dynamics_hessian",
                _WEIGHTED + ", by q, v and u in rows and in columns",
            ),
        ),
        "Second derivatives of w^T forward_dynamics(q, v, u) by (q, v, u).",
        "eq. 19, solved for the free coordinates and differentiated twice",
        TANGENT + " The matrix is symmetric, with both triangles filled.",
        on_request=True,
        derivative_of="forward_dynamics",
        kind="hessian",
        is_long=True,
    ),
    Row(
        "input_forces_derivatives",
        "qu",
        (
            Output("input_forces", "v", "N m or N", "input_forces", "{forces}"),
            Output("input_forces_dq", "vv", "N m or N", "input_forces_dq", "{forces}" + BY_Q),
        ),
        "Generalised forces B u of the inputs, and their derivatives by q.",
        "eqs. 7-13, differentiated",
        TANGENT,
        on_request=True,
    ),
    Row(
        "input_forces_hessian",
        "quw",
        (
            Output("input_forces_qq", "vv", "N m or N", "input_forces_qq", _WEIGHTED + BY_Q),
            Output(
                "input_forces_qu",
                "vu",
                "1 or m",
                "input_forces_qu",
                _WEIGHTED + "; rows by a displacement along each of VELOCITIES, "
                "columns by each of INPUTS",
            ),
        ),
        "Second derivatives of w^T B u by q, and by q and u.",
        "eqs. 7-13, differentiated twice",
        TANGENT + " The first matrix is symmetric, with both triangles filled.",
        on_request=True,
        is_long=True,
    ),
    Row(
        "coriolis_matrix",
        "qv",
        (
            Output(
                "coriolis",
                "vv",
                "kg m^2/s, kg/s or kg m/s",
                "coriolis_matrix",
                "[kg m^2/s] between angles, [kg/s] between lengths, [kg m/s] between both",
            ),
        ),
        "Matrix C whose product with v is the velocity terms of M a - R.",
        "eqs. 4-6",
        "C v = residual(q, 0) - residual(q, v), without dampers, and the rate of M less 2 C is "
        "skew-symmetric. The same matrix as Pinocchio's computeCoriolisMatrix gives.",
        on_request=True,
    ),
)


KINEMATIC_DERIVATIVES = (
    Row(
        "frame_poses_derivatives",
        "q",
        (
            Output(
                "poses",
                "f44",
                "1 or m",
                "frame_poses",
                "axes [1] and position [m], a block for each of {frames}",
            ),
            Output(
                "poses_dq",
                "f44v",
                "1 or m",
                "frame_poses_dq",
                "[{unit}]" + BY_Q,
                "q",
            ),
        ),
        "Homogeneous transforms from the frames to the world, and their derivatives by q.",
        "forward kinematics, differentiated",
        TANGENT,
        on_request=True,
        derivative_of="frame_poses",
        kind="jacobian",
    ),
    Row(
        "frame_velocities_derivatives",
        "qv",
        (
            Output(
                "velocities",
                "f6",
                "m/s or rad/s",
                "frame_velocities",
                "[m/s] in the first three, [rad/s] in the others, a row for each of {frames}",
            ),
            Output(
                "velocities_dq",
                "f6v",
                "m/s or rad/s",
                "frame_velocities_dq",
                "[{unit}]" + BY_Q,
                "q",
            ),
            Output(
                "velocities_dv",
                "f6v",
                "m/rad, rad/m or 1",
                "frame_velocities_dv",
                "[{unit}]" + BY_V,
                "v",
            ),
        ),
        "Velocities of the frames, linear entries first, and their derivatives by q and v.",
        "forward kinematics, differentiated",
        TANGENT + " Those by v are frame_jacobians.",
        on_request=True,
        derivative_of="frame_velocities",
        kind="jacobian",
    ),
    Row(
        "integrate_derivatives",
        "qv",
        (
            Output("coordinates_dq", "vv", "1, rad/m or m/rad", "integrated_dq", by="q"),
            Output("coordinates_dv", "vv", "1, rad/m or m/rad", "integrated_dv", by="v"),
        ),
        "Derivatives of integrate(q, v) by q and v, in the tangent spaces at q and at the result.",
        "sums, or the exponential map of SE(3) for a quaternion with its position",
        "The same as Pinocchio's dIntegrate. A displacement d of q moves the result by "
        "coordinates_dq d, one of v by coordinates_dv d.",
        on_request=True,
        derivative_of="integrate",
        kind="jacobian",
    ),
)


PARAMETERS = (
    Row(
        "regressor",
        "qva",
        (
            Output(
                "regressor",
                "vn",
                "N m or N",
                "regressor",
                "{forces}, each by each of BASE_PARAMETERS",
            ),
        ),
        "Matrix whose product with the base parameters is the inertial part of M a - R.",
        "eqs. 4-6, which are linear in the inertias",
        "regressor(q, v, a) base_parameters() = inverse_dynamics(q, v, a) without dampers, springs "
        "and armature. No column is a combination of the others at every state.",
        on_request=True,
    ),
    Row(
        "base_parameters",
        "",
        (
            Output(
                "parameters",
                "n",
                "kg, kg m or kg m^2",
                "base_parameters",
                "{base_parameters}",
            ),
        ),
        "The fewest numbers of the bodies that determine the equations of motion.",
        "regrouping of the inertias",
        "Mass, first moment and second moments (integrals of r r^T dm, not moments of inertia) "
        "about the joint, with z along it. The numbers that are missing here are added to those of "
        "the parent: of a body that turns, its mass and what is along the joint; of a body that "
        "slides, its second moments.",
        on_request=True,
    ),
    Row(
        "inverse_dynamics_parameters",
        "qva",
        (
            Output(
                "force_dp",
                "vp",
                "N m or N",
                "inverse_dynamics_dp",
                "{forces}, each by each of PARAMETERS",
            ),
        ),
        "Derivatives of the generalised forces M a - R by the parameters.",
        "eqs. 4-6, differentiated",
        on_request=True,
        derivative_of="inverse_dynamics",
        kind="parameters",
    ),
    Row(
        "forward_dynamics_parameters_vjp",
        ("q", "v", "u", "w"),
        (
            Output(
                "p_bar",
                "p",
                "rad/s^2 or m/s^2, by the unit of the parameter",
                "forward_dynamics_p_bar",
                "[{unit}], with w without units, by each of PARAMETERS",
            ),
        ),
        "Gradient of w^T forward_dynamics(q, v, u) by the parameters.",
        "eq. 19, solved for the free coordinates and differentiated",
        on_request=True,
        derivative_of="forward_dynamics",
        kind="parameters",
    ),
)


_ENTRIES = "[{unit}]; rows belong to q_next and then to v_next"
_SLOPES = (
    Output(
        "A",
        "ss",
        "1, s, 1/s, rad/m or m/rad",
        entries=f"{_ENTRIES}, columns to q and then to v",
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
            on_request=True,
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
            on_request=True,
            composed=with_derivatives,
            derivative_of=name,
            kind="jacobian",
        ),
    )


STEPS = (
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
