"""The rows of the table that are derivatives of kinematics, which are generated on request only."""

from __future__ import annotations

from gibbs_codegen.interface.derivatives import BY_Q, BY_V, TANGENT
from gibbs_codegen.interface.rows import Output, Row

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
