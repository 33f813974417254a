"""The rigid-body recursions in CasADi SX: composite bodies and Newton–Euler.

All vectors are in the axes of the body they belong to. Accelerations are the classical ones of the
bodies' origins; gravity is an acceleration of the base.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from peers.casadi_bases import (
    FixedBase,
    FreeFlyer,
    MovingBase,
    TaitBryanBase,
    unit_wrench,
)
from peers.casadi_motion import Motion, wrench
from peers.casadi_spatial import (
    ZERO,
    Joint,
    Matrix,
    Scalar,
    Turn,
    Vector,
    cross,
    matrix_plus,
    plus,
)
from peers.tree import ATTITUDE, Body, Tree, shifted


class Machine:
    """A tree in symbols: `q`, `v`, `tau` in the project's order; `joints[i]` carries body i ≥ 1."""

    def __init__(self, tree: Tree) -> None:
        size = tree.velocities
        self.tree = tree
        self.q = ca.SX.sym("q", len(tree.layout.coordinates))
        self.v, self.tau = (ca.SX.sym(name, size) for name in ("v", "tau"))
        self.velocity = self.v.elements()
        self.force = self.tau.elements()
        q = self.q.elements()
        first = ATTITUDE if tree.root == "xyz" else len(q) - tree.joints
        turning = [(ca.cos(angle), ca.sin(angle)) for angle in q[first : first + tree.joints]]
        self.joints: list[Joint | None] = [None] + [
            Joint(body.turn.tolist(), body.step.tolist(), Turn(2, *turn))
            for body, turn in zip(tree.bodies[1:], turning, strict=True)
        ]
        self.base: MovingBase
        if tree.root == "fixed":
            self.base = FixedBase()
        elif tree.root == "quaternion":
            self.base = FreeFlyer(q[3:7], self.velocity)
        else:
            attitude = [(ca.cos(angle), ca.sin(angle)) for angle in q[:ATTITUDE]]
            self.base = TaitBryanBase(attitude, self.velocity)


def mass_matrix(machine: Machine) -> ca.SX:
    """Mass matrix by composite rigid bodies."""
    tree, base, size = machine.tree, machine.base, machine.tree.velocities
    matrix = ca.SX.zeros(size, size)

    def put(row: int, column: int, entry: Scalar) -> None:
        matrix[row, column] = matrix[column, row] = entry

    carried: list[list[Carried]] = [[] for _ in tree.bodies]
    for i in range(tree.joints, 0, -1):
        mass, first, inertia = _composite(tree.bodies[i], carried[i])
        column = tree.row(i)
        put(column, column, inertia[2][2])
        torque, force = unit_wrench(2, first, inertia)
        for j in tree.path(i):
            torque, force = _wrench_on_parent(machine.joints[j], torque, force)
            if tree.bodies[j].parent:
                put(tree.row(tree.bodies[j].parent), column, torque[2])
        for row, entry in zip(base.rows, base.forces(torque, force), strict=True):
            put(row, column, entry)
        carried[tree.bodies[i].parent].append((machine.joints[i], mass, first, inertia))
    whole = _composite(tree.bodies[0], carried[0])
    for (j, k), entry in base.mass_block(*whole).items():
        put(base.rows[j], base.rows[k], entry)
    return matrix


def effects(machine: Machine) -> ca.SX:
    """Nonlinear effects, the forces at which no coordinate accelerates."""
    return inverse_dynamics(machine, [0.0] * machine.tree.velocities)


def inverse_dynamics(machine: Machine, accelerations: Vector) -> ca.SX:
    """The forces at which the coordinates accelerate as given, by Newton–Euler."""
    tree, base = machine.tree, machine.base
    of_base = base.motion(tree.gravity)
    of_base = base.accelerated(of_base, [accelerations[row] for row in base.rows])
    moving = motions(machine, of_base, accelerations)
    result = [0.0] * tree.velocities
    wrenches = [wrench(body, motion) for body, motion in zip(tree.bodies, moving, strict=True)]
    for i in range(tree.joints, 0, -1):
        torque, force = wrenches[i]
        result[tree.row(i)] = torque[2]
        torque, force = _wrench_on_parent(machine.joints[i], torque, force)
        own_torque, own_force = wrenches[tree.bodies[i].parent]
        wrenches[tree.bodies[i].parent] = plus(own_torque, torque), plus(own_force, force)
    for row, entry in zip(base.rows, base.forces(*wrenches[0]), strict=True):
        result[row] = entry
    return ca.vertcat(*result)


def motions(machine: Machine, of_base: Motion, accelerations: Vector | None = None) -> list[Motion]:
    """Motion of every body, base first; no joint accelerates if none is told to."""
    found = [of_base]
    for i, body in enumerate(machine.tree.bodies[1:], start=1):
        joint, row = machine.joints[i], machine.tree.row(i)
        motion = found[body.parent].placed(joint).turned(joint.turn, machine.velocity[row])
        turning = [0.0, 0.0, accelerations[row] if accelerations else 0.0]
        found.append(motion.accelerated(turning, ZERO))
    return found


def _wrench_on_parent(joint: Joint, torque: Vector, force: Vector) -> tuple[Vector, Vector]:
    """Torque and force about the parent's origin, in its axes."""
    force = joint.up(force)
    return plus(joint.up(torque), cross(joint.step, force)), force


Carried = tuple[Joint, float, Vector, Matrix]


def _composite(body: Body, carried: list[Carried]) -> tuple[float, Vector, Matrix]:
    """Mass, first moment and inertia of a body and what it carries, about its origin.

    What is constant is summed before it meets what is not.
    """
    mass, moment, constant = body.mass, body.moment, body.inertia_about_origin
    for joint, child_mass, _, _ in carried:
        step = np.array(joint.step)
        mass, moment = mass + child_mass, moment + child_mass * step
        constant = constant + shifted(child_mass, step)
    first, inertia = moment.tolist(), constant.tolist()
    for joint, _, child_first, child_inertia in carried:
        own = joint.up(child_first)
        first = plus(own, first)
        inertia = matrix_plus(_moved(joint, own, joint.up_symmetric(child_inertia)), inertia)
    return mass, first, inertia


def _moved(joint: Joint, first: Vector, inertia: Matrix) -> Matrix:
    """Inertia about the parent's origin, in its axes, but for what the mass adds."""
    twice = [2 * a * b for a, b in zip(joint.step, first, strict=True)]
    moved = [list(row) for row in inertia]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moved[i][i] = inertia[i][i] + (twice[j] + twice[k])
        moved[i][j] = inertia[i][j] - (joint.step[i] * first[j] + joint.step[j] * first[i])
        moved[j][i] = moved[i][j]
    return moved
