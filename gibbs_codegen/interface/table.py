"""The table of emitted functions: what every generated module offers, one row per function.

A row says what a function takes and returns, what that means, and what derives each output. The
derivation, the targets, the loader, the verification and `flight` read it. To add a function,
add a row here and, for an array that nothing derives yet, an entry to `derivation.functions`.

Shapes are given by letters: q the coordinates, v the velocities, h the hybrid unknowns, u the
inputs, k the points, f the frames, b the bodies, p the parameters, n the base parameters; c the
constrained joints, s the velocities twice, for a displacement of a state, and x the same and the
inputs; r the rotors, m the commands, z the states of the actuators; g the constraints of frames
and l their rows; digits stand for themselves.
"""

from __future__ import annotations

from gibbs_codegen.interface.actuators import ACTUATOR_DERIVATIVES, ACTUATOR_PARAMETERS, ACTUATORS
from gibbs_codegen.interface.constraints import CONSTRAINT_DERIVATIVES, CONSTRAINTS
from gibbs_codegen.interface.derivatives import DERIVATIVES, PARAMETERS, STEPS
from gibbs_codegen.interface.kinematics import KINEMATICS
from gibbs_codegen.interface.rows import (
    ACCELERATIONS,
    INERTIAS,
    LEVERS,
    LOADS,
    Argument,
    Kind,
    Output,
    Row,
)

# States in a block of the C functions for batches: as many doubles as the widest registers hold, of
# which floats are half as long, so that their blocks have twice as many.
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
    "FRAMES",
    "BODIES",
    "PARAMETERS",
    "DERIVATIVES",
)
# Further constants of a module about its robot; modules of version 0.2.0 and earlier lack it.
DESCRIPTION = (
    "FUNCTIONS",
    "INPUT_UNITS",
    "COORDINATE_PLACES",
    "VELOCITY_PLACES",
    "CARRIERS",
    "PARENTS",
    "COORDINATE_LIMITS",
    "VELOCITY_LIMITS",
    "INPUT_LIMITS",
    "TIME_CONSTANTS",
    "SPINS",
    "POSTURE",
)
# The same, and constants of those modules that have functions which need them.
DATA_ON_REQUEST = (
    *DESCRIPTION,
    "ROTORS",
    "COMMANDS",
    "COMMAND_UNITS",
    "COMMAND_LIMITS",
    "ACTUATOR_STATES",
    "ACTUATOR_TIMES",
    "DRIVE_PARAMETERS",
    "ROTOR_AIR",
    "CONSTRAINTS",
    "CONSTRAINT_ROWS",
    "CONSTRAINT_PLACES",
    "BASE_PARAMETERS",
    "PATTERNS",
)
# Letters of shapes, and the constants that list what they count.
LISTS = {
    "q": "COORDINATES",
    "v": "VELOCITIES",
    "h": "HYBRID_COORDINATES",
    "u": "INPUTS",
    "k": "POINTS",
    "f": "FRAMES",
    "b": "BODIES",
    "p": "PARAMETERS",
    "n": "BASE_PARAMETERS",
    "r": "ROTORS",
    "m": "COMMANDS",
    "z": "ACTUATOR_STATES",
    "g": "CONSTRAINTS",
    "l": "CONSTRAINT_ROWS",
}
# Shapes of arguments whose entries are named by the module's lists alone: commands, states of
# actuators, and which constraints are active.
OWN_LISTS = ("m", "z", "g")

ARGUMENTS = {
    "q": Argument("q", "coordinates"),
    "v": Argument("v", "their rates", "v_", "velocities"),
    "a": Argument("v", "their accelerations", "a_", "their rates", "{unit}^2"),
    "u": Argument("u", "inputs"),
    "W": Argument("f6", "wrenches on the frames, at their origins, in world axes"),
    "q0": Argument("q", "coordinates to begin with", "q0_"),
    "q1": Argument("q", "coordinates to end with", "q1_"),
    "w": Argument("v", "weights of the entries of the result", "w_", unit="1"),
    "q_dot": Argument("v", "direction of q, in the tangent space", "q_dot_", unit="{step}"),
    "v_dot": Argument("v", "direction of v", "v_dot_"),
    "a_dot": Argument("v", "direction of a", "a_dot_", unit="{unit}^2"),
    "u_dot": Argument("u", "direction of u", "u_dot_"),
    "W_dot": Argument("f6", "direction of W"),
    "w_input_matrix": Argument("vu", "weights of the entries of B", unit="1"),
    "w_jacobian": Argument("3v", "weights of the entries of the Jacobian", unit="1"),
    "h": Argument("", "length of the step", "time_step", unit="s"),
    "x": Argument("z", "state of the actuators", "x_"),
    "command": Argument("m", "what motors and servos are commanded"),
    "active": Argument(
        "g", "1 for each constraint that holds, 0 for the others, and nothing else", unit="1"
    ),
}

_MASS_MATRIX = Output("mass_matrix", "vv", "kg m^2, kg or kg m", INERTIAS, "mass_matrix")
_RESIDUAL = Output("residual", "v", "N m or N", "{forces}", "residual")
_ROWS = (
    Row(
        "mass_matrix_and_residual",
        "qv",
        (_MASS_MATRIX, _RESIDUAL),
        "Mass matrix M and residual R of M a = R + B u, in one pass.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        "R holds velocity terms, gravity, dampers and springs, with the sign of a force.",
        parts=("mass_matrix", "residual"),
        group="dynamics",
    ),
    Row(
        "mass_matrix",
        "q",
        (_MASS_MATRIX,),
        "Mass matrix M of M a = R + B u, symmetric, both triangles filled.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        "The same matrix as Pinocchio's crba gives for these coordinates.",
        group="dynamics",
    ),
    Row(
        "residual",
        "qv",
        (_RESIDUAL,),
        "Residual R of M a = R + B u, with the sign of a force.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        "Velocity terms, gravity, dampers and springs. Without the last two it is minus what "
        "Pinocchio calls nonLinearEffects.",
        group="dynamics",
    ),
    Row(
        "input_matrix",
        "q",
        (Output("input_matrix", "vu", "N/N, N m/N or N m/(N m)", LEVERS),),
        "Input matrix B of M a = R + B u.",
        "eqs. 7-13",
        "Column k holds the generalised forces of a unit of input k.",
        group="dynamics",
    ),
    Row(
        "forward_dynamics",
        "qvu",
        (Output("acceleration", "v", ACCELERATIONS, "{accelerations}"),),
        "Accelerations a of M a = R + B u.",
        "eq. 19, solved for the free coordinates",
        "Accurate at every attitude{singularity}. Where links without mass or thickness let joints "
        "move nothing, as a massless wrist with two axes in line, results are huge, infinite or "
        "not a number.",
        group="dynamics",
    ),
    Row(
        "inverse_dynamics",
        "qva",
        (Output("force", "v", "N m or N", "{forces}"),),
        "Generalised forces M a - R that the motion needs; B u supplies them.",
        "eqs. 4-6",
        "The partial derivatives of the Gibbs function by the accelerations.",
        group="dynamics",
    ),
    Row(
        "hybrid_mass_matrix",
        "q",
        (Output("mass_matrix", "hh", "kg m^2, kg, kg m or 1", INERTIAS),),
        "Matrix I_H of the hybrid system I_H a_H = R_H + B_H u.",
        "eqs. 15, 18 and 19",
        "Rows and columns are in the order of HYBRID_COORDINATES; the last rows hold the "
        "constrained joints, the last columns their torques.",
        group="hybrid",
    ),
    Row(
        "hybrid_residual",
        "qv",
        (Output("residual", "h", "N m, N or rad/s^2", "{hybrid_forces}"),),
        "Residual R_H of the hybrid system I_H a_H = R_H + B_H u.",
        "eqs. 15, 18 and 19",
        "Entries are in the order of HYBRID_COORDINATES.",
        group="hybrid",
    ),
    Row(
        "hybrid_input_matrix",
        "q",
        (Output("input_matrix", "hu", "N/N, N m/N or N m/(N m)", LEVERS),),
        "Input matrix B_H of the hybrid system I_H a_H = R_H + B_H u.",
        "eqs. 12, 13 and 18",
        "Rows are in the order of HYBRID_COORDINATES, columns in that of INPUTS.",
        group="hybrid",
    ),
    Row(
        "constraint_torques",
        "qvau",
        (Output("torque", "c", "N m", "{constraint_torques}"),),
        "Torques that hold the constrained joints: base arms 2 ... N, and constrained links.",
        "eqs. 14 and 15",
        "Linear in the accelerations and inputs, which need not fit each other.",
        group="hybrid",
    ),
    Row(
        "gibbs",
        "qva",
        (Output("value", "", "W/s"),),
        "Gibbs function S up to terms free of accelerations, in W/s.",
        "eqs. 2 and 3",
        "Gravity enters as the upward acceleration of the base, so that dS/da = M a - R.",
        group="energies",
        on_request=True,
    ),
    Row(
        "kinetic_energy",
        "qv",
        (Output("energy", "", "J"),),
        "Kinetic energy in J.",
        "eq. 2 with rates for accelerations",
        group="energies",
    ),
    Row(
        "potential_energy",
        "q",
        (Output("energy", "", "J"),),
        "Potential energy in J: of the weight, zero at world Z = 0, and of the springs.",
        "gravity times the first moment of mass",
        group="energies",
    ),
    Row(
        "gravity_forces",
        "q",
        (Output("force", "v", "N m or N", "{forces}"),),
        "Generalised forces of gravity: gravity's part of R.",
        "eqs. 5 and 6 at rest",
        "They are minus what Pinocchio calls the generalised gravity.",
        group="dynamics",
    ),
    Row(
        "wrench_forces",
        "qW",
        (Output("force", "v", "N m or N", "{forces}"),),
        "Generalised forces of wrenches on the frames: the sum of J^T W.",
        "eq. 7",
        "They add to B u. The wrenches are carried in from body to body, without a Jacobian.",
        group="dynamics",
    ),
    Row(
        "forward_dynamics_with_wrenches",
        "qvuW",
        (Output("acceleration", "v", ACCELERATIONS, "{accelerations}"),),
        "Accelerations a of M a = R + B u + the sum of J^T W.",
        "eq. 19, solved for the free coordinates",
        "As forward_dynamics, with wrenches on the frames.",
        group="dynamics",
    ),
    Row(
        "joint_wrenches",
        "qvau",
        (Output("wrenches", "b6", "N or N m", LOADS),),
        "The whole wrench through every joint: what the parent does to the body, at the joint.",
        "eqs. 6 and 14, all six components",
        "It is in the axes of the joint's frame, which the robot file gives the body. Gravity, "
        "inertia and thrusts of all that the joint carries balance it, at the given accelerations, "
        "which need not fit the inputs. Where they do, its component along a joint that moves is "
        "the joint's input less armature, damper and spring.",
        group="loads",
        on_request=True,
    ),
    Row(
        "joint_wrenches_with_wrenches",
        "qvauW",
        (Output("wrenches", "b6", "N or N m", LOADS),),
        "The whole wrench through every joint, where wrenches act on the frames too.",
        "eqs. 6, 7 and 14, all six components",
        "As joint_wrenches, less what the wrenches on the frames of all that a joint carries do.",
        group="loads",
        on_request=True,
    ),
)
# Groups of functions, those on request after the others.
GROUPS = (
    "dynamics",
    "hybrid",
    "kinematics",
    "energies",
    "actuators",
    "constraints",
    "loads",
    "tip",
)
# Groups whose functions are derivatives of others, or compose or fit them.
DERIVATIVE_GROUPS = ("derivatives", "parameters", "steps")
_EVERY = (
    *_ROWS,
    *KINEMATICS,
    *ACTUATORS,
    *CONSTRAINTS,
    *DERIVATIVES,
    *ACTUATOR_DERIVATIVES,
    *CONSTRAINT_DERIVATIVES,
    *PARAMETERS,
    *ACTUATOR_PARAMETERS,
    *STEPS,
)
FUNCTIONS: dict[str, Row] = {row.name: row for row in _EVERY}
# By the name of a part, the function whose text computes it.
WHOLES = {part: row.name for row in _EVERY for part in row.parts}
_DERIVATIVES = {(row.derivative_of, row.kind): row.name for row in _EVERY if row.derivative_of}


def derivative(name: str, kind: Kind) -> str:
    """The function that gives derivatives of a kind of another; empty where the table has none."""
    return _DERIVATIVES.get((name, kind), "")
