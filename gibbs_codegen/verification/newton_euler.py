"""Recursive Newton–Euler equations of the tree, in world axes (Luh, Walker and Paul, 1980).

The constrained joints are joints here, so that what holds them comes out as their effort.
"""

from __future__ import annotations

import numpy as np

from gibbs_codegen.verification.body_wrenches import joint_wrenches
from gibbs_codegen.verification.formulation import Quantities
from gibbs_codegen.verification.joints import WORLD, Point
from gibbs_codegen.verification.motions import Motion, joint_motions
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Frames, Tree
from gibbs_codegen.verification.vectors import Array, cross, times


class NewtonEuler:
    """A formulation (see `formulation`): balance of forces and moments, body by body."""

    name = "Newton–Euler"
    limit = 1e-10
    growth = 0

    def __init__(self, tree: Tree) -> None:
        self.tree = tree

    def at(self, states: States) -> Quantities:
        """Everything that the formulation computes."""
        tree = self.tree
        q, v, a = map(tree.spread, (states.q, states.v, states.a))
        frames = tree.frames(q)
        steady = joint_motions(tree, v, np.zeros_like(a), frames)
        still = joint_motions(tree, np.zeros_like(v), np.zeros_like(a), frames)
        moved = joint_motions(tree, v, a, frames)
        centre = self._centre(frames)
        bias = [self._bias(steady, frames, point) for point in tree.named]
        return Quantities(
            mass_matrix=self.mass_matrix(states.q),
            residual=-self._efforts(steady, frames, tree.gravity),
            inverse_dynamics=self._efforts(moved, frames, tree.gravity),
            poses=tree.poses(frames),
            jacobians=np.stack([self._jacobian(frames, seat) for seat in tree.seats], axis=1),
            kinetic_energy=self._kinetic_energy(steady, frames),
            potential_energy=self._potential_energy(frames),
            positions=tree.positions(frames, tree.points),
            bias_accelerations=np.stack(bias, axis=1),
            centre_of_mass=centre,
            centre_jacobian=self._centre_jacobian(frames),
            momentum=self._momentum(steady, frames, centre),
            gravity_forces=-self._efforts(still, frames, tree.gravity),
            joint_wrenches=joint_wrenches(tree, moved, frames, states.u),
        )

    def mass_matrix(self, q: Array) -> Array:
        """Mass matrix (s, size, size) of all joints, for q (s, nv) of the free ones.

        Its columns are efforts of unit accelerations, one by one, at rest and without gravity.
        """
        tree = self.tree
        frames = tree.frames(tree.spread(q)[:, None])
        units = np.eye(tree.size)[None]
        motions = joint_motions(tree, np.zeros_like(units), units, frames)
        efforts = self._efforts(motions, frames, 0.0)
        return np.swapaxes(efforts, -1, -2)

    def _kinetic_energy(self, motions: list[Motion], frames: Frames) -> Array:
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

    def _centre(self, frames: Frames) -> Array:
        """The centre of mass, (s, 3)."""
        bodies = zip(self.tree.joints, frames.rotations, frames.positions, strict=True)
        moment: Array = np.zeros(3)
        for joint, rotation, position in bodies:
            moment = moment + joint.mass * (position + rotation @ joint.com)
        return moment / self.tree.mass

    def _centre_jacobian(self, frames: Frames) -> Array:
        """Jacobian of the centre of mass, (s, 3, size)."""
        moment: Array = np.zeros((3, self.tree.size))
        for number, joint in enumerate(self.tree.joints):
            jacobian = self._jacobian(frames, Point(number, joint.com))
            moment = moment + joint.mass * jacobian[:, :3]
        return moment / self.tree.mass

    def _momentum(self, motions: list[Motion], frames: Frames, centre: Array) -> Array:
        """Momentum (s, 6), kg m/s and kg m²/s: linear, then angular about the centre of mass."""
        linear: Array = np.zeros(3)
        angular: Array = np.zeros(3)
        rotations, positions, _ = frames
        for number, (joint, motion) in enumerate(zip(self.tree.joints, motions, strict=True)):
            lever, spin = rotations[number] @ joint.com, motion.angular_velocity
            push = joint.mass * motion.at(lever)[0]
            inertia = rotations[number] @ joint.inertia @ np.swapaxes(rotations[number], -1, -2)
            about = positions[number] + lever - centre
            linear, angular = linear + push, angular + cross(about, push) + times(inertia, spin)
        return np.concatenate([linear, angular], axis=-1)

    def _efforts(self, motions: list[Motion], frames: Frames, gravity: float) -> Array:
        """Efforts (…, size), N m and N, of the joints against inertia and `gravity`, in m/s²."""
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

    @staticmethod
    def _bias(motions: list[Motion], frames: Frames, point: Point) -> Array:
        """Acceleration (s, 6), m/s² and rad/s², of a point and of its frame, linear first."""
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
