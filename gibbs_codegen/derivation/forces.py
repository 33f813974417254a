"""Generalised forces: of thrusts, joint torques, dampers and springs (Fig. 3, eqs. 7–13).

A thrust F at o_{j,i} along a direction ε gives Ψ·F with Ψ = Jᵀ·R·ε. The transposed Jacobian is
applied by moving the thrust, as a wrench, to the root and to the joints it passes. The wrench of a
rotor about the joint of the link that it is on is constant in the link's own frame, that of a rotor
on the base in the base's.

Damping, springs and armature act by themselves. Armature adds to the diagonal of the mass matrix,
the rest to the residual: τ − damping·v − stiffness·(q − rest) drives a joint.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import sympy as sp

from gibbs_codegen.derivation.jointed_bodies import JointedBodies
from gibbs_codegen.derivation.parameters import PassiveSymbols
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.model import Vector3
from gibbs_codegen.robot.names import rotor_identifier
from gibbs_codegen.symbolic.tape import Scalars
from gibbs_codegen.symbolic.vectors import (
    NO_WRENCH,
    Matrix,
    Vector,
    Wrench,
    add,
    axis_vector,
    cross,
    scale,
    structural_number,
    zeros,
)


@dataclass(frozen=True)
class MountedWrench:
    """A wrench on a segment, about its joint and in its own frame; of segment 0 the origin's."""

    segment: int
    wrench: Wrench


def _structural(direction: Vector3) -> Vector:
    x, y, z = (structural_number(sp.Float(entry)) for entry in direction)
    return (x, y, z)


def rod_thrust_direction(symbolic: SymbolicRobot, k: int) -> Vector:
    """Unit direction ε of the thrust of motor k = 1 … N on a base rod, in the frame of the rod."""
    return _structural(symbolic.robot.base.thrust[k - 1])


def rotor_position(symbolic: SymbolicRobot, bodies: JointedBodies, k: int) -> tuple[int, Vector]:
    """Segment of rotor k = 1 … N, and its position from the joint in the segment's frame (m)."""
    tape = symbolic.tape
    if symbolic.robot.thrusters:
        frame = bodies.frames[symbolic.robot.thrusters[k - 1].on]
        position, _ = symbolic.parameters.rotor(k)
        return frame.segment, frame.point(tape, position)
    reach = axis_vector(0, symbolic.rod_reach(k))
    return 0, add(tape, symbolic.centre, symbolic.rod_frame(k).vector(tape, reach))


def rotor_wrench(symbolic: SymbolicRobot, bodies: JointedBodies, k: int) -> MountedWrench:
    """Wrench of rotor k = 1 … N per unit of thrust (1 and m).

    The drag torque acts about the thrust's own direction.
    """
    tape = symbolic.tape
    if symbolic.robot.thrusters:
        rotor = symbolic.robot.thrusters[k - 1]
        direction = bodies.frames[rotor.on].direction(_structural(rotor.direction))
        _, ratio = symbolic.parameters.rotor(k)
    else:
        direction = symbolic.rod_frame(k).vector(tape, rod_thrust_direction(symbolic, k))
        ratio = symbolic.parameters.drag(k)
    segment, position = rotor_position(symbolic, bodies, k)
    lever = cross(tape, position, direction)
    drag = scale(tape, ratio, direction)
    return MountedWrench(segment, Wrench(direction, add(tape, lever, drag)))


def motor_torque_about_rod(symbolic: SymbolicRobot, k: int) -> sp.Expr:
    """Row of base rod k's constrained joint, 2 … N, in Ψ of its motor: torque about z at O₂ (m)."""
    _, y, z = rod_thrust_direction(symbolic, k)
    tape, parameters = symbolic.tape, symbolic.parameters
    with tape.group(f"torque of motor {k} about joint {k}"):
        return tape.let(parameters.arm(k).length * y + parameters.drag(k) * z)


def rod_thrust(symbolic: SymbolicRobot, k: int) -> Wrench:
    """Wrench of motor k = 2 … N per unit of thrust on its base rod, about O₂ in the rod's frame."""
    tape, direction = symbolic.tape, rod_thrust_direction(symbolic, k)
    lever = cross(tape, axis_vector(0, symbolic.rod_reach(k)), direction)
    drag = scale(tape, symbolic.parameters.drag(k), direction)
    return Wrench(direction, add(tape, lever, drag))


def carried_in(
    tape: Scalars, tree: SegmentTree, loads: Mapping[int, Wrench]
) -> tuple[Wrench, dict[int, sp.Expr]]:
    """Sum at the root of wrenches carried in from their segments, and the joints' rows on the way.

    `loads` are by index of the segment, about the joint in its own frame; the sum is about the root
    in its group frame.
    """
    carried = {k: tree.to_working_frame(tape, k, load) for k, load in loads.items()}
    rows = {}
    for k in range(tree.joints, 0, -1):
        if k in carried:
            wrench = tree.to_group_frame(tape, k, carried[k])
            rows[k] = tree.segments[k].row(wrench)
            wrench = tree.passed_in(tape, k, wrench)
            parent = tree.segments[k].parent
            carried[parent] = carried.get(parent, NO_WRENCH).plus(tape, wrench)
    return tree.to_group_frame(tape, 0, carried.get(0, NO_WRENCH)), rows


def generalised_forces(symbolic: SymbolicRobot, loads: Mapping[int, Wrench]) -> list[sp.Expr]:
    """Generalised forces (N m or N), in the order of v, of wrenches as of `carried_in`."""
    tape, root, tree = symbolic.tape, symbolic.root, symbolic.reduced_tree
    wrench, rows = carried_in(tape, tree, loads)
    joints = [rows.get(i, sp.S.Zero) for i in range(1, tree.joints + 1)]
    return symbolic.places.joined(root.rows(tape, wrench), joints)


def rotor_column(
    symbolic: SymbolicRobot, tree: SegmentTree, bodies: JointedBodies, k: int
) -> list[sp.Expr]:
    """Generalised forces of rotor k = 1 … N per unit of thrust (eq. 13), in the tree's order."""
    tape, root = symbolic.tape, symbolic.root
    label = rotor_identifier(symbolic.robot, k)
    with tape.group(f"thrust direction and generalised forces of motor {label}"):
        unit = rotor_wrench(symbolic, bodies, k)
        wrench, rows = carried_in(tape, tree, {unit.segment: unit.wrench})
        joints = [rows.get(i, sp.S.Zero) for i in range(1, tree.joints + 1)]
        return root.places(tree.joints).joined(root.rows(tape, wrench), joints)


def thrust_wrenches(symbolic: SymbolicRobot, bodies: JointedBodies) -> dict[int, Wrench]:
    """Wrenches of all rotors for the inputs u, by segments (N, N m).

    They are about the joint, for the root about the origin, in the segment's own frame.
    """
    tape, totals = symbolic.tape, {0: NO_WRENCH}
    with tape.group("force and moment of all thrusts"):
        for k, thrust in enumerate(symbolic.u[: symbolic.robot.rotors], start=1):
            unit = rotor_wrench(symbolic, bodies, k)
            scaled = Wrench.of(tape.let(thrust * e) for e in unit.wrench.entries)
            total = totals.get(unit.segment, NO_WRENCH)
            totals[unit.segment] = total.plus(tape, scaled)
    return totals


def input_matrix(symbolic: SymbolicRobot) -> Matrix:
    """B of M a = R + B u, rows in the order of v, columns in that of u."""
    places, rotors = symbolic.places, symbolic.robot.rotors
    tree, bodies = symbolic.reduced_tree, symbolic.bodies
    columns: list[Sequence[sp.Expr]] = [
        rotor_column(symbolic, tree, bodies, k) for k in range(1, rotors + 1)
    ]
    matrix = zeros(places.size, len(symbolic.u))
    for j, column in enumerate(columns):
        for i, entry in enumerate(column):
            matrix[i][j] = entry
    for i, row in enumerate(places.joint_places):
        matrix[row][rotors + i] = sp.S.One
    return matrix


def passive_symbols(symbolic: SymbolicRobot) -> list[PassiveSymbols]:
    """Symbols of what acts by itself on each joint that moves."""
    return [symbolic.parameters.link(i).passive for i in symbolic.robot.moving]


def armatures(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Inertia of what turns or slides with each joint alone, of those that move (kg m² or kg)."""
    return [joint.armature for joint in passive_symbols(symbolic)]


def passive_forces(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Forces (N m or N) of the joints' dampers and springs: −damping·v − stiffness·(q − rest)."""
    tape = symbolic.tape
    q = symbolic.coordinates.values()
    _, v = symbolic.places.split(symbolic.v)
    forces = []
    with tape.group("forces of dampers and springs"):
        for joint, angle, rate in zip(passive_symbols(symbolic), q, v, strict=True):
            spring = tape.let(joint.stiffness * _stretch(tape, joint, angle))
            forces.append(tape.let(-tape.let(joint.damping * rate) - spring))
    return forces


def passive_gibbs_function(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Terms (W/s) of armature, dampers and springs in S: ½ armature·a² − force·a."""
    tape = symbolic.tape
    _, a = symbolic.places.split(symbolic.a)
    pairs = zip(a, passive_forces(symbolic), strict=True)
    return [*_squares(symbolic, a), *(tape.let(-force * rate) for rate, force in pairs)]


def armature_energy(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Terms (J) of the kinetic energy of what turns with the joints alone."""
    return _squares(symbolic, symbolic.places.split(symbolic.v)[1])


def spring_energy(symbolic: SymbolicRobot) -> list[sp.Expr]:
    """Terms (J) of the potential energy of the springs, ½ stiffness·(q − rest)²."""
    tape = symbolic.tape
    q = symbolic.coordinates.values()
    terms = []
    for joint, angle in zip(passive_symbols(symbolic), q, strict=True):
        stretch = _stretch(tape, joint, angle)
        terms.append(tape.let(joint.stiffness * tape.let(stretch * stretch) / 2))
    return terms


def _stretch(tape: Scalars, joint: PassiveSymbols, angle: sp.Expr) -> sp.Expr:
    """How far a spring is from rest; zero where there is none."""
    return tape.let(angle - joint.rest) if joint.stiffness != 0 else sp.S.Zero


def _squares(symbolic: SymbolicRobot, rates: list[sp.Expr]) -> list[sp.Expr]:
    """½ armature times the square of a rate, for each joint."""
    tape = symbolic.tape
    return [
        tape.let(joint.armature * tape.let(rate * rate) / 2)
        for joint, rate in zip(passive_symbols(symbolic), rates, strict=True)
        if joint.armature != 0
    ]
