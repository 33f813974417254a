"""Motion of a body and the wrench that it takes, in CasADi SX.

All vectors are in the axes of the body they belong to. Accelerations are the classical ones of the
bodies' origins.
"""

from __future__ import annotations

from dataclasses import dataclass

from peers.casadi_spatial import (
    Joint,
    Matrix,
    Scalar,
    Turn,
    Vector,
    cross,
    dot,
    plus,
    times,
    transposed,
)
from peers.tree import Body


@dataclass(frozen=True)
class Motion:
    """A body's angular velocity, and its accelerations."""

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

    def accelerated(self, turning: Vector, moving: Vector) -> Motion:
        """Motion with more of either acceleration."""
        turning, moving = plus(self.turning, turning), plus(self.acceleration, moving)
        return Motion(self.velocity, turning, moving)

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
