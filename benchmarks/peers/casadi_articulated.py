"""Forward dynamics in CasADi SX by articulated bodies, the base solved as a block of six."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from peers.casadi_motion import Motion, wrench
from peers.casadi_recursions import Machine, motions
from peers.casadi_spatial import (
    ZERO,
    Joint,
    Matrix,
    Scalar,
    Vector,
    cross,
    dot,
    matrix_minus,
    matrix_plus,
    minus,
    mirrored,
    plus,
    product,
    skew,
    times,
    transposed,
)
from peers.tree import Body


@dataclass(frozen=True)
class Release:
    """What an arm joint leaves behind to find its own acceleration once its parent's is known.

    The joint accelerates by `drive` less the inner products of the body's accelerations, without
    the joint's own share, with `turning` and `moving`; `gyration` is the share of its rate.
    """

    drive: Scalar
    turning: Vector
    moving: Vector
    gyration: Vector


@dataclass(frozen=True)
class Articulated:
    """A body and what it carries, free to move: inertia and bias about the body's origin.

    Accelerations α and a take the torque I α + H a + `torque` and the force Hᵀ α + m a + `force`,
    with I the `inertia`, H the `coupling` and m the `mass`.
    """

    inertia: Matrix
    coupling: Matrix
    mass: Matrix
    torque: Vector
    force: Vector

    @classmethod
    def alone(cls, body: Body, velocity: Vector) -> Articulated:
        """A rigid body at an angular velocity."""
        inertia, mass = body.inertia_about_origin.tolist(), (body.mass * np.eye(3)).tolist()
        bias = wrench(body, Motion(velocity, ZERO, ZERO))
        return cls(inertia, skew(body.moment.tolist()), mass, *bias)

    def joined(self, other: Articulated) -> Articulated:
        """Both, moving as one."""
        return Articulated(
            matrix_plus(self.inertia, other.inertia),
            matrix_plus(self.coupling, other.coupling),
            matrix_plus(self.mass, other.mass),
            plus(self.torque, other.torque),
            plus(self.force, other.force),
        )

    def released(self, gyration: Vector, effort: Scalar) -> tuple[Articulated, Release]:
        """What the parent feels across a joint about z that `effort` drives, in body axes."""
        torque = plus(self.torque, times(self.inertia, gyration))
        force = plus(self.force, times(transposed(self.coupling), gyration))
        inverse = 1 / self.inertia[2][2]
        turning = [self.inertia[0][2] * inverse, self.inertia[1][2] * inverse, 1.0]
        moving = [entry * inverse for entry in self.coupling[2]]
        excess = effort - torque[2]
        inertia = [list(ZERO) for _ in range(3)]
        coupling = [list(ZERO) for _ in range(3)]
        for i in range(2):
            for j in range(2):
                inertia[i][j] = self.inertia[i][j] - turning[i] * self.inertia[j][2]
            for k in range(3):
                coupling[i][k] = self.coupling[i][k] - turning[i] * self.coupling[2][k]
        mass = [
            [self.mass[i][j] - moving[i] * self.coupling[2][j] for j in range(3)] for i in range(3)
        ]
        torque = [torque[0] + turning[0] * excess, torque[1] + turning[1] * excess, effort]
        force = plus(force, [entry * excess for entry in moving])
        felt = Articulated(mirrored(inertia), coupling, mirrored(mass), torque, force)
        return felt, Release(excess * inverse, turning, moving, gyration)

    def on_parent(self, joint: Joint, pull: Vector) -> Articulated:
        """The same in the parent's axes about its origin; `pull` accelerates the joint's place."""
        inertia, mass = joint.up_symmetric(self.inertia), joint.up_symmetric(self.mass)
        coupling = joint.up_tensor(self.coupling)
        torque = plus(joint.up(self.torque), times(coupling, pull))
        force = plus(joint.up(self.force), times(mass, pull))
        lever = skew(joint.step)
        moved = matrix_plus(coupling, product(lever, mass))
        change = matrix_minus(product(lever, transposed(coupling)), product(moved, lever))
        return Articulated(
            mirrored(matrix_plus(inertia, change)),
            moved,
            mass,
            plus(torque, cross(joint.step, force)),
            force,
        )


def forward_dynamics(machine: Machine) -> ca.SX:
    """Accelerations of the coordinates under generalised forces."""
    tree = machine.tree
    moving = motions(machine, replace(machine.base.motion(0.0), acceleration=ZERO))
    pulls = [
        times(Motion(moving[body.parent].velocity, ZERO, ZERO).spread(), body.step.tolist())
        for body in tree.bodies[1:]
    ]
    releases = []
    whole = [
        Articulated.alone(body, motion.velocity)
        for body, motion in zip(tree.bodies, moving, strict=True)
    ]
    for i in range(tree.joints, 0, -1):
        x, y, _ = moving[i].velocity
        rate, effort = machine.velocity[tree.row(i)], machine.force[tree.row(i)]
        felt, release = whole[i].released([y * rate, -(x * rate), 0.0], effort)
        releases.append(release)
        parent = tree.bodies[i].parent
        whole[parent] = felt.on_parent(machine.joints[i], pulls[i - 1]).joined(whole[parent])
    found = [_base_accelerations(machine, whole[0])]
    result = [0.0] * tree.velocities
    in_coordinates = machine.base.accelerations(*found[0], tree.gravity)
    for row, entry in zip(machine.base.rows, in_coordinates, strict=True):
        result[row] = entry
    for i, release in enumerate(reversed(releases), start=1):
        joint, (turning, acceleration) = machine.joints[i], found[tree.bodies[i].parent]
        acceleration = plus(acceleration, cross(turning, joint.step), pulls[i - 1])
        turning, acceleration = joint.down(turning), joint.down(acceleration)
        own = dot(release.moving, acceleration) + dot(release.turning, turning)
        relative = result[tree.row(i)] = release.drive - own
        found.append((plus(turning, [*release.gyration[:2], relative]), acceleration))
    return ca.vertcat(*result)


def _base_accelerations(machine: Machine, whole: Articulated) -> tuple[Vector, Vector]:
    """Angular acceleration of the base, and that of its origin against free fall."""
    if not machine.base.rows:
        return ZERO, machine.base.motion(machine.tree.gravity).acceleration
    torque, force = machine.base.wrench([machine.force[row] for row in machine.base.rows])
    right = minus(force + torque, whole.force + whole.torque)
    upper = [a + b for a, b in zip(whole.mass, transposed(whole.coupling), strict=True)]
    lower = [a + b for a, b in zip(whole.coupling, whole.inertia, strict=True)]
    solution = _solved(upper + lower, right)
    return solution[3:], solution[:3]


def _solved(matrix: Matrix, right: Vector) -> Vector:
    """Solution of a symmetric system by LDLᵀ."""
    size = len(right)
    left, right = [list(row) for row in matrix], list(right)
    inverses, factors = [], []
    for k in range(size):
        inverse = 1 / left[k][k]
        factor = [left[i][k] * inverse for i in range(size)]
        for i in range(k + 1, size):
            for j in range(k + 1, i + 1):
                left[i][j] = left[i][j] - factor[i] * left[j][k]
            right[i] = right[i] - factor[i] * right[k]
        inverses.append(inverse)
        factors.append(factor)
    for k in range(size - 1, -1, -1):
        right[k] = right[k] * inverses[k]
        for i in range(k + 1, size):
            right[k] = right[k] - factors[k][i] * right[i]
    return right
