"""Generalised forces of thrusts and joint torques (Fig. 3, eqs. 7–13).

A thrust F at o_{j,i} along a direction ε gives Ψ·F with Ψ = Jᵀ·R·ε. The transposed Jacobian is
applied by moving the thrust, as a wrench, to the root and to the joints it passes: a motor's wrench
about the origin is constant in arm 1's frame.
"""

from __future__ import annotations

import sympy as sp

from gibbs_codegen.derivation.machine import Machine
from gibbs_codegen.symbolic.exact_angles import structural_number
from gibbs_codegen.symbolic.vectors import (
    NO_WRENCH,
    Rotation,
    Vector,
    Wrench,
    add,
    axis_vector,
    cross,
    scale,
)


def thrust_direction(machine: Machine, k: int) -> Vector:
    """Unit direction ε of a motor's thrust.

    Args:
        machine, k: The motor, by its number 1 … N.

    Returns:
        Components in the frame of the motor's base arm.

    """
    x, y, z = (structural_number(sp.Float(e)) for e in machine.robot.base.thrust[k - 1])
    return (x, y, z)


def motor_position(machine: Machine, k: int) -> Vector:
    """Seat of a motor.

    Args:
        machine, k: The motor, by its number 1 … N.

    Returns:
        Position from the origin of the coordinates, in arm 1's frame (m).

    """
    tape, base = machine.tape, machine.robot.base
    centre = axis_vector(0, machine.centre_offset)
    if k == 1:
        return add(tape, centre, axis_vector(0, -machine.parameters.arm_length(1)))
    arm = Rotation.degrees(2, base.arm_angle_deg(k))
    reach = axis_vector(0, machine.parameters.arm_length(k))
    return add(tape, centre, arm.vector(tape, reach))


def motor_wrench(machine: Machine, k: int) -> Wrench:
    """Wrench of a motor per unit of thrust; the drag torque acts about the thrust's own direction.

    Args:
        machine, k: The motor, by its number 1 … N.

    Returns:
        Wrench about the origin, in arm 1's frame (1 and m).

    """
    tape = machine.tape
    direction = thrust_direction(machine, k)
    if k > 1:
        arm = Rotation.degrees(2, machine.robot.base.arm_angle_deg(k))
        direction = arm.vector(tape, direction)
    lever = cross(tape, motor_position(machine, k), direction)
    drag = scale(tape, machine.parameters.drag(k), direction)
    return Wrench(direction, add(tape, lever, drag))


def motor_torque_about_arm_joint(machine: Machine, k: int) -> sp.Expr:
    """Row of the constrained joint of a base arm in Ψ of the arm's motor.

    Args:
        machine, k: The motor and the arm, by their number 2 … N.

    Returns:
        Torque about z at O₂ per unit of thrust (m).

    """
    _, y, z = thrust_direction(machine, k)
    tape, parameters = machine.tape, machine.parameters
    with tape.group(f"torque of motor {k} about joint {k}"):
        return tape.let(parameters.arm_length(k) * y + parameters.drag(k) * z)


def motor_column(machine: Machine, k: int) -> tuple[sp.Expr, ...]:
    """Generalised forces of a motor per unit of thrust (eq. 13).

    Args:
        machine, k: The motor, by its number 1 … N.

    Returns:
        One for each coordinate of the base, those of the attitude first.

    """
    tape, root = machine.tape, machine.root
    with tape.group(f"thrust direction and generalised forces of motor {k}"):
        return root.rows(tape, motor_wrench(machine, k).rotated(tape, root.segment_rotation))


def total_thrust_wrench(machine: Machine) -> Wrench:
    """Wrench of all motors for the inputs u.

    Args:
        machine: The robot in symbols.

    Returns:
        Wrench about the origin, in arm 1's frame (N, N m).

    """
    tape, total = machine.tape, NO_WRENCH
    with tape.group("force and moment of all thrusts"):
        for k, thrust in enumerate(machine.u[: machine.robot.rotors], start=1):
            unit = motor_wrench(machine, k)
            force, moment = (scale(tape, thrust, v) for v in (unit.force, unit.moment))
            total = total.plus(tape, Wrench(force, moment))
    return total


def input_matrix(machine: Machine) -> list[list[sp.Expr]]:
    """B of M a = R + B u.

    Args:
        machine: The robot in symbols.

    Returns:
        Rows in the order of q, columns in that of u.

    """
    places, rotors = machine.places, machine.robot.rotors
    zero, one = sp.S.Zero, sp.S.One
    matrix = [[zero] * len(machine.u) for _ in machine.q]
    for k in range(1, rotors + 1):
        for row, entry in zip(places.base, motor_column(machine, k), strict=True):
            matrix[row][k - 1] = entry
    for i, row in enumerate(places.joint_places):
        matrix[row][rotors + i] = one
    return matrix
