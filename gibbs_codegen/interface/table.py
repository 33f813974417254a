"""The table of emitted functions: what every generated module offers, one row per function.

A row says what a function takes and returns, what that means, and what derives each output. The
derivation, the targets, the loader, the verification and `flight` read it. To add a function, add
a row to `dynamics` or its like and, for an array that nothing derives yet, an entry to
`derivation.functions`.

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
from gibbs_codegen.interface.dynamics import DYNAMICS
from gibbs_codegen.interface.kinematics import KINEMATICS
from gibbs_codegen.interface.rows import Argument, Kind, Row

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
    "LOOPS",
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
# actuators, which constraints are active, and how these rebound.
OWN_LISTS = ("m", "z", "g")

ARGUMENTS = {
    "q": Argument("q", "coordinates"),
    "v": Argument("v", "their rates", "v_", "velocities"),
    "a": Argument("v", "their accelerations", "a_", "their rates", "{unit}^2"),
    "u": Argument("u", "inputs"),
    "W": Argument("f6", "wrenches on the frames, at their origins, in world axes"),
    "q0": Argument("q", "initial coordinates", "q0_"),
    "q1": Argument("q", "final coordinates", "q1_"),
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
    "command": Argument("m", "commands of motors and servos"),
    "active": Argument(
        "g", "1 for each active constraint, 0 for each other one; no other value", unit="1"
    ),
    "restitution": Argument(
        "g", "restitution of each: share of its velocity with which it rebounds", unit="1"
    ),
    "v_r": Argument("v", "reference velocities", "v_r_"),
    "a_r": Argument("v", "their rates", "a_r_", unit="{unit}^2"),
}

# Groups of functions, those on request after the others.
GROUPS = (
    "dynamics",
    "hybrid",
    "kinematics",
    "energies",
    "actuators",
    "constraints",
    "loads",
    "passivity",
    "tip",
)
# Groups whose functions are derivatives of others, or compose or fit them.
DERIVATIVE_GROUPS = ("derivatives", "parameters", "steps")
_ROWS = (
    *DYNAMICS,
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
FUNCTIONS: dict[str, Row] = {row.name: row for row in _ROWS}
# By the name of a part, the function whose text computes it.
WHOLES = {part: row.name for row in _ROWS for part in row.parts}
_DERIVATIVES = {(row.derivative_of, row.kind): row.name for row in _ROWS if row.derivative_of}


def derivative(name: str, kind: Kind) -> str:
    """The function that gives derivatives of a kind of another; empty where the table has none."""
    return _DERIVATIVES.get((name, kind), "")
