"""Generalised forces of thrusts and joint torques (Fig. 3, eqs. 7–13).

A thrust F at o_{j,i} along a direction ε gives Ψ·F with Ψ = Jᵀ·R·ε. The transposed Jacobian is
applied by moving the thrust, as a wrench, to the root and to the joints it passes: a motor's wrench
about the origin is constant in arm 1's frame.
"""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.symbolic.exact_angles import structural_number
from gibbs_codegen.symbolic.vectors import (
    NO_WRENCH,
    Matrix,
    Rotation,
    Vector,
    Wrench,
    add,
    axis_vector,
    cross,
    scale,
    zeros,
)


def thrust_direction(symbolic: SymbolicRobot, k: int) -> Vector:
    """Unit direction ε of a motor's thrust.

    Args:
        symbolic, k: The motor, by its number 1 … N.

    Returns:
        Components in the frame of the motor's base arm.
    """
    x, y, z = (structural_number(sp.Float(e)) for e in symbolic.robot.base.thrust[k - 1])
    return (x, y, z)


def motor_position(symbolic: SymbolicRobot, k: int) -> Vector:
    """Seat of a motor.

    Args:
        symbolic, k: The motor, by its number 1 … N.

    Returns:
        Position from the origin of the coordinates, in arm 1's frame (m).
    """
    tape, base = symbolic.tape, symbolic.robot.base
    centre = axis_vector(0, symbolic.centre_offset)
    if k == 1:
        return add(tape, centre, axis_vector(0, -symbolic.parameters.arm(1).length))
    arm = Rotation.degrees(2, base.arm_angle_deg(k))
    reach = axis_vector(0, symbolic.parameters.arm(k).length)
    return add(tape, centre, arm.vector(tape, reach))


def motor_wrench(symbolic: SymbolicRobot, k: int) -> Wrench:
    """Wrench of a motor per unit of thrust; the drag torque acts about the thrust's own direction.

    Args:
        symbolic, k: The motor, by its number 1 … N.

    Returns:
        Wrench about the origin, in arm 1's frame (1 and m).
    """
    tape = symbolic.tape
    direction = thrust_direction(symbolic, k)
    if k > 1:
        arm = Rotation.degrees(2, symbolic.robot.base.arm_angle_deg(k))
        direction = arm.vector(tape, direction)
    lever = cross(tape, motor_position(symbolic, k), direction)
    drag = scale(tape, symbolic.parameters.drag(k), direction)
    return Wrench(direction, add(tape, lever, drag))


def motor_torque_about_arm_joint(symbolic: SymbolicRobot, k: int) -> sp.Expr:
    """Row of the constrained joint of a base arm in Ψ of the arm's motor.

    Args:
        symbolic, k: The motor and the arm, by their number 2 … N.

    Returns:
        Torque about z at O₂ per unit of thrust (m).
    """
    _, y, z = thrust_direction(symbolic, k)
    tape, parameters = symbolic.tape, symbolic.parameters
    with tape.group(f"torque of motor {k} about joint {k}"):
        return tape.let(parameters.arm(k).length * y + parameters.drag(k) * z)


def motor_column(symbolic: SymbolicRobot, k: int) -> tuple[sp.Expr, ...]:
    """Generalised forces of a motor per unit of thrust (eq. 13).

    Args:
        symbolic, k: The motor, by its number 1 … N.

    Returns:
        One for each coordinate of the base, those of the attitude first.
    """
    tape, root = symbolic.tape, symbolic.root
    with tape.group(f"thrust direction and generalised forces of motor {k}"):
        return root.rows(tape, motor_wrench(symbolic, k).rotated(tape, root.segment_rotation))


def total_thrust_wrench(symbolic: SymbolicRobot) -> Wrench:
    """Wrench of all motors for the inputs u.

    Args:
        symbolic: The robot in symbols.

    Returns:
        Wrench about the origin, in arm 1's frame (N, N m).
    """
    tape, total = symbolic.tape, NO_WRENCH
    with tape.group("force and moment of all thrusts"):
        for k, thrust in enumerate(symbolic.u[: symbolic.robot.rotors], start=1):
            unit = motor_wrench(symbolic, k)
            total = total.plus(tape, Wrench.of(tape.let(thrust * e) for e in unit.entries))
    return total


def input_matrix(symbolic: SymbolicRobot) -> Matrix:
    """B of M a = R + B u.

    Args:
        symbolic: The robot in symbols.

    Returns:
        Rows in the order of v, columns in that of u.
    """
    places, rotors = symbolic.places, symbolic.robot.rotors
    matrix = zeros(len(symbolic.v), len(symbolic.u))
    for k in range(1, rotors + 1):
        for row, entry in zip(places.base, motor_column(symbolic, k), strict=True):
            matrix[row][k - 1] = entry
    for i, row in enumerate(places.joint_places):
        matrix[row][rotors + i] = sp.S.One
    return matrix
