"""The tree in Pinocchio, where that is installed: composite bodies, Newton–Euler, Jacobians."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from gibbs_codegen.verification.formulation import EVERYTHING
from gibbs_codegen.verification.tree import WORLD, Array, Point, Tree

_KINDS = {
    True: (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ),
    False: (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ),
}
_WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class Pinocchio:
    """A formulation (see `formulation`) by the library of that name."""

    name = "Pinocchio"
    gives = EVERYTHING
    limit = 1e-10
    growth = 1

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self._model = pin.Model()
        self._model.gravity.linear = np.array([0.0, 0.0, -tree.gravity])
        self._ids: list[int] = []
        for number, joint in enumerate(tree.joints):
            parent = 0 if joint.parent == WORLD else self._ids[joint.parent]
            kind = _KINDS[joint.revolute][joint.axis]()
            placement = pin.SE3(joint.rotation, joint.offset)
            self._ids.append(self._model.addJoint(parent, kind, placement, f"joint_{number}"))
            inertia = pin.Inertia(joint.mass, joint.com, joint.inertia)
            self._model.appendBodyToJoint(self._ids[-1], inertia, pin.SE3.Identity())
        self._data = self._model.createData()
        # Place of each of Pinocchio's coordinates among the tree's, and the other way about.
        self._places = np.empty(tree.size, int)
        for joint, identity in zip(tree.joints, self._ids, strict=True):
            self._places[self._model.joints[identity].idx_v] = joint.place
        self._order = np.argsort(self._places)

    def mass_matrix(self, q: Array) -> Array:
        """By the composite rigid body algorithm."""
        matrices = [pin.crba(self._model, self._data, x).copy() for x in self._spread(q)]
        return np.array(matrices)[:, self._order][:, :, self._order]

    def inverse_dynamics(self, q: Array, v: Array, a: Array) -> Array:
        """By the recursive Newton–Euler algorithm."""
        states = zip(self._spread(q), self._spread(v), self._spread(a), strict=True)
        efforts = [pin.rnea(self._model, self._data, *state).copy() for state in states]
        return np.array(efforts)[:, self._order]

    def input_matrix(self, q: Array) -> Array:
        """By the motors' Jacobians."""
        matrices = []
        for x in self._spread(q):
            columns = []
            for motor in self.tree.motors:
                jacobian = self._jacobian(x, motor.seat)
                thrust = self._placement(motor.seat).rotation @ motor.direction
                columns.append(jacobian.T @ np.concatenate([thrust, motor.drag * thrust]))
            columns += [np.eye(self.tree.size)[place] for place in self.tree.arm]
            matrices.append(np.transpose(columns))
        return np.array(matrices)

    def positions(self, q: Array) -> Array:
        """By forward kinematics."""
        places = []
        for x in self._spread(q):
            pin.forwardKinematics(self._model, self._data, x)
            places.append([self._placement(point).translation for point in self.tree.points])
        return np.array(places)

    def tip_pose(self, q: Array) -> Array:
        """By forward kinematics."""
        poses = []
        for x in self._spread(q):
            pin.forwardKinematics(self._model, self._data, x)
            poses.append(self._placement(self.tree.tip).homogeneous)
        return np.array(poses)

    def tip_jacobian(self, q: Array) -> Array:
        """The frame's Jacobian."""
        return np.array([self._jacobian(x, self.tree.tip) for x in self._spread(q)])

    def tip_bias_acceleration(self, q: Array, v: Array) -> Array:
        """The frame's classical acceleration."""
        tip = self.tree.tip
        still = np.zeros(self.tree.size)
        accelerations = []
        for x, rate in zip(self._spread(q), self._spread(v), strict=True):
            pin.forwardKinematics(self._model, self._data, x, rate, still)
            accelerations.append(
                pin.getFrameClassicalAcceleration(
                    self._model,
                    self._data,
                    self._ids[tip.joint],
                    pin.SE3(np.eye(3), tip.local),
                    _WORLD_AXES,
                ).vector
            )
        return np.array(accelerations)

    def kinetic_energy(self, q: Array, v: Array) -> Array:
        """By Pinocchio's function of that name."""
        states = zip(self._spread(q), self._spread(v), strict=True)
        return np.array([pin.computeKineticEnergy(self._model, self._data, *s) for s in states])

    def potential_energy(self, q: Array) -> Array:
        """By Pinocchio's function of that name."""
        states = self._spread(q)
        return np.array([pin.computePotentialEnergy(self._model, self._data, x) for x in states])

    def _spread(self, values: Array) -> Array:
        every: Array = self.tree.spread(values)[:, self._places]
        return every

    def _placement(self, point: Point) -> pin.SE3:
        return self._data.oMi[self._ids[point.joint]] * pin.SE3(np.eye(3), point.local)

    def _jacobian(self, x: Array, point: Point) -> Array:
        identity = self._ids[point.joint]
        pin.computeJointJacobians(self._model, self._data, x)
        at_joint = pin.getJointJacobian(self._model, self._data, identity, _WORLD_AXES)
        lever = self._data.oMi[identity].rotation @ point.local
        linear = at_joint[:3] + np.cross(at_joint[3:].T, lever).T
        jacobian: Array = np.concatenate([linear, at_joint[3:]])[:, self._order]
        return jacobian
