"""Recursive Newton–Euler equations of the tree, in world axes (Luh, Walker and Paul, 1980).

The constrained joints are joints here, so that what holds them comes out as their effort.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gibbs_codegen.verification.formulation import Quantities
from gibbs_codegen.verification.joints import WORLD, Point
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Frames, Tree
from gibbs_codegen.verification.vectors import Array, cross, times


@dataclass(frozen=True)
class _Motion:
    """Motion of a joint's frame in world axes, each (…, 3)."""

    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array

    def at(self, lever: Array) -> tuple[Array, Array]:
        """Velocity and acceleration of a point that is fixed in the frame."""
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
    limit = 1e-10
    growth = 0

    def __init__(self, tree: Tree) -> None:
        self.tree = tree

    def at(self, states: States) -> Quantities:
        """Everything that the formulation computes.

        Args:
            states: The states to compute at.

        Returns:
            The quantities at those states.
        """
        tree = self.tree
        q, v, a = map(tree.spread, (states.q, states.v, states.a))
        frames = tree.frames(q)
        steady = self._motions(v, np.zeros_like(a), frames)
        named = tree.seats[len(tree.motors) :]
        return Quantities(
            mass_matrix=self.mass_matrix(states.q),
            residual=-self._efforts(steady, frames, tree.gravity),
            inverse_dynamics=self._efforts(self._motions(v, a, frames), frames, tree.gravity),
            poses=tree.poses(frames),
            jacobians=np.stack([self._jacobian(frames, seat) for seat in tree.seats], axis=1),
            kinetic_energy=self._kinetic_energy(steady, frames),
            potential_energy=self._potential_energy(frames),
            positions=tree.positions(frames, tree.points),
            bias_accelerations=np.stack([self._bias(steady, frames, x) for x in named], axis=1),
        )

    def mass_matrix(self, q: Array) -> Array:
        """Efforts of unit accelerations, one by one, at rest and without gravity.

        Args:
            q: Coordinates of the free joints, (s, nv).

        Returns:
            Mass matrix of all joints, (s, size, size).
        """
        tree = self.tree
        frames = tree.frames(tree.spread(q)[:, None])
        units = np.eye(tree.size)[None]
        efforts = self._efforts(self._motions(np.zeros_like(units), units, frames), frames, 0.0)
        return np.swapaxes(efforts, -1, -2)

    def _kinetic_energy(self, motions: list[_Motion], frames: Frames) -> Array:
        """König's theorem, summed over the bodies."""
        energy: Array = np.zeros(())
        for joint, motion, rotation in zip(
            self.tree.joints, motions, frames.rotations, strict=True
        ):
            velocity, _ = motion.at(rotation @ joint.com)
            own = np.einsum("sji,sj->si", rotation, motion.angular_velocity)
            energy = energy + 0.5 * joint.mass * np.sum(velocity**2, axis=-1)
            energy = energy + 0.5 * np.einsum("si,ij,sj->s", own, joint.inertia, own)
        return energy

    def _potential_energy(self, frames: Frames) -> Array:
        """Weight times height, summed over the bodies."""
        rotations, positions, _ = frames
        energy: Array = np.zeros(())
        for joint, rotation, position in zip(self.tree.joints, rotations, positions, strict=True):
            height = (position + rotation @ joint.com)[:, 2]
            energy = energy + joint.mass * self.tree.gravity * height
        return energy

    def _efforts(self, motions: list[_Motion], frames: Frames, gravity: float) -> Array:
        """Efforts of the joints against inertia and gravity.

        Args:
            motions: The motion of each joint's frame.
            frames: The joints' frames.
            gravity: Acceleration of free fall in m/s².

        Returns:
            Torques in N m and forces in N, (…, size).
        """
        joints, rotations = self.tree.joints, frames.rotations
        upwards = np.array([0.0, 0.0, gravity])
        forces = []
        moments = []
        for joint, motion, rotation in zip(joints, motions, rotations, strict=True):
            lever = rotation @ joint.com
            _, acceleration = motion.at(lever)
            force = joint.mass * (acceleration + upwards)
            inertia = rotation @ joint.inertia @ np.swapaxes(rotation, -1, -2)
            spin = motion.angular_velocity
            moment = times(inertia, motion.angular_acceleration)
            moment = moment + cross(spin, times(inertia, spin))
            forces.append(force)
            moments.append(moment + cross(lever, force))
        efforts = np.empty((*forces[-1].shape[:-1], len(joints)))
        for number in range(len(joints) - 1, -1, -1):
            joint = joints[number]
            transmitted = moments[number] if joint.revolute else forces[number]
            axis = rotations[number][..., joint.axis]
            efforts[..., joint.place] = np.sum(axis * transmitted, axis=-1)
            if joint.parent != WORLD:
                lever = cross(frames.steps[number], forces[number])
                forces[joint.parent] = forces[joint.parent] + forces[number]
                moments[joint.parent] = moments[joint.parent] + moments[number] + lever
        return efforts

    def _motions(self, v: Array, a: Array, frames: Frames) -> list[_Motion]:
        """Motions of the joints' frames, from the world outwards.

        Args:
            v: Rates of all joints in rad/s and m/s, (…, size).
            a: Their accelerations, (…, size).
            frames: The joints' frames; their leading axes broadcast against those of the rates.

        Returns:
            The motion of each frame, in the joints' order.
        """
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

    @staticmethod
    def _bias(motions: list[_Motion], frames: Frames, point: Point) -> Array:
        """Acceleration of a point and its frame without accelerations of the coordinates.

        Args:
            motions: Of all joints.
            frames: Where they are.
            point: The point.

        Returns:
            World axes, (states, 6), linear entries first.
        """
        motion = motions[point.joint]
        _, linear = motion.at(frames.rotations[point.joint] @ point.local)
        return np.concatenate([linear, motion.angular_acceleration], axis=-1)

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
