"""Recursive Newton–Euler equations of the tree, in world axes (Luh, Walker and Paul, 1980).

The constrained joints are joints here, so that what holds them comes out as their effort.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.verification.formulation import EVERYTHING
from gibbs_codegen.verification.tree import WORLD, Array, Frames, Point, Tree, cross, times


@dataclass(frozen=True)
class _Motion:
    """Motion of a joint's frame in world axes, each (…, 3)."""

    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array

    def at(self, lever: Array) -> tuple[Array, Array]:
        """Velocity and acceleration of a point fixed in the frame, `lever` away from its origin."""
        turning = cross(self.angular_velocity, lever)
        return (
            self.velocity + turning,
            self.acceleration
            + cross(self.angular_acceleration, lever)
            + cross(self.angular_velocity, turning),
        )


class NewtonEuler:
    """A formulation (see `formulation`): balance of forces and moments, body by body."""

    name = "Newton–Euler"
    gives = EVERYTHING
    limit = 1e-10
    growth = 0

    def __init__(self, tree: Tree) -> None:
        self.tree = tree

    def mass_matrix(self, q: Array) -> Array:
        """Efforts of unit accelerations, one by one, at rest and weightless."""
        tree = self.tree
        every = tree.spread(q)[:, None]
        columns = self._efforts(every, np.zeros_like(every), np.eye(tree.size)[None], 0.0)
        return np.swapaxes(columns, -1, -2)

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """Efforts of a motion against inertia and gravity."""
        tree = self.tree
        return self._efforts(tree.spread(q), tree.spread(v), tree.spread(a), tree.gravity)

    def input_matrix(self, q: Array) -> Array:
        """Thrusts and drag torques by the Jacobians of the motors, and the arm's own efforts."""
        tree = self.tree
        frames = tree.frames(tree.spread(q))
        rotations = frames.rotations
        columns = []
        for motor in tree.motors:
            jacobian = self._jacobian(frames, motor.seat)
            thrust = rotations[motor.seat.joint] @ motor.direction
            wrench = np.concatenate([thrust, motor.drag * thrust], axis=-1)
            columns.append(np.einsum("sij,si->sj", jacobian, wrench))
        for place in tree.arm:
            columns.append(np.broadcast_to(np.eye(tree.size)[place], (len(q), tree.size)))
        return np.stack(columns, axis=-1)

    def positions(self, q: Array) -> Array:
        """World positions of the named points."""
        rotations, positions, _ = self.tree.frames(self.tree.spread(q))
        return np.stack(
            [
                positions[point.joint] + rotations[point.joint] @ point.local
                for point in self.tree.points
            ],
            axis=-2,
        )

    def tip_pose(self, q: Array) -> Array:
        """Homogeneous transform of the tip."""
        rotations, positions, _ = self.tree.frames(self.tree.spread(q))
        joint, local = self.tree.tip.joint, self.tree.tip.local
        pose = np.zeros((len(q), 4, 4))
        pose[:, :3, :3] = rotations[joint]
        pose[:, :3, 3] = positions[joint] + rotations[joint] @ local
        pose[:, 3, 3] = 1.0
        return pose

    def tip_jacobian(self, q: Array) -> Array:
        """Axes and levers of the joints inboard of the tip."""
        return self._jacobian(self.tree.frames(self.tree.spread(q)), self.tree.tip)

    def tip_bias_acceleration(self, q: Array, v: Array) -> Array:
        """How the tip accelerates where all joints keep their rates."""
        tree = self.tree
        every = tree.spread(q)
        frames = tree.frames(every)
        rotations = frames.rotations
        motions = self._motions(tree.spread(v), np.zeros_like(every), frames)
        moving = motions[tree.tip.joint]
        _, acceleration = moving.at(rotations[tree.tip.joint] @ tree.tip.local)
        return np.concatenate([acceleration, moving.angular_acceleration], axis=-1)

    def kinetic_energy(self, q: Array, v: Array) -> Array:
        """König's theorem, summed over the bodies."""
        tree = self.tree
        every = tree.spread(q)
        frames = tree.frames(every)
        rotations = frames.rotations
        motions = self._motions(tree.spread(v), np.zeros_like(every), frames)
        energy = np.zeros(len(q))
        for joint, motion, rotation in zip(tree.joints, motions, rotations, strict=True):
            velocity, _ = motion.at(rotation @ joint.com)
            own = np.einsum("sji,sj->si", rotation, motion.angular_velocity)
            energy += 0.5 * joint.mass * np.sum(velocity**2, axis=-1)
            energy += 0.5 * np.einsum("si,ij,sj->s", own, joint.inertia, own)
        return energy

    def potential_energy(self, q: Array) -> Array:
        """Weight times height, summed over the bodies."""
        tree = self.tree
        rotations, positions, _ = tree.frames(tree.spread(q))
        energy = np.zeros(len(q))
        for joint, rotation, position in zip(tree.joints, rotations, positions, strict=True):
            energy += joint.mass * tree.gravity * (position + rotation @ joint.com)[:, 2]
        return energy

    def _efforts(self, q: Array, v: Array, a: Array, gravity: float) -> Array:
        """Effort of every joint (…, size); the arguments broadcast."""
        tree = self.tree
        q, v, a = np.broadcast_arrays(q, v, a)
        frames = tree.frames(q)
        rotations = frames.rotations
        motions = self._motions(v, a, frames)
        upwards = np.array([0.0, 0.0, gravity])
        forces = []
        moments = []
        for joint, motion, rotation in zip(tree.joints, motions, rotations, strict=True):
            lever = rotation @ joint.com
            _, acceleration = motion.at(lever)
            force = joint.mass * (acceleration + upwards)
            inertia = rotation @ joint.inertia @ np.swapaxes(rotation, -1, -2)
            spin = motion.angular_velocity
            moment = times(inertia, motion.angular_acceleration)
            moment = moment + cross(spin, times(inertia, spin))
            forces.append(force)
            moments.append(moment + cross(lever, force))
        efforts = np.zeros(q.shape)
        for number in range(len(tree.joints) - 1, -1, -1):
            joint = tree.joints[number]
            axis = rotations[number][..., joint.axis]
            transmitted = moments[number] if joint.revolute else forces[number]
            efforts[..., joint.place] = np.sum(axis * transmitted, axis=-1)
            if joint.parent != WORLD:
                lever = frames.steps[number]
                forces[joint.parent] = forces[joint.parent] + forces[number]
                moments[joint.parent] = (
                    moments[joint.parent] + moments[number] + cross(lever, forces[number])
                )
        return efforts

    def _motions(self, v: Array, a: Array, frames: Frames) -> list[_Motion]:
        still = _Motion(*(np.zeros((*v.shape[:-1], 3)) for _ in range(4)))
        motions: list[_Motion] = []
        for number, joint in enumerate(self.tree.joints):
            parent = still if joint.parent == WORLD else motions[joint.parent]
            axis = frames.rotations[number][..., joint.axis]
            rate = axis * v[..., joint.place, None]
            gain = axis * a[..., joint.place, None]
            dragged = cross(parent.angular_velocity, rate)
            velocity, acceleration = parent.at(frames.steps[number])
            if joint.revolute:
                motion = _Motion(
                    velocity,
                    parent.angular_velocity + rate,
                    acceleration,
                    parent.angular_acceleration + gain + dragged,
                )
            else:
                motion = _Motion(
                    velocity + rate,
                    parent.angular_velocity,
                    acceleration + gain + 2.0 * dragged,
                    parent.angular_acceleration,
                )
            motions.append(motion)
        return motions

    def _jacobian(self, frames: Frames, point: Point) -> Array:
        """World-axes Jacobian of a point (states, 6, size), linear rows first."""
        tree = self.tree
        number = point.joint
        lever = frames.rotations[number] @ point.local
        jacobian = np.zeros((len(lever), 6, tree.size))
        while number != WORLD:
            joint = tree.joints[number]
            axis = frames.rotations[number][..., joint.axis]
            if joint.revolute:
                jacobian[:, :3, joint.place] = cross(axis, lever)
                jacobian[:, 3:, joint.place] = axis
            else:
                jacobian[:, :3, joint.place] = axis
            lever = lever + frames.steps[number]
            number = joint.parent
        return jacobian
