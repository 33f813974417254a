"""The rigid-body recursions in CasADi SX: composite bodies, Newton–Euler, articulated bodies.

All vectors are in the axes of the body they belong to. Accelerations are the classical ones of the
bodies' origins, which the base's velocity does not enter; gravity is an acceleration of the base.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from peers.casadi_spatial import (
    ZERO,
    Joint,
    Matrix,
    Scalar,
    Turn,
    Vector,
    cross,
    dot,
    matrix_plus,
    plus,
    times,
    transposed,
)
from peers.tree import Body, Tree, shifted

ATTITUDE = 3


class Machine:
    """A tree in symbols: `q`, `v`, `tau` in the project's order, and the turns they make.

    `turns` are those of the attitude; `joints[i]` carries body i = 1 … n. The base's angular
    velocity is `rates` times the attitude's rates, and `rotation` takes its axes to the world's.
    """

    def __init__(self, tree: Tree) -> None:
        size = tree.coordinates
        self.tree = tree
        self.q, self.v, self.tau = (ca.SX.sym(name, size) for name in ("q", "v", "tau"))
        self.velocity = self.v.elements()
        self.force = self.tau.elements()
        angles = self.q.elements()[: size - 3]
        turning = [(ca.cos(angle), ca.sin(angle)) for angle in angles]
        self.turns = [Turn(axis, *turning[axis]) for axis in range(ATTITUDE)]
        self.joints: list[Joint | None] = [None] + [
            Joint(body.turn.tolist(), body.step.tolist(), Turn(2, *turning[ATTITUDE + i]))
            for i, body in enumerate(tree.bodies[1:])
        ]
        (cx, sx), (cy, sy), (cz, sz) = turning[:ATTITUDE]
        first, second = sx * sy, cx * sy
        self.rates = [[cy * cz, sz, 0.0], [-(cy * sz), cz, 0.0], [sy, 0.0, 1.0]]
        self.rotation = [
            [cy * cz, -(cy * sz), sy],
            [first * cz + cx * sz, cx * cz - first * sz, -(sx * cy)],
            [sx * sz - second * cz, second * sz + sx * cz, cx * cy],
        ]

    def row(self, body: int) -> int:
        """Place of an arm joint among the coordinates."""
        return ATTITUDE - 1 + body


def mass_matrix(machine: Machine) -> ca.SX:
    """Mass matrix by composite rigid bodies."""
    tree, size = machine.tree, machine.tree.coordinates
    matrix = ca.SX.zeros(size, size)

    def put(row: int, column: int, entry: Scalar) -> None:
        matrix[row, column] = matrix[column, row] = entry

    body = tree.bodies[-1]
    mass, first = body.mass, body.moment.tolist()
    inertia = body.inertia_about_origin.tolist()
    for i in range(tree.joints, 0, -1):
        column = machine.row(i)
        put(column, column, inertia[2][2])
        torque, force = _unit_wrench(2, first, inertia)
        for j in range(i, 0, -1):
            torque, force = _wrench_on_parent(machine.joints[j], torque, force)
            if j > 1:
                put(machine.row(j - 1), column, torque[2])
        for k, entry in enumerate(_on_base(machine, torque, force)):
            put(k if k < ATTITUDE else size - 6 + k, column, entry)
        mass, first, inertia = _joined(machine.joints[i], mass, first, inertia, tree.bodies[i - 1])
    for k in range(3):
        put(size - 3 + k, size - 3 + k, mass)
    for axis in range(ATTITUDE - 1, -1, -1):
        put(axis, axis, inertia[axis][axis])
        torque, force = _unit_wrench(axis, first, inertia)
        for turned in range(axis, -1, -1):
            turn = machine.turns[turned]
            torque, force = turn.up(torque), turn.up(force)
            if turned:
                put(turned - 1, axis, torque[turned - 1])
        for k in range(3):
            put(size - 3 + k, axis, force[k])
        turn = machine.turns[axis]
        first, inertia = turn.up(first), turn.up_symmetric(inertia)
    return matrix


def effects(machine: Machine) -> ca.SX:
    """Nonlinear effects, the forces at which no coordinate accelerates, by Newton–Euler."""
    tree, size = machine.tree, machine.tree.coordinates
    falling = [tree.gravity * entry for entry in machine.rotation[2]]
    moving = motions(machine, falling)
    result = [0.0] * size
    torque = force = ZERO
    for i in range(tree.joints, -1, -1):
        own_torque, own_force = wrench(tree.bodies[i], moving[i])
        torque, force = plus(own_torque, torque), plus(own_force, force)
        if i:
            result[machine.row(i)] = torque[2]
            torque, force = _wrench_on_parent(machine.joints[i], torque, force)
    on_base = _on_base(machine, torque, force)
    result[:ATTITUDE], result[size - 3 :] = on_base[:ATTITUDE], on_base[ATTITUDE:]
    return ca.vertcat(*result)


def _unit_wrench(axis: int, first: Vector, inertia: Matrix) -> tuple[Vector, Vector]:
    """Torque and force that turn a body about an axis at unit acceleration."""
    unit = [float(k == axis) for k in range(3)]
    return [row[axis] for row in inertia], cross(unit, first)


def _wrench_on_parent(joint: Joint, torque: Vector, force: Vector) -> tuple[Vector, Vector]:
    """Torque and force about the parent's origin, in its axes."""
    force = joint.up(force)
    return plus(joint.up(torque), cross(joint.step, force)), force


def _on_base(machine: Machine, torque: Vector, force: Vector) -> Vector:
    """Generalised forces of the attitude, then of the position."""
    return times(transposed(machine.rates), torque) + times(machine.rotation, force)


def _joined(
    joint: Joint, mass: float, first: Vector, inertia: Matrix, parent: Body
) -> tuple[float, Vector, Matrix]:
    """Mass, first moment and inertia of a composite joined to its parent, about its origin.

    What is constant is summed before it meets what is not.
    """
    step = np.array(joint.step)
    first, inertia = joint.up(first), joint.up_symmetric(inertia)
    twice = [2 * a * b for a, b in zip(joint.step, first, strict=True)]
    constant = (parent.inertia_about_origin + shifted(mass, step)).tolist()
    moved = [list(row) for row in inertia]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moved[i][i] = inertia[i][i] + (twice[j] + twice[k])
        moved[i][j] = inertia[i][j] - (joint.step[i] * first[j] + joint.step[j] * first[i])
        moved[j][i] = moved[i][j]
    first = plus(first, (parent.moment + mass * step).tolist())
    return mass + parent.mass, first, matrix_plus(moved, constant)


@dataclass(frozen=True)
class Motion:
    """A body's angular velocity, and its accelerations while no coordinate accelerates."""

    velocity: Vector
    turning: Vector
    acceleration: Vector

    def spread(self) -> Matrix:
        """Matrix that takes a point of the body to its acceleration against the origin."""
        x, y, z = self.velocity
        a, b, c = self.turning
        xx, yy, zz, xy, yz, zx = x * x, y * y, z * z, x * y, y * z, z * x
        return [
            [-(yy + zz), xy - c, zx + b],
            [xy + c, -(zz + xx), yz - a],
            [zx - b, yz + a, -(xx + yy)],
        ]

    def turned(self, turn: Turn, rate: Scalar) -> Motion:
        """Motion of what turns on this body, about the same origin."""
        i, j = (turn.axis + 1) % 3, (turn.axis + 2) % 3
        velocity, turning = turn.down(self.velocity), turn.down(self.turning)
        turning[i] = turning[i] + velocity[j] * rate
        turning[j] = turning[j] - velocity[i] * rate
        velocity[turn.axis] = velocity[turn.axis] + rate
        return Motion(velocity, turning, turn.down(self.acceleration))

    def placed(self, joint: Joint) -> Motion:
        """Motion of this body at the place of a joint, in the axes it turns."""
        moved = plus(self.acceleration, times(self.spread(), joint.step))
        axes = transposed(joint.placement)
        return Motion(*(times(axes, x) for x in (self.velocity, self.turning, moved)))


def motions(machine: Machine, base_acceleration: Vector) -> list[Motion]:
    """Motion of every body, base first."""
    motion = Motion([machine.velocity[0], 0.0, 0.0], ZERO, ZERO)
    for axis in range(1, ATTITUDE):
        motion = motion.turned(machine.turns[axis], machine.velocity[axis])
    found = [Motion(motion.velocity, motion.turning, base_acceleration)]
    for i in range(1, machine.tree.joints + 1):
        joint, rate = machine.joints[i], machine.velocity[machine.row(i)]
        found.append(found[-1].placed(joint).turned(joint.turn, rate))
    return found


def wrench(body: Body, motion: Motion) -> tuple[Vector, Vector]:
    """Torque about the origin and force that keep a body in its motion."""
    first, inertia = body.moment.tolist(), body.inertia_about_origin.tolist()
    squares = [[a * b for b in motion.velocity] for a in motion.velocity]
    torque = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        gyroscopic = (
            (inertia[k][k] - inertia[j][j]) * squares[j][k]
            + inertia[i][k] * squares[i][j]
            - inertia[i][j] * squares[i][k]
            + inertia[j][k] * (squares[j][j] - squares[k][k])
        )
        torque.append(dot(inertia[i], motion.turning) + gyroscopic)
    force = [body.mass * entry for entry in motion.acceleration]
    return (
        plus(torque, cross(first, motion.acceleration)),
        plus(force, times(motion.spread(), first)),
    )
