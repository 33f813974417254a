"""Generalised forces of thrusts, joint torques and other wrenches (Fig. 3, eqs. 7–13).

A thrust F at o_{j,i} along a direction ε gives Ψ·F with Ψ = Jᵀ·R·ε. The transposed Jacobian is
applied by moving the thrust, as a wrench, to the root and to the joints it passes. The wrench of a
rotor about the joint of the link that it is on is constant in the link's own frame, that of a rotor
on the base in the base's.
"""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sp

from gibbs_codegen.derivation.forward_kinematics import mounted_frames, rotor_place, segment_frames
from gibbs_codegen.derivation.jointed_bodies import JointedBodies
from gibbs_codegen.derivation.segment_tree import SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.robot.names import rotor_identifier
from gibbs_codegen.robot.parts.numbers import Vector3
from gibbs_codegen.symbolic.numbers import exact
from gibbs_codegen.symbolic.structural import applied, back, product
from gibbs_codegen.symbolic.tape import Scalars, Values, Vector
from gibbs_codegen.symbolic.vectors import NO_WRENCH, Matrix, Wrench, axis_vector, zeros


def structural(direction: Vector3) -> Vector:
    """A direction that the robot file fixes."""
    return tuple(map(exact, direction))


def rod_thrust_direction(symbolic: SymbolicRobot, k: int) -> Vector:
    """Unit direction ε of the thrust of motor k = 1 … N on a base rod, in the frame of the rod."""
    return structural(symbolic.robot.base.thrust[k - 1])


def rotor_wrench(symbolic: SymbolicRobot, bodies: JointedBodies, k: int) -> tuple[int, Wrench]:
    """Segment of rotor k = 1 … N, and its wrench there per unit of thrust (1 and m).

    It is about the segment's joint and in its own frame, on segment 0 about the origin.
    """
    tape = symbolic.tape
    if symbolic.robot.thrusters:
        rotor = symbolic.robot.thrusters[k - 1]
        direction = bodies.frames[rotor.on].direction(structural(rotor.direction))
    else:
        direction = symbolic.rod_frame(k).vector(tape, rod_thrust_direction(symbolic, k))
    ratio = symbolic.parameters.rotors[k]["drag"]
    segment, position = rotor_place(symbolic, bodies, k)
    return segment, _thrust_wrench(tape, position, direction, ratio)


def _thrust_wrench(tape: Scalars, position: Vector, direction: Vector, ratio: sp.Expr) -> Wrench:
    """Wrench of a unit of thrust at a position (m), with a drag torque about its direction."""
    lever = tape.cross(position, direction)
    drag = tape.scale(ratio, direction)
    return Wrench(direction, tape.add(lever, drag))


def motor_torque_about_rod(symbolic: SymbolicRobot, k: int) -> sp.Expr:
    """Row of base rod k's constrained joint, 2 … N, in Ψ of its motor: torque about z at O₂ (m)."""
    _, y, z = rod_thrust_direction(symbolic, k)
    tape, parameters = symbolic.tape, symbolic.parameters
    with tape.group(f"torque of motor {k} about joint {k}"):
        return tape.let(parameters.arms[k].length * y + parameters.rotors[k]["drag"] * z)


def rod_thrust(symbolic: SymbolicRobot, k: int) -> Wrench:
    """Wrench of motor k = 2 … N per unit of thrust on its base rod, about O₂ in the rod's frame."""
    position, drag = axis_vector(0, symbolic.rod_reach(k)), symbolic.parameters.rotors[k]["drag"]
    return _thrust_wrench(symbolic.tape, position, rod_thrust_direction(symbolic, k), drag)


def forces_of_wrenches(
    symbolic: SymbolicRobot, tree: SegmentTree, loads: Mapping[int, Wrench]
) -> list[sp.Expr]:
    """Generalised forces (N m or N) of wrenches on segments, in the order of the tree.

    `loads` are by index of the segment, about the joint in its own frame. They are carried in to
    the root, and have a component along each joint on the way.
    """
    tape, root, places = symbolic.tape, symbolic.root, symbolic.root.places(tree.joints)
    carried = {k: tree.to_working_frame(tape, k, load) for k, load in loads.items()}
    joints: list[sp.Expr] = [sp.S.Zero] * tree.joints
    for k in range(tree.joints, 0, -1):
        if k in carried:
            wrench = tree.to_group_frame(tape, k, carried[k])
            joints[k - 1] = tree.segments[k].row(wrench)
            wrench = tree.passed_in(tape, k, wrench)
            parent = tree.segments[k].parent
            carried[parent] = carried.get(parent, NO_WRENCH).plus(tape, wrench)
    wrench = tree.to_group_frame(tape, 0, carried.get(0, NO_WRENCH))
    return places.joined(root.rows(tape, wrench), joints)


def frame_loads(
    symbolic: SymbolicRobot, bodies: JointedBodies | None = None, in_base: bool = False
) -> dict[int, Wrench]:
    """The wrenches W on the frames, taken to the joints of the segments that they are on.

    W is in world axes, or those of the root's group frame. The result is by index of the segment,
    about its joint or about the origin, in its own frame (N, N m): of the reduced tree, or of other
    `bodies`.
    """
    tape, loads = symbolic.tape, dict[int, Wrench]()
    frames = segment_frames(symbolic, in_base)
    places = mounted_frames(symbolic), mounted_frames(symbolic, bodies=bodies)
    for place, (reduced, mounted) in enumerate(zip(*places, strict=True)):
        k, entries = mounted.segment, symbolic.W[6 * place : 6 * place + 6]
        with tape.group(f"wrench on {mounted.name}, in the frame of its link"):
            axes, halves = frames[reduced.segment].axes, (entries[:3], entries[3:])
            vectors = [tuple(tape.dot(axis, half) for axis in axes) for half in halves]
            if mounted.turn != reduced.turn:
                turn = product(mounted.turn, back(reduced.turn))
                vectors = [applied(turn, vector) for vector in vectors]
            load = Wrench(*vectors).shifted(tape, mounted.position)
            loads[k] = loads.get(k, NO_WRENCH).plus(tape, load)
    return loads


def rotor_column(
    symbolic: SymbolicRobot, tree: SegmentTree, bodies: JointedBodies, k: int
) -> list[sp.Expr]:
    """Generalised forces of rotor k = 1 … N per unit of thrust (eq. 13), in the tree's order."""
    label = rotor_identifier(symbolic.robot, k)
    with symbolic.tape.group(f"thrust direction and generalised forces of motor {label}"):
        segment, wrench = rotor_wrench(symbolic, bodies, k)
        return forces_of_wrenches(symbolic, tree, {segment: wrench})


def thrust_wrenches(symbolic: SymbolicRobot, bodies: JointedBodies) -> dict[int, Wrench]:
    """Wrenches of all rotors for the inputs u, by segments (N, N m).

    They are about the joint, for the root about the origin, in the segment's own frame.
    """
    tape, totals = symbolic.tape, {0: NO_WRENCH}
    with tape.group("force and moment of all thrusts"):
        for k, thrust in enumerate(symbolic.u[: symbolic.robot.rotors], start=1):
            segment, unit = rotor_wrench(symbolic, bodies, k)
            scaled = Wrench.of(tape.let(thrust * e) for e in unit.entries)
            totals[segment] = totals.get(segment, NO_WRENCH).plus(tape, scaled)
    return totals


def input_matrix(symbolic: SymbolicRobot) -> Matrix:
    """B of M a = R + B u, rows in the order of v, columns in that of u."""
    places, rotors = symbolic.places, symbolic.robot.rotors
    tree, bodies = symbolic.reduced_tree, symbolic.bodies
    columns: list[Values] = [rotor_column(symbolic, tree, bodies, k) for k in range(1, rotors + 1)]
    matrix = zeros(places.size, len(symbolic.u))
    for j, column in enumerate(columns):
        for i, entry in enumerate(column):
            matrix[i][j] = entry
    driven = len(symbolic.u) - rotors
    for i, row in enumerate(places.joint_places[symbolic.joints - driven :]):
        matrix[row][rotors + i] = sp.S.One
    return matrix
