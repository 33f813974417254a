"""The rows of the table that have forces: equations of motion, hybrid system, energies, loads."""

from __future__ import annotations

from gibbs_codegen.interface.rows import (
    ACCELERATIONS,
    INERTIAS,
    LEVERS,
    LOADS,
    Output,
    Row,
    of_group,
    on_request,
)

_MASS_MATRIX = Output("mass_matrix", "vv", "kg m^2, kg or kg m", INERTIAS, "mass_matrix")
_RESIDUAL = Output("residual", "v", "N m or N", "{forces}", "residual")
DYNAMICS = of_group(
    "dynamics",
    Row(
        "mass_matrix_and_residual",
        "qv",
        (_MASS_MATRIX, _RESIDUAL),
        "Mass matrix M and residual R of M a = R + B u, in one pass.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        "R contains velocity terms, gravity, dampers and springs, with the sign of a force.",
        parts=("mass_matrix", "residual"),
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
        "Residual R of M a = R + B u, with the sign of a force.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        "R contains velocity terms, gravity, dampers and springs. Without the last two it is "
        "minus Pinocchio's nonLinearEffects.",
    ),
    Row(
        "input_matrix",
        "q",
        (Output("input_matrix", "vu", "N/N, N m/N or N m/(N m)", LEVERS),),
        "Input matrix B of M a = R + B u.",
        "eqs. 7-13",
        "Column k contains the generalised forces of a unit of input k.",
    ),
    Row(
        "forward_dynamics",
        "qvu",
        (Output("acceleration", "v", ACCELERATIONS, "{accelerations}"),),
        "Accelerations a of M a = R + B u.",
        "eq. 19, solved for the free coordinates",
        "Accurate at every attitude{singularity}. Where a joint moves no mass, as in a massless "
        "wrist with two axes in line, results are huge, infinite or NaN.",
    ),
    Row(
        "inverse_dynamics",
        "qva",
        (Output("force", "v", "N m or N", "{forces}"),),
        "Generalised forces M a - R that the motion needs; B u supplies them.",
        "eqs. 4-6",
        "The partial derivatives of the Gibbs function by the accelerations.",
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
        "Constraint torques of the constrained joints: base arms 2 ... N, and constrained links.",
        "eqs. 14 and 15",
        "Linear in the accelerations and inputs, which need not be consistent.",
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
        "Potential energy in J of gravity, zero at world Z = 0, and of the springs.",
        "gravity times the first moment of mass",
        group="energies",
    ),
    Row(
        "gravity_forces",
        "q",
        (Output("force", "v", "N m or N", "{forces}"),),
        "Generalised forces of gravity: gravity's part of R.",
        "eqs. 5 and 6 at rest",
        "They are minus Pinocchio's generalised gravity.",
    ),
    Row(
        "wrench_forces",
        "qW",
        (Output("force", "v", "N m or N", "{forces}"),),
        "Generalised forces of wrenches on the frames: the sum of J^T W.",
        "eq. 7",
        "They add to B u. They are computed from body to body, without a Jacobian.",
    ),
    Row(
        "forward_dynamics_with_wrenches",
        "qvuW",
        (Output("acceleration", "v", ACCELERATIONS, "{accelerations}"),),
        "Accelerations a of M a = R + B u + the sum of J^T W.",
        "eq. 19, solved for the free coordinates",
        "As forward_dynamics, with wrenches on the frames.",
    ),
    Row(
        "joint_wrenches",
        "qvau",
        (Output("wrenches", "b6", "N or N m", LOADS),),
        "Wrench through every joint: force and torque of the parent on the body, at the joint.",
        "eqs. 6 and 14, all six components",
        "It is in the axes of the joint's frame, which the robot file gives for the body. It "
        "balances gravity, inertia and thrusts of all bodies beyond the joint, at the given "
        "accelerations, which need not be consistent with the inputs. If they are, its "
        "component along a moving joint is the joint's input less armature, damper and spring.",
        group="loads",
        on_request=True,
    ),
    Row(
        "joint_wrenches_with_wrenches",
        "qvauW",
        (Output("wrenches", "b6", "N or N m", LOADS),),
        "Wrench through every joint, with wrenches on the frames.",
        "eqs. 6, 7 and 14, all six components",
        "As joint_wrenches, less the wrenches on all frames beyond the joint.",
        group="loads",
        on_request=True,
    ),
    *on_request(
        "passivity",
        Row(
            "momentum",
            "qv",
            (Output("momentum", "v", "kg m^2/s or kg m/s"),),
            "Generalised momentum M v.",
            "eqs. 4-6 at rest, with velocities for accelerations",
            "It is computed from body to body, without the mass matrix.",
        ),
        Row(
            "momentum_rate",
            "qv",
            (Output("rate", "v", "N m or N", "{forces}"),),
            "Rate of the momentum M v without B u and the sum of J^T W, which add to it.",
            "C^T v + gravity, dampers and springs",
            "C is coriolis_matrix. It needs no accelerations and no inverse of M, so a momentum "
            "observer can estimate external forces with it.",
        ),
        Row(
            "passive_inverse_dynamics",
            ("q", "v", "v_r", "a_r"),
            (Output("force", "v", "N m or N", "{forces}"),),
            "Forces M a_r + C(q, v) v_r less gravity, dampers at v_r and springs.",
            "eqs. 4-6, with reference velocities",
            "C is coriolis_matrix, so the rate of M less 2 C is skew-symmetric. With v_r = v it "
            "is inverse_dynamics(q, v, a_r).",
        ),
        Row(
            "reference_regressor",
            ("q", "v", "v_r", "a_r"),
            (Output("regressor", "vn", "N m or N", "{forces}, each by each of BASE_PARAMETERS"),),
            "Matrix whose product with the base parameters is passive_inverse_dynamics.",
            "eqs. 4-6, which are linear in the inertias",
            "Dampers, springs and armature are not included. The columns correspond to those of "
            "regressor.",
        ),
    ),
)
