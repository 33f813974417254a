"""How the base of a machine moves, in CasADi SX: by attitude x-y-z, as a free-flyer, or not."""

from __future__ import annotations

from typing import Protocol

from peers.casadi_motion import Motion
from peers.casadi_spatial import (
    ZERO,
    Matrix,
    Scalar,
    Turn,
    Vector,
    cross,
    minus,
    plus,
    times,
    transposed,
)
from peers.tree import ATTITUDE, BASE_VELOCITIES

Entries = dict[tuple[int, int], Scalar]


class MovingBase(Protocol):
    """The base's share of coordinates, velocities and forces; `rows` are its places among them.

    Generalised forces and accelerations are in the order of `rows`.
    """

    rows: tuple[int, ...]

    def motion(self, gravity: float) -> Motion:
        """Motion while no coordinate accelerates, gravity an acceleration upwards."""

    def accelerated(self, motion: Motion, accelerations: Vector) -> Motion:
        """The same motion where the coordinates accelerate."""

    def forces(self, torque: Vector, force: Vector) -> Vector:
        """Generalised forces of a wrench about the base's origin, in its axes."""

    def wrench(self, forces: Vector) -> tuple[Vector, Vector]:
        """Torque and force of generalised forces."""

    def mass_block(self, mass: float, first: Vector, inertia: Matrix) -> Entries:
        """Entries of the mass matrix on one side of its diagonal, by places among `rows`."""

    def accelerations(self, turning: Vector, acceleration: Vector, gravity: float) -> Vector:
        """Rates of the velocities, from accelerations against free fall."""


class TaitBryanBase:
    """Attitude x-y-z by its angles, then position in the world's axes."""

    def __init__(self, turning: list[tuple[Scalar, Scalar]], velocity: list[Scalar]) -> None:
        size = len(velocity)
        self.rows = (*range(ATTITUDE), *range(size - 3, size))
        self.turns = [Turn(axis, *turning[axis]) for axis in range(ATTITUDE)]
        self.velocity = velocity
        (cx, sx), (cy, sy), (cz, sz) = turning
        first, second = sx * sy, cx * sy
        self.rates = [[cy * cz, sz, 0.0], [-(cy * sz), cz, 0.0], [sy, 0.0, 1.0]]
        self.rotation = [
            [cy * cz, -(cy * sz), sy],
            [first * cz + cx * sz, cx * cz - first * sz, -(sx * cy)],
            [sx * sz - second * cz, second * sz + sx * cz, cx * cy],
        ]

    def motion(self, gravity: float) -> Motion:
        """Turned angle by angle."""
        motion = Motion([self.velocity[0], 0.0, 0.0], ZERO, ZERO)
        for axis in range(1, ATTITUDE):
            motion = motion.turned(self.turns[axis], self.velocity[axis])
        falling = [gravity * entry for entry in self.rotation[2]]
        return Motion(motion.velocity, motion.turning, falling)

    def accelerated(self, motion: Motion, accelerations: Vector) -> Motion:
        """By the rates of the attitude and the axes of the world."""
        turning = times(self.rates, accelerations[:ATTITUDE])
        moving = times(transposed(self.rotation), accelerations[ATTITUDE:])
        return motion.accelerated(turning, moving)

    def forces(self, torque: Vector, force: Vector) -> Vector:
        """By the rates of the attitude and the axes of the world."""
        return times(transposed(self.rates), torque) + times(self.rotation, force)

    def wrench(self, forces: Vector) -> tuple[Vector, Vector]:
        """The forces of the attitude by their axes."""
        _, pitch, yaw = self.turns
        across = (forces[0] - pitch.sine * forces[2]) / pitch.cosine
        torque = yaw.down([across, forces[1], forces[2]])
        return torque, times(transposed(self.rotation), forces[ATTITUDE:])

    def mass_block(self, mass: float, first: Vector, inertia: Matrix) -> Entries:
        """The composite turned back angle by angle."""
        entries: Entries = {(k, k): mass for k in range(3, BASE_VELOCITIES)}
        for axis in range(ATTITUDE - 1, -1, -1):
            entries[axis, axis] = inertia[axis][axis]
            torque, force = unit_wrench(axis, first, inertia)
            for turned in range(axis, -1, -1):
                turn = self.turns[turned]
                torque, force = turn.up(torque), turn.up(force)
                if turned:
                    entries[turned - 1, axis] = torque[turned - 1]
            entries |= {(3 + k, axis): force[k] for k in range(3)}
            turn = self.turns[axis]
            first, inertia = turn.up(first), turn.up_symmetric(inertia)
        return entries

    def accelerations(self, turning: Vector, acceleration: Vector, gravity: float) -> Vector:
        """Second derivatives of the angles and of the position."""
        _, pitch, yaw = self.turns
        bias = self.motion(0.0).turning
        across, second, third = yaw.up(minus(turning, bias))
        first = across / pitch.cosine
        x, y, z = times(self.rotation, acceleration)
        return [first, second, third - pitch.sine * first, x, y, z - gravity]


class FixedBase:
    """A base that does not move: it has no coordinates."""

    rows: tuple[int, ...] = ()

    def motion(self, gravity: float) -> Motion:
        """At rest."""
        return Motion(ZERO, ZERO, [0.0, 0.0, gravity])

    def accelerated(self, motion: Motion, accelerations: Vector) -> Motion:
        """The same: nothing accelerates it."""
        return motion

    def forces(self, torque: Vector, force: Vector) -> Vector:
        """None: the ground bears the wrench."""
        return []

    def wrench(self, forces: Vector) -> tuple[Vector, Vector]:
        """None that would move it."""
        return ZERO, ZERO

    def mass_block(self, mass: float, first: Vector, inertia: Matrix) -> Entries:
        """No entries."""
        return {}

    def accelerations(self, turning: Vector, acceleration: Vector, gravity: float) -> Vector:
        """None."""
        return []


class FreeFlyer:
    """Position and quaternion; linear, then angular velocity in the base's axes."""

    def __init__(self, quaternion: list[Scalar], velocity: list[Scalar]) -> None:
        x, y, z, w = quaternion
        self.rows = tuple(range(BASE_VELOCITIES))
        self.linear, self.angular = velocity[:3], velocity[3:BASE_VELOCITIES]
        twice = [2 * x, 2 * y]
        self.up = [
            twice[0] * z - twice[1] * w,
            twice[1] * z + twice[0] * w,
            1 - (twice[0] * x + twice[1] * y),
        ]

    def motion(self, gravity: float) -> Motion:
        """The velocities are in the base's axes as they are."""
        turned = cross(self.angular, self.linear)
        return Motion(self.angular, ZERO, plus(turned, [gravity * entry for entry in self.up]))

    def accelerated(self, motion: Motion, accelerations: Vector) -> Motion:
        """The accelerations are in the base's axes as they are."""
        return motion.accelerated(accelerations[3:], accelerations[:3])

    def forces(self, torque: Vector, force: Vector) -> Vector:
        """The wrench itself."""
        return [*force, *torque]

    def wrench(self, forces: Vector) -> tuple[Vector, Vector]:
        """The forces themselves."""
        return forces[3:], forces[:3]

    def mass_block(self, mass: float, first: Vector, inertia: Matrix) -> Entries:
        """The composite itself."""
        entries: Entries = {(k, k): mass for k in range(3)}
        for axis in range(3):
            torque, force = unit_wrench(axis, first, inertia)
            column = [*force, *torque[: axis + 1]]
            entries |= {(row, 3 + axis): entry for row, entry in enumerate(column)}
        return entries

    def accelerations(self, turning: Vector, acceleration: Vector, gravity: float) -> Vector:
        """Less what the velocity turns, and gravity."""
        return [*minus(acceleration, self.motion(gravity).acceleration), *turning]


def unit_wrench(axis: int, first: Vector, inertia: Matrix) -> tuple[Vector, Vector]:
    """Torque and force that turn a body about an axis at unit acceleration."""
    unit = [float(k == axis) for k in range(3)]
    return [row[axis] for row in inertia], cross(unit, first)
