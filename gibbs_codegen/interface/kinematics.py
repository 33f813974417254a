"""The rows of the table that have no forces: where points and frames are, and how they move."""

from __future__ import annotations

from gibbs_codegen.interface.rows import MOTIONS, Output, Row, of_group, on_request

_TWISTS = "[m/rad] or [1] in the first rows, [1] or [rad/m] in the others"
_BY_FRAME = ", a block for each of {frames}"
_ROW_BY_FRAME = ", a row for each of {frames}"
_POSE = "axes [1] and position [m]"
POSES = Output("poses", "f44", "1 or m", _POSE + _BY_FRAME)
VELOCITIES = Output(
    "velocities",
    "f6",
    "m/s or rad/s",
    "[m/s] in the first three, [rad/s] in the others" + _ROW_BY_FRAME,
)
BIAS_ACCELERATIONS = Output("bias_accelerations", "f6", "m/s^2 or rad/s^2", MOTIONS + _ROW_BY_FRAME)
CENTRE_JACOBIAN = Output("jacobian", "3v", "m/rad or 1")
DISPLACEMENT = Output("displacement", "v", "rad or m", "{displacement}")

_TIP = on_request(
    "tip",
    Row(
        "tip_pose",
        "q",
        (Output("pose", "44", "1 or m", _POSE),),
        "Homogeneous transform from the tip's frame to the world.",
        "forward kinematics",
        "The tip is the frame of that name in the robot file, else the end of the last link "
        "with the axes of the link, else (without links) the base centre with the axes of the "
        "base.",
    ),
    Row(
        "tip_jacobian",
        "q",
        (Output("jacobian", "6v", "m/rad, rad/m or 1", _TWISTS),),
        "Jacobian of the tip: linear rows, then angular rows, in world axes.",
        "forward kinematics",
        "It maps v to the velocity of the tip in m/s and rad/s.",
    ),
    Row(
        "tip_bias_acceleration",
        "qv",
        (Output("bias_acceleration", "6", "m/s^2 or rad/s^2", MOTIONS),),
        "Acceleration of the tip where a is zero, without gravity, in world axes.",
        "forward kinematics",
        "It is the Jacobian's rate times v, linear entries first; the whole acceleration is "
        "tip_jacobian(q) a plus this.",
    ),
    needs=("tip",),
)
KINEMATICS = of_group(
    "kinematics",
    Row(
        "positions",
        "q",
        (Output("position", "k3", "m", "{points} [{unit}]"),),
        "World positions of POINTS in m, one row each.",
        "forward kinematics",
    ),
    *_TIP,
    Row(
        "frame_poses",
        "q",
        (POSES,),
        "Homogeneous transforms from the frames to the world.",
        "forward kinematics",
    ),
    Row(
        "frame_jacobians",
        "q",
        (Output("jacobians", "f6v", "m/rad, rad/m or 1", _TWISTS + _BY_FRAME),),
        "Jacobians of the frames: linear rows, then angular rows, in world axes.",
        "forward kinematics",
        "They map v to the velocities of the frames in m/s and rad/s.",
    ),
    Row(
        "frame_velocities",
        "qv",
        (VELOCITIES,),
        "Velocities of the frames' origins, then angular velocities, in world axes.",
        "forward kinematics",
    ),
    Row(
        "frame_bias_accelerations",
        "qv",
        (BIAS_ACCELERATIONS,),
        "Accelerations of the frames where a is zero, without gravity, in world axes.",
        "forward kinematics",
        "They are the Jacobians' rates times v, linear entries first; the whole acceleration of "
        "a frame is its Jacobian times a plus this.",
    ),
    Row(
        "centre_of_mass",
        "q",
        (Output("position", "3", "m"),),
        "World position of the centre of mass.",
        "the first moment of mass",
    ),
    Row(
        "centre_of_mass_jacobian",
        "q",
        (CENTRE_JACOBIAN,),
        "Jacobian of the centre of mass, in world axes.",
        "the first moment of mass",
        "Multiplied by the robot's mass, it maps v to the linear momentum.",
    ),
    Row(
        "centroidal_momentum",
        "qv",
        (
            Output(
                "momentum",
                "6",
                "kg m/s or kg m^2/s",
                "[kg m/s] in the first three, [kg m^2/s] in the others",
            ),
        ),
        "Linear momentum, then angular momentum about the centre of mass, in world axes.",
        "eq. 6 with rates for accelerations",
        "The same as Pinocchio's computeCentroidalMomentum.",
        group="energies",
        on_request=True,
    ),
    Row(
        "coordinate_rates",
        "qv",
        (Output("rate", "q", "rad/s or m/s", "{coordinate_rates}"),),
        "Rates of the coordinates q.",
        "kinematics of the base",
        "With attitude angles they equal v; a quaternion follows the angular velocity of the base.",
    ),
    Row(
        "integrate",
        "qv",
        (Output("coordinates", "q", "rad or m", "{coordinates}", "integrated"),),
        "Coordinates after a displacement v, a velocity multiplied by a time.",
        "sums, or the exponential map of SE(3) for a quaternion with its position",
        "The same as Pinocchio's integrate. It is the only function that normalises a quaternion.",
    ),
    Row(
        "difference",
        ("q0", "q1"),
        (DISPLACEMENT,),
        "Displacement from q0 to q1: integrate(q0, difference(q0, q1)) is at q1.",
        "differences, or the logarithm of SE(3) for a quaternion with its position",
        "The same as Pinocchio's difference. A quaternion and its negative are the same attitude.",
    ),
)
