"""The rows of the table for robots with constraints: frames that are held where they are.

A constraint holds a frame against the world or against another frame while it is active: `active`
has 1 for it, else 0. Its rows are of J a + bias = 0, and its forces are those of J^T.
"""

from __future__ import annotations

from dataclasses import replace

from gibbs_codegen.interface.rows import ACCELERATIONS, Output, Row, jacobian_row, on_request

_ERRORS = Output("errors", "l", "m or rad", "{constraint_errors}")
_JACOBIAN = Output(
    *("jacobian", "lv", "m/rad, rad/m or 1"),
    "[m/rad], [rad/m] or [1], a row for each of {constraint_rows}",
)
_BIAS = Output("bias", "l", "m/s^2 or rad/s^2", "{constraint_accelerations}")
_ACCELERATION = Output(
    "acceleration", "v", ACCELERATIONS, "{accelerations}", "constrained_acceleration"
)
_FORCES = Output("forces", "l", "N or N m", "{constraint_forces}")
# Not as those of frames, of another shape: PATTERNS are by name.
_VELOCITY = Output("velocities_after", "v", "rad/s or m/s", "{velocities}", "impact_velocities")
_IMPULSES = Output("impulses", "l", "N s or N m s", "{constraint_impulses}")
_KINEMATICS = "forward kinematics"
_BORDERED = "eqs. 14 and 15, with a row and a column for each constraint"
_REDUNDANT = (
    "If constraints are redundant or have no effect, these have the least sum of squares. "
    "Entries of inactive constraints are 0."
)


CONSTRAINTS = on_request(
    "constraints",
    Row(
        "constraint_errors",
        "q",
        (_ERRORS,),
        "Errors of the constraints; zero where a constraint is met.",
        _KINEMATICS,
        "Positions along the axes of the anchor, then sines of the rotation about them. For a "
        "distance L the error is (r^2 - L^2)/(2 L), where r is the actual distance.",
    ),
    Row(
        "constraint_jacobian",
        "q",
        (_JACOBIAN,),
        "Jacobian J of the constraints: J v are velocities relative to the body with the anchor.",
        _KINEMATICS,
        "J^T maps constraint forces and torques to generalised forces. They act on the held "
        "frame, and with opposite sign at the same point of the body with the anchor.",
    ),
    Row(
        "constraint_bias",
        "qv",
        (_BIAS,),
        "Accelerations of the constraints where a is zero; the whole ones are J a plus this.",
        _KINEMATICS,
        "The stabilisation of errors is not included.",
    ),
    Row(
        "constrained_forward_dynamics",
        ("q", "v", "u", "active"),
        (_ACCELERATION, replace(_FORCES, derivation="constraint_forces")),
        "Accelerations a of M a = R + B u + J^T f, and the forces f of the active constraints.",
        _BORDERED,
        "J a + bias is -2 z w J v - w^2 errors, with frequency w and damping ratio z of each "
        f"constraint. {_REDUNDANT}",
    ),
    Row(
        "impact",
        ("q", "v", "active", "restitution"),
        (_VELOCITY, replace(_IMPULSES, derivation="impact_impulses")),
        "Velocities after an impact on the active constraints, and the impulses of these.",
        _BORDERED,
        "By Newton's law the impact multiplies J v by -e, with the restitution e of each "
        "constraint: e = 0 holds, and e = 1 for all conserves kinetic energy. Coupled "
        "constraints with different e may gain energy. The law applies to either sign of J v. "
        f"{_REDUNDANT}",
    ),
    Row(
        "operational_inertia",
        ("q", "active"),
        (Output("inertia", "ll", "kg, kg m or kg m^2"),),
        "Inertia seen by the active constraints: the pseudo-inverse of J M^-1 J^T.",
        _BORDERED,
        "Rows and columns of inactive constraints are 0.",
    ),
    Row(
        "constraint_projection",
        ("q", "active"),
        (Output("displacement", "v", "rad or m", "{displacement}"),),
        "Newton step, a displacement for integrate, towards meeting the active constraints.",
        _BORDERED,
        "It has the least norm in the mass matrix. Small errors become their squares.",
    ),
    needs=("CONSTRAINTS",),
)


_DIFFERENTIATED = (
    *("constraint_errors", "constraint_bias"),
    *("constrained_forward_dynamics", "impact"),
)
CONSTRAINT_DERIVATIVES = on_request(
    "derivatives", *(jacobian_row(row) for row in CONSTRAINTS if row.name in _DIFFERENTIATED)
)
