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
    "Where constraints are redundant or of no effect, they are the least that do, by the sum of "
    "their squares. Those of constraints that are not active are 0."
)


CONSTRAINTS = on_request(
    "constraints",
    Row(
        "constraint_errors",
        "q",
        (_ERRORS,),
        "How far the constraints are from being met: zero where they are.",
        _KINEMATICS,
        "Along the axes of the anchor, and then the sine of the turn about them. Of a distance L "
        "it is (r^2 - L^2)/(2 L), where r is the distance.",
    ),
    Row(
        "constraint_jacobian",
        "q",
        (_JACOBIAN,),
        "Jacobian J of the constraints: J v are velocities against what carries the anchor.",
        _KINEMATICS,
        "Its transpose takes forces, and torques in rows of turns, to generalised forces: at the "
        "frame that is held, and opposite ones at the same place on what carries the anchor.",
    ),
    Row(
        "constraint_bias",
        "qv",
        (_BIAS,),
        "Accelerations of the constraints where a is zero: they are J a plus this.",
        _KINEMATICS,
        "Without what brings errors back to zero.",
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
        "Velocities after an impact on the active constraints, and their impulses.",
        _BORDERED,
        "By Newton's law J v is then -e times what it was, by the restitution e of each: 0 takes "
        "hold, and 1 of all keeps the kinetic energy. Where constraints of different e feel each "
        f"other, some may be gained. Signs of J v make no difference. {_REDUNDANT}",
    ),
    Row(
        "operational_inertia",
        ("q", "active"),
        (Output("inertia", "ll", "kg, kg m or kg m^2"),),
        "Inertia that the active constraints feel: the pseudo-inverse of J M^-1 J^T.",
        _BORDERED,
        "Rows and columns of constraints that are not active are 0.",
    ),
    Row(
        "constraint_projection",
        ("q", "active"),
        (Output("displacement", "v", "rad or m", "{displacement}"),),
        "Displacement, for integrate, to where the active constraints are met: a Newton step.",
        _BORDERED,
        "Of all that do, the least by the mass matrix. Small errors become their squares.",
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
