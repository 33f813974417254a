"""The rows of the table, generated on request only, in which bodies' numbers are what varies.

By the base parameters the equations are linear; by the parameters of the robot file they are not.
"""

from __future__ import annotations

from gibbs_codegen.interface.rows import Output, Row

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
