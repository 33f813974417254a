"""The table of emitted functions: what every generated module offers, one row per function.

A row says what a function takes and returns, what that means, and what derives each output. The
derivation, the targets, the loader, the verification and the simulator read it. To add a function,
add a row here and, for an array that nothing derives yet, an entry to `derivation.functions`.

Shapes are given by letters: q the coordinates, v the velocities, h the hybrid unknowns, u the
inputs, k the points, c the constrained joints; digits stand for themselves.
"""

from __future__ import annotations

from gibbs_codegen.interface.rows import Argument, Output, Row

# States in a block of the C functions for batches: as many doubles as the widest registers hold.
LANES = 8
# Constants of every generated module.
DATA = (
    "NAME",
    "ATTITUDE",
    "COORDINATES",
    "COORDINATE_UNITS",
    "VELOCITIES",
    "VELOCITY_UNITS",
    "HYBRID_COORDINATES",
    "INPUTS",
    "POINTS",
    "PARAMETERS",
)

ARGUMENTS = {
    "q": Argument("q", "coordinates"),
    "v": Argument("v", "their rates", "v_", "velocities"),
    "a": Argument("v", "their accelerations", "a_", "their rates"),
    "u": Argument("u", "inputs"),
    "q0": Argument("q", "coordinates to begin with", "q0_"),
    "q1": Argument("q", "coordinates to end with", "q1_"),
}

_INERTIAS = "[kg m^2] between angles, [kg] between lengths, [kg m] between both"
_LEVERS = "[N/N], [N m/N] and [N m/(N m)], by row and column"
_TWISTS = "[m/rad] or [1] in the first rows, [1] or [rad/m] in the others"
_MOTIONS = "[m/s^2] in the first three, [rad/s^2] in the others"
_MASS_MATRIX = Output("mass_matrix", "vv", "kg m^2, kg or kg m", "mass_matrix", _INERTIAS)
_RESIDUAL = Output("residual", "v", "N m or N", "residual", "{forces}")
_ROWS = (
    Row(
        "mass_matrix_and_residual",
        "qv",
        (_MASS_MATRIX, _RESIDUAL),
        "Mass matrix M and residual R of M a = R + B u, in one pass.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        "R holds the velocity terms and gravity, with the sign of a force.",
    ),
    Row(
        "mass_matrix",
        "q",
        (_MASS_MATRIX,),
        "Mass matrix M of M a = R + B u, symmetric, both triangles filled.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        "The same matrix as Pinocchio's crba gives for these coordinates.",
    ),
    Row(
        "residual",
        "qv",
        (_RESIDUAL,),
        "Residual R of M a = R + B u: velocity terms and gravity, with the sign of a force.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        "It is minus what Pinocchio calls nonLinearEffects.",
    ),
    Row(
        "input_matrix",
        "q",
        (Output("input_matrix", "vu", "N/N, N m/N or N m/(N m)", "input_matrix", _LEVERS),),
        "Input matrix B of M a = R + B u.",
        "eqs. 7-13",
        "Column k holds the generalised forces of a unit of input k.",
    ),
    Row(
        "forward_dynamics",
        "qvu",
        (Output("acceleration", "v", "rad/s^2 or m/s^2", "forward_dynamics", "{accelerations}"),),
        "Accelerations a of M a = R + B u.",
        "eq. 19, solved for the free coordinates",
        "Accurate at every attitude{singularity}. Where links without mass or thickness let joints "
        "move nothing, as a massless wrist with two axes in line, results are huge, infinite or "
        "not a number.",
    ),
    Row(
        "inverse_dynamics",
        "qva",
        (Output("force", "v", "N m or N", "inverse_dynamics", "{forces}"),),
        "Generalised forces M a - R that the motion needs; B u supplies them.",
        "eqs. 4-6",
        "The partial derivatives of the Gibbs function by the accelerations.",
    ),
    Row(
        "hybrid_mass_matrix",
        "q",
        (Output("mass_matrix", "hh", "kg m^2, kg, kg m or 1", "hybrid_mass_matrix", _INERTIAS),),
        "Matrix I_H of the hybrid system I_H a_H = R_H + B_H u.",
        "eqs. 15, 18 and 19",
        "Rows and columns are in the order of HYBRID_COORDINATES; the last rows hold the "
        "constrained joints, the last columns their torques.",
    ),
    Row(
        "hybrid_residual",
        "qv",
        (Output("residual", "h", "N m, N or rad/s^2", "hybrid_residual", "{hybrid_forces}"),),
        "Residual R_H of the hybrid system I_H a_H = R_H + B_H u.",
        "eqs. 15, 18 and 19",
        "Entries are in the order of HYBRID_COORDINATES.",
    ),
    Row(
        "hybrid_input_matrix",
        "q",
        (Output("input_matrix", "hu", "N/N, N m/N or N m/(N m)", "hybrid_input_matrix", _LEVERS),),
        "Input matrix B_H of the hybrid system I_H a_H = R_H + B_H u.",
        "eqs. 12, 13 and 18",
        "Rows are in the order of HYBRID_COORDINATES, columns in that of INPUTS.",
    ),
    Row(
        "constraint_torques",
        "qvau",
        (Output("torque", "c", "N m", "constraint_torques", "{constraint_torques}"),),
        "Torques that keep the base arms 2 ... N from turning against arm 1.",
        "eqs. 14 and 15",
        "Linear in the accelerations and inputs, which need not fit each other.",
    ),
    Row(
        "gibbs",
        "qva",
        (Output("value", "", "W/s", "gibbs"),),
        "Gibbs function S up to terms free of accelerations, in W/s.",
        "eqs. 2 and 3",
        "Gravity enters as the upward acceleration of the base, so that dS/da = M a - R.",
    ),
    Row(
        "kinetic_energy",
        "qv",
        (Output("energy", "", "J", "kinetic_energy"),),
        "Kinetic energy in J.",
        "eq. 2 with rates for accelerations",
    ),
    Row(
        "potential_energy",
        "q",
        (Output("energy", "", "J", "potential_energy"),),
        "Potential energy in J, zero at world Z = 0.",
        "gravity times the first moment of mass",
    ),
    Row(
        "positions",
        "q",
        (Output("position", "k3", "m", "positions", "{points} [{unit}]"),),
        "World positions of POINTS in m, one row each.",
        "forward kinematics",
    ),
    Row(
        "tip_pose",
        "q",
        (Output("pose", "44", "1 or m", "tip_pose", "axes [1] and position [m]"),),
        "Homogeneous transform from the tip's frame to the world.",
        "forward kinematics",
        "The tip's frame has the last link's axes; without an arm it is arm 1's, at O2.",
    ),
    Row(
        "tip_jacobian",
        "q",
        (Output("jacobian", "6v", "m/rad, rad/m or 1", "tip_jacobian", _TWISTS),),
        "Jacobian of the tip: linear rows, then angular rows, in world axes.",
        "forward kinematics",
        "It takes v to the velocity of the tip in m/s and rad/s.",
    ),
    Row(
        "tip_bias_acceleration",
        "qv",
        (Output("bias_acceleration", "6", "m/s^2 or rad/s^2", "tip_bias_acceleration", _MOTIONS),),
        "Acceleration of the tip where a is zero, gravity left out, in world axes.",
        "forward kinematics",
        "It is the Jacobian's rate times v: the tip accelerates at tip_jacobian(q) a plus this, "
        "linear entries first, then angular.",
    ),
    Row(
        "coordinate_rates",
        "qv",
        (Output("rate", "q", "rad/s or m/s", "coordinate_rates", "{coordinate_rates}"),),
        "Rates of the coordinates q.",
        "kinematics of the base",
        "With attitude angles v itself; a quaternion turns with the angular velocity of the base.",
    ),
    Row(
        "integrate",
        "qv",
        (Output("coordinates", "q", "rad or m", "integrated", "{coordinates}"),),
        "Coordinates after a displacement v, which is a velocity times the time that it lasts.",
        "sums, or the exponential map of SE(3) for a quaternion with its position",
        "The same as Pinocchio's integrate. The only function that normalises a quaternion.",
    ),
    Row(
        "difference",
        ("q0", "q1"),
        (Output("displacement", "v", "rad or m", "difference", "{displacement}"),),
        "Displacement from q0 to q1: integrate(q0, difference(q0, q1)) is at q1.",
        "differences, or the logarithm of SE(3) for a quaternion with its position",
        "The same as Pinocchio's difference. A quaternion and its opposite are one attitude.",
    ),
)
FUNCTIONS: dict[str, Row] = {row.name: row for row in _ROWS}
